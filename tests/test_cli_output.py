"""How every command talks: JSON, quiet, progress, errors of the system, help and its examples."""

from __future__ import annotations

import errno
import inspect
import json
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import click
import numpy as np
import pytest
from conftest import Run
from matplotlib.figure import Figure
from once import planned, solved
from simulated_firmware import SimulatedFirmware
from test_cli import SHARED_BEND
from test_occupancy_map import write_map
from test_problem import write
from test_replay import TRIAL, TRIAL_1, wheel_log, write_transport

from benchmarks.files.heating import true_history, write_log
from benchmarks.files.melts import made_up
from benchmarks.files.melts import write as write_rows
from benchmarks.files.photographs import write_folder
from twosra_mpc import NoPlanError, Problem, cli, load_problem, robot_names, scenario_names
from twosra_mpc.cli import options, output, planning, simulate_command
from twosra_mpc.execution.simulation.simulate import Simulation
from twosra_mpc.execution.simulation.simulate import simulate as run_simulation
from twosra_mpc.files import plain_data
from twosra_mpc.lab.commands import serial_commands
from twosra_mpc.lab.figures import paper_figures
from twosra_mpc.lab.report import page
from twosra_mpc.model.rolling import Drift
from twosra_mpc.planning.proof import Prover
from twosra_mpc.plotting import film

COMMANDS = [name for section in cli._COMMANDS.values() for name in section]
OWN_TESTS = ("doctor", "reproduce", "batch", "atlas", "studio", "learn")  # examples run there


@pytest.fixture
def run(run_as_is: Run) -> Run:
    """Run the program; output as it is."""
    return run_as_is


def load_quick(_asked: str, **overrides: Any) -> Problem:
    """Load a scenario that takes less time than the one that was asked for."""
    return load_problem("shape-change", **{"max_phases": 3, "gap": 0.05, **overrides})


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands that start at a scenario plan a quick one, and draw and film little."""
    monkeypatch.setattr(options, "load_problem", load_quick)
    monkeypatch.setattr(film, "FRAMES_PER_S", 0.2)
    monkeypatch.setattr(page, "plot_plan", lambda *_, **__: Figure())
    monkeypatch.setattr(paper_figures, "PAPER_FIGURES", {"blank": Figure().savefig})


@lru_cache(1)
def simulated() -> Simulation:
    """One run of a simulated robot, the same for all tests."""
    return run_simulation(load_problem("rigid-move"))


@pytest.fixture
def one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all simulated robots be alike."""
    monkeypatch.setattr(simulate_command, "simulate", lambda *_, **__: simulated())


def command(name: str) -> click.Command:
    found = cli.commands.get_command(click.Context(cli.commands), name)
    assert found is not None
    return found


# --- JSON and quiet ------------------------------------------------------------------------------


