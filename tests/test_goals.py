"""Goal sets: what a box says of itself, and a set of one's own that is planned for."""

from __future__ import annotations

import math
from typing import Self

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from twosra_mpc import Goal, GoalSet, Problem, Start, Tolerance, load_robot, plan
from twosra_mpc.planning.solver.fixed_sequence import solve
from twosra_mpc.planning.solver.guess import guess_motion, inner_bends
from twosra_mpc.robot.accuracy import PLANNED, Accuracy
from twosra_mpc.robot.description import Robot
from twosra_mpc.timing import transition_model

Array = NDArray[np.float64]

ARC = load_robot("2sra-v1")


class OnCircle(GoalSet):
    """b0 anywhere on a circle about the origin, any heading, a given shape."""

    radius_m: float
    kappa_per_m: tuple[float, ...]

    def of_robot(self, robot: Robot) -> Self:
        assert len(self.kappa_per_m) == robot.coordinates.segments
        return self

    def box(self, near: Array) -> tuple[Array, Array]:
        del near
        low = np.array([-self.radius_m, -self.radius_m, -math.inf, *self.kappa_per_m])
        high = np.array([self.radius_m, self.radius_m, math.inf, *self.kappa_per_m])
        return low, high

    def aim(self, q: Array) -> Array:
        far = math.hypot(q[0], q[1])
        return np.array([*(q[:2] * self.radius_m / far), q[2], *self.kappa_per_m])

    def residual(self, q: ca.SX) -> ca.SX:
        return (q[0] ** 2 + q[1] ** 2 - self.radius_m**2) / self.radius_m


def on_circle(radius_m: float, kappa: tuple[float, float]) -> Problem:
    start = Start(x_m=0.3, y_m=0.1, phi_rad=0.4, kappa_per_m=(0.0, 0.0))
    return Problem(robot=ARC, start=start, goal=OnCircle(radius_m=radius_m, kappa_per_m=kappa))


def test_a_goal_set_of_ones_own_is_planned_for_and_verified() -> None:
    problem = on_circle(0.2, (20.0, -15.0))
    found = plan(problem).require()
    end = found.samples.q[-1]
    assert math.hypot(end[0], end[1]) == pytest.approx(0.2, abs=1e-6)
    assert end[3:] == pytest.approx([20.0, -15.0], abs=1e-6)
    assert found.gap is not None
    assert found.gap < 0.01
    assert found.verification.goal_error == pytest.approx([0.0] * 5, abs=1e-6)


def test_the_nlp_ends_on_the_set() -> None:
    """From a guess that ends elsewhere on the circle, the terminal constraint holds."""
    problem = on_circle(0.2, (0.0, 0.0))
    sequence = (ARC.rigid,)
    network = transition_model(problem).network(sequence, ARC.rigid, [0.0])
    start = problem.start.configuration
    guess = guess_motion(ARC, start, problem.goal, sequence, np.zeros(1), 10)
    better = solve(guess, network, problem)
    assert better is not None
    assert math.hypot(*better.motion.end[:2]) == pytest.approx(0.2, abs=1e-8)


def test_a_driven_goal_set_is_bounded_by_its_box() -> None:
    found = plan(on_circle(0.2, (0.0, 0.0))).require()
    assert found.lower_bound is not None
    assert 0 < found.lower_bound <= found.cost.total


coordinate = st.one_of(st.none(), st.floats(-3, 3))


@given(
    st.tuples(coordinate, coordinate, coordinate, coordinate, coordinate),
    st.tuples(*[st.floats(0, 1)] * 5),
    st.lists(st.floats(-9, 9), min_size=5, max_size=5),
    st.booleans(),
)
def test_a_box_says_of_itself_what_is_true(
    middle: tuple[float | None, ...], widths: tuple[float, ...], at: list[float], modulo: bool
) -> None:
    """error == 0 exactly inside the box next to q; what is aimed at is inside."""
    if all(value is None for value in middle):
        return
    x, y, phi, *kappa = middle
    tolerance = Tolerance(x_m=widths[0], y_m=widths[1], phi_rad=widths[2], kappa_per_m=widths[3:])
    goal = Goal(
        x_m=x, y_m=y, phi_rad=phi, kappa_per_m=tuple(kappa), tolerance=tolerance, phi_modulo=modulo
    )
    q = np.array(at)
    low, high = goal.box(q)
    error = goal.error(q.copy())
    nearest = np.clip(q, low, high)
    assert error == pytest.approx(q - nearest, abs=1e-9)
    aimed = goal.aim(q)
    assert (goal.box(aimed)[0] - 1e-9 <= aimed).all()
    assert (aimed <= goal.box(aimed)[1] + 1e-9).all()
    assert np.abs(goal.error(aimed)).max() < 1e-9
    assert goal.is_box
    by = np.array([0.1, 0.0, -0.2, 0.5, 0.0])
    other = goal.loosened(by)
    assert other.half_width == pytest.approx(np.maximum(goal.half_width + by, 0.0))


def test_a_goal_without_a_tolerance_is_met_within_the_robots_accuracy() -> None:
    start, where = Start(x_m=0, y_m=0, phi_rad=0, kappa_per_m=(0, 0)), {"x_m": 0.1, "y_m": 0.0}
    accuracy = ARC.ends_within
    assert ARC.accuracy == accuracy
    default = Problem(robot=ARC, start=start, goal=where).goal
    assert isinstance(default, Goal)
    x_m, y_m, *rest = default.half_width.tolist()
    assert math.hypot(x_m, y_m) == pytest.approx(PLANNED * accuracy.position_m)
    assert rest == pytest.approx(
        PLANNED * np.array([accuracy.heading_rad, *[accuracy.curvature_per_m] * 2])
    )
    exact = Problem(robot=ARC, start=start, goal={**where, "tolerance": "exact"}).goal
    given = Problem(robot=ARC, start=start, goal={**where, "tolerance": {"x_m": 0.5}}).goal
    assert not exact.half_width.any()
    assert given.half_width.tolist() == [0.5, 0.0, 0.0, 0.0, 0.0]
    bare = ARC.with_values(accuracy=None)
    assert not Problem(robot=bare, start=start, goal=where).goal.half_width.any()
    assert bare.ends_within == Accuracy()
    # What was filled in is a tolerance like any other: a problem of another robot keeps it.
    again = Problem.parse(Problem(robot=ARC, start=start, goal=where).scenario(), "again")
    assert again.goal.half_width == pytest.approx(default.half_width)


@given(st.data())
def test_plans_end_inside_where_the_sequence_can(data: st.DataObject) -> None:
    number, width = st.floats(-5, 5), st.floats(0, 2)
    sequence = ((0, 0), *data.draw(st.permutations([(1, 0), (0, 1), (1, 1)]))[:2])
    incidence = np.array(sequence, dtype=float).T
    bends = np.array([0.0, *(data.draw(number) for _ in range(2))])
    ends = incidence @ bends
    half = np.array([data.draw(width) for _ in range(2)])
    middle = ends + np.array([data.draw(st.floats(-1, 1)) for _ in range(2)]) * half
    box, inner = np.array([middle - half, middle + half]), np.array([middle, middle])
    found = inner_bends(sequence, bends, box, inner)
    assert (box[0] - 1e-6 <= incidence @ found).all()
    assert (incidence @ found <= box[1] + 1e-6).all()
    if (half > 0).all():  # of two soft phases every end can be had
        assert incidence @ found == pytest.approx(middle, abs=1e-6)
