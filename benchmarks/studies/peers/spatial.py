"""Peers 4 and 5: the first peer's program by solvers that prove, SCIP and discopt.

Both branch on the binaries and on the ranges of all other variables, over convex relaxations of
every operation. So what they prove holds for each solution of the program: that of ``minlp`` on
fewer stages, with middle links no farther than some metres from the start. Each nonlinear operation
has a variable of its own: as one expression, a Runge-Kutta step is too long for either solver.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, Protocol

import casadi as ca
import numpy as np

from benchmarks.studies.peers import time_grid
from benchmarks.studies.peers.minlp import formulation, input_bounds
from benchmarks.studies.peers.motions import Answer, Solve
from benchmarks.study import Count
from twosra_mpc import Problem
from twosra_mpc.planning.solver.multiple_shooting import INPUT_SCALE
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.validation import Positive, Value

Operation = Callable[..., Any]

_INFINITE = 1e15  # either solver's infinity is more
_AWAY = 4.0  # m or rad; poses have no limits, which relaxations need
_LINEAR: Mapping[int, Operation] = {
    ca.OP_ADD: operator.add,
    ca.OP_SUB: operator.sub,
    ca.OP_NEG: operator.neg,
    ca.OP_TWICE: lambda a: 2 * a,
}
_NONLINEAR: Mapping[int, Operation] = {
    ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_FABS: abs,
    ca.OP_FMAX: lambda a, b: (a + b + abs(a - b)) / 2,
}
_FUNCTIONS = {ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_EXP: "exp", ca.OP_SQRT: "sqrt"}


class Model(Protocol):
    """A solver's model; what it computes with overloads Python's operators."""

    functions: Mapping[int, Operation]

    def variable(self, low: float, high: float, binary: bool = False) -> Any:
        """Add a variable."""

    def require(self, row: Any) -> None:
        """Add an equation or an inequality."""

    def solve(self, cost: Any, time_limit_s: float) -> tuple[str, float, Operation | None]:
        """Minimise; return the solver's words, its bound, and values at its incumbent, if any."""


class ScipModel:
    """A model of SCIP."""

    def __init__(self) -> None:
        import pyscipopt

        self._model = pyscipopt.Model()
        self.functions = {kind: getattr(pyscipopt, name) for kind, name in _FUNCTIONS.items()}

    def variable(self, low: float, high: float, binary: bool = False) -> Any:
        """Add a variable."""
        return self._model.addVar(lb=low, ub=high, vtype="B" if binary else "C")

    def require(self, row: Any) -> None:
        """Add an equation or an inequality."""
        self._model.addCons(row)

    def solve(self, cost: Any, time_limit_s: float) -> tuple[str, float, Operation | None]:
        """Minimise within so much CPU time."""
        model, least = self._model, self.variable(0.0, math.inf)
        self.require(least >= cost)  # SCIP's objectives are linear
        model.setObjective(least)
        model.setParams(
            {"limits/time": time_limit_s, "timing/clocktype": 1, "display/verblevel": 0}
        )
        model.optimize()
        best = model.getBestSol() if model.getNSols() else None
        words = f"SCIP: {model.getStatus()}, {model.getNNodes()} nodes"
        return words, model.getDualbound(), None if best is None else best.__getitem__


class DiscoptModel:
    """A model of discopt."""

    def __init__(self) -> None:
        import discopt

        self._model, self._variables = discopt.Model("peer"), 0
        self.functions = {kind: getattr(discopt, name) for kind, name in _FUNCTIONS.items()}

    def variable(self, low: float, high: float, binary: bool = False) -> Any:
        """Add a variable."""
        self._variables += 1
        name = f"x{self._variables}"
        if binary:
            return self._model.binary(name)
        limits = {"lb": low, "ub": high}
        return self._model.continuous(
            name, **{key: value for key, value in limits.items() if math.isfinite(value)}
        )

    def require(self, row: Any) -> None:
        """Add an equation or an inequality."""
        self._model.subject_to(row)

    def solve(self, cost: Any, time_limit_s: float) -> tuple[str, float, Operation | None]:
        """Minimise within so much wall time."""
        self._model.minimize(cost)
        found = self._model.solve(time_limit=time_limit_s)
        words, at = f"discopt: {found.status}, {found.node_count} nodes", found.x
        bound = -math.inf if found.bound is None else float(found.bound)
        return words, bound, at and (lambda variable: float(at[variable.name]))


