"""Files that a page saves: scenario, Python program, plan, set-points or report of a problem."""

from __future__ import annotations

import json
from typing import Any, Literal

from twosra_mpc.lab.report.page import report_page, scenario_toml
from twosra_mpc.planning.planner import plan
from twosra_mpc.plans.setpoints import setpoints_csv
from twosra_mpc.problem.problem import Problem
from twosra_mpc.validation import Value


class Saved(Value):
    """Request to save a problem, a scenario document, in one of the forms."""

    problem: dict[str, Any]
    form: Literal["toml", "json", "html", "csv", "py"]


def saved(asked: Saved) -> dict[str, Any]:
    """Make a file: its name and its text.

    Raises:
        InputError: If the problem is none.
        NoPlanError: If the set-points of a plan are asked for, and there is none.
    """
    problem = Problem(**asked.problem)
    match asked.form:
        case "toml":
            text = scenario_toml(problem)
        case "py":
            text = _python(asked.problem)
        case "json":
            text = json.dumps(plan(problem).to_dict(), allow_nan=False)
        case "html":
            text = report_page(plan(problem))
        case "csv":
            text = setpoints_csv(plan(problem).require())
    name = {"toml": "scenario", "json": "plan", "html": "report", "csv": "setpoints", "py": "plan"}
    return {"kind": "file", "name": f"{name[asked.form]}.{asked.form}", "text": text}


def _python(document: dict[str, Any]) -> str:
    """A program that plans the problem."""
    given = {key: value for key, value in document.items() if value not in (None, [], "")}
    lines = [f"    {key}={value!r}," for key, value in given.items()]
    before = ["from twosra_mpc import Problem, plan", "", "problem = Problem("]
    after = [")", "result = plan(problem)", "print(result)", 'result.save("plan.json")', ""]
    return "\n".join([*before, *lines, *after])
