"""Other path models of a robot: exact arcs, or spirals and cardioids fitted to its lengths."""

from __future__ import annotations

import tomllib
from typing import Any

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.files import data_file
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.paths import PATH_MODELS, LogSpiralPath

SPIRALS = ("log_spiral", "log_spiral_corrected")


@public
def with_path_model(robot: Robot, model: str) -> Robot:
    """Return ``robot`` with the path model of this name.

    A robot that has spiral parameters keeps them for both readings of Table I; parameters that it
    lacks are those fitted to its lengths, if these are a built-in robot's. ``arc`` measures v_j at
    the side wheels.

    Raises:
        InputError: If there is no such path model, or no fit to these lengths.
    """
    if model not in PATH_MODELS:
        raise InputError("path.model", model, f"one of {', '.join(PATH_MODELS)}")
    if model == robot.path.model:
        return robot
    if model == "arc":
        table = {"model": "arc", "speed_reference": "side_wheel"}
    elif isinstance(robot.path, LogSpiralPath) and model in SPIRALS:
        table = {**robot.path.model_dump(), "model": model}
    else:
        table = _fitted(robot.geometry, model)
    return robot.with_values(path=table)


def _fitted(geometry: Geometry, model: str) -> dict[str, Any]:
    """The ``[path]`` table of a model, fitted to these lengths."""
    lengths = {"segment_length_m": geometry.lengths_m[0], "middle_link_m": geometry.middle_link_m}
    for fit in tomllib.loads(data_file("robot/fitted_paths.toml"))["fit"]:
        if fit["path"]["model"] == model and lengths.items() <= fit.items():
            return dict(fit["path"])
    allowed = "one that the robot file has: twosra fit-paths fits spirals and cardioids to lengths"
    raise InputError("path.model", model, allowed)
