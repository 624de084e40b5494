"""Transition times from the segments' state: bounds that nothing undercuts, and totals by hand."""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import bound_of, network_of, only_goal
from scipy.optimize import brentq
from thermal_problems import (
    SEQUENCES,
    SPANS_S,
    earliest_finish,
    history,
    phases_of,
    settled,
    thermal_model,
    thermal_problem,
    thermal_problems,
    transitions_of,
)

from twosra_mpc import Problem, load_problem
from twosra_mpc.planning.solver.sequence_solver import GoalSolver
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence
from twosra_mpc.thermal.least_times import LeastTimes
from twosra_mpc.thermal.model import SegmentModel, State
from twosra_mpc.timing import Transition

# --- nothing undercuts the network ---------------------------------------------------------------


@given(problem=thermal_problems(), sequence=SEQUENCES, spans=SPANS_S)
def test_no_history_undercuts_the_least_times_and_energies(
    problem: Problem, sequence: ModeSequence, spans: list[float]
) -> None:
    assert history(problem, sequence, spans).violated() == []


@given(
    problem=thermal_problems(ambient_C=1.0, transition_quantile=0.95),
    sequence=SEQUENCES,
    share=st.floats(0.0, 1.0),
)
def test_the_window_of_a_first_freeze_is_not_undercut_while_the_segment_cools_down(
    problem: Problem, sequence: ModeSequence, share: float
) -> None:
    """Hot metal may be cooled long before its heater is said to be off: 12 s were missing once."""
    model = thermal_model(problem)
    hot = problem.stiffness_thresholds_C[1] + 5.0
    if any(problem.start_mode):
        hot = problem.temperatures[problem.start_mode.index(1)]
    metal = model.plans[0].model
    cooling = metal.time_until(metal.initial(hot), 0.0, metal.liquid_level)
    assert history(problem, sequence, [share * cooling] * 34).violated() == []


@given(problem=thermal_problems(), sequence=SEQUENCES, spans=SPANS_S)
def test_a_settled_schedule_keeps_every_constraint_and_moves_on_no_plateau(
    problem: Problem, sequence: ModeSequence, spans: list[float]
) -> None:
    durations = spans[: len(sequence)]
    found = settled(problem, sequence, durations)
    assert found is not None
    assert found.violated() == []
    transitions = transitions_of(problem, found.network, found.times)
    assert len(transitions) == found.network.transitions
    for (mode, start, end), duration in zip(phases_of(found), durations, strict=True):
        assert end - start >= duration - 1e-6
        for j in (0, 1):
            soft = bool(problem.start_mode[j])
            for item in (item for item in transitions if item.segment == j + 1):
                assert item.heater_s - 1e-6 <= item.onset_s <= item.done_s
                assert end <= item.onset_s + 1e-6 or start >= item.done_s - 1e-6
                soft = item.to == "soft" if start >= item.done_s - 1e-6 else soft
            assert mode[j] == soft
    assert found.finish_s >= max([0.0, *(item.done_s for item in transitions)]) - 1e-6


class Changed(NamedTuple):
    """A melt or freeze that was seen: times and energies at its onset and end, and liquid for."""

    melts: bool
    onset_s: float
    done_s: float
    onset_J: float
    done_J: float
    liquid_s: float
    liquid_J: float


