"""The file of a run on real hardware: written so that an ending of any kind leaves one."""

from __future__ import annotations

import time
from pathlib import Path

from twosra_mpc.execution.run import Ending, Executed, Run, RunRecord, Verdict
from twosra_mpc.files import write_json
from twosra_mpc.plans.plan import Plan

SAVED_EVERY_S = 10.0  # of a run under way, whenever it stands: a power cut costs no more
_SHARE = 0.02  # of the time, at most, is spent on that


class RunFile:
    """The file of a run under way: whole at any time, and never older than a few seconds.

    It is replaced when the robot stands and the last one is `SAVED_EVERY_S` old, and at the end.
    """

    def __init__(self, path: Path, plan: Plan, executed: Executed) -> None:
        """Nothing is written yet.

        Args:
            path: The file.
            plan: What is carried out.
            executed: By what.
        """
        self.path, self._plan, self._executed = path, plan, executed
        self._record: RunRecord | None = None
        self._due_s = time.monotonic() + SAVED_EVERY_S

    def note(self, record: RunRecord) -> None:
        """Look at a run after each of its commands."""
        self._record = record
        if record.controller.belief.stands and (begun_s := time.monotonic()) >= self._due_s:
            self.end("the run was still under way")
            took_s = time.monotonic() - begun_s
            self._due_s = begun_s + max(SAVED_EVERY_S, took_s / _SHARE)

    def end(self, reason: str) -> None:
        """Write down a run that ended so, if it has begun."""
        if self._record is not None:
            verdict = Verdict(self._executed, Ending.LOGGED, reason, (self._plan,))
            self.save(self._record.run(verdict))

    def save(self, run: Run) -> None:
        """Write a run that has come to its own end."""
        write_json(self.path, run.to_dict())
