r"""Direct multiple shooting for a fixed mode sequence, built once per number of phases.

Phase i has N intervals. Decision variables: the states q_{i,k} at the nodes, the input
displacements s_{i,k} = v h of the intervals, and the event times t of the temporal network (see
``timing``). With F the flow of one interval and V the wheel configuration matrix,

.. math::
    \min\; c^T t + \rho \sum N \|s_{i,k} / \bar s\|^2 \quad\text{s.t.}\quad
    q_{i,k+1} = F(q_{i,k}, s_{i,k}, \sigma_i) \;\text{(defects)},\quad q_{i+1,0} = q_{i,N}, \\
    |V(q_{i,k}, \sigma_i) s_{i,k}| \le \omega_{max} h_i,\quad |s^{1,2}_{i,k}| \le v_{max} h_i,\quad
    h_i = (t_{end,i} - t_{start,i}) / N,\quad t_v - t_u \ge w_{uv},

curvatures within limits, locomotion units apart, wheels independent where the robot drives between
soft phases, q at the end in the goal box. The mode sequence sigma, the network (w,
-inf where it has no constraint), the cost c, start and goal are parameters or bounds, so one
compiled program serves every sequence of as many phases. Using displacements instead of velocities
keeps phases of zero length regular and makes the limits linear in s and t. The small rho picks the
shortest of the many motions that take equally long; it is not part of the cost reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from twosra_mpc.effort import Cost, OutOfEffortError, charge
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.outline import outline_points
from twosra_mpc.model.self_collision import self_collision
from twosra_mpc.problem import limits
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.speeds import speed_function
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array, Coordinates
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.timing import EventLayout

INPUT_SCALE = np.array([0.03, 0.03, 0.1, 0.1, 1.0])  # m, m, m, m, rad
TIME_SCALE = 100.0  # s
MOST_ADDED = 1e6  # to the Hessian: every try to add more factorises anew, which nobody counts


def state_scale(robot: Robot | Body) -> Array:
    """Scale of the coordinates of q, (3 + n,): 0.1 m, 1 rad, 30 1/m."""
    return Coordinates(robot.body.geometry.segments).each(0.1, 1.0, 30.0)


@dataclass(frozen=True)
class Transcription:
    """A compiled multiple-shooting program for ``phases`` phases of ``intervals`` intervals.

    The decision vector holds the states (phases, intervals + 1, 3 + n), the input displacements
    (phases, inputs, 5) and the event times, each divided by its scale.

    Attributes:
        scale: What the coordinates of a state are divided by, (3 + n,).
        layout: Numbering of the events.
        intervals: Shooting intervals per phase.
        inputs: Input displacements per phase: one for so many intervals alike.
        nlp: CasADi's dictionary x, p, f, g: can be printed, counted and handed to any solver.
        rows: Slices of g by name: defects, linkage, terminal, speed, shape, driving, network, and
            where the robot is to be, if it is to be inside, and apart, if its parts are to be.
    """

    scale: Array
    layout: EventLayout
    intervals: int
    inputs: int
    nlp: dict[str, ca.MX]
    rows: dict[str, slice]

    @property
    def phases(self) -> int:
        """Number of phases."""
        return self.layout.phases

    def pack(self, states: Array, inputs: Array, times: Array) -> Array:
        """Scale and stack states, input displacements and event times into the decision vector."""
        alike = inputs.reshape(self.phases, self.inputs, -1, INPUTS).mean(axis=2)
        parts = [states / self.scale, alike / INPUT_SCALE, times / TIME_SCALE]
        return np.concatenate([part.ravel() for part in parts])

    def unpack(self, x: Array) -> tuple[Array, Array, Array]:
        """Split a decision vector into states, input displacements and event times."""
        n, m, size = self.phases, self.intervals, len(self.scale)
        cut_1 = n * (m + 1) * size
        cut_2 = cut_1 + n * self.inputs * INPUTS
        states = x[:cut_1].reshape(n, m + 1, size) * self.scale
        inputs = x[cut_1:cut_2].reshape(n, self.inputs, INPUTS) * INPUT_SCALE
        return states, inputs.repeat(m // self.inputs, axis=1), x[cut_2:] * TIME_SCALE

    def parameters(self, modes: Array, cost: Array, regularisation: float) -> Array:
        """Stack the parameters: modes (phases, n), cost coefficients of the events, rho."""
        return np.concatenate([modes.ravel(), cost, [regularisation]])


def transcribe(
    robot: Robot | Body,
    goal: GoalSet | None,
    phases: int,
    intervals: int,
    steps: int,
    inside: bool = False,
    apart: bool = False,
    smooth: bool = False,
) -> Transcription:
    """Write down the program for this many phases; ``steps`` Runge-Kutta steps per interval.

    A ``goal`` that is no box adds the equations that its members fulfil; None: it is one. With
    ``inside`` the places of the outline's points at all nodes and midway between them are rows, in
    units of 0.1 m; with ``apart`` the least separations of the robot's parts at all nodes. With
    ``smooth`` a phase's input is the same in all its intervals: where it changes, wheels must stop.
    """
    body = robot.body
    segments, scale = body.geometry.segments, state_scale(body)
    layout = EventLayout(phases, segments)
    states = ca.MX.sym("q", POSE + segments, phases * (intervals + 1))
    own = 1 if smooth else intervals
    inputs = ca.MX.sym("s", INPUTS, phases * own)
    times = ca.MX.sym("t", layout.count)
    modes = ca.MX.sym("sigma", segments, phases)
    cost = ca.MX.sym("c", layout.count)
    rho = ca.MX.sym("rho")

    t = times * TIME_SCALE
    input_of = ca.DM(INPUT_SCALE) * inputs
    s = ca.horzcat(*[input_of[:, i // (intervals // own)] for i in range(phases * intervals)])
    q = ca.DM(scale) * states
    nodes = np.arange(phases * (intervals + 1)).reshape(phases, intervals + 1)
    before, after = nodes[:, :-1].ravel().tolist(), nodes[:, 1:].ravel().tolist()
    mode_of = _repeated([modes[:, i] for i in range(phases)], intervals)
    lasting = [t[layout.end(i)] - t[layout.start(i)] for i in range(phases)]
    share = _repeated([time / intervals for time in lasting], intervals)

    flow = _flow(body, steps).map(phases * intervals)
    arrive = flow(q[:, before], s, mode_of)
    link = states[:, nodes[1:, 0].tolist()] - states[:, nodes[:-1, -1].tolist()]
    least_times = speed_function(body).map(phases * intervals)(q[:, before], s, mode_of)
    margins = limits.shape_function(body).map(phases * (intervals + 1))(q[POSE:, :])
    blocks = {
        "defects": (arrive - q[:, after]) / ca.DM(scale),
        "linkage": link,
        "terminal": _terminal(goal, q[:, -1]),
        "speed": _speed([*least_times], share),
        "shape": _rows_of(margins, driving=False),
        "driving": _rows_of(margins[:, nodes[:, 0].tolist()], driving=True),
        "network": ca.vertcat(*[(t[v] - t[u]) / TIME_SCALE for u, v in layout.pairs()]),
    }
    if inside:
        visited = ca.horzcat(q, flow(q[:, before], s / 2, mode_of))
        places = outline_points(body.geometry).map(visited.size2())(visited)
        blocks["inside"] = places / float(scale[0])
    if apart:
        blocks["apart"] = _apart(body, q[POSE:, :]) / float(scale[0])
    g, rows = _stacked(blocks)
    nlp = {
        "x": ca.vertcat(ca.vec(states), ca.vec(inputs), times),
        "p": ca.vertcat(ca.vec(modes), cost, rho),
        "f": ca.dot(cost, t) + rho * intervals**2 / own * ca.sumsqr(inputs),
        "g": g,
    }
    return Transcription(scale, layout, intervals, own, nlp, rows)


@per_body()
def _flow(body: Body, steps: int) -> ca.Function:
    """The flow of an interval, written out; programs that live at a time share its derivatives."""
    return interval_flow(body, steps).expand()


def _repeated(of_phases: Sequence[ca.MX], intervals: int) -> ca.MX:
    """A column for each interval, of one for each phase."""
    return ca.horzcat(*[ca.repmat(column, 1, intervals) for column in of_phases])


def _speed(least_times: Sequence[ca.MX], share: ca.MX) -> ca.MX:
    """By how much intervals are too short for their inputs, in both directions."""
    shorter = [
        sign * time - ca.repmat(share, time.size1(), 1) for time in least_times for sign in (1, -1)
    ]
    return ca.vertcat(*shorter)


def _apart(body: Body, kappa: ca.MX) -> ca.MX:
    """Least separations of the robot's parts at nodes, (pairs, nodes) [m]."""
    one = ca.SX.sym("kappa", kappa.size1())
    least = ca.Function("least", [one], [self_collision(body).least(one)], {"cse": True})
    return least.map(kappa.size2())(kappa)


