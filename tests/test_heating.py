"""Heater set-points, currents, temperatures and stiffness follow from the transitions."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from conftest import PLANNERS_AND_TIMINGS
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from once import planned

from twosra_mpc import Plan, Problem, load_problem, load_robot, plan
from twosra_mpc.robot.timing import SequentialTiming
from twosra_mpc.timing import SegmentHeating, Transition, transition_model
from twosra_mpc.timing.constant_heating import ConstantHeating
from twosra_mpc.timing.thermal import ThermalHeating

Array = NDArray[np.float64]

ROBOT = load_robot("2sra-v1")
HEATER = ROBOT.heater
SLEEPS = ROBOT.timing["paper"]
AMBIENT, MELTING, SOFT = 25.0, 61.0, 65.0  # C
MELT_A, HOLD_A = 0.8, 0.307
MELT_LEAD_S, MELT_PLATEAU_S = 26.0, 37.0  # of the 63 s of a melt
FREEZE_LEAD_S, FREEZE_PLATEAU_S = 18.0, 235.0  # of the 253 s of a freeze
SUPERHEAT_S = 3.0  # from molten to the set-point
RAMP = (MELTING - AMBIENT) / MELT_LEAD_S  # C/s, as fast as the heater heats
THERMAL_RAMP = 1.6  # C/s: 4.9 W of the hot coil into the 3.1 J/K of the solid segment
EVENT_S = 2e-6


def of_segment(some: Plan, segment: int) -> list[Transition]:
    """Transitions of a segment (1 or 2)."""
    return [item for item in some.transitions if item.segment == segment]


class Heated(NamedTuple):
    """From ``on`` to ``off`` the heater is on; from ``hot`` the segment is at its set-point."""

    on: float
    hot: float
    off: float


def heated(
    transitions: Sequence[Transition],
    *,
    liquid: bool,
    superheat_s: float = SUPERHEAT_S,
    start_C: float = SOFT,
) -> list[Heated]:
    """Periods between heater on and off, read off the transitions."""
    ons = [(item.heater_s, item.done_s + superheat_s) for item in transitions if item.to == "soft"]
    offs = [item.heater_s for item in transitions if item.to == "rigid"]
    hot = superheat_s * (SOFT - start_C) / (SOFT - MELTING)
    ons = [(-math.inf, hot), *ons] if liquid else ons
    offs += [math.inf] * (len(ons) - len(offs))
    return [Heated(on, hot, off) for (on, hot), off in zip(ons, offs, strict=True)]


def middles(t: Array) -> tuple[Array, NDArray[np.intp]]:
    """Times in the middle of every interval between samples, and the sample that starts it."""
    index = np.flatnonzero(np.diff(t) > 2 * EVENT_S)
    return (t[index] + t[index + 1]) / 2, index


def liquid(transitions: Sequence[Transition], t: float, *, at_start: bool) -> bool:
    """Whether a segment is liquid at a time: molten, and not yet freezing."""
    state = at_start
    for item in transitions:
        if t >= (item.done_s if item.to == "soft" else item.onset_s):
            state = item.to == "soft"
    return state


def temperature_of(segment: SegmentHeating, t: Array) -> Array:
    return segment.temperature_and_melt_fraction(t)[0]


def melt_fraction(segment: SegmentHeating, t: Array) -> Array:
    return segment.temperature_and_melt_fraction(t)[1]


# --- set-points of whole plans -------------------------------------------------------------------


WARM_STARTS = itertools.product([(70.0, 25.0), (25.0, 64.0), (63.0, 62.0)], ["nominal", "constant"])


@pytest.fixture(params=[*PLANNERS_AND_TIMINGS, *WARM_STARTS], ids=str)
def any_start(request: pytest.FixtureRequest) -> Plan:
    """A plan from rigid metal by each planner, or one whose start is partly liquid."""
    first, timing = request.param
    if isinstance(first, str):
        return planned("paper-1", planner=first, timing=timing)
    return planned_from(first, timing)


@functools.cache
def planned_from(temperatures: tuple[float, float], timing: str) -> Plan:
    goal = {"x_m": 0.1, "y_m": 0.0, "phi_rad": 0.2, "kappa_per_m": (20.0, -15.0)}
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    warm = {**start, "temperature_C": temperatures}
    problem = Problem(robot=ROBOT, goal=goal, start=warm, timing=timing, gap=0.011)
    return plan(problem).require()  # the last thousandth takes seconds


def test_the_heater_is_on_from_its_melt_to_its_freeze(any_start: Plan) -> None:
    """Set-point 65 C exactly between heater on and off; melt, hold or no current."""
    samples = any_start.samples
    times, index = middles(samples.t_s)
    thermal = any_start.problem.timing == "nominal"
    for j in (0, 1):
        periods = heated(
            of_segment(any_start, j + 1),
            liquid=bool(any_start.problem.start_mode[j]),
            superheat_s=SUPERHEAT_S if any_start.problem.timing == "constant" else 0.0,
            start_C=any_start.problem.temperatures[j],
        )
        for t, i in zip(times, index, strict=True):
            current = [MELT_A if t < p.hot else HOLD_A for p in periods if p.on <= t < p.off]
            assert samples.heater_setpoint_C[i, j] == (SOFT if current else AMBIENT), t
            if thermal and current:  # as hot as it is, not as late as it is, decides
                before, after = samples.temperature_C[[i, i + 1], j]
                current = [MELT_A if after > before or before < SOFT - 1e-5 else HOLD_A]
                current = [0.0] if before > SOFT + 1e-5 else current
            expected = pytest.approx(current[0], abs=2e-4 * thermal) if current else 0.0
            assert samples.heater_current_A[i, j] == expected, t


def test_the_mode_is_what_the_transitions_made_of_the_metal(any_start: Plan) -> None:
    """The mode of a sample is liquid or not, as the transitions say; nothing moves in between."""
    samples = any_start.samples
    assert samples.mode[0].tolist() == list(any_start.problem.start_mode)
    times, index = middles(samples.t_s)
    for j in (0, 1):
        transitions = of_segment(any_start, j + 1)
        at_start = bool(any_start.problem.start_mode[j])
        for t, i in zip(times, index, strict=True):
            assert samples.mode[i, j] == liquid(transitions, t, at_start=at_start), t
            if samples.v[i].any():
                assert not any(item.onset_s < t < item.done_s for item in transitions), t


def test_the_temperature_is_as_expected(any_start: Plan) -> None:
    """From what was given, between ambient and set-point."""
    temperature = any_start.samples.temperature_C
    assert temperature[0] == pytest.approx(any_start.problem.temperatures, abs=1e-9)
    assert temperature.min() >= AMBIENT - 1e-9
    assert temperature.max() <= max(SOFT, *any_start.problem.temperatures) + 1e-9


@pytest.mark.parametrize("timing", ["nominal", "constant"])
@pytest.mark.parametrize("planner", ["optimal", "greedy"])
def test_metal_melts_and_freezes_at_its_melting_point(planner: str, timing: str) -> None:
    found = planned("paper-1", planner=planner, timing=timing)
    samples = found.samples
    for item in found.transitions:
        plateau = samples.t_s > item.onset_s - EVENT_S
        plateau &= samples.t_s < item.done_s - EVENT_S
        assert plateau.sum() >= 2
        reached = samples.temperature_C[plateau, item.segment - 1]
        assert reached == pytest.approx(np.full(reached.shape, MELTING), abs=1e-5)


@pytest.mark.parametrize("planner", ["optimal", "greedy"])
def test_sleeping_through_a_melt_ends_at_the_set_point(planner: str) -> None:
    found = planned("paper-1", planner=planner, timing="paper")
    samples = found.samples
    for item in found.transitions:
        done = np.abs(samples.t_s - item.done_s).argmin()
        reached = samples.temperature_C[done, item.segment - 1]
        if item.to == "soft":
            assert reached == pytest.approx(SOFT, abs=1e-5)
        else:
            decay = math.exp(-(item.done_s - item.heater_s) / HEATER.cooling_time_constant_s)
            assert reached == pytest.approx(AMBIENT + (SOFT - AMBIENT) * decay, abs=1e-5)
            assert reached < MELTING


def test_the_temperature_never_jumps(any_plan: Plan) -> None:
    samples = any_plan.samples
    steps = np.abs(np.diff(samples.temperature_C, axis=0))
    ramp = THERMAL_RAMP if any_plan.problem.timing == "nominal" else RAMP
    assert (steps <= ramp * np.diff(samples.t_s)[:, None] + 1e-6).all()


def test_the_melt_fraction_says_what_the_transitions_made_of_the_metal(any_plan: Plan) -> None:
    samples = any_plan.samples
    times, index = middles(samples.t_s)
    for j in (0, 1):
        transitions = of_segment(any_plan, j + 1)
        for t, i in zip(times, index, strict=True):
            ends = sorted(samples.melt_fraction[[i, i + 1], j])
            if any(item.onset_s < t < item.done_s for item in transitions):
                assert 0.0 <= ends[0] < ends[1] <= 1.0, t
            else:
                state = float(liquid(transitions, t, at_start=False))
                assert ends == pytest.approx([state] * 2, abs=1e-6)


# --- one segment ---------------------------------------------------------------------------------


class Cycle(NamedTuple):
    """Waits of one melt and freeze [s]: before the heater, liquid with it, liquid without it."""

    before: float
    held: float
    unheated: float


def cycle(before: float, held: float, share: float) -> Cycle:
    """Waits of a cycle that uses a share of the heat its liquid metal has stored."""
    return Cycle(before, held, share * FREEZE_LEAD_S * min(1.0, held / SUPERHEAT_S))


CYCLES = st.lists(
    st.builds(cycle, st.floats(0.0, 300.0), st.floats(0.0, 100.0), st.floats(0.0, 1.0)),
    min_size=1,
    max_size=3,
)
SEGMENTS = st.sampled_from([1, 2])


def cycles(waits: Sequence[Cycle], *, last_freeze: bool = True) -> tuple[Transition, ...]:
    """Melts and freezes with these waits, with the constants of the robot."""
    found: list[Transition] = []
    t = 0.0
    for wait in waits:
        on = t + wait.before
        molten = on + MELT_LEAD_S + MELT_PLATEAU_S
        off = molten + wait.held
        t = off + wait.unheated + FREEZE_PLATEAU_S
        found.append(Transition(1, "soft", on, on + MELT_LEAD_S, molten))
        found.append(Transition(1, "rigid", off, off + wait.unheated, t))
    return tuple(found if last_freeze else found[:-1])


def overlapped(transitions: tuple[Transition, ...], start_C: float = AMBIENT) -> ConstantHeating:
    """A segment with constant times that starts at a temperature."""
    soft, times = start_C > MELTING, (SUPERHEAT_S, FREEZE_LEAD_S)
    return ConstantHeating(soft, transitions, HEATER, AMBIENT, start_C, *times)


def grid(transitions: Sequence[Transition], step_s: float = 0.25) -> Array:
    """Fine times past the end of all transitions."""
    return np.arange(0.0, transitions[-1].done_s + 2000.0, step_s)


@given(CYCLES, st.floats(0.0, 60.9))
def test_the_temperature_curve_is_continuous_and_between_its_extremes(
    waits: list[Cycle], start_C: float
) -> None:
    transitions = cycles(waits)
    if start_C != AMBIENT:  # the first melt takes longer from colder, shorter from warmer metal
        first = transitions[0]
        on = first.onset_s - MELT_LEAD_S * max(1.0, (MELTING - start_C) / (MELTING - AMBIENT))
        shift = max(0.0, -on)
        moved = [item._replace(**later(item, shift)) for item in transitions]
        moved[0] = moved[0]._replace(heater_s=on + shift)
        transitions = tuple(moved)
    t = grid(transitions)
    temperature = temperature_of(overlapped(transitions, start_C), t)
    assert np.abs(np.diff(temperature)).max() <= RAMP * 0.25 + 1e-9
    assert temperature.min() >= min(AMBIENT, start_C) - 1e-9
    assert temperature.max() <= SOFT + 1e-9
    assert temperature[0] == pytest.approx(start_C)


def later(item: Transition, by_s: float) -> dict[str, float]:
    """The times of a transition, ``by_s`` later."""
    return {name: getattr(item, name) + by_s for name in ("heater_s", "onset_s", "done_s")}


@given(CYCLES)
def test_the_curve_rests_on_the_plateaus_and_decays_to_ambient(waits: list[Cycle]) -> None:
    transitions = cycles(waits)
    segment = overlapped(transitions)
    for item in transitions:
        plateau = np.linspace(item.onset_s, item.done_s, 20)
        assert temperature_of(segment, plateau) == pytest.approx(np.full(20, MELTING), abs=1e-9)
    done, tau = transitions[-1].done_s, HEATER.cooling_time_constant_s
    after = done + np.array([0.0, tau, 10 * tau])
    expected = AMBIENT + (MELTING - AMBIENT) * np.exp([0.0, -1.0, -10.0])
    assert temperature_of(segment, after) == pytest.approx(expected, abs=1e-9)


@given(CYCLES)
def test_flags_set_points_and_currents_are_those_of_the_transitions(waits: list[Cycle]) -> None:
    transitions = cycles(waits)
    segment = overlapped(transitions)
    edges = np.unique([0.0, *segment.event_times()])
    assert set(edges) >= {time for item in transitions for time in item[2:]}
    t = (edges[:-1] + edges[1:]) / 2
    t = t[np.diff(edges) > 1e-6]
    soft, fraction = segment.soft(t), melt_fraction(segment, t)
    changing = (fraction > 0) & (fraction < 1)
    assert not (soft & changing).any()
    assert soft.tolist() == [liquid(transitions, time, at_start=False) for time in t]
    assert changing.tolist() == [
        any(item.onset_s < time < item.done_s for item in transitions) for time in t
    ]
    assert (fraction[~changing] == soft[~changing]).all()
    periods = heated(transitions, liquid=False)
    on = np.array([any(p.on < time < p.off for p in periods) for time in t])
    hot = np.array([any(p.hot < time < p.off for p in periods) for time in t])
    assert segment.setpoint_C(t).tolist() == np.where(on, SOFT, AMBIENT).tolist()
    assert segment.current_A(t).tolist() == np.where(on, np.where(hot, HOLD_A, MELT_A), 0).tolist()
    assert (temperature_of(segment, t)[soft] >= MELTING - 1e-9).all()


def test_at_an_event_the_new_value_is_in_force() -> None:
    melt, freeze = cycles([Cycle(10.0, 20.0, 9.0)])
    segment = overlapped((melt, freeze))
    hot = melt.done_s + SUPERHEAT_S
    at = np.array([melt.heater_s, melt.onset_s, melt.done_s, hot, *freeze[2:]])
    assert segment.setpoint_C(at).tolist() == [SOFT] * 4 + [AMBIENT] * 3
    assert segment.current_A(at).tolist() == [MELT_A] * 3 + [HOLD_A] + [0.0] * 3
    assert segment.soft(at).tolist() == [False, False, True, True, True, False, False]
    assert melt_fraction(segment, at).tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0]


def test_the_longer_unheated_metal_stays_liquid_the_hotter_it_was() -> None:
    for unheated, peak in ((18.0, 65.0), (9.0, 63.0), (0.0, 61.0)):
        melt, freeze = cycles([Cycle(0.0, 60.0, unheated)])
        segment = overlapped((melt, freeze))
        assert temperature_of(segment, np.array([freeze.heater_s]))[0] == pytest.approx(peak)


def test_a_segment_that_is_never_heated_relaxes_to_ambient() -> None:
    segment = overlapped((), start_C=45.0)
    t = np.array([0.0, 170.0, 5000.0])
    expected = AMBIENT + 20.0 * np.exp(-t / 170.0)
    assert temperature_of(segment, t) == pytest.approx(expected)
    assert not segment.soft(t).any()
    assert not segment.current_A(t).any()
    assert segment.setpoint_C(t).tolist() == [AMBIENT] * 3
    assert segment.event_times() == []


def test_a_metal_still_warm_is_heated_from_where_it_is() -> None:
    first, second = Cycle(0.0, 10.0, 5.0), Cycle(50.0, 10.0, 5.0)
    transitions = cycles([first, second])
    segment = overlapped(transitions)
    done, on = transitions[1].done_s, transitions[2].heater_s
    expected = AMBIENT + (MELTING - AMBIENT) * math.exp(-(on - done) / 170.0)
    assert temperature_of(segment, np.array([on]))[0] == pytest.approx(expected)
    just_before = temperature_of(segment, np.array([on - 1e-6]))[0]
    assert just_before == pytest.approx(expected, abs=1e-5)


def test_a_liquid_start_is_held_until_its_freeze() -> None:
    freeze = Transition(1, "rigid", 40.0, 58.0, 293.0)
    segment = overlapped((freeze,), start_C=70.0)
    t = np.array([0.0, 20.0, 39.9, 40.1, 57.9, 58.1, 292.9, 293.1])
    soft = [True] * 5 + [False] * 3
    assert segment.soft(t).tolist() == soft
    expected = [1.0] * 5 + [1 - 0.1 / 235, 0.1 / 235, 0.0]
    assert melt_fraction(segment, t) == pytest.approx(expected)
    assert segment.setpoint_C(t).tolist() == [SOFT] * 3 + [AMBIENT] * 5
    assert segment.current_A(t).tolist() == [HOLD_A] * 3 + [0.0] * 5
    temperature = temperature_of(segment, np.arange(0.0, 600.0, 0.1))
    assert temperature[0] == 70.0
    assert temperature.max() == 70.0
    assert (np.diff(temperature) <= 1e-9).all()
    assert temperature_of(segment, np.array([58.0, 293.0])).tolist() == [MELTING, MELTING]


@pytest.mark.parametrize("start_C", [70.0, 85.0])
def test_hot_metal_cools_no_faster_than_without_its_heater(start_C: float) -> None:
    freeze = Transition(1, "rigid", 90.0, 108.0, 343.0)
    t = np.arange(0.0, 108.0, 0.1)
    temperature = temperature_of(overlapped((freeze,), start_C), t)
    fastest = (start_C - AMBIENT) / HEATER.cooling_time_constant_s
    assert np.diff(temperature).min() >= -fastest * 0.1 - 1e-9


@pytest.mark.parametrize("start_C", [25.0, 62.0])
def test_metal_that_stays_liquid_reaches_its_set_point(start_C: float) -> None:
    melt = cycles([Cycle(0.0, 10.0, 0.0)], last_freeze=False)
    segment = overlapped(melt if start_C < MELTING else (), start_C)
    late = np.array([1000.0])
    assert segment.setpoint_C(late)[0] == SOFT
    assert temperature_of(segment, late)[0] == pytest.approx(SOFT, abs=0.1)


SLEEP_CYCLES = st.lists(
    st.tuples(st.floats(0.0, 300.0), st.floats(0.0, 200.0)), min_size=1, max_size=3
)


@given(SLEEP_CYCLES)
def test_sleeping_heats_on_a_line_and_cools_on_an_exponential(
    waits: list[tuple[float, float]],
) -> None:
    assert isinstance(SLEEPS, SequentialTiming)
    transitions: list[Transition] = []
    t = 0.0
    for before, held in waits:
        on, off = t + before, t + before + SLEEPS.heat_s + held
        t = off + SLEEPS.freeze_s
        transitions.append(Transition(1, "soft", on, on, on + SLEEPS.heat_s))
        transitions.append(Transition(1, "rigid", off, off, t))
    segment = ConstantHeating(False, tuple(transitions), HEATER, AMBIENT, AMBIENT)
    fine = grid(transitions)
    temperature = temperature_of(segment, fine)
    steepest = (SOFT - AMBIENT) / SLEEPS.heat_s
    assert np.abs(np.diff(temperature)).max() <= steepest * 0.25 + 1e-9
    assert temperature.min() >= AMBIENT - 1e-9
    assert temperature.max() <= SOFT + 1e-9
    assert temperature[-1] == pytest.approx(AMBIENT, abs=0.01)
    for item in transitions:
        if item.to == "soft":
            assert temperature_of(segment, np.array([item.done_s]))[0] == pytest.approx(SOFT)
            middle = np.array([item.heater_s, item.heater_s + SLEEPS.heat_s / 2, item.done_s])
            low, half, high = temperature_of(segment, middle)
            assert half == pytest.approx((low + high) / 2)


@given(CYCLES, SEGMENTS)
def test_each_segment_gets_its_own_transitions(waits: list[Cycle], segment: int) -> None:
    mine = tuple(item._replace(segment=segment) for item in cycles(waits))
    for timing, kind in (("constant", ConstantHeating), ("nominal", ThermalHeating)):
        split = transition_model(load_problem("paper-1", timing=timing)).heating(mine)
        assert all(isinstance(item, kind) for item in split)
        assert split[segment - 1].transitions == mine
        assert split[2 - segment].transitions == ()
        start = [item.temperature_and_melt_fraction(np.zeros(1)) for item in split]
        assert start == [(AMBIENT, 0.0)] * 2
        assert not any(item.molten_at_start for item in split)
        assert split[2 - segment].energy_J(1e4) == 0.0 < split[segment - 1].energy_J(1e4)
