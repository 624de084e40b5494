"""What the peers share: a time grid's bounds and straight-line guess, stages into phases, waits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc import Problem
from twosra_mpc.model.motion import Motion, roll_out
from twosra_mpc.planning.nlp.landing import available_inputs
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode, ModeSequence
from twosra_mpc.timing import earliest_times, transition_model

Array = NDArray[np.float64]
Block = tuple[ca.MX, float, float]  # constraints with one lower and one upper bound

STILL = 1e-7  # m or rad; a stage that moves less is left out of the sequence
TIME_SCALE = 100.0  # s


@dataclass(frozen=True)
class Waits:
    """Least times of one transition of each segment (pairs) [s], read off our temporal network.

    Attributes:
        melted: From t = 0 until the segment is soft, if it is heated at once.
        melting: Standstill while it melts.
        freezing: Standstill while it freezes.
    """

    melted: tuple[float, float]
    melting: tuple[float, float]
    freezing: tuple[float, float]


def waits(problem: Problem) -> Waits:
    """Least transition times of a problem that starts solid.

    Raises:
        ValueError: If a segment cannot melt and freeze at all.
    """
    model = transition_model(problem)

    def events(sequence: ModeSequence, last: Mode) -> tuple[float, float, float]:
        """Start of the first and of the last phase, and the finish, if motion took no time."""
        network = model.network(sequence, last, [0.0] * len(sequence))
        times, layout = earliest_times(network), network.layout
        if times is None:
            raise ValueError("the transitions of a single melt contradict each other")
        return times[layout.start(0)], times[layout.start(layout.phases - 1)], times[layout.finish]

    melted, melting, freezing = [], [], []
    for alone, other in ((SOFT_1, SOFT_2), (SOFT_2, SOFT_1)):
        first, _, finish = events((alone,), RIGID)
        melted.append(first)
        freezing.append(finish - first)
        before, both, _ = events((other, SOFT_BOTH), SOFT_BOTH)
        melting.append(both - before)
    return Waits((melted[0], melted[1]), (melting[0], melting[1]), (freezing[0], freezing[1]))


def stacked_waits(problem: Problem) -> Array:
    """Columns melted, melting, freezing, stiffness at t = 0 and at the end, one after another."""
    least = waits(problem)
    columns = [least.melted, least.melting, least.freezing, problem.start_mode, problem.goal.mode]
    return np.array(columns, dtype=float).ravel()


def bent_segments(problem: Problem) -> list[int]:
    """Segments (0 or 1) whose curvature must change."""
    change = np.abs(problem.goal.configuration - problem.start.configuration)
    return [j for j in (0, 1) if change[3 + j] > problem.goal.half_width[3 + j]]


def goal_near(problem: Problem) -> Array:
    """Goal q, its heading the equivalent nearest the start's; free coordinates as at the start."""
    start = problem.start.configuration
    goal = np.where(np.isnan(problem.goal.configuration), start, problem.goal.configuration)
    if problem.goal.phi_modulo:
        goal[2] -= 2 * np.pi * np.round((goal[2] - start[2]) / (2 * np.pi))
    return goal


def straight_line(problem: Problem, nodes: int) -> Array:
    """States on a straight line from start to goal, (nodes, 5): the guess of every peer."""
    start = problem.start.configuration
    share = np.linspace(0.0, 1.0, nodes)[:, None]
    return np.asarray(start + share * (goal_near(problem) - start))


def state_bounds(problem: Problem, nodes: int) -> tuple[Array, Array]:
    """Bounds of the states (nodes, 5): start, goal box, curvature limits."""
    high = np.full((nodes, 5), np.inf)
    high[:, 3:] = problem.robot.limits.curvature_per_m
    low = -high
    low[0] = high[0] = problem.start.configuration
    asked, goal = ~np.isnan(problem.goal.configuration), goal_near(problem)
    box = problem.goal.half_width
    low[-1, asked] = np.maximum(low[-1], goal - box)[asked]
    high[-1, asked] = np.minimum(high[-1], goal + box)[asked]
    return low, high


def stacked(blocks: Sequence[Block]) -> tuple[ca.MX, Array, Array]:
    """Stack (block, lower, upper) into one constraint vector with its bounds."""
    columns = [ca.vec(block) for block, _, _ in blocks]
    sizes = [column.numel() for column in columns]
    low = np.repeat([float(low) for _, low, _ in blocks], sizes)
    high = np.repeat([float(high) for _, _, high in blocks], sizes)
    return ca.vertcat(*columns), low, high


def as_motion(problem: Problem, modes: Sequence[Mode], displacements: Array) -> Motion | None:
    """Join stages of equal mode into phases and follow them; None if nothing moves.

    Args:
        problem: The problem.
        modes: Mode of each stage.
        displacements: Input displacement of each stage, (stages, 5) [m, m, m, m, rad]; inputs
            that a stage's mode does not have are ignored.
    """
    moved = displacements * available_inputs(tuple(modes), 1).reshape(-1, 5)
    phases: list[tuple[Mode, list[Array]]] = []
    for mode, move in zip(modes, moved, strict=True):
        if np.abs(move).max() <= STILL:
            continue
        if not phases or phases[-1][0] != mode:
            phases.append((mode, []))
        phases[-1][1].append(move)
    if not phases:
        return None
    inputs = np.zeros((len(phases), max(len(moves) for _, moves in phases), 5))
    for i, (_, moves) in enumerate(phases):
        inputs[i, : len(moves)] = moves
    sequence = tuple(mode for mode, _ in phases)
    return roll_out(problem.robot, problem.start.configuration, sequence, inputs)