class Watched:
    """A segment under any currents: what it is, and every melt and freeze on the way.

    Metal that is liquid at the start and freezes partly, and melts again, may have a colder body
    than any plan leaves it: what is watched of such a segment ends there.
    """

    def __init__(self, model: SegmentModel, state: State, *, soft: bool) -> None:
        self.model, self.state = model, state
        solid = model.level(state) <= model.solid_level
        self.now = "liquid" if soft else "solid" if solid else "melting"
        self.t = self.energy = 0.0
        self.onset = self.molten = (0.0, 0.0)
        self.broken_off = False
        self.seen: list[Changed] = []

    def heat(self, current: float, duration: float, top: float) -> None:
        """Give this current for a while; from the level ``top`` on, none."""
        while duration > 0 and not self.broken_off:
            here = self.model.level(self.state)
            if here >= top:
                current = 0.0
            self._pass(self.model.level(self.model.propagate(self.state, current, 1e-6)) > here)
            marks = {self.model.solid_level, self.model.liquid_level, top} - {here}
            spans = {mark: self.model.time_until(self.state, current, mark) for mark in marks}
            mark = min(spans, key=lambda mark: spans[mark])
            step = min(spans[mark], duration)
            self.energy += self.model.energy_J(self.state, current, step)
            self.state = self.model.propagate(self.state, current, step)
            if step == spans[mark]:
                self.state = self.model.at_level(self.state, mark)
            self.t, duration = self.t + step, duration - step

    def _pass(self, rising: bool) -> None:
        """Take note of a threshold that is left now."""
        here, at = self.model.level(self.state), (self.t, self.energy)
        if here == self.model.solid_level:
            if self.now == "solid" and rising:
                self.now, self.onset = "melting", at
            elif self.now == "freezing" and not rising:
                self._done("solid")
            elif self.now == "melting" and not rising:
                self.now = "solid"
        elif here == self.model.liquid_level:
            if self.now == "liquid" and not rising:
                self.now, self.onset = "freezing", at
            elif self.now == "melting" and rising:
                self._done("liquid")
            elif self.now == "freezing" and rising:
                self.now, self.molten = "liquid", at
                self.broken_off |= not self.seen

    def _done(self, now: str) -> None:
        (onset, onset_J), (molten, molten_J) = self.onset, self.molten
        liquid = (onset - molten, onset_J - molten_J)
        seen = Changed(now == "liquid", onset, self.t, onset_J, self.energy, *liquid)
        self.seen.append(seen)
        self.now = now
        self.molten = (self.t, self.energy)


HEATED = st.lists(
    st.tuples(
        st.one_of(st.just(0.0), st.just(1.0), st.floats(0.0, 1.0)),
        st.one_of(st.floats(0.1, 20.0), st.floats(0.1, 300.0)),
    ),
    min_size=10,
    max_size=25,
)


@given(
    problem=thermal_problems(transition_quantile=None, heating="fastest"),
    pieces=HEATED,
    wait=st.floats(0.0, 300.0),
)
def test_no_currents_whatever_undercut_the_least_times_after_the_first_melt(
    problem: Problem, pieces: list[tuple[float, float]], wait: float
) -> None:
    """Any currents up to the set-point; before the first melt none, then all of it."""
    heating, start = thermal_model(problem).plans[0], problem.start_states[0]
    model, least = heating.model, LeastTimes(heating, start)
    top = model.level_at(heating.soft_setpoint_C)
    soft = bool(problem.start_mode[0])
    segment = Watched(model, start, soft=soft)
    if not soft:
        segment.heat(0.0, wait, top)
        melting = model.time_until(segment.state, heating.melt_current_A, model.liquid_level)
        segment.heat(heating.melt_current_A, melting * 1.0001, top)
    for share, duration in pieces:
        segment.heat(share * heating.melt_current_A, duration, top)
    for number, item in enumerate(segment.seen):
        spent, plateau = item.done_J - item.onset_J, item.done_s - item.onset_s
        if item.melts and number == 0:
            assert item.onset_s >= least.first_lead_s - 1e-6
            assert plateau >= least.first_melting_s - 1e-6
            assert item.done_J >= least.first_energy_J - 1e-6
        elif item.melts:
            assert plateau >= least.melting_s - 1e-6
            assert spent >= least.energy_J - 1e-6
        else:
            assert plateau >= least.freezing_s(number, item.liquid_s if number else 0.0) - 1e-6
            if number == 0:
                assert item.onset_s >= least.first_coasting_s - 1e-6
                assert item.done_s >= least.first_freezing_s - 1e-6
            else:
                assert item.liquid_J >= least.liquid_power_W * item.liquid_s - 1e-6


# --- totals by hand ------------------------------------------------------------------------------


