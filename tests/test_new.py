"""``twosra new``: what it writes loads and plans, keeps its comments, and replaces nothing."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import Run
from once import solved
from test_completion import completions

from twosra_mpc import load_problem, load_robot, robot_names, scenario_names
from twosra_mpc.files import locate
from twosra_mpc.lab.batch.spec import load_spec
from twosra_mpc.problem.goals import Goal, Tolerance
from twosra_mpc.problem.problem import Problem, Start, Weights


def comments(text: str) -> list[str]:
    return re.findall(r"#.*", text)


@pytest.mark.parametrize("name", scenario_names())
def test_a_copied_scenario_is_the_same_problem(name: str, run: Run, tmp_path: Path) -> None:
    code, _, err = run("new", "scenario", f"my-{name}", "--from", name)
    assert (code, err) == (0, "")
    copied = tmp_path / f"my-{name}.toml"
    assert load_problem(copied) == load_problem(name)
    built_in = locate(name, "scenarios", "scenario")
    assert copied.read_text(encoding="utf-8") == built_in.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", robot_names())
def test_a_copied_robot_is_the_same_under_its_own_name_and_plans(
    name: str, run: Run, tmp_path: Path
) -> None:
    told = json.loads(run("new", "robot", "lab 2.toml", "--from", name, "--json").out)
    assert told["file"] == "lab 2.toml"
    copied = load_robot(tmp_path / "lab 2.toml")
    assert copied == load_robot(name).with_values(name="lab 2")
    built_in = locate(name, "robots", "robot")
    kept = (tmp_path / "lab 2.toml").read_text(encoding="utf-8")
    assert comments(kept) == comments(built_in.read_text(encoding="utf-8"))
    plan = next(line for line in told["next"] if line.startswith("twosra plan"))
    assert run(*shlex.split(plan)[1:], "--out", "plan.json").code == 0
    assert run("verify", "plan.json").code == 0


def test_a_new_scenario_plans_as_it_is_told_to(run: Run, tmp_path: Path) -> None:
    told = json.loads(run("new", "scenario", "mine", "--json").out)
    assert [run(*shlex.split(line)[1:]).code for line in told["next"]] == [0, 0]
    assert load_problem(tmp_path / "mine.toml").description


def test_a_new_scenario_shows_every_key_with_a_value_that_is_legal(
    run: Run, tmp_path: Path
) -> None:
    assert run("new", "scenario", "mine").code == 0
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    whole = re.sub(r"(?m)^# (?=\[|\w+ = )", "", text)
    (tmp_path / "whole.toml").write_text(whole, encoding="utf-8")
    made = load_problem(tmp_path / "whole.toml")
    assert set(made.model_fields_set) == set(Problem.model_fields)
    assert set(made.goal.model_fields_set) == set(Goal.model_fields)
    assert set(made.start.model_fields_set) == set(Start.model_fields) - {"holding"}
    assert Tolerance.model_fields.keys() | Weights.model_fields.keys() <= set(
        re.findall(r"(?m)^(\w+) = ", whole)
    )
    plain, shown_only = load_problem(tmp_path / "mine.toml"), {"transition_quantile", "ambient_C"}
    for key in Problem.model_fields.keys() - shown_only - {"goal", "start"}:
        if key not in ("workspace", "obstacles", "tasks", "objects"):
            given, default = getattr(made, key), getattr(plain, key)
            assert (set(given) == set(default)) if key == "modes" else given == default, key


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("scenario", "mine"), "mine.toml' is not acceptable; allowed: the name of a new file"),
        (("robot", "2sra-v1"), "a name that no built-in robot has"),
        (("robot", "x", "--from", "doorway"), "one of 2sr-v2, 2sra-v1"),
        (("scenario", "x", "--from", "dorway"), "did you mean doorway"),
        (("scenario", "x.json"), "a name with or without .toml"),
        (("scenario", "."), "a name with or without .toml"),
        (("scenario", "no/such/folder"), "a folder that exists"),
        (("plan", "x"), "'scenario', 'robot'"),
    ],
)
def test_nothing_is_written_where_it_should_not(
    arguments: tuple[str, ...], words: str, run: Run, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text("kept", encoding="utf-8")
    code, out, err = run("new", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == "kept"
    assert run("new", "scenario", "mine", "--force").code == 0
    assert load_problem(tmp_path / "mine.toml").goal.mode == (0, 0)


def test_what_can_be_copied_is_completed() -> None:
    assert completions("new", "") == (["scenario", "robot", "batch"], False)
    assert completions("new", "scenario", "x", "--from", "door")[0] == ["doorway"]
    assert completions("new", "robot", "x", "--from", "2sr-")[0] == ["2sr-v2"]


def test_a_new_batch_plans_as_it_is_told_to(run: Run, tmp_path: Path) -> None:
    code, out, err = run("new", "batch", "many")
    assert code == 0, err
    assert "twosra batch many.toml --out many-runs" in out
    assert load_spec(tmp_path / "many.toml").size == 20
    text = (tmp_path / "many.toml").read_text(encoding="utf-8")
    shown = re.sub(r"^# (\[|gap|robot|goal|plans|planner)", r"\1", text, flags=re.M)
    head, _, rest = shown.partition("[random]")
    given = [line for line in head.splitlines() if line.startswith("pl")]
    (tmp_path / "all.toml").write_text("\n".join([*given, f"[random]{rest}"]), encoding="utf-8")
    assert load_spec(tmp_path / "all.toml").size == 20 * 3 * 5


def test_a_plan_file_is_the_problem_that_it_solves(tmp_path: Path) -> None:
    solved("rigid-move").save(tmp_path / "plan.json")
    assert load_problem(tmp_path / "plan.json") == solved("rigid-move").problem
    assert load_problem(tmp_path / "plan.json", gap=0.5).gap == 0.5


def test_a_robot_is_exported_as_urdf(run: Run, tmp_path: Path) -> None:
    assert run("export", "2sra-v1", "robot.urdf").code == 0
    assert ElementTree.parse(tmp_path / "robot.urdf").getroot().tag == "robot"
