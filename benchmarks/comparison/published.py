"""The bare published greedy loop as a planner: what its path is worth on the robot."""

from __future__ import annotations

import itertools

import numpy as np

from benchmarks.measurement import Timing
from benchmarks.plan_record import PlanRecord
from twosra_mpc import Problem
from twosra_mpc.greedy.published import PublishedTrajectory, StopReason

PUBLISHED = "published loop"


def published_record(
    label: str, problem: Problem, path: PublishedTrajectory, timing: Timing
) -> PlanRecord:
    """Write down a run of Algorithm 1 as published.

    It gives a path on the published model without transitions or a clock, so there is no cost, and
    less to check than of a plan: that it ends at the goal and stays in the curvature range.
    """
    error = float(np.abs(problem.goal.error(path.final_q.copy())).max())
    bent = float(np.abs(path.q[:, 3:]).max())
    moved = [(int(s1), int(s2)) for s1, s2 in path.mode[1:]]
    return PlanRecord(
        problem=label,
        planner=PUBLISHED,
        status=path.stop.name.lower(),
        message=path.stop.value,
        success=path.stop is StopReason.REACHED,
        verified=bent <= problem.robot.limits.curvature_per_m,
        stopped_early=path.stop is StopReason.ITERATION_LIMIT,
        cost=None,
        lower_bound=None,
        sequence=tuple(mode for mode, _ in itertools.groupby(moved)),
        goal_error=error if np.isfinite(error) else None,
        sequences_solved=0,
        timing=timing,
    )
