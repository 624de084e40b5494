"""Pipes: whatever is read may be one, whatever is written may be one, and no output is an input."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import pytest
from conftest import Run
from forks import Forks
from once import solved

PLAN = "twosra-plan"
SCENARIO = {
    "robot": "2sra-v1",
    "start": {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]},
    "goal": {"x_m": 0.1},
}
SQUARE = {"type": "Polygon", "coordinates": [[[1, 1], [2, 1], [2, 2], [1, 2], [1, 1]]]}


def fifo(folder: Path, name: str, text: str) -> Path:
    """A named pipe, out of which the text comes once."""
    path = folder / name
    os.mkfifo(path)
    threading.Thread(target=path.write_text, args=(text,), daemon=True).start()
    return path


def test_a_scenario_its_robot_and_its_obstacles_come_out_of_pipes(
    run_as_is: Run, tmp_path: Path
) -> None:
    robot = run_as_is("new", "robot", "mine").code == 0 and Path("mine.toml").read_text()
    assert isinstance(robot, str)
    named = {
        "robot": str(fifo(tmp_path, "robot.pipe", robot)),
        "obstacles": str(fifo(tmp_path, "obstacles.pipe", json.dumps(SQUARE))),
    }
    scenario = fifo(tmp_path, "scenario.pipe", json.dumps(SCENARIO | named))
    code, out, err = run_as_is("plan", scenario, "--json")
    assert code == 0, err
    assert json.loads(out)["scenario"]["obstacles"]


def test_a_plan_comes_out_of_a_pipe(run_as_is: Run, tmp_path: Path) -> None:
    text = json.dumps(solved("rigid-move").to_dict())
    for command in (("verify",), ("resample", "--rate", "2", "out.csv"), ("report", "out.html")):
        pipe = fifo(tmp_path, f"{command[0]}.pipe", text)
        assert run_as_is(command[0], pipe, *command[1:]).code == 0


def test_the_program_writes_into_its_own_streams(forks: Forks, tmp_path: Path) -> None:
    """Descriptor 1 leads elsewhere by then, for libraries write to it; a link is followed."""
    words = ("plan", "/dev/stdin", "-q", "--out", "/dev/stdout")
    assert json.loads(forks.run(*words, given=json.dumps(SCENARIO)).stdout)["format"] == PLAN
    link = tmp_path / "link.csv"
    link.symlink_to("/dev/stderr")
    done = forks.run("plan", "rigid-move", "-q", "--csv", link)
    assert done.stderr.startswith(b"t_s,mode1")


def test_a_pipe_is_written_to(run_as_is: Run, tmp_path: Path) -> None:
    solved("rigid-move").save(tmp_path / "plan.json")
    os.mkfifo(tmp_path / "out.pipe")
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append((tmp_path / "out.pipe").read_text()))
    reader.start()
    assert run_as_is("resample", tmp_path / "plan.json", "out.pipe", "--rate", "2").code == 0
    reader.join(timeout=30)
    assert json.loads(got[0])["format"] == PLAN


@pytest.mark.parametrize(
    ("begins", "arguments"),
    [
        (b"\x89PNG", ("plan", "-", "-q", "--plot", "-")),
        (b"<!DOCTYPE html>", ("report", "-", "/dev/stdout")),
        (b"GIF89a", ("animate", "-", "-", "-q", "--seconds", "1")),
        (b"\x89MCAP0", ("export", "-", "-")),
        (b'{"format": "twosra-plan"', ("resample", "-", "-", "--rate", "2")),
    ],
)
def test_a_pipe_has_no_ending_and_a_dash_is_one(
    begins: bytes, arguments: tuple[str, ...], forks: Forks
) -> None:
    """What is written into it is of the usual format, and nothing else."""
    of_plan = arguments[0] != "plan"
    given = solved("rigid-move").to_dict() if of_plan else SCENARIO
    done = forks.run(*arguments, given=json.dumps(given))
    assert done.stdout.startswith(begins), done.stderr


def test_a_file_that_is_redirected_is_as_good_as_a_pipe(forks: Forks, tmp_path: Path) -> None:
    """It has no ending; what it holds says what it is."""
    solved("rigid-move").save(tmp_path / "plan.json")
    for command in ("plan", "verify"):
        assert forks.run(command, "-", "-q", given=tmp_path / "plan.json").returncode == 0


def test_a_stream_is_written_by_one_output(run_as_is: Run) -> None:
    code, _, err = run_as_is("plan", "rigid-move", "--out", "-", "--csv", "-")
    assert (code, "another file for each thing" in err) == (2, True)


def test_a_file_on_standard_output_is_alone_there(forks: Forks) -> None:
    """No tables, no JSON of the command's own; so one command's output is the next one's input."""
    scenario = forks.run("new", "scenario", "-").stdout
    for more in ((), ("--json",)):
        plan = forks.run("plan", "-", "--out", "-", *more, given=scenario).stdout
        assert json.loads(plan)["format"] == PLAN
    done = forks.run("resample", "-", "-", "--rate", "1", given=plan)
    assert done.stdout.startswith(b'{"format"')


@pytest.mark.parametrize("output", ["plan.json", "link.json"])
def test_no_output_is_an_input(output: str, run_as_is: Run, tmp_path: Path) -> None:
    solved("rigid-move").save(tmp_path / "plan.json")
    before = (tmp_path / "plan.json").read_bytes()
    (tmp_path / "link.json").symlink_to("plan.json")
    code, _, err = run_as_is("resample", "plan.json", output, "--rate", "2")
    assert code == 2
    assert "another file than one that is read" in err
    assert (tmp_path / "plan.json").read_bytes() == before


def test_no_output_is_what_a_scenario_names(run_as_is: Run, tmp_path: Path) -> None:
    (tmp_path / "lab.json").write_text(json.dumps(SQUARE))
    (tmp_path / "mine.json").write_text(json.dumps(SCENARIO | {"obstacles": "lab.json"}))
    code, _, err = run_as_is("plan", "mine.json", "--out", "lab.json")
    assert code == 2
    assert "output = " in err
    assert json.loads((tmp_path / "lab.json").read_text()) == SQUARE
