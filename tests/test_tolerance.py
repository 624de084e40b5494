"""One tolerance of goals, for bounds, plans and verification; and boxes of goals as intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import (
    ROBOT,
    bound_of,
    exactly,
    faster_robot,
    guessed,
    network_of,
    only_goal,
    random_problem,
)

from twosra_mpc import Goal, Problem, Start, Status, load_robot, plan
from twosra_mpc.checking.verification import verify
from twosra_mpc.model.bending import bending
from twosra_mpc.planning.bounds import sequence_bound as bounds
from twosra_mpc.planning.bounds.bends import bend_steps, least_durations
from twosra_mpc.planning.bounds.parts import bound_by_parts
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.planning.solver.fixed_sequence import scheduled
from twosra_mpc.planning.solver.guess import correct_end
from twosra_mpc.planning.solver.sequence_solver import GoalSolver
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH

NEAR = 9e-7  # 1/m, within what goals may be missed by


def reshape(kappa: tuple[float, float], off: tuple[float, float], x_m: float = 0.0) -> Problem:
    """From one shape to another next to it, met exactly."""
    shape = tuple(k + by for k, by in zip(kappa, off, strict=True))
    return Problem(
        robot=ROBOT,
        start=Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=kappa),
        goal=Goal(x_m=x_m, y_m=0.0, phi_rad=0.0, kappa_per_m=shape, tolerance="exact"),
        work_limit=5000.0,
    )


@pytest.mark.parametrize("off", [(NEAR, 0.0), (NEAR, -NEAR)])
def test_a_goal_within_the_tolerance_is_met_at_rest(off: tuple[float, float]) -> None:
    result = plan(reshape((10.0, -20.0), off)).require()
    assert result.status is Status.OPTIMAL
    assert result.duration_s == result.lower_bound == 0.0


def test_a_shape_within_the_tolerance_needs_no_melt_on_a_drive() -> None:
    result = plan(reshape((10.0, -20.0), (NEAR, 0.0), x_m=0.1)).require()
    assert not result.transitions
    assert result.duration_s < 1.0


@pytest.mark.parametrize("off", [(1.1e-6, 0.0), (2e-6, 2e-6), (3e-5, 0.0), (1e-5, -1e-5)])
def test_a_goal_just_beyond_the_tolerance_is_planned(off: tuple[float, float]) -> None:
    result = plan(reshape((10.0, -20.0), off)).require()
    assert result.status is Status.OPTIMAL
    assert result.transitions


def test_no_plan_that_counts_as_there_costs_less_than_the_bound() -> None:
    """It may end short of the goal by the tolerance, and saves what that takes to bend."""
    asked, short = (reshape((10.0, -20.0), (by, 0.0)) for by in (1e-4, 1e-4 - NEAR))
    made = plan(short).require()
    assert verify(replace(made.trajectory, problem=asked)).ok
    bound = plan(asked).require().lower_bound
    assert bound is not None
    assert bound <= made.cost.total


def test_a_drive_a_little_beyond_the_tolerance_lasts_as_long_as_any() -> None:
    """No phase that moves is shorter than three control periods, and the bound knows."""
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(10.0, -20.0))
    goal = Goal(x_m=5e-6, y_m=0.0, phi_rad=0.0, kappa_per_m=(10.0, -20.0), tolerance="exact")
    result = plan(Problem(robot=load_robot("2sra-v1"), start=start, goal=goal)).require()
    assert result.status is Status.OPTIMAL
    assert result.lower_bound is not None
    assert 0.19 < result.lower_bound <= result.duration_s < 0.21


# --- boxes ---------------------------------------------------------------------------------------

SEQUENCES = [(RIGID, a, b, RIGID) for a, b in ((SOFT_1, SOFT_BOTH), (SOFT_2, SOFT_1))]


def boxed(problem: Problem, width: float) -> Problem:
    around = {"x_m": 2e-3, "y_m": 2e-3, "phi_rad": np.radians(1), "kappa_per_m": (width, width)}
    return problem.with_values(goal=problem.goal.with_values(tolerance=around))


@pytest.mark.parametrize("seed", range(4))
def test_no_goal_of_a_box_costs_less_than_the_bounds_of_the_box(seed: int) -> None:
    exact = exactly(random_problem(seed, faster_robot(3000.0)))
    box, rng = boxed(exact, 1.0), np.random.default_rng(seed)
    task = bending_task(box)
    for sequence in SEQUENCES:
        network, whole = network_of(box, sequence), bound_of(box, sequence)
        if whole is None:
            continue
        least = least_durations(sequence, task)
        cut = bound_by_parts(bounds.Events(network, box.cost_weights, least), task, np.inf)
        assert cut is not None
        parts = cut.cost
        assert (1 - 1e-3) * whole.cost <= parts  # it is cut into other pieces
        for corner in ((-1, -1), (1, 1), (-1, 1), tuple(rng.uniform(-1, 1, 2))):
            shape = tuple(np.add(exact.goal.kappa_per_m, corner))
            one = exact.with_values(goal=exact.goal.with_values(kappa_per_m=shape))
            bound = bound_of(one, sequence)
            if bound is None:
                continue
            made = scheduled(guessed(one, sequence), network_of(one, sequence), one, 0)
            if made is not None:
                assert parts <= made.times[network.layout.finish] + 1e-9


@pytest.mark.parametrize("seed", [9, 27])
def test_a_box_of_shapes_is_bounded_as_well_as_an_exact_shape(seed: int) -> None:
    exact = exactly(random_problem(seed, load_robot("2sra-v1"), gap=1e-3, motion="fastest"))
    for problem in (exact, boxed(exact, 1.0)):
        assert plan(problem).require().status is Status.OPTIMAL


def test_what_a_bend_takes_beyond_its_least_is_no_more_than_it_takes() -> None:
    facts, origin = bending(ROBOT), ((0.01, 0.02), (-0.03, -0.03))
    for bend, most in ((0.01, 0.03), (-0.01, -0.08)):
        time, more = facts.least_time_of_more(SOFT_1, origin, bend, most)
        assert time == pytest.approx(facts.least_time(SOFT_1, origin, bend))
        for further in np.linspace(bend, most, 9):
            known = facts.least_time(SOFT_1, origin, float(further))
            assert time + more * abs(further - bend) <= known * (1 + 1e-3)


# --- what goes wrong -----------------------------------------------------------------------------


def test_a_drive_that_mirrors_itself_is_not_held_for_the_best() -> None:
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    goal = Goal(x_m=0.3, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0), tolerance="exact")
    assert plan(Problem(robot=ROBOT, start=start, goal=goal)).require().duration_s < 2.87


def test_where_metal_is_fast_the_drive_that_costs_least_is_taken() -> None:
    problem = random_problem(4, faster_robot(500.0), gap=1e-3)
    sequence = (RIGID, SOFT_1, SOFT_BOTH, RIGID)
    network, bound = network_of(problem, sequence), bound_of(problem, sequence)
    assert bound is not None
    found = next(iter(GoalSolver(only_goal(problem))(network, bound)))
    made = scheduled(guessed(problem, sequence), network, problem, 0)
    assert found is not None
    assert made is not None
    assert bound.cost <= found[0] < 0.95 * made.times[network.layout.finish]


def test_solvers_that_give_up_cost_a_bound_or_an_attempt(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = boxed(random_problem(0), 1.0)
    sequence = (RIGID, SOFT_1, SOFT_BOTH, RIGID)
    before = bound_of(problem, sequence)
    guess = guessed(problem, sequence, np.zeros(4), intervals=4)

    def gives_up(*_: object, **__: object) -> None:
        raise ArithmeticError

    def does_not_converge(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(bounds, "proved_minimum", gives_up)
    after = bound_of(problem, sequence)
    assert before is not None
    assert after is not None
    assert 0.9 * before.cost < after.cost <= before.cost
    steps = bend_steps(sequence, bending_task(problem), ())
    assert steps is not None
    for step, bend in zip(steps, after.bends, strict=True):
        assert min(step.least, step.most) - 1e-9 <= bend <= max(step.least, step.most) + 1e-9
    monkeypatch.setattr(np.linalg, "lstsq", does_not_converge)
    assert correct_end(guess, problem.goal) is None


def test_a_start_known_within_a_box_is_within_what_is_said_of_its_bends() -> None:
    task = replace(bending_task(random_problem(0)), origin_within=(0.02, 0.01))
    (step, *_) = bend_steps((SOFT_1, SOFT_2, RIGID), task, ()) or ()
    for (low, high), w, by in zip(step.before, task.origin, (0.02, 0.01), strict=True):
        assert low <= w - by < w + by <= high
