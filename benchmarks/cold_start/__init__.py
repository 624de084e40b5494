"""From the shell to a plan: against importing CasADi alone, and where the time goes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.cold_start.figures import draw_cold_start
from benchmarks.cold_start.processes import measured_round
from benchmarks.cold_start.tables import FIGURE, breakdown, report_lines
from benchmarks.suite import Record, Run, Suite


class ColdStart(Suite):
    """``repeats`` rounds of fresh processes, all commands in turns.

    Attributes:
        scenario: The built-in scenario to plan.
    """

    scenario: str = "paper-1"

    def runs(self) -> Iterator[Run]:
        """Yield one run per round."""
        for number in range(1, self.repeats + 1):
            yield Run(f"round {number}", lambda: measured_round(self.scenario))

    def report(self, records: Sequence[Record], folder: Path) -> list[str]:
        """Medians, their ratio, and the breakdown."""
        parts = breakdown(records)
        draw_cold_start(records, parts, self.scenario, folder / FIGURE)
        return report_lines(records, parts, self.scenario)
