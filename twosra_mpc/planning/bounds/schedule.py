"""Schedules: the cheapest event times of a sequence whose phases last given times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.planning.bounds.linear_program import minimise
from twosra_mpc.problem.problem import Problem, Weights
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import is_rigid
from twosra_mpc.timing import TemporalNetwork, TransitionModel, latest_times, transition_model

_SCHEDULE_ROUNDS = 60  # of raising what a schedule must keep
_LONG_S = 1e5


def cost_coefficients(network: TemporalNetwork, weights: Weights) -> tuple[Array, float]:
    """Cost of a sequence as a linear function of its event times: (coefficients, constant)."""
    objective = np.zeros(network.layout.count)
    objective[network.layout.finish] = 1.0
    for since, until, power in network.holds:
        objective[until] += weights.energy_s_per_J * power
        objective[since] -= weights.energy_s_per_J * power
    return objective, fixed_cost(network, weights)


def fixed_cost(network: TemporalNetwork, weights: Weights) -> float:
    """Cost of melts and freezes besides the time they take."""
    energy = weights.energy_s_per_J * network.melt_energy_J
    return energy + weights.transition_s * network.transitions


def with_durations(network: TemporalNetwork, durations: Sequence[float]) -> TemporalNetwork:
    """Return the network with these least durations of its first phases [s]."""
    if not any(durations):
        return network
    layout, least = network.layout, dict(network.least)
    for i, duration in enumerate(durations):
        least[layout.start(i), layout.end(i)] = float(duration)
    return replace(network, least=least)


def schedule(network: TemporalNetwork, durations: Array, weights: Weights) -> Array | None:
    """Event times of least cost for given phase durations [s], shape (events,).

    Among equally good schedules: segments are held liquid for the shortest time (heat as late as
    the motion allows), then phases start early. None if the constraints contradict each other.
    """
    charge(Cost.SCHEDULE, network.layout.count)
    timed = with_durations(network, durations.tolist())
    if weights.energy_s_per_J == 0:
        return _late_heating(timed)
    return _cheapest(timed, weights)


def feasible_schedule(
    network: TemporalNetwork,
    durations: Array,
    problem: Problem,
    timing: TransitionModel | None = None,
) -> tuple[Array, TemporalNetwork] | None:
    """Event times that what happens before each transition allows, and the network they fulfil.

    None if none are found. The transition model is the problem's, unless told.
    """
    model = timing or transition_model(problem)
    for _ in range(_SCHEDULE_ROUNDS):
        try:
            times = schedule(network, durations, problem.cost_weights)
        except ArithmeticError:  # the solver gave up
            return None
        if times is None:
            return None
        raised = model.settle(network, times.tolist())
        if raised is None:
            return times, network
        network = raised
    return None


def _late_heating(network: TemporalNetwork) -> Array | None:
    """Finish and freezes as early as possible, then melts as late as possible, then phases early.

    Every freeze takes its least time and every melt its latest with all freezes there, so no
    schedule with this finish holds a segment liquid for less.
    """
    earliest = network.earliest
    if earliest is None:
        return None
    fixed = (network.layout.finish, *network.onsets["rigid"])
    latest = latest_times(network, {event: earliest[event] for event in fixed})
    late = {(network.layout.origin, event): latest[event] for event in network.onsets["soft"]}
    early = replace(network, least=network.least | late).earliest
    return None if early is None else np.array(early)


def _cheapest(network: TemporalNetwork, weights: Weights) -> Array | None:
    pairs = list(network.least)
    matrix = np.zeros((len(pairs), network.layout.count))
    for row, (u, v) in enumerate(pairs):
        matrix[row, u] += 1.0
        matrix[row, v] -= 1.0
    objective, _ = cost_coefficients(network, weights)
    objective[network.onsets["rigid"]] += 1e-5
    objective[network.onsets["soft"]] -= 1e-5
    for i in range(network.layout.phases):
        objective[network.layout.start(i)] += 1e-7
        objective[network.layout.end(i)] += 1e-7
    bounds = [(0.0, None)] * network.layout.count
    optimum = minimise(objective, matrix, -np.array(list(network.least.values())), bounds)
    return None if optimum is None else optimum[1]


def hidden_by_phase_s(network: TemporalNetwork) -> list[float]:
    """Duration that each rigid phase may have without making the plan longer, alone; else 0 [s]."""

    def finish(durations: Sequence[float]) -> float:
        times = with_durations(network, durations).earliest
        return math.inf if times is None else times[network.layout.finish]

    count = len(network.sequence)
    least = finish([0.0] * count)
    found = [0.0] * count
    for i, mode in enumerate(network.sequence):
        if is_rigid(mode):
            lasting = [_LONG_S if k == i else 0.0 for k in range(count)]
            found[i] = _LONG_S - (finish(lasting) - least)
    return found
