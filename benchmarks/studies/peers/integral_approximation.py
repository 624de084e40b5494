r"""Peer 2: combinatorial integral approximation: relax, round, polish.

1. Relax by outer convexification of the four modes m on a grid of N stages of equal, free length h:
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
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.answer import Answer, Settings
from benchmarks.peers.rounding import rounded
from benchmarks.peers.shooting import INTERVALS, compile_programs, solved
from benchmarks.peers.time_grid import (
    TIME_SCALE,
    Block,
    bent_segments,
    stacked,
    stacked_waits,
    state_bounds,
    straight_line,
)
from twosra_mpc import Problem, Robot
from twosra_mpc.model.kinematics import kinematics, wheel_travel
from twosra_mpc.model.motion import Motion
from twosra_mpc.planning.nlp.fixed_sequence import SolveStatus, solve_status
from twosra_mpc.planning.nlp.landing import available_inputs
from twosra_mpc.planning.nlp.multiple_shooting import GAP_SCALE, INPUT_SCALE, STATE_SCALE
from twosra_mpc.robot.modes import MODES

Array = NDArray[np.float64]

_REGULARISATION = 1e-4  # s per squared scaled displacement, as in our own program
_USABLE = available_inputs(MODES, 1).reshape(len(MODES), 5) > 0
_LEAST_SHARE = 1e-3  # of a stage; a mode that has less says nothing of its input
_OPTIONS: dict[str, Any] = {
    "expand": True,
    "ipopt.max_iter": 300,
    "ipopt.mu_strategy": "adaptive",
}
_SILENT: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}


@dataclass(frozen=True)
class IntegralApproximation:
    """Peer 2 and what was tuned."""

    stages: int = 24
    max_switches: int = 3
    dwell_stages: int = 2
    milp_time_limit_s: float = 10.0

    @property
    def name(self) -> str:
        """What the report calls it."""
        return "integral approximation"

    @property
    def settings(self) -> Settings:
        """Everything that was tuned."""
        return {**asdict(self), "polishing_intervals": INTERVALS, **_OPTIONS}

    def prepare(self, problem: Problem) -> None:
        """Compile the programs."""
        _relaxation(problem.robot, self.stages)
        compile_programs(problem, self.max_switches + 1)

    def solve(self, problem: Problem) -> Answer:
        """Plan; the answer is the polished motion of the one sequence found."""
        relaxed, status = self._relaxed(problem)
        if relaxed is None:
            return Answer(status, None)
        rounding = rounded(
            relaxed.shares,
            [[m for m, mode in enumerate(MODES) if mode[j]] for j in bent_segments(problem)],
            max_switches=self.max_switches,
            dwell_stages=self.dwell_stages,
            time_limit_s=self.milp_time_limit_s,
        )
        status += f"; HiGHS: {rounding.status}"
        if rounding.choice is None:
            return Answer(status, None)
        candidate = solved(_guess(problem, relaxed, rounding.choice), problem)
        if candidate is None:
            return Answer(f"{status}; IPOPT found no plan of the rounded sequence", None)
        return Answer(f"{status}; polished", candidate.motion)

    def _relaxed(self, problem: Problem) -> tuple[_Relaxed | None, str]:
        program, n, m = _relaxation(problem.robot, self.stages), self.stages, len(MODES)
        low, high = state_bounds(problem, n + 1)
        usable = np.where(np.tile(_USABLE.ravel(), n), np.inf, 0.0)
        rest, line = n * m + n + 1, straight_line(problem, n + 1)
        x0 = [(line / STATE_SCALE).ravel(), np.full(5 * m * n, 0.01), np.full(rest, 0.1)]
        solution = program.solver(
            x0=np.concatenate(x0),
            p=stacked_waits(problem),
            lbx=np.concatenate([(low / STATE_SCALE).ravel(), -usable, np.zeros(rest)]),
            ubx=np.concatenate([(high / STATE_SCALE).ravel(), usable, np.full(rest, np.inf)]),
            lbg=program.low,
            ubg=program.high,
        )
        words = program.solver.stats()["return_status"]
        status = f"IPOPT: {words} (relaxation)"
        if solve_status(words) not in (SolveStatus.SOLVED, SolveStatus.ACCEPTABLE):
            return None, status
        x = ca.DM(solution["x"]).full().ravel()
        ends = np.cumsum([5 * (n + 1), 5 * m * n, m * n])
        states = x[: ends[0]].reshape(n + 1, 5) * STATE_SCALE
        inputs = x[ends[0] : ends[1]].reshape(n, m, 5) * INPUT_SCALE
        times = np.maximum(x[ends[1] : ends[2]].reshape(n, m), 0.0)
        return _Relaxed(states, inputs, times / times.sum(axis=1, keepdims=True)), status


@dataclass(frozen=True, eq=False)
class _Relaxed:
    """Solution of the relaxation.

    Attributes:
        states: q at the nodes, (stages + 1, 5).
        inputs: Displacement of each mode in each stage, (stages, modes, 5).
        shares: Share of each mode in each stage, (stages, modes).
    """

    states: Array
    inputs: Array
    shares: Array


@dataclass(frozen=True, eq=False)
class _Program:
    solver: ca.Function
    low: Array
    high: Array


@lru_cache(maxsize=8)
def _relaxation(robot: Robot, stages: int) -> _Program:
    n, m = stages, len(MODES)
    states, inputs = ca.MX.sym("q", 5, n + 1), ca.MX.sym("s", 5, m * n)
    times, pauses, least = ca.MX.sym("tau", m, n), ca.MX.sym("w", 1, n + 1), ca.MX.sym("p", 2, 5)
    g, low, high = stacked(
        [*_motion_rows(robot, states, inputs, times), *_pause_rows(times, pauses, least)]
    )
    nlp = {
        "x": ca.vertcat(*[ca.vec(part) for part in (states, inputs, times, pauses)]),
        "p": ca.vec(least),
        "f": ca.sum2(ca.sum1(times))
        + TIME_SCALE * ca.sum2(pauses)
        + _REGULARISATION * n * ca.sumsqr(inputs),
        "g": g,
    }
    return _Program(ca.nlpsol("relaxation", "ipopt", nlp, {**_SILENT, **_OPTIONS}), low, high)


def _motion_rows(robot: Robot, states: ca.MX, inputs: ca.MX, times: ca.MX) -> list[Block]:
    """Defects, each mode's speed limits in its own time, equal stages, gap between the units."""
    m, n = times.shape
    limits = robot.limits
    q = ca.DM(STATE_SCALE) * states
    s = ca.repmat(ca.DM(INPUT_SCALE), m, n) * ca.reshape(inputs, 5 * m, n)
    arrive = _blended_flow(robot).map(n)(q[:, :-1], s)
    gap = kinematics(robot).shape_margins.map(n + 1)(q[3:, :])[0, :] - limits.unit_gap_m
    lengths = ca.sum1(times)
    rows: list[Block] = [
        ((arrive - q[:, 1:]) / ca.DM(STATE_SCALE), 0.0, 0.0),
        (lengths[1:] - lengths[:-1], 0.0, 0.0),
        (gap / GAP_SCALE, 0.0, np.inf),
    ]
    rolling = wheel_travel(robot).map(n)
    for i, mode in enumerate(MODES):
        own = s[5 * i : 5 * i + 5, :]
        rolled = rolling(q[:, :-1], own, ca.repmat(ca.DM(mode), 1, n)) / limits.wheel_speed_rad_s
        used = ca.vertcat(rolled, own[:2, :] / limits.unit_speed_m_s)
        time = ca.repmat(times[i, :], used.shape[0], 1)
        rows += [(used - time, -np.inf, 0.0), (-used - time, -np.inf, 0.0)]
    return rows