def _terminal(goal: GoalSet | None, end: ca.MX) -> ca.MX:
    """Terminal constraint: zero where the motion ends in the goal, within its box."""
    if goal is None:
        return ca.MX(0, 1)
    q = ca.SX.sym("q", end.numel())
    return ca.Function("residual", [q], [ca.densify(goal.residual(q))])(end)


def _rows_of(margins: ca.MX, *, driving: bool) -> ca.MX:
    """Rows of the shape limits that are no box, in units of their scale."""
    rows, scales = [], []
    for row, limit in enumerate(limits.SHAPE_LIMITS):
        if limit.driving == driving and limit.scale is not None:
            rows.append(row)
            scales.append(limit.scale)
    return margins[rows, :] / ca.repmat(ca.DM(scales), 1, margins.size2())


def _stacked(blocks: dict[str, ca.MX]) -> tuple[ca.MX, dict[str, slice]]:
    """Stack named blocks of constraints into one vector; where each of them lies."""
    rows: dict[str, slice] = {}
    first = 0
    for name, block in blocks.items():
        rows[name] = slice(first, first + block.numel())
        first += block.numel()
    return ca.vertcat(*[ca.vec(block) for block in blocks.values()]), rows


@per_body(4, bodies=1)  # the first one weighs 11 MiB or more, another one of its robot 1 to 4
def ipopt(
    robot: Body,
    goal: GoalSet | None,
    phases: int,
    intervals: int,
    steps: int,
    max_iterations: int,
    inside: bool = False,
    apart: bool = False,
    smooth: bool = False,
) -> tuple[Transcription, ca.Function, Stopping]:
    """Prepare the program of ``transcribe`` for IPOPT; what stops it must be kept with it.

    Intervals and nodes stay calls of one function each. Written out, an iteration takes nine tenths
    of the time, but the first one waits for seconds and 300 MiB, which 50 programs do not save.
    """
    transcription = transcribe(robot, goal, phases, intervals, steps, inside, apart, smooth)
    return transcription, *solver_of(transcription.nlp, max_iterations)


