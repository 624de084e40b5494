r"""Speed profiles along a path: the quickest way from rest to rest, or a slower one.

Let l be the length of a phase's path in its inputs, :math:`v = \dot l\, s_k / |s_k|` in interval
k, :math:`b = \dot l^2` and :math:`\ddot l = b' / 2`. With w(l) the wheels' turn per length the
limits are

.. math:: r(l) \sqrt b \le 1, \qquad |w'(l)\, b + w(l)\, b' / 2| \le a,

which a forward and a backward pass over a grid of l solve (time-optimal path parameterisation).
Between grid points the acceleration along the path is constant, so v is linear in time. Without a
limit on acceleration every interval takes its least time at constant speed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.flow import Motion
from twosra_mpc.plans.trajectory import SAME_TIME_S, Samples, flown, new_times, wheel_speeds
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.speeds import interval_durations, least_times_and_turns
from twosra_mpc.problem.tolerances import GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import INPUTS, WHEELS, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import is_rigid
from twosra_mpc.timing import Transition, transition_model

_PIECES = 4  # grid points per interval of a bend, on which wheel speeds vary
_BETWEEN = 3e-3  # of the limits is spared: shapes between grid points may use more of them
_CORNER = 5e-8  # relative change of a wheel's turn per x that counts as a corner
_NOTHING = 1e-12  # m or rad: an interval that goes no farther rests
_APART = 1e-3  # least length of a piece, in intervals
_UNNOTICED = 0.1  # of what goals may be missed by
_LEAST_S = 1e-3  # least duration of a phase that moves: its pieces are then events of their own


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Speed profile of one phase; m pieces of constant acceleration of x.

    Attributes:
        x: Where pieces begin, and the end, in intervals, (m + 1,).
        q: Configuration there, (m + 1, 3 + n).
        time_s: When, since the phase began, (m + 1,).
        speed: dx/dt as each piece begins, (m,) [1/s].
        acceleration: Of x in each piece, (m,) [1/s2].
        wheel_rad_s: Wheel speeds as each piece begins, (m, 4).
        effort_s: Integral of the sum of (wheel speed / largest wheel speed)^2 [s].
        peak_rad_s: Largest speed of a wheel.
    """

    x: Array
    q: Array
    time_s: Array
    speed: Array
    acceleration: Array
    wheel_rad_s: Array
    effort_s: float
    peak_rad_s: float

    @property
    def duration_s(self) -> float:
        """Time from start to end."""
        return float(self.time_s[-1])

    def lasting(self, duration_s: float) -> SpeedProfile:
        """Return the same profile, slower or faster."""
        factor = duration_s / self.duration_s if self.duration_s else 1.0
        return replace(
            self,
            time_s=self.time_s * factor,
            speed=self.speed / factor,
            acceleration=self.acceleration / factor**2,
            wheel_rad_s=self.wheel_rad_s / factor,
            effort_s=self.effort_s / factor,
            peak_rad_s=self.peak_rad_s / factor,
        )


def fastest(motion: Motion) -> tuple[SpeedProfile, ...]:
    """The quickest speed profile of each phase within the robot's limits, where not told."""
    if motion.robot.limits.wheel_acceleration_rad_s2 is None:
        durations = np.where(motion.lasting_s > 0, motion.lasting_s, interval_durations(motion))
        made = (lasting(motion, i, own) for i, own in enumerate(durations))
        return tuple(map(_noticed, made))
    charge(Cost.PROFILE, motion.inputs[..., 0].size)
    parts = list(_smooth_parts(motion))
    whole = [*zip((part.phase for part in parts), _from_rest_to_rest(motion, parts), strict=True)]
    if motion.lasting_s.any():
        whole = sorted([*whole, *_told(motion)], key=lambda each: float(each[1].x[0]))
    phases = range(len(motion.sequence))
    return tuple(_joined(motion, i, [own for p, own in whole if p == i]) for i in phases)


def _told(motion: Motion) -> Iterator[tuple[int, SpeedProfile]]:
    """Phase and profile of each run of intervals of which it is told how long they last."""
    phase, k = np.nonzero(motion.lasting_s)
    breaks = np.flatnonzero((np.diff(phase) != 0) | (np.diff(k) != 1)) + 1
    for run in np.split(np.arange(len(k)), breaks) if len(k) else ():
        own = np.zeros(motion.lasting_s.shape[1])
        own[k[run]] = motion.lasting_s[phase[run[0]], k[run]]
        yield int(phase[run[0]]), lasting(motion, int(phase[run[0]]), own)


