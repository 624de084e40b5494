"""Trajectory of a plan at any time: the one place that looks between its samples.

The stiffness of the segments over it is told in intervals: rigid, melting, soft or freezing.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.model import flow
from twosra_mpc.model.flow import rigid_moves, twists
from twosra_mpc.model.kinematics import wheel_travel
from twosra_mpc.model.rows import by_modes
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.speeds import Driven, driven
from twosra_mpc.problem.tasks import Pass, Stage, Task
from twosra_mpc.robot.coordinates import INPUTS, POSE, WHEELS, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode
from twosra_mpc.thermal.model import replayed
from twosra_mpc.timing import SegmentHeating, Transition, transition_model
from twosra_mpc.validation import ArrayValue

SAME_TIME_S = 1e-6  # events closer than this are one
_STRAY = 1e-9  # m or rad: so near to the next pose is where a mean twist leads
_LOOK_S = 0.02  # between looks whether a box is entered
HIGHEST_RATE_HZ = 1000.0  # of set-points; no controller of such robots takes more


class Phase(NamedTuple):
    """One motion phase; holds are the gaps between phases. Times in s."""

    mode: Mode
    start_s: float
    end_s: float


@public
@dataclass(frozen=True, eq=False, repr=False)
class Samples(ArrayValue):
    """A plan at some times, for a robot of n segments; arrays are read-only.

    On a plan's own grid modes, heater commands and the inputs' rate of change hold to the next
    sample: from t_k on the input is v_k + a_k (t - t_k). While something is soft a_k is along v_k
    and v_(k+1), as a change of speed alone does not change the path; a drive may turn on the way.

    Attributes:
        t_s: Time [s], (rows,).
        q: Configuration [m, m, rad, 1/m ...], (rows, 3 + n).
        v: Input v1, v2, u0, v0, r0 [m/s, m/s, m/s, m/s, rad/s], (rows, 5).
        a: Its rate of change, per s, (rows, 5).
        mode: 1 where a segment is liquid, (rows, n).
        wheel_rad_s: Wheel speeds, (rows, 4).
        temperature_C: Expected temperature of the segments, (rows, n).
        melt_fraction: Expected melt fraction of the segments, 0 solid, 1 liquid, (rows, n).
        heater_setpoint_C: Temperature set-points, (rows, n).
        heater_current_A: Feed-forward heater currents, (rows, n).
    """

    t_s: Array
    q: Array
    v: Array
    a: Array
    mode: NDArray[np.int64]
    wheel_rad_s: Array
    temperature_C: Array
    melt_fraction: Array
    heater_setpoint_C: Array
    heater_current_A: Array

    def __post_init__(self) -> None:
        segments = self.mode.shape[-1]
        width = {"t_s": (), "q": (POSE + segments,), "wheel_rad_s": (WHEELS,)}
        width |= {"v": (INPUTS,), "a": (INPUTS,)}
        for item in fields(self):
            array = getattr(self, item.name)
            shape = (len(self.t_s), *width.get(item.name, (segments,)))
            if array.shape != shape:
                raise InputError(f"samples.{item.name}", array.shape, f"an array of shape {shape}")
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def moves(self) -> NDArray[np.bool_]:
        """True where the robot moves from each sample to the next, (rows,)."""
        return ((self.v != 0) | (self.a != 0)).any(axis=1)

    def to_dict(self) -> dict[str, Any]:
        """The samples as plain data."""
        return {item.name: getattr(self, item.name).tolist() for item in fields(self)}


@public
@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(ArrayValue):
    """A plan's course from t = 0 to its end, asked at any times, which are clipped to that.

    Between samples the configuration follows the kinematics from the sample before, with the input
    in force; temperatures and melt fractions are those of the heating model. A time less than a
    microsecond before a sample is taken to be the sample's.

    Attributes:
        problem: The problem planned for (robot included).
        samples: The plan on its own grid.
        phases: Motion phases in order.
        transitions: Melts and freezes by heater time.
        done_s: When each task is done [s].
    """

    problem: Problem
    samples: Samples
    phases: tuple[Phase, ...]
    transitions: tuple[Transition, ...]
    done_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        segments, found = self.problem.robot.coordinates.segments, self.samples.mode.shape[1]
        if len(self.done_s) != (tasks := len(self.problem.tasks)):
            raise InputError("done_s", self.done_s, f"a time for each of {tasks} tasks")
        if found != segments:
            allowed = f"a column for each of {segments} segments"
            raise InputError("samples.mode", f"{found} columns", allowed)
        for i, phase in enumerate(self.phases):
            if len(phase.mode) != segments:
                raise InputError(f"phases.{i}.mode", phase.mode, f"a list of {segments} values")
        for i, item in enumerate(self.transitions):
            if not 1 <= item.segment <= segments:
                where = f"transitions.{i}.segment"
                raise InputError(where, item.segment, f"from 1 to {segments}")

    @property
    def duration_s(self) -> float:
        """Time from start to the end of the last phase or transition."""
        return float(self.samples.t_s[-1])

    def at(self, t: ArrayLike) -> Samples:
        """Everything at these times [s], (n,): one row each."""
        times, at, elapsed = self._in_force(t)
        held, q = self.samples, self._flown(at, elapsed)
        v, mode = self._input(at, elapsed), held.mode[at]
        metal = np.stack([item.temperature_and_melt_fraction(times) for item in self._heating], -1)
        return Samples(
            t_s=times,
            q=q,
            v=v,
            a=held.a[at],
            mode=mode,
            wheel_rad_s=wheel_speeds(self.problem.robot, q, v, mode),
            temperature_C=metal[0],
            melt_fraction=metal[1],
            heater_setpoint_C=held.heater_setpoint_C[at],
            heater_current_A=held.heater_current_A[at],
        )

    def configuration(self, t: ArrayLike) -> Array:
        """Configuration q at these times [s], (n,): (n, 3 + segments)."""
        _, at, elapsed = self._in_force(t)
        return self._flown(at, elapsed)

    def heater_setpoint_C(self, t: ArrayLike) -> Array:
        """Set-points in force at these times [s], (n,): (n, segments)."""
        return self.samples.heater_setpoint_C[self._in_force(t)[1]]

    def wheel_travel_rad(self, t: ArrayLike) -> Array:
        """Turns of each wheel since t = 0, at these times [s], (n,): (n, 4)."""
        _, at, elapsed = self._in_force(t)
        return self._turned_rad[at] + self._rolled(at, elapsed)

    def held(self, rate_Hz: float | None = None) -> Samples:
        """Set-points to send: rows whose inputs and wheel speeds hold to the next and lose nothing.

        They are means from row to row, so that every wheel turns as far as in the plan; where a
        drive turns on the way, they lead from pose to pose. Rows are at a regular rate, where
        phases begin and end, and at the end; or on the plan's own grid.

        Raises:
            InputError: If the rate is not positive, or beyond 1000 Hz.
        """
        t = self.samples.t_s
        if rate_Hz is not None:
            ends = [time for phase in self.phases for time in (phase.start_s, phase.end_s)]
            events = np.unique([*ends, self.duration_s])
            regular = self.regular_times(rate_Hz)
            t = np.sort(np.concatenate([events, new_times(regular, events)]))
        _, at, elapsed = self._in_force(t)
        moved = self._moved[at] + self._input(at, elapsed / 2) * elapsed[:, None]
        dt = np.append(np.diff(t), 1.0)[:, None]  # the last row rests
        found, turned = self.at(t), self.wheel_travel_rad(t)
        s, poses = np.diff(moved, axis=0, append=moved[-1:]), found.q[:, :POSE]
        v, wheels = s / dt, np.diff(turned, axis=0, append=turned[-1:]) / dt
        astray = np.abs(rigid_moves(poses[:-1, 2], s[:-1, 2:]) - np.diff(poses, axis=0)).max(axis=1)
        rows = np.flatnonzero((astray > _STRAY) & ~found.mode[:-1].any(axis=1))  # it turns
        v[rows, 2:] = twists(poses[rows], poses[rows + 1], s[rows, 4]) / dt[rows]
        wheels[rows] = wheel_speeds(self.problem.robot, found.q[rows], v[rows], found.mode[rows])
        return replace(found, v=v, a=np.zeros_like(v), wheel_rad_s=wheels)

    def regular_times(self, rate_Hz: float) -> Array:
        """Times [s] at a regular rate, from 0 until no later than the end.

        Raises:
            InputError: If the rate is not positive, or beyond 1000 Hz.
        """
        check_rate(rate_Hz)
        return np.arange(int(np.floor(self.duration_s * rate_Hz + 1e-9)) + 1) / rate_Hz

    @property
    def wheel_rad_s_before(self) -> Array:
        """Wheel speeds just before each sample but the first, (rows - 1, 4) [rad/s]."""
        speeds = np.zeros_like(self.samples.wheel_rad_s)
        speeds[self.driven.rows] = self.driven.wheel_rad_s[2]
        return speeds[:-1]

    @cached_property
    def driven(self) -> Driven:
        """Speeds and accelerations where the samples move: their limits, wheels and effort."""
        held, dt_s = self.samples, np.append(np.diff(self.samples.t_s), 0.0)
        return driven(self.problem.robot, held.q, held.v, held.a, dt_s, held.mode)

    @cached_property
    def metal(self) -> tuple[tuple[Array, ...], ...]:
        """Values of each segment's state at the samples, as their currents make it from t = 0."""
        held, problem = self.samples, self.problem
        currents_A = held.heater_current_A.T
        each = zip(problem.segment_models, problem.start_states, currents_A, strict=True)
        return tuple(replayed(model, now, held.t_s, own) for model, now, own in each)

    @cached_property
    def _heating(self) -> Sequence[SegmentHeating]:
        return transition_model(self.problem).heating(self.transitions)

    @cached_property
    def _moved(self) -> Array:
        """Input displacement at the samples, (rows, 5) [m, m, m, m, rad]."""
        dt = np.diff(self.samples.t_s)
        steps = self._input(np.arange(len(dt)), dt / 2) * dt[:, None]
        return np.concatenate([np.zeros((1, INPUTS)), np.cumsum(steps, axis=0)])

    @cached_property
    def _turned_rad(self) -> Array:
        """Wheel travel at the samples."""
        steps = self._rolled(np.arange(len(self.samples) - 1), np.diff(self.samples.t_s))
        return np.concatenate([np.zeros((1, WHEELS)), np.cumsum(steps, axis=0)])

    def _in_force(self, t: ArrayLike) -> tuple[Array, NDArray[np.intp], Array]:
        """Times within the plan, the sample in force at each, and the time since that [s]."""
        known = self.samples.t_s
        times = np.clip(np.atleast_1d(np.asarray(t, dtype=float)), known[0], known[-1])
        if times.ndim > 1:
            raise InputError("t", t, "a time in s, or a list of them")
        at = np.searchsorted(known, times, side="right") - 1
        after = np.minimum(at + 1, len(known) - 1)
        # Rounding must not hold an input beyond its sample; asked at a sample, it is that sample.
        at = np.where((known[after] - times <= SAME_TIME_S) & (known[at] < times), after, at)
        return times, at, np.maximum(times - known[at], 0.0)

    def _input(self, at: NDArray[np.intp], elapsed: Array) -> Array:
        """Input ``elapsed`` [s] after the samples ``at``."""
        return self.samples.v[at] + self.samples.a[at] * elapsed[:, None]

    def _flown(self, at: NDArray[np.intp], elapsed: Array) -> Array:
        """Configuration ``elapsed`` [s] after the samples ``at``."""
        held, lasting = self.samples, elapsed[:, None]
        s, change = self._input(at, elapsed / 2) * lasting, held.a[at] * lasting**2
        return flown(self.problem.robot, held.q[at], s, change, held.mode[at])

    def _rolled(self, at: NDArray[np.intp], elapsed: Array) -> Array:
        """Turns of the wheels within ``elapsed`` [s] after the samples ``at``, by Simpson."""

        def speeds(share: float) -> Array:
            t = share * elapsed
            q, mode = self._flown(at, t), self.samples.mode[at]
            return wheel_speeds(self.problem.robot, q, self._input(at, t), mode)

        mean = (speeds(0.0) + 4 * speeds(0.5) + speeds(1.0)) / 6
        return mean * elapsed[:, None]


