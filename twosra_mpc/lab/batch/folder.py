"""Results of a batch: a chunk of a worker's work, and the folder of all of them.

The folder has what made the batch, the pieces that are finished, and in the end one table.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import InputError, Problem, Result, plan
from twosra_mpc.files import differences, json_document, read_text, reading, write_json, write_text
from twosra_mpc.installation import __version__
from twosra_mpc.lab.analysis.critical_path import critical_path
from twosra_mpc.lab.batch.problems import Document, Posed, Problems
from twosra_mpc.lab.batch.spec import Planner
from twosra_mpc.lab.batch.table import (
    GREEDY_COLUMNS,
    PARTS,
    RUNS,
    frame_of,
    problems_in,
    read_runs,
    table_paths,
    write_table,
)
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


FORMAT = 1  # of the folder: another one is not gone on with
_ABOUT, _SPEC, _PLANS = "batch.json", "spec.toml", "plans"


class Folder:
    """The runs of a batch on disk. Every file is written as a whole or not at all.

    Attributes:
        path: The folder.
    """

    def __init__(self, path: Path, problems: Problems, spec: str) -> None:
        """Open the folder of this batch, or begin it with a copy of the spec's text.

        Raises:
            InputError: If it holds something else, or was made from another spec, other files or by
                another version of the package (naming everything that differs).
        """
        self.path, self._problems = path, problems
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._check()
            (path / PARTS).mkdir(exist_ok=True)
            if problems.spec.plans:
                (path / _PLANS).mkdir(exist_ok=True)
        except OSError as error:
            raise InputError("--out", str(path), f"a folder to write to ({error})") from error
        write_text(path / _SPEC, spec)

    def done(self) -> NDArray[np.bool_]:
        """True where a problem is finished, (n,): read from the disk, whatever was interrupted."""
        done = np.zeros(len(self._problems), dtype=bool)
        for part in table_paths(self.path):
            done[problems_in(part)] = True
        return done

    def add(self, chunk: Chunk) -> None:
        """Write what problems came to; their plans first, so that no row is without its plan.

        Raises:
            InputError: If it cannot be written, e.g. on a full disk.
        """
        for name, text in chunk.plans.items():
            write_text(self.path / _PLANS / name, text)
        greedy = self._problems.spec.planner == "both"
        frame = frame_of(chunk.rows, self._problems.kinds, greedy=greedy)
        write_table(frame, self.path / PARTS / f"{chunk.rows[0]['problem']:08}.parquet")

    def finish(self) -> None:
        """Join the pieces of a table that has all problems.

        Raises:
            InputError: If it cannot be written, or somebody else took pieces away.
        """
        if not os.path.isfile(self.path / RUNS):
            whole = read_runs(self.path)
            if len(whole) < len(self._problems):
                allowed = f"all {len(self._problems)} problems: does another batch run here?"
                raise InputError("--out", f"{len(whole)} problems", allowed, str(self.path))
            write_table(whole, self.path / RUNS)
        shutil.rmtree(self.path / PARTS, ignore_errors=True)

    def _check(self) -> None:
        """Compare what made the runs in the folder, or say so in a new one."""
        problems, path = self._problems, self.path / _ABOUT
        spec = problems.spec.model_dump(mode="json", by_alias=True, exclude_none=True)
        about = {"format": FORMAT, "package": __version__, **spec, "files": problems.files}
        now: dict[str, Any] = json.loads(json.dumps(about, default=str))
        if not os.path.isfile(path):
            if any(not one.name.startswith(".") for one in self.path.iterdir()):
                raise InputError("--out", str(self.path), "a new folder, or one of this batch")
            write_json(path, now)
            return
        before = json_document(read_text(path, str(path)), str(path))
        found = [
            InputError(name, new, f"{old!r}, as the runs in {self.path} were begun; or a new --out")
            for name, old, new in differences(before, now)
        ]
        if found:
            raise found[0].among(found[1:])
