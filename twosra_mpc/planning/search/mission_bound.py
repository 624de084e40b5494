"""Proved lower bounds on the cost of a mission whose mode sequence is known.

The relaxation of ``bounds`` over all stages together: the bends up to the end of each stage lead
into what its goal allows, and all drives of a stage together take what its ends are apart.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twosra_mpc.planning.search.bends import Intervals
from twosra_mpc.planning.search.bounds import Relaxation, SequenceBound
from twosra_mpc.planning.search.linear_program import proved_minimum
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, is_rigid
from twosra_mpc.timing import TemporalNetwork

_ROUNDING = 1e-9  # of W


@dataclass(frozen=True, eq=False)
class MissionRelaxation:
    """How far and how fast the bending coordinates may go.

    Attributes:
        room: Asks for (low, high) of each segment: change of W since t = 0 that limits allow.
        rate: Mode -> upper bound of abs(dW/dt), for every shape.
        speed_m_s: Mode -> upper bound of the speed of b0; infinite where none is known.
        soft_travel_m: How far b0 comes in a block of soft phases, at most.
    """

    room: Callable[[], Intervals]
    rate: Callable[[Mode], float]
    speed_m_s: Callable[[Mode], float]
    soft_travel_m: float

    def driven_m(self, sequence: Sequence[Mode], distance_m: float) -> float:
        """How far drives must come where a sequence comes so far."""
        soft = sum(1 for rigid, _ in itertools.groupby(sequence, key=is_rigid) if not rigid)
        return distance_m - soft * self.soft_travel_m if soft else distance_m


class StageEnd(NamedTuple):
    """Where a stage ends.

    Attributes:
        phases: Number of phases up to there, from the first one of the mission.
        change: (low, high) of every segment's change of W up to there.
        begun: Number of phases up to the end of a stage before it from which b0 must come here.
        distance_m: How far that is, at least.
    """

    phases: int
    change: Intervals
    begun: int
    distance_m: float


def mission_bound(
    network: TemporalNetwork,
    relaxation: MissionRelaxation,
    weights: Weights,
    least_durations: Sequence[float],
    ends: Sequence[StageEnd],
    resting: Collection[int],
) -> SequenceBound | None:
    """Solve the relaxation of a mission; None if it is infeasible.

    Args:
        network: Of all phases.
        relaxation: Room, rates and speeds.
        weights: Weights of the cost.
        least_durations: Of the phases [s].
        ends: The end of each stage.
        resting: Phases in which nothing moves.
    """
    sequence = network.sequence
    rates = [relaxation.rate(mode) if any(mode) else 0.0 for mode in sequence]
    program = Relaxation(network, weights, least_durations, rates)
    for j, room in enumerate(relaxation.room()):
        if not _bends(program, network, ends, j, room):
            return None
    for end in ends:
        moving = [i for i in range(end.begun, end.phases) if i not in resting]
        _comes_as_far(program, network, relaxation, moving, end.distance_m)
    return program.optimum()


def _bends(
    program: Relaxation,
    network: TemporalNetwork,
    ends: Sequence[StageEnd],
    segment: int,
    room: tuple[float, float],
) -> bool:
    """Keep the W of a segment within its room and the ends of stages; False if it cannot be."""
    stops, bends = {end.phases: end.change[segment] for end in ends}, dict[int, float]()
    for i, mode in enumerate(network.sequence):
        if mode[segment]:
            bends[network.layout.count + i] = 1.0
        allowed = [room] if mode[segment] else []
        allowed += [stops[i + 1]] if i + 1 in stops else []
        for low, high in allowed:
            if not bends and not low - _ROUNDING <= 0.0 <= high + _ROUNDING:
                return False
            for sign, least in ((1.0, low), (-1.0, -high)):
                if bends and math.isfinite(least):
                    program.at_least(dict.fromkeys(bends, sign), least)
    return True


def _comes_as_far(
    program: Relaxation,
    network: TemporalNetwork,
    relaxation: MissionRelaxation,
    phases: Sequence[int],
    distance_m: float,
) -> None:
    """Let all phases of a stage, and its drives alone, last as long as the way takes."""
    sequence = network.sequence
    by_drives = [i for i in phases if is_rigid(sequence[i])]
    without_blocks = relaxation.driven_m([sequence[i] for i in phases], distance_m)
    for moving, least in ((list(phases), distance_m), (by_drives, without_blocks)):
        speeds = [relaxation.speed_m_s(sequence[i]) for i in moving]
        if least > 0.0 and all(map(math.isfinite, speeds)):
            terms: dict[int, float] = {}
            for i, speed in zip(moving, speeds, strict=True):
                terms |= {network.layout.end(i): speed, network.layout.start(i): -speed}
            program.at_least(terms, least)


def reachable(changes: Sequence[Intervals], modes: Sequence[Sequence[Mode]]) -> bool:
    """Whether stages that use these soft modes can bend as they must, one after the other.

    Args:
        changes: (low, high) of every segment's change of W up to the end of each stage.
        modes: The soft modes of each stage.
    """
    columns = [mode for each in modes for mode in each]
    rows, limits, used = [np.zeros(len(columns))], [0.0], 0
    for change, each in zip(changes, modes, strict=True):
        used += len(each)
        for j, (low, high) in enumerate(change):
            row = np.array([mode[j] if i < used else 0 for i, mode in enumerate(columns)], float)
            for sign, limit in ((-1.0, -low), (1.0, high)):
                if not math.isfinite(limit):
                    continue
                if not row.any() and limit < -_ROUNDING:
                    return False
                rows.append(sign * row)
                limits.append(limit + _ROUNDING)
    if not columns:
        return True
    # If there is a solution there is one that solves some of the rows as equations. Their entries
    # are 0 and 1, so by Cramer and Hadamard it is no larger than this.
    n = len(columns)
    largest = n ** (n / 2 + 1) * float(np.abs(limits).max())
    bounds, none = [(-largest, largest)] * n, np.zeros(n)
    least, _ = proved_minimum(none, np.array(rows), np.array(limits), bounds, none)
    return least < math.inf
