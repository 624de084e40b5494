"""``twosra batch``: whatever happens to it, the table is that of an undisturbed run."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import Run
from pandas.testing import assert_frame_equal
from test_cli_output import examples

from twosra_mpc import InputError, load_plan, plan
from twosra_mpc.analysis.critical_path import critical_path
from twosra_mpc.lab.batch import folder, read_runs, workers
from twosra_mpc.lab.batch.chunk import Asked, Chunk, failed, plan_chunk
from twosra_mpc.lab.batch.problems import Posed, Problems
from twosra_mpc.lab.batch.spec import Spec, load_spec
from twosra_mpc.lab.batch.table import GREEDY_COLUMNS, RESULT_COLUMNS
from twosra_mpc.lab.batch.workers import planned
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import mode_name

# In [60, 60] the units overlap; where only both segments are soft, both bend alike.
CORNERS = """scenario = "shape-change"
[fixed]
"modes" = [[0, 0], [1, 1]]
[grid]
"goal.kappa_per_m.0" = [20.0, 60.0]
"goal.kappa_per_m.1" = [20.0, 60.0]
"""
DRAWN = """[random]
robot = "2sra-v1"
seed = 2
count = 16
position_m = 0.25
heading_rad = 3.14
curvature_per_m = 60.0
"""
COUNT = 16
TIMES = ["wall_s", "cpu_s", "greedy_wall_s", "greedy_cpu_s"]


def planned_here(posed: Iterator[Posed], asked: Asked, _workers: int | None) -> Iterator[Chunk]:
    """Plan in this process."""
    yield plan_chunk(list(posed), asked)


@pytest.fixture
def drawn(tmp_path: Path) -> Path:
    (tmp_path / "drawn.toml").write_text(DRAWN)
    return tmp_path / "drawn.toml"


def assert_same(found: pd.DataFrame, expected: pd.DataFrame) -> None:
    """The same tables but for times."""
    assert len(expected) > 0
    assert found.attrs == expected.attrs
    without = [frame.drop(columns=TIMES, errors="ignore") for frame in (found, expected)]
    assert_frame_equal(*without)


@pytest.fixture(scope="module")
def undisturbed() -> pd.DataFrame:
    """The table of the random problems, made in this process alone."""
    problems = Problems(Spec(random=_random()), Path())
    every = list(problems.posed(np.zeros(COUNT, dtype=bool)))
    rows = plan_chunk(every, Asked("optimal", False)).rows
    return folder.frame_of(rows, problems.kinds, greedy=False)


def _random() -> dict[str, object]:
    lines = [line.split(" = ") for line in DRAWN.splitlines()[1:]]
    return {key: json.loads(value) for key, value in lines}


def test_a_row_says_what_the_plan_is(undisturbed: pd.DataFrame) -> None:
    (posed, *_) = Problems(Spec(random=_random()), Path()).posed(np.zeros(COUNT, dtype=bool))
    made = plan(Problem(**posed.document)).require()
    row = undisturbed.iloc[0]
    kinds = [activity.kind for activity in critical_path(made)]
    assert row["status"] == "optimal"
    assert row["sequence"] == " ".join(map(mode_name, made.sequence))
    assert row["cost"] == made.cost.total
    assert row["lower_bound"] == made.lower_bound
    assert row["gap"] == made.gap
    assert row["duration_s"] == pytest.approx(row["waiting_s"] + row["moving_s"], rel=1e-12)
    assert row["energy_J"] == made.cost.energy_J
    assert (row["critical_melts"], row["critical_freezes"]) == (
        kinds.count("melt"),
        kinds.count("freeze"),
    )
    assert bool(row["verified"])
    assert list(undisturbed.columns) == ["problem", *posed.varied, *RESULT_COLUMNS]


@pytest.mark.parametrize(
    ("what", "lasts_s", "changing_s"), [("melt", 63, 37), ("freeze", 253, 235)]
)
def test_a_second_less_of_each_saves_what_the_table_says(
    what: str, lasts_s: float, changing_s: float
) -> None:
    """To first order: constant times, the part in which nothing may move a second shorter."""
    spec = Spec(
        scenario="paper-1",
        fixed={"timing": "constant", "motion": "fastest"},
        grid={
            f"robot.timing.constant.{what}_s": [lasts_s, lasts_s - 1.0],
            f"robot.timing.constant.{what}_changing_s": [changing_s, changing_s - 1.0],
        },
    )
    problems = Problems(spec, Path())
    every = list(problems.posed(np.zeros(4, dtype=bool)))
    before, after = plan_chunk([every[0], every[3]], Asked("optimal", False)).rows
    assert before[f"critical_{what}s"] > 0
    saved = before["cost"] - after["cost"]
    assert saved == pytest.approx(before[f"critical_{what}s"], abs=0.05)


def test_the_program_writes_a_table_and_plans(run: Run, tmp_path: Path) -> None:
    (tmp_path / "corners.toml").write_text(CORNERS)
    asked = ("batch", "corners.toml", "--out", "runs", "--planner", "both", "--plans")
    code, out, err = run(*asked, "--workers", 1)
    assert (code, err) == (0, "")
    assert "problems 4" in out
    frame = read_runs(tmp_path / "runs")
    assert_frame_equal(frame, read_runs(tmp_path / "runs" / "runs.parquet"))
    assert frame.attrs["varied"] == ["goal.kappa_per_m.0", "goal.kappa_per_m.1"]
    assert list(frame.columns) == [
        *("problem", *frame.attrs["varied"]),
        *(*RESULT_COLUMNS, *GREEDY_COLUMNS),
    ]
    assert frame["status"].tolist() == ["optimal", "infeasible", "infeasible", "refused"]
    assert "goal.kappa_per_m" in frame["message"][3]
    assert frame["sequence"].tolist()[1:] == ["", "", ""]
    assert frame["greedy_status"].tolist()[::3] == ["feasible", "refused"]
    assert frame["verified"].tolist() == [True, False, False, False]
    assert frame["cost"].isna().tolist() == [False, True, True, True]
    plans = sorted(path.name for path in (tmp_path / "runs" / "plans").iterdir())
    assert plans[:2] == ["00000000-greedy.json", "00000000.json"]
    assert len(plans) == 6  # none of what was refused
    made = load_plan(tmp_path / "runs" / "plans" / "00000000.json").require()
    assert made.cost.total == frame["cost"][0]
    # Once more: nothing is left to do.
    code, out, _ = run(*asked, "--json")
    assert code == 0
    assert json.loads(out)["planned now"] == 0
    # Another spec, in the same folder.
    (tmp_path / "corners.toml").write_text(CORNERS.replace("20.0, 60.0", "20.0, 70.0", 1))
    code, _, err = run(*asked)
    assert code == 2
    assert "grid.goal.kappa_per_m.0 = [20.0, 70.0]" in err
    assert "allowed: [20.0, 60.0]" in err
    code, _, err = run(*asked[:4], "--planner", "greedy")
    assert code == 2
    assert "planner = 'greedy'" in err
    assert "plans = False" in err
    assert_frame_equal(frame, read_runs(tmp_path / "runs"))


# The program, which gets a signal once it has written what the first problems came to.
ENDED = """
import os, signal, sys
from twosra_mpc import __main__
from twosra_mpc.lab.batch.folder import Folder
def added(self, chunk):
    add(self, chunk)
    if sys.argv[0] == "SIGINT":
        os.killpg(0, signal.SIGINT)  # a terminal sends it to the workers, too
    else:
        os.kill(os.getpid(), signal.SIGKILL)
