"""Results of planning: a plan or none, what was proved, why the search ended; and their files.

Files of earlier versions of this package are read as well, and converted here alone.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, NoReturn

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from twosra_mpc.arguments import public
from twosra_mpc.effort import Ending
from twosra_mpc.errors import InputError, NoPlanError
from twosra_mpc.files import LARGEST, check_kind, json_document, reading, toml_document, write_json
from twosra_mpc.installation import __version__
from twosra_mpc.plans.branches import Policy
from twosra_mpc.plans.carried import CarriedObject, TaskDone
from twosra_mpc.plans.plan import Cost, Plan, Status, Verification
from twosra_mpc.plans.trajectory import Phase, Samples, Trajectory, entered_s
from twosra_mpc.problem.problem import FORMAT, Problem, embedded_problem
from twosra_mpc.problem.tasks import passes
from twosra_mpc.problem.tolerances import UNPROVED
from twosra_mpc.timing import Transition
from twosra_mpc.validation import ArrayValue, named_problem

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
        words: What was found, in words; empty where the plan says it itself.
        lower_bound: Proved lower bound on the cost of any plan [s]; None if there is none.
        ending: Why the search ended; None without a search, or where a file does not say.
        stats: Effort spent.
        plan: The best plan; None if there is none. Failed planning by the greedy rule may have one
            that does not verify, to be looked at.
        certificate: What ``checking.certificate`` proves a bound with, as plain data; None without.
        policy: What is done where joint bends miss, if the problem's ``risk`` asks for it.
    """

    problem: Problem
    planner: str
    status: Status
    words: str
    lower_bound: float | None
    ending: Ending | None
    stats: Stats
    plan: Plan | None
    certificate: dict[str, Any] | None = None
    policy: Policy | None = None

    @property
    def message(self) -> str:
        """One sentence a person can act on."""
        return self.words or str(self.plan or "")

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

    def proved_by(self, certificate: dict[str, Any]) -> Result:
        """Return the result with a certificate; its lower bound is no more than that proves."""
        lower = self.lower_bound or 0.0
        if (proved := certificate["bound_s"]) < (1 - UNPROVED) * lower:
            lower = proved
        plan = self.plan and replace(self.plan, lower_bound=lower)
        made = replace(self, plan=plan, lower_bound=lower, certificate=certificate)
        short = self.status is Status.OPTIMAL and (made.gap or 0.0) > self.problem.gap
        return replace(made, status=Status.FEASIBLE) if short else made

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
            **({} if self.policy is None else {"policy": self.policy.to_dict()}),
        }

    def save(self, path: str | Path) -> None:
        """Write the result as JSON, atomically.

        Raises:
            InputError: If it does not end in .json, or cannot be written.
        """
        write_json(path, self.to_dict())


class PhaseDocument(NamedTuple):
    """A phase in a plan file; times in s."""

    mode: tuple[Literal[0, 1], ...]
    start_s: float
    end_s: float


_Read = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
_NumberOrNull = Annotated[float | None, AfterValidator(lambda x: math.nan if x is None else x)]


class _VerificationDocument(BaseModel):
    """The types of a plan file's verification; a number that is not finite is written as null."""

    model_config = _Read

    max_defect: _NumberOrNull
    goal_error: tuple[_NumberOrNull, ...]
    limits: dict[str, float]
    ok: bool
    problems: tuple[str, ...]


class PlanDocument(BaseModel):
    """The types of a plan file, for reading one back.

    In version 1 inputs hold from a sample to the next: there is no ``samples.a``.
    ``ending`` is younger than version 1. Where it is missing, ``stopped_early`` is taken to mean a
    limit (an interrupt was written the same way), and otherwise nothing is known of it.
    ``fastest_cost_s`` and ``search_gap`` are younger, too: without them nothing is known of how
    much slower a plan is on purpose; so are ``confirmed_duration_s`` and its bound.
    ``certificate`` is there where one was asked for; ``checking.certificate`` reads it.
    ``warnings`` stands in what ``--json`` prints: doubts about the input, which the plan is not
    about. With tasks or objects files are of version 3, which is version 2 with ``tasks`` and
    ``carried``; in version 2 plans only pass boxes. A robot without ``unit_frame_m`` is older than
    that key, see `embedded_problem`.
    """

    model_config = _Read

    format: Literal["twosra-plan"]
    version: Literal[1, 2, 3]
    package: str
    robot: dict[str, Any]
    scenario: dict[str, Any]
    planner: Literal["optimal", "greedy"]
    status: Status
    message: str
    duration_s: float | None
    lower_bound_s: float | None
    confirmed_duration_s: float | None = None
    confirmed_lower_bound_s: float | None = None
    gap: float | None
    fastest_cost_s: float | None = None
    search_gap: float | None = None
    cost: Cost | None
    phases: tuple[PhaseDocument, ...]
    transitions: tuple[Transition, ...]
    samples: dict[str, list[float] | list[list[float]]] | None
    verification: _VerificationDocument | None
    stats: Stats
    stopped_early: bool
    ending: Ending | None = None
    certificate: dict[str, Any] | None = None
    policy: Policy | None = None
    tasks: tuple[TaskDone, ...] = ()
    carried: tuple[CarriedObject, ...] = ()
    warnings: tuple[str, ...] = ()


