"""The controller as a step: a value that can be kept, and off whatever fails around it."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from once import planned

from benchmarks.thermal_scale import thermally_faster
from twosra_mpc import InputError, Plan, Problem, Result, Status, load_robot, plan
from twosra_mpc.execution import (
    LEVELS,
    Controller,
    Ending,
    Executor,
    Reading,
    SimulatedRobot,
    greedy_controller,
    plan_controller,
)
from twosra_mpc.execution.robot_interface import Command

GOES_ON = """
import pickle, sys
controller, reading = pickle.load(sys.stdin.buffer)
command = controller.step(reading)
sys.stdout.buffer.write(pickle.dumps((command, controller.belief.q)))
"""


def controllers(made: Plan, robot: SimulatedRobot) -> dict[str, Controller]:
    return {
        "optimal": plan_controller(made, robot.camera),
        "greedy": greedy_controller(made.problem, robot.camera),
    }


def kept(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


def drive(made: Plan, which: str, every: int) -> tuple[list[Command], Controller]:
    """Commands of a run whose controller is kept and taken up again every so many steps."""
    robot, commands = SimulatedRobot(made.problem, "arc", LEVELS["moderate"], 4), list[Command]()
    controller = controllers(made, robot)[which]
    while controller.verdict is None:
        command = controller.step(robot.read())
        robot.send(command.wheel_rad_s, command.heater_setpoint_C)
        robot.wait(command.at_most_s)
        commands.append(command)
        if every and len(commands) % every == 0:
            controller = kept(controller)
    return commands, controller


QUICK = thermally_faster(load_robot("2sra-v1"), 4.0)


@pytest.mark.parametrize(("name", "which"), [("paper-2", "optimal"), ("rigid-move", "greedy")])
def test_a_controller_that_is_kept_and_taken_up_again_does_the_same(name: str, which: str) -> None:
    """Also while metal changes, and in the middle of a look, to the last bit."""
    made = planned(name, robot=QUICK)
    (straight, one), (interrupted, other) = drive(made, which, 0), drive(made, which, 60)
    assert straight == interrupted
    assert one.verdict is not None
    assert other.verdict is not None
    assert (one.verdict.ending, one.verdict.reason) == (other.verdict.ending, other.verdict.reason)
    assert one.belief.events == other.belief.events


def test_another_process_goes_on_while_metal_changes() -> None:
    made = planned("paper-2")
    robot = SimulatedRobot(made.problem, "arc", LEVELS["moderate"], 4)
    controller = plan_controller(made, robot.camera)
    while not any(0.2 < segment.melt_fraction < 0.8 for segment in robot.segments):
        command = controller.step(robot.read())
        robot.send(command.wheel_rad_s, command.heater_setpoint_C)
        robot.wait(command.at_most_s)
    reading = robot.read()
    given = pickle.dumps((controller, reading))
    there = subprocess.run([sys.executable, "-c", GOES_ON], input=given, capture_output=True)
    assert there.returncode == 0, there.stderr.decode()
    command, q = pickle.loads(there.stdout)
    assert command == controller.step(reading)
    assert (q == controller.belief.q).all()


def test_a_step_after_the_end_leaves_the_robot_off() -> None:
    made = planned("rigid-move")
    _, controller = drive(made, "optimal", 0)
    robot = SimulatedRobot(made.problem, "arc", LEVELS["none"])
    verdict = controller.verdict
    reading = robot.read()
    for k in range(3):
        command = controller.step(replace(reading, time_s=controller.belief.now_s + 0.1 + k))
        assert not command.wheel_rad_s.any()
        assert (command.heater_setpoint_C <= made.robot.heater.rigid_setpoint_C).all()
        assert controller.verdict is verdict


class BrokenError(Exception):
    """Whatever an owner's code may raise."""


class Fails(SimulatedRobot):
    """A robot whose n-th call of a method raises, and which keeps what it was told last."""

    def __init__(self, made: Plan, part: str, number: int) -> None:
        self.part, self.left, self.told = part, number, list[Any]()
        super().__init__(made.problem, "arc", LEVELS["moderate"], 4)

    def fail(self, part: str) -> None:
        self.left -= part == self.part
        if part == self.part and self.left == 0:
            raise BrokenError(part)

    def read(self) -> Reading:
        self.fail("read")
        return super().read()

    def send(self, *given: Any) -> None:
        self.fail("send")
        super().send(*given)
        self.told.append(given)

    def wait(self, at_most_s: float) -> None:
        self.fail("wait")
        super().wait(at_most_s)

    def think(self, problem: Problem) -> Result | None:
        self.left -= self.part == "plan"
        if self.part == "plan" and self.left == 0:
            return replace(plan(problem), plan=None, status=Status.FAILED)
        return super().think(problem)


