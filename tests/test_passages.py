"""Which shapes pass: what is certified was sampled free, mirrored scenes have mirrored answers."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from conftest import Run

from twosra_mpc import InputError, load_problem
from twosra_mpc.lab.figures.passage_figure import plot_passages
from twosra_mpc.lab.worlds.passages import VERDICTS, find_passages
from twosra_mpc.problem.problem import Problem

STEP = 35.0


def walls(gap_m: float) -> list[dict[str, object]]:
    """A wall of 0.12 m with a door in its middle."""
    high = {"x_m": (-0.06, 0.06), "y_m": (gap_m / 2, 0.35)}
    low = {"x_m": (-0.06, 0.06), "y_m": (-0.35, -gap_m / 2)}
    return [{"box": high}, {"box": low}]


def doorway(gap_m: float) -> Problem:
    return load_problem("doorway", obstacles=walls(gap_m))


def test_what_passes_and_what_does_not() -> None:
    told: list[tuple[int, int]] = []
    found = find_passages(load_problem("doorway"), STEP, progress=lambda *at: told.append(at))
    assert told == [(done, 27) for done in range(1, 28)]
    np.testing.assert_allclose(found.kappa_per_m, [-70, -35, 0, 35, 70])
    assert (found.start, found.goal) == ("blocked", "certified")
    assert found.verdicts[2, 2] == "certified"
    assert found.verdicts[3, 3] == "blocked"
    assert sum(map(found.count, VERDICTS)) == 25
    assert found.nearest_per_m in {(35.0, 0.0), (0.0, 35.0)}


def test_a_wide_door_lets_all_pass_and_a_narrow_one_none() -> None:
    wide, narrow = (find_passages(doorway(gap), 60.0) for gap in (0.5, 0.03))
    assert set(wide.verdicts.ravel()) <= {"certified", "not allowed"}
    assert set(narrow.verdicts.ravel()) <= {"blocked", "not allowed"}
    assert wide.count("not allowed") == narrow.count("not allowed")
    assert narrow.nearest_per_m is None


def test_a_turned_robot_passes_alike() -> None:
    """Half a turn of the robot swaps its segments, bent the other way; the door is symmetric."""
    found = find_passages(doorway(0.085), 45.0).verdicts
    swapped = found.T
    decided = np.isin(found, VERDICTS[:2]) & np.isin(swapped, VERDICTS[:2])
    assert decided.sum() > 4
    assert (found == swapped)[decided].all()


def test_given_headings_pass_no_more_than_free_ones() -> None:
    problem = load_problem("corridor")
    free, given = (find_passages(problem, 60.0, each) for each in ("free", "given"))
    assert not ((given.verdicts == "certified") & (free.verdicts == "blocked")).any()
    assert given.count("certified") <= free.count("certified") + free.count("undecided")


def test_a_goal_that_leaves_its_shape_open_has_no_verdict() -> None:
    problem = doorway(0.5).with_values(goal={"x_m": 0.32, "y_m": 0.1})
    found = find_passages(problem, 60.0)
    assert found.goal is None
    plot_passages(problem, found)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="two segments"):
        find_passages(load_problem("three-segments"))
    for step in (0, 1e-300, math.inf, math.nan):
        with pytest.raises(InputError, match=r"step_per_m = .* at least"):
            find_passages(load_problem("doorway"), step)


def test_the_command_tells_and_draws(run_as_is: Run, tmp_path: Path) -> None:
    drawn = tmp_path / "shapes.png"
    code, out, err = run_as_is("check-passage", "doorway", "--step", "60", "--plot", drawn)
    assert (code, err) == (0, "")
    assert drawn.stat().st_size > 0
    assert "certified, nearest to the start's" in out
    found = json.loads(run_as_is("check-passage", "blocked", "--step", "70", "--json").out)
    assert np.shape(found["verdicts"]) == (3, 3)
    assert found["nearest_per_m"] is None
