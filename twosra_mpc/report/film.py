"""The film of a plan: where everything is at regular places along a stretched time axis.

Every outline is computed here with ``robot_shape``; the page only shows what it is given. Lengths
are in mm with y pointing down, as SVG draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twosra_mpc.checking.sweep import Clearance
from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plotting.playback import PLACES, Playback
from twosra_mpc.plotting.world import length, names_m, shown_m
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array

ARC_POINTS = 16
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
    times, q = playback.time_s, playback.q
    new = np.any(np.abs(np.diff(q, axis=0)) > 1e-9, axis=1)
    shapes = robot_shape(playback.geometry, q[[True, *new]], ARC_POINTS)
    events = {int(np.searchsorted(times, t - _SAME_S)) for t in event_times(plan)}
    return {
        "length_s": film_length_s(plan),
        "time_s": np.round(times, 6).tolist(),
        "pose": [0, *np.cumsum(new).tolist()],
        "poses": [pose(RobotShape(*parts)) for parts in zip(*shapes, strict=True)],
        "state": [playback.states(row) for row in range(PLACES)],
        "temperature_C": np.round(playback.temperature_C, 2).tolist(),
        "melt_fraction": np.round(playback.melt_fraction, 4).tolist(),
        "current_A": np.round(plan.trajectory.at(times).heater_current_A, 4).tolist(),
        "doing": [*(playback.doing(row) for row in range(PLACES - 1)), "the end of the plan"],
        "events": sorted(event for event in events if event < PLACES),
    }


def film_length_s(plan: Plan) -> float:
    """How long the film plays [s]: the true time where nothing is waited for, else as fits."""
    if not plan.transitions:
        return float(np.clip(plan.moving_s, _SHORTEST_S, _LONGEST_S))
    return min(_LONGEST_S, _REST_S + _PHASE_S * len(plan.phases))


def event_times(plan: Plan) -> list[float]:
    """Times at which a phase, a heating, a melt, a cooling or a freeze begins or ends [s]."""
    times = {0.0, plan.trajectory.duration_s}
    times.update(t for phase in plan.phases for t in phase[1:])
    times.update(t for item in plan.transitions for t in item[2:])
    kept: list[float] = []
    for t in sorted(times):
        if not kept or t > kept[-1] + 1e-4:
            kept.append(t)
    return kept


def svg_points(points: Array) -> str:
    """Points (n, 2) or (2,) [m, y up] as an SVG ``points`` attribute [mm, y down]."""
    pairs = np.reshape(points, (-1, 2)) * (1e3, -1e3)
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in pairs)


def filmed_box(problem: Problem, shapes: Sequence[RobotShape]) -> tuple[float, float, float, float]:
    """Corner and size of the box that shows ``shapes`` and what is near them [mm, y down]."""
    parts = [part for shape in shapes for part in (shape.units, shape.wheels, shape.segments)]
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
    """What is around the robot, as SVG ``points`` and places [mm, y down], seen in ``box``."""
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
            "words": f"{length(nearest)}, {nearest.name} at {nearest.at_s:.1f} s",
        },
    }
