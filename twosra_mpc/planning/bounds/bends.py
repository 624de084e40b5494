"""Bends: what a mode sequence must do to the bending coordinates W, as far as the task says it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from twosra_mpc.effort import remembered
from twosra_mpc.planning.bounds.detours import Cells
from twosra_mpc.planning.bounds.pose_phases import PoseTask
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, ModeSequence, mode_name, named

Intervals = tuple[tuple[float, float], ...]  # (low, high) of every segment
Known = tuple[tuple[float, float] | None, ...]  # the same; None: anything

_DEPENDENT = 1e-9  # singular values that are zero
_ROUNDING = 1e-9  # of the changes of W that limits allow


class Conserved(NamedTuple):
    """Invariant of bending two segments together, for messages: ``factor`` (W_i - W_j)."""

    name: str  # to be formatted with i and j
    unit: str
    factor: float


@dataclass(frozen=True, eq=False)
class BendingTask:
    """Task in the bending coordinates: what a plan must do to them, and how fast it can.

    Attributes:
        change: (low, high) of each segment: required change of W.
        within: By how much W of each segment may miss ``change`` where a goal counts as met.
        room: (low, high) of each segment: change of W that the curvature limits allow.
        start: Curvatures at t = 0 [1/m].
        goal: (low, high) of the curvatures at the end [1/m]; None where they are free.
        rate: (mode, curvatures as ``goal``) -> upper bound of abs(dW/dt).
        origin: W of each segment at t = 0.
        least_time: (mode, bounds of W before, least change of W of the soft segments) -> lower
            bound on the time it takes.
        least_time_of_more: (mode, bounds of W before, least change, largest change) -> (a, b): a
            change d in between takes at least a + b abs(d - least) [s].
        least_effort: As least_time -> lower bound on effort times duration [s2].
        forbidden: (mode, bounds of W before, least and largest change of W) -> what is wrong with a
            shape that every such bend passes, in words; None if nothing is.
        shapeless: Bounds of the W of every segment -> whether no shape within them is allowed.
        beyond: Where ``room`` ends, in words.
        shape: The required curvature changes in words, for messages.
        conserved: What bending together cannot change, for messages.
        curvature: W of all segments -> their curvatures [1/m].
        pose: The change of pose, if the goal gives one.
        plane: Fineness -> plane of shapes in which `Detours` are looked for; None: none is known.
        origin_within: How far W may be off ``origin`` at t = 0, by segment; exact without.
    """

    change: Intervals
    within: tuple[float, ...]
    room: Intervals
    start: tuple[float, ...]
    goal: Known
    rate: Callable[[Mode, Known], float]
    origin: tuple[float, ...]
    least_time: Callable[[Mode, Intervals, float], float]
    least_time_of_more: Callable[[Mode, Intervals, float, float], tuple[float, float]]
    least_effort: Callable[[Mode, Intervals, float], float]
    forbidden: Callable[[Mode, Intervals, float, float], str | None]
    shapeless: Callable[[Intervals], bool]
    beyond: str
    shape: str
    conserved: Conserved
    curvature: Callable[[Sequence[float]], tuple[float, ...]]
    pose: PoseTask | None
    plane: Callable[[int], Cells] | None
    origin_within: tuple[float, ...] | None = None

    @cached_property
    def segments(self) -> range:
        """The segments, counted from 0."""
        return range(len(self.change))

    @cached_property
    def must_bend(self) -> tuple[int, ...]:
        """Segments of which the goal asks for another curvature."""
        return tuple(j for j, (low, high) in enumerate(self.met) if not low <= 0 <= high)

    @cached_property
    def met(self) -> Intervals:
        """(low, high) of each segment: changes of W with which the goal counts as met."""
        pairs = zip(self.change, self.within, strict=True)
        return tuple((low - by, high + by) for (low, high), by in pairs)


def unreachable_reason(sequence: Sequence[Mode], task: BendingTask) -> str | None:
    """Say why the modes of ``sequence`` cannot bring about the required bend, or None if they can.

    The reason is an invariant of the kinematics: W_j rests while segment j is rigid, and segments
    that are only ever soft together change their W by the same amount.
    """
    soft = list(dict.fromkeys(mode for mode in sequence if any(mode)))
    for j in task.must_bend:
        if not any(mode[j] for mode in soft):
            names = " and ".join(mode_name(mode) for mode in dict.fromkeys(sequence))
            return f"segment {j + 1} must bend ({task.shape}) but is rigid in {names or 'no mode'}"
    for i, j in itertools.combinations(task.segments, 2):
        if all(mode[i] == mode[j] for mode in soft):
            (low_i, high_i), (low_j, high_j) = task.met[i], task.met[j]
            if max(low_i - high_j, low_j - high_i) > 0:
                return _tied(soft, (i, j), task)
    return _dependent(soft, task)


def _tied(soft: Sequence[Mode], pair: tuple[int, int], task: BendingTask) -> str:
    """Say that these modes bend two segments only together."""
    i, j = pair
    (low_i, high_i), (low_j, high_j) = task.change[i], task.change[j]
    apart = math.copysign(max(low_i - high_j, low_j - high_i), low_i - high_j)
    name, unit, factor = task.conserved
    both = named("segment", (i + 1, j + 1), len(task.change))
    alone = len(soft) == 1
    modes = f"mode {mode_name(soft[0])} alone bends" if alone else f"{_names(soft)} bend"
    return (
        f"{modes} {both} together and cannot reach this shape ({task.shape}): "
        f"{'it keeps' if alone else 'they keep'} {name.format(i + 1, j + 1)}, which must change by "
        f"{factor * apart:+z.3g} {unit}; segment {i + 1} or {j + 1} must also be bent alone"
    )


def _dependent(soft: Sequence[Mode], task: BendingTask) -> str | None:
    """Say that what these modes keep besides differences of two W forbids the shape, if it does."""
    if len(task.change) < 3 or not soft:  # of two segments nothing else is kept
        return None
    incidence = np.array(soft, dtype=float).T
    left, singular, _ = np.linalg.svd(incidence)
    for kept in left[:, int((singular > _DEPENDENT).sum()) :].T:
        ends = kept[:, None] * np.array(task.met)  # of what should be kept, by segment
        if ends.min(axis=1).sum() > 0 or ends.max(axis=1).sum() < 0:
            return f"{_names(soft)} cannot bend the segments independently ({task.shape})"
    return None


def _names(modes: Sequence[Mode]) -> str:
    return f"modes {' and '.join(map(mode_name, modes))}"


def determined_bends(sequence: ModeSequence, task: BendingTask) -> Array | None:
    """Change of W in each phase where the task leaves no choice, else None.

    With independent soft modes and a given shape at the end, the bends are the unique solution of
    one linear equation for each segment. None also where they are no solution.
    """
    found = _ranges(sequence, task.change)
    if found is None or found[0] != found[1]:
        return None
    bends = np.array(found[0])
    incidence = np.array(sequence, dtype=float).reshape(len(sequence), len(task.change)).T
    inside = zip((incidence @ bends).tolist(), task.met, strict=True)
    return bends if all(low <= w <= high for w, (low, high) in inside) else None


def least_bends(sequence: ModeSequence, task: BendingTask) -> Array | None:
    """Change of W in each phase where all may bend their least at once, else None.

    Then no other bends take less time in any phase, so event times are least with these.
    """
    if (steps := bend_steps(sequence, task, ())) is None:
        return None
    bends = np.array([step.surely for step in steps])
    sums = np.cumsum(bends[:, None] * np.array(sequence), axis=0)
    for j in task.segments:
        soft = [i for i, mode in enumerate(sequence) if mode[j]]
        rounding = _ROUNDING * (task.room[j][1] - task.room[j][0])
        for i in soft:
            low, high = task.met[j] if i == soft[-1] else task.room[j]
            if not low - rounding <= sums[i, j] <= high + rounding:
                return None
    return bends


def _ranges(
    sequence: ModeSequence, change: Intervals, free: Intervals = ()
) -> tuple[list[float], list[float]] | None:
    """Least and largest change of W in each phase; None if some are free and not bounded.

    The bends d solve A d = w for some w in the box that is asked for. With those d_f of the free
    phases chosen, too, the others are d_b = A_b^+ (w - A_f d_f).
    """
    solution, chosen = _solution(sequence)
    if len(free) != len(chosen):
        return None
    low, high = np.array([*change, *free]).T
    rise, fall = np.maximum(solution, 0), np.minimum(solution, 0)
    return (rise @ low + fall @ high).tolist(), (rise @ high + fall @ low).tolist()


@lru_cache(4096)
def _solution(sequence: ModeSequence) -> tuple[Array, tuple[int, ...]]:
    """Bends of all phases from (w, d_f), (phases, segments + free), 0 in rigid ones; the free."""
    modes, segments = np.array(sequence, dtype=float), len(sequence[0])
    basic, free = list[int](), list[int]()
    for i in np.flatnonzero(modes.any(axis=1)).tolist():
        more = np.linalg.matrix_rank(modes[[*basic, i]]) > len(basic)
        (basic if more else free).append(i)
    solution = np.zeros((len(sequence), segments + len(free)))
    solution[basic, :segments] = np.linalg.pinv(modes[basic].T)
    solution[basic, segments:] = -solution[basic, :segments] @ modes[free].T
    solution[free, segments:] = np.eye(len(free))
    return solution, tuple(free)


def free_bends(sequence: ModeSequence, task: BendingTask) -> Intervals:
    """Bounds of the bends that the shape at the end leaves free: of each later phase of a kind."""
    rooms = [high - low + 2 * by for (low, high), by in zip(task.room, task.within, strict=True)]
    most = [
        min(room for room, soft in zip(rooms, sequence[i], strict=True) if soft)
        for i in _solution(sequence)[1]
    ]
    return tuple((-each, each) for each in most)


def middle_bends(sequence: ModeSequence, change: Intervals, free: Intervals) -> Array:
    """Change of W in each phase to the middle of the boxes of what is asked for and of choices."""
    return _solution(sequence)[0] @ np.array([*change, *free]).mean(axis=1)


class BendStep(NamedTuple):
    """Bend of a phase, as far as it is known.

    Attributes:
        mode: Its mode.
        before: Bounds of the W of each segment where it begins.
        least: Least change of W of its soft segments, with its sign.
        most: Largest change of W.
        possible: Whether limits and goal leave any shape where it ends.
        beyond: A segment (from 0) that it bends beyond the curvature limits, whatever it bends.
    """

    mode: Mode
    before: Intervals
    least: float
    most: float
    possible: bool
    beyond: int | None

    @property
    def surely(self) -> float:
        """Change of W that every such bend passes."""
        return min(self.least, self.most, key=abs) if self.least * self.most > 0 else 0.0

    def forbidden(self, task: BendingTask) -> str | None:
        """What is wrong with a shape that every such bend passes, in words; None if nothing is."""
        farthest = max(self.least, self.most, key=abs)
        return task.forbidden(self.mode, self.before, self.surely, farthest)


@remembered(64)  # a sequence is looked at more than once while its problem is planned
def bend_steps(
    sequence: ModeSequence, task: BendingTask, free: Intervals
) -> tuple[BendStep, ...] | None:
    """Bend of each phase, as far as it is known; None if some are ``free`` and not bounded."""
    if (ranges := _ranges(sequence, task.met, free)) is None:
        return None
    off = task.origin_within or (0.0,) * len(task.origin)
    here = tuple((w - by, w + by) for w, by in zip(task.origin, off, strict=True))
    steps = list[BendStep]()
    for i, (mode, least, most) in enumerate(zip(sequence, *ranges, strict=True)):
        reached = [
            (low + soft * least, high + soft * most)
            for soft, (low, high) in zip(mode, here, strict=True)
        ]
        outermost = [
            task.room[j] if any(later[j] for later in sequence[i + 1 :]) else task.change[j]
            for j in task.segments
        ]
        missed, beyond, after = False, None, list[tuple[float, float]]()
        for j, ((low, high), w) in enumerate(zip(reached, task.origin, strict=True)):
            (under, over), (least_w, most_w), by = task.room[j], outermost[j], task.within[j]
            if beyond is None and (low - w > over + by or high - w < under - by):
                beyond = j
            missed |= low - w > most_w + by or high - w < least_w - by
            ends = min(max(low, w + least_w), w + most_w), min(max(high, w + least_w), w + most_w)
            after.append(ends)
        possible = not missed and not (any(mode) and task.shapeless(tuple(after)))
        steps.append(BendStep(mode, here, least, most, possible, beyond))
        here = tuple(after)
    return tuple(steps)


@remembered(64)
def least_durations(
    sequence: ModeSequence, task: BendingTask, free: Intervals = ()
) -> tuple[float, ...]:
    """Least durations of the phases, as far as the task says how far they bend [s].

    Infinite where a bend must pass a shape that is forbidden, and not told after that. Bends that
    the task leaves free are within ``free``, or anything without.
    """
    durations = [0.0] * len(sequence)
    for i, step in enumerate(bend_steps(sequence, task, free) or ()):
        if any(step.mode) and (not step.possible or step.forbidden(task)):
            durations[i] = math.inf
            break
        if step.surely:
            durations[i] = task.least_time(step.mode, step.before, step.surely)
    return tuple(durations)


def passes_forbidden(sequence: ModeSequence, task: BendingTask, bends: Array) -> bool:
    """True if these changes of W, one of each phase, lead through a shape that is forbidden."""
    here = np.array(task.origin)
    for mode, bend in zip(sequence, bends.tolist(), strict=True):
        before = tuple((w, w) for w in here.tolist())
        if any(mode) and task.forbidden(mode, before, bend, bend):
            return True
        here = here + bend * np.array(mode)
    return False


def least_efforts(sequence: ModeSequence, task: BendingTask) -> list[float]:
    """Least effort times duration of the phases, as far as the task says how far they bend [s2]."""
    steps = bend_steps(sequence, task, ()) or ()
    return [
        task.least_effort(step.mode, step.before, step.surely) if step.surely else 0.0
        for step in steps
    ]


def known_curvatures(sequence: ModeSequence, phase: int, task: BendingTask) -> Known:
    """Curvatures of the rigid segments in a phase, where the sequence alone determines them."""
    known = list[tuple[float, float] | None]([None] * len(task.change))
    for j, start in enumerate(task.start):
        if not any(mode[j] for mode in sequence[: phase + 1]):
            known[j] = start, start
        elif not any(mode[j] for mode in sequence[phase:]):
            known[j] = task.goal[j]
    return tuple(known)
