"""The bound on drives that counts what turning takes: below every motion there is, and near."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from problems import ROBOT, at_once
from scipy.optimize import linprog

from twosra_mpc import Goal, Problem, Robot, Start, load_robot, plan
from twosra_mpc.planning.bounds.drive_bound import (
    _FINEST_SLICES,
    _best_slices,
    _Drive,
    _slices,
    least_drive_time,
)
from twosra_mpc.planning.bounds.rigid_motion import PoseChange, least_time, twist_vertices
from twosra_mpc.planning.relaxation import rigid_time
from twosra_mpc.problem.speeds import rigid_rows

ROBOTS = (ROBOT, load_robot("2sra-v1"))
STRAIGHT = rigid_rows(ROBOT, (0.0, 0.0))


def drive(pose: np.ndarray, twist: np.ndarray, seconds: float) -> np.ndarray:
    """Pose after a constant body twist (u, v, r): an arc, in closed form."""
    turn = float(twist[2]) * seconds
    along = np.sinc(turn / 2 / math.pi) * seconds
    c, s = math.cos(pose[2] + turn / 2), math.sin(pose[2] + turn / 2)
    u, v = twist[:2]
    return pose + np.array([(c * u - s * v) * along, (s * u + c * v) * along, turn])


def random_rows(rng: np.random.Generator) -> np.ndarray:
    kappa = rng.uniform(-40, 40, 2) * rng.integers(0, 2)
    return rigid_rows(ROBOTS[rng.integers(2)], kappa)


@pytest.mark.parametrize("seed", range(9))
def test_no_motion_is_faster_than_the_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = random_rows(rng)
    vertices = twist_vertices(rows)
    assert vertices is not None
    pose, duration = np.zeros(3), 0.0
    for _ in range(rng.integers(1, 6)):
        seconds = rng.uniform(0.05, 1.5)
        pose, duration = (
            drive(pose, vertices[rng.integers(len(vertices))], seconds),
            duration + seconds,
        )
    box, turns = rng.uniform(0, 0.1, 3) * rng.integers(0, 2, 3), np.zeros(2)
    shift = pose[:2] + rng.uniform(-1, 1, 2) * box[:2]
    turns += pose[2] + rng.uniform(-1, 1) * box[2] + np.array([-1, 1]) * box[2]
    modulo = bool(rng.integers(2))
    turns += math.tau * rng.integers(-1, 2) * modulo
    if seed % 4 == 3:
        shift[rng.integers(2)] = math.nan
    low, high = (-math.inf, math.inf) if seed % 6 == 5 else turns
    change = PoseChange(shift, box[:2], (low, high), modulo)
    bound = least_drive_time(rows, change, 1.3 * duration)
    assert 0 <= bound <= duration * (1 + 1e-9)


def test_turning_to_drive_faster_and_back_is_bounded_nearly_exactly() -> None:
    """Drives of the straight robot along its fast diagonal, after a turn and before another."""
    vertices = twist_vertices(STRAIGHT)
    assert vertices is not None
    pivots = vertices[vertices[:, 2] > 0.5]
    fast = vertices[np.abs(vertices[:, 2]) < 1e-9]
    rng, shares = np.random.default_rng(1), []
    for _ in range(12):
        turn_s, there, back = rng.uniform(0.3, 1.0), *pivots[rng.integers(2, size=2)]
        ahead = fast[np.argmax(fast @ there)]
        pose, legs = np.zeros(3), [(there, turn_s), (ahead, 1.0), (-back, turn_s)]
        for twist, seconds in legs:
            pose = drive(pose, twist, seconds)
        duration = 2 * turn_s + 1.0
        change = PoseChange(pose[:2], np.zeros(2), (0, 0), False)
        bound = least_drive_time(STRAIGHT, change, 1.1 * duration)
        assert bound <= duration * (1 + 1e-9)
        shares.append(bound / duration)
    assert max(shares) > 0.98, shares


@pytest.mark.parametrize("seed", range(4))
def test_the_slices_hold_every_twist_between_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed_rows = random_rows(rng) if seed else STRAIGHT
    vertices = twist_vertices(speed_rows)
    assert vertices is not None
    for count in (1, 3):
        slices, _ = _slices(speed_rows, vertices, count)
        rate = vertices[:, 2].max() / count
        for shares in (*np.eye(len(vertices)), *rng.dirichlet(np.ones(len(vertices)), 10)):
            twist = shares @ vertices
            j = min(math.floor(twist[2] / rate + 1e-9), count - 1)
            ends = [
                np.column_stack([slices[count + i], np.full(len(slices[count + i]), i * rate)])
                for i in (j, j + 1)
            ]
            corners = np.vstack(ends)
            rows = np.vstack([corners.T, np.ones(len(corners))])
            assert linprog(np.zeros(len(corners)), A_eq=rows, b_eq=[*twist, 1.0]).status == 0


def test_of_all_slices_those_are_taken_that_lose_least() -> None:
    """What they lose is by how much they are larger than what they hold, and a grid's steps."""
    rows, width = rigid_rows(ROBOTS[0], (30.0, -15.0)), 0.01
    vertices = twist_vertices(rows)
    assert vertices is not None
    losses = dict[int, float]()
    for m in range(1, _FINEST_SLICES + 1):
        slices, over = _slices(rows, vertices, m)
        rates = vertices[:, 2].max() / m * np.arange(-m, m + 1)
        twists = [np.insert(uv, 2, r, axis=1) for uv, r in zip(slices, rates, strict=True)]
        assert over == pytest.approx(np.abs(np.vstack(twists) @ rows.T).max() - 1, abs=1e-12)
        losses[m] = over + (m + 2) / 4 * width
    assert len(_best_slices(rows, vertices, width)) // 2 == min(losses, key=losses.__getitem__)


