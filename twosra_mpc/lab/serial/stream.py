"""A plan sent to a robot over a serial line; at the end the robot is off, however it ends.

With poses of a camera the plan is tracked, corrected and planned again; without, it is played: by
temperature reports, or by the clock and the model's heat if the robot reports nothing. The run's
file is written so that an ending of any kind leaves one.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from twosra_mpc.arguments import Word, public
from twosra_mpc.checking.verification import verify
from twosra_mpc.errors import InputError, NoPlanError, RobotError, TwosraError
from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import Controller
from twosra_mpc.execution.executor import plan_controller, run_controller
from twosra_mpc.execution.run import Ending, Run, RunRecord
from twosra_mpc.execution.settings import ExecutorSettings, Patience
from twosra_mpc.files import write_json
from twosra_mpc.interrupts import deferred_interrupts
from twosra_mpc.lab.serial.playing import Playing
from twosra_mpc.lab.serial.port import Clock, Port, SteppedClock
from twosra_mpc.lab.serial.pose_lines import PoseLines
from twosra_mpc.lab.serial.robot import RATE_HZ, SerialRobot, connected
from twosra_mpc.planning.planner import plan_again
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array


class Confirm(Word):
    """Condition on which the phases of a stream begin."""

    REQUIRED = "required"  # by temperature reports, or not at all
    NEVER = "never"  # at the plan's times; heaters by the model


class StreamError(TwosraError):
    """A stream ended before the plan did.

    Attributes:
        time_s: When, since the stream began.
        during: Which phase it was in, or waited for.
    """

    def __init__(self, time_s: float, during: str, reason: str) -> None:
        self.time_s, self.during, self.reason = time_s, during, reason
        super().__init__(f"stopped after {time_s:z.1f} s, {during}: {reason}")


class StreamState(NamedTuple):
    """State of a stream, for a progress line.

    Attributes:
        time_s: Since the stream began.
        during: Which phase it is in, or waits for.
        known: What is known about the segments, in words; empty while it listens for that.
    """

    time_s: float
    during: str
    known: str = ""


class SentLine(NamedTuple):
    """A line to the robot, and when it is sent, from the beginning [s]."""

    time_s: float
    line: str


@public
def stream(
    plan: Plan,
    port: Port,
    clock: Clock,
    *,
    rate_Hz: float = RATE_HZ,
    confirm: Confirm = Confirm.REQUIRED,
    poses: PoseLines | None = None,
    log: Path | None = None,
    patience: Patience | None = None,
    on_state: Callable[[StreamState], None] = lambda state: None,
) -> Run:
    """Send a plan to a robot and return what happened.

    The robot stands, heaters off, when this returns or raises; only a line that is dead prevents
    it, and then the error says so. Ctrl-C, SIGTERM and their relatives raise KeyboardInterrupt.

    Args:
        plan: A plan that is verified, here once more.
        port: The line to the robot.
        clock: Time.
        rate_Hz: Commands per second while driving; with ``poses`` the camera's rate counts.
        confirm: When phases begin.
        poses: What sees the robot; without, it is driven blind.
        log: File for the run, written while it goes on and at every ending.
        patience: How long to wait for what.
        on_state: Called with every command.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the line cannot carry the plan or the rate, the plan cannot be sent without
            reports, or poses are to be followed without them.
        StreamError: If the stream ended before the plan did.
    """
    check_sendable(plan, confirm)
    if poses is not None and confirm is Confirm.NEVER:
        allowed = "required: a robot that is followed by a camera begins its phases by reports"
        raise InputError("confirm", str(confirm), allowed)
    chosen = rate_Hz, confirm, poses, patience or Patience()
    file = None if log is None else RunFile(log)
    return _Stream(plan, clock, on_state, file).run(port, *chosen)


@public
def preview(plan: Plan, rate_Hz: float = RATE_HZ) -> list[SentLine]:
    """Return what would be sent to a robot that reports nothing; takes no time.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the line cannot carry the plan or the rate.
    """
    check_sendable(plan)
    clock = SteppedClock()
    line = Recorder(clock)
    chosen = rate_Hz, Confirm.NEVER, None, Patience()
    _Stream(plan, clock, lambda state: None, None).run(line, *chosen)
    return line.sent


def check_sendable(plan: Plan, confirm: Confirm | None = None) -> None:
    """Check that a plan may be sent, so confirmed.

    Raises:
        NoPlanError: If it does not pass the check again.
        InputError: If it keeps a segment warm, which the firmware's commands cannot say; or if
            nothing is to confirm its transitions, and it reserves no time for slow ones.
    """
    if not (checked := verify(plan.trajectory)).ok:
        raise NoPlanError(Status.FAILED, f"verified again, {checked.problems[0]}")
    heater, setpoint_C = plan.robot.heater, plan.samples.heater_setpoint_C
    if ((setpoint_C > heater.rigid_setpoint_C) & (setpoint_C < heater.soft_setpoint_C)).any():
        allowed = "another: the firmware can heat a segment or not, but not keep it warm"
        raise InputError("heating", plan.problem.heating, allowed)
    reserved = plan.problem.transition_quantile is not None or not plan.transitions
    if confirm is Confirm.NEVER and not reserved:
        allowed = (
            "a share such as 0.9 in the scenario: where nothing confirms that a segment is soft or"
            " rigid, the plan must wait for those that melt and freeze slowly; or --confirm"
            " required, with a robot that reports"
        )
        raise InputError("transition_quantile", None, allowed)


class Recorder:
    """A line to nowhere that keeps what is sent."""

    def __init__(self, clock: SteppedClock) -> None:
        """Nothing is sent yet."""
        self._clock, self.sent = clock, list[SentLine]()

    def write(self, data: bytes) -> None:
        """Keep a line."""
        self.sent.append(SentLine(self._clock.now_s(), data.decode("ascii")))

    def read_lines(self) -> list[bytes]:
        """Nothing ever comes back."""
        return []


@dataclass(eq=False)
class _Stream:
    """One stream on its way."""

    plan: Plan
    clock: Clock
    on_state: Callable[[StreamState], None]
    file: RunFile | None
    during: str = "before the plan began"

    def run(
        self,
        port: Port,
        rate_Hz: float,
        confirm: Confirm,
        poses: PoseLines | None,
        patience: Patience,
    ) -> Run:
        at = self.plan.problem, port, self.clock
        with deferred_interrupts():  # none while the log is written
            try:
                with connected(*at, rate_Hz=rate_Hz, poses=poses, patience=patience) as robot:
                    if confirm is Confirm.REQUIRED:
                        self._listen(robot)
                    run = self._played(robot) if poses is None else self._tracked(robot, poses)
            except BaseException as error:
                if self.file is not None:
                    words = "interrupted" if isinstance(error, KeyboardInterrupt) else error
                    with suppress(InputError):  # what stopped the robot is what must be told
                        self.file.end(f"{self.during}: {words}")
                if isinstance(error, RobotError):
                    raise StreamError(self.clock.now_s(), self.during, str(error)) from error
                raise
            if self.file is not None:
                self.file.save(run)
        return run

    def _listen(self, robot: SerialRobot) -> None:
        self.on_state(StreamState(self.clock.now_s(), "listening for temperatures"))
        robot.listen()
        if not robot.reports:
            raise RobotError(f"no temperature report within {robot.patience.listen_s:zg} s")

    def _played(self, robot: SerialRobot) -> Run:
        """Send the plan as it is."""
        belief = Belief(
            self.plan.problem, robot.camera, robot.patience, sighted=False, reports=robot.reports
        )
        policy = Playing(belief, self.plan, reports=robot.reports)
        return run_controller(robot, Controller(belief, policy), self._tell)

    def _tracked(self, robot: SerialRobot, poses: PoseLines) -> Run:
        """Follow the plan by what is seen, to its goal."""
        self._check_place(robot.look_out(lambda: poses.taken > 0, poses.describe), robot.patience)
        settings = ExecutorSettings(
            patience=robot.patience, dead_zone_rad_s=robot.robot.limits.wheel_speed_min_rad_s
        )
        controller = plan_controller(self.plan, robot.camera, settings, ThinkAside(plan_again))
        return run_controller(robot, controller, self._tell)

    def _check_place(self, frames: Array, patience: Patience) -> None:
        """Refuse a robot that is seen (k, 3 + n) farther from the plan's start than it may be.

        Raises:
            RobotError: If it is.
        """
        away = frames.mean(axis=0) - self.plan.problem.start.configuration
        far_m, turn_rad = math.hypot(away[0], away[1]), math.remainder(float(away[2]), math.tau)
        if far_m > patience.corridor_m or abs(turn_rad) > patience.corridor_rad:
            away = f"{far_m:z.2f} m and {abs(turn_rad):z.2f} rad from the plan's start"
            raise RobotError(
                f"the robot is seen {away}: are poses in m and rad, and in the plan's frame?"
            )

    def _tell(self, record: RunRecord) -> None:
        """Note a command."""
        controller = record.controller
        self.during, reading = controller.policy.during, controller.belief.reading
        known = "by the plan's times" if None in reading.stiffness else controller.belief.known
        if self.file is not None:
            self.file.note(record)
        self.on_state(StreamState(self.clock.now_s(), self.during, known))


_JOIN_S = 0.01  # for which the thread that plans is waited for at a time [s]


@public
class ThinkAside:
    """Plans in a thread of its own, so that a robot is told again and again to stand meanwhile.

    An interrupt, or trouble with the robot, leaves the computation behind.
    """

    def __init__(self, plan: Callable[[Problem], Result]) -> None:
        """Nothing is being planned.

        Args:
            plan: Plans a problem.
        """
        self._plan = plan
        self._thread: threading.Thread | None = None
        self._made: list[Result] = []
        self._failures: list[BaseException] = []

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self._plan,))  # whoever goes on asks again

    def __call__(self, problem: Problem) -> Result | None:
        """The result for a problem, or None while it is being planned: ask again."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._compute, args=(problem,), daemon=True)
            self._thread.start()
        self._thread.join(_JOIN_S)
        if self._thread.is_alive():
            return None
        self._thread = None
        if self._failures:
            raise self._failures.pop()
        return self._made.pop()

    def _compute(self, problem: Problem) -> None:
        try:
            self._made.append(self._plan(problem))
        except BaseException as error:
            self._failures.append(error)


SAVED_EVERY_S = 10.0  # of a run under way, whenever it stands: a power cut costs no more
_SHARE = 0.02  # of the time, at most, is spent on that


class RunFile:
    """The file of a run under way: whole at any time, and never older than a few seconds.

    It is replaced when the robot stands and the last one is `SAVED_EVERY_S` old, and at the end.
    """

    def __init__(self, path: Path) -> None:
        """Nothing is written yet to this file."""
        self.path = path
        self._record: RunRecord | None = None
        self._due_s = time.monotonic() + SAVED_EVERY_S

    def note(self, record: RunRecord) -> None:
        """Look at a run after each of its commands."""
        self._record = record
        if record.controller.belief.stands and (begun_s := time.monotonic()) >= self._due_s:
            self.end("the run was still under way")
            took_s = time.monotonic() - begun_s
            self._due_s = begun_s + max(SAVED_EVERY_S, took_s / _SHARE)

    def end(self, reason: str) -> None:
        """Write down a run that ended so, if it has begun."""
        if self._record is not None:
            policy = self._record.controller.policy
            self.save(self._record.run(policy.verdict(Ending.LOGGED, reason)))

    def save(self, run: Run) -> None:
        """Write a run that has come to its own end."""
        write_json(self.path, run.to_dict())