class ByHand:
    """The lumped model of 2sra-v1 in closed form, from its geometry and materials."""

    current_A, ambient_C, melting_C, setpoint_C = 0.8, 25.0, 61.0, 65.0
    metal_kg = 7880 * 0.97 * math.pi / 4 * (0.007**2 - 0.005**2) * 0.04
    rubber_J_per_K = 1150 * 1300 * math.pi / 4 * (0.005**2 + 0.008**2 - 0.007**2) * 0.04
    wire_m, wire_m2 = 190 * math.pi * 0.0051, math.pi / 4 * 0.0001**2
    coil_J_per_K = 8960 * 385 * wire_m * wire_m2
    solid_J_per_K = 196 * metal_kg + rubber_J_per_K + coil_J_per_K
    liquid_J_per_K = 220 * metal_kg + rubber_J_per_K + coil_J_per_K
    latent_J = 26500 * metal_kg
    loss_W_per_K = 16 * math.pi * 0.008 * 0.04 + 0.002
    alpha = 3.93e-3
    resistance_ohm = 1.68e-8 * wire_m / wire_m2 * (1 + 5 * alpha)

    @classmethod
    def power_W(cls, temperature_C: float) -> float:
        """Heater power at full current."""
        return cls.current_A**2 * cls.resistance_ohm * (1 + cls.alpha * (temperature_C - 25))

    @classmethod
    def lead_s(cls, temperature_C: float) -> float:
        """Full current from this temperature to the melting point."""
        net = [cls.power_W(t) - cls.loss_W_per_K * (t - 25) for t in (temperature_C, cls.melting_C)]
        slope = cls.loss_W_per_K - cls.alpha * cls.current_A**2 * cls.resistance_ohm
        return cls.solid_J_per_K / slope * math.log(net[0] / net[1])

    @classmethod
    def cold_melt_J(cls) -> float:
        """Heat of the coil from ambient to molten: what is stored, and what is lost meanwhile."""
        slope = cls.loss_W_per_K - cls.alpha * cls.current_A**2 * cls.resistance_ohm
        warm_K_s = (cls.power_W(25.0) * LEAD - cls.solid_J_per_K * 36) / slope
        lost = cls.loss_W_per_K * (warm_K_s + 36 * MELT)
        return cls.solid_J_per_K * 36 + cls.latent_J + lost

    @classmethod
    def melting_s(cls) -> float:
        """Through the plateau at full current."""
        return cls.latent_J / (cls.power_W(cls.melting_C) - cls.loss_W_per_K * 36)

    @classmethod
    def freezing_s(cls) -> float:
        """Through the plateau without current."""
        return cls.latent_J / (cls.loss_W_per_K * 36)

    @classmethod
    def coasting_s(cls) -> float:
        """From the set-point to the melting point without current."""
        return cls.liquid_J_per_K / cls.loss_W_per_K * math.log(40 / 36)


LEAD, MELT, FREEZE = ByHand.lead_s(25.0), ByHand.melting_s(), ByHand.freezing_s()
BY_HAND: list[tuple[ModeSequence, float]] = [
    ((RIGID,), 0.0),
    ((RIGID, SOFT_1, RIGID), LEAD + MELT + FREEZE),
    ((RIGID, SOFT_BOTH, RIGID), LEAD + MELT + FREEZE),
    ((RIGID, SOFT_1, SOFT_BOTH, RIGID), LEAD + MELT + MELT + FREEZE),
    ((RIGID, SOFT_BOTH, SOFT_2, RIGID), LEAD + MELT + FREEZE + FREEZE),
    ((RIGID, SOFT_1, SOFT_2, RIGID), LEAD + MELT + FREEZE + FREEZE),
    ((RIGID, SOFT_1, RIGID, SOFT_2, RIGID), LEAD + MELT + FREEZE + MELT + FREEZE),
    ((RIGID, SOFT_1, RIGID, SOFT_1, RIGID), LEAD + MELT + FREEZE + MELT + FREEZE),
]


def test_the_times_of_the_papers_robot_are_those_of_its_materials() -> None:
    """At 0.8 A 63 s to melt, of which 37 s on the plateau; 235 s to freeze: as published waits."""
    times = [LEAD, MELT, FREEZE, ByHand.coasting_s()]
    assert times == pytest.approx([26.3, 36.4, 234.6, 18.8], abs=0.06)


@pytest.mark.parametrize(("sequence", "total"), BY_HAND)
def test_transitions_alone_take_the_time_calculated_by_hand(
    sequence: ModeSequence, total: float
) -> None:
    problem = thermal_problem()
    assert earliest_finish(network_of(problem, sequence)) == pytest.approx(total, abs=1e-6)
    found = settled(problem, sequence, [0.0] * len(sequence))
    assert found is not None
    assert found.finish_s == pytest.approx(total, abs=1e-6)


