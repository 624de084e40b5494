"""A stop that always happens: whatever ends a run, the last command is wheels zero, heaters off."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from twosra_mpc.execution.robot_interface import RobotError, RobotInterface
from twosra_mpc.interrupts import Interrupts, deferred_interrupts, raised_interrupts
from twosra_mpc.robot.coordinates import WHEELS

_UNTOLD = "the robot could NOT be told to stop: switch it off"
_TRIES = 5  # a line can fail once, and a driver too

Driven = TypeVar("Driven")


def stopped_after(robot: RobotInterface, drive: Callable[[Interrupts], Driven]) -> Driven:
    """Drive a robot and stop it, however the drive ends; no number of signals cuts that short.

    The first signal that would end the program raises KeyboardInterrupt in the drive, as Ctrl-C
    does; later ones are only noted. The drive should check the interrupts it is given from time to
    time: a library may swallow the exception, or make another error of it. That the robot could
    not be told to stop is a note to the error that ended the drive.

    Raises:
        RobotError: If nothing else went wrong but the stop.
    """
    with raised_interrupts() as interrupts:
        try:
            try:
                driven = drive(interrupts)
            finally:  # from here on no signal raises: the only one that may has been or is caught
                interrupts.held = True
        except BaseException as error:
            if (untold := _stop(robot)) is not None:
                error.add_note(f"{untold}; {_UNTOLD}")
            interrupts.check()
            raise
        if (untold := _stop(robot)) is not None:
            raise RobotError(f"{untold}; {_UNTOLD}") from untold
        return driven


def _stop(robot: RobotInterface) -> Exception | None:
    """Send wheels zero and heaters off until that goes through; the last error if it never does."""
    failure: Exception | None = None
    off_C = np.full(robot.robot.coordinates.segments, robot.robot.heater.rigid_setpoint_C)
    with deferred_interrupts():
        for _ in range(_TRIES):
            try:
                robot.send(np.zeros(WHEELS), off_C)
                return None
            except Exception as error:  # whatever it is, the next try may get through
                failure = error
    return failure
