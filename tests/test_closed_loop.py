"""Closed-loop runs from start to end: what a user of ``simulate`` relies on."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from once import simulated

from twosra_mpc import InputError, load_problem, plan
from twosra_mpc.cli import main
from twosra_mpc.execution.executor import Executor
from twosra_mpc.execution.run import Ending
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.execution.simulation.simulate import Simulation, simulate
from twosra_mpc.robot.path_fitting import with_path_model

RUNS = [("paper-2", 2), ("paper-4", 2), ("paper-1", 4)]


def true_error(simulation: Simulation) -> np.ndarray:
    return simulation.run.goal.error(simulation.truth.q[-1].copy())


@pytest.mark.parametrize(("name", "seed"), RUNS)
def test_a_disturbed_robot_reaches_its_goal_or_says_why_not(name: str, seed: int) -> None:
    found = simulated(name, seed)
    assert found.run.reason
    assert found.run.ending is Ending.REACHED
    x, y, phi, *kappa = true_error(found)
    assert math.hypot(x, y) <= 2e-3
    assert abs(phi) <= math.radians(1.0)
    assert np.abs(kappa).max() <= 1.0


def test_no_more_transitions_than_the_plans_begun() -> None:
    for name, seed in RUNS:
        run = simulated(name, seed).run
        assert run.transitions <= sum(run.begun)
        assert len(run.begun) == len(run.plans) == 1 + run.replans + run.corrections


def test_an_undisturbed_robot_of_the_planned_kind_does_what_was_planned() -> None:
    problem = load_problem("rigid-move")
    found = simulate(problem, plant="as-planned", disturbance="none", seed=0)
    assert found.run.reached
    assert np.abs(true_error(found)[:3]).max() <= 1e-4


def test_a_robot_moves_only_while_no_metal_changes() -> None:
    for name, seed in RUNS:
        truth = simulated(name, seed).truth
        moved = np.abs(np.diff(truth.q, axis=0)).max(axis=1) > 1e-3
        changing = (truth.melt_fraction > 0.2) & (truth.melt_fraction < 0.8)
        assert not (moved & changing[:-1].any(axis=1)).any()


def test_a_heater_that_never_warms_is_reported_in_words() -> None:
    found = simulate(load_problem("paper-2"), disturbance="none", seed=0, broken_heaters=[1])
    assert found.run.ending is Ending.HEATER_FAILED
    assert "segment 1" in found.run.reason
    assert not found.run.reached


@pytest.mark.parametrize(
    ("asked", "field"), [({"disturbance": "wild"}, "disturbance"), ({"plant": "clay"}, "plant")]
)
def test_what_does_not_exist_is_refused_by_name(asked: dict[str, str], field: str) -> None:
    with pytest.raises(InputError) as error:
        simulate(load_problem("paper-2"), **asked)
    assert error.value.field == field


def test_a_plan_for_another_robot_is_refused() -> None:
    problem = load_problem("rigid-move")
    robot = SimulatedRobot(problem, "arc", disturbance_level("none"), 0)
    other = plan(problem.with_values(robot=with_path_model(problem.robot, "log_spiral"))).require()
    with pytest.raises(InputError, match="robot"):
        Executor(robot, ExecutorSettings()).run(other)


def test_the_command_writes_run_and_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, plot = tmp_path / "run.json", tmp_path / "run.png"
    arguments = ["simulate", "rigid-move", "--disturbance", "mild", "--seed", "1"]
    with pytest.raises(SystemExit) as done:
        main([*arguments, "--out", str(out), "--plot", str(plot)])
    assert done.value.code == 0
    assert "reached" in capsys.readouterr().out
    document = json.loads(out.read_text())
    assert document["disturbance"] == "mild"
    assert document["metrics"]
    assert plot.stat().st_size > 10_000


def test_the_plan_inside_a_run_is_a_plan() -> None:
    made = simulated("paper-2", 2).run.plans[0]
    assert made.verification.ok
