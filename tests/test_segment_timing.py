"""Transitions of one to four segments, each of its own length or kind."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from test_one_heater import dwells
from thermal_problems import (
    MIXED,
    SPANS_S,
    UNEQUAL,
    V1,
    V2,
    earliest_finish,
    history,
    robot_of,
    sequences,
    settled,
    thermal_model,
    thermal_problem,
    thermal_problems,
    transitions_of,
)

from twosra_mpc import InputError, Plan, Problem, Robot, plan
from twosra_mpc.checking.heat import heating_problems
from twosra_mpc.checking.verification import energy_J
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import ModeSequence
from twosra_mpc.thermal.model import reference_times
from twosra_mpc.timing import EventLayout, transition_model

LENGTHS_M = ((0.04,), (0.03, 0.05), (0.03, 0.04, 0.05), (0.04, 0.03, 0.04, 0.05))
ROBOTS = tuple(robot_of(V1, *lengths) for lengths in LENGTHS_M)
COUNTS = st.integers(1, 4)
robots = pytest.mark.parametrize("robot", [UNEQUAL, MIXED], ids=lambda robot: robot.name)

# --- the network ---------------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [1, 2, 3, 4])
@pytest.mark.parametrize("phases", [1, 2, 5])
def test_every_event_has_a_number_of_its_own(phases: int, segments: int) -> None:
    layout = EventLayout(phases, segments)
    onsets = itertools.product(range(phases + 1), range(segments))
    events = [layout.origin, layout.finish, *(layout.onset(*onset) for onset in onsets)]
    events += [event(i) for i in range(phases) for event in (layout.start, layout.end)]
    assert sorted(events) == list(range(layout.count))
    assert {event for pair in layout.pairs() for event in pair} == set(events)


def finish_by_hand(sequence: ModeSequence, segments: int, heaters: int) -> float:
    """The end of a plan whose phases take no time: 26 s + 37 s to melt, 18 s + 235 s to freeze."""
    now, done, frozen = 0.0, [0.0] * segments, [-np.inf] * segments
    before = (0,) * segments
    for mode in (*sequence, before):
        changes = [j for j in range(segments) if mode[j] != before[j]]
        ends = [now]
        for j in sorted(changes, key=lambda j: mode[j]):  # a heater goes off before another goes on
            onset = max(now, done[j] + (26.0 if mode[j] else 0.0))
            if mode[j] and heaters == 1:  # the others' are off 18 s before their freezes begin
                others = (frozen[k] for k in range(segments) if k != j)
                onset = max([onset, *(freeze - 18.0 + 26.0 for freeze in others)])
            if not mode[j]:
                frozen[j] = onset
            done[j] = onset + (37.0 if mode[j] else 235.0)
            ends.append(done[j])
        now, before = max(ends), mode
    return now


@given(count=COUNTS, data=st.data(), one_heater=st.booleans())
def test_the_earliest_finish_is_that_of_a_plan_by_hand(
    count: int, data: st.DataObject, one_heater: bool
) -> None:
    sequence = data.draw(sequences(count))
    heaters = 1 if one_heater else count
    problem = thermal_problem(ROBOTS[count - 1], timing="constant", heaters_at_once=heaters)
    model, rigid = transition_model(problem), problem.robot.rigid
    many = heaters == 1 and any(sum(mode) > 1 for mode in sequence)
    assert (model.refusal(sequence, rigid) is not None) == many
    if not many:
        network = model.network(sequence, rigid, [0.0] * len(sequence))
        assert earliest_finish(network) == pytest.approx(finish_by_hand(sequence, count, heaters))
        assert set(network.least) <= set(network.layout.pairs())


@given(count=COUNTS, data=st.data())
def test_waits_do_not_depend_on_how_many_segments_change(count: int, data: st.DataObject) -> None:
    sequence = data.draw(sequences(count))
    problem = thermal_problem(ROBOTS[count - 1], timing="paper")
    network = transition_model(problem).network(sequence, problem.robot.rigid, [0.0] * 6)
    modes = [any(mode) for mode in ((0,) * count, *sequence, (0,) * count)]
    wait = {(False, True): 100.0, (True, False): 300.0, (True, True): 502.0, (False, False): 0.0}
    # No mode of a sequence follows itself; the rigid mode may at its ends, and then nothing waits.
    assert earliest_finish(network) == sum(wait[pair] for pair in itertools.pairwise(modes))


@pytest.mark.parametrize("segments", [3, 4])
def test_one_heater_or_all_and_nothing_in_between(segments: int) -> None:
    for heaters in range(segments + 2):
        if heaters in (1, segments):
            thermal_problem(ROBOTS[segments - 1], heaters_at_once=heaters)
        else:
            with pytest.raises(InputError, match="heaters_at_once"):
                thermal_problem(ROBOTS[segments - 1], heaters_at_once=heaters)
    with pytest.raises(InputError, match=f"allowed: 1 or {segments}$"):
        thermal_problem(ROBOTS[segments - 1], heaters_at_once=2)


# --- nothing undercuts it ------------------------------------------------------------------------


@given(problem=thermal_problems(robots=(UNEQUAL, MIXED)), sequence=sequences(3), spans=SPANS_S)
def test_no_history_of_three_segments_undercuts_the_least_times_and_energies(
    problem: Problem, sequence: ModeSequence, spans: list[float]
) -> None:
    assert history(problem, sequence, spans).violated() == []


@settings(max_examples=20)
@given(
    problem=thermal_problems(robots=(UNEQUAL, MIXED), heaters_at_once=1),
    sequence=sequences(3),
    spans=SPANS_S,
)
def test_no_two_of_three_heaters_are_on_in_a_settled_schedule_with_one(
    problem: Problem, sequence: ModeSequence, spans: list[float]
) -> None:
    single = tuple(mode for mode in sequence if sum(mode) <= 1) or (problem.robot.rigid,)
    assume(thermal_model(problem).refusal(single, problem.goal.mode) is None)
    found = settled(problem, single, spans[: len(single)])
    assume(found is not None)
    assert found is not None
    assert found.violated() == []
    for pair in itertools.combinations(found.trajectories, 2):
        for one, two in itertools.product(*(dwells(each, found.finish_s) for each in pair)):
            assert one[1] <= two[0] + 1e-6 or two[1] <= one[0] + 1e-6


def test_the_only_segment_of_a_robot_is_kept_warm_too() -> None:
    """Its one heater is needed nowhere else."""
    keep = {"transition_quantile": 0.95, "heating": "keep_warm"}
    soft = ((0,), (1,), (0,), (1,), (0,))
    found = settled(thermal_problem(ROBOTS[0], **keep), soft, [0.0, 1.0, 600.0, 1.0, 0.0])
    assert found is not None
    assert 58.0 in [piece.setpoint_C for piece in found.trajectories[0].pieces]


# --- each segment by its own model ---------------------------------------------------------------


def own_times(robot: Robot, ambient_C: float) -> list[tuple[float, float]]:
    """(melt from cold, freeze from the set-point) of each segment [s]."""
    heater = robot.heater
    return [
        reference_times(
            segment_model(robot, ambient_C, j), heater.melt_current_A, heater.soft_setpoint_C
        )[1::2]
        for j in range(robot.coordinates.segments)
    ]


@robots
def test_each_segment_melts_and_freezes_in_its_own_time(robot: Robot) -> None:
    problem = thermal_problem(robot)
    found = settled(problem, (robot.rigid, (1, 1, 1), robot.rigid), [0.0, 120.0, 0.0])
    assert found is not None
    made = transitions_of(problem, found.network, found.times)
    took = {(item.segment, item.to): item.done_s - item.heater_s for item in made}
    for j, (melt_s, freeze_s) in enumerate(own_times(robot, problem.ambient), 1):
        assert took[j, "soft"] == pytest.approx(melt_s)
        if robot is UNEQUAL or j != 2:  # of two nodes the body is warmer than after a cold melt
            assert took[j, "rigid"] == pytest.approx(freeze_s)
    ends = [item.done_s for item in made if item.to == "rigid"]
    assert found.finish_s == pytest.approx(max(ends))
    assert len(set(np.round(ends, 3))) == 3  # all differ, so that no other order would do


def test_longer_segments_take_longer() -> None:
    times = own_times(UNEQUAL, 25.0)
    assert times == sorted(times)
    assert times[2][0] > 1.5 * times[0][0]


def test_thresholds_and_windows_are_of_each_segment() -> None:
    problem = thermal_problem(MIXED, transition_quantile=0.9)
    assert problem.segment_thresholds_C == ((61.0, 61.0), (53.0, 64.0), (61.0, 61.0))
    assert problem.stiffness_thresholds_C == (53.0, 64.0)
    first, second, third = (one.windows for one in thermal_model(problem).plans)
    alike = V2.with_values(heater=V1.heater)
    twin = thermal_model(thermal_problem(alike, transition_quantile=0.9)).plans[0]
    assert second == twin.windows
    assert len({first, second, third}) == 3  # a longer one loses less at its ends
    warm = thermal_problem(MIXED, temperature_C=(60.0, 52.0, 62.5))
    assert warm.start_mode == (0, 0, 1)
    assert thermal_problem(MIXED, temperature_C=(55.0, 55.0, 55.0)).start_stiffness == (0, None, 0)


# --- whole plans ---------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=[UNEQUAL, MIXED], ids=lambda robot: robot.name)
def made(request: pytest.FixtureRequest) -> Plan:
    """A plan that bends the first and the last of three segments."""
    robot: Robot = request.param
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0, 0.0)}
    goal = {"kappa_per_m": (10.0, 0.0, -8.0)}
    modes = [robot.rigid, (1, 0, 0), (1, 0, 1), (0, 0, 1)]
    return plan(Problem(robot=robot, start=start, goal=goal, modes=modes)).require()


def problems_of(made: Plan, samples: Samples) -> list[str]:
    return list(heating_problems(replace(made.trajectory, samples=samples)))


def with_column(samples: Samples, name: str, segment: int, values: Sequence[float]) -> Samples:
    """Samples with other values for one segment."""
    changed = getattr(samples, name).copy()
    changed[:, segment] = values
    return Samples(**{**vars(samples), name: changed})


def test_the_plan_is_checked_segment_by_segment(made: Plan) -> None:
    samples = made.trajectory.samples
    assert problems_of(made, samples) == []
    assert energy_J(made.trajectory) == pytest.approx(made.cost.energy_J, rel=1e-4)
    assert {item.segment for item in made.transitions} == {1, 3}
    for segment in (0, 2):
        weaker = 0.9 * samples.heater_current_A[:, segment]
        found = problems_of(made, with_column(samples, "heater_current_A", segment, weaker))
        assert found
        assert all(re.search(f"(segment|heater) {segment + 1}", text) for text in found)
    warmer = samples.temperature_C[:, 1] + 1.0
    (found,) = problems_of(made, with_column(samples, "temperature_C", 1, warmer))
    assert found.startswith("segment 2: its currents make it 1 C warmer or colder")


def test_currents_of_one_segment_do_not_suit_a_longer_one(made: Plan) -> None:
    samples = made.trajectory.samples
    swapped = samples.heater_current_A[:, [2, 1, 0]]
    found = problems_of(made, Samples(**{**vars(samples), "heater_current_A": swapped}))
    assert any("segment 3: its currents" in text for text in found)
