"""Problems the tests share: random ones from a seed, robots with other times, and their bounds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from twosra_mpc import Goal, InputError, Problem, Robot, Start, load_robot
from twosra_mpc.model.flow import Motion
from twosra_mpc.planning.bounds.bends import least_durations
from twosra_mpc.planning.bounds.sequence_bound import Events, SequenceBound, sequence_bound
from twosra_mpc.planning.relaxation import bending_task, stage_tree
from twosra_mpc.planning.search.nodes import Node
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.planning.solver.guess import guess_motion
from twosra_mpc.planning.stages.variants import Variant, ways_of
from twosra_mpc.problem.ends import check_shapes
from twosra_mpc.problem.limits import body_gaps_m
from twosra_mpc.robot.modes import RIGID, Mode, ModeSequence
from twosra_mpc.robot.timing import OverlappedTiming
from twosra_mpc.timing import TemporalNetwork, transition_model

ROBOT = load_robot("2sra-v1-paper")


def at_once(robot: Robot) -> Robot:
    """The robot as the paper's is: no limit on acceleration, bending, driving and turning rates."""
    of_paper = ("wheel_speed_rad_s", "unit_speed_m_s", "curvature_per_m", "unit_gap_m")
    limits = {name: getattr(robot.limits, name) for name in (*of_paper, "wheel_independence")}
    return robot.with_values(limits=type(robot.limits)(**limits))


def bold(robot: Robot) -> Robot:
    """The robot, though its wheels may have no lever on a segment that is soft alone."""
    return robot.with_values(limits=robot.limits.with_values(bend_lever=None))


def exactly(problem: Problem) -> Problem:
    """The problem with its goal to be met exactly."""
    return problem.with_values(goal=problem.goal.with_values(tolerance="exact"))


def random_problem(seed: int, robot: Robot = ROBOT, **overrides: Any) -> Problem:
    """abs(kappa) <= 60 1/m, positions within 0.25 m, any heading, units apart at both ends."""
    rng = np.random.default_rng(seed)

    def draw() -> dict[str, Any]:
        x, y = rng.uniform(-0.25, 0.25, 2)
        phi = rng.uniform(-np.pi, np.pi)
        return {"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": rng.uniform(-60, 60, 2)}

    start, goal = draw(), draw()
    problem = Problem(
        **{"robot": robot, "start": Start(**start), "goal": Goal(**goal), **overrides}
    )
    try:
        check_shapes(problem)
    except InputError:  # the units would overlap: draw again
        return random_problem(seed + 10_000, robot, **overrides)
    return problem


def network_of(problem: Problem, sequence: ModeSequence, last: Mode = RIGID) -> TemporalNetwork:
    """The temporal network of a sequence whose phases may take no time."""
    return transition_model(problem).network(sequence, last, [0.0] * len(sequence))


def bound_of(problem: Problem, sequence: ModeSequence, last: Mode = RIGID) -> SequenceBound | None:
    """The bound of a sequence as the search takes it; None if it has no plan."""
    task = bending_task(problem)
    durations = least_durations(sequence, task)
    if not all(map(math.isfinite, durations)):
        return None
    network = transition_model(problem).network(sequence, last, durations)
    return sequence_bound(Events(network, problem.cost_weights, durations), task)


def guessed(
    problem: Problem, sequence: ModeSequence, bends: Any = None, intervals: int = 10
) -> Motion:
    """The guess of a sequence with these bends, or those of its relaxation."""
    if bends is None:
        bound = bound_of(problem, sequence)
        assert bound is not None
        bends = bound.bends
    start = problem.start.configuration
    return guess_motion(problem.robot, start, problem.goal, sequence, bends, intervals)


def faster_robot(factor: float) -> Robot:
    """2sra-v1-paper whose metal melts and freezes ``factor`` times faster."""
    timing = OverlappedTiming(
        overlap="full",
        melt_s=63.0 / factor,
        melt_changing_s=37.0 / factor,
        freeze_s=253.0 / factor,
        freeze_changing_s=235.0 / factor,
        superheat_s=3.0 / factor,
    )
    return ROBOT.with_values(timing={"nominal": timing})


def only_goal(problem: Problem) -> Variant:
    """The one way to do a problem without objects."""
    (variant,) = ways_of(problem).variants
    return variant


def goal_tree(problem: Problem, solver: Any = lambda *_: (), in_the_way: Any = None) -> Tree[Any]:
    """The search tree of a single goal."""
    return stage_tree(problem, [only_goal(problem)], solver, in_the_way=in_the_way)


def at(head: ModeSequence) -> Node:
    """The node of the first variant whose first stage begins with these modes."""
    return Node(0, (), head)


def overlapping_on_the_way_to(robot: Robot, kappa1: float, overlap_m: float) -> float:
    """Curvature of segment 2 with which bending segment 1 so far overlaps by that much at most."""
    least, most = 20.0, 35.0
    for _ in range(12):
        kappa2 = (least + most) / 2
        way = np.linspace(0.0, kappa1, 300)
        gaps_m = body_gaps_m(robot, np.column_stack([way, np.full_like(way, kappa2)]))
        least, most = (kappa2, most) if gaps_m.min() > -overlap_m else (least, kappa2)
    return least
