"""The ``twosra`` program: exit codes, what goes where, and that options override the file."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from conftest import Outcome, Run
from test_problem import ROBOT, write

from twosra_mpc import __version__, effort, load_plan, load_robot, robot_names, scenario_names
from twosra_mpc.cli import planning
from twosra_mpc.planning import planner
from twosra_mpc.planning.solver import sequence_solver
from twosra_mpc.problem.problem import Problem, load_problem

SHARED_BEND = {
    "robot": "2sra-v1",
    "modes": [[0, 0], [1, 1]],
    "start": {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]},
    "goal": {"kappa_per_m": [20.0, -10.0]},
}  # both segments bend by the same angle, so this goal is out of reach


def rigid_move() -> dict[str, Any]:
    """The built-in scenario, every default written out."""
    document = load_problem("rigid-move").scenario()
    document["start"] = written(document["start"])
    return written(document)


def written(table: dict[str, Any]) -> dict[str, Any]:
    """A table without None, which TOML cannot write."""
    return {key: value for key, value in table.items() if value is not None}


@pytest.fixture
def infeasible(tmp_path: Path) -> Path:
    """A scenario that is proved infeasible."""
    return write(SHARED_BEND, tmp_path / "shared-bend.toml")


# --- planned: 0 ----------------------------------------------------------------------------------


def test_a_plan_is_summed_up_on_standard_output(run: Run) -> None:
    code, out, err = run("plan", "shape-change")
    assert code == 0
    assert err == ""
    found = planner.plan(load_problem("shape-change"))
    assert found.lower_bound is not None
    assert "status optimal" in out
    assert f"outcome {found.message}" in out
    assert f"duration {found.plan.cost.time_s:.2f} s" in out
    assert f"lower bound {found.lower_bound:.2f} s" in out
    assert f"energy {found.plan.cost.energy_J:.0f} J in 2 transitions" in out
    for phase in found.plan.phases:
        assert f"drive [{phase.mode[0]},{phase.mode[1]}] {phase.start_s:.2f} s to" in out
    for item in found.plan.transitions:
        assert f"segment {item.segment} {item.to} {item.heater_s:.2f} s to {item.done_s:.2f}" in out
    assert "verification passed" in out


def test_a_greedy_plan_claims_no_bound(run: Run) -> None:
    code, out, _ = run("plan", "rigid-move", "--planner", "greedy")
    assert code == 0
    assert "status feasible" in out
    assert "lower bound" not in out
    assert "by the greedy rule" in out


def test_files_are_written_where_they_were_asked_for(run: Run, tmp_path: Path) -> None:
    code, _, err = run("plan", "shape-change", "--out", "a.json", "--csv", "a.csv")
    assert (code, err) == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.json"]
    found = load_plan(tmp_path / "a.json")
    assert found.found
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("t_s,mode1,mode2,wheel1_rad_s")
    assert len(lines) - 1 == len(found.plan.samples)
    assert float(lines[-1].split(",")[0]) == found.plan.duration_s


def test_the_rate_is_that_of_the_csv_file(run: Run, tmp_path: Path) -> None:
    assert run("plan", "rigid-move", "--csv", "a.csv", "--rate", "20").code == 0
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()[1:]
    times = [float(line.split(",")[0]) for line in lines]
    assert times[:-1] == pytest.approx([i / 20 for i in range(len(times) - 1)])


def test_a_scenario_file_is_planned_like_a_built_in_one(run: Run, tmp_path: Path) -> None:
    for name in ("mine.toml", "mine.json"):
        write(rigid_move(), tmp_path / name)
        assert run("plan", name, "--out", "plan.json").code == 0
        expected = planner.plan(load_problem("rigid-move")).to_dict()
        found = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))
        assert found["samples"] == expected["samples"]
        assert found["cost"] == expected["cost"]


def test_scenarios_are_listed_with_start_goal_and_purpose(run: Run) -> None:
    code, out, err = run("scenarios")
    assert (code, err) == (0, "")
    for name in scenario_names():
        problem = load_problem(name)
        assert name in out.split()
        assert problem.description in out
        goal = ", ".join(f"{value:g}" for value in problem.goal.configuration)
        start = ", ".join(f"{value:g}" for value in problem.start.configuration)
        assert f"{start} {goal if not problem.ends_anywhere else 'none: only tasks'}" in out
    assert "nan" not in out


def test_robots_are_listed_with_path_model_and_timings(run: Run) -> None:
    out = run("robots").out
    for name in robot_names():
        robot = load_robot(name)
        assert f"{name} {robot.path.model} {', '.join(robot.timing)} {robot.description}" in out


@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_and_version_are_no_errors(run: Run, option: str) -> None:
    for command in ((), ("plan",)):
        code, out, err = run(*command, option)
        assert (code, err) == (0, "")
        assert "Usage: twosra" in out
    assert run("--version").out == f"twosra, version {__version__}"


# --- options override the file -------------------------------------------------------------------

OVERRIDES: list[tuple[str, str, str, object]] = [
    ("--planner", "greedy", "planner", "greedy"),
    ("--robot", "mine.toml", "robot", "mine"),
    ("--timing", "paper", "timing", "paper"),
    ("--gap", "0.25", "gap", 0.25),
    ("--time-limit", "17.5", "time_limit_s", 17.5),
    ("--work-limit", "1750", "work_limit", 1750.0),
    ("--max-phases", "3", "max_phases", 3),
]


@pytest.mark.parametrize(("option", "given", "key", "expected"), OVERRIDES)
def test_every_option_overrides_the_file(
    run: Run, option: str, given: str, key: str, expected: object, tmp_path: Path
) -> None:
    write({**ROBOT, "name": "mine"}, tmp_path / "mine.toml")
    write(
        {**rigid_move(), "gap": 0.125, "time_limit_s": 30.0, "max_phases": 2},
        tmp_path / "move.toml",
    )
    assert run("plan", "move.toml", "--out", "without.json").code == 0
    assert run("plan", "move.toml", option, given, "--out", "with.json").code == 0
    before, after = (
        json.loads((tmp_path / name).read_text(encoding="utf-8"))["scenario"]
        for name in ("without.json", "with.json")
    )
    assert after[key] == expected
    assert before[key] != expected
    assert {**before, key: expected} == after


def test_a_goal_is_met_exactly_if_asked(run: Run, tmp_path: Path) -> None:
    for options in ([], ["--exact"]):
        assert run("plan", "rigid-move", *options, "--out", f"{len(options)}.json").code == 0
    widths = [
        json.loads((tmp_path / name).read_text(encoding="utf-8"))["scenario"]["goal"]["tolerance"]
        for name in ("0.json", "1.json")
    ]
    assert min(widths[0]["x_m"], widths[0]["phi_rad"], *widths[0]["kappa_per_m"]) > 0
    assert widths[1] == {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}


def test_the_path_model_overrides_that_of_the_robot(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Problem] = []

    def stop(problem: Problem, **_: Any) -> None:
        asked.append(problem)
        raise KeyboardInterrupt

    monkeypatch.setattr(planning, "plan_until_interrupted", stop)
    assert run("plan", "rigid-move", "--path-model", "arc").code == 130
    (problem,) = asked
    expected = load_problem("rigid-move")
    assert problem.robot.path.model == "arc"
    assert problem.with_values(robot=expected.robot) == expected
    assert problem.robot.with_values(path=expected.robot.path) == expected.robot


# --- bad input: 2 --------------------------------------------------------------------------------


@pytest.fixture
def no_planning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let whatever is planned be planned in vain."""
    monkeypatch.setattr(planning, "plan_until_interrupted", Mock(side_effect=AssertionError))


