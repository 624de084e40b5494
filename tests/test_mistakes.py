"""Mistakes of a first hour: each is answered in a line or two, with what to write instead."""

from __future__ import annotations

import re
import tomllib
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from once import cases, solved

from twosra_mpc import (
    InputError,
    Problem,
    Start,
    load_problem,
    load_robot,
    robot_names,
    scenario_names,
)
from twosra_mpc.errors import InputWarning
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.files import locate
from twosra_mpc.lab.batch.spec import RandomSet
from twosra_mpc.problem.goals import Goal
from twosra_mpc.robot.description import with_path_model

pytestmark = pytest.mark.filterwarnings("error::twosra_mpc.errors.InputWarning")

LONGEST = 260  # characters of a message without the list of what is known

SCENARIO = """\
robot = "2sra-v1"
time_limit_s = 5.0

[start]
x_m = 0.0
y_m = 0.0
phi_rad = 0.0
kappa_per_m = [0.0, 0.0]

[goal]
x_m = 0.1
y_m = 0.05
phi_rad = 0.5
kappa_per_m = [20.0, 10.0]
"""

CASES = cases("mistakes")

HERE = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
PYTHON: list[tuple[Callable[[], object], tuple[str, ...]]] = [
    (
        lambda: Problem(robot="2sra-v1", start=[0, 0, 0, 0, 0], goal={"x_m": 0.1}),
        ("start = [0, 0, 0, 0, 0]", "give every value its key, e.g. x_m = 0.1"),
    ),
    (
        lambda: Problem(robot="2sra-v1", start=HERE, goal=np.zeros(5)),
        ("goal", "give every value its key"),
    ),
    (lambda: Problem(robot="2sra-v1", start=Start(**HERE)), ("goal is missing",)),
    (lambda: Start(x=0.0, **HERE), ("x = 0.0", "did you mean x_m?")),
    (lambda: Start(0.0, 0.0, 0.0, (0.0, 0.0)), ("Start(x_m=..., y_m=...,",)),  # type: ignore[misc]
    (
        lambda: Problem(robot="2sra-v1", start=Goal(x_m=0.1), goal=Goal(x_m=0.1)),
        ("this is a Goal, and a Start is meant",),
    ),
    (lambda: Goal(x_m="0.1"), ("did you mean 0.1, without quotes?",)),
    (lambda: Goal(kappa_per_m=(1.0, "any")), ('did you mean "free"?',)),
    (lambda: disturbance_level("medium"), ("disturbance = 'medium'", "none, mild, moderate")),
    (lambda: with_path_model(load_robot("2sra-v1"), "Arc"), ("did you mean arc?",)),
    (lambda: load_problem({"robot": "2sra-v1"}), ("Problem(**table)",)),  # type: ignore[arg-type]
]


def assert_helpful(said: str, words: Sequence[str]) -> None:
    """It says these words, in at most three short lines."""
    for word in words:
        assert word in said, said
    assert "Traceback" not in said
    lines = said.splitlines()
    assert len(lines) <= 4, said
    listed = r"known keys here are .*|allowed: .*one of .*|a built-in .*"
    assert all(len(re.sub(listed, "", line)) <= LONGEST for line in lines), said
    assert not re.search("pydantic|validation error|NoneType|<class|object at", said)


@pytest.fixture(autouse=True)
def there(tmp_path: Path) -> None:
    """Files that a beginner has around."""
    (tmp_path / "mine.toml").write_text(SCENARIO)
    robot = locate("2sra-v1", "robots", "robot").read_text(encoding="utf-8")
    (tmp_path / "robot.toml").write_text(robot.replace('"2sra-v1"', '"mine"'))
    (tmp_path / "log.csv").write_text("time_s,temperature_C\n0,25\n")
    (tmp_path / "map.json").write_text('{"type": "FeatureCollection", "features": []}')
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.html").mkdir()
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n")
    (tmp_path / "batch.toml").write_text("[random]\nseed = 0\n[grid]\n")


EMPTY = SCENARIO, "", ["a scenario; this file is empty", "twosra new scenario NAME"]


