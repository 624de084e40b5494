"""The same problems for robots that melt and freeze ever faster."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks import figures
from benchmarks.measurement import PlanRecord
from benchmarks.study import Measured, Numbers, PlanStudy
from benchmarks.thermal_scale import thermally_faster
from twosra_mpc.validation import Positive


class Case(NamedTuple):
    """A problem at a freezing time."""

    problem: str
    freeze_s: float


class TransitionSweep(PlanStudy):
    """Every problem for every transition time.

    Attributes:
        freeze_s: Freezing times of a segment, from its set-point, to sweep through.
        reference_freeze_s: Freezing time of the robot as it is; the melting time keeps its ratio.
    """

    record: ClassVar = TypeAdapter(PlanRecord)
    question: ClassVar = "How do best sequence, proof and wall time change as metal gets faster?"

    freeze_s: Numbers
    reference_freeze_s: Positive

    def cases(self) -> Iterator[Case]:
        """Yield every problem at each transition time; compiled functions are per robot."""
        for freeze_s, label in itertools.product(self.freeze_s, self.named):
            yield Case(label, freeze_s)

    def run(self, case: Case) -> PlanRecord:
        """Plan for a robot that freezes as fast."""
        problem = self.named[case.problem]
        robot = thermally_faster(problem.robot, self.reference_freeze_s / case.freeze_s)
        return self.planned(problem.with_values(robot=robot))

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Best sequences, costs, proved gaps and wall times over the transition time."""
        sweep: dict[str, dict[float, PlanRecord]] = {}
        for case, made in results:
            sweep.setdefault(case.problem, {})[case.freeze_s] = made
        times, as_it_is = sorted(set(self.freeze_s)), self.reference_freeze_s
        columns = {freeze: [plans[freeze] for plans in sweep.values()] for freeze in times}
        slow, fast = (
            min(times, key=lambda freeze: abs(np.log(faster * freeze / as_it_is)))
            for faster in (1, 10)
        )
        changes = {
            label: sum(a.sequence != b.sequence for a, b in itertools.pairwise(plans.values()))
            for label, plans in sweep.items()
        }
        return {
            **{"sweep": sweep, "columns": columns, "slow": slow, "fast": fast, "changes": changes},
            "different": sum(p[slow].sequence != p[fast].sequence for p in sweep.values()),
            "figures": {
                "sequences.png": partial(figures.draw_sequences, sweep, times, as_it_is),
                "proofs.png": partial(figures.draw_proofs, columns, self.time_limit_s),
            },
            "every": {f"{case.problem} at {case.freeze_s:zg} s": made for case, made in results},
        }
