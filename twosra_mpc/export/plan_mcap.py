"""A plan as MCAP, to be played in Foxglove without ROS.

The robot and its frames are Foxglove's own messages; the numbers are tables in JSON, whose schemas
carry the units.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.checking.plan_file import refined
from twosra_mpc.files import check_writable, write_bytes
from twosra_mpc.installation import require
from twosra_mpc.keys import describe
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.setpoints import changed, columns
from twosra_mpc.plans.trajectory import Samples, State, Trajectory, state_at, stiffness_intervals
from twosra_mpc.robot.coordinates import Array

SCENE, FRAMES, AROUND, OBJECTS = "/robot", "/tf", "/surroundings", "/objects"
TABLES = {  # topic -> what it says, how the names of its columns begin
    "/configuration": ("Pose of the middle link, and curvatures", ("x_", "y_", "phi_", "kappa")),
    "/mode": ("Stiffness of the segments", ("mode",)),
    "/wheels": ("Set-points of the wheels", ("wheel",)),
    "/heaters": ("Set-points, feed-forward currents of the heaters", ("heater", "current")),
    "/temperatures": ("Expected temperatures and melt fractions", ("temperature", "melt")),
}
STEPS = {"temperature": 0.1, "melt": 0.01}  # by how a column's name begins; others: any change
TOPICS = (SCENE, FRAMES, *TABLES)


@public
def save_mcap(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write a plan as MCAP, atomically.

    Log times are the plan's, from zero. A topic has a message wherever it changes, and holds to
    the next one: temperatures by 0.1 C, melt fractions by 0.01. What is around the robot is written
    once.

    Args:
        plan: The plan.
        path: Where to write it.
        rate_Hz: Samples per second that are added to the plan's own; default: none.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If foxglove-sdk is not installed, or the rate or the path is not acceptable.
    """
    require("a file for Foxglove (.mcap)", "mcap", "foxglove-sdk")
    import foxglove
    from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel

    from twosra_mpc.export.foxglove_messages import (
        frames,
        nanoseconds,
        objects,
        scene,
        surroundings,
    )

    shown = plan.require() if rate_Hz is None else refined(plan, rate_Hz).require()
    held = shown.trajectory.held()
    context, memory = foxglove.Context(), io.BytesIO()  # a full disk is then an error like any
    robots = SceneUpdateChannel(SCENE, context=context)
    transforms = FrameTransformsChannel(FRAMES, context=context)
    check_writable(path)
    with foxglove.open_mcap(memory, context=context) as file:
        file.write_metadata("plan", _metadata(plan))
        if plan.problem.obstacles or plan.problem.passes:
            around = SceneUpdateChannel(AROUND, context=context)
            around.log(surroundings(plan.problem), log_time=0)
        for time_s, q, states in _changes(shown.trajectory):
            at = nanoseconds(time_s)
            transforms.log(frames(plan.robot.geometry, time_s, q), log_time=at)
            robots.log(scene(plan.robot.geometry, time_s, q, states), log_time=at)
        if plan.problem.objects:
            things = SceneUpdateChannel(OBJECTS, context=context)
            for time_s, poses in _moves(shown.trajectory):
                update = objects(plan.problem, time_s, poses)
                things.log(update, log_time=nanoseconds(time_s))
        for topic, table in tables(held).items():
            channel = foxglove.Channel(topic, schema=_schema(topic, table), context=context)
            rows = np.column_stack(list(table.values()))
            new = changed(rows, [_step(name) for name in table])
            for time_s, row in zip(held.t_s[new].tolist(), rows[new].tolist(), strict=True):
                message = dict(zip(table, row, strict=True))
                channel.log(message, log_time=nanoseconds(time_s))
    write_bytes(path, memory.getvalue())


def _step(column: str) -> float:
    """Change of a column that is not worth a message, in its unit."""
    return next((step for name, step in STEPS.items() if column.startswith(name)), 0.0)


def _changes(trajectory: Trajectory) -> Iterator[tuple[float, list[float], list[State]]]:
    """Time, configuration and states of the segments wherever one of these is new."""
    samples, intervals = trajectory.samples, stiffness_intervals(trajectory)
    before: object = None
    for time_s, q in zip(samples.t_s.tolist(), samples.q.tolist(), strict=True):
        states = [state_at(each, time_s) for each in intervals]
        if before != (before := (q, states)):
            yield time_s, q, states


def _moves(trajectory: Trajectory) -> Iterator[tuple[float, Array]]:
    """Time and poses of the objects, (objects, 3), wherever one of these is new."""
    samples = trajectory.samples
    poses = object_poses(trajectory, samples.t_s, samples.q)
    new = [True, *np.any(np.diff(poses, axis=0) != 0, axis=(1, 2))]
    yield from zip(samples.t_s[new].tolist(), poses[new], strict=True)


def tables(samples: Samples) -> dict[str, dict[str, Array]]:
    """Topic -> name of each column, unit included -> its values, one a sample."""
    named = columns(samples)
    return {
        topic: {name: values for name, values in named.items() if name.startswith(begins)}
        for topic, (_, begins) in TABLES.items()
    }


def _schema(topic: str, names: Iterable[str]) -> dict[str, Any]:
    """JSON schema of a table: every column a number, and no other."""
    return {
        "title": f"twosra.{topic.removeprefix('/').capitalize()}",
        "description": TABLES[topic][0],
        "type": "object",
        "properties": {name: {"type": "number", "description": describe(name)} for name in names},
        "required": list(names),
        "additionalProperties": False,
    }


def _metadata(plan: Plan) -> dict[str, str]:
    return {
        "robot": plan.robot.name,
        "planner": plan.planner,
        "status": str(plan.status),
        "message": str(plan),
        "duration_s": f"{plan.duration_s:z.6f}",
    }
