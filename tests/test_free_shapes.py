"""Goals whose every shape is forbidden are refused, whatever the limits that forbid them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from twosra_mpc import Goal, InputError, Problem, Start, load_problem, plan
from twosra_mpc.model.self_collision import self_collision
from twosra_mpc.problem.ends import look_for_shape
from twosra_mpc.problem.goals import Tolerance
from twosra_mpc.problem.limits import broken_by_shapes, shape_margins
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot

PAPER = load_problem("paper-1")
ROBOT, THREE = PAPER.robot, load_problem("three-segments").robot
POINTS = 9  # of a grid, along each coordinate


def boxes(seed: int, count: int, segments: int = 2) -> list[tuple[Array, Array]]:
    """Middles and half-widths of boxes of curled shapes, of which many are forbidden."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        curled = rng.choice([-1.0, 1.0]) * rng.uniform(25.0, 75.0, segments)
        middle = curled if rng.random() < 0.8 else rng.uniform(-75.0, 75.0, segments)
        found.append((middle, rng.choice([0.0, 0.1, 0.7, 4.0, 15.0], segments)))
    return found


def some_free(robot: Robot, middle: Array, half: Array) -> bool:
    """Whether a grid of a box has a shape that is allowed, shape by shape and limit by limit."""
    ends = (
        np.linspace(m - h, m + h, POINTS if h else 1) for m, h in zip(middle, half, strict=True)
    )
    most = robot.limits.curvature_per_m
    grid = np.clip(np.array([*itertools.product(*ends)]), -most, most)
    margins = shape_margins(robot, grid)
    kept = [margins[name] >= 0 for name in ("curvature_per_m", "unit_gap_m", "body_gap_m")]
    return bool(np.all(kept, axis=0).any())


@pytest.mark.parametrize(("robot", "seed", "count"), [(ROBOT, 0, 400), (THREE, 1, 60)])
def test_a_box_is_forbidden_or_has_a_shape_that_is_allowed(
    robot: Robot, seed: int, count: int
) -> None:
    both, most = set(), robot.limits.curvature_per_m
    for middle, half in boxes(seed, count, robot.coordinates.segments):
        looked = look_for_shape(robot, middle - half, middle + half)
        both.add(looked.allowed)
        assert looked.allowed != looked.forbidden
        assert looked.allowed or not some_free(robot, middle, half)
        if looked.allowed:
            assert broken_by_shapes(robot, looked.shape) is None
            low, high = np.clip([middle - half, middle + half], -most, most)
            assert (looked.shape >= low - 1e-9).all()
            assert (looked.shape <= high + 1e-9).all()
    assert both == {False, True}


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((-np.inf, 77.8), (np.inf, 78.5)),
        ((-77.5706, -np.inf), (-77.5706, np.inf)),
        ((-np.inf, 77.8008), (np.inf, 78.0008)),
    ],
)
def test_what_a_free_curvature_does_not_change_is_forbidden_whatever_it_is(
    low: tuple[float, float], high: tuple[float, float]
) -> None:
    """Unit 2, folded back, meets the middle link by a hundredth of a millimetre or a few.

    That depends on the other segment by nothing, or next to nothing. It used to stay open, and a
    plan was looked for in vain.
    """
    assert look_for_shape(ROBOT, low, high).forbidden


@pytest.mark.parametrize("robot", [ROBOT, THREE])
def test_overlaps_ease_no_faster_than_is_proved(robot: Robot) -> None:
    rng, most = np.random.default_rng(3), robot.limits.curvature_per_m
    own, shape = self_collision(robot.body), (500, robot.coordinates.segments)
    here, bent = rng.uniform(-most, most, shape), rng.uniform(-5.0, 5.0, shape)
    there = np.clip(here + bent * rng.integers(0, 2, shape), -most, most)
    before, after = own.separations(here), np.minimum(own.separations(there), 0.0)
    overlap, most_m = before < 0, np.abs(there - here) @ own.eased_m2.T
    eased = (after - before)[overlap] / (most_m[overlap] + 1e-12)
    assert 0.3 < eased.max() <= 1.0


def test_free_curvatures_are_looked_through() -> None:
    """Segment 2 may be anything: only where that leaves nothing is a goal refused."""
    low, high = np.array([60.0, -np.inf]), np.array([60.0, np.inf])
    looked = look_for_shape(ROBOT, low, high)
    assert looked.allowed
    assert looked.shape[0] == 60.0


@pytest.mark.parametrize("kappa", [(-57.1983, -32.7069), (-50.656, -39.787), (-60.0, -30.0)])
def test_the_limit_that_lacks_most_is_named_whichever_comes_first(
    kappa: tuple[float, float],
) -> None:
    """Units meet by a millimetre in the middle of these goals, and wheels by ten all over them."""
    with pytest.raises(InputError, match=r"goal.kappa_per_m.*wheel 4 by 1\d\.\d mm"):
        plan(PAPER.with_values(goal=PAPER.goal.with_values(kappa_per_m=kappa)))


@pytest.mark.parametrize("seed", range(3))
def test_goals_fail_only_where_some_shape_of_theirs_is_allowed(seed: int) -> None:
    """Refused exactly where a grid has nothing; never left unfound where it has nothing."""
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    for middle, half in boxes(seed + 10, 6):
        tolerance = Tolerance(kappa_per_m=tuple(half.tolist()))
        goal = Goal(kappa_per_m=tuple(middle.tolist()), tolerance=tolerance)
        asked = Problem(robot=ROBOT, start=start, goal=goal, gap=0.05, time_limit_s=60.0)
        free = some_free(ROBOT, middle, half)
        try:
            found = plan(asked)
        except InputError:
            assert not free, (middle, half)
        else:
            assert found.status.value != "failed", (middle, half, found.message)


def test_a_leaf_whose_end_is_forbidden_is_no_plan() -> None:
    """Only a corner of this goal is free: what ends elsewhere is ruled out, and the best is found.

    The robot used to be sent another way, half as long again, with nothing better proved.
    """
    second = np.linspace(-60.0, -50.0, 1001)  # the first free one, and half a 1/m beyond it
    free = [broken_by_shapes(PAPER.robot, (-30.0, k)) is None for k in second.tolist()]
    goal = PAPER.goal.with_values(kappa_per_m=(-30.0, float(second[free.index(True)]) - 0.5))
    found = plan(PAPER.with_values(goal=goal, motion="fastest"))
    assert found.gap is not None
    assert found.gap < 0.02
