"""What the peers on a time grid share: programs in blocks, bounds, waits, stages into phases."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.peers import motions
from twosra_mpc import Problem, Robot
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.planning.solver.guess import available_inputs
from twosra_mpc.planning.solver.multiple_shooting import state_scale
from twosra_mpc.problem import limits
from twosra_mpc.problem.speeds import speed_function
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import Mode, ModeSequence, rigid_mode
from twosra_mpc.timing import transition_model

Array = NDArray[np.float64]
Block = tuple[ca.MX, float, float]  # constraints with one lower and one upper bound
Values = Mapping[str, Any]  # of the variables, by name; arrays are (columns, rows)

STILL = 1e-7  # m or rad; a stage that moves less is left out of the sequence
TIME_SCALE = 100.0  # s


class Formulation(NamedTuple):
    """A program in symbols; its variables have names, each is (rows, columns) of a grid.

    Attributes:
        variables: The states q, which are scaled, and others.
        cost: What is to be least.
        rows: Its constraints.
        parameters: ``stacked_waits`` of a problem.
    """

    variables: Mapping[str, ca.MX]
    cost: ca.MX
    rows: Sequence[Block]
    parameters: ca.MX

    @property
    def nlp(self) -> dict[str, ca.MX]:
        """The program as CasADi's solvers take it."""
        return {
            "x": ca.vertcat(*map(ca.vec, self.variables.values())),
            "f": self.cost,
            "g": ca.vertcat(*(ca.vec(block) for block, _, _ in self.rows)),
            "p": ca.vec(self.parameters),
        }

    def row_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bound of each constraint."""
        sizes = [block.numel() for block, _, _ in self.rows]
        low, high = (np.repeat([row[i] for row in self.rows], sizes) for i in (1, 2))
        return low, high

    def stacked(self, problem: Problem, given: Values) -> Array:
        """Values of all variables, q not scaled, one after another as in the program."""
        scale = dict.fromkeys(self.variables, 1.0) | {"q": state_scale(problem.robot)}
        return np.concatenate(
            [
                np.broadcast_to(given[name] / scale[name], variable.shape[::-1]).ravel()
                for name, variable in self.variables.items()
            ]
        )

    def parts(self, problem: Problem, stacked: Array) -> dict[str, Array]:
        """Variables as (columns, rows), q not scaled; the inverse of ``stacked``."""
        scale = dict.fromkeys(self.variables, 1.0) | {"q": state_scale(problem.robot)}
        ends = np.cumsum([variable.numel() for variable in self.variables.values()])
        return {
            name: part.reshape(variable.shape[::-1]) * scale[name]
            for (name, variable), part in zip(
                self.variables.items(), np.split(stacked, ends[:-1]), strict=True
            )
        }


class Program:
    """A formulation, compiled for one of CasADi's solvers."""

    def __init__(self, solver: str, formulation: Formulation, options: dict[str, Any]) -> None:
        self._formulation = formulation
        options = {"print_time": False, **options}
        self._solver = ca.nlpsol("peer", solver, formulation.nlp, options)

    def solve(
        self, problem: Problem, low: Values, high: Values, guess: Values
    ) -> tuple[str, float, dict[str, Array]]:
        """Solve; low, high and guess are of all variables but the states q, which are scaled.

        Returns the solver's words, the cost, and the variables as (columns, rows), q not scaled.
        """
        form = self._formulation
        nodes = form.variables["q"].shape[1]
        given = {"x0": {"q": motions.straight_line(problem, nodes), **guess}}
        given["lbx"], given["ubx"] = (
            {"q": bound, **more}
            for bound, more in zip(state_bounds(problem, nodes), (low, high), strict=True)
        )
        stacked = {name: form.stacked(problem, values) for name, values in given.items()}
        stacked["lbg"], stacked["ubg"] = form.row_bounds()
        found = self._solver(p=stacked_waits(problem), **stacked)
        words = self._solver.stats()["return_status"]
        return words, float(found["f"]), form.parts(problem, found["x"].full().ravel())


def state_bounds(problem: Problem, nodes: int) -> tuple[Array, Array]:
    """Bounds of the states (nodes, 3 + n): start, goal box, curvature limits."""
    of, start = problem.robot.coordinates, problem.start.configuration
    high = np.tile(of.each(np.inf, np.inf, problem.robot.limits.curvature_per_m), (nodes, 1))
    low, (nearest, farthest) = -high, problem.goal.box(start)
    low[-1], high[-1] = np.maximum(low[-1], nearest), np.minimum(high[-1], farthest)
    low[0] = high[0] = start
    return low, high


def state_rows(problem: Problem, states: ca.MX, arrive: ca.MX) -> list[Block]:
    """Defects of states (scaled) that arrive somewhere, and the limits of their shapes."""
    scale = ca.DM(state_scale(problem.robot))
    margins = limits.shape_function(problem.robot).map(states.shape[1])(
        scale[POSE:] * states[POSE:, :]
    )
    return [
        (arrive / scale - states[:, 1:], 0.0, 0.0),
        *(
            (row / limit.scale, 0.0, np.inf)
            for limit, row in zip(limits.SHAPE_LIMITS, ca.vertsplit(margins), strict=True)
            if limit.scale is not None and not limit.driving
        ),
    ]


def speed_rows(robot: Robot, q: ca.MX, s: ca.MX, modes: ca.MX, lengths: ca.MX) -> list[Block]:
    """Displacements s from q (not scaled) within the speed limits, in stages of these lengths."""
    least_times = speed_function(robot).map(s.shape[1])(q, s, modes)
    return [
        (sign * time - ca.repmat(lengths, time.shape[0], 1), -np.inf, 0.0)
        for sign in (1, -1)
        for time in least_times
    ]


def waits(problem: Problem) -> Array:
    """Least times of one transition of each segment [s], read off our temporal network.

    Columns melted, melting, freezing: from t = 0 until the segment is soft if it is heated at
    once; standstill while it melts; standstill while it freezes. For two segments or more.

    Raises:
        ValueError: If a segment cannot melt and freeze at all.
    """
    n, model = problem.robot.coordinates.segments, transition_model(problem)

    def events(*sequence: Mode, last: Mode) -> tuple[float, float, float]:
        """Start of the first and of the last phase, and the finish, if motion took no time."""
        network = model.network(sequence, last, [0.0] * len(sequence))
        times, layout = network.earliest, network.layout
        if times is None:
            raise ValueError("the transitions of a single melt contradict each other")
        return times[layout.start(0)], times[layout.start(layout.phases - 1)], times[layout.finish]

    least, every = [], (1,) * n
    for alone in np.eye(n, dtype=int):
        first, _, finish = events(tuple(alone.tolist()), last=rigid_mode(n))
        before, then, _ = events(tuple((1 - alone).tolist()), every, last=every)
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