@pytest.mark.parametrize(("old", "new", "words"), [*CASES["edits"], EMPTY])
def test_a_slip_in_a_scenario_is_answered_with_what_to_write(
    old: str, new: str, words: list[str], run_as_is: Run, tmp_path: Path
) -> None:
    assert old in SCENARIO
    (tmp_path / "mine.toml").write_text(SCENARIO.replace(old, new, 1), encoding="utf-8")
    code, out, err = run_as_is("plan", "mine.toml")
    assert (code, out) == (2, "")
    assert_helpful(err, words)
    assert "mine.toml" in err


@pytest.mark.parametrize(("command", "words"), CASES["commands"])
def test_a_slip_at_the_prompt_is_answered_with_what_to_type(
    command: str, words: list[str], run_as_is: Run, tmp_path: Path
) -> None:
    solved("rigid-move").save(tmp_path / "plan.json")
    before = sorted(tmp_path.iterdir())
    code, out, err = run_as_is(*command.split())
    assert (code, out) == (2, "")
    assert_helpful(err, words)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(("make", "words"), PYTHON)
def test_a_slip_in_python_is_answered_with_what_to_write(
    make: Callable[[], object], words: tuple[str, ...]
) -> None:
    with pytest.raises(InputError) as error:
        make()
    assert_helpful(str(error.value), words)


@pytest.mark.parametrize(("old", "new", "words"), CASES["doubts"])
def test_a_number_in_another_unit_is_planned_with_and_doubted(
    old: str, new: str, words: list[str], run_as_is: Run, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text(SCENARIO.replace(old, new, 1), encoding="utf-8")
    code, out, err = run_as_is("plan", "mine.toml", "--quiet", "--work-limit", "1")
    assert code in (0, 3, 4), err
    assert out == ""
    assert err.startswith("twosra: warning: mine.toml: ")
    assert_helpful(err, (*words, "did you mean"))
    with pytest.warns(InputWarning, match="did you mean") as told:
        problem = load_problem(tmp_path / "mine.toml")
    assert [str(each.message) for each in told] == [
        f"{tmp_path / 'mine.toml'}: {doubt}" for doubt in problem.unit_doubts
    ]
    document = tomllib.loads((tmp_path / "mine.toml").read_text(encoding="utf-8"))
    for make in (lambda: Problem(**document), lambda: problem.with_values(max_phases=3)):
        with pytest.warns(InputWarning) as told:
            make()
        assert [str(each.message) for each in told] == [*problem.unit_doubts]
        assert {each.filename for each in told} == {__file__}, "the line of whoever made it"


@pytest.mark.parametrize(("old", "new", "words"), CASES["robot_doubts"])
def test_a_number_of_a_robot_in_another_unit_is_doubted_or_refused(
    old: str, new: str, words: list[str], run_as_is: Run, tmp_path: Path
) -> None:
    text = (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "robot.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    code, _, err = run_as_is("check-robot", "robot.toml")
    assert code in (0, 2), err
    for word in words:
        assert word in err
    assert len(err.splitlines()) == 1, err


def test_no_problem_that_is_right_is_doubted() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in scenario_names():
            assert load_problem(name).unit_doubts == ()
        for name in robot_names():
            load_robot(name)
        robot = load_robot("2sra-v1")
        wide = {"x_m": (-100.0, 100.0), "y_m": (-100.0, 100.0)}
        ends = {"start": load_problem("corridor").start, "goal": {"x_m": 0.2}}
        given = {"robot": robot, **ends, "workspace": wide}
        assert Problem.parse(given, "mine").unit_doubts == ()
        for ranges in ((0.3, 3.14, 70.0), (4.0, 6.28, 40.0), (0.01, 0.1, 1.0)):
            names = ("position_m", "heading_rad", "curvature_per_m")
            drawn = RandomSet(
                robot="2sra-v1", seed=3, count=300, **dict(zip(names, ranges, strict=True))
            )
            for start, goal in drawn.ends(robot):
                assert Problem(robot=robot, start=start, goal=goal).unit_doubts == ()
