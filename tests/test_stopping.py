"""A stop cannot be cut short: signals strike between any two opcodes of the code that stops."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from twosra_mpc import load_robot
from twosra_mpc.errors import TwosraError
from twosra_mpc.execution import robot_interface
from twosra_mpc.execution.robot_interface import RobotError, stopped_after
from twosra_mpc.interrupts import Interrupts

ROBOT = load_robot("2sra-v1")
BURST = 3  # signals at one place
WHOLLY = ("robot_interface.py", "test_stopping.py")  # every opcode; elsewhere every line, once
BY_LINE = ("interrupts.py", "contextlib.py")


class Line:
    """A robot that knows only what it was told last; a signal strikes while it is told."""

    def __init__(self, failures: int = 0) -> None:
        self.robot = ROBOT
        self.told: list[tuple[np.ndarray, np.ndarray]] = []
        self.failures = failures

    def send(self, wheel_rad_s: np.ndarray, setpoint_C: np.ndarray) -> None:
        if not wheel_rad_s.any() and self.failures > 0:
            self.failures -= 1
            raise RobotError("lost line")
        self.told.append((wheel_rad_s, setpoint_C))

    @property
    def off(self) -> bool:
        wheels, setpoint = self.told[-1]
        return not wheels.any() and bool((setpoint == self.robot.heater.rigid_setpoint_C).all())


def driven(line: Line, error: type[Exception] | None) -> Callable[[Interrupts], str]:
    def drive(interrupts: Interrupts) -> str:
        line.send(np.ones(4), np.full(2, 65.0))
        interrupts.check()
        if error is not None:
            raise error("trouble")
        return "driven"

    return drive


def strike() -> None:
    """Several signals at once; a handler may raise for one of them only, and only once a run."""
    raised: BaseException | None = None
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT)[:BURST]:
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt as error:
            raised = raised or error
    if raised is not None:
        raise raised


@contextmanager
def struck_at(number: int) -> Iterator[SimpleNamespace]:
    """Strike at place ``number`` of the code that stops, counting them in ``places``."""
    count, lines = SimpleNamespace(places=0), set()

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        file, line = frame.f_code.co_filename, frame.f_lineno
        if not file.endswith((*WHOLLY, *BY_LINE)) or frame.f_code.co_name == "strike":
            return None
        frame.f_trace_opcodes = file.endswith(WHOLLY)
        if event == ("opcode" if frame.f_trace_opcodes else "line"):
            count.places += frame.f_trace_opcodes or (file, line) not in lines
            lines.add((file, line))
            if count.places == number:
                sys.settrace(None)
                strike()
        return trace

    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as the program sets it
    usual = sys.gettrace()
    try:
        sys.settrace(trace)
        yield count
    finally:
        sys.settrace(usual)
        for each, handler in before.items():
            signal.signal(each, handler)


def run_struck_at(number: int, error: type[Exception] | None, failures: int) -> tuple[Line, int]:
    line = Line(failures)
    count = SimpleNamespace(places=0)
    try:
        with struck_at(number) as count:
            stopped_after(line, driven(line, error))  # type: ignore[arg-type]
    except (KeyboardInterrupt, TwosraError):
        pass
    return line, count.places


@pytest.mark.parametrize(("error", "failures"), [(None, 0), (RobotError, 2)])
def test_signals_between_any_two_opcodes_leave_the_robot_off(
    error: type[Exception] | None, failures: int
) -> None:
    _, places = run_struck_at(0, error, failures)  # nothing strikes
    assert places > 180  # of Python 3.13, 185
    on = [
        number
        for number in range(1, places + 1)
        if (line := run_struck_at(number, error, failures)[0]).told and not line.off
    ]
    assert on == []


def test_the_first_signal_interrupts_the_drive_and_the_next_does_not_disturb_the_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line, stop = Line(), robot_interface._stop

    def disturbed_stop(robot: Any) -> Exception | None:
        strike()
        return stop(robot)

    monkeypatch.setattr(robot_interface, "_stop", disturbed_stop)

    def drive(_: Interrupts) -> None:
        line.send(np.ones(4), np.full(2, 65.0))
        signal.raise_signal(signal.SIGINT)
        pytest.fail("the drive goes on")

    with pytest.raises(KeyboardInterrupt):
        stopped_after(line, drive)  # type: ignore[arg-type]
    assert line.off


def test_a_stop_that_never_goes_through_is_told() -> None:
    line = Line(failures=100)
    with pytest.raises(RobotError, match="could NOT be told to stop"):
        stopped_after(line, driven(line, None))  # type: ignore[arg-type]
    line = Line(failures=100)
    with pytest.raises(ValueError, match="trouble") as caught:
        stopped_after(line, driven(line, ValueError))  # type: ignore[arg-type]
    assert "could NOT be told to stop" in caught.value.__notes__[0]
