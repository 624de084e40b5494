"""Lower bounds of mode sequences: never above what a plan of that sequence costs."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from problems import ROBOT, bound_of, faster_robot, guessed, network_of, random_problem

from twosra_mpc import Goal, load_robot, plan
from twosra_mpc.planning.bounds.bends import least_bends, least_durations, unreachable_reason
from twosra_mpc.planning.bounds.sequence_bound import Events, pose_bound
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.planning.solver.fixed_sequence import scheduled, solve, verified
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence

SOFT_SEQUENCES = [
    soft
    for n in (1, 2)
    for soft in itertools.product((SOFT_1, SOFT_2, SOFT_BOTH), repeat=n)
    if all(a != b for a, b in itertools.pairwise(soft))
]


def sequences() -> list[ModeSequence]:
    return [(RIGID, *soft, RIGID) for soft in SOFT_SEQUENCES]


# Thermal times, constant times, and metal so fast that driving counts: half of it, all of it.
CASES = [(0, None), (3, 1.0), (2, 30.0), (1, 3000.0)]


def test_where_the_least_bends_are_known_the_linear_program_finds_nothing_else() -> None:
    known = 0
    for seed in range(6):
        problem = random_problem(seed, robot=load_robot("2sra-v1"))  # goals are boxes
        task, energy = bending_task(problem), Weights(energy_s_per_J=1e-12)
        for sequence in sequences():
            if unreachable_reason(sequence, task) or least_bends(sequence, task) is None:
                continue
            bound = bound_of(problem, sequence)
            solved = bound_of(problem.with_values(weights=energy), sequence)
            assert (bound is None) == (solved is None)
            if bound is not None and solved is not None:
                assert bound.cost == pytest.approx(solved.cost, rel=1e-9)
                known += 1
    assert known >= 12


def test_problems_that_begin_alike_share_their_networks() -> None:
    one, other = (random_problem(seed) for seed in (0, 1))
    sequence = sequences()[0]
    assert network_of(one, sequence) is network_of(other, sequence)
    warm = one.start.with_values(temperature_C=(40.0, 25.0))
    assert network_of(one.with_values(start=warm), sequence) is not network_of(one, sequence)
    assert network_of(one.with_values(ambient_C=20.0), sequence) is not network_of(one, sequence)


@pytest.mark.parametrize(("seed", "factor"), CASES)
def test_no_plan_of_a_sequence_costs_less_than_its_bound(seed: int, factor: float | None) -> None:
    robot = ROBOT if factor is None else faster_robot(factor)  # thermal or constant times
    problem = random_problem(seed, robot=robot)
    task = bending_task(problem)
    found = 0
    for sequence in list(sequences())[seed % 6 :: 6]:
        if unreachable_reason(sequence, task):
            continue
        network, bound = network_of(problem, sequence), bound_of(problem, sequence)
        if bound is None:
            continue
        durations = least_durations(sequence, task)
        events = Events(network, problem.cost_weights, durations)
        tighter = pose_bound(events, task, math.inf)
        guess = guessed(problem, sequence, intervals=8)
        for candidate in (scheduled(guess, network, problem, 0), solve(guess, network, problem)):
            if candidate is not None:
                found += 1
                cost = verified(problem, candidate, network).cost
                assert max(bound.cost, tighter) <= cost.total + 1e-6, sequence
    assert found >= 2


def test_the_bound_includes_the_time_to_bend() -> None:
    problem = random_problem(9, timing="constant")
    bound = bound_of(problem, (RIGID, SOFT_1, SOFT_BOTH, RIGID))
    assert bound is not None
    # 335 s of transitions, and at least abs(dW) / rate for what segment 2 must bend in [1,1].
    task = bending_task(problem)
    least = abs(task.change[1][0]) / task.rate(SOFT_BOTH, (None, None))
    assert least > 0.1
    assert bound.cost >= 335.0 + least - 1e-6


def test_a_looser_goal_never_has_a_higher_bound() -> None:
    problem = random_problem(6, timing="constant")
    kappa = problem.goal.kappa_per_m
    assert kappa is not None
    costs = []
    for width in (0.0, 3.0, 10.0, 200.0):
        goal = Goal(kappa_per_m=kappa, tolerance={"kappa_per_m": (width, width)})
        loose = problem.with_values(goal=goal)
        bound = bound_of(loose, (RIGID, SOFT_1, SOFT_2, RIGID))
        assert bound is not None
        costs.append(bound.cost)
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == pytest.approx(63 + 235 + 235)


def test_bends_of_the_relaxation_add_up_to_the_task() -> None:
    problem = random_problem(8)
    task = bending_task(problem)
    sequence = (RIGID, SOFT_BOTH, SOFT_1, RIGID)
    bound = bound_of(problem, sequence)
    assert bound is not None
    for j in (0, 1):
        total = sum(bound.bends[i] for i, mode in enumerate(sequence) if mode[j])
        assert total == pytest.approx(task.change[j][0], abs=1e-9)
    assert not bound.bends[[0, -1]].any()
    assert np.isfinite(bound.times).all()


def test_with_fast_metal_the_change_of_pose_raises_the_bound() -> None:
    problem = random_problem(1, robot=faster_robot(50.0))
    result = plan(problem).require()
    sequence = tuple(phase.mode for phase in result.phases)
    sequence = sequence if sequence[-1] == RIGID else (*sequence, RIGID)
    network, bound = network_of(problem, sequence), bound_of(problem, sequence)
    assert bound is not None
    task = bending_task(problem)
    events = Events(network, problem.cost_weights, least_durations(sequence, task))
    tighter = pose_bound(events, task, math.inf)
    assert bound.cost < tighter <= result.cost.total
    assert result.cost.total - tighter < 0.6 * (result.cost.total - bound.cost)
    assert result.gap is not None
    assert result.gap < 0.08
    enough = bound.cost + 0.2 * (tighter - bound.cost)
    early = pose_bound(events, task, enough)
    assert enough <= early <= tighter + 1e-6


def test_without_a_goal_pose_or_a_choice_of_bends_the_pose_proves_nothing() -> None:
    problem = random_problem(0)
    task = bending_task(problem)
    chosen = (RIGID, SOFT_1, SOFT_2, SOFT_BOTH, RIGID)
    events = Events(network_of(problem, chosen), problem.cost_weights, [0.0] * 5)
    assert pose_bound(events, task, math.inf) == -math.inf
    free = problem.with_values(goal=Goal(kappa_per_m=problem.goal.kappa_per_m))
    sequence = (RIGID, SOFT_1, SOFT_2, RIGID)
    durations = least_durations(sequence, bending_task(free))
    events = Events(network_of(free, sequence), problem.cost_weights, durations)
    assert pose_bound(events, bending_task(free), math.inf) == -math.inf
