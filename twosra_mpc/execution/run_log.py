"""Records of runs under way, and runs read back from files."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.errors import InputError
from twosra_mpc.execution.controller import Controller
from twosra_mpc.execution.run import (
    CHANGING,
    FORMAT,
    FORMAT_VERSION,
    Change,
    Drive,
    Ending,
    Run,
    RunEvent,
    RunLog,
    Verdict,
)
from twosra_mpc.files import check_kind, read_document, reading
from twosra_mpc.plans.document import plan_within
from twosra_mpc.problem.problem import embedded_problem
from twosra_mpc.robot.coordinates import Array

_CODES: dict[KnownStiffness | None, float] = {
    **{"rigid": 0.0, "changing": CHANGING, "soft": 1.0},
    None: np.nan,
}


class RunRecord:
    """Record of everything measured, believed and commanded.

    Attributes:
        controller: What drives the robot.
    """

    def __init__(self, controller: Controller) -> None:
        """Nothing has happened yet."""
        self.controller = controller
        self._rows: list[tuple[object, ...]] = []  # in the order of the log's columns
        coordinates = controller.belief.problem.robot.coordinates
        self._unknown = np.full(coordinates.size, np.nan)
        self._no_mode = (np.nan,) * coordinates.segments

    def note(self) -> None:
        """Note what was read, and the command given on it."""
        belief = self.controller.belief
        reading, command = belief.reading, belief.command
        seen = reading.frames.mean(axis=0) if len(reading.frames) else self._unknown
        stiffness = tuple(_CODES[now] for now in reading.stiffness)
        planned = command.planned if command.planned.size else self._unknown
        mode = self._no_mode if command.mode is None else command.mode
        known = (reading.time_s, belief.q, seen, planned, reading.temperature_C, stiffness)
        self._rows.append((*known, command.heater_setpoint_C, command.wheel_rad_s, mode))

    def run(self, verdict: Verdict) -> Run:
        """The run as it is written down up to now, with this verdict."""
        belief = self.controller.belief
        kinds = [event.kind for event in belief.events]
        columns = (np.array(column, dtype=float) for column in zip(*self._rows, strict=True))
        return Run(
            problem=belief.problem,
            **verdict._asdict(),
            error=belief.error,
            replans=kinds.count("replan"),
            corrections=kinds.count("correct"),
            changes=tuple(belief.changes),
            drives=tuple(belief.drives),
            events=tuple(belief.events),
            log=RunLog(*columns),
        )


@public
def load_run(path: str | Path) -> Run:
    """Read a run back that was saved from ``Run.to_dict``.

    Raises:
        InputError: If the file is no run of this version, or does not fit together.
    """
    source = str(path)
    document = read_document(Path(path), source)
    check_kind(document, "run", source)
    found = document.get("format"), document.get("version")
    if found != (FORMAT, FORMAT_VERSION):
        raise InputError("format", found, f"{FORMAT!r} version {FORMAT_VERSION}", source)
    with reading(source, "run"):
        return _run(document, source)


def _run(data: dict[str, Any], source: str) -> Run:
    return Run(
        problem=embedded_problem(data["robot"], data["scenario"], source),
        executor=data["executor"],
        plans=tuple(plan_within(each, data["robot"], source) for each in data["plans"]),
        ending=Ending(data["ending"]),
        reason=data["reason"],
        error=np.array(data["error"], dtype=float),
        replans=data["replans"],
        corrections=data["corrections"],
        begun=tuple(data["begun"]),
        changes=tuple(Change(**each) for each in data["changes"]),
        drives=tuple(Drive(**{**each, "mode": tuple(each["mode"])}) for each in data["drives"]),
        events=tuple(RunEvent(**each) for each in data["events"]),
        log=_log(data["log"]),
        done_s=tuple(data.get("done_s", ())),  # younger than version 1
        lost=data.get("lost", 0),
    )


def _log(columns: dict[str, Any]) -> RunLog:
    arrays: dict[str, Array] = {
        item.name: np.array(columns[item.name], dtype=float)  # None becomes NaN
        for item in fields(RunLog)
        if item.name != "mode" or "mode" in columns
    }
    arrays.setdefault("mode", np.full_like(arrays["stiffness"], np.nan))  # younger than version 1
    if len({len(column) for column in arrays.values()}) != 1:
        raise ValueError("the columns of the log differ in length")
    return RunLog(**arrays)
