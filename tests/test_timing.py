"""The temporal network: hand-calculated totals, order of events, and both transition models."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import random_problem

from twosra_mpc import Goal, Start, load_problem
from twosra_mpc.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence
from twosra_mpc.search.bounds import cost_coefficients, schedule
from twosra_mpc.timing import Transition, earliest_times, transition_model

# First-principles constants of the built-in robot: melt 63 s (the last 37 s changing), freeze 253 s
# (the last 235 s changing). By hand: 298 s = 63 + 253 - 18, 335 s = 63 + 37 + 235.
BY_HAND = [
    ((RIGID,), 0.0),
    ((RIGID, SOFT_1, RIGID), 63 + 235),
    ((RIGID, SOFT_BOTH, RIGID), 63 + 235),
    ((RIGID, SOFT_1, SOFT_BOTH, RIGID), 63 + 37 + 235),
    ((RIGID, SOFT_BOTH, SOFT_2, RIGID), 63 + 235 + 235),
    ((RIGID, SOFT_1, SOFT_2, RIGID), 63 + 235 + 235),
    ((RIGID, SOFT_1, RIGID, SOFT_2, RIGID), 63 + 235 + 37 + 235),
    ((RIGID, SOFT_1, RIGID, SOFT_1, RIGID), 63 + 235 + 26 + 37 + 235),
]
# The authors' sleeps: heat 100 s, freeze 300 s, any soft mode to another 502 s.
BY_HAND_PAPER = [
    ((SOFT_1, RIGID), 100 + 300),
    ((SOFT_2, SOFT_1, RIGID), 100 + 502 + 300),
    ((SOFT_BOTH, SOFT_2, SOFT_1, RIGID), 1404.0),
]

SEQUENCES = st.lists(st.sampled_from(MODES), min_size=1, max_size=6).map(
    lambda modes: tuple(m for i, m in enumerate(modes) if i == 0 or modes[i - 1] != m)
)
DURATIONS = st.lists(st.floats(0.0, 40.0), min_size=6, max_size=6)


@pytest.mark.parametrize(("sequence", "total"), BY_HAND)
def test_transitions_alone_take_the_time_calculated_by_hand(
    sequence: ModeSequence, total: float
) -> None:
    network = transition_model(random_problem(0)).network(sequence, RIGID)
    assert earliest_times(network)[network.layout.finish] == pytest.approx(total)
    times = schedule(network, np.zeros(len(sequence)), random_problem(0).weights)
    assert times[network.layout.finish] == pytest.approx(total)


@pytest.mark.parametrize(("sequence", "total"), BY_HAND_PAPER)
def test_the_authors_practice_waits_as_published(sequence: ModeSequence, total: float) -> None:
    problem = random_problem(0, timing="paper")
    network = transition_model(problem).network(sequence, RIGID)
    assert earliest_times(network)[network.layout.finish] == pytest.approx(total)


def test_a_drive_shorter_than_the_heating_lead_costs_nothing() -> None:
    problem = random_problem(0)
    network = transition_model(problem).network((RIGID, SOFT_1, RIGID), RIGID)
    finish = [
        schedule(network, np.array([drive, 1.0, 0.0]), problem.weights)[network.layout.finish]
        for drive in (0.0, 26.0, 30.0)
    ]
    assert finish == pytest.approx([299.0, 299.0, 303.0])


@settings(deadline=None, derandomize=True, max_examples=150)
@given(sequence=SEQUENCES, durations=DURATIONS, timing=st.sampled_from(["nominal", "paper"]))
def test_a_schedule_respects_every_constraint_and_is_the_longest_path(
    sequence: ModeSequence, durations: list[float], timing: str
) -> None:
    problem = random_problem(1, timing=timing)
    network = transition_model(problem).network(sequence, RIGID)
    lengths = np.array(durations[: len(sequence)])
    times = schedule(network, lengths, problem.weights)
    assert all(times[v] - times[u] >= w - 1e-6 for (u, v), w in network.least.items())
    with_motion = dict(network.least)
    for i, length in enumerate(lengths):
        with_motion[network.layout.start(i), network.layout.end(i)] = float(length)
    longest = [0.0] * network.layout.count
    for _ in range(network.layout.count):
        for (u, v), w in with_motion.items():
            longest[v] = max(longest[v], longest[u] + w)
    assert times[network.layout.finish] == pytest.approx(longest[network.layout.finish], abs=1e-6)


@settings(deadline=None, derandomize=True, max_examples=150)
@given(sequence=SEQUENCES, durations=DURATIONS)
def test_transitions_alternate_and_nothing_moves_on_a_plateau(
    sequence: ModeSequence, durations: list[float]
) -> None:
    problem = random_problem(1)
    model = transition_model(problem)
    network = model.network(sequence, RIGID)
    layout = network.layout
    times = schedule(network, np.array(durations[: len(sequence)]), problem.weights)
    transitions = model.transitions(sequence, RIGID, list(times))
    assert len(transitions) == network.melts + network.freezes
    for segment in (1, 2):
        mine = [item for item in transitions if item.segment == segment]
        assert [item.to for item in mine] == ["soft", "rigid"] * (len(mine) // 2)
        for item in mine:
            assert item.heater_s <= item.onset_s + 1e-9 <= item.done_s + 1e-9
            for i, length in enumerate(durations[: len(sequence)]):
                begin = times[layout.start(i)]
                assert begin + length <= item.onset_s + 1e-6 or begin >= item.done_s - 1e-6


def test_a_warm_segment_melts_sooner_and_a_liquid_one_at_once() -> None:
    def first_soft_phase(temperature: float) -> float:
        start = {**load_problem("paper-4").start.model_dump(), "temperature_C": (25.0, temperature)}
        problem = load_problem("paper-4", start=Start(**start))
        network = transition_model(problem).network((SOFT_2, RIGID), RIGID)
        return earliest_times(network)[network.layout.start(0)]

    assert first_soft_phase(25.0) == pytest.approx(63.0)
    assert first_soft_phase(43.0) == pytest.approx(37.0 + 13.0)
    assert first_soft_phase(65.0) == 0.0


def test_a_goal_that_stays_soft_needs_no_freeze() -> None:
    problem = random_problem(2, goal=Goal(kappa_per_m=(10.0, 20.0), mode=(1, 0)))
    model = transition_model(problem)
    network = model.network((RIGID, SOFT_BOTH), SOFT_1)
    transitions = model.transitions((RIGID, SOFT_BOTH), SOFT_1, earliest_times(network))
    assert [(item.segment, item.to) for item in transitions].count((1, "rigid")) == 0
    assert (network.melts, network.freezes) == (2, 1)


def test_the_linear_cost_counts_energy_and_transitions() -> None:
    problem = random_problem(3, weights={"energy_s_per_J": 0.5, "transition_s": 7.0})
    model = transition_model(problem)
    network = model.network((RIGID, SOFT_1, SOFT_BOTH, RIGID), RIGID)
    times = schedule(network, np.array([1.0, 40.0, 2.0, 0.0]), problem.weights)
    coefficients, constant = cost_coefficients(network, problem.weights)
    held = sum(times[off] - times[since] - shift for since, off, shift in network.holds)
    energy = network.melt_energy_J + network.hold_power_W * held
    assert held > 0
    assert coefficients @ times + constant == pytest.approx(
        times[network.layout.finish] + 0.5 * energy + 7.0 * 4
    )


def test_reconfiguring_by_the_authors_practice_cools_everything_first() -> None:
    problem = random_problem(4, timing="paper")
    model = transition_model(problem)
    network = model.network((SOFT_BOTH, SOFT_2, RIGID), RIGID)
    transitions = model.transitions((SOFT_BOTH, SOFT_2, RIGID), RIGID, earliest_times(network))
    assert transitions == [
        Transition(1, "soft", 0.0, 0.0, 100.0),
        Transition(2, "soft", 0.0, 0.0, 100.0),
        Transition(1, "rigid", 100.0, 100.0, 500.0),
        Transition(2, "rigid", 100.0, 100.0, 500.0),
        Transition(2, "soft", 500.0, 500.0, 602.0),
        Transition(2, "rigid", 602.0, 602.0, 902.0),
    ]