def _noticed(profile: SpeedProfile) -> SpeedProfile:
    """The profile, slower if it is over in no time but does not end where it began."""
    moved = np.abs(profile.q[-1] - profile.q[0]).max()
    brief = 0 < profile.duration_s <= SAME_TIME_S and moved > _UNNOTICED * GOAL_TOLERANCE
    return profile.lasting(2 * SAME_TIME_S) if brief else profile


def lasting(motion: Motion, phase: int, durations: Array) -> SpeedProfile:
    """A phase whose intervals last so long, (k,) [s]; those that last no time are left out."""
    used, states = np.flatnonzero(durations > 0), motion.states[phase]
    x, own = np.append(used, len(durations)), durations[used]
    modes = np.tile(np.array(motion.sequence[phase]), (len(used), 1))
    s, change = (of[phase][used] / own[:, None] for of in (motion.inputs, motion.changes))
    ends = (states[used], s - change / 2), (states[used + 1], s + change / 2)
    turned = np.array([wheel_speeds(motion.robot, q, v, modes) for q, v in ends])
    mean = (turned[0] ** 2 + turned[0] * turned[1] + turned[1] ** 2).sum(axis=1) / 3
    return SpeedProfile(
        x=x.astype(float),
        q=states[x],
        time_s=np.append(0.0, np.cumsum(own)),
        speed=1 / own,
        acceleration=np.zeros(len(used)),
        wheel_rad_s=turned[0],
        effort_s=float(mean @ own) / motion.robot.limits.wheel_speed_rad_s**2,
        peak_rad_s=float(np.abs(turned).max(initial=0.0)),
    )


def _joined(motion: Motion, phase: int, parts: list[SpeedProfile]) -> SpeedProfile:
    """The parts of a phase one after the other."""
    if not parts:
        return lasting(motion, phase, np.zeros(motion.inputs.shape[1]))
    start = np.append(0.0, np.cumsum([part.duration_s for part in parts]))
    made = SpeedProfile(
        x=np.concatenate([*(part.x[:-1] for part in parts), parts[-1].x[-1:]]),
        q=np.concatenate([*(part.q[:-1] for part in parts), parts[-1].q[-1:]]),
        time_s=np.concatenate(
            [*(at + part.time_s[:-1] for at, part in zip(start, parts, strict=False)), start[-1:]]
        ),
        speed=np.concatenate([part.speed for part in parts]),
        acceleration=np.concatenate([part.acceleration for part in parts]),
        wheel_rad_s=np.concatenate([part.wheel_rad_s for part in parts]),
        effort_s=sum(part.effort_s for part in parts),
        peak_rad_s=max(part.peak_rad_s for part in parts),
    )
    least = max(_LEAST_S, motion.robot.limits.phase_s)
    return made if made.duration_s >= least else made.lasting(least)


class _Part(NamedTuple):
    """Intervals of a phase between which the wheels' turn per length does not jump.

    Attributes:
        phase: Its number.
        intervals: Their numbers, (k,).
        nodes: Length of the path at their ends, (k + 1,).
        path: Length at the grid points, (m,).
    """

    phase: int
    intervals: NDArray[np.intp]
    nodes: Array
    path: Array


def _smooth_parts(motion: Motion) -> Iterator[_Part]:
    """Every phase from rest to rest, and to rest where its path has a corner."""
    lengths = np.linalg.norm(motion.inputs, axis=2)
    phase, k = np.nonzero((lengths > _NOTHING) & (motion.lasting_s == 0))
    if not len(k):
        return
    ends = np.concatenate([motion.states[phase, k], motion.states[phase, k + 1]])
    along = np.tile(motion.inputs[phase, k] / lengths[phase, k, None], (2, 1))
    modes = np.tile(np.array(motion.sequence)[phase], (2, 1))
    r, w = least_times_and_turns(motion.robot, ends, along, modes)
    turn = np.abs(w).max(axis=1)
    most = motion.robot.limits.wheel_acceleration_rad_s2 or np.inf
    up, down = np.split(0.5 / r**2 * turn / most, 2)  # where full speed may be reached
    begin, end = np.split(w, 2)
    jump = np.abs(begin[1:] - end[:-1]).max(axis=1) > _CORNER * turn[1 : len(k)]
    apart = jump | (np.diff(phase) > 0) | (np.diff(k) != 1)
    for rows in np.split(np.arange(len(k)), np.flatnonzero(apart) + 1):
        first, own = int(phase[rows[0]]), lengths[phase[rows], k[rows]]
        nodes = np.append(0.0, np.cumsum(own))
        pieces = len(own) * (1 if is_rigid(motion.sequence[first]) else _PIECES)
        grid = np.interp(np.linspace(0, len(own), pieces + 1), np.arange(len(nodes)), nodes)
        further = (up[rows[0]], nodes[-1] / 2, nodes[-1] - down[rows[-1]])
        path = np.sort([*grid, *(at for at in further if 0 < at < nodes[-1])])
        path = path[np.append(True, np.diff(path) > _APART * own.min())]
        path[-1] = nodes[-1]
        yield _Part(first, k[rows], nodes, path)


