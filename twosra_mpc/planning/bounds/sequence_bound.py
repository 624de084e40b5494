r"""Proved lower bounds on the cost of a mode sequence.

Relax the motion to what it does to the bending coordinates W_j (see ``model.bending``), drop
the pose, and keep the temporal network of the melts and freezes. With t the event times and d_i
the change of W in soft phase i,

.. math::
    \min_{t, d}\; t_{finish} + w_E E(t) + w_s N
    \quad\text{s.t.}\quad t_v - t_u \ge w_{uv}, \quad
    |d_i| \le R_{\sigma_i} (t_{end,i} - t_{start,i}), \quad
    \sum_{i: \sigma_{ij} = 1} d_i \in [\Delta W_j^-, \Delta W_j^+],

and the partial sums after every phase within what the curvature limits allow. Where the sequence
leaves no choice of d, the least time of each bend is integrated instead of divided by one rate, and
a bend that must pass a forbidden shape rules the sequence out. Where the goal is a box, the least
bend is integrated so, and what a bend takes beyond it is at least a line. The changes of W asked
for are those of every shape that counts as in the goal, so the bound holds for every plan that
verifies. Where the cost weighs effort by w_u, w_u sum e_i is added, with e_i at least tangents of
E_i / (t_{end,i} - t_{start,i}) for the least effort times duration E_i that such a bend takes
(rigid drives: none). Every plan of the sequence satisfies these constraints, because R is an upper
bound of abs(dW/dt) and W_j rests while segment j is rigid; so the optimum of this linear program
bounds its cost from below. Where that is not enough, what the sequence may do is cut into
``parts``, and a goal pose adds the constraint of ``pose_bound``. A sequence that never melts
anything is bounded by ``rigid_motion.least_time`` as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twosra_mpc.effort import remembered
from twosra_mpc.planning.bounds.bends import (
    BendingTask,
    Intervals,
    bend_steps,
    determined_bends,
    known_curvatures,
    least_bends,
    least_efforts,
)
from twosra_mpc.planning.bounds.linear_program import proved_minimum
from twosra_mpc.planning.bounds.pose_bound import PoseConstraint, PoseProgram
from twosra_mpc.planning.bounds.pose_phases import PhaseMotions
from twosra_mpc.planning.bounds.schedule import cost_coefficients, fixed_cost, with_durations
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, ModeSequence, soft_segments
from twosra_mpc.timing import TemporalNetwork

_COARSE, _FINE = 64, 768  # boxes of shapes in a bend: to look, and to prove
_LOOSE = 1e-4  # of a bound: how much short phases may be wrong
_TANGENTS = np.geomspace(1e-5, 4.0, 30)  # their slopes: minus effort over duration


@dataclass(frozen=True)
class SequenceBound:
    """Optimum of the relaxation: the bound, its event times and its bends.

    Attributes:
        cost: Lower bound on the cost of every plan with this sequence [s].
        times: Event times of the relaxed optimum, by event number.
        bends: Change of W in each phase of the relaxed optimum (0 in rigid phases).
        detour: Whether these are others, because those pass forbidden shapes.
    """

    cost: float
    times: Array
    bends: Array
    detour: bool = False


class Events(NamedTuple):
    """Events of a mode sequence, which last so long at least, and what they cost.

    Attributes:
        network: Constraints of the event times.
        weights: Weights of the cost.
        least_s: Proved least durations of the phases.
    """

    network: TemporalNetwork
    weights: Weights
    least_s: Sequence[float]


def sequence_bound(events: Events, task: BendingTask) -> SequenceBound | None:
    """Solve the relaxation of one mode sequence (a linear program); None if it is infeasible.

    Where only time counts and it is known which bends take least, that is a longest path.
    """
    bends = quickest_bends(events.network.sequence, task, events.weights)
    if bends is None:
        try:
            return _linear_program_bound(events, task)
        except ArithmeticError:
            bends = mean_bends(events.network.sequence, task)
    return longest_path_bound(events, bends)


@remembered(64)  # a stage has the same with each sequence of another
def quickest_bends(sequence: ModeSequence, task: BendingTask, weights: Weights) -> Array | None:
    """Bends that take the least time of all, where that is all that counts and they are known."""
    if weights.energy_s_per_J or weights.effort:
        return None
    bends = determined_bends(sequence, task)
    return least_bends(sequence, task) if bends is None else bends


def mean_bends(sequence: ModeSequence, task: BendingTask) -> Array:
    """Bends to the middle, for where the solver gives up: what each phase takes by itself holds."""
    middle = np.array(task.change).mean(axis=1)
    return np.linalg.pinv(np.array(sequence, dtype=float).T) @ middle


def longest_path_bound(events: Events, bends: Array) -> SequenceBound | None:
    """The earliest finish is a longest path; what holding segments liquid costs is left out.

    None if no durations, or no times, fulfil the constraints.
    """
    network, weights, least_s = events
    if not all(map(math.isfinite, least_s)):
        return None
    times = with_durations(network, least_s).earliest
    if times is None:
        return None
    cost = times[network.layout.finish] + fixed_cost(network, weights)
    return SequenceBound(cost, np.array(times), bends)


def pose_bound(events: Events, task: BendingTask, enough: float) -> float:
    """Raise the bound of a sequence by the time its change of pose takes; -inf if not known.

    Takes a hundred times as long as ``sequence_bound``; stops where ``enough`` is reached. Needs a
    goal pose, and a sequence whose soft modes are independent.
    """
    network, weights, least_s = events
    phases, finer = (_phase_motions(network.sequence, task, n) for n in (_COARSE, _FINE))
    if task.pose is None or phases is None or finer is None:
        return -math.inf
    cost, _ = cost_coefficients(network, weights)

    timed = with_durations(network, least_s)
    times = timed.earliest or [0.0] * network.layout.count
    # Where to look for it: as if all of a delay were passed on. Proved is what is told apart.
    whole = {(d.since, d.until): d.least - (1 - d.share) * times[d.since] for d in network.delays}
    least = timed.least | whole
    for side in task.pose.sides:
        program = PoseProgram(task.pose, phases, network.layout, least, cost, side)
        found = program.best(lambda each: _told_apart(events, task, each, -math.inf), enough)
        if found is None:
            return -math.inf
        enough = min(enough, _told_apart(events, task, program.prove(found, finer), enough))
    return enough


def _told_apart(
    events: Events,
    task: BendingTask,
    found: PoseConstraint,
    enough: float,
    most_s: tuple[float, ...] = (),
) -> float:
    """Bound where phases last so long at most; short ones are told apart until it is enough.

    A phase reaches less than full speed while it lasts less than two ramps, and lasts d at full
    speed less a ramp else: one line is above all that, or two.
    """
    most_s = most_s or (math.inf,) * len(events.least_s)
    least, most = np.array(events.least_s), np.array(most_s)
    at_least, short = found.at_speed_s(least), most < math.inf
    slopes = np.ones(len(least))
    slopes[short] = (found.at_speed_s(most) - at_least)[short] / (most - least)[short]
    rates = found.rates * slopes
    need = found.need - float(found.rates @ at_least - rates @ least)
    try:
        bound = _linear_program_bound(events, task, _Lasting(rates, need, most))
    except ArithmeticError:  # the solver gave up: nothing is proved
        return -math.inf
    if bound is None or bound.cost >= enough:
        return math.inf if bound is None else bound.cost
    lasts = np.diff(bound.times[: 2 * len(least)])[::2]  # starts and ends come first, in turns
    loose = found.rates * (at_least + slopes * (lasts - least) - found.at_speed_s(lasts)) * ~short
    i = int(loose.argmax())
    if loose[i] <= _LOOSE * bound.cost:
        return bound.cost
    two = 2 * float(found.ramps_s[i])
    longer = events._replace(least_s=[*events.least_s[:i], two, *events.least_s[i + 1 :]])
    shorter = (*most_s[:i], two, *most_s[i + 1 :])
    return min(
        _told_apart(longer, task, found, enough, most_s),
        _told_apart(events, task, found, enough, shorter),
    )


def _phase_motions(
    sequence: ModeSequence, task: BendingTask, boxes: int
) -> list[PhaseMotions] | None:
    """Motions of each phase; None without a goal pose, or if nothing limits one of them."""
    steps, found = bend_steps(sequence, task, ()), list[PhaseMotions]()
    if task.pose is None or steps is None:
        return None
    for i, step in enumerate(steps):
        if any(step.mode):
            room = _room(step.mode, step.before, task)
            motions = task.pose.soft_phase(
                step.mode, step.before, (step.least, step.most), room, boxes
            )
        else:
            motions = task.pose.rigid_phase(*_shapes(sequence, i, step.before, task))
        if motions is None:
            return None
        found.append(motions)
    return found


def _room(mode: Mode, here: Intervals, task: BendingTask) -> tuple[float, float]:
    """Changes of W from ``here`` that the curvature limits allow to all soft segments of a mode."""
    soft = soft_segments(mode)
    least = [task.origin[j] + task.room[j][0] - here[j][1] for j in soft]
    most = [task.origin[j] + task.room[j][1] - here[j][0] for j in soft]
    return max(least), min(most)


def _shapes(
    sequence: ModeSequence, phase: int, here: Intervals, task: BendingTask
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Least and largest curvatures in a rigid phase: the start's, the goal's, or of these W."""
    known = known_curvatures(sequence, phase, task)
    ends = zip(*map(task.curvature, zip(*here, strict=True)), strict=True)
    low, high = zip(
        *(by_w if k is None else k for k, by_w in zip(known, ends, strict=True)), strict=True
    )
    return low, high


