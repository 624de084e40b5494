"""From a candidate to a verified plan: samples, transitions, cost and verification in one value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from twosra_mpc.checking.verification import verify
from twosra_mpc.planning.nlp.fixed_sequence import Candidate
from twosra_mpc.plans.plan import Cost, Plan, Stats, Status, Verification
from twosra_mpc.plans.sampling import sample
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Samples
from twosra_mpc.problem.problem import Problem
from twosra_mpc.timing import TemporalNetwork, Transition, transition_model


@dataclass(frozen=True, eq=False)
class Verified:
    """A sampled candidate and the outcome of its verification."""

    phases: tuple[Phase, ...]
    transitions: tuple[Transition, ...]
    samples: Samples
    cost: Cost
    verification: Verification


def verified(problem: Problem, candidate: Candidate, network: TemporalNetwork) -> Verified:
    """Sample a candidate, derive its transitions and set-points, and verify the result."""
    layout, times = network.layout, [float(t) for t in candidate.times]
    sequence, durations = network.sequence, candidate.durations
    model = transition_model(problem)
    transitions = tuple(model.transitions(network, times))
    starts = [times[layout.start(i)] for i in range(layout.phases)]
    phases = tuple(
        Phase(mode, start, start + float(length))
        for mode, start, length in zip(sequence, starts, durations.sum(axis=1), strict=True)
        if length > SAME_TIME_S
    )
    finish = times[layout.finish]
    samples = sample(problem, candidate.motion, durations, starts, finish, transitions)
    return Verified(
        phases=phases,
        transitions=transitions,
        samples=samples,
        cost=_cost(problem, samples, transitions),
        verification=verify(problem, samples, phases, transitions),
    )


def _cost(problem: Problem, samples: Samples, transitions: Sequence[Transition]) -> Cost:
    """Cost of what will be executed."""
    seconds, count = float(samples.t_s[-1]), len(transitions)
    heating = transition_model(problem).heating(transitions)
    energy = sum(item.energy_J(seconds) for item in heating)
    weights = problem.cost_weights
    total = seconds + weights.energy_s_per_J * energy + weights.transition_s * count
    return Cost(total, seconds, energy, count)


def finished(
    problem: Problem,
    planner: str,
    outcome: Verified | None,
    status: Status,
    message: str,
    stats: Stats,
    lower_bound: float | None = None,
    stopped_early: bool = False,
) -> Plan:
    """Wrap what was found, or that nothing was, as a plan."""
    return Plan(
        problem=problem,
        planner=planner,
        status=status,
        message=message,
        cost=outcome.cost if outcome else None,
        lower_bound=lower_bound,
        phases=outcome.phases if outcome else (),
        transitions=outcome.transitions if outcome else (),
        samples=outcome.samples if outcome else None,
        verification=outcome.verification if outcome else None,
        stats=stats,
        stopped_early=stopped_early,
    )
