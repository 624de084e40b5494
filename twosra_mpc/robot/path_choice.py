"""The same robot with another path model."""

from __future__ import annotations

from typing import Any

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.keys import near_word
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.path_fitting import CASES, fitted_path_tables
from twosra_mpc.robot.paths import PATH_MODELS, CardioidPath, LogSpiralPath, Path

SPIRALS = ("log_spiral", "log_spiral_corrected")


@public
def with_path_model(robot: Robot, model: str) -> Robot:
    """Return ``robot`` with the path model of this name.

    A robot that has spiral parameters keeps them for both readings of Table I; parameters that it
    lacks are fitted to its lengths. ``arc`` measures v_j at the side wheels.

    Raises:
        InputError: If there is no such path model, or its fit fails.
    """
    if model not in PATH_MODELS:
        allowed = f"one of {', '.join(PATH_MODELS)}"
        raise InputError("path.model", model, allowed, hint=near_word(model, PATH_MODELS))
    if model == robot.path.model:
        return robot
    table: dict[str, Any]
    if model == "arc":
        table = {"model": "arc", "speed_reference": "side_wheel"}
    elif isinstance(robot.path, LogSpiralPath) and model in SPIRALS:
        table = {**robot.path.model_dump(), "model": model}
    else:
        table = fitted_path_tables(robot)[model]
    return robot.with_values(path=table)


def parameters_in_words(path: Path) -> tuple[list[str], list[str]]:
    """Return the two parameters of each spiral and of each cardioid; "-" where it has none."""
    spirals = zip(path.scale, path.growth, strict=True) if isinstance(path, LogSpiralPath) else ()
    cardioids = (
        zip(path.radius_m, path.phi_per_alpha, strict=True)
        if isinstance(path, CardioidPath)
        else ()
    )
    told = [[f"{a:z.4f}, {b:z.4f}" for a, b in pairs] for pairs in (spirals, cardioids)]
    return told[0] or ["-"] * len(CASES), told[1] or ["-"] * len(CASES)