_MODELS: Mapping[str, Callable[[], Model]] = {"SCIP": ScipModel, "discopt": DiscoptModel}


class SpatialMinlp(Value):
    """Peer 4 or 5 and what was tuned.

    Attributes:
        solver: Which.
        stages: Stages of the grid.
        time_limit_s: Of CPU time for SCIP; of wall time for discopt, which looks at it rarely.
        longest_stage_s: Short stages tighten the relaxation.
    """

    solver: Literal["SCIP", "discopt"]
    stages: Count = 6
    time_limit_s: Positive = 20.0
    longest_stage_s: Positive = 4.0

    def prepared(self, problem: Problem) -> Solve:
        """Build the model; the answer of what is returned is the incumbent at its end."""
        form, model = formulation(problem, self.stages), _MODELS[self.solver]()
        low, high = (
            form.stacked(problem, {"q": states, **others})
            for states, others in zip(
                _within_reach(problem, self.stages + 1),
                input_bounds(self.longest_stage_s),
                strict=True,
            )
        )
        binary = dict.fromkeys(form.variables, np.zeros(1)) | {"sigma": np.ones(1)}
        binaries = form.stacked(problem, binary).astype(bool)
        bounds = zip(low.tolist(), high.tolist(), binaries.tolist(), strict=True)
        x = [model.variable(*each) for each in bounds]
        nlp = form.nlp
        function = ca.Function("f", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]]).expand()
        (cost,), rows = evaluated(function, [x, time_grid.stacked_waits(problem).tolist()], model)
        for row, least, most in zip(rows, *map(np.ndarray.tolist, form.row_bounds()), strict=True):
            _bound(model, row, least, most)

        def solve() -> Answer:
            words, proved, at = model.solve(cost, self.time_limit_s)
            bound = proved if abs(proved) < _INFINITE else None
            if at is None:
                return Answer(f"{words}, no incumbent", None, bound)
            values = form.parts(problem, np.array([at(variable) for variable in x]))
            chosen = [tuple(mode) for mode in values["sigma"].round().astype(int).tolist()]
            motion = time_grid.as_motion(problem, chosen, values["s"] * INPUT_SCALE)
            return Answer(words, motion, bound)

        return solve


def evaluated(
    function: ca.Function, given: Sequence[Sequence[Any]], model: Model
) -> list[list[Any]]:
    """Outputs of a CasADi function of scalars, computed in a model.

    Args:
        function: Expanded, with dense inputs and outputs.
        given: Elements of its inputs: variables of the model, or numbers.
        model: Gets a variable for each nonlinear operation.
    """
    work: dict[int, Any] = {}
    outputs = [[0.0] * function.numel_out(i) for i in range(function.n_out())]
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if kind == ca.OP_CONST:
            work[target[0]] = function.instruction_constant(k)
        elif kind == ca.OP_INPUT:
            work[target[0]] = given[source[0]][source[1]]
        elif kind == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[source[0]]
        else:
            work[target[0]] = _operated(kind, [work[i] for i in source], model)
    return outputs


def _operated(kind: int, operands: list[Any], model: Model) -> Any:
    """Result of one operation: a number, an expression, or a variable that equals it."""
    numbers = [isinstance(operand, float) for operand in operands]
    if all(numbers):
        plain = {kind: getattr(math, name) for kind, name in _FUNCTIONS.items()}
        return (_LINEAR | _NONLINEAR | plain)[kind](*operands)
    if kind in _LINEAR:
        return _LINEAR[kind](*operands)
    if kind == ca.OP_DIV and numbers[1]:
        return operands[0] * (1 / operands[1])
    result = (_NONLINEAR | model.functions)[kind](*operands)
    if kind == ca.OP_MUL and any(numbers):
        return result
    variable = model.variable(-math.inf, math.inf)
    model.require(variable == result)
    return variable


def _bound(model: Model, row: Any, least: float, most: float) -> None:
    """Require a row to be within its bounds; one of numbers only says nothing of a solution."""
    if isinstance(row, float):
        return
    if least == most:
        model.require(row == least)
        return
    if least > -math.inf:
        model.require(row >= least)
    if most < math.inf:
        model.require(row <= most)


def _within_reach(problem: Problem, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    low, high = time_grid.state_bounds(problem, nodes)
    pose = problem.start.configuration[:POSE]
    low[:, :POSE] = np.maximum(low[:, :POSE], pose - _AWAY)
    high[:, :POSE] = np.minimum(high[:, :POSE], pose + _AWAY)
    return low, high
