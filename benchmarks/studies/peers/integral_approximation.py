r"""Peer 2: combinatorial integral approximation: relax, round, polish.

1. Relax by outer convexification of the modes m on a grid of N stages of equal, free length h:
   each mode has its own share tau_{km} of the stage and its own displacements s_{km},

   .. math::
       \min\; N h + \text{waits} + \rho N \sum \|s / \bar s\|^2 \quad\text{s.t.}\quad
       q_{k+1} = F\Big(q_k, \sum_m J_m(q) s_{km}\Big), \quad
       |V_m(q_k) s_{km}| \le \omega_{max} \tau_{km}, \quad \sum_m \tau_{km} = h,

   waits being the standstill of melting and freezing, per change of the segments' soft share, as
   in ``minlp``. IPOPT, straight-line guess.
2. Round the shares to one mode a stage, with limits on switches and dwell time (``rounding``).
3. Polish: our own multiple-shooting program of the sequence found, started from the relaxed
   states and from the relaxed inputs of the modes chosen. Its timing is our temporal network.
"""

from __future__ import annotations

import itertools
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.peers import motions, time_grid
from benchmarks.studies.peers.motions import INTERVALS, Answer, Solve
from benchmarks.studies.peers.rounding import rounded
from benchmarks.studies.peers.time_grid import TIME_SCALE, Block, Formulation, Program
from benchmarks.study import Count
from twosra_mpc import Problem, Robot
from twosra_mpc.model.flow import Motion
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.solver.fixed_sequence import SolveStatus, solve_status
from twosra_mpc.planning.solver.guess import available_inputs
from twosra_mpc.planning.solver.multiple_shooting import INPUT_SCALE, state_scale
from twosra_mpc.robot.modes import Mode, all_modes
from twosra_mpc.validation import Positive, Value

Array = NDArray[np.float64]

_REGULARISATION = 1e-4  # s per squared scaled displacement, as in our own program
_LEAST_SHARE = 1e-3  # of a stage; a mode that has less says nothing of its input
_OPTIONS: dict[str, Any] = {
    "expand": True,
    "ipopt.max_iter": 300,
    "ipopt.mu_strategy": "adaptive",
    **{"ipopt.print_level": 0, "ipopt.sb": "yes"},
}


class IntegralApproximation(Value):
    """Peer 2 and what was tuned.

    Attributes:
        stages: Stages of the grid.
        max_switches: Most changes of mode.
        dwell_stages: Least stages a mode stays on.
        milp_time_limit_s: HiGHS' limit of wall time.
    """

    stages: Count = 24
    max_switches: int = 3
    dwell_stages: Count = 2
    milp_time_limit_s: Positive = 60.0

    def prepared(self, problem: Problem) -> Solve:
        """Compile the programs; the answer is the polished motion of the one sequence found."""
        modes, n = all_modes(problem.robot.coordinates.segments), self.stages
        program = _relaxation(problem, modes, n)
        motions.compile_programs(problem, self.max_switches + 1)
        usable = np.where(available_inputs(modes, 1).ravel() > 0, np.inf, 0.0)
        guess, lower = {"s": 0.01, "tau": 0.1, "w": 0.1}, {"s": -usable, "tau": 0.0, "w": 0.0}
        upper = {"s": usable, "tau": np.inf, "w": np.inf}
        bent = motions.bent_segments(problem)
        needed = [[m for m, mode in enumerate(modes) if mode[j]] for j in bent]
        limits = (self.max_switches, self.dwell_stages, self.milp_time_limit_s)

        def solve() -> Answer:
            words, _, x = program.solve(problem, lower, upper, guess)
            status = f"IPOPT: {words} (relaxation)"
            if solve_status(words) not in (SolveStatus.SOLVED, SolveStatus.ACCEPTABLE):
                return Answer(status, None)
            times = np.maximum(x["tau"], 0.0)
            shares = times / times.sum(axis=1, keepdims=True)
            rounding = rounded(shares, needed, *limits)
            status += f"; HiGHS: {rounding.status}"
            if rounding.choice is None:
                return Answer(status, None)
            own = (np.arange(n), np.array(rounding.choice))
            inputs = x["s"].reshape(n, len(modes), 5)[own] * INPUT_SCALE
            used = inputs / np.maximum(shares[own], _LEAST_SHARE)[:, None]
            guessed = _guess(problem, x["q"], used, [modes[m] for m in rounding.choice])
            candidate = motions.solved(guessed, problem)
            if candidate is None:
                return Answer(f"{status}; IPOPT found no plan of the rounded sequence", None)
            return Answer(f"{status}; polished", candidate.motion)

        return solve


