"""Record of a run under way: a row before each command, and the run that it adds up to."""

from __future__ import annotations

import numpy as np

from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.execution.controller import Controller
from twosra_mpc.execution.run import CHANGING, Run, RunLog, Verdict

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