@pytest.mark.parametrize("part", ["read", "send", "wait"])
@pytest.mark.parametrize("number", [1, 2, 25, 50, 121])
def test_whatever_call_fails_the_robot_is_off(part: str, number: int) -> None:
    made = planned("rigid-move")
    robot = Fails(made, part, number)
    try:
        run = Executor(robot).run(made)
        assert run.ending is Ending.REACHED  # it was there before so many calls
        assert robot.left > 0
    except BrokenError:
        assert robot.left <= 0
    wheels, setpoint_C = robot.told[-1]
    assert not wheels.any()
    assert (setpoint_C <= made.robot.heater.rigid_setpoint_C).all()


@pytest.mark.parametrize("number", [1, 2, 3])
def test_whatever_plan_is_not_found_the_robot_is_off(number: int) -> None:
    made = planned("rigid-move")
    robot = Fails(made, "plan", number)
    run = Executor(robot, think=robot.think).run(made)
    assert run.ending in (Ending.REACHED, Ending.NO_PLAN)
    assert run.ending is Ending.REACHED or robot.left <= 0
    wheels, setpoint_C = robot.told[-1]
    assert not wheels.any()
    assert (setpoint_C <= made.robot.heater.rigid_setpoint_C).all()


SEEN: dict[str, Any] = {"taken_s": [1.0], "frames": [[0.0] * 5]}


@pytest.mark.parametrize(
    ("field", "given"),
    [
        ("time_s", {"time_s": "soon"}),
        ("taken_s", {"taken_s": None}),
        ("frames", {"taken_s": [1.0], "frames": [[0.0] * 4]}),
        ("frames", {"taken_s": [1.0], "frames": [0.0] * 5}),
        ("frames", {"taken_s": [1.0, 2.0], "frames": [[0.0] * 5]}),
        ("frames", {"taken_s": [1.0], "frames": [["a"] * 5]}),
        ("temperature_C", {"temperature_C": ("cold", 25.0)}),
        ("temperature_C", {"temperature_C": None}),
        ("faulty", {"faulty": (False,)}),
        ("stiffness", {"stiffness": ("liquid", "rigid")}),
        ("stiffness", {"stiffness": ("rigid",)}),
        ("current_A", {"current_A": (1.0,)}),
        ("objects", {**SEEN, "objects": np.zeros((2, 1, 3))}),
        ("objects", {**SEEN, "objects": np.zeros(3)}),
    ],
)
def test_a_reading_that_is_none_says_what_is_wrong(field: str, given: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        replace(COLD, **given)
    assert caught.value.field == f"reading.{field}"


COLD = Reading(0.0, [], [], (25.0, 25.0), ["rigid"] * 2, (False, False))  # type: ignore[arg-type]


def test_a_reading_takes_lists_and_what_is_not_known() -> None:
    drawn = replace(COLD, temperature_C=[None, 25], current_A=[None, -1.0])  # type: ignore[arg-type]
    assert drawn.frames.shape == (0, 5)
    assert drawn.stiffness == ("rigid", "rigid")
    assert np.isnan(drawn.temperature_C[0])
    for no_current in (-1.0, np.nan, np.inf, 1e300):
        assert replace(COLD, current_A=(no_current, 1.5)).current_A == (None, 1.5)


def test_a_reading_of_another_robot_is_refused() -> None:
    made = planned("rigid-move")
    controller = plan_controller(made, SimulatedRobot(made.problem).camera)
    with pytest.raises(InputError, match="of each segment"):
        controller.step(Reading(0.0, [], [], (25.0,), ("rigid",), (False,)))  # type: ignore[arg-type]


@pytest.mark.parametrize("shown_C", [np.nan, -127.0, 1e9])
def test_a_temperature_that_nobody_can_read_is_no_start_of_a_plan(shown_C: float) -> None:
    """A plan may be asked for at any step, and one wild reading is no reason to have none."""
    made = planned("rigid-move")
    controller = plan_controller(made, SimulatedRobot(made.problem).camera)
    for k, here_C in enumerate((25.0, 25.5, shown_C)):
        controller.step(replace(COLD, time_s=0.1 * k, temperature_C=(here_C, here_C)))
        metal = [one.temperature_C for one in controller.belief.metal if one is not None]
    assert metal == [25.5, 25.5]


def test_no_step_reads_a_file_or_a_clock() -> None:
    """Seen from its modules: what it is made of imports neither time nor threads."""
    folder = Path(sys.modules[Controller.__module__].__file__ or "").parent
    for name in (
        *("belief", "controller", "course", "driving", "following"),
        *("greedy_rule", "mission", "replanning"),
    ):
        source = (folder / f"{name}.py").read_text()
        for word in ("import time", "threading", "open(", "sleep"):
            assert word not in source, (name, word)