def assert_bad_input(outcome: Outcome, *words: str) -> None:
    """Exit code 2, nothing on standard output, and these words on standard error."""
    assert outcome.code == 2
    assert outcome.out == ""
    assert "Traceback" not in outcome.err
    for word in words:
        assert word in outcome.err


def test_no_command_shows_the_help_and_is_an_error(run: Run) -> None:
    assert_bad_input(run(), "Usage: twosra", "scenarios")


@pytest.mark.parametrize("option", ["--out", "--csv", "--plot"])
@pytest.mark.parametrize("target", ["missing/a.png", ".", "file/a.png"])
def test_an_output_that_cannot_be_written_is_refused_before_planning(
    run: Run, option: str, target: str, no_planning: None, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    outcome = run("plan", "rigid-move", option, target)
    allowed = "of a file, not of a folder" if target == "." else "that exists and can be written"
    assert_bad_input(outcome, f"twosra: output = '{target}'", allowed)


def test_a_folder_without_permission_is_refused_before_planning(
    run: Run, no_planning: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert_bad_input(run("plan", "rigid-move", "--out", "a.json"), "output = 'a.json'")


# --- infeasible: 3, no plan: 4 -------------------------------------------------------------------


def test_a_proof_that_there_is_no_plan_has_its_own_code(
    run: Run, infeasible: Path, tmp_path: Path
) -> None:
    code, out, err = run("plan", infeasible, "--out", "a.json", "--csv", "a.csv", "--plot", "a.png")
    assert (code, err) == (3, "twosra: there is no plan to write to a.csv and a.png")
    assert "status infeasible" in out
    assert "proved infeasible: mode [1,1] alone bends both segments together" in out
    assert "allowed modes are [0,0], [1,1]" in out
    assert "duration" not in out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "shared-bend.toml"]
    assert load_plan(tmp_path / "a.json").status == "infeasible"


def test_a_greedy_rule_that_fails_has_no_plan(run: Run, infeasible: Path, tmp_path: Path) -> None:
    code, out, err = run("plan", infeasible, "--planner", "greedy", "--out", "a.json")
    assert (code, err) == (4, "")
    assert "status failed" in out
    assert "the greedy rule found no plan: no allowed mode comes nearer to the goal" in out
    assert not load_plan(tmp_path / "a.json").found


@pytest.mark.parametrize("limit", ["work_limit", "time_limit_s"])
def test_a_limit_that_is_too_small_has_no_plan(run: Run, limit: str) -> None:
    option = "--" + limit.removesuffix("_s").replace("_", "-")
    code, out, err = run("plan", "paper-1", option, "1e-9")
    assert (code, err) == (4, "")
    assert "status failed" in out
    assert f"no plan found (a limit was reached): raise {limit}" in out


# With the authors' sleeps the gap of the first plan is 0.1 %: asked for less, the search goes on.
LONG_SEARCH = ("plan", "paper-1", "--timing", "paper", "--gap", "0")


def assert_best_so_far(outcome: Outcome, words: str, folder: Path) -> None:
    """Exit code 4, but the verified plan found so far is told and written."""
    assert outcome.code == 4
    assert outcome.err == ""
    assert "status feasible" in outcome.out
    assert words in outcome.out
    assert "verification passed" in outcome.out
    found = load_plan(folder / "a.json")
    assert found.stopped_early
    assert found.found
    assert found.gap is not None
    assert 0.0 < found.gap < 0.01
    assert (folder / "a.csv").is_file()


class Solving:
    """Replaces ``solve``: some sequences keep their guess, the next meets a surprise."""

    def __init__(self, surprise: Callable[[], None], before: int) -> None:
        self.before = before
        self.surprise = surprise

    def __call__(self, *_: Any) -> None:
        self.before -= 1
        if self.before < 0:
            self.surprise()


@pytest.mark.parametrize("before", [0, 1])  # 0: while the first plan is improved
def test_an_interrupt_returns_the_best_plan_so_far(
    before: int, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr(sequence_solver, "solve", Solving(interrupt, before))
    outcome = run(*LONG_SEARCH, "--out", "a.json", "--csv", "a.csv")
    assert_best_so_far(outcome, "; interrupted: run again to continue the search", tmp_path)


def test_a_time_limit_returns_the_best_plan_so_far(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(now=0.0)

    def an_hour_later() -> None:
        clock.now += 3600.0

    monkeypatch.setattr(effort, "time", SimpleNamespace(process_time=lambda: clock.now))
    monkeypatch.setattr(sequence_solver, "solve", Solving(an_hour_later, before=0))
    outcome = run(*LONG_SEARCH, "--out", "a.json", "--csv", "a.csv")
    assert_best_so_far(outcome, "; a limit was reached: raise time_limit_s or gap", tmp_path)


def test_an_interrupt_outside_the_search_has_no_plan(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    for end in (signal.SIGINT, signal.SIGTERM):
        ended = Mock(side_effect=lambda *_, end=end, **__: signal.raise_signal(end))
        monkeypatch.setattr(planning, "plan_until_interrupted", ended)
        code, out, err = run("plan", "paper-1")
        assert (code, out) == (130, "")
        assert err == "twosra: interrupted before there was a result"


# --- progress ------------------------------------------------------------------------------------


# --- the installed program -----------------------------------------------------------------------


def test_the_program_is_installed() -> None:
    program = shutil.which("twosra", path=str(Path(sys.executable).parent)) or "twosra"
    done = subprocess.run(
        [program, "plan", "rigid-move", "--rate", "0"], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("twosra: rate = 0.0")


# --- figures -------------------------------------------------------------------------------------


def test_the_plan_is_drawn_where_it_was_asked_for(run: Run, tmp_path: Path) -> None:
    assert run("plan", "rigid-move", "--plot", "a.png").code == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG\r\n")
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
