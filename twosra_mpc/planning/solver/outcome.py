"""From a candidate to a plan: sampled, with its transitions, its cost and its verification."""

from __future__ import annotations

import math
from collections.abc import Sequence

from twosra_mpc.checking.cost import cost_of
from twosra_mpc.checking.verification import verify
from twosra_mpc.planning.solver.fixed_sequence import Candidate
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.speed_profile import sample
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Samples, Trajectory, entered_s
from twosra_mpc.problem.problem import Problem
from twosra_mpc.timing import TemporalNetwork, transition_model


def verified(
    problem: Problem,
    candidate: Candidate,
    network: TemporalNetwork,
    planner: str = "optimal",
    fastest_cost: float = math.inf,
) -> Plan:
    """Sample a candidate, derive its transitions and set-points, and verify the result.

    Nothing is known of other plans here: the lower bound is left to the search, and what the plan
    cost before it was made gentle [s] is told.
    """
    layout, times = network.layout, [float(t) for t in candidate.times]
    sequence, profiles = network.sequence, candidate.profiles
    transitions = tuple(transition_model(problem).transitions(network, times))
    starts = [times[layout.start(i)] for i in range(layout.phases)]
    phases = tuple(
        Phase(mode, start, start + profile.duration_s)
        for mode, start, profile in zip(sequence, starts, profiles, strict=True)
        if profile.duration_s > SAME_TIME_S
    )
    finish = times[layout.finish]
    samples = sample(problem, candidate.motion, profiles, starts, finish, transitions)
    ends = candidate.stage_ends or (layout.phases,)
    ends_s = [starts[end - 1] + profiles[end - 1].duration_s for end in ends]
    done_s = _done_s(problem, ends_s, samples) if problem.tasks else ()
    trajectory = Trajectory(problem, samples, phases, transitions, done_s)
    cost = cost_of(trajectory)
    fastest_cost = min(fastest_cost, cost.total)
    return Plan(planner, trajectory, cost, verify(trajectory), None, fastest_cost)


def _done_s(problem: Problem, ends_s: Sequence[float], samples: Samples) -> tuple[float, ...]:
    """Times when tasks are done: at the end of their stages; boxes when entered."""
    moved = Trajectory(problem, samples, (), (), (0.0,) * len(problem.tasks))
    done, ends = [0.0], iter(ends_s)
    for stage in problem.stages()[: len(problem.tasks)]:
        if stage.through is not None:
            done.append(entered_s(moved, stage.through, done[-1]))
        else:
            done.append(max(next(ends), done[-1] + stage.least_s))
    return tuple(done[1:])


def cost_s(problem: Problem, candidate: Candidate, network: TemporalNetwork) -> float:
    """Cost of the plan that a candidate makes, by its schedule [s]."""
    model, seconds = transition_model(problem), float(candidate.times[network.layout.finish])
    transitions = model.transitions(network, candidate.times.tolist())
    weights, energy = problem.cost_weights, 0.0
    if weights.energy_s_per_J:  # else nobody asks
        energy = sum(item.energy_J(seconds) for item in model.heating(transitions))
    total = seconds + weights.energy_s_per_J * energy + weights.transition_s * len(transitions)
    return total + weights.effort * candidate.effort_s
