"""Proved lower bounds on the cost of stages whose mode sequences are known.

The relaxation of ``bounds`` over all stages together: the bends up to the end of each stage lead
into what its goal allows, and all drives of a stage together take what its ends are apart.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twosra_mpc.planning.bounds.bends import Intervals
from twosra_mpc.planning.bounds.linear_program import proved_minimum
from twosra_mpc.planning.bounds.sequence_bound import (
    BendRows,
    Relaxation,
    SequenceBound,
    longest_path_bound,
    mean_bends,
    quickest_bends,
)
from twosra_mpc.planning.bounds.stage_bounds import StageBounds
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, blocks_of, is_rigid
from twosra_mpc.timing import TemporalNetwork

_ROUNDING = 1e-9  # of W


@dataclass(frozen=True, eq=False)
class StageRelaxation:
    """Relaxation of a stage: how far and how fast the bending coordinates may go.

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
        """Distance that drives must come where a sequence comes so far."""
        blocks = blocks_of(sequence)
        return distance_m - blocks * self.soft_travel_m if blocks else distance_m


def stages_bound(
    network: TemporalNetwork,
    stages: Sequence[StageBounds],
    sequences: Sequence[ModeSequence],
    relaxation: StageRelaxation,
    weights: Weights,
    least_durations: Sequence[float],
) -> SequenceBound | None:
    """Solve the relaxation of all stages together; None if it is infeasible.

    Where only time counts, and it is known which bends take least, that is a longest path.

    Args:
        network: Of all phases.
        stages: The stages.
        sequences: Their mode sequences.
        relaxation: Room, rates and speeds.
        weights: Weights of the cost.
        least_durations: Of the phases [s].
    """
    pairs = [(each, stage.bend) for each, stage in zip(sequences, stages, strict=True)]
    quickest = (quickest_bends(each, task, weights) for each, task in pairs if task is not None)
    known = [bends for bends in quickest if bends is not None]
    if len(known) < len(stages) or any(stage.distance_m for stage in stages):
        try:
            return _program(network, stages, sequences, relaxation, weights, least_durations)
        except ArithmeticError:
            known = [
                mean_bends(each, task) if task else np.zeros(len(each)) for each, task in pairs
            ]
    return longest_path_bound(network, np.concatenate(known), weights, least_durations)


def _program(
    network: TemporalNetwork,
    stages: Sequence[StageBounds],
    sequences: Sequence[ModeSequence],
    relaxation: StageRelaxation,
    weights: Weights,
    least_durations: Sequence[float],
) -> SequenceBound | None:
    """The linear program: the first stage's bends from the known start, then those of all."""
    rates, efforts, told, own = list[float](), list[float](), 0, None
    if (task := stages[0].bend) is not None:
        own = BendRows(sequences[0], task, weights)
        rates, efforts, told = own.rates, own.efforts, len(sequences[0])
    later = network.sequence[told:]
    rates = [*rates, *(relaxation.rate(mode) if any(mode) else 0.0 for mode in later)]
    efforts = [*efforts, *[0.0] * len(later)] if weights.effort else []
    program = Relaxation(network, weights, least_durations, rates, efforts)
    if own is not None:
        own.add_to(program)
    ends = [0, *itertools.accumulate(map(len, sequences))]
    stops = {ends[k]: stage.change for k, stage in enumerate(stages, start=1)}
    for j, room in enumerate(relaxation.room() if later else ()):
        if not _bends(program, network, stops, told, j, room):
            return None
    resting = _resting(stages, sequences)
    for k, stage in enumerate(stages, start=1):
        moving = [i for i in range(ends[k - stage.since], ends[k]) if i not in resting]
        _comes_as_far(program, network, relaxation, moving, stage.distance_m)
    program.weigh_efforts()
    return program.optimum()


def _resting(stages: Sequence[StageBounds], sequences: Sequence[ModeSequence]) -> list[int]:
    """Phases in which nothing moves."""
    pairs = zip(stages, sequences, strict=True)
    moving = [moves for stage, sequence in pairs for moves in stage.moving(sequence)]
    return [i for i, moves in enumerate(moving) if not moves]


def _bends(
    program: Relaxation,
    network: TemporalNetwork,
    stops: Mapping[int, Intervals],
    told: int,
    segment: int,
    room: tuple[float, float],
) -> bool:
    """Keep the W of a segment within its room and the ends of stages; False if it cannot be.

    Of so many first phases it is ``told`` already.
    """
    bends = dict[int, float]()
    for i, mode in enumerate(network.sequence):
        if mode[segment]:
            bends[network.layout.count + i] = 1.0
        if i < told:
            continue
        allowed = [room] if mode[segment] else []
        allowed += [stops[i + 1][segment]] if i + 1 in stops else []
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
    relaxation: StageRelaxation,
    phases: Sequence[int],
    distance_m: float,
) -> None:
    """Let all phases of a stage, and its drives alone, last as long as the way takes."""
    if distance_m <= 0.0:
        return
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
    """True if stages that use these soft modes can bend as they must, one after the other.

    Args:
        changes: (low, high) of every segment's change of W up to the end of each stage.
        modes: The soft modes of each stage.
    """
    columns, sums = [mode for each in modes for mode in each], list[list[int]]()
    for count, change in zip(itertools.accumulate(map(len, modes)), changes, strict=True):
        rest = [0] * (len(columns) - count)
        sums += [[mode[j] for mode in columns[:count]] + rest for j in range(len(change))]
    changed = np.array(sums, dtype=float).reshape(len(sums), len(columns))
    ends = np.array([ends for change in changes for ends in change]).T
    ends = ends + np.array([[-_ROUNDING], [_ROUNDING]])
    asked = np.isfinite(ends)
    some = asked.any(axis=0)
    middle = np.where(asked, ends, ends[::-1])[:, some].mean(axis=0)
    found = changed @ np.linalg.lstsq(changed[some], middle)[0]
    if ((ends[0] <= found) & (found <= ends[1])).all():  # as simple bends do
        return True
    if (~changed.any(axis=1) & ((ends[0] > 0) | (ends[1] < 0))).any():
        return False
    rows = np.concatenate([-changed[asked[0]], changed[asked[1]]])
    limits = np.concatenate([-ends[0, asked[0]], ends[1, asked[1]]])
    # If there is a solution there is one that solves some of the rows as equations. Their entries
    # are 0 and 1, so by Cramer and Hadamard it is no larger than this.
    n = len(columns)
    largest = n ** (n / 2 + 1) * float(np.abs(limits).max())
    bounds, none = [(-largest, largest)] * n, np.zeros(n)
    least, _ = proved_minimum(none, rows, limits, bounds, none)
    return least < math.inf
