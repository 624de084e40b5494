"""Chunk of a worker's work: plans of a few problems, each as a row."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from twosra_mpc.analysis.critical_path import critical_path
from twosra_mpc.errors import InputError
from twosra_mpc.files import reading
from twosra_mpc.installation import __version__
from twosra_mpc.lab.batch.problems import Document, Posed
from twosra_mpc.lab.batch.spec import Planner
from twosra_mpc.lab.batch.table import GREEDY_COLUMNS
from twosra_mpc.planning.planner import plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import mode_name

Row = dict[str, Any]


class Asked(NamedTuple):
    """Request for every problem, and the version of the package that makes it."""

    planner: Planner
    plans: bool
    version: str = __version__


class Chunk(NamedTuple):
    """Results of a few problems.

    Attributes:
        rows: A row each.
        plans: Name -> content of plan files.
        wall_s: How long all of it took.
    """

    rows: list[Row]
    plans: dict[str, str]
    wall_s: float


def plan_chunk(posed: Sequence[Posed], asked: Asked) -> Chunk:
    """Plan problems one after the other; whatever is wrong with one is said in its row.

    Raises:
        InputError: If this is another version of the package than the one that asks.
    """
    if asked.version != __version__:
        raise InputError("version of a worker", __version__, asked.version)
    started, rows, plans = time.perf_counter(), list[Row](), dict[str, str]()
    for one in posed:
        rows.append({"problem": one.number, **one.varied})
        for planner, prefix in _planners(asked.planner):
            told, result = _outcome(one.document, planner)
            rows[-1] |= _named(told, prefix)
            if asked.plans and result is not None:
                name = f"{one.number:08}{'-greedy' if prefix else ''}.json"
                plans[name] = json.dumps(result.to_dict(), allow_nan=False) + "\n"
    return Chunk(rows, plans, time.perf_counter() - started)


def failed(posed: Posed, asked: Asked, message: str) -> Chunk:
    """Row of a problem that could not be planned at all."""
    told = {"status": "failed", "message": message, "sequence": "", "verified": False}
    row = {"problem": posed.number, **posed.varied}
    for _, prefix in _planners(asked.planner):
        row |= _named(told, prefix)
    return Chunk([row], {}, 0.0)


def _planners(asked: Planner) -> Iterator[tuple[str, str]]:
    """Planners as scenarios call them, with what is put before the names of their columns."""
    yield ("greedy" if asked == "greedy" else "optimal"), ""
    if asked == "both":
        yield "greedy", "greedy_"


def _named(told: Row, prefix: str) -> Row:
    if not prefix:
        return told
    return {f"{prefix}{k}": v for k, v in told.items() if f"{prefix}{k}" in GREEDY_COLUMNS}


def _outcome(document: Document, planner: str) -> tuple[Row, Result | None]:
    """Plan, and measure this thread's time; a bug in one problem is no reason to lose others."""
    wall, cpu, result = time.perf_counter(), time.thread_time(), None
    told: Row = {"sequence": "", "verified": False}
    try:
        with reading("", "scenario"):
            problem = Problem(**{**document, "planner": planner})
        result = plan(problem)
        told |= {"status": str(result.status), "message": result.message} | _numbers(result)
    except InputError as error:
        told |= {"status": "refused", "message": str(error)}
    except Exception as error:
        told |= {"status": "failed", "message": f"a bug: {type(error).__name__}: {error}"}
    spent = {"wall_s": time.perf_counter() - wall, "cpu_s": time.thread_time() - cpu}
    return told | spent, result


def _numbers(result: Result) -> Row:
    """Numbers of the plan, if there is one, and of the bound."""
    bound = {"lower_bound": result.lower_bound}
    if (made := result.plan) is None:
        return bound
    path = [activity.kind for activity in critical_path(made)]
    return bound | {
        "sequence": " ".join(map(mode_name, made.sequence)),
        "cost": made.cost.total,
        "gap": made.gap,
        "fastest_cost": made.fastest_cost,
        "search_gap": made.search_gap,
        "duration_s": made.duration_s,
        "waiting_s": made.duration_s - made.moving_s,
        "moving_s": made.moving_s,
        "energy_J": made.cost.energy_J,
        "critical_melts": path.count("melt"),
        "critical_freezes": path.count("freeze"),
        "verified": made.verification.ok,
    }
