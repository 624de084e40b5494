"""SCIP as a solver of programs that CasADi writes, called as CasADi's own are.

Every product, quotient and function becomes a variable with an equation of its own, so SCIP sees
the whole program and proves a bound of it. It needs the package pyscipopt.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import casadi as ca
import numpy as np

_MOST = 1e3  # of variables without a limit, in scaled units
_LINEAR: Mapping[int, Callable[..., Any]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_TWICE: lambda a: 2.0 * a,
}
_OTHERS: Mapping[int, Callable[..., Any]] = {
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_INV: lambda a: 1.0 / a,
    ca.OP_FABS: abs,
}


class Scip:
    """A program as of ``casadi.nlpsol``; ``options`` are SCIP's, and which columns are whole."""

    def __init__(self, nlp: Mapping[str, ca.MX], options: Mapping[str, Any]) -> None:
        self._options = {key: value for key, value in options.items() if "/" in key}
        self._whole, self._words = options["discrete"], ""
        given, made = [nlp["x"], nlp["p"]], [ca.vertcat(nlp["f"], nlp["g"])]
        self._program = ca.Function("program", given, made).expand()
        self._scip = import_module("pyscipopt")

    def __call__(
        self, *, x0: Any, p: Any, lbx: Any, ubx: Any, lbg: Any, ubg: Any
    ) -> dict[str, ca.DM]:
        """Solve; f is infinite without an incumbent. SCIP needs no guess."""
        del x0
        model = self._scip.Model()
        model.hideOutput()
        model.setParams(self._options)
        ends = np.clip([lbx, ubx], -_MOST, _MOST).T.tolist()
        columns = zip(ends, self._whole, strict=True)
        x = [model.addVar(lb=a, ub=b, vtype="CB"[whole]) for (a, b), whole in columns]

        def named(value: Any) -> Any:
            if isinstance(value, float):
                return value
            variable = model.addVar(lb=None)
            model.addCons(variable == value)
            return variable

        functions = {
            ca.OP_SIN: self._scip.sin,
            ca.OP_COS: self._scip.cos,
            ca.OP_SQRT: self._scip.sqrt,
            ca.OP_FMIN: lambda a, b: (a + b - named(abs(a - b))) / 2,
            ca.OP_FMAX: lambda a, b: (a + b + named(abs(a - b))) / 2,
        }
        cost, *rows = evaluated(self._program, [x, list(p)], named, functions)
        for row, low, high in zip(rows, lbg.tolist(), ubg.tolist(), strict=True):
            for sign, most in ((1, high), (-1, -low)):
                if np.isfinite(most) and not isinstance(row, float):
                    model.addCons(sign * row <= most)
        total = model.addVar(lb=None)
        model.addCons(total >= cost)
        model.setObjective(total)
        model.optimize()
        self._words = f"{model.getStatus()}, proved {100 * model.getDualbound():.1f} s"
        if not model.getNSols():
            return {"f": ca.DM(np.inf), "x": ca.DM([0.0] * len(x))}
        found = [model.getVal(each) for each in x]
        return {"f": ca.DM(model.getObjVal()), "x": ca.DM(found)}

    def stats(self) -> dict[str, str]:
        """How it ended."""
        return {"return_status": self._words}


def evaluated(
    program: ca.Function,
    given: Sequence[Sequence[Any]],
    named: Callable[[Any], Any],
    functions: Mapping[int, Callable[..., Any]],
) -> list[Any]:
    """The one result of an expanded function, in the arithmetic of what is given.

    Sums and multiples are left as they are; every other expression is ``named``.
    """
    known, work = {**_LINEAR, **_OTHERS, **functions}, dict[int, Any]()
    results = [0.0] * program.numel_out(0)
    for k in range(program.n_instructions()):
        operation, out = program.instruction_id(k), program.instruction_output(k)
        inputs = program.instruction_input(k)
        if operation == ca.OP_CONST:
            work[out[0]] = float(program.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            work[out[0]] = given[inputs[0]][inputs[1]]
        elif operation == ca.OP_OUTPUT:
            results[out[1]] = work[inputs[0]]
        else:
            values = [work[i] for i in inputs]
            numbers = [isinstance(value, float) for value in values]
            linear = operation in _LINEAR or (operation == ca.OP_MUL and any(numbers))
            linear |= operation == ca.OP_DIV and numbers[-1]
            made = known[operation](*values)
            work[out[0]] = made if linear or all(numbers) else named(made)
    return results
