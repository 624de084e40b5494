"""What the peers on a time grid share: programs in blocks, bounds, waits, stages into phases."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.peers.motions import goal_near, network_of
from twosra_mpc import Problem
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.motion import Motion, roll_out
from twosra_mpc.planning.nlp.landing import available_inputs
from twosra_mpc.planning.nlp.multiple_shooting import GAP_SCALE, STATE_SCALE
from twosra_mpc.robot.modes import Mode, ModeSequence, rigid_mode
from twosra_mpc.timing import earliest_times

Array = NDArray[np.float64]
Block = tuple[ca.MX, float, float]  # constraints with one lower and one upper bound
Values = Mapping[str, float | Array]  # of the variables, by name; arrays are (columns, rows)

STILL = 1e-7  # m or rad; a stage that moves less is left out of the sequence
TIME_SCALE = 100.0  # s


class Program:
    """A compiled program whose variables have names; a variable is (rows, columns) of a grid."""

    def __init__(
        self,
        solver: str,
        variables: Mapping[str, ca.MX],
        cost: ca.MX,
        rows: Sequence[Block],
        parameters: ca.MX,
        options: dict[str, Any],
    ) -> None:
        self._shapes = {name: variable.shape[::-1] for name, variable in variables.items()}
        sizes = [block.numel() for block, _, _ in rows]
        low, high = (np.repeat([row[i] for row in rows], sizes) for i in (1, 2))
        self._bounds = {"lbg": low, "ubg": high}
        nlp = {
            "x": ca.vertcat(*map(ca.vec, variables.values())),
            "f": cost,
            "g": ca.vertcat(*(ca.vec(block) for block, _, _ in rows)),
            "p": ca.vec(parameters),
        }
        self._solver = ca.nlpsol("peer", solver, nlp, {"print_time": False, **options})

    def solve(
        self, low: Values, high: Values, guess: Values, parameters: Array
    ) -> tuple[str, float, dict[str, Array]]:
        """Solve; returns the solver's words, the cost, and the variables as (columns, rows)."""
        low, high, guess = (self._stacked(values) for values in (low, high, guess))
        found = self._solver(x0=guess, lbx=low, ubx=high, p=parameters, **self._bounds)
        ends = np.cumsum([np.prod(shape) for shape in self._shapes.values()])
        parts = np.split(found["x"].full().ravel(), ends[:-1])
        values = {
            name: part.reshape(shape)
            for (name, shape), part in zip(self._shapes.items(), parts, strict=True)
        }
        return self._solver.stats()["return_status"], float(found["f"]), values

    def _stacked(self, values: Values) -> Array:
        return np.concatenate(
            [np.broadcast_to(values[name], shape).ravel() for name, shape in self._shapes.items()]
        )


def state_bounds(problem: Problem, nodes: int) -> tuple[Array, Array]:
    """Bounds of the scaled states (nodes, 3 + n): start, goal box, curvature limits."""
    start, asked = problem.start.configuration, ~np.isnan(problem.goal.configuration)
    high = np.full((nodes, len(start)), np.inf)
    high[:, 3:] = problem.robot.limits.curvature_per_m
    low = -high
    low[0] = high[0] = start
    goal, box = goal_near(problem), problem.goal.half_width
    low[-1, asked] = np.maximum(low[-1], goal - box)[asked]
    high[-1, asked] = np.minimum(high[-1], goal + box)[asked]
    return low / STATE_SCALE, high / STATE_SCALE


def state_rows(problem: Problem, states: ca.MX, arrive: ca.MX) -> list[Block]:
    """Defects of states (scaled) that arrive somewhere, and the gap between the units."""
    q, limits = ca.DM(STATE_SCALE) * states, problem.robot.limits
    margins = kinematics(problem.robot).shape_margins.map(states.shape[1])(q[3:, :])
    return [
        ((arrive - q[:, 1:]) / ca.DM(STATE_SCALE), 0.0, 0.0),
        ((margins[0, :] - limits.unit_gap_m) / GAP_SCALE, 0.0, np.inf),
    ]


def waits(problem: Problem) -> Array:
    """Least times of one transition of each segment [s], read off our temporal network.

    Columns melted, melting, freezing: from t = 0 until the segment is soft if it is heated at
    once; standstill while it melts; standstill while it freezes. For two segments or more.

    Raises:
        ValueError: If a segment cannot melt and freeze at all.
    """
    rigid = rigid_mode(problem.robot.coordinates.segments)

    def events(*sequence: Mode, last: Mode) -> tuple[float, float, float]:
        """Start of the first and of the last phase, and the finish, if motion took no time."""
        solid = problem.model_copy(update={"goal": problem.goal.model_copy(update={"mode": last})})
        network = network_of(solid, sequence)
        times, layout = earliest_times(network), network.layout
        if times is None:
            raise ValueError("the transitions of a single melt contradict each other")
        return times[layout.start(0)], times[layout.start(layout.phases - 1)], times[layout.finish]

    least = []
    for j in range(len(rigid)):
        alone = tuple(int(i == j) for i in range(len(rigid)))
        others = tuple(int(i != j) for i in range(len(rigid)))
        both = tuple(1 for _ in rigid)
        first, _, finish = events(alone, last=rigid)
        before, then, _ = events(others, both, last=both)
        least.append((first, then - before, finish - first))
    return np.array(least)


def stacked_waits(problem: Problem) -> Array:
    """Columns melted, melting, freezing, stiffness at t = 0 and at the end, one after another."""
    return np.column_stack([waits(problem), problem.start_mode, problem.goal.mode]).T.ravel()


def as_motion(problem: Problem, modes: Sequence[Mode], displacements: Array) -> Motion | None:
    """Join stages of equal mode into phases and follow them; None if nothing moves.

    Args:
        problem: The problem.
        modes: Mode of each stage.
        displacements: Input displacement of each stage, (stages, 5) [m, m, m, m, rad]; inputs
            that a stage's mode does not have are ignored.
    """
    usable = available_inputs(tuple(modes), 1).reshape(displacements.shape)
    moved = [
        (mode, move)
        for mode, move in zip(modes, displacements * usable, strict=True)
        if np.abs(move).max() > STILL
    ]
    phases = [
        (mode, [move for _, move in stages])
        for mode, stages in itertools.groupby(moved, key=lambda stage: stage[0])
    ]
    if not phases:
        return None
    inputs = np.zeros((len(phases), max(len(moves) for _, moves in phases), 5))
    for i, (_, moves) in enumerate(phases):
        inputs[i, : len(moves)] = moves
    sequence: ModeSequence = tuple(mode for mode, _ in phases)
    return roll_out(problem.robot, problem.start.configuration, sequence, inputs)
