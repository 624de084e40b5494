"""How much work a first plan among obstacles and objects is, counted; and what is made at once."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
import shapely
from worlds import ARC_ROBOT, STRAIGHT

from twosra_mpc import Goal, Obstacle, Tolerance, World, load_problem, plan
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.planning.solver.placer import Placer
from twosra_mpc.planning.stages.variants import Placement, goals_of
from twosra_mpc.problem.tasks import Stage
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import RIGID, SOFT_BOTH
from twosra_mpc.space import drives, slices
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import footprint
from twosra_mpc.space.slices import certified_slices, component_around, possible_slices


class FirstPlanError(Exception):
    """There is a first plan: no more is asked."""


def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count what plans are made of, and stop at the first one."""
    work: Counter[str] = Counter()
    sums, legs, made, bound = slices.minkowski_sums, drives.clear_legs, Placer._made, Tree.bound

    def count_sums(first: Array, second: Array) -> Array:
        here = math.prod(first.shape[:-2]) * len(second)
        work["sums"] += here
        work["sums at once"] = max(work["sums at once"], here)
        return sums(first, second)

    def count_legs(clear: Any, start: Array, *given: Any) -> Any:
        work["legs"] += len(start)
        return legs(clear, start, *given)

    def count_bounds(*given: Any) -> float:
        work["bounds"] += 1
        return bound(*given)

    def count_plans(*given: Any) -> Any:
        work["plans"] += 1
        if (found := made(*given)) is not None:
            raise FirstPlanError
        return found

    monkeypatch.setattr(slices, "minkowski_sums", count_sums)
    monkeypatch.setattr(drives, "clear_legs", count_legs)
    monkeypatch.setattr(Tree, "bound", count_bounds)
    monkeypatch.setattr(Placer, "_made", count_plans)
    return work


# A sum costs about 0.02 ms, a leg 0.1 ms, a bound 0.2 ms, a plan 100 ms.
@pytest.mark.parametrize(
    ("name", "sums", "legs"),
    [
        ("scattered", 6_000, 350),
        ("doorway", 6_500, 560),
        ("corridor", 8_000, 500),
        ("conform-cylinder", 0, 60),
        ("grasp-cube", 1_200, 120),
        ("pick-and-place", 0, 400),
        ("tidy-up", 0, 500),
    ],
)
def test_a_first_plan_is_little_work(
    name: str, sums: int, legs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = counted(monkeypatch)
    with pytest.raises(FirstPlanError):
        plan(load_problem(name))
    most = {"sums": sums, "legs": legs, "bounds": 800, "plans": 1}
    assert all(work[key] <= count for key, count in most.items()), work


def crowded(seed: int, count: int) -> World:
    """A world of small rough things."""
    rng, found = np.random.default_rng(seed), []
    for middle in rng.uniform(-1.0, 1.0, (count, 2)):
        angles = np.arange(9) * 2 * np.pi / 9
        radius = rng.uniform(0.01, 0.03, (9, 1))
        corners = middle + radius * np.column_stack([np.cos(angles), np.sin(angles)])
        found.append(Obstacle(polygon_m=tuple(map(tuple, corners.tolist()))))
    return World(obstacles=tuple(found))


@pytest.mark.parametrize("count", [5, 60])
def test_sums_at_once_do_not_grow_with_what_is_around(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, world = counted(monkeypatch), crowded(count, count)
    pieces = footprint(ARC_ROBOT.geometry, STRAIGHT)
    for make in (certified_slices, possible_slices):
        make(pieces, world, 0.0, 8)
    assert work["sums at once"] <= slices._SUMS


@pytest.mark.parametrize("open_rad", [0.3, 0.6, 0.75, 1.2, 1.6])
def test_what_gets_out_of_a_ring_is_what_fits_through_its_gap(open_rad: float) -> None:
    half_m, inner_m = 0.012, 0.03
    thing = half_m * np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    angles = np.linspace(open_rad, 2 * np.pi, 9)
    ends = np.column_stack([np.cos(angles), np.sin(angles)])
    around = [
        part
        for a, b in itertools.pairwise(ends)
        for part in convex_parts(np.array([inner_m * a, 0.04 * a, 0.04 * b, inner_m * b]))
    ]
    found = component_around([thing], around, 72, np.zeros(2))
    assert found is not None
    parts, at_edge = found
    gap_m = 2 * inner_m * np.sin(open_rad / 2)
    if gap_m < 2 * half_m * 0.99:
        assert not at_edge
        assert np.abs(shapely.get_coordinates(parts)).max() < inner_m
    if gap_m > 2 * half_m * 1.1:
        assert at_edge


@pytest.mark.parametrize(("corners", "alike"), [(3, 24), (4, 18), (5, 72), (6, 12)])
def test_what_looks_the_same_when_it_is_turned_is_turned_no_further(
    corners: int, alike: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    angles = 0.1 + 2 * np.pi * np.arange(corners) / corners
    thing = 0.01 * np.column_stack([np.cos(angles), np.sin(angles)])
    beside = [
        0.02 * np.array([[c, s]]) + np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.007
        for c, s in ((1, 0.1), (0, 1), (-1, 0), (0.2, -1))
    ]
    assert slices._alike_after([thing], 72) == alike
    found = [component_around([thing], beside, 72, np.zeros(2))]
    monkeypatch.setattr(slices, "_alike_after", lambda _, headings: headings)
    found.append(component_around([thing], beside, 72, np.zeros(2)))
    (parts, at_edge), (whole, whole_at_edge) = (each for each in found if each is not None)
    assert len(parts) == len(whole)
    assert at_edge == whole_at_edge
    assert shapely.area(parts) == pytest.approx(shapely.area(whole), abs=1e-10)


def test_what_is_opened_before_a_grasp_is_open_for_it() -> None:
    opened = Goal(kappa_per_m=(-10.0, -10.0), tolerance=Tolerance(kappa_per_m=(40.0, 40.0)))
    entry = Goal(kappa_per_m=(10.0, 10.0), tolerance=Tolerance(kappa_per_m=(31.0, 31.0)))
    grasp = Goal(kappa_per_m=(-30.0, -30.0))
    modes, world = (RIGID, SOFT_BOTH), World()
    release = Placement(Stage(modes), opened, world, openings=(opened,))
    closed = Placement(Stage(modes, RIGID), grasp, world, reshapes=True, entries=(entry,))
    for first, last in goals_of([release, closed]):
        low, high = first.box(np.zeros(5))
        assert low[3:] == pytest.approx([-21.0, -21.0])
        assert high[3:] == pytest.approx([30.0, 30.0])
        assert last is grasp