def _blended_flow(robot: Robot) -> ca.Function:
    """(q, s of all modes stacked) -> q after a stage, one Runge-Kutta 4 step of sum_m J_m s_m."""
    jacobian = kinematics(robot).jacobian
    q, s = ca.SX.sym("q", 5), ca.SX.sym("s", 5 * len(MODES))

    def rate(at: ca.SX) -> ca.SX:
        moves = [jacobian(at, mode) @ s[5 * i : 5 * i + 5] for i, mode in enumerate(MODES)]
        return ca.sum2(ca.horzcat(*moves))

    k1 = rate(q)
    k2 = rate(q + k1 / 2)
    k3 = rate(q + k2 / 2)
    k4 = rate(q + k3)
    return ca.Function("blended_flow", [q, s], [q + (k1 + 2 * k2 + 2 * k3 + k4) / 6])


def _pause_rows(times: ca.MX, pauses: ca.MX, least: ca.MX) -> list[Block]:
    """Standstill per change of the soft shares; multiplied by the length of a stage."""
    _, melting, freezing, first, last = ca.horzsplit(least)
    soft, length = ca.DM(MODES).T @ times, ca.sum1(times[:, 0])
    change = ca.horzcat(soft, last * length) - ca.horzcat(first * length, soft)
    paused = ca.repmat(TIME_SCALE * pauses * length, 2, 1)
    rows = [paused - melting * change, paused + freezing * change]
    return [(row / TIME_SCALE, 0.0, np.inf) for row in rows]


def _guess(problem: Problem, relaxed: _Relaxed, choice: tuple[int, ...]) -> Motion:
    """Relaxed states of each run of equal modes, and the inputs its mode had in its own share."""
    runs = [list(run) for _, run in itertools.groupby(range(len(choice)), key=lambda k: choice[k])]
    sequence = tuple(MODES[choice[run[0]]] for run in runs)
    states = np.zeros((len(runs), INTERVALS + 1, 5))
    inputs = np.zeros((len(runs), INTERVALS, 5))
    for i, run in enumerate(runs):
        mode, at = choice[run[0]], np.linspace(run[0], run[-1] + 1, INTERVALS + 1)
        nodes = np.arange(len(relaxed.states))
        states[i] = np.array([np.interp(at, nodes, column) for column in relaxed.states.T]).T
        share = np.maximum(relaxed.shares[run, mode], _LEAST_SHARE)
        inputs[i] = (relaxed.inputs[run, mode] / share[:, None]).sum(axis=0) / INTERVALS
    return Motion(problem.robot, sequence, inputs, states)
