"""twosra_mpc: plans with a proved gap for soft-rigid robots that melt their spine (2SRA).

Examples:
    >>> from twosra_mpc import load_problem, plan
    >>> result = plan(load_problem("paper-1"))
    >>> result.status, result.gap
"""

from __future__ import annotations

import gc
import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # as what they are called: so are they public
    from twosra_mpc.analysis.explanation import Explanation as Explanation
    from twosra_mpc.analysis.explanation import explain as explain
    from twosra_mpc.checking.plan_file import PlanCheck as PlanCheck
    from twosra_mpc.checking.plan_file import check_plan as check_plan
    from twosra_mpc.checking.plan_file import load_plan as load_plan
    from twosra_mpc.checking.plan_file import refined as refined
    from twosra_mpc.errors import ContradictionError as ContradictionError
    from twosra_mpc.errors import InputError as InputError
    from twosra_mpc.errors import InputWarning as InputWarning
    from twosra_mpc.errors import NoPlanError as NoPlanError
    from twosra_mpc.errors import PlanInterrupted as PlanInterrupted
    from twosra_mpc.errors import TwosraError as TwosraError
    from twosra_mpc.installation import __version__ as __version__
    from twosra_mpc.model.kinematics import Kinematics as Kinematics
    from twosra_mpc.model.kinematics import kinematics as kinematics
    from twosra_mpc.model.outline import RobotShape as RobotShape
    from twosra_mpc.model.outline import robot_shape as robot_shape
    from twosra_mpc.planning.conclusion import Progress as Progress
    from twosra_mpc.planning.planner import plan as plan
    from twosra_mpc.plans.plan import Plan as Plan
    from twosra_mpc.plans.plan import Status as Status
    from twosra_mpc.plans.result import Result as Result
    from twosra_mpc.plans.setpoints import save_setpoints as save_setpoints
    from twosra_mpc.problem.geojson import obstacles_of as obstacles_of
    from twosra_mpc.problem.geojson import read_obstacles as read_obstacles
    from twosra_mpc.problem.goals import Goal as Goal
    from twosra_mpc.problem.goals import GoalSet as GoalSet
    from twosra_mpc.problem.goals import Tolerance as Tolerance
    from twosra_mpc.problem.objects import Object as Object
    from twosra_mpc.problem.objects import Pose as Pose
    from twosra_mpc.problem.objects import Round as Round
    from twosra_mpc.problem.objects import read_outline as read_outline
    from twosra_mpc.problem.problem import Problem as Problem
    from twosra_mpc.problem.problem import Start as Start
    from twosra_mpc.problem.problem import Weights as Weights
    from twosra_mpc.problem.problem import load_problem as load_problem
    from twosra_mpc.problem.problem import scenario_names as scenario_names
    from twosra_mpc.problem.tasks import Carry as Carry
    from twosra_mpc.problem.tasks import Conform as Conform
    from twosra_mpc.problem.tasks import Grasp as Grasp
    from twosra_mpc.problem.tasks import Pass as Pass
    from twosra_mpc.problem.tasks import Reach as Reach
    from twosra_mpc.problem.tasks import Release as Release
    from twosra_mpc.problem.tasks import Task as Task
    from twosra_mpc.problem.world import Box as Box
    from twosra_mpc.problem.world import Disc as Disc
    from twosra_mpc.problem.world import Obstacle as Obstacle
    from twosra_mpc.problem.world import Workspace as Workspace
    from twosra_mpc.problem.world import World as World
    from twosra_mpc.robot.description import Robot as Robot
    from twosra_mpc.robot.description import load_robot as load_robot
    from twosra_mpc.robot.description import robot_names as robot_names
    from twosra_mpc.robot.modes import Mode as Mode
    from twosra_mpc.robot.path_fitting import with_path_model as with_path_model
    from twosra_mpc.schema import json_schema as json_schema

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
    "problem.world": ("Box", "Disc", "Obstacle", "Workspace", "World"),
    "robot.description": ("Robot", "load_robot", "robot_names"),
    "robot.modes": ("Mode",),
    "robot.path_fitting": ("with_path_model",),
    "schema": ("json_schema",),
    "installation": ("__version__",),
}
_MODULES = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    thresholds = gc.get_threshold()
    gc.set_threshold(0)  # to look for garbage meanwhile takes an eighth of the time, for nothing
    try:
        module = importlib.import_module(f"{__name__}.{_MODULES[name]}")
    finally:
        gc.set_threshold(*thresholds)
    return globals().setdefault(name, getattr(module, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
