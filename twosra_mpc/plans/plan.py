"""The plan: what the planner returns, and the file other programs read."""

from __future__ import annotations

import enum
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from twosra_mpc.errors import InputError, NoPlanError
from twosra_mpc.files import read_text, write_text
from twosra_mpc.plans.trajectory import Phase, Samples, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import Robot
from twosra_mpc.timing import Transition
from twosra_mpc.validation import named_problem
from twosra_mpc.version import __version__

Array = NDArray[np.float64]

FORMAT, FORMAT_VERSION = "twosra-plan", 1


class Status(enum.StrEnum):
    """What is known about a plan."""

    OPTIMAL = "optimal"  # verified, proved within the asked gap of the best possible
    FEASIBLE = "feasible"  # verified; the gap is larger than asked, or not known
    INFEASIBLE = "infeasible"  # proved that there is no plan
    FAILED = "failed"  # no verified plan found, nothing proved


class Cost(NamedTuple):
    """Cost of a plan in s, and what it is made of."""

    total: float
    time_s: float
    energy_J: float
    transitions: int


@dataclass(frozen=True)
class Verification:
    """What independent re-integration and checking of a plan found.

    Attributes:
        max_defect: Largest difference between the samples and their re-integration [m, rad, 1/m].
        goal_error: Distance to the goal box of each coordinate after re-integration.
        limits: Name of each limit -> margin left (negative: violated), unit in the name.
        ok: Whether everything holds.
        problems: What does not hold, in words.
    """

    max_defect: float
    goal_error: tuple[float, ...]
    limits: Mapping[str, float]
    ok: bool
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class Stats:
    """Effort spent on a plan."""

    wall_s: float
    sequences_bounded: int
    sequences_solved: int
    nlp_iterations: int


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan with its status, its proof and its set-points.

    Attributes:
        problem: The problem planned for (robot included).
        planner: "optimal" or "greedy".
        status: What is known about it.
        message: One sentence a person can act on.
        cost: None if there is no plan.
        lower_bound: Proved lower bound on the cost of any plan [s]; None if there is none.
        phases: Motion phases in order.
        transitions: Melts and freezes by heater time.
        samples: The plan on its grid; None if there is no plan.
        verification: Outcome of the independent check; None if there is no plan.
        stats: Effort spent.
        stopped_early: Whether a limit or an interrupt ended the search before the asked gap.
    """

    problem: Problem
    planner: str
    status: Status
    message: str
    cost: Cost | None
    lower_bound: float | None
    phases: tuple[Phase, ...]
    transitions: tuple[Transition, ...]
    samples: Samples | None
    verification: Verification | None
    stats: Stats
    stopped_early: bool = False

    @property
    def robot(self) -> Robot:
        """The robot planned for."""
        return self.problem.robot

    @cached_property
    def trajectory(self) -> Trajectory:
        """The plan at any time.

        Raises:
            NoPlanError: If there is no plan.
        """
        if self.samples is None:
            raise NoPlanError(self.status, self.message)
        return Trajectory(self.problem, self.samples, self.phases, self.transitions)

    @property
    def found(self) -> bool:
        """Whether there is a verified plan."""
        return self.status in (Status.OPTIMAL, Status.FEASIBLE)

    @property
    def duration_s(self) -> float | None:
        """Time from start to the end of the last phase or transition."""
        return self.cost.time_s if self.cost else None

    @property
    def gap(self) -> float | None:
        """Proved relative gap (cost - lower bound) / cost; None where either is missing."""
        if self.cost is None or self.lower_bound is None:
            return None
        if self.cost.total == 0.0:
            return 0.0
        return max(0.0, (self.cost.total - self.lower_bound) / self.cost.total)

    @property
    def moving_s(self) -> float:
        """Time spent in motion phases."""
        return sum(phase.end_s - phase.start_s for phase in self.phases)

    def require(self) -> Plan:
        """Return this plan if it is verified.

        Raises:
            NoPlanError: If it is not; carries status and message.
        """
        if not self.found:
            raise NoPlanError(self.status, self.message)
        return self

    def to_dict(self) -> dict[str, Any]:
        """The plan as plain data, in the published file format."""
        return {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "package": __version__,
            "robot": self.robot.model_dump(mode="json"),
            "scenario": self.problem.scenario(),
            "planner": self.planner,
            "status": str(self.status),
            "message": self.message,
            "duration_s": self.duration_s,
            "lower_bound_s": self.lower_bound,
            "gap": self.gap,
            "cost": self.cost._asdict() if self.cost else None,
            "phases": [phase._asdict() for phase in self.phases],
            "transitions": [transition._asdict() for transition in self.transitions],
            "samples": _samples_dict(self.samples),
            "verification": _verification_dict(self.verification),
            "stats": vars(self.stats).copy(),
            "stopped_early": self.stopped_early,
        }

    def save(self, path: str | Path) -> None:
        """Write the plan as JSON, atomically.

        Raises:
            InputError: If the folder does not exist or cannot be written.
        """
        write_text(path, json.dumps(self.to_dict(), allow_nan=False) + "\n")


class PhaseDocument(NamedTuple):
    """A phase in a plan file; times in s."""

    mode: tuple[Literal[0, 1], Literal[0, 1]]
    start_s: float
    end_s: float


class _VerificationDocument(BaseModel):
    """The types of a plan file's verification; a number that is not finite is written as null."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    max_defect: float | None
    goal_error: tuple[float | None, ...]
    limits: dict[str, float]
    ok: bool
    problems: tuple[str, ...]