def check_rate(rate_Hz: float) -> None:
    """Check a rate of samples.

    Raises:
        InputError: If it is not positive, or beyond 1000 Hz.
    """
    if not 0 < rate_Hz <= HIGHEST_RATE_HZ:
        raise InputError("rate", rate_Hz, f"more than 0 and at most {HIGHEST_RATE_HZ:zg} Hz")


def new_times(times: Array, known: Array) -> Array:
    """Those of the growing ``times`` that are an event of their own beside the ``known`` ones."""
    after = np.searchsorted(known, times).clip(1, len(known) - 1)
    nearest = np.minimum(np.abs(times - known[after - 1]), np.abs(times - known[after]))
    return times[(nearest > SAME_TIME_S) & (np.diff(times, prepend=-np.inf) > SAME_TIME_S)]


def flown(robot: Robot, q: Array, s: Array, change: Array | None, mode: NDArray[np.int64]) -> Array:
    """Configurations after input displacements s = v h from q; rows at rest stay as they are.

    The input changes by ``change`` / h meanwhile, if it does: along itself where something is soft.
    """
    reached = q.copy()
    soft = mode.any(axis=1) & s.any(axis=1)
    rigid = ~mode.any(axis=1)
    changes = None if change is None else change[rigid, 2:]
    reached[rigid, :POSE] += rigid_moves(q[rigid, 2], s[rigid, 2:], changes)
    if soft.any():
        reached[soft] = flow.flown(robot, q[soft], s[soft], mode[soft])
    return reached