def _relaxation(problem: Problem, modes: tuple[Mode, ...], n: int) -> Program:
    m, of = len(modes), problem.robot.coordinates
    states, inputs = ca.MX.sym("q", of.size, n + 1), ca.MX.sym("s", 5 * m, n)
    times, pauses = ca.MX.sym("tau", m, n), ca.MX.sym("w", 1, n + 1)
    least = ca.MX.sym("p", of.segments, 5)
    s = ca.repmat(ca.DM(INPUT_SCALE), m, 1) * inputs
    rows = _motion_rows(problem, modes, states, s, times) + _pause_rows(modes, times, pauses, least)
    cost = ca.sum2(ca.sum1(times)) + TIME_SCALE * ca.sum2(pauses)
    cost += _REGULARISATION * n * ca.sumsqr(inputs)
    variables = {"q": states, "s": inputs, "tau": times, "w": pauses}
    return Program("ipopt", Formulation(variables, cost, rows, least), _OPTIONS)


def _motion_rows(
    problem: Problem, modes: tuple[Mode, ...], states: ca.MX, s: ca.MX, times: ca.MX
) -> list[Block]:
    """Defects and gaps, equal stages, each mode's speed limits in its own time."""
    n, lengths = s.shape[1], ca.sum1(times)
    q = ca.DM(state_scale(problem.robot)) * states[:, :-1]
    rows = time_grid.state_rows(problem, states, _blended_flow(problem.robot, modes).map(n)(q, s))
    rows.append((lengths[1:] - lengths[:-1], 0.0, 0.0))
    for i, mode in enumerate(modes):
        own, sigma = s[5 * i : 5 * i + 5, :], ca.MX(ca.repmat(ca.DM(mode), 1, n))
        rows += time_grid.speed_rows(problem.robot, q, own, sigma, times[i, :])
    return rows


def _blended_flow(robot: Robot, modes: tuple[Mode, ...]) -> ca.Function:
    """(q, s of all modes stacked) -> q after a stage, one Runge-Kutta 4 step of sum_m J_m s_m."""
    jacobian = kinematics(robot).jacobian
    q, s = ca.SX.sym("q", robot.coordinates.size), ca.SX.sym("s", 5 * len(modes))

    def rate(at: ca.SX) -> ca.SX:
        moves = [jacobian(at, mode) @ s[5 * i : 5 * i + 5] for i, mode in enumerate(modes)]
        return ca.sum2(ca.horzcat(*moves))

    k1 = rate(q)
    k2 = rate(q + k1 / 2)
    k3 = rate(q + k2 / 2)
    k4 = rate(q + k3)
    return ca.Function("blended_flow", [q, s], [q + (k1 + 2 * k2 + 2 * k3 + k4) / 6])


def _pause_rows(modes: tuple[Mode, ...], times: ca.MX, pauses: ca.MX, least: ca.MX) -> list[Block]:
    """Standstill per change of the soft shares; multiplied by the length of a stage."""
    _, melting, freezing, first, last = ca.horzsplit(least)
    soft, length = ca.DM(modes).T @ times, ca.sum1(times[:, 0])
    change = ca.horzcat(soft, last * length) - ca.horzcat(first * length, soft)
    paused = ca.repmat(TIME_SCALE * pauses * length, soft.shape[0], 1)
    rows = [paused - melting * change, paused + freezing * change]
    return [(row / TIME_SCALE, 0.0, np.inf) for row in rows]


def _guess(problem: Problem, states: Array, used: Array, modes: list[Mode]) -> Motion:
    """Relaxed states of each run of equal modes, and the inputs its mode had in its own share."""
    runs = [list(run) for _, run in itertools.groupby(range(len(modes)), key=lambda k: modes[k])]
    nodes, width = np.arange(len(states)), states.shape[1]
    at = [np.linspace(run[0], run[-1] + 1, INTERVALS + 1) for run in runs]
    path = [[np.interp(some, nodes, states[:, i]) for i in range(width)] for some in at]
    inputs = [[used[run].sum(axis=0) / INTERVALS] * INTERVALS for run in runs]
    sequence = tuple(modes[run[0]] for run in runs)
    return Motion(problem.robot, sequence, np.array(inputs), np.swapaxes(path, 1, 2))