add, Folder.add = Folder.add, added
sys.argv[:2] = sys.argv[1:2]
__main__.main()
"""


def test_a_batch_goes_on_whatever_ended_it(
    drawn: Path,
    run: Run,
    undisturbed: pd.DataFrame,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the signals that the program catches, one: they are one to it (see test_cli)."""
    runs = drawn.parent / "runs"
    words = ["batch", str(drawn), "--out", str(runs), "--workers", "1"]
    (scratch := drawn.parent / "scratch").mkdir()
    for number in (signal.SIGINT, signal.SIGKILL):
        ended = subprocess.run(
            [sys.executable, "-c", ENDED, number.name, *words],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=os.environ | {"TMPDIR": str(scratch)},
        )
        done = read_runs(runs)
        if number == signal.SIGKILL:
            assert ended.returncode == -signal.SIGKILL
        else:
            said = f"twosra: interrupted: {len(done)} of {COUNT} problems are planned; the same"
            assert (ended.returncode, len(ended.stderr.splitlines())) == (130, 1), ended.stderr
            assert ended.stderr.startswith(said)
            assert not list(scratch.iterdir())
    assert 4 <= len(done) < COUNT
    monkeypatch.setattr(workers, "planned", planned_here)
    code, out, _ = run(*words, "--json")
    assert code == 0
    assert json.loads(out)["planned now"] == COUNT - len(done)
    found = read_runs(runs)
    assert_same(found, undisturbed)
    kept = found[found["problem"].isin(done["problem"])]
    assert kept["wall_s"].tolist() == done["wall_s"].tolist()  # not planned again
    assert sorted(path.name for path in runs.iterdir()) == [
        *("batch.json", "runs.parquet", "spec.toml")
    ]