def test_a_straight_robot_that_drives_ahead_is_bounded_within_2_percent() -> None:
    """The quick bound is 26 % below the best plan, which turns by 21 degrees and back."""
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    goal = Goal(x_m=0.3, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    problem = Problem(robot=ROBOT, start=start, goal=goal)
    made = plan(problem).require()
    assert rigid_time(problem) < 0.75 * made.cost.total
    assert made.gap is not None
    assert made.gap < 0.02
    enough = 2.5
    assert enough <= rigid_time(problem, enough) <= enough * (1 + 1e-5)


@pytest.mark.parametrize(("robot", "ramps"), [*itertools.product(ROBOTS, [False, True])])
def test_asking_for_more_never_lowers_the_bound(robot: Robot, ramps: bool) -> None:
    rng = np.random.default_rng(2)
    robot = robot if ramps else at_once(robot)
    for _ in range(2):
        x, y, phi = rng.uniform(-0.3, 0.3, 3) * [1, 1, 10]
        start = Start(x_m=0.0, y_m=0.0, phi_rad=0.4, kappa_per_m=(0.0, 0.0))
        goal = Goal(x_m=x, y_m=y, phi_rad=phi, kappa_per_m=(0.0, 0.0))
        problem = Problem(robot=robot, start=start, goal=goal)
        assert rigid_time(problem) <= rigid_time(problem, math.inf)


def test_a_box_around_the_start_and_free_positions_prove_nothing() -> None:
    near, free = np.array([0.01, 0.0]), np.full(2, math.nan)
    boxed = PoseChange(near, np.full(2, 0.1), (-1, 1), False)
    assert least_drive_time(STRAIGHT, boxed, 2.0) == 0.0
    change = PoseChange(free, np.zeros(2), (1, 1), False)
    assert least_drive_time(STRAIGHT, change, 2.0) == 0.0
    assert least_time(STRAIGHT, change, 2.0) > 0.0


@pytest.mark.parametrize("seed", range(4))
def test_no_step_gains_more_than_between_the_headings_of_a_coarse_grid(seed: int) -> None:
    """From headings between those of the grid, by one twist or two: what a finer grid would see."""
    rng = np.random.default_rng(seed)
    rows = random_rows(rng) if seed else STRAIGHT
    vertices = twist_vertices(rows)
    assert vertices is not None
    along = rng.uniform(-0.2, 0.2, 2)
    change = PoseChange(along, np.zeros(2), (-0.5, 0.5), False)
    made = _Drive(rows, vertices, change, change.turns, until_s=3.0)
    grid, _ = made._grid(16)
    h, m = float(grid[1] - grid[0]), len(made.slices) // 2
    step_s, excess = m * h / made.fastest_turn, []
    shares = rng.dirichlet(np.ones(len(vertices)), 20)
    twists = [*vertices, *(shares @ vertices)]
    for angle in rng.uniform(-math.pi, math.pi, 8):
        p, steep = np.array([math.cos(angle), math.sin(angle)]), rng.uniform(-0.1, 0.1)
        gains = made._gains(p, grid, h, step_s)
        inner = slice(m, len(grid) - m)
        ends = [steep * np.roll(grid, m - k) for k in range(2 * m + 1)]
        bound = np.max([a + b for a, b in zip(ends, gains, strict=True)], axis=0)[inner]
        for heading in rng.uniform(grid[inner][0], grid[inner][-1], 10):
            most = np.interp(heading, grid[inner], bound)
            for twist in twists:
                end = drive(np.array([0.0, 0.0, heading]), twist, step_s)
                excess.append(p @ end[:2] + steep * end[2] - most)
    assert max(excess) <= 1e-9
    loss = (m + 2) / 4 * h * made.fastest * step_s
    assert max(excess) > -loss  # what is added for the grid is needed in part
