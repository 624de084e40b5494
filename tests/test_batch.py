"""``twosra batch``: whatever happens to it, the table is that of an undisturbed run."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cloudpickle
import numpy as np
import pandas as pd
import pytest
from conftest import Run
from distributed import Client, LocalCluster, Worker, WorkerPlugin
from pandas.testing import assert_frame_equal
from test_cli_output import examples

from twosra_mpc import InputError, load_plan, plan
from twosra_mpc.lab.analysis.critical_path import critical_path
from twosra_mpc.lab.batch import folder, read_runs, workers
from twosra_mpc.lab.batch.folder import Asked, plan_chunk
from twosra_mpc.lab.batch.problems import Problems
from twosra_mpc.lab.batch.spec import Spec, load_spec
from twosra_mpc.lab.batch.table import GREEDY_COLUMNS, RESULT_COLUMNS
from twosra_mpc.lab.batch.workers import cluster_at, local_cluster, planned
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
COUNT = 8
RANDOM = {"robot": "2sra-v1", "seed": 2, "count": COUNT}
RANDOM |= {"position_m": 0.25, "heading_rad": 3.14, "curvature_per_m": 60.0}
DRAWN = "[random]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in RANDOM.items())
TIMES = ["wall_s", "cpu_s", "greedy_wall_s", "greedy_cpu_s"]

cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers do not have the tests


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Two workers on this machine, on which somebody else has the port of the dashboard."""
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # somebody has it indeed
            taken.bind(("", 8787))
            taken.listen()
        with local_cluster(2) as client:
            yield client


def test_workers_and_dashboard_are_reached_from_this_machine_alone(client: Client) -> None:
    about = client.scheduler_info()
    addresses = [about["address"], *about["workers"]]
    assert all(address.startswith("tcp://127.0.0.1:") for address in addresses)
    cluster = client.cluster
    assert cluster is not None
    assert cluster.scheduler.http_server._sockets  # the dashboard's, or what stands in for it
    for listening in cluster.scheduler.http_server._sockets.values():
        assert listening.getsockname()[0] == "127.0.0.1"


@pytest.fixture
def drawn(tmp_path: Path) -> Path:
    (tmp_path / "drawn.toml").write_text(DRAWN)
    return tmp_path / "drawn.toml"


def table(client: Client, spec: Spec) -> pd.DataFrame:
    """What a cluster comes to, without a folder."""
    problems = Problems(spec, Path())
    left = problems.posed(np.zeros(len(problems), dtype=bool))
    asked = Asked(spec.planner, spec.plans)
    rows = [row for found in planned(client, left, asked) for row in found.rows]
    return pd.DataFrame(rows).sort_values("problem", ignore_index=True)


def assert_same(found: pd.DataFrame, expected: pd.DataFrame) -> None:
    """The same tables but for times."""
    assert len(expected) > 0
    assert found.attrs == expected.attrs
    without = [frame.drop(columns=TIMES, errors="ignore") for frame in (found, expected)]
    assert_frame_equal(*without)


@pytest.fixture(scope="module")
def undisturbed() -> pd.DataFrame:
    """The table of the random problems, made in this process without Dask."""
    problems = Problems(Spec(random=RANDOM), Path())
    every = list(problems.posed(np.zeros(COUNT, dtype=bool)))
    rows = plan_chunk(every, Asked("optimal", False)).rows
    return folder.frame_of(rows, problems.kinds, greedy=False)


def test_a_row_says_what_the_plan_is(undisturbed: pd.DataFrame) -> None:
    (posed, *_) = Problems(Spec(random=RANDOM), Path()).posed(np.zeros(COUNT, dtype=bool))
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


def test_the_program_writes_a_table_and_plans(
    client: Client, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "local_cluster", lambda _: contextlib.nullcontext(client))
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
    # Once more: nothing is left to do, by whatever means.
    code, out, _ = run(*asked, "--scheduler", "tcp://127.0.0.1:1", "--json")
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