def plan_in(text: str, source: str) -> Result:
    """Read back what is in a plan file; ``checking.plan_file.load_plan`` believes nothing of it.

    Args:
        text: Its text.
        source: The file.

    Raises:
        InputError: If it is not a plan of a known version, or does not fit together.
    """
    if Path(source).suffix == ".toml":
        check_kind(toml_document(text, source), "plan", source)
    head = json_document(text, source, "a plan in JSON")
    check_kind(head, "plan", source)
    if head.get("format") != FORMAT or head.get("version") not in (
        1,
        FORMAT_VERSION,
        MISSION_VERSION,
    ):
        found = (head.get("format"), head.get("version"))
        raise InputError("format", found, f"{FORMAT!r} version 1, 2 or {MISSION_VERSION}", source)
    with reading(source, "plan"):
        try:
            return _result(PlanDocument.model_validate_json(text), source)
        except ValidationError as error:
            first = named_problem(PlanDocument, error.errors()[0])
            raise first.within("plan", source) from None


def plan_within(document: dict[str, Any], robot: dict[str, Any], source: str) -> Plan:
    """Read back a plan that another file holds, as ``Plan.to_dict`` wrote it.

    Args:
        document: The plan.
        robot: Its robot, as the file has it.
        source: The file.

    Raises:
        InputError: If it is no plan, or does not fit together.
    """
    unsaid: dict[str, Any] = {"status": Status.FEASIBLE, "message": "", "stopped_early": False}
    head = {"format": FORMAT, "version": FORMAT_VERSION, "package": "", "robot": robot}
    stats = vars(Stats(0.0, 0, 0, 0)).copy()
    try:
        whole = json.dumps({**head, **unsaid, "stats": stats, **document})
        return _result(PlanDocument.model_validate_json(whole), source).require()
    except ValidationError as error:
        first = named_problem(PlanDocument, error.errors()[0])
        raise first.within("plans", source) from None


def _result(data: PlanDocument, source: str) -> Result:
    problem = embedded_problem(data.robot, data.scenario, source)
    early = Ending.LIMIT if data.stopped_early else None
    plan = None if data.samples is None else _plan(data, problem, data.samples)
    return Result(
        problem=problem,
        planner=data.planner,
        status=data.status,
        words="" if data.message == str(plan or "") else data.message,
        lower_bound=data.lower_bound_s,
        ending=data.ending or early,
        stats=data.stats,
        certificate=data.certificate,
        policy=data.policy,
        plan=plan,
    )


def _plan(data: PlanDocument, problem: Problem, samples: dict[str, Any]) -> Plan:
    if data.cost is None or data.verification is None:
        missing = "cost" if data.cost is None else "verification"
        raise InputError(f"plan.{missing}", None, "a table of keys, as there are samples")
    constant = {"a": [[0.0] * len(v) for v in samples["v"]]} if data.version == 1 else {}
    trajectory = Trajectory(
        problem=problem,
        samples=_samples({**samples, **constant}),
        phases=tuple(Phase(*phase) for phase in data.phases),
        transitions=data.transitions,
        done_s=(0.0,) * len(problem.tasks),
    )
    trajectory = replace(trajectory, done_s=tuple(_done_s(data, trajectory)))
    verification = Verification(**dict(data.verification))
    proved = data.lower_bound_s, data.fastest_cost_s, data.confirmed_lower_bound_s
    return Plan(data.planner, trajectory, data.cost, verification, *proved)


def _done_s(data: PlanDocument, trajectory: Trajectory) -> Iterator[float]:
    """Times of the tasks as a file has them; older ones do not say when boxes are passed."""
    tasks, since_s = trajectory.problem.tasks, 0.0
    if data.tasks or len(passes(tasks)) != len(tasks):
        yield from (item.done_s for item in data.tasks)
        return
    for box in passes(tasks).values():
        yield (since_s := entered_s(trajectory, box, since_s))


def _samples(samples: dict[str, Any]) -> Samples:
    if samples.keys() != (known := Samples.__dataclass_fields__).keys():
        raise InputError("plan.samples", [*samples], f"the lists {', '.join(known)}, and no other")
    arrays = {name: np.array(rows) for name, rows in samples.items()}
    for name, array in arrays.items():
        if not (np.abs(array) <= LARGEST).all():
            raise InputError(f"plan.samples.{name}", "beyond", f"at most {LARGEST:zg} in size")
    if not np.isin(arrays["mode"], (0, 1)).all():
        raise InputError("plan.samples.mode", arrays["mode"].tolist(), "zeros and ones")
    arrays["mode"] = arrays["mode"].astype(np.int64)
    if not (np.diff(arrays["t_s"]) > 0).all():
        raise InputError("plan.samples.t_s", "times that do not grow", "growing times")
    return Samples(**arrays)