def test_nothing_but_json_is_printed_for_programs(run: Run) -> None:
    code, out, err = run("plan", "shape-change", "--json", "--out", "plan.json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found == json.loads(Path("plan.json").read_text(encoding="utf-8"))
    assert found["samples"] == json.loads(json.dumps(solved("shape-change").to_dict()))["samples"]


def test_a_plan_that_there_is_not_is_json_too(run: Run) -> None:
    write(SHARED_BEND, Path("shared-bend.toml"))
    code, out, err = run("plan", "shared-bend.toml", "--json")
    assert (code, err) == (3, "")
    assert json.loads(out)["status"] == "infeasible"


def test_an_explanation_is_json(run: Run) -> None:
    code, out, err = run("explain", "shape-change", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["complete"] is True
    total = sum(item["duration_s"] for item in found["critical_path"])
    assert total == pytest.approx(found["plan"]["duration_s"])
    assert found["why"]
    assert all(other["change"] for other in found["alternatives"])
    assert {type(other["difference_s"]) for other in found["alternatives"]} <= {float, type(None)}


def test_the_lists_are_json(run: Run) -> None:
    scenarios = json.loads(run("scenarios", "--json").out)
    assert [each.pop("name") for each in scenarios] == scenario_names()
    assert scenarios == [load_problem(name).scenario() for name in scenario_names()]
    robots = json.loads(run("robots", "--json").out)
    assert [each["name"] for each in robots] == robot_names()


def test_a_checked_robot_is_json(run: Run) -> None:
    found = json.loads(run("check-robot", "2sra-v1", "--json").out)
    assert found["robot"] == "2sra-v1"
    assert any(shape["unit_gap_m"] < 0 for shape in found["singular_shapes"])
    assert found["condition_number_straight"] > 1


def test_fitted_paths_are_json(run: Run) -> None:
    found = json.loads(run("fit-paths", "2sra-v1-paper", "--json").out)
    assert found["cases"] == ["I", "II", "III"]
    assert found["spirals"][0]["growth"] == pytest.approx(found["path"]["growth"][0], abs=2e-3)
    assert len(found["cardioids"]) == 3


def test_simulations_are_json(run: Run) -> None:
    one = json.loads(run("simulate", "rigid-move", "--json", "--seed", 3).out)
    assert (one["format"], one["seed"]) == ("twosra-run", 3)
    many = json.loads(run("simulate", "rigid-move", "--json", "--seed", 3, "--runs", 2).out)
    assert many["first_seed"] == 3
    assert [each["reached"] for each in many["runs"]] == [True, True]
    assert many["runs"][0]["time_s"] == one["metrics"]["time_s"]


def test_a_scored_log_is_json(run: Run, tmp_path: Path) -> None:
    log = write_log(true_history((40.0,)).log(1.0), tmp_path / "log.csv")
    found = json.loads(run("fit-thermal", log, "--robot", "2sr-v2", "--score", "--json").out)
    assert found[0]["residuals"]["rms_C"] > 0


def test_quiet_prints_nothing_and_does_the_work(run: Run) -> None:
    assert run("plan", "rigid-move", "--quiet", "--out", "plan.json") == (0, "", "")
    assert Path("plan.json").is_file()
    assert run("scenarios", "-q") == (0, "", "")


def test_quiet_still_tells_errors(run: Run) -> None:
    code, out, err = run("plan", "no-such", "--quiet")
    assert (code, out) == (2, "")
    assert "no-such" in err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_both_options(name: str) -> None:
    options = {opt for param in command(name).params for opt in param.opts}
    assert {"--json", "--quiet", "-q"} <= options


def test_numbers_that_are_not_finite_are_null() -> None:
    data = {"a": np.array([1.0, np.nan]), 2: (np.float64("inf"), "text", None, True)}
    assert plain_data(data) == {"a": [1.0, None], "2": [None, "text", None, True]}


# --- overrides of a scenario ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ["plan", "explain", "compare", "simulate"])
def test_a_path_model_that_there_is_not_is_refused_wherever_one_can_be_given(
    name: str, run: Run
) -> None:
    code, out, err = run(name, "rigid-move", "--path-model", "straight")
    assert (code, out) == (2, "")
    assert "path.model = 'straight' is not acceptable" in err


def test_the_path_model_asked_for_is_planned_with(run: Run) -> None:
    for name in ("plan", "simulate"):
        asked = (name, "rigid-move", "--path-model", "arc", "--gap", "0.05", "--json")
        made = json.loads(run(*asked).out)
        assert made["robot"]["path"]["model"] == "arc"
        assert made["scenario"]["gap"] == 0.05


@pytest.mark.parametrize("name", ["plan", "explain", "compare", "simulate"])
def test_a_search_can_be_limited_wherever_there_is_one(name: str) -> None:
    known = {opt for param in command(name).params for opt in param.opts}
    assert {"--robot", "--timing", "--gap", "--time-limit"} <= known


# --- tables --------------------------------------------------------------------------------------


@pytest.mark.parametrize("columns", ["1", "20", "61", "200"])
def test_no_sign_of_a_table_is_lost_on_a_narrow_screen(
    columns: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    rows = [("two\nlines", "x" * 30, "[0,0] > [1,0]", "and [bold] :smile:", "é")]
    output.print_table(("first", "second", "", "fourth", "fifth"), rows)
    shown = Counter(capsys.readouterr().out)
    assert "…" not in shown
    assert not Counter("".join(rows[0]).replace(" ", "")) - shown


NARROW: list[list[str]] = [
    ["plan", "paper-2", "--timing", "paper"],
    ["plan", "blocked"],
    ["compare", "paper-2", "rigid-move"],
    ["explain", "shape-change"],
    ["simulate", "rigid-move"],
    ["check-robot", "2sra-v1"],
    ["fit-paths", "2sra-v1"],
    ["robots"],
    ["scenarios"],
    ["verify", "plan.json"],
]


@pytest.mark.parametrize("arguments", NARROW, ids=" ".join)
def test_tables_fit_100_columns_in_a_pipe_unless_more_are_asked_for(
    arguments: list[str], run_as_is: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS")
    solved("rigid-move").save("plan.json")
    lines = run_as_is(*arguments).out.splitlines()
    assert max(map(len, lines)) <= 100
    assert len(lines) > 3
    assert not re.search(r"-0(\.0+)?\b(?!\.|e|\d)", "".join(lines))  # no zero has a sign


# --- progress ------------------------------------------------------------------------------------


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let standard error pass for a terminal."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")


PROGRESS: list[tuple[list[str], str]] = [
    (["plan", "rigid-move", "--json"], "planning (optimal): best plan"),
    (["explain", "paper-4", "--json"], "planning"),
    (["compare", "rigid-move", "--json"], "planning rigid-move (1 of 1), greedy"),
    (["simulate", "rigid-move", "--json", "--runs", "2"], "running 2 of 2"),
    (["verify", "plan.json", "--json"], "verifying"),
    (["resample", "plan.json", "out.csv", "--rate", "1", "--json"], "resampling at 1 Hz"),
    (["export", "plan.json", "out.csv", "--json"], "writing out.csv"),
    (["report", "plan.json", "out.html", "--json"], "drawing the report"),
    (["animate", "plan.json", "out.gif", "--json"], "animating: frame 2 of 2"),
    (["figures", "folder", "--json"], "drawing blank"),
]


@pytest.mark.usefixtures("terminal", "quick", "one_run")
@pytest.mark.parametrize(("arguments", "words"), PROGRESS, ids=[" ".join(a) for a, _ in PROGRESS])
def test_progress_is_shown_on_a_terminal_only_and_not_with_quiet(
    run: Run, arguments: list[str], words: str
) -> None:
    solved("rigid-move").save("plan.json")
    code, out, err = run(*arguments)
    assert code == 0
    assert words in err
    json.loads(out)
    assert run(*arguments, "--quiet") == (0, out, "") or "wall_s" in out


@pytest.mark.usefixtures("terminal", "quick", "one_run")
def test_a_film_of_a_run_shows_its_progress(run: Run) -> None:
    assert "filming: frame 2 of 2" in run("simulate", "rigid-move", "--animate", "run.gif").err
    assert Path("run.gif").is_file()


# --- what the system refuses ---------------------------------------------------------------------


FULL = OSError(errno.ENOSPC, "No space left on device", "plan.json")


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (FULL, 2, "plan.json: No space left on device"),
        (OSError("something odd"), 2, "something odd"),
        (MemoryError(), 2, "more memory than there is"),
        (NoPlanError("infeasible", "why"), 3, "no verified plan (infeasible): why"),
        (NoPlanError("failed", "why"), 4, "no verified plan (failed): why"),
    ],
)
def test_what_stops_a_command_is_a_message(
    error: BaseException, code: int, words: str, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planning, "plan_until_interrupted", Mock(side_effect=error))
    told = run("plan", "rigid-move")
    assert (told.code, told.out) == (code, "")
    assert told.err.startswith("twosra: ")
    assert words in told.err


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    program = [sys.executable, "-m", "twosra_mpc", "schema", "plan"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        told = process.stderr.read()
    assert (process.returncode, told) == (output.Exit.BROKEN_PIPE, b"")


# --- help ----------------------------------------------------------------------------------------


def test_the_help_lists_every_command_in_one_line(run: Run) -> None:
    width = max(map(len, COMMANDS))
    out = run("--help").out
    for title, section in cli._COMMANDS.items():
        assert f"\n{title}:\n" in out
        for name, (_, words) in section.items():
            assert f"\n  {name.ljust(width)}  {words}\n" in out


def test_the_help_tells_exit_codes_and_completion(run: Run) -> None:
    out = run("--help").out
    for code in ("0  done", "2  bad input", "3  proved infeasible", "4  no plan"):
        assert f"    {code}" in out
    assert "_TWOSRA_COMPLETE=bash_source" in out


def examples(name: str) -> list[str]:
    text = inspect.cleandoc(command(name).help or "")
    return [line.strip() for line in text.splitlines() if line.startswith("  twosra ")]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_teaches_by_example(name: str) -> None:
    found = examples(name)
    assert any(example.startswith(f"twosra {name} ") or example == f"twosra {name}"
               for example in found)  # fmt: skip


@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], None]]:
    """Put a simulated robot and its clock at the end of a line: so many numbers end a command."""
    with ExitStack() as stack:

        def connect_once(numbers: int) -> None:
            firmware = SimulatedFirmware(planned("rigid-move"), numbers=numbers)
            stack.callback(firmware.close)
            monkeypatch.setattr(serial_commands, "open_serial_port", lambda _: firmware.port)
            monkeypatch.setattr(serial_commands, "SystemClock", lambda: firmware)

        yield connect_once


