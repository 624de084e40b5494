"""Nothing sends or writes set-points of a plan that does not verify: one way in, and one question.

The forged plan is the least change that matters to a robot: a wheel that stands where it should
turn. Commands and functions are found by what they take, so that a new one is asked here, too.
"""

from __future__ import annotations

import inspect
import json
import typing
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import pytest
from conftest import Run
from once import solved
from test_seams import MODULES, imports

from twosra_mpc import NoPlanError, Plan, Status, load_plan
from twosra_mpc.cli import _MODULES as MODULES_OF_COMMANDS
from twosra_mpc.execution.executor import Executor
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.execution.tracking.tracker import Tracker

# Command -> what it writes.
OUTPUTS: dict[str, list[list[str]]] = {
    "verify": [[]],
    "resample": [["out.csv", "--rate", "5"], ["out.json", "--rate", "5"]],
    "export": [["out.csv"], ["out.mcap"]],
    "animate": [["out.gif", "--seconds", "1"]],
    "stream": [["--dry-run"]],
    "report": [["out.html"]],
}
REFUSED = 4


def command(name: str) -> click.Command:
    module = import_module(f"twosra_mpc.{MODULES_OF_COMMANDS[name]}")
    found = [each for each in vars(module).values() if isinstance(each, click.Command)]
    return next(each for each in found if each.name == name)


def takes_a_plan(name: str) -> bool:
    arguments = [each for each in command(name).params if isinstance(each, click.Argument)]
    return any(
        "PLAN" in (each.metavar or each.name or "").upper().split("|")[0] for each in arguments
    )


@pytest.fixture(scope="module")
def forged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan file in which one wheel stands still in one sample."""
    document = json.loads(json.dumps(solved("paper-1").to_dict()))
    wheels = document["samples"]["wheel_rad_s"]
    row = next(i for i, speeds in enumerate(wheels) if abs(speeds[0]) > 0.1)
    wheels[row][0] = 0.0
    path = tmp_path_factory.mktemp("forged") / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_every_command_that_takes_a_plan_is_asked_here() -> None:
    assert {name for name in MODULES_OF_COMMANDS if takes_a_plan(name)} == OUTPUTS.keys()


@pytest.mark.parametrize("name", OUTPUTS)
def test_no_command_writes_setpoints_of_a_forged_plan(name: str, forged: Path, run: Run) -> None:
    for arguments in OUTPUTS[name]:
        done = run(name, forged, *arguments)
        if name == "report":  # which says so
            text = Path("out.html").read_text(encoding="utf-8")
            assert "the wheels do not turn as v asks" in text
            assert 'id="setpoints"' not in text
            continue
        assert done.code == REFUSED
        assert "wheels" in done.out + done.err
        assert not list(Path().glob("out.*"))


@pytest.mark.parametrize("name", sorted(OUTPUTS.keys() - {"verify", "report"}))
def test_no_command_writes_anything_of_a_file_without_a_plan(name: str, run: Run) -> None:
    none = {"plan": None, "lower_bound": None, "status": Status.FAILED, "words": "no way"}
    replace(solved("rigid-move"), **none).save("p.json")
    for arguments in OUTPUTS[name]:
        done = run(name, "p.json", *arguments)
        assert (done.code, done.out) == (REFUSED, "")
        assert "no way" in done.err
        assert not list(Path().glob("out.*"))


def test_no_function_sends_or_writes_a_plan_that_does_not_verify(
    forged: Path, tmp_path: Path
) -> None:
    """Those of ``export`` and set-points, found by their first argument, and what runs a plan."""
    result = load_plan(forged)
    assert not result.found
    assert result.plan is not None
    with pytest.raises(NoPlanError, match="wheels do not turn as v asks"):
        result.require()
    plan, problem = result.plan, result.problem
    robot = SimulatedRobot(problem)
    emitters: list[Callable[[Plan], Any]] = [
        Executor(robot).run,
        Tracker(problem.robot).reset,
        lambda plan: simulate(problem, plan=plan),
        *(lambda plan, save=save: save(plan, tmp_path / "out.csv") for save in savers()),
    ]
    assert len(emitters) == 6
    for emit in emitters:
        with pytest.raises(NoPlanError, match="it does not verify"):
            emit(plan)
    assert not list(tmp_path.iterdir())
    assert replace(plan, verification=replace(plan.verification, ok=True)).require()


def savers() -> list[Callable[..., None]]:
    """Functions ``save_...(plan, path)`` of the package."""
    found: dict[str, Callable[..., None]] = {}
    for name in MODULES:
        if name.startswith(("lab/export/", "lab/identification/motion_log", "plans/")):
            module = import_module(f"twosra_mpc.{name[:-3].replace('/', '.')}")
            for key, value in vars(module).items():
                if key.startswith("save_") and inspect.isfunction(value):
                    kinds = list(typing.get_type_hints(value).values())
                    found |= {key: value} if kinds[0] is Plan else {}
    return list(found.values())


def test_plan_files_are_read_by_the_loader_alone() -> None:
    from_files = {
        module
        for module in MODULES
        if "plan_in(" in (Path(__file__).parent.parent / "twosra_mpc" / module).read_text()
    }
    assert from_files == {"plans/result.py", "checking/plan_file.py"}
    assert "twosra_mpc.plans.result" in set(imports("checking/plan_file.py"))
