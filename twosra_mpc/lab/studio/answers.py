"""Answers of the studio: a problem in; drawings, bounds and plans out, as plain data.

Nothing here knows how messages travel. Every answer is an iterator of records with a ``kind``: the
drawing of the problem at once, then what is proved without surroundings, then plans that become
better until the gap that is asked for is closed, or nobody waits any more. A file of a problem is
saved as scenario, Python program, plan, set-points or report.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

import numpy as np

from twosra_mpc import (
    InputError,
    Plan,
    Problem,
    Result,
    RobotShape,
    confirmed_lower_bound,
    load_robot,
    plan,
    robot_shape,
    with_path_model,
)
from twosra_mpc.effort import limited
from twosra_mpc.files import attributes, built_in_names
from twosra_mpc.lab.analysis.critical_path import critical_path
from twosra_mpc.lab.analysis.explanation import reasons
from twosra_mpc.lab.report import player
from twosra_mpc.lab.report.page import drawn, report_page, scenario_toml
from twosra_mpc.plans.plan import relative_gap
from twosra_mpc.plans.setpoints import setpoints_csv
from twosra_mpc.plotting.world_figures import outlines_m
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import sequence_name
from twosra_mpc.validation import Count, Metres, Numbers, Value

GivenUp = Callable[[], bool]
Record = dict[str, Any]

_WORK = 150.0, 1500.0, math.inf  # units of plans in turn; the last has the problem's own limit
_BOUND = 100.0  # units of the bound without surroundings
_HANDLE_M = 0.16  # from b0 to the handle of the heading
_SHAPES = 241  # curvatures that are looked at to bring a segment under the hand
_ROOM_M = 0.08  # around a problem, in its picture


class Pull(Value):
    """A segment's outer end that is drawn to a point: the segment bends until it is nearest.

    ``end`` is "start" or "goal"; ``segment`` counts from 0. At the outermost segments it is the
    unit that is drawn.
    """

    end: Literal["start", "goal"]
    segment: Count
    x_m: Metres
    y_m: Metres


class Ask(Value):
    """Request of a page: a problem as scenario document, and the views it wants.

    ``pull`` bends the problem first, ``path_model`` gives its robot another one. ``box_mm`` is the
    part of the plane that is drawn, corner and size, y down; without it all of the problem. With
    ``film`` the plane is drawn and the plan is played, beside the greedy rule's if ``greedy``; else
    only what the hand moves is told.
    """

    problem: dict[str, Any]
    pull: Pull | None = None
    path_model: str | None = None
    box_mm: Numbers | None = None
    film: bool = False
    greedy: bool = False


def document(problem: Problem) -> Record:
    """The problem as a scenario document; a robot that is not built in is written out."""
    robot = problem.robot
    built_in = robot.name in built_in_names("robots") and load_robot(robot.name) == robot
    whole = robot.name if built_in else robot.model_dump(mode="json")
    return {**problem.scenario(), "robot": whole}


def asked_problem(ask: Ask) -> Problem:
    """The problem that is asked, bent as the hand wants.

    Raises:
        InputError: If it is none.
    """
    problem = Problem(**ask.problem)
    if ask.path_model is not None:
        problem = problem.with_values(robot=with_path_model(problem.robot, ask.path_model))
    if ask.pull is None:
        return problem
    kappa = pulled(problem, ask.pull)
    changed = getattr(problem, ask.pull.end).with_values(kappa_per_m=kappa)
    return problem.with_values(**{ask.pull.end: changed})


def pulled(problem: Problem, pull: Pull) -> tuple[float, ...]:
    """Curvatures with which a segment's outer end is nearest to a point: only it bends.

    Raises:
        InputError: If there is no such segment.
    """
    q, limit = _configuration(problem, pull.end), problem.robot.limits.curvature_per_m
    if (last := POSE + pull.segment) >= len(q):
        raise InputError("pull.segment", pull.segment, f"at most {len(q) - POSE - 1}")
    tried = np.repeat(q[None], _SHAPES, axis=0)
    tried[:, last] = np.linspace(-limit, limit, _SHAPES)
    ends = _outer_ends(robot_shape(problem.robot.geometry, tried, 2))[:, pull.segment]
    apart = np.hypot(*(ends - (pull.x_m, pull.y_m)).T)
    q[last] = round(float(tried[apart.argmin(), last]), 1)
    return tuple(q[POSE:].tolist())


def _outer_ends(shape: RobotShape) -> Array:
    """Ends of the segments away from b0, (..., n, 2); of the outermost, the units' centres."""
    both, count = shape.segments[..., [0, -1], :], shape.segments.shape[-3]
    outer = np.where(np.arange(count) < count // 2, 0, 1)[:, None, None]
    ends: Array = np.take_along_axis(both, np.broadcast_to(outer, (*both.shape[:-2], 1, 2)), -2)
    ends = ends[..., 0, :]
    ends[..., 0, :], ends[..., -1, :] = shape.centres[..., 0, :], shape.centres[..., 1, :]
    return ends


def answers(ask: Ask, given_up: GivenUp, others_wait: GivenUp = lambda: False) -> Iterator[Record]:
    """Draw a problem and plan it, better and better; with ``film``, play the last plan.

    Once there is a first answer, a longer search makes room while others wait for theirs: it ends
    with a record ``waiting``, and begins again after them.

    Raises:
        InputError: If the problem is none.
    """
    problem = asked_problem(ask)
    shown = scene(problem, ask.box_mm, plane=ask.film)
    yield shown
    around = bool(problem.obstacles or problem.objects)
    if around and not problem.tasks and problem.planner == "optimal":
        with limited(_BOUND, math.inf, given_up):
            free = plan(problem.with_values(obstacles=(), objects=(), workspace=None))
        if free.lower_bound is not None:
            yield {"kind": "bound", "lower_bound_s": free.lower_bound}
    for work in _WORK:
        while True:
            result, whole = _planned(problem, work, given_up, others_wait)
            if given_up():
                return
            if whole:
                break
            yield {"kind": "waiting"}
        complete = work == _WORK[-1] or not result.stopped_early
        yield told(result, complete=complete)
        if complete:
            break
    if ask.film and result.found and result.plan is not None:
        yield _film(result.plan, _greedy(problem) if ask.greedy else None, shown["box_mm"])
        with limited(math.inf, math.inf, given_up):
            lower_s = confirmed_lower_bound(result.plan)
        yield {"kind": "confirmed", "gap": relative_gap(result.plan.confirmed_s, lower_s)}


def _planned(
    problem: Problem, work: float, given_up: GivenUp, others_wait: GivenUp
) -> tuple[Result, bool]:
    """Plan with so much work; False if others had to wait, so that less was done."""
    left = False

    def ends() -> bool:
        nonlocal left
        left = left or (work > _WORK[0] and others_wait())
        return left or given_up()

    with limited(work, math.inf, ends):
        result = plan(problem)
    return result, not left


def told(result: Result, *, complete: bool) -> Record:
    """Result of planning, as the page shows it."""
    made, found = result.plan, result.found
    record = {
        "kind": "result",
        "status": str(result.status),
        "found": found,
        "complete": complete,
        "words": result.status.words,
        "message": result.message,
        "lower_bound_s": result.lower_bound,
        "work": result.stats.work,
    }
    if made is None or not found:
        return record
    longest = max(critical_path(made), key=lambda item: item.duration_s, default=None)
    told_why = not (made.problem.tasks or made.problem.obstacles)
    why = next(reasons(made), "") if told_why else ""
    if longest is not None and (not why or longest.kind in ("melt", "freeze")):
        share = longest.duration_s / made.duration_s
        why = f"{why}; " if why and not why.startswith("the robot") else ""
        why += f"{longest} is {share:z.0%} of the time"
    return record | {
        "sequence": sequence_name(made.sequence),
        **attributes(made, "duration_s", "confirmed_s", "gap"),
        **attributes(made.cost, "energy_J", "transitions"),
        "cost_s": made.cost.total,
        "why": why,
        "path": way_of(made),
    }


def way_of(made: Plan) -> list[str]:
    """Way of b0, as SVG points [mm, y down]."""
    return [player.svg_points(at) for at in made.samples.q[:, :2]]


def scene(problem: Problem, box_mm: Sequence[float] | None = None, *, plane: bool = True) -> Record:
    """The problem, drawn: the plane, and where the hand can take hold of start and goal."""
    ends = {"start": _configuration(problem, "start")}
    if not problem.ends_anywhere:
        ends["goal"] = _configuration(problem, "goal")
    geometry = problem.robot.geometry
    shapes = {name: robot_shape(geometry, q, player.ARC_POINTS) for name, q in ends.items()}
    start, *goal = shapes.values()
    left, top, wide, high = box_mm or _box(problem, list(shapes.values()))
    box = left, top, wide, high
    return {
        "kind": "scene",
        "problem": document(problem),
        "box_mm": [left, top, wide, high],
        "plane": drawn("plane.html", player.plane_of(problem, start, goal, box)) if plane else "",
        "ends": {name: player.pose(shape) for name, shape in shapes.items()},
        "handles": {name: _handles(q, shapes[name]) for name, q in ends.items()},
        "limits": {"curvature_per_m": problem.robot.limits.curvature_per_m},
        "air_C": problem.ambient,
        "temperatures_C": list(problem.temperatures),
    }


def _box(problem: Problem, shapes: list[RobotShape]) -> tuple[float, float, float, float]:
    """Box of all of a problem, with room for the hand."""
    poses = np.array([item.pose.pose for item in problem.objects]).reshape(-1, POSE)
    parts = [*outlines_m(problem, poses), *(item.inner_corners_m for item in problem.obstacles)]
    if problem.workspace is not None:
        corners = problem.workspace.corners_m
        parts.append(corners[np.isfinite(corners).all(axis=1)])
    parts += [shape.units.reshape(-1, 2) + way for shape in shapes for way in (-_ROOM_M, _ROOM_M)]
    return player.filmed_box(problem, shapes, np.concatenate(parts))


def _configuration(problem: Problem, end: str) -> Array:
    """Configuration at an end, (3 + n,); what a goal leaves free is as at the start."""
    q: Array = problem.start.configuration.copy()
    if end == "goal" and not problem.ends_anywhere:
        goal = problem.goal.configuration
        q = np.where(np.isnan(goal), q, goal)
    return q


def _handles(q: Array, shape: RobotShape) -> dict[str, list[float]]:
    """Places to take hold of [mm, y down]."""
    heading = q[:2] + _HANDLE_M * np.array([math.cos(q[2]), math.sin(q[2])])
    places = {"place": q[:2], "heading": heading}
    places |= {f"segment{j}": at for j, at in enumerate(_outer_ends(shape))}
    return {name: [1e3 * float(at[0]), -1e3 * float(at[1])] for name, at in places.items()}


def _greedy(problem: Problem) -> Result | None:
    """The greedy rule's plan; None where it knows no such problem."""
    if problem.tasks or problem.obstacles or problem.objects or problem.planner == "greedy":
        return None
    return plan(problem.with_values(planner="greedy"))


def _film(made: Plan, ghost: Result | None, box_mm: list[float]) -> Record:
    """The plan, played; the plane as the page has it."""
    left, top, wide, high = box_mm
    motion = player.motion_of(made, (left, top, wide, high))
    data: Record = motion["data"]
    record: Record = {"kind": "film"}
    if ghost is not None and ghost.found:
        other = ghost.require()
        data["film"]["ghost"] = player.ghost_of(other, data["film"]["time_s"])
        record["greedy_s"] = other.duration_s
    elif ghost is not None:
        record["greedy"] = ghost.message
    parts = ("plane.html", "readings.html", "timeline.html")
    return record | {"data": data} | {part[:-5]: drawn(part, motion) for part in parts}


class Saved(Value):
    """Request to save a problem, a scenario document, in one of the forms."""

    problem: dict[str, Any]
    form: Literal["toml", "json", "html", "csv", "py"]


def saved(asked: Saved) -> dict[str, Any]:
    """Make a file: its name and its text.

    Raises:
        InputError: If the problem is none.
        NoPlanError: If the set-points of a plan are asked for, and there is none.
    """
    problem = Problem(**asked.problem)
    match asked.form:
        case "toml":
            text = scenario_toml(problem)
        case "py":
            text = _python(asked.problem)
        case "json":
            text = json.dumps(plan(problem).to_dict(), allow_nan=False)
        case "html":
            text = report_page(plan(problem))
        case "csv":
            text = setpoints_csv(plan(problem).require())
    name = {"toml": "scenario", "json": "plan", "html": "report", "csv": "setpoints", "py": "plan"}
    return {"kind": "file", "name": f"{name[asked.form]}.{asked.form}", "text": text}


def _python(document: dict[str, Any]) -> str:
    """A program that plans the problem."""
    given = {key: value for key, value in document.items() if value not in (None, [], "")}
    lines = [f"    {key}={value!r}," for key, value in given.items()]
    before = ["from twosra_mpc import Problem, plan", "", "problem = Problem("]
    after = [")", "result = plan(problem)", "print(result)", 'result.save("plan.json")', ""]
    return "\n".join([*before, *lines, *after])