def remelted(gap_s: float) -> tuple[Transition, float, float]:
    """(second melt, end of the plan, energy) of two soft phases of 1 s with a drive in between."""
    problem = thermal_problem()
    found = settled(problem, (RIGID, SOFT_1, RIGID, SOFT_1, RIGID), [0.0, 1.0, gap_s, 1.0, 0.0])
    assert found is not None
    melts = [t for t in transitions_of(problem, found.network, found.times) if t.to == "soft"]
    return melts[1], found.finish_s, found.energy_J


def test_a_melt_right_after_a_freeze_needs_only_the_plateau() -> None:
    melt, _, _ = remelted(0.0)
    assert melt.onset_s - melt.heater_s == pytest.approx(0.0, abs=1e-6)
    assert melt.done_s - melt.onset_s == pytest.approx(MELT)


def test_a_segment_still_warm_melts_in_the_time_calculated_by_hand() -> None:
    """60 s apart: at 51.4 C the heater goes on, 7.0 s instead of 26.3 s to the melting point."""
    melt, _, _ = remelted(60.0)
    tau = ByHand.solid_J_per_K / ByHand.loss_W_per_K

    def late(cooled_s: float) -> float:  # cool, then heat: 60 s together
        warm = 25 + 36 * math.exp(-cooled_s / tau)
        return cooled_s + ByHand.lead_s(warm) - 60.0

    cooled = brentq(late, 0.0, 60.0)
    warm = 25 + 36 * math.exp(-cooled / tau)
    assert melt.onset_s - melt.heater_s == pytest.approx(ByHand.lead_s(warm), abs=1e-6)
    assert melt.onset_s - melt.heater_s == pytest.approx(7.05, abs=0.01)


def test_two_soft_phases_close_together_cost_less_than_two_cold_melts() -> None:
    """Of the 62.7 s and 298 J of a cold melt, 60 s after a freeze 43.4 s and 211 J are left."""
    gaps = (4000.0, 600.0, 60.0, 0.0)
    found = [remelted(gap) for gap in gaps]
    times = [melt.done_s - melt.heater_s for melt, _, _ in found]
    assert times[0] == pytest.approx(LEAD + MELT, abs=1e-3)
    assert times == sorted(times, reverse=True)
    assert times[2:] == pytest.approx([43.4, MELT], abs=0.05)
    energies = [energy - ByHand.cold_melt_J() for _, _, energy in found]  # of the second melt
    # Liquid for 1 s each, and heated for a sixth of it: not 1 J each.
    assert energies[0] == pytest.approx(ByHand.cold_melt_J() + 1.5, abs=0.5)
    assert energies == sorted(energies, reverse=True)
    assert energies[2:] == pytest.approx([211.3, 177.7], abs=0.1)
    # The drive hides the heating; without one only the plateau is left to wait for.
    ends = [end - gap for gap, (_, end, _) in zip(gaps, found, strict=True)]
    assert ends == pytest.approx([LEAD + MELT + FREEZE + 1 + MELT + 1 + FREEZE] * 4)


def test_the_plan_of_a_remelt_is_shorter_and_cheaper_than_with_cold_melts() -> None:
    sequence = (RIGID, SOFT_1, RIGID, SOFT_1, RIGID)
    costs = []
    for timing in ("nominal", "constant"):
        problem = load_problem("shape-change", timing=timing)
        network, bound = network_of(problem, sequence), bound_of(problem, sequence)
        assert bound is not None
        first = next(iter(GoalSolver(only_goal(problem))(network, bound)))
        assert first is not None
        found = first[1].with_plan().plan
        assert found.verification.ok
        costs.append(found.cost)
        motion = sum(phase.end_s - phase.start_s for phase in found.phases)
        by_hand = LEAD + MELT + FREEZE + MELT + FREEZE if timing == "nominal" else 596.0
        assert by_hand <= found.cost.time_s <= by_hand + motion + 1e-6
    assert costs[0].time_s < costs[1].time_s - 20.0
    assert costs[0].energy_J < costs[1].energy_J - 50.0
