r"""Peer 1: one mixed-integer nonlinear program on a time grid, solved by Bonmin.

Stage k of N has the mode sigma_k (two binaries), input displacements s_k, a free length h_k and a
start t_k; t_N is the finish. With F the flow of a stage and b_j, b_N+1 the stiffness at both ends,

.. math::
    \min\; t_N + \rho N \sum \|s_k / \bar s\|^2 \quad\text{s.t.}\quad
    q_{k+1} = F(q_k, s_k, \sigma_k), \quad |V(q_k, \sigma_k) s_k| \le \omega_{max} h_k, \\
    t_{k+1} \ge t_k + h_k + \text{melting}_j (\sigma_{k+1,j} - \sigma_{k,j}), \quad
    t_{k+1} \ge t_k + h_k + \text{freezing}_j (\sigma_{k,j} - \sigma_{k+1,j}), \quad
    t_k \ge \text{melted}_j\, \sigma_{k,j}.

So it models the transition timing as stage-wise constraints that are linear in the binaries: stand
still while a segment melts or freezes, the segments' transitions overlap each other, and heating
before the first melt overlaps with driving. Not modelled are heating up again before a second
melt, and anything else that depends on a segment's history: with constant times this is
the timing of our planner but for second melts, with thermal times it is the least that any history
allows. Between integers J and V blend the modes multilinearly in sigma, as written in the model.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.answer import Answer, Settings
from benchmarks.peers.time_grid import (
    TIME_SCALE,
    Block,
    as_motion,
    stacked,
    stacked_waits,
    state_bounds,
    straight_line,
)
from twosra_mpc import Problem, Robot
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.kinematics import kinematics, wheel_travel
from twosra_mpc.planning.nlp.multiple_shooting import GAP_SCALE, INPUT_SCALE, STATE_SCALE

Array = NDArray[np.float64]

_REGULARISATION = 1e-2  # s per squared scaled displacement; speeds the relaxations up
_WIDEST = 10.0  # largest scaled displacement of a stage
_LATEST = 30.0  # largest scaled time
_INTEGRAL = 1e-4


@dataclass(frozen=True)
class TimeGridMinlp:
    """Peer 1 and what was tuned."""

    stages: int = 24
    time_limit_s: float = 20.0  # Bonmin counts CPU time
    longest_stage_s: float = 0.5  # short stages tighten the relaxation
    gap: float = 0.01  # the planner's own default

    @property
    def name(self) -> str:
        """What the report calls it."""
        return "time-grid MINLP"

    @property
    def settings(self) -> Settings:
        """Everything that was tuned."""
        return {**asdict(self), **_OPTIONS}

    def prepare(self, problem: Problem) -> None:
        """Write down and compile the program."""
        _program(problem.robot, self)

    def solve(self, problem: Problem) -> Answer:
        """Plan; the answer is Bonmin's incumbent when it ends."""
        program = _program(problem.robot, self)
        low, high = self._bounds(problem)
        solution = program.solver(
            x0=self._guess(problem),
            p=stacked_waits(problem),
            lbx=low,
            ubx=high,
            lbg=program.low,
            ubg=program.high,
        )
        status = f"Bonmin: {program.solver.stats()['return_status']}"
        x = ca.DM(solution["x"]).full().ravel()
        modes = x[program.modes]
        if not np.isfinite(x).all() or float(solution["f"]) > 1e20:
            return Answer(f"{status}, no incumbent", None)
        if np.abs(modes - modes.round()).max() > _INTEGRAL:
            return Answer(f"{status}, incumbent is not integral", None)
        pairs = modes.round().astype(int).reshape(self.stages, 2).tolist()
        displacements = x[program.inputs].reshape(self.stages, 5) * INPUT_SCALE
        motion = as_motion(problem, [(a, b) for a, b in pairs], displacements)
        return Answer(f"{status}, incumbent {float(solution['f']):.1f} s", motion)

    def _bounds(self, problem: Problem) -> tuple[Array, Array]:
        n = self.stages
        low, high = state_bounds(problem, n + 1)
        widest = np.full(5 * n, _WIDEST)
        lower = [(low / STATE_SCALE).ravel(), -widest, np.zeros(2 * n + n + n + 1)]
        upper = [(high / STATE_SCALE).ravel(), widest, np.ones(2 * n)]
        upper += [np.full(n, self.longest_stage_s), np.full(n + 1, _LATEST)]
        return np.concatenate(lower), np.concatenate(upper)

    def _guess(self, problem: Problem) -> Array:
        n = self.stages
        states = straight_line(problem, n + 1) / STATE_SCALE
        lengths = np.full(n, min(0.2, self.longest_stage_s))
        halves, times = np.full(2 * n, 0.5), np.linspace(0.0, 3.0, n + 1)
        return np.concatenate([states.ravel(), np.full(5 * n, 0.01), halves, lengths, times])