def wheel_speeds(robot: Robot, q: Array, v: Array, mode: NDArray[np.int64]) -> Array:
    """Speeds of the wheels that inputs ask for, row by row, (rows, 4) [rad/s]; zero at rest."""
    speeds = np.zeros((len(q), WHEELS))
    moving = v.any(axis=1)
    if moving.any():
        rows = q[moving], v[moving], mode[moving]
        (speeds[moving],) = by_modes(wheel_travel(robot), *rows)
    return speeds


State = Literal["rigid", "melting", "soft", "freezing"]
CHANGING: tuple[State, ...] = ("melting", "freezing")


class Interval(NamedTuple):
    """From ``start_s`` on, until ``end_s``, a segment is in one state."""

    start_s: float
    end_s: float
    state: State


def stiffness_intervals(trajectory: Trajectory) -> tuple[tuple[Interval, ...], ...]:
    """For each segment, the intervals that fill the plan; the last one may have no length."""
    changes = list[list[tuple[float, State]]]()
    for first in trajectory.problem.start_stiffness:
        changes.append([] if first is None else [(0.0, "soft" if first else "rigid")])
    for item in trajectory.transitions:
        changing: State = "melting" if item.to == "soft" else "freezing"
        own = changes[item.segment - 1]
        own += [(item.onset_s if own else 0.0, changing), (item.done_s, item.to)]
    return tuple(_intervals(each, trajectory.duration_s) for each in changes)


