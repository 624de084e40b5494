"""The film of a plan: where everything is at regular places along a stretched time axis.

Every outline is computed here with ``robot_shape``; the page only shows what it is given. Lengths
are in mm with y pointing down, as SVG draws.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.plotting import TimeStretch, robot_shape, segment_states
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import mode_name

Array = NDArray[np.float64]

FRAMES = 1001  # the slider's places
ARC_POINTS = 16
_MARGIN_MM, _ASPECT = 22.0, 1.5  # around the robot in the box that is shown, and of that box
_SAME_S = 1e-6  # events closer than this are one
_SHORTEST_S, _LONGEST_S = 2.0, 24.0  # of the film at normal speed
_PHASE_S, _REST_S = 2.5, 4.0  # of the film, for each phase and for all waits together


@dataclass(frozen=True)
class Pose:
    """Outlines of the robot, each as the value of an SVG ``points`` attribute [mm, y down]."""

    segments: tuple[str, ...]
    links: tuple[str, ...]
    units: tuple[str, ...]
    wheels: tuple[str, ...]
    centres: tuple[str, ...]  # of the units
    origin: str  # b0


@dataclass(frozen=True)
class Film:
    """Frames at equal distances along the stretched time axis; lists have one entry a frame.

    Attributes:
        length_s: How long it plays at normal speed [s].
        time_s: Time in the plan [s].
        pose: Index into ``poses``: while the robot waits, its pose is stored once.
        poses: Poses in order of time.
        state: "rigid", "melting", "soft" or "freezing" of both segments.
        temperature_C: Of both segments.
        melt_fraction: Of both segments, 0 solid, 1 liquid.
        current_A: Of both heaters.
        doing: What happens, in words.
        events: Frames at which something begins or ends, in order.
    """

    length_s: float
    time_s: list[float]
    pose: list[int]
    poses: tuple[Pose, ...]
    state: list[tuple[str, str]]
    temperature_C: list[list[float]]
    melt_fraction: list[list[float]]
    current_A: list[list[float]]
    doing: list[str]
    events: list[int]

    def document(self) -> dict[str, Any]:
        """The film as plain data for the page."""
        return asdict(self)


def film_of(plan: Plan, samples: Samples, stretch: TimeStretch) -> Film:
    """Make the film of a plan. Between samples, configurations are interpolated linearly.

    Args:
        plan: The plan.
        samples: Its samples.
        stretch: The stretched time axis.
    """
    end_s = float(samples.t_s[-1])
    times = np.minimum(stretch.inverse(np.linspace(0.0, 1.0, FRAMES)), end_s)
    held = np.searchsorted(samples.t_s, times + _SAME_S, side="right") - 1
    states = [_states_at(plan, segment, times) for segment in (1, 2)]
    places, poses = _poses(plan.robot.geometry, _columns_at(times, samples.t_s, samples.q))
    return Film(
        length_s=film_length_s(plan),
        time_s=[round(t, 6) for t in times.tolist()],
        pose=places,
        poses=poses,
        state=list(zip(*states, strict=True)),
        temperature_C=_rounded(_columns_at(times, samples.t_s, samples.temperature_C), 2),
        melt_fraction=_rounded(_columns_at(times, samples.t_s, samples.melt_fraction), 4),
        current_A=_rounded(samples.heater_current_A[held], 4),
        doing=[
            _doing(plan, t, (first, second), (current > 0).tolist())
            for t, first, second, current in zip(
                times.tolist(), *states, samples.heater_current_A[held], strict=True
            )
        ],
        events=sorted(
            {int(np.searchsorted(times, t - _SAME_S)) for t in event_times(plan) if t <= end_s}
        ),
    )


def film_length_s(plan: Plan) -> float:
    """How long the film plays [s]: the true time where nothing is waited for, else as fits."""
    if not plan.transitions:
        return float(np.clip(plan.moving_s, _SHORTEST_S, _LONGEST_S))
    return min(_LONGEST_S, _REST_S + _PHASE_S * len(plan.phases))


def event_times(plan: Plan) -> list[float]:
    """Times at which a phase, a heating, a melt, a cooling or a freeze begins or ends [s]."""
    times = {0.0, plan.duration_s or 0.0}
    times.update(t for phase in plan.phases for t in phase[1:])
    times.update(t for item in plan.transitions for t in item[2:])
    kept: list[float] = []
    for t in sorted(times):
        if not kept or t > kept[-1] + 1e-4:
            kept.append(t)
    return kept


def _poses(geometry: Geometry, q: Array) -> tuple[list[int], tuple[Pose, ...]]:
    places, poses = list[int](), list[Pose]()
    last: Array | None = None
    for row in q:
        if last is None or np.abs(row - last).max() > 1e-9:
            poses.append(pose_of(geometry, row))
            last = row
        places.append(len(poses) - 1)
    return places, tuple(poses)


def pose_of(geometry: Geometry, q: Array) -> Pose:
    """Place the robot at ``q`` [m, m, rad, 1/m, 1/m], shape (5,)."""
    shape = robot_shape(geometry, q, ARC_POINTS)
    return Pose(
        segments=tuple(map(svg_points, shape.segments)),
        links=tuple(map(svg_points, shape.links)),
        units=tuple(map(svg_points, shape.units)),
        wheels=tuple(map(svg_points, shape.wheels)),
        centres=tuple(map(svg_points, shape.centres)),
        origin=svg_points(shape.origin),
    )


def svg_points(points: Array) -> str:
    """Points (n, 2) or (2,) [m, y up] as an SVG ``points`` attribute [mm, y down]."""
    pairs = np.reshape(points, (-1, 2)) * (1e3, -1e3)
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in pairs)


def _states_at(plan: Plan, segment: int, times: Array) -> list[str]:
    spans = segment_states(plan, segment, max(float(times[-1]), _SAME_S))
    begins = [low for low, _, _ in spans]
    return [spans[max(0, bisect_right(begins, t + _SAME_S) - 1)][2] for t in times.tolist()]


def _doing(plan: Plan, t: float, states: tuple[str, str], heated: Sequence[bool]) -> str:
    """What happens at ``t``: motion first, then what is waited for."""
    if t >= (plan.duration_s or 0.0) - _SAME_S:
        return "the end of the plan"
    for phase in plan.phases:
        if phase.start_s - _SAME_S <= t < phase.end_s - _SAME_S:
            verb = "bending" if any(phase.mode) else "driving"
            return f"{verb} in mode {mode_name(phase.mode)}"
    changing = [f"segment {j + 1} is {s}" for j, s in enumerate(states) if s.endswith("ing")]
    if len(changing) == 2 and states[0] == states[1]:
        return f"waiting: both segments are {states[0]}"
    if changing:
        return f"waiting: {' and '.join(changing)}"
    if any(heated):
        which = " and ".join(str(j + 1) for j in (0, 1) if heated[j])
        return f"waiting: heater{'s' * all(heated)} {which} on"
    return "waiting: cooling" if "soft" in states else "waiting"


def _columns_at(times: Array, t_s: Array, values: Array) -> Array:
    return np.column_stack([np.interp(times, t_s, column) for column in values.T])


def _rounded(values: Array, digits: int) -> list[list[float]]:
    rounded: list[list[float]] = np.round(values, digits).tolist()
    return rounded


def filmed_box(poses: Sequence[Pose]) -> tuple[float, float, float, float]:
    """Corner and size of the box that shows all ``poses`` with a margin [mm, y down]."""
    parts = [(*pose.units, *pose.wheels, *pose.segments) for pose in poses]
    corners = {pair for pose in parts for part in pose for pair in part.split()}
    points = np.array([[float(value) for value in pair.split(",")] for pair in corners])
    low, high = points.min(axis=0) - _MARGIN_MM, points.max(axis=0) + _MARGIN_MM
    width, height = high - low
    wide, tall = max(width, _ASPECT * height), max(height, width / _ASPECT)
    left, top = (low + high - (wide, tall)) / 2
    return float(left), float(top), float(wide), float(tall)