class PlanDocument(BaseModel):
    """The types of a plan file, for reading one back."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    format: Literal["twosra-plan"]
    version: Literal[1]
    package: str
    robot: dict[str, Any]
    scenario: dict[str, Any]
    planner: Literal["optimal", "greedy"]
    status: Status
    message: str
    duration_s: float | None
    lower_bound_s: float | None
    gap: float | None
    cost: Cost | None
    phases: tuple[PhaseDocument, ...]
    transitions: tuple[Transition, ...]
    samples: dict[str, list[float] | list[list[float]]] | None
    verification: _VerificationDocument | None
    stats: dict[str, int | float]
    stopped_early: bool


def load_plan(path: str | Path) -> Plan:
    """Read a plan file back.

    Raises:
        InputError: If the file is not a plan of a known version, or does not fit together.
    """
    source = str(path)
    text = read_text(Path(path), source)
    try:
        head = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError("file", source, f"a plan in JSON ({error})", source) from error
    if not isinstance(head, dict):
        raise InputError("file", source, "a table of keys at the top level", source)
    if head.get("format") != FORMAT or head.get("version") != FORMAT_VERSION:
        found = (head.get("format"), head.get("version"))
        raise InputError("format", found, f"{FORMAT!r} version {FORMAT_VERSION}", source)
    try:
        return _plan(PlanDocument.model_validate_json(text), source)
    except ValidationError as error:
        first = named_problem(PlanDocument, error.errors()[0])
        raise first.within("plan", source) from None
    except InputError as error:
        raise error.within("", source) from None
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("plan", str(error), "values that fit together", source) from error


def _plan(data: PlanDocument, source: str) -> Plan:
    robot = Robot.parse(data.robot, f"{source} (robot)")
    problem = Problem.parse({**data.scenario, "robot": robot}, f"{source} (scenario)")
    checked = data.verification
    arrays = {name: np.array(rows) for name, rows in (data.samples or {}).items()}
    if "mode" in arrays:
        if not np.isin(arrays["mode"], (0, 1)).all():
            raise InputError("plan.samples.mode", arrays["mode"].tolist(), "zeros and ones")
        arrays["mode"] = arrays["mode"].astype(np.int64)
    if "t_s" in arrays and not (np.diff(arrays["t_s"]) > 0).all():
        raise InputError("plan.samples.t_s", "times that do not grow", "growing times")
    return Plan(
        problem=problem,
        planner=data.planner,
        status=data.status,
        message=data.message,
        cost=data.cost,
        lower_bound=data.lower_bound_s,
        phases=tuple(Phase(*phase) for phase in data.phases),
        transitions=data.transitions,
        samples=Samples(**arrays) if data.samples is not None else None,
        verification=Verification(
            max_defect=math.nan if checked.max_defect is None else checked.max_defect,
            goal_error=tuple(math.nan if e is None else e for e in checked.goal_error),
            limits=checked.limits,
            ok=checked.ok,
            problems=checked.problems,
        )
        if checked
        else None,
        stats=Stats(**data.stats),  # type: ignore[arg-type]  # counts are whole numbers in the file
        stopped_early=data.stopped_early,
    )


def _samples_dict(samples: Samples | None) -> dict[str, Any] | None:
    if samples is None:
        return None
    return {item.name: getattr(samples, item.name).tolist() for item in fields(samples)}


def _verification_dict(verification: Verification | None) -> dict[str, Any] | None:
    if verification is None:
        return None
    defect, errors = verification.max_defect, verification.goal_error
    return {
        **vars(verification),
        "max_defect": defect if math.isfinite(defect) else None,
        "goal_error": [error if math.isfinite(error) else None for error in errors],
        "limits": dict(verification.limits),
        "problems": list(verification.problems),
    }
