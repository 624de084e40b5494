"""What no robot can truly report ends a run, or is not believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from once import planned

from benchmarks.foreign import TICK_S, ForeignRobot
from benchmarks.problems import labelled
from twosra_mpc import plan
from twosra_mpc.execution import Executor, ExecutorSettings, Reading, RobotError, greedy_rule
from twosra_mpc.execution.executor import plan_controller
from twosra_mpc.execution.following import Following
from twosra_mpc.execution.run import Ending, Run

ARC, FROM_S = "2sra-v1", 2.0
Spoil = Callable[[Reading], Reading]


class Spoilt(ForeignRobot):
    """A robot whose readings are spoilt from a time on, while it drives."""

    def __init__(self, problem: Any, spoil: Spoil) -> None:
        self.spoil = spoil
        super().__init__(problem)

    def read(self) -> Reading:
        reading = super().read()
        return self.spoil(reading) if reading.time_s >= FROM_S else reading


def stands(reading: Reading) -> Reading:
    return replace(reading, time_s=FROM_S, taken_s=np.minimum(reading.taken_s, FROM_S))


def shifted(reading: Reading, by_s: float = -1.0) -> Reading:
    return replace(reading, time_s=reading.time_s + by_s, taken_s=reading.taken_s + by_s)


def driven(robot: ForeignRobot, made: Any, executor: str) -> Run:
    """Drive the robot as far as it goes."""
    if executor == "greedy":
        return Executor(robot).drive(made.problem)
    return Executor(robot).run(made)


@pytest.mark.parametrize("executor", ["optimal", "greedy"])
@pytest.mark.parametrize(("spoil", "words"), [(stands, "stands still"), (shifted, "goes back")])
def test_a_clock_that_does_not_go_on_stops_the_robot(
    spoil: Spoil, words: str, executor: str
) -> None:
    """Otherwise its wheels would turn for ever, for nothing is ever late."""
    made = planned("rigid-move", robot=ARC)
    robot = Spoilt(made.problem, spoil)
    with pytest.raises(RobotError, match=f"clock {words}"):
        driven(robot, made, executor)
    assert robot.off
    assert robot.time_s < FROM_S + 5.0


WRONG: list[dict[str, Any]] = [
    *({"time_s": time_s} for time_s in (0.0, np.nan, np.inf, 1e9)),
    *({"faulty": (True, True)}, {"stiffness": ("rigid", "soft")}, {"stiffness": (None, None)}),
    {"temperature_C": (500.0, -40.0), "current_A": (1e9, np.nan)},
]


class NowAndThen(ForeignRobot):
    """A robot of which every 31st reading is wrong, each time in another way."""

    count = 0

    def read(self) -> Reading:
        self.count += 1
        which, spoils = divmod(self.count, 31)
        reading = super().read()
        return reading if spoils else replace(reading, **WRONG[which % len(WRONG)])


@pytest.mark.parametrize("executor", ["optimal", "greedy"])
def test_single_readings_that_are_wrong_end_nothing(executor: str) -> None:
    made = planned("paper-1", robot=ARC)
    robot = NowAndThen(made.problem)
    run = driven(robot, made, executor)
    assert run.ending is Ending.REACHED, run.reason
    assert robot.count > 31 * len(WRONG)
    assert sum("clock" in event.text for event in run.events) >= 4


def test_a_clock_that_goes_on_from_later_is_believed() -> None:
    """As after a program that was held up."""
    made = planned("rigid-move", robot=ARC)
    run = driven(Spoilt(made.problem, lambda reading: shifted(reading, 9.0)), made, "optimal")
    assert run.ending is Ending.REACHED
    assert run.duration_s > FROM_S + 9.0


@pytest.mark.parametrize("executor", ["optimal", "greedy"])
@pytest.mark.parametrize("far", [1e3, 1e300])
def test_frames_of_where_no_robot_can_be_are_lost_frames(far: float, executor: str) -> None:
    made = planned("rigid-move", robot=ARC)
    robot = Spoilt(made.problem, lambda reading: replace(reading, frames=reading.frames + far))
    assert driven(robot, made, executor).ending is Ending.CAMERA_LOST
    assert robot.off
    assert robot.time_s < FROM_S + 10.0


@pytest.mark.parametrize(("executor", "problem"), [("optimal", 1), ("greedy", 0)])
def test_reports_that_flicker_are_no_failed_heaters(executor: str, problem: int) -> None:
    """However long a segment was soft before, or has to wait for the other one.

    The greedy rule drives this robot, which is not quite the model, metres away, and back.
    """
    rng = np.random.default_rng(1)
    made = plan(list(labelled(("random-100:2",)).values())[problem]).require()

    def flickers(reading: Reading) -> Reading:
        told = [known if rng.random() > 0.1 else "changing" for known in reading.stiffness]
        return replace(reading, stiffness=tuple(told))

    robot = Spoilt(made.problem, flickers)
    run = driven(robot, made, executor)
    assert run.ending is Ending.REACHED, run.reason
    assert robot.off


class Reversed(ForeignRobot):
    """A robot whose wheels turn the other way."""

    def send(
        self, wheel_rad_s: NDArray[np.float64], heater_setpoint_C: NDArray[np.float64]
    ) -> None:
        super().send(-wheel_rad_s, heater_setpoint_C)


def test_the_greedy_rule_does_not_go_away_from_its_goal_for_hours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(greedy_rule, "AWAY_M", 3.0)
    made = planned("rigid-move", robot=ARC)
    robot = Reversed(made.problem)
    run = driven(robot, made, "greedy")
    assert run.ending is Ending.GAVE_UP
    assert "leads away from the goal" in run.reason
    assert robot.off
    assert np.linalg.norm(robot.q[:2] - made.problem.start.configuration[:2]) < 3.0 + 1.0


def test_the_longest_time_of_a_run_holds_while_it_drives() -> None:
    made = planned("rigid-move", robot=ARC)
    robot, longest_s = ForeignRobot(made.problem), made.duration_s / 2
    run = Executor(robot, ExecutorSettings(longest_s=longest_s)).run(made)
    assert run.ending is Ending.TIME_LIMIT
    assert robot.off
    assert longest_s < robot.time_s < longest_s + 2 * TICK_S


def test_a_robot_that_does_not_bend_is_not_heated_for_hours() -> None:
    """With a dead wheel it never bends, however long it melts."""
    made, settings = planned("rigid-move", robot=ARC), ExecutorSettings()
    policy = plan_controller(made, ForeignRobot(made.problem).camera, settings).policy
    assert isinstance(policy, Following)
    held_s = sum(policy.melt_on_s() for _ in range(settings.replans))
    assert held_s <= 4 * settings.patience.melt_on_s * settings.replans
