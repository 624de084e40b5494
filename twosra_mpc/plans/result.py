"""Results of planning: a plan or none, what was proved, and why the search ended."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from twosra_mpc.arguments import public
from twosra_mpc.effort import Ending
from twosra_mpc.errors import NoPlanError
from twosra_mpc.files import write_json
from twosra_mpc.installation import __version__
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.problem.problem import FORMAT, Problem
from twosra_mpc.validation import ArrayValue

FORMAT_VERSION, MISSION_VERSION = 2, 3  # of single goals, and with tasks or objects

_NO_PLAN: dict[str, Any] = {
    **dict.fromkeys(("duration_s", "confirmed_duration_s", "confirmed_lower_bound_s")),
    **dict.fromkeys(("gap", "fastest_cost_s", "search_gap")),
    **dict.fromkeys(("cost", "samples", "verification")),
    **{"phases": [], "transitions": []},
}


@dataclass(frozen=True)
class Stats:
    """Effort spent on a plan.

    Attributes:
        wall_s: Time by the clock.
        sequences_bounded: Mode sequences whose bound was computed.
        sequences_solved: Those that were tried.
        nlp_iterations: Iterations of the nonlinear solver.
        work: Units of work, the same on every machine; None in older files.
        first_plan_work: Of it, until the first plan was found; None without one.
    """

    wall_s: float
    sequences_bounded: int
    sequences_solved: int
    nlp_iterations: int
    work: float | None = None
    first_plan_work: float | None = None


@public
@dataclass(frozen=True, eq=False)
class Result(ArrayValue):
    """The outcome of planning.

    Attributes:
        problem: The problem (robot included).
        planner: "optimal" or "greedy".
        status: What is known.
        message: One sentence a person can act on.
        lower_bound: Proved lower bound on the cost of any plan [s]; None if there is none.
        ending: Why the search ended; None without a search, or where a file does not say.
        stats: Effort spent.
        plan: The best plan; None if there is none. Failed planning by the greedy rule may have one
            that does not verify, to be looked at.
        certificate: What ``checking.certificate`` proves a bound with, as plain data; None without.
    """

    problem: Problem
    planner: str
    status: Status
    message: str
    lower_bound: float | None
    ending: Ending | None
    stats: Stats
    plan: Plan | None
    certificate: dict[str, Any] | None = None

    @property
    def found(self) -> bool:
        """True if there is a verified plan."""
        return self.plan is not None and self.status in (Status.OPTIMAL, Status.FEASIBLE)

    @property
    def gap(self) -> float | None:
        """Proved relative gap of the plan; None without a plan or a bound."""
        return None if self.plan is None else self.plan.gap

    @property
    def stopped_early(self) -> bool:
        """True if a limit or an interrupt ended the search before the asked gap."""
        return self.ending in (Ending.LIMIT, Ending.INTERRUPTED)

    def require(self) -> Plan:
        """Return the plan, which is verified.

        Raises:
            NoPlanError: If there is none; carries status and message.
        """
        if self.plan is None or not self.found:
            raise NoPlanError(self.status, self.message)
        return self.plan

    def __getattr__(self, name: str) -> NoReturn:
        """Say where to find what a plan has.

        Raises:
            AttributeError: Always; a result has no further attributes.
        """
        of_plan = name in {*dir(Plan), *Plan.__dataclass_fields__}
        hint = f"; result.require().{name} is the plan's" if of_plan else ""
        raise AttributeError(f"a Result has no {name}{hint}", name=name, obj=self)

    def __repr__(self) -> str:
        return f"<Result {self.status}: {self.message}>"

    def _repr_html_(self) -> str:
        """The message and the plan's figure, for notebooks."""
        from html import escape  # its tables take longer to load than to use

        words = f"<p>{self.status}: {escape(self.message)}</p>"
        return words + self.plan._repr_html_() if self.plan else words

    def to_dict(self) -> dict[str, Any]:
        """The result as plain data, in the published file format."""
        asked = self.problem.tasks or self.problem.objects
        tasks: dict[str, Any] = {"tasks": [], "carried": []} if asked else {}
        return {
            "format": FORMAT,
            "version": MISSION_VERSION if tasks else FORMAT_VERSION,
            "package": __version__,
            "robot": self.problem.robot.model_dump(mode="json"),
            "scenario": self.problem.scenario(),
            "planner": self.planner,
            "status": str(self.status),
            "message": self.message,
            **(self.plan.to_dict() if self.plan else _NO_PLAN | tasks),
            "lower_bound_s": self.lower_bound,
            "stats": vars(self.stats).copy(),
            "stopped_early": self.stopped_early,
            "ending": self.ending,
            **({} if self.certificate is None else {"certificate": self.certificate}),
        }

    def save(self, path: str | Path) -> None:
        """Write the result as JSON, atomically.

        Raises:
            InputError: If the folder does not exist or cannot be written.
        """
        write_json(path, self.to_dict())
