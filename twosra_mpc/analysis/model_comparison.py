"""How much the path model matters: one problem planned under each, and executed by the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.checking.reintegration import reintegrate
from twosra_mpc.model.path_models import path_model
from twosra_mpc.planning.planner import plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.path_choice import with_path_model
from twosra_mpc.robot.paths import PATH_MODELS


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Plans of one problem under several path models.

    Attributes:
        models: Names of the path models.
        speeds: What v_j means in each, in words.
        results: What planning came to with each model.
        end_errors: (maker, executor, 3 + n): q at the end of the maker's plan when its inputs v
            drive a robot that moves as the executor says, minus the planned end [m, m, rad, 1/m
            ...]; NaN where the maker found no plan, or the executor bends beyond twice its limit.
    """

    models: tuple[str, ...]
    speeds: tuple[str, ...]
    results: tuple[Result, ...]
    end_errors: Array


@public
def compare_models(problem: Problem, models: Sequence[str] = PATH_MODELS) -> ModelComparison:
    """Plan ``problem`` under each path model and execute every plan under every other.

    Raises:
        InputError: If a path model does not exist or cannot be fitted to the robot.
    """
    robots = [with_path_model(problem.robot, model) for model in models]
    variants = [problem.with_values(robot=robot) for robot in robots]
    results = tuple(plan(variant) for variant in variants)
    errors = np.full((len(models), len(models), problem.robot.coordinates.size), np.nan)
    for i, made in enumerate(result.plan for result in results):
        if made is not None:
            for j, executor in enumerate(variants):
                errors[i, j] = reintegrate(executor, made.samples)[-1] - made.samples.q[-1]
    return ModelComparison(
        models=tuple(models),
        speeds=tuple(path_model(robot).speed for robot in robots),
        results=results,
        end_errors=errors,
    )