class _Lasting(NamedTuple):
    """sum of rates[i] (duration of phase i) >= need; and none lasts longer than most_s[i] [s]."""

    rates: Array
    need: float
    most_s: Array


def _linear_program_bound(
    events: Events, task: BendingTask, lasting: _Lasting | None = None
) -> SequenceBound | None:
    rows, layout = bend_rows(events.network.sequence, task, events.weights), events.network.layout
    program = Relaxation(events, rows.rates, rows.efforts)
    program.bend(events.network.sequence, task, rows)
    program.weigh_efforts()
    if lasting is not None:
        drives: dict[int, float] = {}
        for i, rate in enumerate(lasting.rates.tolist()):
            drives |= {layout.end(i): rate, layout.start(i): -rate}
        for i in np.flatnonzero(lasting.most_s < math.inf).tolist():
            program.at_least({layout.end(i): -1.0, layout.start(i): 1.0}, -lasting.most_s[i])
        program.at_least(drives, lasting.need)
    return program.optimum()


class BendRows(NamedTuple):
    """Rows for the bends of the first phases of a relaxation, from the start to a goal.

    Attributes:
        rates: Upper bound of abs(dW/dt) in each of these phases.
        efforts: Least effort times duration of each [s2]; none where effort has no weight.
        lines: Phase -> least time of its least bend [s], what more takes a unit of W, that bend.
    """

    rates: list[float]
    efforts: list[float]
    lines: dict[int, tuple[float, float, float]]