def test_the_examples_run(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "random.toml").write_text('scenario = "rigid-move"\n')
    monkeypatch.setattr(workers, "planned", planned_here)
    for example in examples("batch"):
        code, out, err = run(*shlex.split(example)[1:])
        assert (code, err) == (0, "")
        assert "problems 1" in out


def deadly(posed: list[Posed], asked: Asked) -> Chunk:
    """Plan nothing, and die of one problem, as a solver that crashes would."""
    assert os.environ["OMP_NUM_THREADS"] == os.environ["OPENBLAS_NUM_THREADS"] == "1"
    if any(one.number == 2 for one in posed):
        os._exit(1)
    time.sleep(0.1)  # so that chunks stay small
    chunks = [failed(one, asked, "well") for one in posed]
    return Chunk([row for each in chunks for row in each.rows], {}, 1.0)


def test_only_a_problem_that_ends_processes_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = Spec(scenario="rigid-move", grid={"time_limit_s": [101.0 + k for k in range(12)]})
    problems = Problems(spec, Path()).posed(np.zeros(12, dtype=bool))
    monkeypatch.setattr(workers, "plan_chunk", deadly)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    asked = Asked("optimal", False)
    rows = [row for found in planned(problems, asked, 2) for row in found.rows]
    assert sorted(row["problem"] for row in rows) == list(range(12))
    told = {row["problem"]: row["message"] for row in rows}
    assert told.pop(2) == "every process that planned it died"
    assert set(told.values()) == {"well"}
    assert not active_children()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"
    assert "OMP_NUM_THREADS" not in os.environ


def test_other_folders_are_left_alone(run: Run, drawn: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    code, _, err = run("batch", drawn, "--out", "mine")
    assert code == 2
    assert "--out = 'mine' is not acceptable; allowed: a new folder" in err
    code, _, err = run("batch", drawn, "--out", drawn)
    assert code == 2
    assert "a folder to write to" in err
    assert load_spec(drawn).size == COUNT


@pytest.mark.parametrize("what", ["empty", "text", "other"])
def test_tables_of_others_are_refused(what: str, tmp_path: Path) -> None:
    path = tmp_path
    if what == "text":
        (path := tmp_path / "a.parquet").write_text("no table")
    elif what == "other":
        pd.DataFrame({"problem": [1]}).to_parquet(path := tmp_path / "b.parquet")
    with pytest.raises(InputError, match="runs = "):
        read_runs(path)
