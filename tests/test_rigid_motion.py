"""The lower bound on rigid motions: below every motion there is, and tight where it is known."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import ROBOT

from twosra_mpc import Goal, Problem, Start, load_robot, plan
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.bounds import rigid_motion
from twosra_mpc.planning.bounds.linear_program import minimise
from twosra_mpc.planning.bounds.rigid_motion import PoseChange, headings_visited, least_time
from twosra_mpc.planning.relaxation import rigid_time
from twosra_mpc.problem.speeds import drive_rows, rigid_rows
from twosra_mpc.robot.modes import RIGID

LIMIT = ROBOT.limits.wheel_speed_rad_s


def wheel_matrix(kappa: tuple[float, float]) -> np.ndarray:
    return kinematics(ROBOT).wheel_matrix([0, 0, 0, *kappa], RIGID).full()[:, 2:]


def problem_between(start: np.ndarray, goal: np.ndarray, kappa: tuple[float, float]) -> Problem:
    return Problem(
        robot=ROBOT,
        start=Start(x_m=start[0], y_m=start[1], phi_rad=start[2], kappa_per_m=kappa),
        goal=Goal(x_m=goal[0], y_m=goal[1], phi_rad=goal[2], kappa_per_m=kappa),
    )


def drive(pose: np.ndarray, twist: np.ndarray, seconds: float) -> np.ndarray:
    """Pose after a constant body twist (u, v, r), by many small exact turns."""
    for _ in range(200):
        middle = pose[2] + twist[2] * seconds / 400
        c, s = math.cos(middle), math.sin(middle)
        step = np.array([c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]])
        pose = pose + step * seconds / 200
    return pose


KAPPA = st.tuples(st.floats(-40, 40), st.floats(-40, 40))
LEG = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(0.05, 2.0))


@settings(max_examples=10)
@given(kappa=KAPPA, legs=st.lists(LEG, min_size=1, max_size=3), heading=st.floats(-3, 3))
def test_no_admissible_motion_is_faster_than_the_bound(
    kappa: tuple[float, float], legs: list[tuple[float, float, float, float]], heading: float
) -> None:
    matrix = wheel_matrix(kappa)
    start = np.array([0.1, -0.2, heading])
    pose, duration = start, 0.0
    for u, v, r, seconds in legs:
        twist = np.array([u, v, 10 * r])
        size = np.abs(matrix @ twist).max()
        if size < 1e-6:
            continue
        pose = drive(pose, twist * LIMIT / size, seconds)
        duration += seconds
    problem = problem_between(start, pose, kappa)
    assert rigid_time(problem) <= duration + 1e-6
    boxed = problem.with_values(
        goal=problem.goal.with_values(
            x_m=float(pose[0]) + 0.01,
            phi_rad=float(pose[2]) - 0.2,
            tolerance={"x_m": 0.011, "phi_rad": 0.21},
        )
    )
    free = problem.with_values(goal=Goal(x_m=pose[0], phi_rad=pose[2], kappa_per_m=kappa))
    whole = problem.with_values(goal=problem.goal.with_values(phi_modulo=False))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rigid_motion, "FAR_RAD", 0.0)  # as if it were far: headings once around
        heading = problem.goal.with_values(phi_rad=None)
        for asked in (problem, boxed, free, whole, problem.with_values(goal=heading)):
            assert rigid_time(asked) <= duration + 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_no_drive_from_rest_to_rest_is_faster_than_the_bound(seed: int) -> None:
    """Twists of a few corners, linear in time between them, as fast as wheels and speeds allow."""
    rng, robot = np.random.default_rng(seed), load_robot("2sra-v1")
    kappa = tuple(rng.uniform(-40, 40, 2) * (seed > 0))
    rows, (_, wheels) = rigid_rows(robot, kappa), drive_rows(robot, kappa)
    gained = wheels / (robot.limits.wheel_acceleration_rad_s2 or math.inf)
    corners = np.pad(rng.normal(size=(rng.integers(1, 4), 3)) * [0.05, 0.05, 0.3], ((1, 1), (0, 0)))
    corners *= seed != 1  # then it rests
    corners /= max(1.0, np.abs(corners @ rows.T).max())
    lasting = np.abs(np.diff(corners, axis=0) @ gained.T).max(axis=1) * rng.choice([1.0, 3.0])
    at = np.append(0.0, np.cumsum(lasting))
    t = np.linspace(0.0, at[-1], 3001)
    middle = (t[1:] + t[:-1]) / 2
    pose = np.zeros(3)
    for twist in np.column_stack([np.interp(middle, at, of) for of in corners.T]):
        c, s = math.cos(pose[2] + twist[2] * t[1] / 2), math.sin(pose[2] + twist[2] * t[1] / 2)
        u, v, r = twist * t[1]
        pose = pose + np.array([c * u - s * v, s * u + c * v, r])
    for priced, wide, around in (
        (False, 0, False),
        (True, 0, False),
        (True, 1, False),
        (0, 1, True),
    ):
        turns = (pose[2] - 0.1 * wide, pose[2] + 0.2 * wide)
        change = PoseChange(pose[:2], np.full(2, 0.01 * wide), turns, around)
        asked = rows, change, 1.5 * at[-1]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rigid_motion, "FAR_RAD", 0.0 if around else math.inf)
            bound = least_time(*asked, gained, bool(priced))
        assert bound <= at[-1] * (1 + 1e-6)
        assert bound >= least_time(*asked) or wide


@pytest.mark.parametrize("phi_modulo", [True, False])
def test_far_goals_are_bounded_and_met_as_near_ones_are(phi_modulo: bool) -> None:
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(20.0, -10.0))
    goal = Goal(x_m=12.0, y_m=-16.0, phi_rad=1.0, kappa_per_m=(20.0, -10.0), phi_modulo=phi_modulo)
    problem = Problem(robot=ROBOT, start=start, goal=goal, gap=0.01)
    made = plan(problem).require()
    rows = wheel_matrix((20.0, -10.0))[:, :2] / LIMIT
    around = np.linspace(0, math.tau, 721)
    straight_s = 20.0 * np.abs(rows @ [np.cos(around), np.sin(around)]).max(axis=0).min()
    assert made.lower_bound is not None
    assert 0.98 * straight_s <= made.lower_bound <= made.duration_s < 1.02 * straight_s


def test_what_may_be_quicker_does_not_keep_a_far_drive_from_being_tried() -> None:
    """In 80 m it would pay to bend first, and many sequences are bounded below the drive."""
    shape = (20.0, -10.0)
    problem = problem_between(np.zeros(3), np.array([60.0, -80.0, 1.0]), shape)
    made = plan(problem.with_values(work_limit=1000.0)).require()
    assert made.duration_s < 850.0


def test_pure_rotation_is_bounded_exactly() -> None:
    kappa = (10.0, -10.0)
    rate = LIMIT / np.abs(wheel_matrix(kappa)[:, 2]).max()
    bound = rigid_time(problem_between(np.zeros(3), np.array([0.0, 0.0, 1.0]), kappa))
    # Turning while shifting to and fro may be faster than turning on the spot, never slower.
    assert 0.8 / rate <= bound <= 1.0 / rate + 1e-9


def test_the_bound_knows_that_headings_are_modulo_a_turn() -> None:
    kappa = (0.0, 0.0)
    near = rigid_time(problem_between(np.zeros(3), np.array([0.0, 0.0, 0.5]), kappa))
    far = rigid_time(problem_between(np.zeros(3), np.array([0.0, 0.0, 0.5 + math.tau]), kappa))
    other = rigid_time(problem_between(np.zeros(3), np.array([0.0, 0.0, math.tau - 0.5]), kappa))
    assert near == pytest.approx(far) == pytest.approx(other)


@pytest.mark.parametrize(
    "goal",
    [
        Goal(x_m=0.2, kappa_per_m=(5.0, 5.0)),
        Goal(x_m=0.2, y_m=0.1),
        Goal(phi_rad=0.7),
        Goal(x_m=0.2, y_m=0.1, phi_rad=0.7, tolerance={"x_m": 0.05, "phi_rad": 0.2}),
    ],
)
def test_free_and_loose_goals_are_never_bounded_above_a_tight_one(goal: Goal) -> None:
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.3, kappa_per_m=(5.0, 5.0))
    tight = Goal(x_m=0.2, y_m=0.1, phi_rad=0.7, kappa_per_m=(5.0, 5.0))
    loose_bound = rigid_time(Problem(robot=ROBOT, start=start, goal=goal))
    tight_bound = rigid_time(Problem(robot=ROBOT, start=start, goal=tight))
    assert 0 < loose_bound <= tight_bound + 1e-9


def test_wheels_that_cannot_hold_the_body_give_no_bound() -> None:
    matrix = np.array([[1.0, 0.0, 0.1], [1.0, 0.0, 0.2], [1.0, 0.0, 0.3], [1.0, 0.0, 0.4]])
    shift = np.array([1.0, 0.0])
    assert least_time(matrix, PoseChange(shift, np.zeros(2), (0.0, 0.0), True), 9.0) == 0.0


def test_all_headings_that_a_motion_into_a_box_visits_are_covered() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        steps = rng.normal(size=rng.integers(1, 6))
        visited = np.concatenate([[0.0], np.cumsum(steps)])
        goal = tuple(visited[-1] + rng.uniform(0, 1, 2) * [-1, 1])
        low, high = headings_visited(goal, float(np.abs(steps).sum()))
        assert low - 1e-9 <= visited.min() <= visited.max() <= high + 1e-9
    # It may turn up to 0.9 and back to 0.8: farther than half of reach, and than the goal.
    assert headings_visited((0.0, 0.8), 1.0)[1] == pytest.approx(0.9)


@pytest.mark.parametrize("error", [0.0, 1e-6, 1e-2])
def test_a_solver_that_is_wrong_proves_nothing_too_high(
    error: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows, goal = np.diag([1.0, 1.0, 0.5]), np.array([0.3, 0.4])

    def bound() -> float:
        return least_time(rows, PoseChange(goal, np.full(2, 0.1), (0.0, 0.0), False), 1.0)

    exact = bound()

    def wrong(*args: Any) -> tuple[float, np.ndarray]:
        value, x, _ = minimise(*args)
        return value - 1.0, x + error * np.random.default_rng(1).normal(size=len(x))

    monkeypatch.setattr(rigid_motion, "minimise", wrong)
    assert exact * (1 - 20 * error) - 1e-9 <= bound() <= exact + 1e-9


@pytest.mark.parametrize("turn_rad", [1.0, 30.0])
def test_rounding_is_taken_off_a_bound(turn_rad: float) -> None:
    """To turn on the spot, less or more than once round, takes a time that is known exactly."""
    rows, least_s = np.diag([20.0, 20.0, 1 / 0.3]), turn_rad / 0.3
    change = PoseChange(np.zeros(2), np.zeros(2), (turn_rad, turn_rad), False)
    bound = least_time(rows, change, least_s)
    assert (1 - 1e-8) * least_s < bound < least_s


@pytest.mark.parametrize("turn_rad_s", [3.0, 40.0])
def test_a_turn_and_a_drive_are_bounded_exactly_wherever_the_panels_lie(turn_rad_s: float) -> None:
    """A robot that drives ahead or turns, not both, turns on the way to where it must head."""
    signs = itertools.product((-1.0, 1.0), repeat=2)
    rows = np.array([[1.0, aside / 0.02, turn / turn_rad_s] for aside, turn in signs])
    takes_s, shares = 1.0 + 0.6 / turn_rad_s, []
    for angle in np.linspace(0.25, 0.35, 17):
        shift = np.array([math.cos(angle), math.sin(angle)])
        change = PoseChange(shift, np.zeros(2), (0.6, 0.6), False)
        shares.append(least_time(rows, change, 1.2 * takes_s) / takes_s)
    assert max(shares) <= 1.0
    assert min(shares) > 0.999
