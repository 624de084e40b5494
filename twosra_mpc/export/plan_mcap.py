"""A plan as MCAP, to be played in Foxglove or rerun without ROS."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twosra_mpc.checking.resampling import refined
from twosra_mpc.errors import InputError
from twosra_mpc.export.foxglove_messages import Message, frames, nanoseconds, scene
from twosra_mpc.export.foxglove_schemas import (
    FRAME_TRANSFORMS,
    SCENE_UPDATE,
    Schema,
    number,
    record,
)
from twosra_mpc.files import atomic_path
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import SAME_TIME_S, Samples
from twosra_mpc.version import __version__

_PAIR = (1, 2)


class Topic(NamedTuple):
    """A topic and the schema of its messages."""

    name: str
    schema: Schema


def _table(name: str, title: str, description: str, units: dict[str, str]) -> Topic:
    fields = {field: number(unit) for field, unit in units.items()}
    return Topic(name, record(title, description, **fields))


SCENE = Topic("/robot", SCENE_UPDATE)
FRAMES = Topic("/tf", FRAME_TRANSFORMS)
CONFIGURATION = _table(
    *("/configuration", "twosra.Configuration", "Pose of the middle link, and curvatures"),
    {"x_m": "m", "y_m": "m", "phi_rad": "rad", "kappa1_per_m": "1/m", "kappa2_per_m": "1/m"},
)
MODE = _table(
    *("/mode", "twosra.Mode", "Stiffness: 1 soft, 0 rigid"),
    {f"mode{j}": "1 soft, 0 rigid" for j in _PAIR},
)
WHEELS = _table(
    *("/wheels", "twosra.WheelSpeeds", "Set-points of the wheels"),
    {f"wheel{i}_rad_s": "rad/s" for i in (1, 2, 3, 4)},
)
HEATERS = _table(
    *("/heaters", "twosra.Heaters", "Set-points and feed-forward currents of the heaters"),
    {f"heater{j}_C": "degrees Celsius" for j in _PAIR} | {f"current{j}_A": "A" for j in _PAIR},
)
TEMPERATURES = _table(
    *("/temperatures", "twosra.Temperatures", "Expected temperatures and melt fractions"),
    {f"temperature{j}_C": "degrees Celsius" for j in _PAIR}
    | {f"melt_fraction{j}": "0 solid, 1 liquid" for j in _PAIR},
)
TOPICS = (SCENE, FRAMES, CONFIGURATION, MODE, WHEELS, HEATERS, TEMPERATURES)


def save_mcap(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write a plan as MCAP, one message a topic and sample, atomically.

    Log times are the plan's, from zero. Set-points hold from a message to the next. The robot and
    its frames are written when they move or a segment changes.

    Args:
        plan: The plan.
        path: Where to write it.
        rate_Hz: Samples per second that are added to the plan's own; default: none.

    Raises:
        InputError: If mcap is not installed, or the rate or the path is not acceptable.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        allowed = "a .csv file, or any once mcap is installed: pip install 'twosra-mpc[mcap]'"
        raise InputError("output", str(path), allowed) from error
    plan = plan if rate_Hz is None else refined(plan, rate_Hz)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library=f"twosra_mpc {__version__}")
        channels = {}
        for topic in TOPICS:
            text = json.dumps(topic.schema).encode()
            schema = writer.register_schema(topic.schema["title"], "jsonschema", text)
            channels[topic.name] = writer.register_channel(topic.name, "json", schema)
        for time_s, topic, message in messages(plan):
            at, data = nanoseconds(time_s), json.dumps(message, allow_nan=False).encode()
            writer.add_message(channels[topic.name], log_time=at, data=data, publish_time=at)
        writer.add_metadata("plan", _metadata(plan))
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves this one out


def messages(plan: Plan) -> Iterator[tuple[float, Topic, Message]]:
    """Every message of a plan in order: time [s], topic, content."""
    samples, geometry = plan.samples, plan.robot.geometry
    shown: object = None
    for row, time_s in enumerate(samples.t_s.tolist()):
        q, states = samples.q[row].tolist(), stiffness(plan, time_s)
        if shown != (shown := (q, states)):
            yield time_s, FRAMES, frames(geometry, time_s, q)
            yield time_s, SCENE, scene(geometry, time_s, q, states)
        for topic, values in _rows(samples, row):
            names = topic.schema["properties"]
            yield time_s, topic, dict(zip(names, values, strict=True))


def _rows(samples: Samples, row: int) -> Iterator[tuple[Topic, list[Any]]]:
    yield CONFIGURATION, samples.q[row].tolist()
    yield MODE, samples.mode[row].tolist()
    yield WHEELS, samples.wheel_rad_s[row].tolist()
    heaters = (samples.heater_setpoint_C[row], samples.heater_current_A[row])
    yield HEATERS, np.concatenate(heaters).tolist()
    metal = (samples.temperature_C[row], samples.melt_fraction[row])
    yield TEMPERATURES, np.concatenate(metal).tolist()


def stiffness(plan: Plan, time_s: float) -> tuple[str, str]:
    """Expected stiffness of both segments: "rigid", "soft", or "changing" from onset to done."""
    now = ["soft" if soft else "rigid" for soft in plan.problem.start_mode]
    for item in plan.transitions:
        if time_s >= item.onset_s - SAME_TIME_S:
            done = time_s >= item.done_s - SAME_TIME_S
            now[item.segment - 1] = item.to if done else "changing"
    return now[0], now[1]


def _metadata(plan: Plan) -> dict[str, str]:
    return {
        "robot": plan.robot.name,
        "planner": plan.planner,
        "status": str(plan.status),
        "message": str(plan),
        "duration_s": f"{plan.duration_s:.6f}",
    }
