"""Missions made of plans between given configurations: what draws them needs no planner of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache

import numpy as np

from twosra_mpc import Plan, load_problem, plan
from twosra_mpc.plans.trajectory import Samples, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Carry
from twosra_mpc.robot.coordinates import Array, composed, inverse

CAGE_PER_M = (39.9, 39.9)
CUP_IN_B0 = np.array([0.0, 0.034, 0.0])


def configured(q: Sequence[float]) -> dict[str, object]:
    """A configuration by its keys."""
    x_m, y_m, phi_rad, *kappa_per_m = q
    return {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad, "kappa_per_m": kappa_per_m}


def joined(problem: Problem, places: Sequence[Sequence[float]], tasks: Sequence[int]) -> Plan:
    """Drives and reshapings through configurations, one after the other.

    ``tasks`` are the numbers of the legs, from 0, at whose ends the tasks of the problem are done.
    """
    alone = problem.with_values(objects=(), tasks=(), order="given", motion="fastest", gap=0.05)
    parts: list[Plan] = []
    for first, last in zip([problem.start.configuration.tolist(), *places], places, strict=False):
        goal = {**configured(last), "tolerance": "exact"}
        leg = alone.with_values(start=configured(first), goal=goal)
        parts.append(plan(leg).require())
    begins = np.cumsum([0.0, *(part.trajectory.duration_s for part in parts)]).tolist()
    shifted = list(zip(begins, parts, strict=False))
    samples = {
        item.name: np.concatenate([getattr(part.trajectory.samples, item.name) for part in parts])
        for item in fields(Samples)
    }
    samples["t_s"] = np.concatenate([t + part.trajectory.samples.t_s for t, part in shifted])
    kept = np.append(np.diff(samples["t_s"]) > 0, True)  # the next leg's first row stands
    trajectory = Trajectory(
        problem,
        Samples(**{name: values[kept] for name, values in samples.items()}),
        tuple(
            p._replace(start_s=t + p.start_s, end_s=t + p.end_s)
            for t, part in shifted
            for p in part.phases
        ),
        tuple(
            m._replace(heater_s=t + m.heater_s, onset_s=t + m.onset_s, done_s=t + m.done_s)
            for t, part in shifted
            for m in part.transitions
        ),
        tuple(begins[leg + 1] for leg in tasks),
    )
    return replace(parts[-1], trajectory=trajectory)


def grasping(cup: Array, phi_rad: float) -> list[float]:
    """The robot around a cup at a pose."""
    x, y, _ = composed(cup, np.array([0.0, 0.0, phi_rad]))
    at = composed(np.array([x, y, phi_rad]), inverse(CUP_IN_B0))
    return [*at.tolist(), *CAGE_PER_M]


@cache
def fetched() -> Plan:
    """``pick-and-place`` as a plan of three legs."""
    problem = load_problem("pick-and-place")
    cup, place = np.array([0.32, 0.10, 0.0]), np.array([-0.30, 0.15, 0.0])
    held, put = grasping(cup, -1.2), grasping(place, 0.4)
    free = [*composed(np.array(put[:3]), np.array([0.0, -0.05, 0.0])).tolist(), 0.0, 0.0]
    return joined(problem, [held, put, free], (0, 1, 2))


@cache
def reshaped() -> Plan:
    """``three-shapes`` as a plan of three legs."""
    problem = load_problem("three-shapes")
    goals = [task.goal.configuration for task in problem.tasks]  # type: ignore[attr-defined]
    places = [np.nan_to_num(q).tolist() for q in (*goals, problem.goal.configuration)]
    return joined(problem, places, (0, 1))


@cache
def tidied() -> Plan:
    """``tidy-up`` as a plan of six legs, one a task."""
    problem, legs = load_problem("tidy-up"), list[list[float]]()
    for item, task in zip(problem.objects, problem.tasks[1::3], strict=True):
        assert isinstance(task, Carry)
        held = grasping(item.pose.pose, -0.9)
        put = grasping(np.array([task.x_m, task.y_m, 0.0]), -1.5)
        back = composed(np.array(put[:3]), np.array([0.0, -0.05, 0.0])).tolist()
        legs += [held, put, [*back, 0.0, 0.0]]
    return joined(problem, legs, range(6))
