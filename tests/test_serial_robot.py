"""A robot on a serial line, driven as any other, and never blind; to its goal: test_pose_lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from once import planned
from simulated_firmware import SimulatedFirmware

from twosra_mpc import InputError, Plan, Problem
from twosra_mpc.execution import Camera, Ending, Executor, RobotError
from twosra_mpc.lab.serial.robot import STOPS, connected
from twosra_mpc.model.rolling import NO_DRIFT, rolling
from twosra_mpc.plans.result import Result

Array = NDArray[np.float64]

ARC = "2sra-v1"


class SeenFirmware(SimulatedFirmware):
    """Firmware whose robot rolls as its wheels turn, seen by a perfect camera."""

    camera = Camera(rate_Hz=15.0)

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.q, self._robot = plan.problem.start.configuration.copy(), plan.robot

    def sleep(self, duration_s: float) -> None:
        super().sleep(duration_s)
        if self.received and any(self.received[-1].wheel_rad_s):
            mode = tuple(int(segment.soft) for segment in self.segments)
            turned = duration_s * np.array(self.received[-1].wheel_rad_s)
            self.q = rolling(self._robot, mode)(self.q, turned, NO_DRIFT).full().ravel()

    def frames(self, now_s: float) -> tuple[Array, Array]:
        """The pose source's: what is seen now."""
        return np.array([now_s]), self.q[None]


@pytest.fixture
def made() -> Iterator[list[SeenFirmware]]:
    """Where a test puts its firmware, to have it released at the end."""
    firmware: list[SeenFirmware] = []
    yield firmware
    for each in firmware:
        each.close()


def test_a_robot_that_nothing_sees_is_not_driven(made: list[SeenFirmware]) -> None:
    plan = planned("paper-2", robot=ARC)
    made.append(SeenFirmware(plan))
    with connected(plan.problem, made[0].port, made[0]) as robot:
        robot.listen()
        run = Executor(robot).run(plan)
    assert run.ending is Ending.CAMERA_LOST
    assert "no camera frame" in run.reason
    assert not made[0].moves


def test_wheels_do_not_turn_while_the_rest_is_planned(made: list[SeenFirmware]) -> None:
    plan = planned("paper-2", robot=ARC)
    made.append(SeenFirmware(plan))

    def stopped(problem: Problem) -> Result:
        made[0].receive()
        assert not any(made[0].received[-1].wheel_rad_s)
        raise InputError("goal", problem, "none: planning was tried")

    push = np.array([0.15, 0.0, 0.0, 0.0, 0.0])
    with connected(plan.problem, made[0].port, made[0], poses=made[0]) as robot:
        robot.listen()
        made[0].at[made[0].now_s() + 0.5] = lambda: setattr(made[0], "q", made[0].q + push)
        run = Executor(robot, think=stopped).run(plan)
    assert run.ending is Ending.NO_PLAN
    assert "planning was tried" in run.reason


def test_a_robot_that_gets_too_hot_is_switched_off(made: list[SeenFirmware]) -> None:
    plan = planned("paper-2", robot=ARC)
    made.append(SeenFirmware(plan))
    made[0].reports = lambda t, j, T: b"%c%.1f\n" % (65 + j, T if t < 50 else 90)
    with connected(plan.problem, made[0].port, made[0], poses=made[0]) as robot:
        robot.listen()
        with pytest.raises(RobotError, match="segment 1: too hot, 90"):
            Executor(robot).run(plan)
    made[0].receive()
    assert [item.heated for item in made[0].received[-STOPS:]] == [(0, 0)] * STOPS
