"""twosra_mpc: plans with a proved gap for the two-segment soft-rigid agent (2SRA).

>>> from twosra_mpc import load_problem, plan
>>> result = plan(load_problem("paper-1"))
>>> result.status, result.gap
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from twosra_mpc.errors import InputError, NoPlanError, TwosraError
from twosra_mpc.explanation import Explanation, explain
from twosra_mpc.model_comparison import compare_models
from twosra_mpc.modes import Mode
from twosra_mpc.path_choice import with_path_model
from twosra_mpc.plan import Plan, Status, load_plan
from twosra_mpc.plan_check import PlanCheck, check_plan
from twosra_mpc.planner import Progress, plan
from twosra_mpc.problem import (
    Goal,
    Problem,
    Start,
    Tolerance,
    Weights,
    load_problem,
    scenario_names,
)
from twosra_mpc.resampling import refined
from twosra_mpc.robot import Robot, load_robot, robot_names
from twosra_mpc.robot_shape import RobotShape, robot_shape
from twosra_mpc.schema import json_schema
from twosra_mpc.setpoints import save_setpoints
from twosra_mpc.version import __version__

if TYPE_CHECKING:
    from twosra_mpc.thermal.heating_log import HeatingLog, read_heating_log
    from twosra_mpc.thermal.identification import ThermalFit, identify

__all__ = [
    "Explanation",
    "Goal",
    "HeatingLog",
    "InputError",
    "Mode",
    "NoPlanError",
    "Plan",
    "PlanCheck",
    "Problem",
    "Progress",
    "Robot",
    "RobotShape",
    "Start",
    "Status",
    "ThermalFit",
    "Tolerance",
    "TwosraError",
    "Weights",
    "__version__",
    "check_plan",
    "compare_models",
    "explain",
    "identify",
    "json_schema",
    "load_plan",
    "load_problem",
    "load_robot",
    "plan",
    "read_heating_log",
    "refined",
    "robot_names",
    "robot_shape",
    "save_setpoints",
    "scenario_names",
    "with_path_model",
]

_OF_LOGS = {
    "HeatingLog": "heating_log",
    "read_heating_log": "heating_log",
    "ThermalFit": "identification",
    "identify": "identification",
}


def __getattr__(name: str) -> Any:
    """Import what identifies segments when it is asked for: signal processing takes a second."""
    if name not in _OF_LOGS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.thermal.{_OF_LOGS[name]}"), name)
