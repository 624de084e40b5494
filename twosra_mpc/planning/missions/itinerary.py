"""The stops of a mission: blocks to carry out, boxes to pass, ends of stages, drives in between."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.missions.stages import Stage
from twosra_mpc.planning.obstacles.block import Block, Sweep, block, soft_runs
from twosra_mpc.planning.obstacles.itinerary import Stop, passing
from twosra_mpc.planning.obstacles.stations import Chain, Stations, around, shortest_chain
from twosra_mpc.problem.limits import broken_by_shapes
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence, is_rigid
from twosra_mpc.robot.poses import composed, inverse
from twosra_mpc.space.drives import Drives

_FINE = 10  # times as many nodes where something may be touched
_CANDIDATES, _REACH_M = 300, 0.4  # stations of a block, and how far from where it should be
_ENDS = 6  # of the stop before, about which places are tried
_AIMS = 40  # members of a goal that are tried
_AWAY_M = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16)  # from an object that was let go
_AWAY_RAD = np.linspace(-np.pi, np.pi, 16, endpoint=False)
_LEAVES_M = 0.12  # straight on, from an object that is free: past a disc that can be held
_LOOKS, _CHAINS = 60, 3  # for a stop

Bools = NDArray[np.bool_]
DrivesOf = Callable[[Stage, Array], Drives]


@dataclass
class Legs:
    """Stops with a leg before each of them, as they are put together.

    Attributes:
        stops: What is done between legs.
        drives: The drive before each stop; None: none.
        phases: Which phase each drive belongs to; None without one.
        ends: Number of stops up to the end of each stage.
        blocks: Inputs of each soft phase, by its number.
    """

    stops: list[Stop] = field(default_factory=list)
    drives: list[Drives | None] = field(default_factory=list)
    phases: list[int | None] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    blocks: dict[int, Array] = field(default_factory=dict)

    def add(self, stop: Stop, drive: Drives | None, phase: int | None) -> None:
        """One more stop, with the drive that leads to it."""
        self.stops.append(stop)
        self.drives.append(drive)
        self.phases.append(phase if drive is not None else None)


class Itinerary:
    """The stops of the stages of a mission, for one choice of bends.

    Args:
        problem: The problem.
        stages: Its stages.
        sequences: The mode sequence of each.
        bends: Change of W in each phase of each stage.
        drives_of: Drives of a stage in a shape.
    """

    def __init__(
        self,
        problem: Problem,
        stages: Sequence[Stage],
        sequences: Sequence[ModeSequence],
        bends: Sequence[Array],
        drives_of: DrivesOf,
    ) -> None:
        self.problem, self._drives_of = problem, drives_of
        self._shape = problem.start.configuration[POSE:]
        self._last = problem.start.configuration[None, :POSE]  # where the stop before may end
        self.legs, self.possible, first = Legs(), True, 0
        for stage, sequence, bend in zip(stages, sequences, bends, strict=True):
            self._add_stage(stage, sequence, bend, first)
            if not self.possible:
                return
            first += len(sequence)

    def _add_stage(self, stage: Stage, sequence: ModeSequence, bends: Array, first: int) -> None:
        runs = soft_runs(sequence)
        blocks = list(self._blocks(stage, sequence, runs, bends))
        if len(blocks) < len(runs):
            self.possible = False
            return
        shape = self._shape if not blocks else blocks[-1].shape
        end = self._end(stage, shape)
        passes = list(map(self._pass, stage.passes))
        drive, phase = self._drive(stage, sequence, 0, first)
        if not stage.drives_first and runs:
            drive = None
        for k, (run, made) in enumerate(zip(runs, blocks, strict=True)):
            if passes and drive is not None:
                for stop in passes:
                    self._put(stop, drive, phase)
                passes = []
            fixed = None
            if drive is None:
                fixed = self._last
            elif k == len(runs) - 1:
                fixed = self._before(end, made, drives_last=stage.drives_last)
            self._put(self._block(stage, made, fixed), drive, phase)
            self.legs.blocks |= {first + i: made.inputs[j] for j, i in enumerate(run)}
            self._shape = made.shape
            drive, phase = self._drive(stage, sequence, run[-1] + 1, first)
        if runs and not stage.drives_last:
            drive = None
        for stop in passes:
            self._put(stop, drive, phase)
        if end is None:
            end = self._aims(stage) if stage.away is None else self._retreat()
        self._put(self._ending(stage, end), drive, phase)
        self.legs.ends.append(len(self.legs.stops))

    def _put(self, stop: Stop, drive: Drives | None, phase: int | None) -> None:
        self.legs.add(stop, drive, phase)
        self._last = composed(stop.first, stop.displacement)

    def _drive(
        self, stage: Stage, sequence: ModeSequence, phase: int, first: int
    ) -> tuple[Drives | None, int | None]:
        """The drive that a phase is, in the shape the robot has by then."""
        if phase < len(sequence) and is_rigid(sequence[phase]):
            return self._drives_of(stage, self._shape), first + phase
        return None, None

    def _blocks(
        self, stage: Stage, sequence: ModeSequence, runs: Sequence[list[int]], bends: Array
    ) -> Iterator[Block]:
        """The blocks of a stage, as far as their shapes are allowed."""
        shape, robot = self._shape, self.problem.robot
        fine = _FINE if stage.touches else 1
        for run in runs:
            modes = [sequence[i] for i in run]
            made = block(robot, shape, modes, bends[run].tolist(), (1.0, 1.0), fine)
            far = float(np.hypot(*made.displacement[:2])) > robot.limits.soft_travel_m
            if far or broken_by_shapes(robot, made.nodes[:, POSE:]) is not None:
                return
            yield made
            shape = made.shape

    def _before(self, end: Array | None, made: Block, *, drives_last: bool) -> Array | None:
        """Where the last block of a stage should begin."""
        if end is None:
            return None
        if not drives_last:
            return composed(end, inverse(made.displacement))
        few = end[:: max(1, len(end) // _ENDS)]
        near = [around(pose, _CANDIDATES // len(few), _REACH_M) for pose in few]
        return composed(np.concatenate(near), inverse(made.displacement))

    def _block(self, stage: Stage, made: Block, begins: Array | None) -> Stop:
        sweep = Sweep(made, self.problem.robot, stage.world, stage.sagitta_m)
        if begins is None:
            few = self._last[:: max(1, len(self._last) // 4)]
            near = [around(pose, _CANDIDATES // len(few), _REACH_M) for pose in few]
            begins = np.concatenate(near)
        return _stop(made.displacement, begins, sweep.may_be_clear, sweep.clear)

    def _pass(self, task: Pass) -> Stop:
        return passing(task, self._last[:_ENDS])

    def _end(self, stage: Stage, shape: Array) -> Array | None:
        """Poses in which a stage may end, as far as they are known beforehand."""
        if stage.ends is not None or stage.away is not None:
            return stage.ends
        low, high = stage.goal.box(self.problem.start.configuration)
        if not np.isfinite(high[:POSE] - low[:POSE]).all():
            return None
        return _different(
            np.array([stage.goal.aim(np.append(pose, shape))[:POSE] for pose in self._last[:1]])
        )

    def _aims(self, stage: Stage) -> Array:
        """Members of a goal that leaves part of the pose free, near where the robot is."""
        few = self._last[:: max(1, len(self._last) // _AIMS)]
        aims = [stage.goal.aim(np.append(pose, self._shape))[:POSE] for pose in few]
        return _different(np.array(aims))

    def _retreat(self) -> Array:
        """Poses away from where an object was let go."""
        few = self._last[:: max(1, len(self._last) // 24)]
        ways = [
            (far * np.cos(angle), far * np.sin(angle), 0.0)
            for far in _AWAY_M
            for angle in (_AWAY_RAD if far else _AWAY_RAD[:1])
        ]
        return composed(few[:, None], np.array(ways)[None]).reshape(-1, POSE)

    def _ending(self, stage: Stage, ends: Array) -> Stop:
        if stage.away is None:
            return _stop(np.zeros(POSE), ends, _all, lambda _: True)
        away = self._drives_of(replace(stage, world=stage.away), self._shape)

        def may_be_clear(poses: Array) -> Bools:
            return np.asarray(away.clear(poses) >= away.kept_m)

        def can_leave(pose: Array) -> bool:
            ways = _LEAVES_M * np.column_stack(
                [np.cos(_AWAY_RAD), np.sin(_AWAY_RAD), 0 * _AWAY_RAD]
            )
            legs = np.tile(pose, (len(ways), 1)), composed(pose, ways)
            return bool(away.clear_legs(*legs).any())

        return _stop(np.zeros(POSE), ends, may_be_clear, can_leave)

    def chain(self, hidden_s: Callable[[int], float]) -> Chain | None:
        """The best chain found; ``hidden_s`` tells what the drive of a phase may take."""
        legs = self.legs
        shared = [hidden_s(p) / legs.phases.count(p) if p is not None else 0.0 for p in legs.phases]
        layers = []
        for stop in legs.stops:
            clear = stop.first[stop.may_be_clear(stop.first)]
            layers.append(Stations(clear, composed(clear, stop.displacement)))
        return shortest_chain(
            self.problem.start.configuration[:POSE],
            lambda poses: poses,
            layers,
            lambda k, pose: legs.stops[k].clear(pose),
            [*legs.drives, None],
            [*shared, 0.0],
            _LOOKS * len(layers),
            _CHAINS,
        )


def _stop(
    displacement: Array,
    first: Array,
    may_be_clear: Callable[[Array], Bools],
    clear: Callable[[Array], bool],
) -> Stop:
    return Stop(displacement, may_be_clear, clear, lambda _: first, first, lambda: first)


def _all(poses: Array) -> Bools:
    return np.ones(len(poses), dtype=bool)


def _different(poses: Array) -> Array:
    """The poses without repetitions, in their order."""
    _, first = np.unique(poses.round(9), axis=0, return_index=True)
    found: Array = poses[np.sort(first)]
    return found


def routes_of(chain: Chain, legs: Legs) -> dict[int, Array]:
    """Via poses of the drive of each phase."""
    routes: dict[int, list[Array]] = {}
    for route, phase in itertools.zip_longest(chain.routes, legs.phases):
        if phase is not None:
            routes.setdefault(phase, []).append(route)
    return {phase: np.concatenate(parts) for phase, parts in routes.items()}