@remembered(64)
def bend_rows(sequence: ModeSequence, task: BendingTask, weights: Weights) -> BendRows:
    """Bound rates, efforts and times of the bends of a sequence."""
    rows = BendRows([], least_efforts(sequence, task) if weights.effort else [], {})
    steps = bend_steps(sequence, task, ()) or [None] * len(sequence)
    for i, (mode, step) in enumerate(zip(sequence, steps, strict=True)):
        if step and (bend := step.surely) and step.least < step.most:
            most = max(step.least, step.most, key=abs)
            time, more = task.least_time_of_more(mode, step.before, bend, most)
            rows.lines[i] = time, more, bend
            rows.rates.append(max(1 / more, abs(bend) / time))  # which the line implies
        else:
            known = known_curvatures(sequence, i, task)
            rows.rates.append(task.rate(mode, known) if any(mode) else 0.0)
    return rows


class Relaxation:
    """The linear program in event times and bends, row by row; columns are in this order.

    Args:
        events: Of all phases.
        rates: Upper bound of abs(dW/dt) in each phase.
        efforts: Least effort times duration of each phase [s2]; none where effort has no weight.
    """

    def __init__(
        self, events: Events, rates: Sequence[float], efforts: Sequence[float] = ()
    ) -> None:
        network, self._weights, least_s = events
        self._network = network
        self._rates, self._efforts = rates, efforts
        self.layout = layout = network.layout
        self._width = layout.count + layout.phases + len(efforts)
        self._rows: list[Array] = []
        self._limits: list[float] = []
        for (u, v), least in network.least.items():
            self.at_least({v: 1.0, u: -1.0}, least)
        for delay in network.delays:
            self.at_least({delay.until: 1.0, delay.since: -delay.share}, delay.least)
        for i, least in enumerate(least_s):
            self.at_least({layout.end(i): 1.0, layout.start(i): -1.0}, least)
        for i, (mode, rate) in enumerate(zip(network.sequence, rates, strict=True)):
            if any(mode) and np.isfinite(rate):
                for sign in (1.0, -1.0):
                    bend = layout.count + i
                    self.at_least({layout.end(i): rate, layout.start(i): -rate, bend: sign}, 0.0)

    def at_least(self, terms: dict[int, float], least: float) -> None:
        """Demand that the sum of columns times factors is no less."""
        row = np.zeros(self._width)
        for column, value in terms.items():
            row[column] -= value
        self._rows.append(row)
        self._limits.append(-least)

    def bend(self, sequence: ModeSequence, task: BendingTask, rows: BendRows) -> None:
        """Demand that limits and goal allow the bends of these phases, and what they take."""
        layout = self.layout
        for i, (time, more, bend) in rows.lines.items():
            lasting = {layout.end(i): 1.0, layout.start(i): -1.0}
            beyond = {layout.count + i: -math.copysign(more, bend)}
            self.at_least(lasting | beyond, time - more * abs(bend))
        for j in task.segments:
            bends: dict[int, float] = {}
            for i in (i for i, mode in enumerate(sequence) if mode[j]):
                bends[layout.count + i] = 1.0
                later = any(mode[j] for mode in sequence[i + 1 :])
                low, high = task.room[j] if later else task.met[j]
                self.at_least(bends, low)
                self.at_least(dict.fromkeys(bends, -1.0), -high)

    def weigh_efforts(self) -> None:
        """Demand that efforts are at least tangents of effort over duration."""
        layout = self._network.layout
        for i, effort in enumerate(self._efforts):
            column, end, start = layout.count + layout.phases + i, layout.end(i), layout.start(i)
            for slope in _TANGENTS if effort else ():
                self.at_least(
                    {column: 1.0, end: slope, start: -slope}, 2 * math.sqrt(slope * effort)
                )

    def optimum(self) -> SequenceBound | None:
        """The least cost; None if the constraints contradict each other.

        All times are at most the finish, which costs 1 per second, and bends at most rate times
        time; so nothing is larger than a multiple of the cost.
        """
        layout, n = self._network.layout, self._network.layout.phases
        count, effort = len(self._efforts), self._weights.effort
        objective, constant = cost_coefficients(self._network, self._weights)
        bends_of = [(None, None) if any(mode) else (0.0, 0.0) for mode in self._network.sequence]
        bounds = [*[(0.0, None)] * (layout.count - 1), (0.0, 0.0), *bends_of]
        bounds += [(0.0, None)] * count
        objective = np.concatenate([objective, np.zeros(n), np.full(count, effort)])
        per_cost = np.concatenate([np.ones(layout.count), self._rates, np.ones(count)])
        per_cost[layout.count + n :] /= effort or 1.0
        rows, limits = np.array(self._rows), np.array(self._limits)
        least, found = proved_minimum(objective, rows, limits, bounds, per_cost)
        if least == math.inf:
            return None
        times, bends_found, _ = np.split(found, [layout.count, layout.count + n])
        return SequenceBound(least + constant, times=times, bends=bends_found)