def _from_rest_to_rest(motion: Motion, parts: list[_Part]) -> Iterator[SpeedProfile]:
    """The quickest profile of every part; what the model says is asked once for all of them."""
    if not parts:
        return
    at = [
        np.clip(np.searchsorted(part.nodes, part.path, side="right") - 1, 0, len(part.nodes) - 2)
        for part in parts
    ]
    length = [np.diff(part.nodes)[k] for part, k in zip(parts, at, strict=True)]
    share = [(p.path - p.nodes[k]) / own for p, k, own in zip(parts, at, length, strict=True)]
    phase = np.repeat([part.phase for part in parts], [len(part.path) for part in parts])
    k = np.concatenate([part.intervals[at] for part, at in zip(parts, at, strict=True)])
    s, modes = motion.inputs[phase, k], np.array(motion.sequence)[phase]
    q = flown(
        motion.robot, motion.states[phase, k], s * np.concatenate(share)[:, None], None, modes
    )
    r, w = least_times_and_turns(motion.robot, q, s / np.concatenate(length)[:, None], modes)
    ends = np.cumsum([len(part.path) for part in parts])[:-1]
    asked = (np.split(each, ends) for each in (q, r, w, k + np.concatenate(share)))
    for part, own, lengths in zip(parts, zip(*asked, strict=True), length, strict=True):
        yield _profile(motion, part, lengths, *own)


def _profile(
    motion: Motion, part: _Part, length: Array, q: Array, r: Array, w: Array, x: Array
) -> SpeedProfile:
    """The quickest way along a part, of what holds at its grid points."""
    limits, path = motion.robot.limits, part.path
    spare = 0.0 if is_rigid(motion.sequence[part.phase]) else _BETWEEN
    most = limits.wheel_acceleration_rad_s2 or np.inf
    b = squared_speeds(path, (1 + spare) * r, w, (1 - spare) * most)
    speed = np.sqrt(b)
    time = 2 * np.diff(path) / (speed[1:] + speed[:-1])
    turned = w * speed[:, None]
    middle = (turned[1:] ** 2 + turned[1:] * turned[:-1] + turned[:-1] ** 2).sum(axis=1) / 3
    return SpeedProfile(
        x=x,
        q=q,
        time_s=np.append(0.0, np.cumsum(time)),
        speed=speed[:-1] / length[:-1],
        acceleration=np.diff(b) / (2 * np.diff(path)) / length[:-1],
        wheel_rad_s=turned[:-1],
        effort_s=float(middle @ time) / limits.wheel_speed_rad_s**2,
        peak_rad_s=float(np.abs(turned).max()),
    )


def squared_speeds(path: Array, r: Array, w: Array, most: float) -> Array:
    """Largest b on the grid from rest to rest, (m,).

    On a piece of length d, with W the larger turn per x of a wheel and D the change of it per x,
    D b + W abs(b') / 2 <= a is asked for b the larger of its ends: at most a little slower than
    need be. It gives b_next <= (b + 2 a d / W) / (1 + 2 D d / W), in both directions alike.
    """
    length = np.diff(path)[:, None]
    change = np.abs(np.diff(w, axis=0)) / length
    largest = np.maximum(np.maximum(np.abs(w[1:]), np.abs(w[:-1])), 1e-12)
    gain, shrink = 2 * most * length / largest, 1 + 2 * change * length / largest
    of_wheels = np.stack([gain, shrink], axis=2).tolist()
    with np.errstate(divide="ignore", over="ignore"):
        cap = 1 / r**2
        curved = (most / change).min(axis=1)
    cap[1:] = np.minimum(cap[1:], curved)
    cap[:-1] = np.minimum(cap[:-1], curved)
    cap[[0, -1]] = 0.0
    b = cap.tolist()
    for order in (range(len(b) - 1), range(len(b) - 2, -1, -1)):
        step = order.step
        for i in order:
            here, there = (i, i + 1) if step > 0 else (i + 1, i)
            before = b[here]
            b[there] = min(b[there], *[(before + g) / k for g, k in of_wheels[i]])
    return np.array(b)


