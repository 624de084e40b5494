"""The film of a plan, and the plan over time: places along a stretched time axis.

Plain data for the page and its script. Lengths are in millimetres and y points down, as SVG has it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from twosra_mpc import Plan, Problem, RobotShape, robot_shape
from twosra_mpc.checking.sweep import Clearance
from twosra_mpc.plans.trajectory import Interval, Samples, stiffness_intervals, stretches
from twosra_mpc.plotting import TimeStretch, world_figures
from twosra_mpc.plotting.playback import PLACES, Playback, plan_playback
from twosra_mpc.plotting.world_figures import length, names_m, shown_m
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import mode_name, soft_segments

ARC_POINTS = 16  # of an arc: chords miss it by less than a pixel
_NAME_M = np.array([0.006, 0.016])  # from an object to its name, beside it and above it
_MARGIN_MM, _ASPECT = 22.0, 1.5  # around the robot in the box that is shown, and of that box
_SAME_S = 1e-6  # events closer than this are one
_SHORTEST_S, _LONGEST_S = 2.0, 24.0  # of the film at normal speed
_PHASE_S, _REST_S = 2.5, 4.0  # of the film, for each phase and for all waits together


def pose(shape: RobotShape) -> dict[str, Any]:
    """Outlines of the robot, each as the value of an SVG ``points`` attribute [mm, y down].

    Those of segments, links, units and wheels, the centres of the units, and the origin b0.
    """
    parts = ("segments", "links", "units", "wheels", "centres")
    outlines = {part: list(map(svg_points, getattr(shape, part))) for part in parts}
    return {**outlines, "origin": svg_points(shape.origin)}


def film_of(plan: Plan, playback: Playback) -> dict[str, Any]:
    """Make the film of a plan from its playback, as plain data for the page's script.

    Frames are at equal distances along the stretched time axis; while the robot waits, its pose is
    stored once, and ``pose`` is the place of each frame's in ``poses``. ``events`` are the frames
    at which something begins or ends, ``length_s`` is how long the film plays at normal speed.

    Raises:
        NoPlanError: If there is no plan.
    """
    times = playback.time_s
    shown = _poses(playback.problem.robot.geometry, playback.q)
    if playback.problem.objects:
        rows = np.unique(shown["pose"], return_index=True)[1]
        placed = zip(shown["poses"], playback.q[rows], playback.objects[rows], strict=True)
        shown["poses"] = [each | objects_at(playback, *where) for each, *where in placed]
    length_s = min(_LONGEST_S, _REST_S + _PHASE_S * len(plan.phases))
    if not plan.transitions:  # nothing is waited for: the true time
        length_s = float(np.clip(plan.moving_s, _SHORTEST_S, _LONGEST_S))
    events = {int(np.searchsorted(times, t - _SAME_S)) for t in event_times(plan)}
    return {
        "length_s": length_s,
        "time_s": np.round(times, 6).tolist(),
        **shown,
        "state": [playback.states(row) for row in range(PLACES)],
        "temperature_C": np.round(playback.temperature_C, 2).tolist(),
        "melt_fraction": np.round(playback.melt_fraction, 4).tolist(),
        "current_A": np.round(plan.trajectory.at(times).heater_current_A, 4).tolist(),
        "doing": [*map(playback.doing, range(PLACES - 1)), "the end of the plan"],
        "events": sorted(event for event in events if event < PLACES),
    }


def ghost_of(plan: Plan, time_s: Sequence[float]) -> dict[str, Any]:
    """Another plan at the times of a film: poses, and which of them each frame shows."""
    q = plan.trajectory.configuration(np.minimum(time_s, plan.duration_s))
    return _poses(plan.robot.geometry, q)


def _poses(geometry: Geometry, q: Array) -> dict[str, Any]:
    """Poses of the robot at configurations (rows, 3 + n), and which of them each row shows."""
    new = np.any(np.abs(np.diff(q, axis=0)) > 1e-9, axis=1)
    shapes = robot_shape(geometry, q[[True, *new]], ARC_POINTS)
    robots = [pose(RobotShape(*parts)) for parts in zip(*vars(shapes).values(), strict=True)]
    return {"pose": [0, *np.cumsum(new).tolist()], "poses": robots}


def objects_at(playback: Playback, q: Array, poses: Array) -> dict[str, Any]:
    """Poses of objects, (objects, 3), and places of their names beside the robot at q."""
    shape = robot_shape(playback.problem.robot.geometry, q)
    outlines = world_figures.outlines_m(playback.problem, poses)
    sides = [world_figures.free_side(outline, shape) for outline in outlines]
    return {
        "objects": [moved_to(pose) for pose in poses],
        "names": [
            [*svg_points(at + way * _NAME_M).split(","), ("middle", "start", "end")[round(way[0])]]
            for at, way in sides
        ],
    }


def moved_to(pose: Array) -> str:
    """The SVG transform from the frame of an object at a pose (3,)."""
    x, y, phi = pose.tolist()
    return f"translate({1e3 * x:z.2f},{-1e3 * y:z.2f}) rotate({-math.degrees(phi):z.2f})"


def mission(problem: Problem, aims: Sequence[tuple[int, Array]] = ()) -> dict[str, Any]:
    """Objects in their own frames, where they are and shall be, as SVG has it [mm, y down]."""
    own = np.zeros(POSE)
    return {
        "objects": [
            {
                "name": item.name,
                "fill": world_figures.fill_of(number),
                "edge": world_figures.edge_of(number),
                "points": svg_points(world_figures.outline_m(item, own)),
                "at": moved_to(item.pose.pose),
            }
            for number, item in enumerate(problem.objects)
        ],
        "targets": [(number, moved_to(pose)) for number, pose in aims],
    }


def plane_of(
    problem: Problem,
    start: RobotShape,
    ends: Sequence[RobotShape],
    box: tuple[float, float, float, float],
    nearest: Clearance | None = None,
    aims: Sequence[tuple[int, Array]] = (),
) -> dict[str, Any]:
    """The plane in a box: what is around, start and goals, objects and where they shall be."""
    geometry = problem.robot.geometry
    return {
        "box": box,
        "grid": grid(box),
        "around": surroundings(problem, nearest, box),
        "ghosts": [("start", pose(start)), *(("goal", pose(end)) for end in ends)],
        "mission": mission(problem, aims),
        "fibre_mm": 2e3 * geometry.fibre_radius_m,
        "number_mm": 400 * geometry.unit_frame_m,
    }


def motion_of(plan: Plan, box: tuple[float, float, float, float] | None = None) -> dict[str, Any]:
    """Everything that is drawn of a plan: plane, film, timeline; the plane in a box, or all."""
    playback, samples = plan_playback(plan), plan.trajectory.samples
    scale = Thermometer.of(plan)
    places = playback.q, samples.q[0], *_goals(plan)
    shapes = [robot_shape(playback.problem.robot.geometry, at, ARC_POINTS) for at in places]
    start, *ends = shapes[1:]
    if box is None:
        box = filmed_box(plan.problem, shapes, world_figures.seen_m(plan.trajectory))
    aims = world_figures.targets(plan.trajectory)
    levels = [[scale.level(t) for t in column] for column in samples.temperature_C.T.tolist()]
    return {
        **plane_of(plan.problem, start, ends, box, playback.nearest, aims),
        "data": {
            "film": film_of(plan, playback),
            "temperature_C": [scale.low_C, scale.high_C],
        },
        "moves": plan.trajectory.duration_s > 0.0,
        "lanes": lanes(plan, playback.stretch),
        "ticks": ticks(playback.stretch),
        "curves": [curve(samples.t_s, column, playback.stretch) for column in levels],
        "thermometer": scale,
    }


def _goals(plan: Plan) -> list[Array]:
    """Configurations to reach; of the last one, its middle."""
    reached, last = world_figures.goals(plan.trajectory), plan.problem.goal.configuration
    if not plan.problem.ends_anywhere:
        reached[-1] = np.where(np.isnan(last), reached[-1], last)
    return reached


def grid(box: tuple[float, float, float, float]) -> dict[str, Any]:
    """Lines every 50 mm, or 10, 100 or more times that far apart in a box that is not so large."""
    left, top, width, height = box
    step = next((s for s in (50, 100, 200, 500, 1000) if width / s <= 10), int(width / 5))
    return {
        "step": step,
        "x": [x for x in range(int(left // step) * step, int(left + width) + 1, step) if x > left],
        "y": [y for y in range(int(top // step) * step, int(top + height) + 1, step) if y > top],
    }


def event_times(plan: Plan) -> list[float]:
    """Times at which a phase, a heating, a melt, a cooling or a freeze begins or ends [s]."""
    times = {0.0, plan.trajectory.duration_s}
    times.update(t for phase in plan.phases for t in phase[1:])
    times.update(t for item in plan.transitions for t in item[2:])
    times.update(plan.trajectory.done_s)
    kept: list[float] = []
    for t in sorted(times):
        if not kept or t > kept[-1] + 1e-4:
            kept.append(t)
    return kept


def svg_points(points: Array) -> str:
    """Points (n, 2) or (2,) [m, y up] as an SVG ``points`` attribute [mm, y down]."""
    pairs = np.reshape(points, (-1, 2)) * (1e3, -1e3)
    return " ".join(f"{x:z.2f},{y:z.2f}" for x, y in pairs)


def filmed_box(
    problem: Problem, shapes: Sequence[RobotShape], more_m: Array
) -> tuple[float, float, float, float]:
    """Corner and size of the box that shows ``shapes``, points (k, 2) and what is near them.

    In mm, y down.
    """
    parts = [part for shape in shapes for part in (shape.units, shape.wheels, shape.segments)]
    parts.append(more_m)
    points = shown_m(problem, np.concatenate([part.reshape(-1, 2) for part in parts]))
    points = points * (1e3, -1e3)
    low, high = points.min(axis=0) - _MARGIN_MM, points.max(axis=0) + _MARGIN_MM
    width, height = high - low
    wide, tall = max(width, _ASPECT * height), max(height, width / _ASPECT)
    left, top = (low + high - (wide, tall)) / 2
    return float(left), float(top), float(wide), float(tall)


def surroundings(
    problem: Problem, nearest: Clearance | None, box: tuple[float, float, float, float]
) -> dict[str, Any]:
    """Surroundings of the robot, as SVG ``points`` and places [mm, y down], seen in ``box``."""
    left, top, width, height = box
    seen = np.array([(left, -top - height), (left + width, -top)]) / 1e3
    middles = {name: svg_points(np.array(at)) for name, at in names_m(problem, seen).items()}
    low, high = seen
    tasks = [(task, np.clip(task.ends[:, :2], low - 1.0, high + 1.0)) for task in problem.passes]
    return {
        "obstacles": [svg_points(obstacle.corners_m) for obstacle in problem.obstacles],
        "names": {name: at.split(",") for name, at in middles.items()},
        "tasks": [
            {
                "name": task.name or f"task {number}",
                "points": svg_points(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])),
                "at": svg_points(np.clip((x0, y1), low, high)).split(","),
            }
            for number, (task, ((x0, y0), (x1, y1))) in enumerate(tasks, start=1)
        ],
        "nearest": nearest
        and {
            "points": svg_points(nearest.points_m),
            "at": svg_points(nearest.points_m.mean(axis=0)).split(","),
            "length": length(nearest),
            "words": f"{length(nearest)}, {nearest.name} at {nearest.at_s:z.1f} s",
        },
    }


_DIGIT, _WIDE_DIGIT = 0.009, 0.028  # width of a tick label's digit on a wide and a narrow screen


class Span(NamedTuple):
    """Part of a lane: from place to place, how it looks, what it says, and how high it is."""

    left: float
    width: float
    look: str
    label: str
    title: str
    level: float = 1.0


class Lane(NamedTuple):
    """One row of the timeline."""

    name: str
    spans: tuple[Span, ...]


class Tick(NamedTuple):
    """A time worth a label; on narrow screens only some of them are shown."""

    place: float
    label: str
    on_narrow: bool


class Thermometer(NamedTuple):
    """Scale of temperatures that holds everything the plan does [C]."""

    low_C: float
    high_C: float
    solid_C: float
    liquid_C: float

    @classmethod
    def of(cls, plan: Plan) -> Thermometer:
        """Choose the scale: in tens of degrees, with room above and below."""
        solid, liquid = plan.problem.stiffness_thresholds_C
        shown = [*plan.trajectory.samples.temperature_C.ravel().tolist(), solid, liquid]
        low, high = 10 * np.floor(min(shown) / 10 - 0.2), 10 * np.ceil(max(shown) / 10 + 0.2)
        return cls(float(low), float(high), solid, liquid)

    def level(self, temperature_C: float) -> float:
        """Place of a temperature on the scale, 0 to 100 from below."""
        return 100 * (temperature_C - self.low_C) / (self.high_C - self.low_C)

    @property
    def marks(self) -> list[float]:
        """Round temperatures worth a mark [C]."""
        step = 10.0 if self.high_C - self.low_C <= 60 else 20.0
        return np.arange(self.low_C, self.high_C + 1, step).tolist()

    @property
    def melting_words(self) -> str:
        """Name of the threshold."""
        if self.solid_C == self.liquid_C:
            return f"melts at {self.solid_C:zg} °C"
        return f"changes from {self.solid_C:zg} to {self.liquid_C:zg} °C"


def lanes(plan: Plan, stretch: TimeStretch) -> list[Lane]:
    """Return task, motion, stiffness and heater lanes from top to bottom."""
    each = tuple(_tasks(plan, stretch))
    made = [Lane("task", each)] if each else []
    made.append(Lane("motion", tuple(_motion(plan, stretch))))
    for segment, intervals in enumerate(stiffness_intervals(plan.trajectory), start=1):
        made.append(Lane(f"segment {segment}", tuple(_stiffness(intervals, segment, stretch))))
        heater = _heater(plan.trajectory.samples, segment, stretch)
        made.append(Lane(f"heater {segment}", tuple(heater)))
    return made


def _tasks(plan: Plan, stretch: TimeStretch) -> Iterator[Span]:
    for number, stage in enumerate(stretches(plan.trajectory), start=1):
        words = f"{number} {stage.words}", f"{number}: {stage.words}"
        span = _span(stretch, stage.from_s, stage.to_s, "done", *words)
        fits = len(span.label) + 1 < span.width  # else the number alone
        yield span if fits else span._replace(label=str(number))


def _motion(plan: Plan, stretch: TimeStretch) -> Iterator[Span]:
    for phase in plan.phases:
        soft = [f"segment {j + 1}" for j in soft_segments(phase.mode)]
        what = f"bending {' and '.join(soft)}" if soft else "driving rigidly"
        look, mode = "bending" if soft else "driving", mode_name(phase.mode)
        yield _span(stretch, phase.start_s, phase.end_s, look, mode, f"{mode} {what}")


def _stiffness(intervals: Sequence[Interval], segment: int, stretch: TimeStretch) -> Iterator[Span]:
    for low, high, state in intervals:
        if high > low:
            yield _span(stretch, low, high, state, state, f"segment {segment} {state}")


def _heater(samples: Samples, segment: int, stretch: TimeStretch) -> Iterator[Span]:
    """Spans in which the heater is on, each as high as its current."""
    current, most = samples.heater_current_A[:, segment - 1], float(samples.heater_current_A.max())
    changes = [0, *(np.flatnonzero(np.diff(current)) + 1).tolist(), len(current) - 1]
    for first, last in pairwise(changes):
        if current[first] > 0 and first < last:
            low, high = float(samples.t_s[first]), float(samples.t_s[last])
            what = f"heater {segment} at {current[first]:z.3g} A"
            span = _span(stretch, low, high, "heating", f"{current[first]:z.2g} A", what)
            yield span._replace(level=round(float(current[first]) / most, 3))


def _span(stretch: TimeStretch, low: float, high: float, look: str, label: str, what: str) -> Span:
    """Part of a lane from one time to another, whose title says what is done and when."""
    left, right = (100 * stretch.forward(np.array([low, high]))).tolist()
    title = f"{what}, {low:z.2f} s to {high:z.2f} s"
    return Span(round(left, 3), round(right - left, 3), look, label, title)


def ticks(stretch: TimeStretch) -> list[Tick]:
    """Return the times worth a label, in order."""
    few = set(stretch.ticks(_WIDE_DIGIT))
    return [
        Tick(round(100 * float(stretch.forward(np.array(t))), 3), label, t in few)
        for t, label in sorted(stretch.ticks(_DIGIT).items())
    ]


def curve(t_s: Array, levels: Sequence[float], stretch: TimeStretch) -> str:
    """Levels, 0 to 100 from below, as an SVG ``points`` attribute in a box of 1000 by 100."""
    places = 1000 * stretch.forward(t_s)
    return " ".join(f"{x:z.2f},{100 - y:z.2f}" for x, y in zip(places, levels, strict=True))