_OPTIONS: dict[str, Any] = {
    "expand": True,
    "bonmin.algorithm": "B-BB",
    "bonmin.variable_selection": "most-fractional",
    "bonmin.nlp_failure_behavior": "fathom",
    "bonmin.max_iter": 200,
}
_SILENT: dict[str, Any] = {
    "print_time": False,
    "bonmin.sb": "yes",
    "bonmin.bb_log_level": 0,
    "bonmin.nlp_log_level": 0,
}


@dataclass(frozen=True, eq=False)
class _Program:
    """The compiled program, bounds of its constraints, and where its variables lie."""

    solver: ca.Function
    low: Array
    high: Array
    inputs: slice
    modes: slice


@lru_cache(maxsize=8)
def _program(robot: Robot, peer: TimeGridMinlp) -> _Program:
    n = peer.stages
    states, inputs = ca.MX.sym("q", 5, n + 1), ca.MX.sym("s", 5, n)
    modes, lengths = ca.MX.sym("sigma", 2, n), ca.MX.sym("h", 1, n)
    times, least = ca.MX.sym("t", 1, n + 1), ca.MX.sym("waits", 2, 5)
    g, low, high = stacked(
        [
            *_motion_rows(robot, states, inputs, modes, lengths),
            *_timing_rows(modes, lengths, times, least),
        ]
    )
    parts = [ca.vec(part) for part in (states, inputs, modes, lengths, times)]
    ends = np.cumsum([part.numel() for part in parts])
    discrete = np.zeros(ends[-1], dtype=bool)
    discrete[ends[1] : ends[2]] = True
    nlp = {
        "x": ca.vertcat(*parts),
        "p": ca.vec(least),
        "f": TIME_SCALE * times[-1] + _REGULARISATION * n * ca.sumsqr(inputs),
        "g": g,
    }
    options: dict[str, Any] = {
        **_OPTIONS,
        **_SILENT,
        "discrete": discrete.tolist(),
        "bonmin.time_limit": peer.time_limit_s,
        "bonmin.allowable_fraction_gap": peer.gap,
    }
    solver = ca.nlpsol("time_grid", "bonmin", nlp, options)
    return _Program(solver, low, high, slice(ends[0], ends[1]), slice(ends[1], ends[2]))


def _motion_rows(
    robot: Robot, states: ca.MX, inputs: ca.MX, modes: ca.MX, lengths: ca.MX
) -> list[Block]:
    """Defects, speed limits of wheels and units, and the gap between the units."""
    n, limits = inputs.shape[1], robot.limits
    q, s = ca.DM(STATE_SCALE) * states, ca.DM(INPUT_SCALE) * inputs
    arrive = interval_flow(robot, 1).map(n)(q[:, :-1], s, modes)
    rolled = wheel_travel(robot).map(n)(q[:, :-1], s, modes) / limits.wheel_speed_rad_s
    travelled = s[:2, :] / limits.unit_speed_m_s
    gap = kinematics(robot).shape_margins.map(n + 1)(q[3:, :])[0, :] - limits.unit_gap_m
    return [
        ((arrive - q[:, 1:]) / ca.DM(STATE_SCALE), 0.0, 0.0),
        (rolled - ca.repmat(lengths, 4, 1), -np.inf, 0.0),
        (-rolled - ca.repmat(lengths, 4, 1), -np.inf, 0.0),
        (travelled - ca.repmat(lengths, 2, 1), -np.inf, 0.0),
        (-travelled - ca.repmat(lengths, 2, 1), -np.inf, 0.0),
        (gap / GAP_SCALE, 0.0, np.inf),
    ]


def _timing_rows(modes: ca.MX, lengths: ca.MX, times: ca.MX, least: ca.MX) -> list[Block]:
    """Standstill at every change of stiffness, and heating from t = 0; all linear in the modes.

    ``least`` has the columns melted, melting, freezing, stiffness at t = 0, stiffness at the end.
    """
    melted, melting, freezing, first, last = ca.horzsplit(least)
    change = ca.horzcat(modes, last) - ca.horzcat(first, modes)
    pause = TIME_SCALE * times - ca.horzcat(0, TIME_SCALE * times[:-1] + lengths)
    pauses, starts = ca.repmat(pause, 2, 1), ca.repmat(TIME_SCALE * times[:-1], 2, 1)
    rows = [pauses - melting * change, pauses + freezing * change, pause, starts - melted * modes]
    return [(row / TIME_SCALE, 0.0, np.inf) for row in rows]
