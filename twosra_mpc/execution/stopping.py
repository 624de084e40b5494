"""A stop that always happens: whatever ends a run, the last command is wheels zero, heaters off."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from twosra_mpc.execution.robot_interface import RobotError, RobotInterface
from twosra_mpc.execution.serial.interrupts import deferred_interrupts, ending_signals_raised
from twosra_mpc.robot.coordinates import WHEELS

_TRIES = 5  # a line can fail once, and a driver too


@contextmanager
def stopped_at_the_end(robot: RobotInterface) -> Iterator[None]:
    """Stop a robot at the end of a block, however it ends; no interrupt cuts that short.

    Signals that would end the program raise KeyboardInterrupt in the block, as Ctrl-C does.

    Raises:
        RobotError: If the robot could not be told.
    """
    with ending_signals_raised():
        try:
            yield
        finally:
            with deferred_interrupts():
                untold = _stop(robot)
            if untold is not None:
                words = "the robot could NOT be told to stop: switch it off"
                raise RobotError(f"{untold}; {words}") from untold


def _stop(robot: RobotInterface) -> Exception | None:
    """Send wheels zero and heaters off until that goes through; the last error if it never does."""
    failure: Exception | None = None
    off_C = np.full(robot.robot.coordinates.segments, robot.robot.heater.rigid_setpoint_C)
    for _ in range(_TRIES):
        try:
            robot.send(np.zeros(WHEELS), off_C)
            return None
        except Exception as error:  # whatever it is, the next try may get through
            failure = error
    return failure