def solver_of(
    nlp: dict[str, Any], max_iterations: int, cost: int = Cost.NLP_STEP
) -> tuple[ca.Function, Stopping]:
    """Prepare a program for IPOPT, and what stops it, which must be kept with it.

    Args:
        nlp: CasADi's dictionary x, p, f, g.
        max_iterations: Iterations that it may take.
        cost: Of a variable in an iteration.
    """
    stopping = Stopping(nlp, cost)
    options: dict[str, Any] = {
        "iteration_callback": stopping,
        "ipopt.print_level": 0,
        "print_time": False,
        "show_eval_warnings": False,
        "calc_lam_p": False,  # nobody asks for it; where it fails, that is printed
        "ipopt.sb": "yes",
        "ipopt.max_iter": max_iterations,
        "ipopt.tol": 1e-8,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.bound_relax_factor": 0.0,
        "ipopt.max_hessian_perturbation": MOST_ADDED,
    }
    return ca.nlpsol("program", "ipopt", nlp, options), stopping


class Stopping(ca.Callback):
    """Stops a solver when the effort of whoever called it is over."""

    def __init__(self, nlp: dict[str, Any], cost: int) -> None:
        """For a program with these symbols x and expressions g; a variable costs so much a step."""
        ca.Callback.__init__(self)
        self._cost = cost
        self._sizes = {"f": 1, "x": nlp["x"].numel(), "g": nlp["g"].numel()}
        self.construct("stopping", {})

    def get_n_in(self) -> int:
        """As CasADi asks."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """As CasADi asks."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """As CasADi asks."""
        return ca.Sparsity.dense(self._sizes.get(ca.nlpsol_out(i).removeprefix("lam_"), 0), 1)

    def eval(self, _: Sequence[ca.DM]) -> list[int]:
        """Whether to stop."""
        try:
            charge(self._cost, self._sizes["x"])
        except OutOfEffortError:
            return [1]
        return [0]