def state_at(intervals: Sequence[Interval], time_s: float) -> State:
    """The state at a time; at a border that of the interval that begins."""
    place = bisect_right([one.start_s for one in intervals], time_s + SAME_TIME_S) - 1
    return intervals[max(place, 0)].state


def soft_and_changing(states: Sequence[State]) -> tuple[Mode, Mode]:
    """Soft segments, also those that freeze, and those that melt or freeze; 1: they do."""
    soft = tuple(int(state in ("soft", "freezing")) for state in states)
    return soft, tuple(int(state in CHANGING) for state in states)


def _intervals(changes: list[tuple[float, State]], end_s: float) -> tuple[Interval, ...]:
    ends = [*(t for t, _ in changes[1:]), end_s]
    whole = [Interval(t, end, state) for (t, state), end in zip(changes, ends, strict=True)]
    return (*(one for one in whole[:-1] if one.end_s > one.start_s), whole[-1])


class Stretch(NamedTuple):
    """The part of a plan in which a stage is done.

    Attributes:
        stage: What is asked.
        from_s: Since when [s].
        to_s: When it is done [s].
    """

    stage: Stage
    from_s: float
    to_s: float

    @property
    def words(self) -> str:
        """Words for the task, e.g. "grasp cup"."""
        return self.stage.words

    @property
    def task(self) -> Task | None:
        """Task; None for the goal."""
        return self.stage.task


def stretches(trajectory: Trajectory) -> tuple[Stretch, ...]:
    """The stages of a plan, in order; none where a plan only reaches a goal."""
    if not trajectory.problem.tasks:
        return ()
    spans = pairwise((0.0, *trajectory.done_s, trajectory.duration_s))
    each = zip(trajectory.problem.stages, spans, strict=False)  # not all have a goal at the end
    return tuple(Stretch(stage, *span) for stage, span in each)


def entered_s(trajectory: Trajectory, box: Pass, since_s: float) -> float:
    """Time at which b0 is first seen in a box, from a time on [s]; that time if it never is."""
    known, looks = trajectory.samples.t_s, np.arange(since_s, trajectory.duration_s, _LOOK_S)
    t = np.union1d(looks, known[known >= since_s])
    met = box.met(trajectory.configuration(t)[:, :POSE])
    return float(t[met.argmax()])
