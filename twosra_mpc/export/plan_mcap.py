"""A plan as MCAP, to be played in Foxglove without ROS.

The robot and its frames are Foxglove's own messages; the numbers are tables in JSON, whose schemas
carry the units.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.checking.resampling import refined
from twosra_mpc.errors import InputError
from twosra_mpc.files import atomic_path
from twosra_mpc.plans.plan import Plan, Samples
from twosra_mpc.plans.stiffness import state_at, stiffness_intervals
from twosra_mpc.robot.coordinates import WHEELS

SCENE, FRAMES = "/robot", "/tf"
TABLES = {  # topic -> what it says
    "/configuration": "Pose of the middle link, and curvatures",
    "/mode": "Stiffness of the segments",
    "/wheels": "Set-points of the wheels",
    "/heaters": "Set-points and feed-forward currents of the heaters",
    "/temperatures": "Expected temperatures and melt fractions",
}
TOPICS = (SCENE, FRAMES, *TABLES)


def save_mcap(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write a plan as MCAP, one message a topic and sample, atomically.

    Log times are the plan's, from zero. Set-points hold from a message to the next. The robot and
    its frames are written when they move or a segment changes.

    Args:
        plan: The plan.
        path: Where to write it.
        rate_Hz: Samples per second that are added to the plan's own; default: none.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If foxglove-sdk is not installed, or the rate or the path is not acceptable.
    """
    try:
        import foxglove
        from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel

        from twosra_mpc.export.foxglove_messages import frames, nanoseconds, scene
    except ImportError as error:
        allowed = "a .csv file, or any once MCAP can be written: pip install 'twosra-mpc[mcap]'"
        raise InputError("output", str(path), allowed) from error
    plan = plan.require() if rate_Hz is None else refined(plan.require(), rate_Hz)
    samples, geometry, intervals = plan.samples, plan.robot.geometry, stiffness_intervals(plan)
    assert samples is not None, "a verified plan has samples"
    context, memory = foxglove.Context(), io.BytesIO()  # a full disk is then an error like any
    robots = SceneUpdateChannel(SCENE, context=context)
    transforms = FrameTransformsChannel(FRAMES, context=context)
    with atomic_path(path) as temporary:
        with foxglove.open_mcap(memory, context=context) as file:
            file.write_metadata("plan", _metadata(plan))
            shown: object = None
            for time_s, q in zip(samples.t_s.tolist(), samples.q.tolist(), strict=True):
                states = [state_at(each, time_s) for each in intervals]
                if shown != (shown := (q, states)):
                    at = nanoseconds(time_s)
                    transforms.log(frames(geometry, time_s, q), log_time=at)
                    robots.log(scene(geometry, time_s, q, states), log_time=at)
            for topic, columns in tables(samples).items():
                schema = _schema(topic, list(columns))
                channel = foxglove.Channel(topic, schema=schema, context=context)
                rows = np.column_stack(list(columns.values())).tolist()
                for time_s, row in zip(samples.t_s.tolist(), rows, strict=True):
                    message = dict(zip(columns, row, strict=True))
                    channel.log(message, log_time=nanoseconds(time_s))
        temporary.write_bytes(memory.getvalue())


def tables(samples: Samples) -> dict[str, dict[str, Any]]:
    """Topic -> name of each column, unit included -> its values, one a sample."""
    segments = range(1, samples.mode.shape[1] + 1)
    pose = ("x_m", "y_m", "phi_rad")
    return {
        "/configuration": _named((*pose, *(f"kappa{j}_per_m" for j in segments)), samples.q),
        "/mode": _named([f"mode{j}" for j in segments], samples.mode),
        "/wheels": _named([f"wheel{i + 1}_rad_s" for i in range(WHEELS)], samples.wheel_rad_s),
        "/heaters": _named([f"heater{j}_C" for j in segments], samples.heater_setpoint_C)
        | _named([f"current{j}_A" for j in segments], samples.heater_current_A),
        "/temperatures": _named([f"temperature{j}_C" for j in segments], samples.temperature_C)
        | _named([f"melt_fraction{j}" for j in segments], samples.melt_fraction),
    }


def _named(names: Sequence[str], columns: np.ndarray) -> dict[str, Any]:
    return dict(zip(names, columns.T, strict=True))


def _schema(topic: str, names: Sequence[str]) -> dict[str, Any]:
    """JSON schema of a table: every column a number, and no other."""
    return {
        "title": f"twosra.{topic.removeprefix('/').capitalize()}",
        "description": TABLES[topic],
        "type": "object",
        "properties": {name: {"type": "number", "description": _unit(name)} for name in names},
        "required": list(names),
        "additionalProperties": False,
    }


_UNITS = {"_rad_s": "rad/s", "_rad": "rad", "_per_m": "1/m", "_m": "m", "_A": "A", "_C": "°C"}


def _unit(name: str) -> str:
    given = next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), None)
    return given or ("1 soft, 0 rigid" if name.startswith("mode") else "0 solid, 1 liquid")


def _metadata(plan: Plan) -> dict[str, str]:
    return {
        "robot": plan.robot.name,
        "planner": plan.planner,
        "status": str(plan.status),
        "message": plan.message,
        "duration_s": f"{plan.duration_s:.6f}",
    }
