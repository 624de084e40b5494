"""A start in any state of the metal: plans, bounds, proofs and what is left of a plan."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from once import planned
from problems import ROBOT, bound_of, faster_robot, network_of, only_goal, random_problem

from twosra_mpc import InputError, Plan, Problem, load_robot, plan
from twosra_mpc.checking.certificate import check
from twosra_mpc.checking.verification import verify
from twosra_mpc.planning.bounds.bends import unreachable_reason
from twosra_mpc.planning.proof import Prover
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.planning.solver.sequence_solver import GoalSolver
from twosra_mpc.robot.modes import RIGID, all_modes
from twosra_mpc.timing import Transition, transition_model

TIMINGS = ("nominal", "constant", "paper")
GAP = 0.02


def from_any_state(seed: int, timing: str = "nominal", **overrides: Any) -> Problem:
    """A random problem whose segments are each solid, liquid or, mostly, half molten at first."""
    problem = random_problem(seed, robot=ROBOT, gap=GAP, timing=timing, **overrides)
    rng, rows = np.random.default_rng(seed), list[tuple[float, float]]()
    for solid, liquid in problem.segment_thresholds_C:
        share = float(rng.uniform())
        cold, hot = float(rng.uniform(15.0, solid)), float(rng.uniform(liquid, 80.0))
        amid = solid + share * (liquid - solid), share
        rows.append([(cold, 0.0), (hot, 1.0), amid, amid][rng.integers(4)])
    temperatures, fractions = zip(*rows, strict=True)
    start = problem.start.with_values(temperature_C=temperatures, melt_fraction=fractions)
    return problem.with_values(start=start)


def half_molten(*fractions: float, timing: str = "nominal", seed: int = 21) -> Problem:
    """A random problem with so much of each segment molten at the start."""
    problem = random_problem(seed, robot=ROBOT, gap=0.001, max_phases=4, timing=timing)
    return problem.with_values(start=problem.start.with_values(melt_fraction=fractions))


@pytest.mark.parametrize(("seed", "timing"), [(seed, TIMINGS[seed % 3]) for seed in range(15)])
def test_a_plan_from_any_state_is_verified_and_no_bound_is_above_its_cost(
    seed: int, timing: str
) -> None:
    problem = from_any_state(seed, timing)
    found = plan(problem).require()
    assert found.verification.ok
    assert found.lower_bound is not None
    assert 0.97 * found.cost.total <= found.lower_bound <= found.cost.total + 1e-9
    if seed % 5 == 0:
        certificate = Prover(problem).certificate(found.lower_bound)
        assert check(problem, certificate).bound <= found.cost.total + 1e-9


EVERY = {  # problems of which all sequences are solved, and the longest of these
    "nominal": (half_molten(0.5, 0.5), 3),
    "constant": (half_molten(0.1, 1.0, timing="constant"), 3),
    "paper": (half_molten(0.5, 0.5, timing="paper"), 3),
    "fast metal": (random_problem(21, robot=faster_robot(100.0), gap=0.001, max_phases=4), 4),
}


@pytest.mark.parametrize("name", EVERY)
def test_the_search_finds_what_solving_every_sequence_finds(name: str) -> None:
    problem, longest = EVERY[name]
    solver, task, best = GoalSolver(only_goal(problem)), bending_task(problem), math.inf
    bounded = []
    for n in (1, 2, 3):
        for head in itertools.product(all_modes(2), repeat=n):
            sequence = (*head, RIGID) if any(head[-1]) else head
            if len(sequence) > longest or any(a == b for a, b in itertools.pairwise(sequence)):
                continue
            if not unreachable_reason(sequence, task) and (bound := bound_of(problem, sequence)):
                bounded.append((bound, sequence))
    for bound, sequence in sorted(bounded, key=lambda each: each[0].cost):  # soon no other is below
        if bound.cost < best:
            solved = solver(network_of(problem, sequence), bound)
            best = min([best, *(found[0] for found in solved if found)])
    result = plan(problem).require()
    assert math.isfinite(best)
    assert result.cost.total <= best * 1.001 + 1e-9
    assert result.lower_bound is not None
    assert result.lower_bound <= best + 1e-9


def resting_times(made: Plan, rng: np.random.Generator, count: int) -> list[float]:
    """Times of a plan at which nothing moves."""
    found = list[float]()
    while len(found) < count:
        t = float(rng.uniform(0.0, made.duration_s))
        if not any(phase.start_s < t < phase.end_s for phase in made.phases):
            found.append(t)
    return found


@pytest.mark.parametrize("timing", TIMINGS)
def test_what_is_left_of_a_plan_takes_what_was_left(timing: str) -> None:
    """Dynamic programming: no sooner at the goal than the bound says, nor later by more than a gap.

    However far its metal has changed: planned again from there, half molten or half frozen.
    """
    problem = random_problem(1, robot=ROBOT, gap=0.005, timing=timing, motion="fastest")
    made = plan(problem).require()
    for t in resting_times(made, np.random.default_rng(1), 5):
        again = plan(made.rest_at(t)).require()
        assert again.verification.ok
        assert made.lower_bound is not None
        assert again.lower_bound is not None
        assert t + again.duration_s >= made.lower_bound - 1e-3
        left = made.duration_s - t
        assert again.lower_bound <= left + 1e-3
        assert again.duration_s <= left / (1 - problem.gap) + 1e-3


@pytest.mark.parametrize(("scenario", "share"), [("pick-and-place", 0.3), ("grasp-cube", 0.75)])
def test_what_is_left_of_a_mission_has_a_plan_above_its_bound(scenario: str, share: float) -> None:
    """The robot has closed around its object, and its metal is not rigid yet: it need only wait.

    It touches what it takes, and was refused for that; or had to open again, by a false proof.
    """
    made = planned(scenario)
    left_s = (1 - share) * made.duration_s
    again = plan(made.rest_at(share * made.duration_s)).require()
    assert again.lower_bound is not None
    assert again.lower_bound <= left_s + 1e-3
    assert again.duration_s <= 1.1 * left_s


@pytest.mark.parametrize("robot", ["2sra-v1", "2sr-v2"])
def test_the_rest_of_a_plan_is_in_the_state_in_which_the_plan_is(robot: str) -> None:
    problem = random_problem(3, robot=ROBOT)
    bends = {"kappa_per_m": (10.0, -10.0)}
    problem = problem.with_values(
        robot=load_robot(robot),
        gap=0.1,
        start=problem.start.with_values(kappa_per_m=(0.0, 0.0)),
        goal=problem.goal.with_values(**bends),
    )
    made = plan(problem).require()
    model = transition_model(problem).heating(made.transitions)
    for t in np.linspace(0.0, made.duration_s, 40).tolist():
        rest, now = made.rest_at(t), made.trajectory.at([t])
        assert rest.start.configuration == pytest.approx(now.q[0])
        assert rest.melt_fractions == pytest.approx(now.melt_fraction[0], abs=1e-8)
        for own, state in zip(model, rest.start_states, strict=True):
            assert state == pytest.approx(own.state_at(t), abs=1e-6)  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="time_s"):
        made.rest_at(made.duration_s + 1.0)


@pytest.mark.parametrize("timing", TIMINGS)
def test_a_plan_from_half_molten_metal_is_none_from_metal_less_molten(timing: str) -> None:
    made = plan(half_molten(0.5, 0.5, timing=timing).with_values(gap=0.05)).require()
    assert verify(made.trajectory).ok
    for fractions in ((0.3, 0.5), (0.0, 0.5), (0.5, 1.0)):
        start = made.problem.start.with_values(melt_fraction=fractions)
        forged = replace(made.trajectory, problem=made.problem.with_values(start=start))
        assert not verify(forged).ok


def test_metal_just_above_its_melting_point_does_not_coast_for_longer_than_its_heat_lasts() -> None:
    """A kelvin of four from the plateau to the set-point: 4.5 s of the 18 s from there."""
    problem = random_problem(0, robot=ROBOT, timing="constant")
    warm = problem.with_values(start=problem.start.with_values(temperature_C=(63.0, 62.0)))
    timing = transition_model(warm)

    def wrong(heater_s: float, onset_s: float) -> list[str]:
        item = Transition(2, "rigid", heater_s, onset_s, onset_s + 235.0)
        return list(timing.violations(item, None, [item]))

    assert wrong(0.0, 4.5) == []
    assert "liquid for 4.990 s after its heater is off: it would freeze earlier" in wrong(0.0, 4.99)
    assert wrong(0.5, 8.0) == []  # heated for 0.5 s of 3 s, it coasts for 3 s more
    assert wrong(0.4, 8.0)
