"""The stops of a plan: blocks to carry out, boxes to pass, ends of stages, with drives between."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.solver.block import Block, Shares, Sweep, block
from twosra_mpc.planning.solver.stations import HIDDEN_S, Chain, Stations, around, between, chains
from twosra_mpc.planning.stages.variants import Placement
from twosra_mpc.problem.limits import broken_by_shapes, levers_kept
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.robot.modes import ModeSequence, is_rigid, soft_runs
from twosra_mpc.space.drives import Drives

_FINE = 10  # times as many nodes where something may be touched
_CANDIDATES, _REACH_M = 600, 0.4  # stations of a block, and how far from where it should be
_OF_SEVERAL = 300  # the same, of each block of several stages
_NEAR_M = 0.1  # from a station found, where better ones may be
_PASSES = 60  # candidates about each end
_INSIDE_M = 5e-3  # of a box if it is as wide, and rad
_ENDS = 6  # of the stop before, about which places are tried
_AIMS = 40  # members of a goal that are tried
_AWAY_M = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16)  # from an object that was let go
_AWAY_RAD = np.linspace(-np.pi, np.pi, 16, endpoint=False)
_LEAVES_M = 0.12  # straight on, from an object that is free: past a disc that can be held
_LOOKS = 60  # drives and sweeps that are looked at; of several stages, for each stop
_CHAINS, _CHAINS_OF_BLOCKS, _CHAINS_OF_STAGES = 6, 2, 3  # compared
_MOST_POSES = 1500  # all over the plane
_MOST_ORDERS = 30  # of drives in which boxes are passed
_WITHIN = 0.9  # of the half-widths of a goal: how far from its middle is aimed, at most
_SHARES = np.linspace(0.0, 1.0, 33)[:, None]  # of the way from there to what is clearest
_AROUND = np.array([*itertools.product((0.0, -1.0, 1.0), repeat=POSE)])

Bools = NDArray[np.bool_]
DrivesOf = Callable[[Placement, Array], Drives]


class Stop(NamedTuple):
    """Stop between two drives, and what is done there.

    Attributes:
        displacement: Pose of b0 afterwards, as seen from where it was, (3,).
        may_be_clear: (poses in which it begins (m, 3)) -> which of them to look at, (m,).
        clear: (pose in which it begins) -> whether it is clear.
        moved: (poses) -> candidates of the pose in which it begins, made of these.
        first: Candidates to begin with, (m, 3).
        everywhere: Makes candidates all over the plane, where those lead nowhere.
    """

    displacement: Array
    may_be_clear: Callable[[Array], Bools]
    clear: Callable[[Array], bool]
    moved: Callable[[Array], Array]
    first: Array
    everywhere: Callable[[], Array]


@dataclass
class Legs:
    """Stops with a leg before each of them, as they are put together, and a last leg.

    Attributes:
        stops: What is done between legs.
        drives: The drive of each leg; None: none.
        phases: Which phase each drive belongs to; None without one.
    """

    stops: list[Stop] = field(default_factory=list)
    drives: list[Drives | None] = field(default_factory=list)
    phases: list[int | None] = field(default_factory=list)

    def add(self, drive: Drives | None, phase: int | None, stop: Stop | None = None) -> None:
        """One more leg, and the stop that it leads to."""
        self.stops += [stop] if stop is not None else []
        self.drives.append(drive)
        self.phases.append(phase if drive is not None else None)


class Itinerary:
    """The stops of stages, for one choice of bends.

    Args:
        problem: The problem.
        stages: Its stages.
        sequences: The mode sequence of each.
        bends: Change of W in each phase of each stage.
        shares: Of the travel of the two locomotion units.
        drives_of: Drives of a stage in a shape.
    """

    def __init__(
        self,
        problem: Problem,
        stages: Sequence[Placement],
        sequences: Sequence[ModeSequence],
        bends: Sequence[Array],
        shares: Shares,
        drives_of: DrivesOf,
    ) -> None:
        self.problem, self.stages, self.sequences = problem, stages, sequences
        self._drives_of, self._start = drives_of, problem.start.configuration[:POSE]
        self._candidates = _CANDIDATES if len(stages) == 1 else _OF_SEVERAL
        self.blocks, self.shapes = list[list[Block]](), [problem.start.configuration[POSE:]]
        self.possible = True
        for stage, sequence, bend in zip(stages, sequences, bends, strict=True):
            shape, runs = self.shapes[-1], soft_runs(sequence)
            made = list(_blocks(problem, stage, shape, sequence, bend, shares))
            self.possible &= len(made) == len(runs)
            self.blocks.append(made)
            self.shapes.append(made[-1].shape if made else shape)

    @property
    def inputs(self) -> dict[int, Array]:
        """Inputs of each soft phase, by its number."""
        firsts = [0, *itertools.accumulate(map(len, self.sequences))]
        return {
            first + i: made.inputs[j]
            for first, sequence, blocks in zip(firsts, self.sequences, self.blocks, strict=False)
            for run, made in zip(soft_runs(sequence), blocks, strict=True)
            for j, i in enumerate(run)
        }

    def chains(self, hidden_s: Sequence[float]) -> Iterator[tuple[float, dict[int, Array]]]:
        """Yield what drives add [s], and the via poses of each drive's phase; then less and less.

        Boxes are passed in any of a stage's drives, in their order.

        Args:
            hidden_s: What the drive of each phase may take without making the plan longer [s].
        """
        least = math.inf
        for passed_in in itertools.islice(self._orders(), _MOST_ORDERS):
            legs = _Stops(self, passed_in).legs
            for found in self._shorter(legs, hidden_s):
                if found.cost_s < least:
                    least = found.cost_s
                    yield least, _by_phase(found, legs)
            if least <= HIDDEN_S:
                return

    def _orders(self) -> Iterator[tuple[tuple[int, ...], ...]]:
        """In which drives of its stage each box is passed."""
        choices = []
        for stage, sequence in zip(self.stages, self.sequences, strict=True):
            usable = [k for k in range(len(soft_runs(sequence)) + 1) if drives(stage, sequence, k)]
            choices.append(itertools.combinations_with_replacement(usable, len(stage.passes)))
        yield from itertools.product(*choices)

    def _shorter(self, legs: Legs, hidden_s: Sequence[float]) -> Iterator[Chain]:
        """First by stations all around; where drives cost time, then by others near those found.

        Of several stages only the first: nearer stations cost more time than they save.
        """
        stops, best = legs.stops, None
        for best in self._chains(legs, [stop.first for stop in stops], hidden_s):
            yield best
        if best is None and stops:
            for best in self._chains(legs, [stop.everywhere() for stop in stops], hidden_s):
                yield best
        if best is None or not stops or best.cost_s <= HIDDEN_S or len(self.stages) > 1:
            return
        nearer = [
            stop.moved(around(begin, self._candidates, _NEAR_M))
            for stop, begin in zip(stops, best.begins, strict=True)
        ]
        if self.stages[-1].reaches:
            end = composed(best.begins[-1], stops[-1].displacement)
            ends = between(self._goals(end[None])[0], end, self._candidates)
            back = composed(ends, inverse(stops[-1].displacement))
            nearer[-1] = np.vstack([nearer[-1], stops[-1].moved(back)])
        yield from self._chains(legs, nearer, hidden_s)

    def _chains(
        self, legs: Legs, begins: Sequence[Array], hidden_s: Sequence[float]
    ) -> Iterator[Chain]:
        layers = []
        for stop, begin in zip(legs.stops, begins, strict=True):
            clear = begin[stop.may_be_clear(begin)]
            layers.append(Stations(clear, composed(clear, stop.displacement)))
        phases = legs.phases
        most = _CHAINS if sum(map(len, self.blocks)) < 2 else _CHAINS_OF_BLOCKS
        return chains(
            self._start,
            self._goals if self.stages[-1].reaches else lambda poses: poses,
            layers,
            lambda k, pose: legs.stops[k].clear(pose),
            legs.drives,
            [hidden_s[p] / phases.count(p) if p is not None else 0.0 for p in phases],
            _LOOKS * (1 if len(self.stages) == 1 else len(layers)),
            most if len(self.stages) == 1 else _CHAINS_OF_STAGES,
        )

    def _goals(self, poses: Array) -> Array:
        """Members of the last goal to aim at from poses (m, 3) in the last shape, (m, 3).

        Where the one to aim at is too near to something, the first clear one on the way to the
        clearest of the box around it.
        """
        stage, sequence, shape = self.stages[-1], self.sequences[-1], self.shapes[-1]
        found, goal = aims(stage, poses, shape), stage.goal
        if goal.is_box and drives(stage, sequence, len(soft_runs(sequence))):
            last = self._drives_of(stage, shape)
            several, of = np.unique(found, axis=0, return_inverse=True)
            for i in np.flatnonzero(last.clear(several) < last.kept_m):
                low, high = (end[:POSE] for end in goal.box(np.append(several[i], shape)))
                half = np.where(np.isfinite(high - low), _WITHIN * (high - low) / 2, 0.0)
                members = several[i] + half * _AROUND
                clearest = members[last.clear(members).argmax()]
                nearer = several[i] + _SHARES * (clearest - several[i])
                several[i] = nearer[(last.clear(nearer) >= last.kept_m).argmax() or -1]
            found = several[of.ravel()]
        return found


class _Stops:
    """The stops of an itinerary, one after the other; ``ends`` is where the last one may end."""

    def __init__(self, whole: Itinerary, passed_in: Sequence[Sequence[int]]) -> None:
        self.whole, self.legs, self.ends = whole, Legs(), whole._start[None]
        first = 0
        for k, (sequence, passed) in enumerate(zip(whole.sequences, passed_in, strict=True)):
            self._add_stage(k, passed, first)
            first += len(sequence)

    def _add_stage(self, number: int, passed_in: Sequence[int], first: int) -> None:
        whole, stage = self.whole, self.whole.stages[number]
        sequence, blocks = whole.sequences[number], whole.blocks[number]
        shape, begun = whole.shapes[number], self.ends
        runs = soft_runs(sequence)
        befores = [0, *(run[-1] + 1 for run in runs)]
        for k, before in enumerate(befores):
            drive = whole._drives_of(stage, shape) if drives(stage, sequence, k) else None
            for task, of in zip(stage.passes, passed_in, strict=True):
                if of == k:
                    ends = np.vstack([begun[:_ENDS], self._known_ends(stage, begun, shape)])
                    self._put(drive, first + before, passing(task, ends))
            if k < len(blocks):
                last = k + 1 == len(blocks)
                begins = self._begins(stage, blocks[k], begun, last=last)
                begins = begins if drive is not None else self.ends
                stop = self._block(stage, blocks[k], begins, drive, aside=not last)
                self._put(drive, first + before, stop)
                shape = blocks[k].shape
        for pose in stage.via:
            stop = _stop(np.zeros(POSE), pose[None], _all, lambda _: True)
            self._put(drive, first + befores[-1], stop)
        if number + 1 < len(whole.stages) or not stage.reaches:
            self._put(drive, first + befores[-1], self._ending(stage, shape))
            drive = None
        if number + 1 == len(whole.stages):
            self.legs.add(drive, first + befores[-1])

    def _put(self, drive: Drives | None, phase: int, stop: Stop) -> None:
        self.legs.add(drive, phase, stop)
        self.ends = composed(stop.first, stop.displacement)

    def _known_ends(self, stage: Placement, begun: Array, shape: Array) -> Array:
        """Poses in which a stage should end, as far as they are known beforehand; else none."""
        if stage.ends is not None:
            return stage.ends
        return aims(stage, begun[:1], shape) if stage.away is None else np.zeros((0, POSE))

    def _begins(self, stage: Placement, made: Block, begun: Array, *, last: bool) -> Array:
        """Poses where a block may begin: about where the stage began, or to end about its end.

        A block after which there is no drive ends in the end itself.
        """
        ends, count = self._known_ends(stage, begun, made.shape), self.whole._candidates
        if last and len(ends) and not stage.drives_last:
            return composed(ends, inverse(made.displacement))
        at_end = last and len(ends)
        few = ends[:: max(1, len(ends) // _ENDS)] if at_end else begun[:: max(1, len(begun) // 4)]
        near = np.concatenate([around(pose, count // len(few), _REACH_M) for pose in few])
        return composed(near, inverse(made.displacement)) if at_end else near

    def _block(
        self, stage: Placement, made: Block, begins: Array, drive: Drives | None, *, aside: bool
    ) -> Stop:
        robot = self.whole.problem.robot
        sweep = Sweep(made, robot, stage.world, stage.sagitta_m)
        stop = _stop(made.displacement, begins, sweep.may_be_clear, sweep.clear)
        if drive is None or not (aside or stage.drives_last):
            return stop
        return stop._replace(moved=np.copy, everywhere=partial(drive.spread, _MOST_POSES))

    def _ending(self, stage: Placement, shape: Array) -> Stop:
        """The end of a stage: one of its poses, or members of its goal, or away from a thing."""
        if stage.away is None:
            few = self.ends[:: max(1, len(self.ends) // _AIMS)]
            ends = _different(aims(stage, few, shape)) if stage.ends is None else stage.ends
            return _stop(np.zeros(POSE), ends, _all, lambda _: True)
        away = self.whole._drives_of(replace(stage, world=stage.away), shape)

        def may_be_clear(poses: Array) -> Bools:
            return np.asarray(away.clear(poses) >= away.kept_m)

        def can_leave(pose: Array) -> bool:
            ways = _LEAVES_M * np.column_stack(
                [np.cos(_AWAY_RAD), np.sin(_AWAY_RAD), 0 * _AWAY_RAD]
            )
            legs = np.tile(pose, (len(ways), 1)), composed(pose, ways)
            return bool(away.clear_legs(*legs).any())

        return _stop(np.zeros(POSE), self._retreat(), may_be_clear, can_leave)

    def _retreat(self) -> Array:
        """Poses away from where an object was let go."""
        few = self.ends[:: max(1, len(self.ends) // 24)]
        ways = [
            (far * np.cos(angle), far * np.sin(angle), 0.0)
            for far in _AWAY_M
            for angle in (_AWAY_RAD if far else _AWAY_RAD[:1])
        ]
        return composed(few[:, None], np.array(ways)[None]).reshape(-1, POSE)


def drives(stage: Placement, sequence: ModeSequence, k: int) -> bool:
    """True if a stage drives before its block ``k``, or after all of them."""
    runs = soft_runs(sequence)
    if runs and ((k == 0 and not stage.drives_first) or (k == len(runs) and not stage.drives_last)):
        return False
    phase = 0 if k == 0 else runs[k - 1][-1] + 1
    return phase < len(sequence) and is_rigid(sequence[phase])


def aims(stage: Placement, poses: Array, shape: Array) -> Array:
    """Members of a stage's goal to aim at from poses (m, 3) in a shape, (m, 3)."""
    found = [stage.goal.aim(np.append(pose, shape))[:POSE] for pose in poses]
    return np.array(found).reshape(-1, POSE)


