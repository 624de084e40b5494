"""Mission plans made by hand: there the robot closes around a disc, carries it and lets it go."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from twosra_mpc import Plan, Problem, load_robot
from twosra_mpc.model.flow import roll_out
from twosra_mpc.planning.bounds.schedule import feasible_schedule
from twosra_mpc.planning.solver.fixed_sequence import Candidate, verified
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import RIGID, ModeSequence
from twosra_mpc.timing import transition_model

RADIUS_M = 0.03
CLOSED_PER_M = 36.0
SEQUENCE: ModeSequence = ((1, 1), (0, 0), (1, 1), (0, 0))  # close, carry, open, retreat
INTERVALS = 10


def made(start: Array, sequence: ModeSequence, inputs: Array, **asked: Any) -> Plan:
    """The plan that sends these input displacements (phases, intervals, 5)."""
    robot = load_robot("2sra-v1")
    names = ("x_m", "y_m", "phi_rad")
    motion = roll_out(robot, start, sequence, inputs)
    ends = [
        {**dict(zip(names, q.tolist(), strict=False)), "kappa_per_m": q[3:].tolist()}
        for q in (start, motion.states[-1, -1])
    ]
    problem = Problem(robot=robot, start=ends[0], goal=ends[1], **asked)
    profiles = fastest(motion)
    lasting = [profile.duration_s for profile in profiles]
    network = transition_model(problem).network(sequence, RIGID, lasting)
    found = feasible_schedule(network, np.array(lasting), problem)
    assert found is not None
    return verified(problem, Candidate(motion, profiles, *found, 0), found[1])


def repeated(displacement: tuple[float, ...]) -> Array:
    """A phase whose intervals add up to a displacement (5,)."""
    return np.tile(np.array(displacement) / INTERVALS, (INTERVALS, 1))


def pick_and_place(
    carry: tuple[float, float, float] = (0.2, 0.1, 0.5),
    hold: str = "caged",
    closed_per_m: float = CLOSED_PER_M,
    **world: Any,
) -> Trajectory:
    """Grasp the cup at the origin, carry it by a twist (m, m, rad) and release it."""
    plan = picked(carry, closed_per_m)
    return replace(plan.trajectory, problem=_problem(plan, hold, **world), done_s=times(plan))


@cache
def picked(carry: tuple[float, float, float], closed_per_m: float = CLOSED_PER_M) -> Plan:
    """Its motion: close around what is at the origin, drive, open, and back away."""
    closed = np.array([0.0, -0.0345, 0.0, closed_per_m, closed_per_m])
    opening = repeated((-0.15, -0.15, 0, 0, 0))
    begun = roll_out(load_robot("2sra-v1"), closed, ((1, 1),), opening[None]).states[-1, -1]
    driven = repeated((0, 0, *carry))
    return made(
        begun, SEQUENCE, np.array([-opening, driven, opening, repeated((0, 0, 0, -0.03, 0))])
    )


def times(plan: Plan) -> tuple[float, float, float]:
    """When the grasp, the carrying and the release of that plan are done."""
    frozen = max(
        item.done_s
        for item in plan.transitions
        if item.to == "rigid" and item.done_s < plan.phases[1].start_s + 1e-3
    )
    return frozen, plan.phases[1].end_s, plan.phases[-1].end_s


def _problem(plan: Plan, hold: str, **world: Any) -> Problem:
    q = plan.trajectory.configuration(times(plan)[1:2])[0]
    x, y = q[:2] + 0.0345 * np.array([-np.sin(q[2]), np.cos(q[2])])
    cup = {"name": "cup", "disc": {"radius_m": RADIUS_M}, "pose": {"x_m": 0.0, "y_m": 0.0}}
    tasks = [
        {"do": "grasp", "object": "cup", "hold": hold},
        {"do": "carry", "object": "cup", "x_m": float(x), "y_m": float(y), "phi_rad": float(q[2])},
        {"do": "release", "object": "cup"},
    ]
    values = {**dict(plan.problem), "objects": [{**cup, "friction": 0.3}], "tasks": tasks, **world}
    return Problem(**{**values, "goal": None})
