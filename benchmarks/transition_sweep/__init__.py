"""The same problems for robots that melt and freeze ever faster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from pydantic import model_validator

from benchmarks.measurement import timed_in_turns
from benchmarks.plan_record import PlanRecord, plan_record
from benchmarks.suite import Choices, Names, Numbers, Record, Run, Suite, chosen
from benchmarks.transition_sweep.figures import draw_proofs, draw_sequences, draw_total_times
from benchmarks.transition_sweep.tables import (
    PROOFS,
    SEQUENCES,
    TOTAL_TIME,
    Sweep,
    report_lines,
)
from benchmarks.transition_sweep.thermal_scale import thermally_faster
from twosra_mpc import InputError, Problem, plan
from twosra_mpc.validation import Positive


class TransitionSweep(Suite):
    """Every problem for every transition time.

    Attributes:
        problems: The problems.
        freeze_s: Freezing times of a segment, from its set-point, to sweep through.
        reference_freeze_s: Freezing time of the robot as it is; the melting time keeps its ratio.
        panels: Problems that get a panel in the figure of total times.
        time_limit_s: Time limit of a plan.
    """

    problems: Choices
    freeze_s: Numbers
    reference_freeze_s: Positive
    panels: Names = ()
    time_limit_s: Positive = 20.0

    @model_validator(mode="after")
    def _panels_are_problems(self) -> TransitionSweep:
        labels = [label for label, _ in chosen(self.problems)]
        for name in self.panels:
            if name not in labels:
                raise InputError("panels", name, f"one of {', '.join(labels)}")
        return self

    def runs(self) -> Iterator[Run]:
        """Yield one run per transition time and problem; compiled functions are per robot."""
        problems = chosen(self.problems)
        for freeze_s in self.freeze_s:
            for label, problem in problems:
                measure = partial(self._measure, label, problem, freeze_s)
                yield Run(f"{label}, freeze {freeze_s:g} s", measure)

    def report(self, records: Sequence[Record], folder: Path) -> list[str]:
        """Best sequences, total times, proved gaps and wall times over the transition time."""
        sweep: Sweep = {}
        for record in records:
            one = PlanRecord.from_record(record["plan"])
            sweep.setdefault(one.problem, {})[record["freeze_s"]] = one
        draw_sequences(sweep, self.reference_freeze_s, folder / SEQUENCES)
        draw_total_times(sweep, self.panels or tuple(sweep)[:6], folder / TOTAL_TIME)
        draw_proofs(sweep, self.time_limit_s, folder / PROOFS)
        return report_lines(sweep, self.reference_freeze_s, self.time_limit_s)

    def _measure(self, label: str, problem: Problem, freeze_s: float) -> Record:
        robot = thermally_faster(problem.robot, self.reference_freeze_s / freeze_s)
        faster = problem.with_robot(robot).model_copy(update={"time_limit_s": self.time_limit_s})
        made = timed_in_turns({"plan": partial(plan, faster)}, self.repeats, self.repeat_budget_s)[
            "plan"
        ]
        return {"freeze_s": freeze_s, "plan": plan_record(label, *made).to_record()}