def test_the_examples_run(
    client: Client, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "random.toml").write_text('scenario = "rigid-move"\n')
    for name in ("local_cluster", "cluster_at"):
        monkeypatch.setattr(workers, name, lambda _: contextlib.nullcontext(client))
    for example in examples("batch"):
        code, out, err = run(*shlex.split(example)[1:])
        assert (code, err) == (0, "")
        assert "problems 1" in out


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
    client: Client,
    drawn: Path,
    run: Run,
    undisturbed: pd.DataFrame,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the signals that the program catches, one: they are one to it (see test_cli)."""
    runs = drawn.parent / "runs"
    words = ["batch", str(drawn), "--out", str(runs)]
    (scratch := drawn.parent / "scratch").mkdir()
    for number, where in (
        (signal.SIGINT, ("--workers", "1")),
        (signal.SIGKILL, ("--scheduler", client.scheduler.address)),
    ):
        ended = subprocess.run(
            [sys.executable, "-c", ENDED, number.name, *words, *where],
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
    monkeypatch.setattr(workers, "local_cluster", lambda _: contextlib.nullcontext(client))
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


def test_a_worker_that_dies_loses_nothing(client: Client, undisturbed: pd.DataFrame) -> None:
    problems = Problems(Spec(random=RANDOM), Path())
    victim = next(iter(client.run(os.getpid).values()))
    rows = []
    for found in planned(
        client, problems.posed(np.zeros(COUNT, dtype=bool)), Asked("optimal", False)
    ):
        if not rows:
            os.kill(victim, signal.SIGKILL)
        rows += found.rows
    assert_same(
        folder.frame_of(rows, problems.kinds, greedy=False).sort_values(
            "problem", ignore_index=True
        ),
        undisturbed,
    )


class _Deadly(WorkerPlugin):
    """Has a worker die of one problem, as a solver that crashes would."""

    name = "deadly"

    def setup(self, worker: Worker) -> None:
        del worker
        self._real = folder.plan

        def deadly(problem: Problem) -> object:
            if problem.time_limit_s == 103.0:
                os._exit(1)
            return self._real(problem)

        folder.plan = deadly

    def teardown(self, worker: Worker) -> None:
        del worker
        folder.plan = self._real


def test_a_problem_that_kills_every_worker_is_a_row(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = Spec(scenario="rigid-move", grid={"time_limit_s": [101.0, 103.0]})
    monkeypatch.setattr(client.cluster.scheduler, "allowed_failures", 0)
    client.register_plugin(_Deadly())
    frame = table(client, spec)
    client.unregister_worker_plugin("deadly")
    client.wait_for_workers(2)
    assert frame["verified"].tolist() == [True, False]
    assert frame["status"][1] == "failed"
    assert "every worker that planned it died" in frame["message"][1]


def test_workers_use_one_core_each(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def settings() -> tuple[str, str]:
        return os.environ["OMP_NUM_THREADS"], os.environ["OPENBLAS_NUM_THREADS"]

    assert set(client.run(settings).values()) == {("1", "1")}
    assert set(client.nthreads().values()) == {1}


def test_a_scheduler_that_does_not_answer_is_an_error(
    run: Run, drawn: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "_ANSWER_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        address = f"tcp://127.0.0.1:{deaf.getsockname()[1]}"
        for given in (address, "nonsense", "x://1:2"):
            code, out, err = run("batch", drawn, "--out", "runs", "--scheduler", given)
            assert (code, out) == (2, "")
            assert f"--scheduler = '{given}'" in err
            assert "answers within 0.3 s" in err


def test_workers_of_another_version_are_refused(client: Client, undisturbed: pd.DataFrame) -> None:
    def pretend(version: str) -> None:
        workers.__version__ = version

    here = workers.__version__
    client.run(pretend, "0.0.7")
    try:
        with (
            pytest.raises(InputError, match=r"version of twosra_mpc = '0.0.7'"),
            cluster_at(client.scheduler.address),
        ):
            pass
    finally:
        client.run(pretend, here)
    with cluster_at(client.scheduler.address) as connected:  # now it is a cluster like any other
        assert len(connected.nthreads()) == 2


def test_a_worker_of_another_version_that_comes_later_is_refused(client: Client) -> None:
    problems = Problems(Spec(scenario="rigid-move"), Path()).posed(np.zeros(1, dtype=bool))
    with pytest.raises(InputError, match="version of a worker"):
        list(planned(client, problems, Asked("optimal", False, version="0.0.7")))


def test_workers_of_several_threads_are_refused() -> None:
    with (
        LocalCluster(
            *("threads", 1, 2), processes=False, dashboard_address=":0", protocol="tcp"
        ) as cluster,
        pytest.raises(InputError, match="--nthreads 1"),
        cluster_at(cluster.scheduler_address),
    ):
        pass


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
