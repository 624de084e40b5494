"""Bounds of sequences whose bends are a choice: cut into parts, none of which hides a plan."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from problems import (
    ROBOT,
    bold,
    bound_of,
    exactly,
    faster_robot,
    guessed,
    network_of,
    random_problem,
)

from twosra_mpc import Goal, Problem, Start, Status, load_robot, plan
from twosra_mpc.model.bending import bending
from twosra_mpc.planning.bounds.bends import bend_steps, free_bends, middle_bends
from twosra_mpc.planning.bounds.parts import bound_by_parts
from twosra_mpc.planning.bounds.sequence_bound import Events
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.planning.solver.fixed_sequence import scheduled
from twosra_mpc.problem.limits import broken_by_shapes
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence

SEQUENCES: list[ModeSequence] = [
    *((RIGID, *soft, RIGID) for soft in itertools.permutations((SOFT_1, SOFT_2, SOFT_BOTH))),
    (RIGID, SOFT_2, SOFT_BOTH, SOFT_2, RIGID),
    (RIGID, SOFT_1, RIGID, SOFT_2, SOFT_1, RIGID),
    (RIGID, SOFT_1, SOFT_2, SOFT_1, SOFT_2, RIGID),
]


@pytest.fixture(scope="module")
def unlucky() -> Problem:
    """A problem whose direct ways all pass shapes in which the units would overlap."""
    return Problem(
        robot=bold(load_robot("2sra-v1")),
        start=Start(x_m=0.2349, y_m=-0.1488, phi_rad=-1.5485, kappa_per_m=(-35.964, 58.98)),
        goal=Goal(x_m=-0.1067, y_m=0.0526, phi_rad=3.0827, kappa_per_m=(54.008, -54.918)),
    )


def parts_of(problem: Problem, sequence: ModeSequence) -> tuple[float, Array]:
    """The bound by parts, and its bends."""
    known_s = [0.0] * len(sequence)
    events = Events(network_of(problem, sequence), problem.cost_weights, known_s)
    found = bound_by_parts(events, bending_task(problem), math.inf)
    assert found is not None
    return found.cost, found.bends


@pytest.mark.parametrize(("seed", "factor"), [(0, 1.0), (1, 30.0), (2, 3000.0)])
def test_no_plan_costs_less_than_the_bound_by_parts(seed: int, factor: float) -> None:
    problem = exactly(random_problem(seed, faster_robot(factor)))
    task, rng, found = bending_task(problem), np.random.default_rng(seed), 0
    for sequence in SEQUENCES:
        bound, _ = parts_of(problem, sequence)
        free = free_bends(sequence, task)
        assert free
        for scale in (0.0, *np.geomspace(0.02, 0.5, 4)):
            choice = tuple((scale * rng.choice(ends),) * 2 for ends in free)
            bends = middle_bends(sequence, task.change, choice)
            made = scheduled(
                guessed(problem, sequence, bends), network_of(problem, sequence), problem, 0
            )
            if made is not None:
                found += 1
                assert bound <= made.times.max() + 1e-9, sequence
    assert found >= 6


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_all_bends_within_a_part_are_within_its_steps(sequence: ModeSequence) -> None:
    robot, rng, found = load_robot("2sra-v1"), np.random.default_rng(3), 0
    task, facts = bending_task(random_problem(3, robot)), bending(robot)
    for _ in range(200):
        ends = np.sort(rng.uniform(-2, 2, (len(free_bends(sequence, task)), 2)))
        steps = bend_steps(sequence, task, tuple(map(tuple, ends.tolist())))
        assert steps is not None
        choice = tuple((w, w) for w in rng.uniform(*ends.T).tolist())
        bends = middle_bends(sequence, task.change, choice)
        passed = task.origin + np.cumsum(np.array(sequence) * bends[:, None], axis=0)
        low, high = np.array(task.origin) + np.array(task.room).T
        if not ((passed >= low) & (passed <= high)).all():
            continue  # beyond the curvature limits
        if broken_by_shapes(robot, [facts.curvatures(w) for w in passed.tolist()]):
            continue  # it would overlap itself
        found += 1
        here = np.vstack([task.origin, passed[:-1]])
        for step, bend, before in zip(steps, bends, here, strict=True):
            assert step.possible
            assert step.least - 1e-9 <= bend <= step.most + 1e-9
            low, high = np.array(step.before).T
            assert (low - 1e-9 <= before).all()
            assert (before <= high + 1e-9).all()
    assert found > 5


def test_what_is_excluded_by_parts_has_no_bends_that_are_allowed(unlucky: Problem) -> None:
    task, facts, excluded = bending_task(unlucky), bending(unlucky.robot), 0
    for sequence in SEQUENCES[:6]:
        if parts_of(unlucky, sequence)[0] < math.inf:
            continue
        excluded += 1
        ((least, most),) = free_bends(sequence, task)
        for free in np.linspace(least, most, 300):
            bends = middle_bends(sequence, task.change, ((free, free),))
            ends = task.origin + np.cumsum(np.array(sequence) * bends[:, None], axis=0)
            begins = np.vstack([task.origin, ends[:-1]])
            way = np.linspace(begins, ends, 40).reshape(-1, 2)
            low, high = np.array(task.origin) + np.array(task.room).T
            if not ((way >= low) & (way <= high)).all():
                continue
            shapes = np.column_stack([facts.curvature(w, j) for j, w in enumerate(way.T)])
            assert broken_by_shapes(unlucky.robot, shapes) is not None
    assert excluded >= 1


def test_a_shape_behind_forbidden_ones_is_proved_within_the_gap(unlucky: Problem) -> None:
    sequence = (RIGID, SOFT_1, SOFT_2, SOFT_BOTH, RIGID)
    relaxed = bound_of(unlucky, sequence)
    assert relaxed is not None
    assert relaxed.cost + 10.0 < parts_of(unlucky, sequence)[0]
    result = plan(unlucky).require()
    assert result.status is Status.OPTIMAL
    assert result.verification.ok
    least, _ = parts_of(unlucky, (RIGID, SOFT_2, SOFT_1, SOFT_BOTH, RIGID))
    assert result.sequence == (RIGID, SOFT_2, SOFT_1, SOFT_BOTH)
    assert least <= result.cost.total <= 1.005 * least


def test_its_bends_are_a_plan_close_to_the_bound(unlucky: Problem) -> None:
    sequence = (RIGID, SOFT_BOTH, SOFT_2, SOFT_1, RIGID)
    bound, bends = parts_of(unlucky, sequence)
    made = scheduled(guessed(unlucky, sequence, bends), network_of(unlucky, sequence), unlucky, 0)
    assert made is not None
    assert bound <= made.times.max() <= 1.005 * bound


def test_where_there_is_no_choice_there_are_no_parts() -> None:
    problem = exactly(random_problem(0))
    sequence = (RIGID, SOFT_1, SOFT_BOTH, RIGID)
    assert problem.robot is ROBOT
    events = Events(network_of(problem, sequence), problem.cost_weights, [0.0] * 4)
    assert bound_by_parts(events, bending_task(problem), math.inf) is None
