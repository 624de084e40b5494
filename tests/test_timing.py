"""The temporal network: hand-calculated totals, order of events, and constant transition times."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import network_of, random_problem

from twosra_mpc import Goal, Problem, Start, load_problem
from twosra_mpc.planning.bounds.schedule import cost_coefficients, feasible_schedule, schedule
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence
from twosra_mpc.timing import TemporalNetwork, Transition, transition_model

SEQUENCES = st.lists(st.sampled_from(MODES), min_size=1, max_size=6).map(
    lambda modes: tuple(m for i, m in enumerate(modes) if i == 0 or modes[i - 1] != m)
)
DURATIONS = st.lists(st.floats(0.0, 40.0), min_size=6, max_size=6)


def earliest(network: TemporalNetwork) -> list[float]:
    times = network.earliest
    assert times is not None
    return times


def scheduled(problem: Problem, network: TemporalNetwork, durations: list[float]) -> list[float]:
    times = schedule(network, np.array(durations), problem.cost_weights)
    assert times is not None
    return list(times)


def test_a_drive_shorter_than_the_heating_lead_costs_nothing() -> None:
    problem = random_problem(0, timing="constant")
    network = network_of(problem, (RIGID, SOFT_1, RIGID))
    finish = [
        scheduled(problem, network, [drive, 1.0, 0.0])[network.layout.finish]
        for drive in (0.0, 26.0, 30.0)
    ]
    assert finish == pytest.approx([299.0, 299.0, 303.0])


@given(
    sequence=SEQUENCES,
    durations=DURATIONS,
    timing=st.sampled_from(["nominal", "constant", "paper"]),
    price=st.sampled_from([0.0, 0.01]),
)
def test_a_schedule_respects_every_constraint_and_is_the_longest_path(
    sequence: ModeSequence, durations: list[float], timing: str, price: float
) -> None:
    problem = random_problem(1, timing=timing, weights={"energy_s_per_J": price})
    network = network_of(problem, sequence)
    lengths = durations[: len(sequence)]
    times = scheduled(problem, network, lengths)
    assert all(times[v] - times[u] >= w - 1e-6 for (u, v), w in network.least.items())
    with_motion = dict(network.least)
    for i, length in enumerate(lengths):
        with_motion[network.layout.start(i), network.layout.end(i)] = float(length)
    longest = [0.0] * network.layout.count
    for _ in range(network.layout.count):
        for (u, v), w in with_motion.items():
            longest[v] = max(longest[v], longest[u] + w)
    assert times[network.layout.finish] == pytest.approx(longest[network.layout.finish], abs=1e-6)


@given(sequence=SEQUENCES, durations=DURATIONS)
def test_transitions_alternate_and_nothing_moves_on_a_plateau(
    sequence: ModeSequence, durations: list[float]
) -> None:
    problem = random_problem(1, timing="constant")
    network = network_of(problem, sequence)
    layout = network.layout
    times = scheduled(problem, network, durations[: len(sequence)])
    transitions = transition_model(problem).transitions(network, times)
    assert len(transitions) == network.transitions
    assert transition_model(problem).settle(network, times) is None
    for segment in (1, 2):
        mine = [item for item in transitions if item.segment == segment]
        assert [item.to for item in mine] == ["soft", "rigid"] * (len(mine) // 2)
        for item in mine:
            assert item.heater_s <= item.onset_s + 1e-9 <= item.done_s + 1e-9
            for i, length in enumerate(durations[: len(sequence)]):
                begin = times[layout.start(i)]
                assert begin + length <= item.onset_s + 1e-6 or begin >= item.done_s - 1e-6


@given(sequence=SEQUENCES)
def test_programs_have_a_row_for_whatever_a_network_constrains(sequence: ModeSequence) -> None:
    """With one heater, what one segment does also waits for what others did before."""
    for timing in ("nominal", "constant", "paper"):
        network = network_of(random_problem(1, timing=timing, heaters_at_once=1), sequence)
        pairs = set(network.layout.pairs())
        assert network.least.keys() <= pairs
        assert all(u != v for u, v in pairs)


def test_a_warm_segment_melts_sooner_and_a_liquid_one_at_once() -> None:
    def first_soft_phase(temperature: float) -> float:
        start = {**load_problem("paper-4").start.model_dump(), "temperature_C": (25.0, temperature)}
        problem = load_problem("paper-4", start=Start(**start), timing="constant")
        network = network_of(problem, (SOFT_2, RIGID))
        return earliest(network)[network.layout.start(0)]

    assert first_soft_phase(25.0) == pytest.approx(63.0)
    assert first_soft_phase(43.0) == pytest.approx(37.0 + 13.0)
    assert first_soft_phase(65.0) == 0.0


@pytest.mark.parametrize("timing", ["nominal", "constant", "paper"])
def test_a_goal_that_stays_soft_needs_no_freeze(timing: str) -> None:
    goal = Goal(kappa_per_m=(10.0, 20.0), mode=(1, 0))
    problem = random_problem(2, goal=goal, timing=timing)
    network = network_of(problem, (RIGID, SOFT_BOTH), SOFT_1)
    transitions = transition_model(problem).transitions(network, earliest(network))
    kinds = [item[:2] for item in transitions]
    expected = [(1, "soft"), (2, "rigid"), (2, "soft")]
    if timing == "paper":  # every reconfiguration cools and melts anew
        expected = [(1, "rigid"), (1, "soft"), *expected]
    assert sorted(kinds) == sorted(expected)
    assert network.transitions == len(kinds)


def test_the_linear_cost_counts_energy_and_transitions() -> None:
    weights = {"energy_s_per_J": 0.5, "transition_s": 7.0}
    problem = random_problem(3, weights=weights, timing="constant")
    network = network_of(problem, (RIGID, SOFT_1, SOFT_BOTH, RIGID))
    times = scheduled(problem, network, [1.0, 40.0, 2.0, 0.0])
    coefficients, constant = cost_coefficients(network, problem.cost_weights)
    # Two melts of 63 s at 0.8 A, 6.64 ohm. Liquid metal that is heated for 3 s stays liquid for
    # another 18 s, so its heater gives a seventh of that power on average: less than holding does.
    # Segment 1 is liquid for 40 s, the plateau of segment 2 (37 s) and 2 s, segment 2 for 2 s.
    melt_W = 0.8**2 * 6.64
    energy = 2 * 63 * melt_W + (40 + 37 + 2 + 2) * melt_W * 3 / 21
    assert coefficients @ times + constant == pytest.approx(
        times[network.layout.finish] + 0.5 * energy + 7.0 * 4
    )


def test_where_heat_is_dear_a_later_finish_may_cost_less() -> None:
    """Two of three segments are liquid at first: what freezes early waits longer for the rest."""
    start = {**load_problem("three-segments").start.model_dump(), "temperature_C": (25.0, 80.0, 64)}
    problem = load_problem("three-segments", start=start, weights={"energy_s_per_J": 30.0})
    sequence = ((1, 1, 1), (1, 0, 0), (0, 1, 0), (1, 0, 1), (0, 1, 0), (1, 0, 0))
    network, lengths = network_of(problem, sequence, (1, 0, 1)), np.ones(len(sequence))
    network = feasible_schedule(network, lengths, problem)[1]  # type: ignore[index]
    cheapest, soonest = (
        schedule(network, lengths, weights) for weights in (problem.cost_weights, Weights())
    )
    assert cheapest is not None
    assert cheapest.min() == 0.0
    coefficients, _ = cost_coefficients(network, problem.cost_weights)
    assert coefficients @ cheapest < coefficients @ soonest - 100.0


def test_reconfiguring_by_the_authors_practice_cools_everything_first() -> None:
    problem = random_problem(4, timing="paper")
    network = network_of(problem, (SOFT_BOTH, SOFT_2, RIGID))
    assert transition_model(problem).transitions(network, earliest(network)) == [
        Transition(1, "soft", 0.0, 0.0, 100.0),
        Transition(2, "soft", 0.0, 0.0, 100.0),
        Transition(1, "rigid", 100.0, 100.0, 500.0),
        Transition(2, "rigid", 100.0, 100.0, 500.0),
        Transition(2, "soft", 500.0, 500.0, 602.0),
        Transition(2, "rigid", 602.0, 602.0, 902.0),
    ]
