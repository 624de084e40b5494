"""Transitions, and the interface of every model of transition times."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, singledispatch
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, ModeSequence, StartingStiffness, Stiffness
from twosra_mpc.robot.timing import Timing
from twosra_mpc.timing.network import Dwell, Event, TemporalNetwork, overlaps, refused


class Transition(NamedTuple):
    """Melt or freeze of a segment (1 to n), times in s.

    ``heater_s`` is when its heater goes on (melt) or off (freeze), ``onset_s`` from when on the
    segment may be changing, ``done_s`` when it surely has changed.
    """

    segment: int
    to: Stiffness
    heater_s: float
    onset_s: float
    done_s: float


@dataclass(frozen=True)
class SegmentHeating(ABC):
    """Heater and state of a segment over time; times in s, arrays of the times' shape.

    Attributes:
        molten_at_start: Melt fraction at t = 0: 1 if the segment is liquid.
        transitions: Its transitions in order.
    """

    molten_at_start: float
    transitions: tuple[Transition, ...]

    @abstractmethod
    def event_times(self) -> list[float]:
        """Times at which set-point, current or state change [s]."""

    @abstractmethod
    def setpoint_C(self, t: Array) -> Array:
        """Temperature set-point from each time to the next [C]."""

    @abstractmethod
    def current_A(self, t: Array) -> Array:
        """Heater current from each time to the next [A]."""

    @abstractmethod
    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        """Expected temperature [C] and melt fraction, from 0 (solid) to 1 (liquid)."""

    def body_C(self, t: Array) -> Array | None:
        """Expected temperature of what is around the metal [C]; None: it is as warm."""
        del t
        return None

    @abstractmethod
    def energy_J(self, until_s: float) -> float:
        """Heater energy from t = 0."""

    def soft(self, t: Array) -> NDArray[np.bool_]:
        """True where the segment is liquid: after a melt is done, before the next freeze begins."""
        value = np.full(t.shape, self.molten_at_start == 1)
        for item in self.transitions:
            value[t >= (item.done_s if item.to == "soft" else item.onset_s)] = item.to == "soft"
        return value


@dataclass(frozen=True)
class TransitionModel(ABC):
    """Model of the times of melts and freezes in a problem, and of what may happen meanwhile.

    Attributes:
        times: The timing that the problem names.
        problem: The problem.
    """

    times: Timing
    problem: Problem

    @cached_property
    def first(self) -> StartingStiffness:
        """Stiffness at t = 0."""
        return self.problem.start_stiffness

    @property
    def kinds(self) -> Sequence[int]:
        """A number for each segment: those with the same one take the same times."""
        return range(len(self.first))

    def ordered(self, modes: ModeSequence) -> ModeSequence:
        """Modes that take the same times, with segments that are alike in one order."""
        rows = sorted(zip(self.kinds, *modes, strict=True))
        return tuple(zip(*(row[1:] for row in rows), strict=True))

    @property
    @abstractmethod
    def words(self) -> str:
        """The times in words, to complete "it holds for"."""

    @property
    def policy(self) -> str:
        """Heating policy in words: that of every plan that bounds are about."""
        heater = self.problem.robot.heater
        warm = ", solid segments kept warm where that costs less"
        return (
            f"one heating policy: {heater.melt_current_A:zg} A until the set-point of"
            f" {heater.soft_setpoint_C:zg} °C, then hold"
            f"{warm if self.problem.heating == 'keep_warm' else ''}"
        )

    def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
        """Reason why no heating with each heater on once around a soft phase gives it, or None."""
        if self.problem.heaters_at_once == 1:
            for one, two, mode in overlaps(sequence, self.first, last):
                if not self.coasts(one, two) and not self.coasts(two, one):
                    return refused(mode)
        return None

    def coasts(self, liquid: Dwell, other: Dwell) -> bool:
        """True if a segment might stay liquid without heat while another one melts."""
        del liquid, other
        return False

    def sharing(
        self, network: TemporalNetwork
    ) -> Iterator[list[tuple[Event | None, Event, Event]]]:
        """Yield (melt, freeze, melt of another) of metal that coasts while the other one melts.

        Of two that melt in the same gap either may go first; first here the one that freezes first.
        There is none where neither freezes any more.
        """
        for pair in overlaps(network.sequence, self.first, network.last):
            found = [
                (a.melt, a.freeze, b.melt)
                for a, b in itertools.permutations(pair[:2])
                if a.freeze and b.melt and self.coasts(a, b)
            ]
            yield sorted(found, key=lambda turn: turn[1].gap)

    @abstractmethod
    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        """Difference constraints that every plan of a mode sequence satisfies.

        Args:
            sequence: Mode of each phase.
            last: Stiffness at the end.
            least_durations: Proved least duration of each phase [s].
        """

    def onward(
        self, mode: Mode, missing: frozenset[int], modes: Sequence[Mode], last: Mode
    ) -> float | None:
        """Least cost of all melts and freezes from a phase on to the end, by the problem's weights.

        None where it depends on what came before: then no phase that is appended to a sequence
        makes its melts and freezes end sooner or cost less, which is what the search relies on.

        Args:
            mode: Of the phase.
            missing: Segments (from 0) that must be soft in some phase after it.
            modes: Modes that may be used.
            last: Stiffness at the end.
        """
        del mode, missing, modes, last
        return None

    def with_delays(
        self, network: TemporalNetwork, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        """Return a network for bounds: what it takes longer if melts begin later, if anything."""
        del least_durations
        return network

    @abstractmethod
    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        """Network with the constraints that ``times`` violate raised; None if there is none."""

    def left(self, segment: int, to: Stiffness) -> float:
        """Share of the first change of a segment (from 0) that is still to come at t = 0."""
        molten = self.problem.melt_fractions[segment]
        return 1.0 - molten if to == "soft" else molten

    def transitions(self, network: TemporalNetwork, times: Sequence[float]) -> list[Transition]:
        """Melts and freezes of a sequence with these event times, by heater time."""
        made = self.made(network, times)
        return sorted(made, key=lambda item: (item.heater_s, item.segment))

    @abstractmethod
    def made(self, network: TemporalNetwork, times: Sequence[float]) -> Iterator[Transition]:
        """Yield them in any order."""

    def heating(self, transitions: Sequence[Transition]) -> tuple[SegmentHeating, ...]:
        """Heating of each segment, given all melts and freezes of a plan."""
        segments = range(len(self.first))
        return tuple(self.segment_heating(j, own_transitions(transitions, j)) for j in segments)

    @abstractmethod
    def segment_heating(self, segment: int, own: tuple[Transition, ...]) -> SegmentHeating:
        """Heating of a segment (from 0) that makes these transitions."""

    def violations(
        self, item: Transition, before: Transition | None, others: Sequence[Transition]
    ) -> Iterator[str]:
        """Violations of the constants by a transition: an independent check, not of the network.

        Nothing, if the times come from the segments: replaying the heater currents tells.

        Args:
            item: The transition.
            before: The one before it of the same segment.
            others: All of the plan.
        """
        del item, before, others
        return iter(())


@lru_cache(maxsize=8)
def transition_model(problem: Problem) -> TransitionModel:
    """The transition model of the timing that a problem names; the same one when asked again."""
    return model_of(problem.transition_times, problem)


@singledispatch
def model_of(times: Timing, problem: Problem) -> TransitionModel:
    """Build the transition model of a set of times; each kind registers its own here."""
    raise NotImplementedError(f"no transition model is registered for {type(times).__name__}")


def own_transitions(transitions: Sequence[Transition], segment: int) -> tuple[Transition, ...]:
    """Return those of a segment (from 0)."""
    return tuple(item for item in transitions if item.segment == segment + 1)
