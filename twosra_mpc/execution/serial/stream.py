"""A plan sent to a robot over a serial line, without a camera; at the end the robot is off."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

from twosra_mpc.checking.verification import verify
from twosra_mpc.errors import InputError, NoPlanError, TwosraError
from twosra_mpc.execution.robot_interface import RobotError
from twosra_mpc.execution.run import Drive
from twosra_mpc.execution.runner import ByClock, ByReports, PlanRunner
from twosra_mpc.execution.serial.clock import Clock
from twosra_mpc.execution.serial.port import Port
from twosra_mpc.execution.serial.robot import RATE_HZ, connected
from twosra_mpc.execution.session import Session
from twosra_mpc.execution.settings import Patience
from twosra_mpc.plans.plan import Plan, Status


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
    patience: Patience | None = None,
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
        patience: How long to wait for what.
        on_state: Called with every command.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the line cannot carry the plan or the rate.
        StreamError: If the stream ended before the plan did.
    """
    check_sendable(plan)
    patience, during = patience or Patience(), "before the plan began"

    def tell(session: Session) -> None:
        nonlocal during
        during, reading, reported = session.during, session.reading, robot.reports
        words = ", ".join(map(reading.describe, range(len(reading.stiffness))))
        known = words if reported else "by the plan's times"
        on_state(StreamState(clock.now_s(), during, known, reported))

    try:
        with connected(
            plan.problem, port, clock, rate_Hz=rate_Hz, robot_id=robot_id, patience=patience
        ) as robot:
            if confirm is not Confirm.NEVER:
                on_state(StreamState(clock.now_s(), "listening for temperatures"))
                robot.listen()
            if confirm is Confirm.REQUIRED and not robot.reports:
                raise RobotError(f"no temperature report within {patience.listen_s:g} s")
            session = Session(robot, plan.problem, tell)
            feedback = ByReports() if robot.reports else ByClock()
            runner = PlanRunner(session, plan, feedback, patience)
            if (left := runner.follow()) is not None:
                raise RobotError(left.text)
    except RobotError as error:
        raise StreamError(clock.now_s(), during, str(error)) from error
    return tuple(runner.driven)


def check_sendable(plan: Plan) -> None:
    """Check that a plan may be sent.

    Raises:
        NoPlanError: If it does not pass the check again.
        InputError: If it keeps a segment warm, which the firmware's commands cannot say.
    """
    if not (checked := verify(plan.trajectory)).ok:
        raise NoPlanError(Status.FAILED, f"verified again, {checked.problems[0]}")
    heater, setpoint_C = plan.robot.heater, plan.samples.heater_setpoint_C
    if ((setpoint_C > heater.rigid_setpoint_C) & (setpoint_C < heater.soft_setpoint_C)).any():
        allowed = "another: the firmware can heat a segment or not, but not keep it warm"
        raise InputError("heating", plan.problem.heating, allowed)
