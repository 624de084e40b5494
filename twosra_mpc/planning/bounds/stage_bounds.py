"""Bounds of stages: which mode sequences each may have, and what is proved of all together.

The relaxation of several stages is that of ``sequence_bound`` over all of their phases: the bends
up to the end of each stage lead into what its goal allows, and all drives of a stage together take
what its ends are apart.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twosra_mpc.effort import once
from twosra_mpc.planning.bounds.bends import (
    BendingTask,
    Intervals,
    unreachable_reason,
)
from twosra_mpc.planning.bounds.sequence_bound import (
    Events,
    Relaxation,
    SequenceBound,
    bend_rows,
    longest_path_bound,
    mean_bends,
    quickest_bends,
)
from twosra_mpc.robot.modes import (
    Mode,
    ModeSequence,
    StartingStiffness,
    blocks_of,
    is_rigid,
    rigid_mode,
)

_ROUNDING = 1e-9  # of W

Shapes = tuple[tuple[float, ...], ...]  # (1 + n, 1 + n): most of W_i - W_j since t = 0; W_0 is 0


@dataclass(frozen=True, eq=False)
class StageBounds:
    """Mode sequences of a stage, and what is proved of each.

    Attributes:
        change: (low, high) of each segment: change of W since t = 0 where the stage ends.
        bend: What its modes must do, where the shapes at both of its ends are nearly known.
        modes: Modes that it may use.
        last: Stiffness at its end; None: any.
        most_phases: Of the sequences that are opened.
        final: Whether the plan ends with it: then segments may melt or freeze after its phases.
        drives_first: Whether it may begin with a drive.
        drives_last: Whether it may drive after its last soft phase.
        distance_m: How far b0 must come in it, at least; or in it and in those before it, since
            the last one of which it is known where it ends.
        since: How many stages these are.
        drive: What is enough -> least duration where it is nothing but a drive [s].
        least_s: Least duration [s].
        reshapes: Whether it is proved that it must reshape.
    """

    change: Intervals
    bend: BendingTask | None
    modes: Sequence[Mode]
    last: Mode | None
    most_phases: int
    final: bool = False
    drives_first: bool = True
    drives_last: bool = True
    distance_m: float = 0.0
    since: int = 1
    drive: Callable[[float], float] = lambda enough: 0.0
    least_s: float = 0.0
    reshapes: bool = False

    @cached_property
    def rigid(self) -> Mode:
        """The mode in which every segment is solid."""
        return rigid_mode(len(self.change))

    def opening(self, begins: StartingStiffness) -> ModeSequence:
        """The first drive if the robot is solid and may drive, else nothing."""
        drives = self.drives_first and self.rigid in self.modes and begins == self.rigid
        return (self.rigid,) if drives else ()

    def sequences(self, begins: StartingStiffness) -> Iterator[ModeSequence]:
        """Yield every sequence of up to ``most_phases`` phases from a stiffness on, short first."""
        heads = [self.opening(begins)]
        for length in range(self.most_phases + 1):
            if length:
                heads = [longer for head in heads for longer in self.longer(head, begins)]
            for head in heads:
                whole = self.closed(head, begins)
                if whole and len(whole) <= self.most_phases and self.misfit(whole) is None:
                    yield whole

    def longer(self, head: ModeSequence, begins: StartingStiffness) -> Iterator[ModeSequence]:
        """Yield a sequence with every mode that may follow."""
        for mode in self.modes:
            stays = mode == head[-1] if head else begins == self.rigid == mode
            if not stays:
                yield (*head, mode)

    def closed(self, head: ModeSequence, begins: StartingStiffness) -> ModeSequence | None:
        """The sequence that ends as the stage asks for; None if another head stands for it."""
        rigid, opening = self.rigid, head == (self.rigid,) and begins == self.rigid
        if self.last == rigid and rigid in self.modes and not opening:
            return None if head and head[-1] == rigid else (*head, rigid)
        if not (self.final or self.last in (None, *head[-1:])):
            return None
        return head or None

    def misfit(self, sequence: ModeSequence) -> str | None:
        """Reason why a sequence cannot be one of this stage."""
        if self.reshapes and not any(map(any, sequence)):
            return "a task must reshape"
        return self.unreachable(frozenset(sequence))

    @once
    def unreachable(self, modes: frozenset[Mode]) -> str | None:
        """Reason why these modes cannot bring about the bend, by what they keep; None otherwise."""
        return None if self.bend is None else unreachable_reason(sorted(modes), self.bend)

    @once
    def lacks(self, modes: frozenset[Mode]) -> int:
        """Number of soft modes that must follow these at least, of a stage that is possible."""
        if not self.unreachable(modes):
            return 0
        least = len(self.modes)
        for mode in self.modes:
            if least and any(mode) and mode not in modes:
                least = min(least, self.lacks(modes | {mode}))
        return 1 + least

    def settled(self, sequence: ModeSequence) -> Mode:
        """Stiffness after a sequence of it."""
        return self.last if self.final and self.last is not None else sequence[-1]

    @property
    def endings(self) -> Sequence[Mode]:
        """Stiffnesses in which it may end."""
        return self.modes if self.last is None else (self.last,)

    def moving(self, sequence: ModeSequence) -> list[bool]:
        """In which phases of a sequence something may move."""
        rests = not self.drives_last and len(sequence) > 1 and is_rigid(sequence[-1])
        return [True] * (len(sequence) - rests) + [False] * rests

    @cached_property
    def shapes(self) -> Shapes:
        """Shapes in which it ends, as far as its goal tells."""
        ends = [(0.0, 0.0), *((low - _ROUNDING, high + _ROUNDING) for low, high in self.change)]
        return tuple(
            tuple(0.0 if i == j else a[1] - b[0] for j, b in enumerate(ends))
            for i, a in enumerate(ends)
        )

    def ends_in(self, sequence: ModeSequence, shapes: Shapes) -> Shapes | None:
        """Shapes in which it ends with a sequence from one of these; None if there are none.

        A W rests while its segment is rigid, and all that are soft change by the same.
        """
        alike = list(zip(*((0, *mode) for mode in sequence), strict=True))
        most = [
            [min(now, end) if own == other else end for now, end, other in zip(*row, strict=True)]
            for own, *row in zip(alike, shapes, self.shapes, [alike] * len(alike), strict=True)
        ]
        count = range(len(most))
        for k in count:
            most = [[min(most[i][j], most[i][k] + most[k][j]) for j in count] for i in count]
        return tuple(map(tuple, most)) if all(most[i][i] >= 0.0 for i in count) else None

    @cached_property
    def alike(self) -> Hashable:
        """Key of all that bounds of the stage alone depend on."""
        bend = self.bend and (self.bend.change, self.bend.origin, self.bend.origin_within)
        moves = self.drives_first, self.drives_last, self.drive, self.reshapes, self.least_s
        return self.modes, self.last, self.final, self.most_phases, moves, bend


class Way(NamedTuple):
    """Way of moving on: whether it drives, and how many blocks of soft phases there are."""

    drives: bool = False
    blocks: int = 0

    def then(self, sequences: Sequence[ModeSequence], stages: Sequence[StageBounds]) -> Way:
        """The same after the sequences of further stages."""
        moving = [
            mode
            for stage, sequence in zip(stages, sequences, strict=False)
            for mode, moves in zip(sequence, stage.moving(sequence), strict=True)
            if moves
        ]
        return Way(self.drives or any(map(is_rigid, moving)), self.blocks + blocks_of(moving))


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


@dataclass(frozen=True, eq=False)
class Together:
    """Relaxation of all stages together, for one mode sequence of each.

    Attributes:
        events: Of all phases.
        stages: The stages.
        sequences: Their mode sequences.
        relaxation: Room, rates and speeds.
    """

    events: Events
    stages: Sequence[StageBounds]
    sequences: Sequence[ModeSequence]
    relaxation: StageRelaxation

    def bound(self) -> SequenceBound | None:
        """Solve it; None if it is infeasible.

        Where only time counts, and it is known which bends take least, that is a longest path.
        """
        stages, weights = self.stages, self.events.weights
        pairs = [(each, stage.bend) for each, stage in zip(self.sequences, stages, strict=True)]
        quickest = (quickest_bends(each, task, weights) for each, task in pairs if task is not None)
        known = [bends for bends in quickest if bends is not None]
        if len(known) < len(stages) or any(stage.distance_m for stage in stages):
            try:
                return self._program()
            except ArithmeticError:
                known = [
                    mean_bends(each, task) if task else np.zeros(len(each)) for each, task in pairs
                ]
        return longest_path_bound(self.events, np.concatenate(known))

    def _program(self) -> SequenceBound | None:
        """The linear program: the first stage's bends from the known start, then those of all."""
        sequences, weights, relaxation = self.sequences, self.events.weights, self.relaxation
        rates, efforts, told = list[float](), list[float](), 0
        if (task := self.stages[0].bend) is not None:
            own, told = bend_rows(sequences[0], task, weights), len(sequences[0])
            rates, efforts = own.rates, own.efforts
        later = self.events.network.sequence[told:]
        rates = [*rates, *(relaxation.rate(mode) if any(mode) else 0.0 for mode in later)]
        efforts = [*efforts, *[0.0] * len(later)] if weights.effort else []
        program = Relaxation(self.events, rates, efforts)
        if task is not None:
            program.bend(sequences[0], task, own)
        ends = [0, *itertools.accumulate(map(len, sequences))]
        stops = dict(zip(ends[1:], (stage.change for stage in self.stages), strict=True))
        for j, room in enumerate(relaxation.room() if later else ()):
            if not self._bends(program, stops, told, j, room):
                return None
        pairs = zip(self.stages, sequences, strict=True)
        moves = [moves for stage, sequence in pairs for moves in stage.moving(sequence)]
        for k, stage in enumerate(self.stages, start=1):
            moving = [i for i in range(ends[k - stage.since], ends[k]) if moves[i]]
            self._comes_as_far(program, moving, stage.distance_m)
        program.weigh_efforts()
        return program.optimum()

    def _bends(
        self,
        program: Relaxation,
        stops: Mapping[int, Intervals],
        told: int,
        segment: int,
        room: tuple[float, float],
    ) -> bool:
        """Keep the W of a segment within its room and the ends of stages; False if it cannot be.

        ``stops`` has the ends by the number of phases before; of the first ``told`` it is done.
        """
        bends = dict[int, float]()
        for i, mode in enumerate(self.events.network.sequence):
            if mode[segment]:
                bends[program.layout.count + i] = 1.0
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

    def _comes_as_far(self, program: Relaxation, phases: Sequence[int], distance_m: float) -> None:
        """Let all phases of a stage, and its drives alone, last as long as the way takes."""
        if distance_m <= 0.0:
            return
        sequence, layout = self.events.network.sequence, program.layout
        by_drives = [i for i in phases if is_rigid(sequence[i])]
        driven_m = self.relaxation.driven_m([sequence[i] for i in phases], distance_m)
        for moving, least in ((phases, distance_m), (by_drives, driven_m)):
            speeds = [self.relaxation.speed_m_s(sequence[i]) for i in moving]
            if least > 0.0 and all(map(math.isfinite, speeds)):
                terms: dict[int, float] = {}
                for i, speed in zip(moving, speeds, strict=True):
                    terms |= {layout.end(i): speed, layout.start(i): -speed}
                program.at_least(terms, least)
