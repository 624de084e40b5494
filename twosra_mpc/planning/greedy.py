"""The greedy reference planner: the paper's Algorithm 1 on the robot's own model.

At every step each mode proposes to remove as much of the error as its Jacobian can, the mode whose
proposal ends nearest the goal (unweighted norm, as published) is taken and kept until it no longer
moves the robot. Melting and freezing play no part in the choice. What differs from the published
loop (``greedy.published``): the Jacobian is the autonomous one, steps follow the exact flow, a step
never removes more than the whole error, so the loop cannot diverge, and it heads for the middle of
the goal and ends as soon as it is in it. The resulting path gets the same transition model, speed
limits and verification as every plan.
"""

from __future__ import annotations

import enum
import math
import time
from dataclasses import dataclass

import numpy as np

from twosra_mpc.effort import Cost, charge, spent
from twosra_mpc.model.flow import interval_flow, roll_out
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.solver.fixed_sequence import scheduled, verified
from twosra_mpc.planning.solver.gentle import cheapest
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.problem.limits import broken_by_shapes
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode
from twosra_mpc.timing import transition_model

STEP_S = 0.05  # DT of the published simulations; sets the gain schedule t (1 - exp(-t)) DT
MAX_ITERATIONS = 5000
_STAGNATION = 1e-9  # unweighted norm of (m, m, rad, 1/m, 1/m)
_REACHED = 1e-8
_RECORDED = 1e-5  # phases that move less than this are left out, as published
_LONGEST_STEP_M = 0.003  # longer soft steps are split, so that the roll-out stays accurate
_SHORTEST_STEP = 1e-5  # m or rad; shorter ones are joined to the step before
_FLOW_STEPS = 4
_LOST = "wheels lose control, or hold of a segment that is soft alone"
_OTHERWISE = 'allow more modes, or set planner to "optimal"'


class GreedyEnding(enum.Enum):
    """Reason why the greedy loop ended."""

    REACHED = "the goal is reached"
    STAGNATED = "no allowed mode comes nearer to the goal"
    ITERATION_LIMIT = f"the goal is not reached within {MAX_ITERATIONS} iterations"


@dataclass(frozen=True)
class GreedyPath:
    """Path of the greedy rule: one mode and one input displacement (5,) per step."""

    modes: tuple[Mode, ...]
    steps: tuple[Array, ...]
    ending: GreedyEnding


def greedy_path(problem: Problem) -> GreedyPath:
    """Follow the greedy rule from start to goal."""
    robot, goal = problem.robot, problem.goal
    flow = interval_flow(robot, _FLOW_STEPS)
    q = problem.start.configuration
    current: Mode | None = None
    modes: list[Mode] = []
    steps: list[Array] = []
    for iteration in range(1, MAX_ITERATIONS + 1):
        if np.linalg.norm(goal.error(q.copy())) <= _REACHED:
            return GreedyPath(tuple(modes), tuple(steps), GreedyEnding.REACHED)
        charge(Cost.GREEDY_STEP, len(problem.modes))
        error = q - goal.aim(q)
        t = iteration * STEP_S
        gain = min(1.0, t * (1 - math.exp(-t)) * STEP_S)
        proposals = {mode: proposal(robot, q, error, mode) for mode in problem.modes}
        if current is None or np.linalg.norm(gain * proposals[current][1]) <= _STAGNATION:
            left = {
                mode: float(np.linalg.norm(error + gain * moved))
                for mode, (_, moved) in proposals.items()
            }
            current = min(left, key=lambda mode: left[mode])
            if np.linalg.norm(gain * proposals[current][1]) <= _STAGNATION:
                return GreedyPath(tuple(modes), tuple(steps), GreedyEnding.STAGNATED)
        step = gain * proposals[current][0]
        q = flow(q, step, current).full().ravel()
        modes.append(current)
        steps.append(step)
    return GreedyPath(tuple(modes), tuple(steps), GreedyEnding.ITERATION_LIMIT)


def proposal(robot: Robot, q: Array, error: Array, mode: Mode) -> tuple[Array, Array]:
    """Input displacement with which a mode removes most of the error, and what it moves, (5,)."""
    jacobian = kinematics(robot).jacobian(q, mode).full()
    columns = slice(0, 2) if any(mode) else slice(2, 5)
    displacement = np.zeros(5)
    displacement[columns] = -(np.linalg.pinv(jacobian[:, columns]) @ error)
    return displacement, jacobian @ displacement


def plan_greedily(problem: Problem) -> Result:
    """Plan with the greedy rule; its plan is one like any other, without a lower bound."""
    started = time.perf_counter()
    path = greedy_path(problem)
    phases = _phases(path) or [(problem.start_mode, [np.zeros(5)])]
    sequence = tuple(mode for mode, _ in phases)
    made: Plan | None = None
    timing = transition_model(problem)
    refusal = timing.refusal(sequence, problem.goal.mode)
    if path.ending is GreedyEnding.REACHED and refusal is None:
        longest = max((len(steps) for _, steps in phases), default=1)
        inputs = np.zeros((len(phases), longest, 5))
        for i, (_, steps) in enumerate(phases):
            inputs[i, : len(steps)] = steps
        motion = roll_out(problem.robot, problem.start.configuration, sequence, inputs)
        network = timing.network(sequence, problem.goal.mode, [0.0] * len(sequence))
        candidate = scheduled(motion, network, problem, iterations=0)
        if candidate is not None:
            candidate = cheapest(problem, candidate, network)
            made = verified(problem, candidate, network, "greedy")
    first = spent() if made is not None and made.verification.ok else None
    stats = Stats(time.perf_counter() - started, 0, 0, 0, spent(), first)
    if made is None:
        reason = path.ending.value
        if refusal is not None:
            reason = refusal
        elif path.ending is GreedyEnding.REACHED:
            visited = motion.states[:, :, POSE:].reshape(-1, problem.robot.coordinates.segments)
            broken = broken_by_shapes(problem.robot, visited)
            words = _LOST if broken is None else broken.words(problem.robot.limits)
            reason = f"its path leads through shapes whose {words}"
        status, message = Status.FAILED, f"the greedy rule found no plan: {reason}; {_OTHERWISE}"
    else:
        status, message, check = made.status, str(made), made.verification
        if not check.ok:
            message += f", which does not verify: {'; '.join(check.problems)}"
            if problem.obstacles or problem.tasks:
                message += " (the greedy rule knows neither obstacles nor tasks)"
            message += f"; {_OTHERWISE}"
    return Result(problem, "greedy", status, message, None, None, stats, made)


def _phases(path: GreedyPath) -> list[tuple[Mode, list[Array]]]:
    """Group the steps into phases; phases of negligible motion are left out and merged over."""
    phases: list[tuple[Mode, list[Array]]] = []
    for mode, step in zip(path.modes, path.steps, strict=True):
        if not phases or phases[-1][0] != mode:
            phases.append((mode, []))
        steps = phases[-1][1]
        if steps and np.abs(step).max() < _SHORTEST_STEP:
            steps[-1] = steps[-1] + step
            continue
        pieces = math.ceil(float(np.abs(step[:2]).max()) / _LONGEST_STEP_M) or 1
        steps.extend([step / pieces] * pieces)
    kept: list[tuple[Mode, list[Array]]] = []
    for mode, steps in phases:
        if sum(float(np.abs(step).sum()) for step in steps) <= _RECORDED:
            continue
        if kept and kept[-1][0] == mode:
            kept[-1][1].extend(steps)
        else:
            kept.append((mode, steps))
    return kept
