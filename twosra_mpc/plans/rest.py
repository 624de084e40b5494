"""What is left of a plan: the problem from where it is at some time, in the state it is in then."""

from __future__ import annotations

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.objects import Object
from twosra_mpc.problem.problem import Problem, Start
from twosra_mpc.timing import transition_model

_ALL = 1e-9  # metal that is molten but for so much is liquid


def rest_at(trajectory: Trajectory, time_s: float) -> Problem:
    """The problem that is left: its start as the plan has it then, at rest, and what is not done.

    Raises:
        InputError: If the time is not within the plan.
    """
    if not 0.0 <= time_s <= trajectory.duration_s:
        raise InputError("time_s", time_s, f"from 0 to {trajectory.duration_s:zg} s")
    done = sum(done_s <= time_s for done_s in trajectory.done_s)
    left = trajectory.problem.tasks[done:]
    given = {"start": start_at(trajectory, time_s), "objects": objects_at(trajectory, time_s)}
    return trajectory.problem.with_values(**given, tasks=left)


def start_at(trajectory: Trajectory, time_s: float) -> Start:
    """Where the robot is in a plan, the state of its metal, and what it holds."""
    problem, now = trajectory.problem, trajectory.at([time_s])
    x_m, y_m, phi_rad, *kappa_per_m = now.q[0].tolist()
    heating = transition_model(problem).heating(trajectory.transitions)
    temperatures, fractions, bodies = list[float](), list[float](), list[float]()
    for j, (solid, liquid) in enumerate(problem.segment_thresholds_C):
        metal, share = float(now.temperature_C[0, j]), float(now.melt_fraction[0, j])
        share = 0.0 if share < _ALL else 1.0 if share > 1 - _ALL else share
        if share < 1:
            metal = solid + share * (liquid - solid) if share else min(metal, solid)
        temperatures.append(metal if share < 1 else max(metal, liquid))
        fractions.append(share)
        body = heating[j].body_C(np.array([time_s]))
        bodies.append(temperatures[j] if body is None else float(body[0]))
    return Start(
        x_m=x_m,
        y_m=y_m,
        phi_rad=phi_rad,
        kappa_per_m=tuple(kappa_per_m),
        temperature_C=tuple(temperatures),
        melt_fraction=tuple(fractions),
        body_temperature_C=None if bodies == temperatures else tuple(bodies),
        holding=_held(trajectory, time_s),
    )


def objects_at(trajectory: Trajectory, time_s: float) -> tuple[Object, ...]:
    """Objects where the plan has them."""
    problem = trajectory.problem
    if not problem.objects:
        return ()
    poses = object_poses(trajectory, np.array([time_s]))[0].tolist()
    return tuple(
        item.with_values(pose=dict(zip(("x_m", "y_m", "phi_rad"), pose, strict=True)))
        for item, pose in zip(problem.objects, poses, strict=True)
    )


def _held(trajectory: Trajectory, time_s: float) -> str | None:
    """Name of the object in hand."""
    held = trajectory.problem.start.holding
    for task, done_s in zip(trajectory.problem.tasks, trajectory.done_s, strict=False):
        if done_s <= time_s:
            held = task.about if task.takes else None if task.lets_go else held
    return held
