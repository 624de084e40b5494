"""Logs of trials against simulations: the published recipe, and where the time goes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import similaritymeasures  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from twosra_mpc.errors import InputError
from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.reproduction import hardware
from twosra_mpc.lab.reproduction.hardware import dtw_table, read_trials, trial_of, waiting
from twosra_mpc.lab.reproduction.published_runs import SIMULATIONS, PublishedTrajectory
from twosra_mpc.robot.description import load_robot

Array = NDArray[np.float64]
HEADER = "x,y,angle,k1,k2,v1,v2,u0,v0,r0,s1,s2,time"
# Phases of the published trials by their logs (2sr-agent-control, exp1 to exp5): mode, first and
# last second, rows; then totals and shares as computed from them.
TRIALS = {
    1: (
        [("11", 0, 7, 99), ("01", 509, 511, 42), ("10", 1013, 1015, 23), ("00", 1315, 1323, 121)],
        *(1423, 0.987),
    ),
    2: ([("10", 0, 38, 558), ("00", 338, 345, 106)], 447, 0.899),
    3: ([("11", 0, 23, 339), ("00", 323, 325, 31)], 425, 0.941),
    4: ([("01", 0, 11, 111), ("00", 311, 313, 18)], 415, 0.969),
    5: ([("01", 0, 14, 219), ("00", 315, 317, 34)], 419, 0.962),
}
each_trial = pytest.mark.parametrize("trial", TRIALS)


def log_of(trial: int) -> MotionLog:
    """A log with the phases of a trial, on the straight line from its start to its target."""
    phases = TRIALS[trial][0]
    time_s = np.concatenate([np.linspace(begin, end, rows) for _, begin, end, rows in phases])
    mode = np.concatenate([np.tile([int(bit) for bit in m], (n, 1)) for m, *_, n in phases])
    simulation, part = SIMULATIONS[trial], np.linspace(0.0, 1.0, len(time_s))[:, None]
    q = (1.0 - part) * simulation.start + part * simulation.goal
    return made("trial", q, time_s, mode)


def made(
    name: str, q: Array, time_s: Array | None = None, mode: NDArray[np.int_] | None = None
) -> MotionLog:
    rows = len(q)
    times = np.arange(rows) / 15.0 if time_s is None else time_s
    modes = np.zeros((rows, 2), dtype=np.int_) if mode is None else mode
    return MotionLog(name, times, q, modes, np.zeros((rows, 5)))


def warped(points: list[tuple[float, ...]], others: list[tuple[float, ...]]) -> float:
    """Least sum of distances over all warping paths, one by one."""

    def onward(i: int, j: int) -> float:
        here = float(np.linalg.norm(np.subtract(points[i], others[j])))
        if (i, j) == (len(points) - 1, len(others) - 1):
            return here
        steps = ((i + 1, j), (i, j + 1), (i + 1, j + 1))
        return here + min(
            onward(*at) for at in steps if at[0] < len(points) and at[1] < len(others)
        )

    return onward(0, 0)


def simulated(q: Array) -> PublishedTrajectory:
    """A trajectory with these rows."""
    run = SIMULATIONS[4].run()
    nothing = np.zeros((len(q), 5))
    modes = np.zeros((len(q), 2), dtype=np.int64)
    rows = np.arange(len(q))
    return PublishedTrajectory(q, modes, nothing, rows, q[-1], run.stop, len(q), ())


# --- simulations ------------------------------------------------------------------------------


@each_trial
def test_simulations_reach_the_targets_of_their_trials(trial: int) -> None:
    simulation = SIMULATIONS[trial]
    run = simulation.run()
    assert simulation.run() is run  # kept
    np.testing.assert_allclose(run.final_q, simulation.goal, rtol=0.0, atol=1e-9)
    assert len(run.q) == {1: 140, 2: 115, 3: 144, 4: 111, 5: 62}[trial]


@each_trial
def test_a_log_is_of_the_trial_whose_simulation_starts_there(trial: int) -> None:
    q = np.tile(SIMULATIONS[trial].start, (20, 1))
    assert trial_of(made("placed", q + np.array([0.01, -0.01, 0.1, 1.0, -2.0]))) == trial
    assert trial_of(made("elsewhere", q + np.array([0.0, 0.5, 0.0, 0.0, 0.0]))) is None


# --- time warping -----------------------------------------------------------------------------


def test_the_published_recipe_step_by_step() -> None:
    rng = np.random.default_rng(3)
    q, end = rng.normal(size=(19, 5)), rng.normal(size=(3, 5))
    row = dtw_table(made("noise", q), simulated(end))
    for column in range(5):
        means = [float(np.mean(q[i : i + 15, column])) for i in range(5)]
        padded = [*end[:, column], end[-1, column], end[-1, column]]
        mine, theirs = (
            list(enumerate((np.array(v) - np.mean(v)) / np.std(v, ddof=1))) for v in (means, padded)
        )
        assert row.published[column] == pytest.approx(warped(mine, theirs))


@pytest.mark.parametrize(("rows", "others"), [(1, 1), (1, 4), (5, 1), (7, 3), (30, 41)])
def test_sums_along_paths_are_those_of_the_published_library(rows: int, others: int) -> None:
    rng = np.random.default_rng(rows)
    one, other = rng.normal(size=(rows, 2)), rng.normal(size=(others, 2))
    found = hardware._cumulative(cdist(one, other))
    np.testing.assert_array_equal(found, similaritymeasures.dtw(one, other)[1])


def test_values_alone_are_compared_along_the_path_of_least_deviation() -> None:
    """Steps 0 1 2 against 0 2 with each value kept for long: only the step at 1 has no partner."""
    kept = 40
    values = np.repeat([0.0, 0.001, 0.002], kept)
    ends = np.repeat([0.0, 0.002], kept)
    log = made("steps", np.tile(values[:, None], (1, 5)))
    row = dtw_table(log, simulated(np.tile(ends[:, None], (1, 5))))
    assert row.largest == pytest.approx((0.001,) * 5, abs=1e-12)
    assert all(0.0 < mean < 0.0005 for mean in row.mean)


def test_a_log_that_is_its_simulation_deviates_by_nothing() -> None:
    q = np.repeat(np.random.default_rng(4).normal(size=(4, 5)), 30, axis=0)
    averaged = np.lib.stride_tricks.sliding_window_view(q, 15, axis=0).mean(axis=-1)
    row = dtw_table(made("itself", q), simulated(averaged))
    assert row.published == pytest.approx((0.0,) * 5, abs=1e-9)
    assert row.mean == row.largest == pytest.approx((0.0,) * 5, abs=1e-12)


def test_a_coordinate_that_stays_put_is_compared_as_zero() -> None:
    """As in trial 4, whose first segment is rigid in the simulation: it has no deviation."""
    q = np.ones((40, 5))
    row = dtw_table(made("still", q), simulated(28.0 * np.ones((20, 5))))
    assert row.published == (0.0,) * 5
    assert row.mean == row.largest == pytest.approx((27.0,) * 5)


def test_distances_are_refused_where_they_cannot_be_had(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="more than 15") as short:
        dtw_table(made("short", np.zeros((15, 5))), simulated(np.zeros((3, 5))))
    assert short.value.field == "rows"
    monkeypatch.setitem(sys.modules, "similaritymeasures", None)
    with pytest.raises(InputError, match=r"similaritymeasures is missing: .*paper"):
        dtw_table(made("long", np.zeros((30, 5))), simulated(np.zeros((3, 5))))


# --- waiting ----------------------------------------------------------------------------------


@each_trial
def test_where_the_time_of_the_trials_went(trial: int) -> None:
    phases, total_s, waiting_share = TRIALS[trial]
    log = log_of(trial)
    found = waiting(log, SIMULATIONS[trial].goal)
    assert found.total_s == pytest.approx(total_s)
    assert found.share_waiting == pytest.approx(waiting_share, abs=0.0006)
    assert found.final_error == pytest.approx((0.0,) * 5, abs=1e-12)
    assert ["".join(map(str, mode)) for mode in found.sequence] == [mode for mode, *_ in phases]
    assert found.first_heating_s == {1: 102.0, 2: 100.0}[sum(found.sequence[0])]
    assert found.motion_s == pytest.approx(sum(end - begin for _, begin, end, _ in phases))
    assert found.waits_s + found.motion_s == pytest.approx(log.time_s[-1])


def test_all_published_trials_waited_for_96_percent_of_their_time() -> None:
    found = [waiting(log_of(trial)) for trial in TRIALS]
    waited = sum(each.first_heating_s + each.waits_s for each in found)
    assert waited == pytest.approx(3011.0)
    assert sum(each.total_s for each in found) == pytest.approx(3129.0)
    assert found[0].final_error == ()


def test_goals_and_robots_that_do_not_fit_are_refused() -> None:
    log = log_of(4)
    with pytest.raises(InputError, match="five numbers"):
        waiting(log, (0.1, 0.2))
    of_three = MotionLog("three", log.time_s, np.zeros((129, 6)), log.mode, log.commands)
    for refused in (waiting, trial_of):
        with pytest.raises(InputError, match="two segments"):
            refused(of_three)


# --- folders ----------------------------------------------------------------------------------


def test_trials_are_read_by_name_and_once(tmp_path: Path) -> None:
    rows = [f"0.1,0.2,0,{i},0,0,0,0,0,0,1,0,{i}" for i in range(4)]
    for name, last in (("b", "0.1,0.2,0,9,0,0,0,0,0,0,1,0,4"), ("a", rows[-1]), ("c", rows[-1])):
        (tmp_path / f"{name}.csv").write_text("\n".join([HEADER, *rows[:-1], last]))
    (tmp_path / "notes.txt").write_text("not a log")
    logs = list(read_trials(tmp_path, load_robot("2sra-v1")))
    assert [Path(log.source).stem for log in logs] == ["a", "b"]
    assert logs[0].q[:, 3].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_folders_and_logs_that_are_none_are_refused(tmp_path: Path) -> None:
    robot = load_robot("2sra-v1")
    with pytest.raises(InputError, match="logs of trials") as empty:
        list(read_trials(tmp_path, robot))
    assert empty.value.field == "folder"
    rows = ["0,0,0,0,0,0,0,0,0,0,1,0,5", *["0,0,0,0,0,0,0,0,0,0,1,0,4"] * 3]
    (tmp_path / "back.csv").write_text("\n".join([HEADER, *rows]))
    with pytest.raises(InputError, match="time, row 2"):
        list(read_trials(tmp_path, robot))
    (tmp_path / "back.csv").rename(tmp_path / "s1_v1_6.csv")
    units = "time stamp,LU1 x,LU1 y,LU1 th,LU2 x,LU2 y,LU2 th"
    frames = [f"{i},1,1,1,100,{i},1" for i in range(12)]
    (tmp_path / "s1_v1_6.csv").write_text("\n".join([units, *frames]))
    with pytest.raises(InputError, match="inputs and two segments"):
        list(read_trials(tmp_path, robot))
