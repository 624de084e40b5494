"""Plans made without the planner, and whether one of them costs less than what is proved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

from pydantic import Field, TypeAdapter

from benchmarks.attack.attacks import attack
from benchmarks.attack.trial import claims, planned
from benchmarks.study import Count, Measured, Study
from twosra_mpc.robot.modes import sequence_name
from twosra_mpc.validation import NonNegative, Positive


class Case(NamedTuple):
    """An attack, by its number."""

    seed: int


@dataclass(frozen=True)
class AttackRecord:
    """What was claimed of an attack.

    Attributes:
        features: What is special about it.
        sequence: Its modes.
        cost: What it costs [s].
        slack: (cost - largest claim) / cost; None if a claim does not hold.
        broken: Claims that do not hold, in words.
        raised: An error of the planner; empty without.
        status: What the planner came to; empty where it was not run.
    """

    features: tuple[str, ...]
    sequence: str
    cost: float
    slack: float | None
    broken: tuple[str, ...]
    raised: str = ""
    status: str = ""


class AttackStudy(Study):
    """Random plans against the bounds of all nodes above them, and against whole searches.

    Attributes:
        count: Attacks.
        times: What transition times they have: thermal, constant or paper; any, unless told.
        also: Keys of all their problems, such as heaters_at_once.
        first: Number of the first one; ``count=1`` with the number of another repeats it.
        tighter_every: The bound with the pose is taken of every so many; it takes longest.
        plan_every: The planner is run on every so many.
        time_limit_s: Its limit, in thousands of units of work: about seconds.
    """

    record: ClassVar = TypeAdapter(AttackRecord)
    question: ClassVar = "Does a plan made without the planner cost less than what is proved?"

    count: Count = 60
    times: Literal["thermal", "constant", "paper"] | None = None
    also: dict[str, Any] = Field(default_factory=dict)
    first: NonNegative = 0
    tighter_every: Count = 4
    plan_every: Count = 20
    time_limit_s: Positive = 2.0

    def cases(self) -> Iterator[Case]:
        """Yield the attacks."""
        first = int(self.first)
        yield from map(Case, range(first, first + self.count))

    def run(self, case: Case) -> AttackRecord:
        """Compare one attack with all that is claimed."""
        made = attack(case.seed, self.times, **self.also)
        alone = self.count == 1
        told, status = (made.features, sequence_name(made.sequence), made.cost), ""
        try:
            found = list(claims(made, tighter=alone or case.seed % self.tighter_every == 0))
            if alone or case.seed % self.plan_every == 0:
                status, claim = planned(made, 1e3 * self.time_limit_s)
                found.append(claim)
        except Exception as error:  # whatever the planner raises is a finding
            return AttackRecord(*told, None, (), f"{type(error).__name__}: {error}")
        broken = tuple(
            f"{claim.of}: {claim.bound:z.6f} s" for claim in found if not made.bears(claim.bound)
        )
        slack = None if broken else made.slack(max(claim.bound for claim in found))
        return AttackRecord(*told, slack, broken, status=status)

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Records by every feature they have."""
        kinds: dict[str, list[AttackRecord]] = {"all": [made for _, made in results]}
        for _, made in results:
            for feature in made.features:
                kinds.setdefault(feature, []).append(made)
        return {"kinds": kinds}
