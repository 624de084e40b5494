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

from typing import Any

import casadi as ca
import numpy as np

from benchmarks.studies.peers import time_grid
from benchmarks.studies.peers.motions import Answer, Solve
from benchmarks.studies.peers.time_grid import TIME_SCALE, Block, Formulation, Program
from benchmarks.study import Count
from twosra_mpc import Problem
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.planning.solver.multiple_shooting import INPUT_SCALE, state_scale
from twosra_mpc.validation import Positive, Value

_REGULARISATION = 1e-2  # s per squared scaled displacement; speeds the relaxations up
_WIDEST = 10.0  # largest scaled displacement of a stage
_LATEST = 30.0  # largest scaled time
_INTEGRAL = 1e-4
_OPTIONS: dict[str, Any] = {
    "expand": True,
    "bonmin.algorithm": "B-BB",
    "bonmin.variable_selection": "most-fractional",
    "bonmin.nlp_failure_behavior": "fathom",
    "bonmin.max_iter": 200,
    **{"bonmin.sb": "yes", "bonmin.bb_log_level": 0, "bonmin.nlp_log_level": 0},
}


class TimeGridMinlp(Value):
    """Peer 1 and what was tuned.

    Attributes:
        stages: Stages of the grid.
        time_limit_s: Bonmin's limit; it counts CPU time.
        longest_stage_s: Short stages tighten the relaxation.
        gap: The planner's own default.
    """

    stages: Count = 24
    time_limit_s: Positive = 20.0
    longest_stage_s: Positive = 0.5
    gap: Positive = 0.01

    def prepared(self, problem: Problem) -> Solve:
        """Compile the program; the answer of what is returned is Bonmin's incumbent at its end."""
        program, n = self._program(problem), self.stages
        guess = {"s": 0.01, "sigma": 0.5, "h": min(0.2, self.longest_stage_s)}
        guess["t"] = np.linspace(0.0, 3.0, n + 1)[:, None]
        lower, upper = input_bounds(self.longest_stage_s)

        def solve() -> Answer:
            words, cost, x = program.solve(problem, lower, upper, guess)
            status, modes = f"Bonmin: {words}", x["sigma"]
            if cost > 1e20 or not all(np.isfinite(part).all() for part in x.values()):
                return Answer(f"{status}, no incumbent", None)
            if np.abs(modes - modes.round()).max() > _INTEGRAL:
                return Answer(f"{status}, incumbent is not integral", None)
            chosen = [tuple(mode) for mode in modes.round().astype(int).tolist()]
            motion = time_grid.as_motion(problem, chosen, x["s"] * INPUT_SCALE)
            return Answer(f"{status}, incumbent {cost:z.1f} s", motion)

        return solve

    def _program(self, problem: Problem) -> Program:
        form = formulation(problem, self.stages)
        options = {
            **_OPTIONS,
            "discrete": [
                name == "sigma" for name, v in form.variables.items() for _ in range(v.numel())
            ],
            "bonmin.time_limit": self.time_limit_s,
            "bonmin.allowable_fraction_gap": self.gap,
        }
        return Program("bonmin", form, options)


def formulation(problem: Problem, stages: int) -> Formulation:
    """The program in symbols."""
    n, of = stages, problem.robot.coordinates
    states, inputs = ca.MX.sym("q", of.size, n + 1), ca.MX.sym("s", 5, n)
    modes, lengths = ca.MX.sym("sigma", of.segments, n), ca.MX.sym("h", 1, n)
    times, least = ca.MX.sym("t", 1, n + 1), ca.MX.sym("waits", of.segments, 5)
    scale = ca.DM(state_scale(problem.robot))
    q, s = scale * states[:, :-1], ca.DM(INPUT_SCALE) * inputs
    rows = [
        *time_grid.state_rows(problem, states, interval_flow(problem.robot, 1).map(n)(q, s, modes)),
        *time_grid.speed_rows(problem.robot, q, s, modes, lengths),
        *_timing_rows(modes, lengths, times, least),
    ]
    cost = TIME_SCALE * times[-1] + _REGULARISATION * n * ca.sumsqr(inputs)
    variables = {"q": states, "s": inputs, "sigma": modes, "h": lengths, "t": times}
    return Formulation(variables, cost, rows, least)


def input_bounds(longest_stage_s: float) -> tuple[dict[str, float], dict[str, float]]:
    """Bounds of all variables but the states."""
    return (
        {"s": -_WIDEST, "sigma": 0.0, "h": 0.0, "t": 0.0},
        {"s": _WIDEST, "sigma": 1.0, "h": longest_stage_s, "t": _LATEST},
    )


def _timing_rows(modes: ca.MX, lengths: ca.MX, times: ca.MX, least: ca.MX) -> list[Block]:
    """Standstill at every change of stiffness, and heating from t = 0; all linear in the modes.

    ``least`` has the columns melted, melting, freezing, stiffness at t = 0, stiffness at the end.
    """
    melted, melting, freezing, first, last = ca.horzsplit(least)
    change = ca.horzcat(modes, last) - ca.horzcat(first, modes)
    pause = TIME_SCALE * times - ca.horzcat(0, TIME_SCALE * times[:-1] + lengths)
    pauses, starts = (
        ca.repmat(part, modes.shape[0], 1) for part in (pause, TIME_SCALE * times[:-1])
    )
    rows = [pauses - melting * change, pauses + freezing * change, pause, starts - melted * modes]
    return [(row / TIME_SCALE, 0.0, np.inf) for row in rows]
