"""A plan sent to a robot, command by command; however it ends, the robot is told to stop."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.checking.verification import verify
from twosra_mpc.errors import InputError, NoPlanError, TwosraError
from twosra_mpc.execution.heater_schedule import Progress
from twosra_mpc.execution.serial.clock import Clock
from twosra_mpc.execution.serial.confirmation import ByReports, ByTime, Confirmation
from twosra_mpc.execution.serial.firmware_lines import (
    HIGHEST_RATE_HZ,
    Report,
    command,
    parse_report,
    stop_command,
)
from twosra_mpc.execution.serial.interrupts import Interrupts, deferred_interrupts
from twosra_mpc.execution.serial.port import Port, PortError
from twosra_mpc.execution.serial.wheel_commands import wheel_commands
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.plans.trajectory import Phase, Samples
from twosra_mpc.robot.modes import RIGID, Mode, mode_name

Array = NDArray[np.float64]

RATE_HZ = 15.0  # of the authors' controller in their published trials, by their logs
LISTEN_S = 5.0  # for the first reports; the follow-up robot reports every second
ENOUGH_REPORTS = 3  # of each segment: single ones can be far off
REPEAT_S = 1.0  # while the robot stands, a command is sent again so often
STOPS, STOP_PAUSE_S = 5, 0.05  # a stop is sent so often: a line can lose a byte
HELD_UP_S = 0.5  # a command that turns the wheels and lasts so much too long is an error

_STILL = np.zeros(4)
_LONGEST_NAP_S = 0.1  # an interrupt waits no longer than this
_SAME_TIME_S = 1e-6


class Confirm(enum.StrEnum):
    """When the phases of a stream begin."""

    IF_REPORTED = "if-reported"  # by temperature reports if there are any, else by time
    REQUIRED = "required"  # by temperature reports, or not at all
    NEVER = "never"  # at the plan's times


class StreamError(TwosraError):
    """A stream ended before the plan did.

    Attributes:
        time_s: When, since the stream began.
        during: Which phase it was in, or waited for.
    """

    def __init__(self, time_s: float, during: str, reason: str) -> None:
        self.time_s, self.during, self.reason = time_s, during, reason
        super().__init__(f"stopped after {time_s:.1f} s, {during}: {reason}")

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.time_s, self.during, self.reason))


class Drive(NamedTuple):
    """A phase as it was driven; times since the stream began [s]."""

    mode: Mode
    start_s: float
    end_s: float


class StreamState(NamedTuple):
    """Where a stream is, for a progress line.

    Attributes:
        time_s: Since the stream began.
        during: Which phase it is in, or waits for.
        known: What is known about the segments, in words; empty while it listens for that.
        reported: Whether the robot reports temperatures; None while that is not known.
    """

    time_s: float
    during: str
    known: str = ""
    reported: bool | None = None


def stream(
    plan: Plan,
    port: Port,
    clock: Clock,
    *,
    rate_Hz: float = RATE_HZ,
    robot_id: int | None = None,
    confirm: Confirm = Confirm.IF_REPORTED,
    on_state: Callable[[StreamState], None] = lambda state: None,
) -> tuple[Drive, ...]:
    """Send a plan to a robot and return the phases as they were driven.

    The robot stands, heaters off, when this returns or raises; only a line that is dead prevents
    it, and then the error says so. Ctrl-C, SIGTERM and SIGHUP raise KeyboardInterrupt.

    Args:
        plan: A plan that is verified, here once more.
        port: The line to the robot.
        clock: Time.
        rate_Hz: Commands per second while driving.
        robot_id: Number of the robot, if the firmware expects one.
        confirm: When phases begin.
        on_state: Called with every command.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the line cannot carry the plan or the rate.
        StreamError: If the stream ended before the plan did.
    """
    samples = check_sendable(plan)
    check_command_rate(rate_Hz)
    with deferred_interrupts() as interrupts:
        run = _Stream(plan, samples, port, clock, interrupts, rate_Hz, robot_id, on_state)
        try:
            try:
                run.run(confirm)
            finally:
                run.stop()
        except PortError as error:
            raise run.error(f"{error}; {run.after_port_error}") from error
    return tuple(run.drives)


def check_sendable(plan: Plan) -> Samples:
    """Samples of a plan that may be sent.

    Raises:
        NoPlanError: If the plan is not verified, or does not pass the check again.
        InputError: If it keeps a segment warm, which the firmware's commands cannot say.
    """
    checked = verify(plan.problem, plan.samples, plan.phases, plan.transitions)
    if not checked.ok:
        raise NoPlanError(Status.FAILED, f"verified again, {checked.problems[0]}")
    heater, setpoint_C = plan.robot.heater, plan.samples.heater_setpoint_C
    if ((setpoint_C > heater.rigid_setpoint_C) & (setpoint_C < heater.soft_setpoint_C)).any():
        allowed = "another: the firmware can heat a segment or not, but not keep it warm"
        raise InputError("heating", plan.problem.heating, allowed)
    return plan.samples


def check_command_rate(rate_Hz: float) -> None:
    """Check a rate of commands.

    Raises:
        InputError: If the line does not carry it, or it is less than one a second.
    """
    if not 1 <= rate_Hz <= HIGHEST_RATE_HZ:
        raise InputError(
            "rate", rate_Hz, f"from 1 to {HIGHEST_RATE_HZ:g} Hz, which the line carries"
        )


class _Stream:
    """One plan on its way to the robot; ``run`` may be called once, ``stop`` always."""

    def __init__(
        self,
        plan: Plan,
        samples: Samples,
        port: Port,
        clock: Clock,
        interrupts: Interrupts,
        rate_Hz: float,
        robot_id: int | None,
        on_state: Callable[[StreamState], None],
    ) -> None:
        self.plan, self.samples, self.port = plan, samples, port
        self.clock, self.interrupts = clock, interrupts
        self.rate_Hz, self.robot_id, self.on_state = rate_Hz, robot_id, on_state
        self.drives: list[Drive] = []
        self.after_port_error = "the robot was told to stop"
        self._during = "before the plan began"
        self._plan_s = 0.0
        self._sent, self._sent_s = b"", 0.0

    def run(self, confirm: Confirm) -> None:
        """Listen, and send the plan from its start to its end."""
        known = self._listen(confirm)
        phases, last = self.plan.phases, self.plan.problem.goal.mode
        for number, phase in enumerate(phases, 1):
            name = f"phase {number} of {len(phases)} {mode_name(phase.mode)}"
            self._await(known, phase.mode, phase.start_s, name)
            self._drive(known, phase, name)
        self._await(known, last, float(self.samples.t_s[-1]), f"the end {mode_name(last)}")

    def stop(self) -> None:
        """Tell the robot to stand and to let its heaters cool, several times.

        Raises:
            PortError: If no stop could be sent.
        """
        failure: PortError | None = None
        sent = 0
        for _ in range(STOPS):
            try:
                self.port.write(stop_command(self.robot_id))
                sent += 1
            except PortError as error:
                failure = error
            self.clock.sleep(STOP_PAUSE_S)
        if failure is not None and not sent:
            self.after_port_error = "the robot could NOT be told to stop: switch it off"
            raise failure

    def error(self, reason: str) -> StreamError:
        """Return the error that names time and phase."""
        return StreamError(self.clock.now_s(), self._during, reason)

    @property
    def _progress(self) -> Progress:
        return Progress(self._plan_s, len(self.drives))

    def _listen(self, confirm: Confirm) -> Confirmation:
        """Wait at rest for reports of both segments, and choose what lets phases begin."""
        if confirm is Confirm.NEVER:
            return ByTime(self.plan)
        heard: list[Report] = []
        counts, until_s = [0, 0], self.clock.now_s() + LISTEN_S
        while self.clock.now_s() < until_s - _SAME_TIME_S and min(counts) < ENOUGH_REPORTS:
            self._send(_STILL, RIGID)
            heard += self._pass(self.clock.now_s() + 1 / self.rate_Hz)
            counts = [sum(report.segment == j for report in heard) for j in (0, 1)]
            self.on_state(StreamState(self.clock.now_s(), "listening for temperatures"))
        if all(counts):
            return ByReports(self.plan, heard, self.clock.now_s())
        if any(counts):
            raise self.error(f"segment {counts.index(0) + 1} does not report its temperature")
        if confirm is Confirm.REQUIRED:
            raise self.error(f"no temperature report within {LISTEN_S:g} s")
        return ByTime(self.plan)

    def _await(self, known: Confirmation, mode: Mode, planned_s: float, name: str) -> None:
        """Stand until the robot may drive in a mode; the plan's clock stops when it should."""
        stood_s = 0.0
        self._during = f"waiting for {name}"
        while not known.ready(mode, self._progress, planned_s):
            began_s = self.clock.now_s()
            left_s = planned_s - self._plan_s
            step_s = min(1 / self.rate_Hz, left_s) if left_s > _SAME_TIME_S else 1 / self.rate_Hz
            self._command(known, _STILL, began_s + step_s)
            passed_s = self.clock.now_s() - began_s
            self._plan_s = max(self._plan_s, min(self._plan_s + passed_s, planned_s))
            stood_s += max(0.0, passed_s - max(0.0, left_s))
            if stood_s > known.patience_s(mode):
                raise self.error(f"{stood_s:.0f} s later than planned, {known.describe()}")
        self._plan_s = max(self._plan_s, planned_s)

    def _drive(self, known: Confirmation, phase: Phase, name: str) -> None:
        """Drive a phase, each command for one period; stand while a segment is not as it must be.

        Periods are counted from the start, so that lateness does not add up to a longer way.
        """
        began_s = due_s = self.clock.now_s()
        for order in wheel_commands(self.samples, phase, self.rate_Hz):
            if not known.ready(phase.mode, self._progress, order.start_s):
                self._await(known, phase.mode, order.start_s, name)
                due_s = self.clock.now_s()
            self._during = f"in {name}"
            due_s += 1 / self.rate_Hz
            self._command(known, order.wheel_rad_s, due_s)
            if (late_s := self.clock.now_s() - due_s) > HELD_UP_S:
                raise self.error(f"the computer was held up for {late_s:.1f} s with turning wheels")
            self._plan_s = order.end_s
        self.drives.append(Drive(phase.mode, began_s, self.clock.now_s()))

    def _command(self, known: Confirmation, wheel_rad_s: Array, until_s: float) -> None:
        """Command wheels and heaters, let time pass, and take in what the robot reports."""
        heated = known.heated(self._progress)
        self._send(wheel_rad_s, heated)
        reported = isinstance(known, ByReports)
        self.on_state(StreamState(self.clock.now_s(), self._during, known.describe(), reported))
        known.take(self._pass(until_s), heated, self.clock.now_s())
        if (trouble := known.trouble(self.clock.now_s())) is not None:
            raise self.error(trouble)

    def _send(self, wheel_rad_s: Array, heated: Mode) -> None:
        """Send a command, unless the robot stands and has just been told the same."""
        line, now_s = command(wheel_rad_s.tolist(), heated, self.robot_id), self.clock.now_s()
        stands = not wheel_rad_s.any()
        if stands and line == self._sent and now_s < self._sent_s + REPEAT_S - _SAME_TIME_S:
            return
        self.port.write(line)
        self._sent, self._sent_s = line, now_s

    def _pass(self, until_s: float) -> list[Report]:
        """Let time pass, and return what was reported."""
        self.interrupts.check()
        while (left_s := until_s - self.clock.now_s()) > _SAME_TIME_S:
            self.clock.sleep(min(left_s, _LONGEST_NAP_S))
            self.interrupts.check()
        reports = map(parse_report, self.port.read_lines())
        return [report for report in reports if report is not None]