@pytest.fixture(scope="module")
def examples_read(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what examples read; its plans carry their proof."""
    folder, found = tmp_path_factory.mktemp("read"), solved("shape-change")
    proof = Prover(found.problem).certificate(found.lower_bound or 0.0)
    for target in ("plan.json", "other.json"):
        replace(found, certificate=proof).save(folder / target)
    robot = files("twosra_mpc").joinpath("robots", "2sra-v1.toml").read_text(encoding="utf-8")
    (folder / "my-robot.toml").write_text(robot, encoding="utf-8")
    write_log(true_history((40.0,)).log(0.5), folder / "heating.csv")
    for rows, file in zip(made_up(), ("melts.csv", "readings.csv"), strict=True):
        write_rows(rows, folder / file)
    write_map(folder, [[0, 255], [255, 255]])
    write_folder(folder / "shots", [-30.0, 20.0])
    (folder / "k.csv").write_text("kappa_per_m\n-30\n20\n")
    (folder / "exp1.csv").write_text(f"{TRIAL}\n{TRIAL_1}", encoding="utf-8")
    poses, _ = wheel_log(folder, Drift(), seconds=1)
    for log in ("s1_v1_6.csv", "poses.csv"):
        (folder / log).write_bytes(poses.read_bytes())
    write_transport(folder)
    return folder


@pytest.mark.usefixtures("quick", "one_run")
@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in OWN_TESTS])
def test_every_example_runs(
    name: str,
    run: Run,
    examples_read: Path,
    connect: Callable[[int], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shutil.copytree(examples_read, tmp_path, dirs_exist_ok=True)
    if name == "stream":  # a plan of which no metal has to melt
        monkeypatch.setattr(options, "load_problem", lambda *_, **__: load_problem("rigid-move"))
    for example in examples(name):
        words = shlex.split(example)[1:]
        words = words[: next((i for i, word in enumerate(words) if word in (">", "&&")), None)]
        if "--size" in words:  # of a map: 9 points are drawn as 81 are
            words[words.index("--size") + 1] = "3"
        if "--port" in words:
            connect(1 if "--robot-id" in words else 0)
        code, out, err = run(*words)
        assert (code, err) == (0, ""), example
        assert (out == "") == ("--quiet" in words), example
        if "--json" in words or name == "schema":
            json.loads(out)
        for option in ("--out", "--plot", "--csv", "--animate"):
            if option in words:
                assert (tmp_path / words[words.index(option) + 1]).stat().st_size > 0, example
