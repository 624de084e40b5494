"""Segments whose thermistors lie, and as many that do not: how hot metal gets, what stops a run.

The segments share nothing with the simulator, and lies matter from some time on: see
`benchmarks.lying`.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import BeforeValidator

from benchmarks.lying import LIES, watched
from benchmarks.study import RUNNING, Count, Measured, Study
from twosra_mpc import load_robot
from twosra_mpc.validation import Positive, plain

Kinds = Annotated[tuple[Literal[LIES], ...], BeforeValidator(plain)]  # type: ignore[valid-type]


class Case(NamedTuple):
    """One run; no lie: ""."""

    lie: str
    seed: int


class Lying(Study):
    """Runs with each lie, and without any.

    Attributes:
        robot: Whose segments are drawn.
        lies: Which lies.
        count: Runs of each.
        sound: Runs without any.
        lasts_s: Longest run.
    """

    question: ClassVar = "How hot does metal get under a sensor that lies?"
    measures: ClassVar = RUNNING

    robot: str = "2sra-v1"
    lies: Kinds = LIES
    count: Count = 1
    sound: Count = 13
    lasts_s: Positive = 1500.0

    def cases(self) -> Iterator[Case]:
        """Yield the runs."""
        yield from itertools.starmap(Case, itertools.product(self.lies, range(self.count)))
        yield from (Case("", seed) for seed in range(self.sound))

    def run(self, case: Case) -> dict[str, Any]:
        """Run one case; a time that there is none of is left out."""
        found = asdict(watched(load_robot(self.robot), case.seed, case.lie, self.lasts_s))
        return {key: each for key, each in found.items() if each == each}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Sum up by lie."""
        rows = []
        for lie in (*self.lies, ""):
            made = [record for case, record in results if case.lie == lie]
            if not made:
                continue
            hottest = [record["hottest_C"] for record in made]
            mattered = [r["mattered_s"] for r in made if "mattered_s" in r]
            rows.append(
                (
                    lie or "none",
                    len(made),
                    max(hottest),
                    sum(each > _HOTTEST_C for each in hottest),
                    max(mattered, default=math.nan),
                    sum(each > _LONGEST_S for each in mattered),
                    Counter(record["cause"] or "time is up" for record in made),
                )
            )
        return {"rows": rows}


_HOTTEST_C, _LONGEST_S = 85.0, 60.0  # of the metal; from when a lie matters to the end
