"""twosra_mpc: plans with a proved gap for the two-segment soft-rigid agent (2SRA).

>>> from twosra_mpc import load_problem, plan
>>> result = plan(load_problem("paper-1"))
>>> result.status, result.gap
"""

from twosra_mpc.errors import InputError, NoPlanError, TwosraError
from twosra_mpc.explanation import Explanation, explain
from twosra_mpc.model_comparison import compare_models
from twosra_mpc.modes import Mode
from twosra_mpc.path_choice import with_path_model
from twosra_mpc.plan import Plan, Status, load_plan
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
from twosra_mpc.robot import Robot, load_robot, robot_names
from twosra_mpc.setpoints import save_setpoints
from twosra_mpc.version import __version__

__all__ = [
    "Explanation",
    "Goal",
    "InputError",
    "Mode",
    "NoPlanError",
    "Plan",
    "Problem",
    "Progress",
    "Robot",
    "Start",
    "Status",
    "Tolerance",
    "TwosraError",
    "Weights",
    "__version__",
    "compare_models",
    "explain",
    "load_plan",
    "load_problem",
    "load_robot",
    "plan",
    "robot_names",
    "save_setpoints",
    "scenario_names",
    "with_path_model",
]
