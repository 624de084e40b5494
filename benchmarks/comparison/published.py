"""The bare published greedy loop as a planner: what its path is worth on the robot."""

from __future__ import annotations

import itertools

import numpy as np

from benchmarks.measurement import Timing
from benchmarks.plan_record import PlanRecord
from twosra_mpc import Problem
from twosra_mpc.problem.limits import shape_margins
from twosra_mpc.reproduction.published import PublishedTrajectory, StopReason

PUBLISHED = "published loop"


def published_record(
    label: str, problem: Problem, path: PublishedTrajectory, timing: Timing
) -> PlanRecord:
    """Write down a run of Algorithm 1 as published.

    It gives a path on the published model without transitions or a clock, so there is no cost, and
    less to check than of a plan: that it ends at the goal, stays in the curvature range and keeps
    the locomotion units apart.
    """
    error = float(np.abs(problem.goal.error(path.final_q.copy())).max())
    kappa = path.q[:, 3:]
    in_range = bool(np.abs(kappa).max() <= problem.robot.limits.curvature_per_m)
    apart = bool((shape_margins(problem.robot, kappa).unit_gap_m >= 0).all())
    moved = [(int(s1), int(s2)) for s1, s2 in path.mode[1:]]
    return PlanRecord(
        problem=label,
        planner=PUBLISHED,
        status=path.stop.name.lower(),
        message=path.stop.value,
        success=path.stop is StopReason.REACHED,
        verified=in_range and apart,
        stopped_early=path.stop is StopReason.ITERATION_LIMIT,
        cost=None,
        lower_bound=None,
        sequence=tuple(mode for mode, _ in itertools.groupby(moved)),
        goal_error=error if np.isfinite(error) else None,
        sequences_solved=0,
        timing=timing,
    )