def passing(task: Pass, ends: Array) -> Stop:
    """A box to pass on the way between poses (m, 3), the last of them the goal."""
    low, high = task.ends
    inset = np.minimum(_INSIDE_M, (high - low) / 4)

    def moved(poses: Array) -> Array:
        poses = np.clip(poses, [*(low + inset)[:2], -np.inf], [*(high - inset)[:2], np.inf])
        if np.isfinite(high[2] - low[2]):
            middle, half = (high[2] + low[2]) / 2, (high[2] - low[2]) / 2 - inset[2]
            off = (poses[:, 2] - middle + np.pi) % (2 * np.pi) - np.pi
            poses[:, 2] = middle + np.clip(off, -half, half)
        return poses

    widely = [around(pose, _PASSES, 2 * _REACH_M) for pose in ends]
    first = moved(np.concatenate(widely))
    if np.isfinite([low[:2], high[:2]]).all():
        first = np.vstack(
            [first, moved(around(_middle(low, high, ends[-1]), _CANDIDATES, _REACH_M))]
        )
    return Stop(np.zeros(POSE), _all, lambda _: True, moved, first, lambda: first)


def _blocks(
    problem: Problem,
    stage: Placement,
    shape: Array,
    sequence: ModeSequence,
    bends: Array,
    shares: Shares,
) -> Iterator[Block]:
    """The blocks of a stage, as far as their shapes are allowed."""
    robot = problem.robot
    for run in soft_runs(sequence):
        modes = tuple(sequence[i] for i in run)
        fine = _FINE if stage.stage.touches else 1
        made = block(robot, shape, modes, bends[run].tolist(), shares, fine)
        far = float(np.hypot(*made.displacement[:2])) > robot.limits.soft_travel_m
        if far or broken_by_shapes(robot, made.nodes[:, POSE:]) is not None:
            return
        if not levers_kept(robot, modes, made.ways):
            return
        yield made
        shape = made.shape


def _stop(
    displacement: Array,
    first: Array,
    may_be_clear: Callable[[Array], Bools],
    clear: Callable[[Array], bool],
) -> Stop:
    """A stop at one of these poses."""
    return Stop(displacement, may_be_clear, clear, lambda _: first, first, lambda: first)


def _all(poses: Array) -> Bools:
    return np.ones(len(poses), dtype=bool)


def _different(poses: Array) -> Array:
    """The poses without repetitions, in their order."""
    _, first = np.unique(poses.round(9), axis=0, return_index=True)
    return poses[np.sort(first)]


def _middle(low: Array, high: Array, otherwise: Array) -> Array:
    """The middle of a box, where it has one."""
    free = ~np.isfinite(high - low)
    return np.where(free, otherwise, np.where(free, 0.0, low) / 2 + np.where(free, 0.0, high) / 2)


def _by_phase(chain: Chain, legs: Legs) -> dict[int, Array]:
    """Via poses of the drive of each phase."""
    routes: dict[int, list[Array]] = {}
    for route, phase in zip(chain.routes, legs.phases, strict=True):
        if phase is not None:
            routes.setdefault(phase, []).append(route)
    return {phase: np.concatenate(parts) for phase, parts in routes.items()}
