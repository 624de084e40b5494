"""What a transition is, and what every model of transition times offers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol

from twosra_mpc.robot.modes import Mode, ModeSequence, Stiffness
from twosra_mpc.timing.network import TemporalNetwork


class Transition(NamedTuple):
    """One melt or freeze of a segment (1 or 2), times in s.

    ``heater_s`` is when its heater goes on (melt) or off (freeze), ``onset_s`` from when on the
    segment may be changing, ``done_s`` when it surely has changed.
    """

    segment: Literal[1, 2]
    to: Stiffness
    heater_s: float
    onset_s: float
    done_s: float


class TransitionModel(Protocol):
    """How long melting and freezing take, and what may happen meanwhile."""

    def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
        """Why no heating with each heater on once around a soft phase gives it, or None."""

    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        """Difference constraints that every plan of a mode sequence satisfies.

        Args:
            sequence: Mode of each phase.
            last: Stiffness at the end.
            least_durations: Proved least duration of each phase [s].
        """

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        """What a schedule really needs: constraints that ``times`` violate, raised; else None."""

    def transitions(self, network: TemporalNetwork, times: Sequence[float]) -> list[Transition]:
        """Melts and freezes of a sequence with these event times, by heater time."""


def number_of(segment: int) -> Literal[1, 2]:
    """Segments are counted from 1 where people read them."""
    return 2 if segment else 1