HOLD_SAMPLE_S = 5.0  # while the robot waits, temperatures are sampled at least this often


def sample(
    problem: Problem,
    motion: Motion,
    profiles: Sequence[SpeedProfile],
    phase_starts: Sequence[float],
    finish_s: float,
    transitions: Sequence[Transition],
) -> Samples:
    """Put a motion on the clock: every change of speed, heater event, and regular hold samples.

    Args:
        problem: The problem.
        motion: Path of the phases.
        profiles: How fast each phase is travelled.
        phase_starts: Start of each phase [s].
        finish_s: End of the plan [s].
        transitions: Melts and freezes.
    """
    heating = transition_model(problem).heating(transitions)
    events = [time for item in heating for time in item.event_times() if time <= finish_s]
    times = np.array(sorted({0.0, finish_s, *np.arange(0.0, finish_s, HOLD_SAMPLE_S), *events}))
    knots = _knots(motion, profiles, phase_starts)
    t, q, v, a, mode, wheel_rad_s = _on_path(knots, times, problem.robot)
    just_after = t + 2 * SAME_TIME_S
    resting = ~(v.any(axis=1) | a.any(axis=1))
    soft = np.column_stack([item.soft(just_after) for item in heating])
    mode[resting] = soft[resting]
    metal = np.stack([item.temperature_and_melt_fraction(t) for item in heating], -1)
    return Samples(
        t_s=t,
        q=q,
        v=v,
        a=a,
        mode=mode,
        wheel_rad_s=wheel_rad_s,
        temperature_C=metal[0],
        melt_fraction=metal[1],
        heater_setpoint_C=np.column_stack([item.setpoint_C(just_after) for item in heating]),
        heater_current_A=np.column_stack([item.current_A(just_after) for item in heating]),
    )


Knots = tuple[Array, Array, Array, Array, NDArray[np.int64], Array]
"""Times, q, v, a, modes and wheel speeds, by rows."""


def _knots(
    motion: Motion, profiles: Sequence[SpeedProfile], phase_starts: Sequence[float]
) -> Knots:
    """The motion alone: the start of every piece of its profiles, and a stop after every phase.

    From each row on the robot moves with input v + a (t' - t) in its mode, or rests.
    """
    still, resting, modes = np.zeros((1, INPUTS)), np.zeros((1, WHEELS)), np.array(motion.sequence)
    found = [(np.zeros(1), motion.states[0, :1], still, still, modes[:1], resting)]
    for i, profile in enumerate(profiles):
        start = phase_starts[i]
        if profile.duration_s <= SAME_TIME_S:
            continue
        stop = float(found[-1][0][-1])
        if start <= stop + SAME_TIME_S:
            start = stop
            t, q, v, a, mode, wheels = found[-1]
            found[-1] = t[:-1], q[:-1], v[:-1], a[:-1], mode[:-1], wheels[:-1]
        k = np.minimum(profile.x[:-1].astype(int), len(motion.inputs[i]) - 1)
        pace, rate = profile.speed[:, None], profile.acceleration[:, None]
        s, change = motion.inputs[i, k], motion.changes[i, k]
        begin = s + change * (profile.x[:-1] - k - 1 / 2)[:, None]
        found.append(
            (
                start + profile.time_s,
                np.concatenate([profile.q[:-1], motion.states[i, -1:]]),
                np.concatenate([begin * pace, still]),
                np.concatenate([s * rate + change * pace**2, still]),
                np.tile(modes[i], (len(k) + 1, 1)),
                np.concatenate([profile.wheel_rad_s, resting]),
            )
        )
    t, q, v, a, mode, wheels = (np.concatenate(column) for column in zip(*found, strict=True))
    return t, q, v, a, mode, wheels


def _on_path(knots: Knots, times: Array, robot: Robot) -> Knots:
    """The knots, and what is between them at further times."""
    known, q, v, a, mode, wheels = knots
    further = new_times(times, known)
    at = np.searchsorted(known, further, side="right") - 1
    elapsed = (further - known[at])[:, None]
    change = a[at] * elapsed**2
    between = flown(robot, q[at], v[at] * elapsed + change / 2, change, mode[at])
    later = v[at] + a[at] * elapsed
    t = np.concatenate([known, further])
    order = np.argsort(t, kind="stable")
    rows = np.concatenate([np.arange(len(known)), at])[order]
    turned = wheel_speeds(robot, between, later, mode[at])
    both = (q, between), (v, later), (wheels, turned)
    q, v, wheels = (np.concatenate(each)[order] for each in both)
    return t[order], q, v, a[rows], mode[rows], wheels
