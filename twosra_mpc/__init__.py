"""twosra_mpc: plans with a proved gap for soft-rigid robots that melt their spine (2SRA).

Examples:
    >>> from twosra_mpc import load_problem, plan
    >>> result = plan(load_problem("paper-1"))
    >>> result.status, result.gap
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twosra_mpc.analysis.explanation import Explanation, explain
    from twosra_mpc.checking.plan_file import PlanCheck, check_plan, load_plan, refined
    from twosra_mpc.errors import (
        ContradictionError,
        InputError,
        InputWarning,
        NoPlanError,
        PlanInterrupted,
        TwosraError,
    )
    from twosra_mpc.installation import __version__
    from twosra_mpc.model.kinematics import Kinematics, kinematics
    from twosra_mpc.model.outline import RobotShape, robot_shape
    from twosra_mpc.planning.conclusion import Progress
    from twosra_mpc.planning.planner import plan
    from twosra_mpc.plans.plan import Plan, Status
    from twosra_mpc.plans.result import Result
    from twosra_mpc.plans.setpoints import save_setpoints
    from twosra_mpc.problem.geojson import obstacles_of, read_obstacles
    from twosra_mpc.problem.goals import Goal, GoalSet, Tolerance
    from twosra_mpc.problem.objects import Object, Pose, Round, read_outline
    from twosra_mpc.problem.problem import Problem, Start, Weights, load_problem, scenario_names
    from twosra_mpc.problem.tasks import Carry, Conform, Grasp, Pass, Reach, Release, Task
    from twosra_mpc.problem.workspace import Workspace
    from twosra_mpc.problem.world import Box, Disc, Obstacle, World
    from twosra_mpc.robot.description import Robot, load_robot, robot_names
    from twosra_mpc.robot.modes import Mode
    from twosra_mpc.robot.path_fitting import with_path_model
    from twosra_mpc.schema import json_schema

# Module -> its public names, imported when they are first asked for: solvers take a second to load.
_PUBLIC = {
    "analysis.explanation": ("Explanation", "explain"),
    "checking.plan_file": ("PlanCheck", "check_plan", "load_plan", "refined"),
    "errors": (
        "ContradictionError",
        "InputError",
        "InputWarning",
        "NoPlanError",
        "PlanInterrupted",
        "TwosraError",
    ),
    "model.kinematics": ("Kinematics", "kinematics"),
    "model.outline": ("RobotShape", "robot_shape"),
    "planning.conclusion": ("Progress",),
    "planning.planner": ("plan",),
    "plans.plan": ("Plan", "Status"),
    "plans.result": ("Result",),
    "plans.setpoints": ("save_setpoints",),
    "problem.geojson": ("obstacles_of", "read_obstacles"),
    "problem.goals": ("Goal", "GoalSet", "Tolerance"),
    "problem.problem": ("Problem", "Start", "Weights", "load_problem", "scenario_names"),
    "problem.objects": ("Object", "Pose", "Round", "read_outline"),
    "problem.tasks": ("Carry", "Conform", "Grasp", "Pass", "Reach", "Release", "Task"),
    "problem.workspace": ("Workspace",),
    "problem.world": ("Box", "Disc", "Obstacle", "World"),
    "robot.description": ("Robot", "load_robot", "robot_names"),
    "robot.modes": ("Mode",),
    "robot.path_fitting": ("with_path_model",),
    "schema": ("json_schema",),
    "installation": ("__version__",),
}
_MODULES = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = [
    "Box",
    "Carry",
    "Conform",
    "ContradictionError",
    "Disc",
    "Explanation",
    "Goal",
    "GoalSet",
    "Grasp",
    "InputError",
    "InputWarning",
    "Kinematics",
    "Mode",
    "NoPlanError",
    "Object",
    "Obstacle",
    "Pass",
    "Plan",
    "PlanCheck",
    "PlanInterrupted",
    "Pose",
    "Problem",
    "Progress",
    "Reach",
    "Release",
    "Result",
    "Robot",
    "RobotShape",
    "Round",
    "Start",
    "Status",
    "Task",
    "Tolerance",
    "TwosraError",
    "Weights",
    "Workspace",
    "World",
    "__version__",
    "check_plan",
    "explain",
    "json_schema",
    "kinematics",
    "load_plan",
    "load_problem",
    "load_robot",
    "obstacles_of",
    "plan",
    "read_obstacles",
    "read_outline",
    "refined",
    "robot_names",
    "robot_shape",
    "save_setpoints",
    "scenario_names",
    "with_path_model",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
