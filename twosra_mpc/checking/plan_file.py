"""``check_plan(path)``: what a plan file claims, against what follows from its samples.

The verification and the numbers stored in the file are not trusted: the samples are re-integrated
and every rule is tested anew for the robot and the scenario in the file, limits also between
samples; the cost is worked out from the samples, and it alone is compared with bound and gap. The
robot in the file must be the one that its name stands for. That the lower bound is one cannot be
seen from a plan; it takes planning the scenario again.

`refined` makes a file denser: a plan with more samples, verified anew.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.checking.reintegration import between_problems
from twosra_mpc.checking.verification import Findings, cost_of, examine, verify
from twosra_mpc.checking.walk import walked_s
from twosra_mpc.files import differences, json_document, read_text, reading
from twosra_mpc.keys import unit_of
from twosra_mpc.plans.carried import mission_document
from twosra_mpc.plans.plan import Cost, Plan, Status, Verification
from twosra_mpc.plans.result import MISSION_VERSION, Result, plan_in
from twosra_mpc.plans.trajectory import Samples, Trajectory, new_times
from twosra_mpc.problem.tolerances import (
    CONFIRMED_TOLERANCE,
    DEFECT_TOLERANCE,
    EFFORT_TOLERANCE,
    FIT_TOLERANCE,
    GOAL_TOLERANCE,
    ROUNDING,
)
from twosra_mpc.robot.coordinates import Coordinates
from twosra_mpc.robot.description import Robot, load_robot, robot_names, with_path_model
from twosra_mpc.robot.modes import mode_name
from twosra_mpc.validation import ArrayValue

_YOUNGER = {"body_gap_m", "bend_lever"}  # limits that plan files of before do not state


@dataclass(frozen=True)
class Check:
    """Requirement of a plan file, and the finding.

    Attributes:
        name: What was checked.
        found: What was found, in words.
        ok: Whether it holds.
        margin: How far it is from not holding (negative: does not hold); None without a measure.
        unit: Unit of the margin.
    """

    name: str
    found: str
    ok: bool
    margin: float | None = None
    unit: str = ""


@public
@dataclass(frozen=True, eq=False, repr=False)
class PlanCheck(ArrayValue):
    """A plan file that was checked.

    Attributes:
        result: What was read.
        checks: Everything that was checked; a single failed check if there is no plan in the file.
        problems: What does not hold, in words.
    """

    result: Result
    checks: tuple[Check, ...]
    problems: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """True if everything holds."""
        return not self.problems and all(check.ok for check in self.checks)

    def believed(self, source: str) -> Result:
        """The result as far as it holds: failed where anything does not, its plan to be looked at.

        Args:
            source: The file, for the message.
        """
        result = self.result
        if self.ok or (plan := result.plan) is None:
            return result
        told = replace(plan.verification, ok=False, problems=self.problems)
        message = result.message
        if result.status is not Status.FAILED:
            message = f"{source} does not verify: {'; '.join(self.problems[:3])}"
        refused = replace(plan, verification=told)
        return replace(result, status=Status.FAILED, words=message, plan=refused)


@public
def load_plan(path: str | Path, robot: Robot | None = None) -> Result:
    """Read a plan file back, and check it: no other way leads from a file to a plan.

    What a file claims without truth is no plan to drive: the result has failed then, its message
    says why, and ``require()`` raises. Its plan is left to be looked at.

    Args:
        path: The file.
        robot: What its robot must be; left out, the built-in one of its name, if there is one.

    Raises:
        InputError: If the file is not a plan of a known version, or does not fit together.
    """
    return check_plan(path, robot).believed(str(path))


@public
def check_plan(path: str | Path, robot: Robot | None = None) -> PlanCheck:
    """Check a plan file without trusting what it says of itself.

    Args:
        path: The file.
        robot: What its robot must be; left out, the built-in one of its name, if there is one.

    Raises:
        InputError: If it is not a plan file of a known version, or does not fit together.
    """
    return checked_text(read_text(Path(path), str(path)), str(path), robot)


def checked_text(text: str, source: str, robot: Robot | None = None) -> PlanCheck:
    """Check what is in a plan file, as `check_plan` does, from its text."""
    result, document = plan_in(text, source), json_document(text, source)
    if (plan := result.plan) is None:
        nothing = Check("plan", f"none in this file: {result.message}", ok=False)
        return PlanCheck(result, (nothing,), (f"there is no plan: {result.message}",))
    with reading(source, "plan"):
        return _check_claims(result, plan, document, robot)


def _check_claims(
    result: Result, plan: Plan, document: dict[str, Any], robot: Robot | None
) -> PlanCheck:
    if "bend_lever" not in document["robot"]["limits"]:  # a file of before it was limited
        plan = _with_lever(plan, robot)
        result = replace(result, plan=plan)
    found, cost = examine(plan.trajectory), cost_of(plan.trajectory)
    costed = replace(plan, cost=cost)  # what is compared follows from the samples
    claims = (
        _robot(plan.robot, robot),
        _allowed_modes(plan),
        _currents(plan.samples),
        _between_samples(plan.trajectory),
        *_cost(plan, cost),
        *_proof(costed, result.status),
        *_confirmed(costed, document),
        *_copies(result, costed, document),
        _stored(plan.verification, found.verification),
    )
    false = (f"{claim.name}: {claim.found}" for claim in claims if not claim.ok)
    rules = _rules(plan.robot.coordinates, found)
    return PlanCheck(result, (*rules, *claims), (*found.verification.problems, *false))


def _with_lever(plan: Plan, known: Robot | None) -> Plan:
    """The plan for a robot that has the ``bend_lever`` that is known of it today."""
    own = plan.robot
    meant = known or (load_robot(own.name) if own.name in robot_names() else own)
    limits = own.limits.with_values(bend_lever=meant.limits.bend_lever)
    problem = plan.problem.with_values(robot=own.with_values(limits=limits))
    return replace(plan, trajectory=replace(plan.trajectory, problem=problem))


def _rules(coordinates: Coordinates, found: Findings) -> Iterator[Check]:
    """Every rule of motion: first those with a margin."""
    checked = found.verification
    margin = DEFECT_TOLERANCE - checked.max_defect
    departs = f"departs from the samples by {checked.max_defect:z.2g} (m, rad or 1/m)"
    yield Check("re-integration", departs, margin >= 0, margin)
    errors = zip(coordinates.names, coordinates.units, checked.goal_error, strict=True)
    for name, unit, error in errors:
        margin = GOAL_TOLERANCE - abs(error)
        yield Check(
            f"goal.{name}", f"missed by {abs(error):z.2g} {unit}", margin >= 0, margin, unit
        )
    for name, margin in checked.limits.items():
        state = "kept" if margin >= 0 else "exceeded"
        yield Check(f"limit {name}", state, margin >= 0, margin, unit_of(name))
    for name, broken in found.rules.items():
        yield Check(name, broken[0] if broken else "kept", not broken)


def _robot(stored: Robot, known: Robot | None) -> Check:
    """Check that the robot in the file is the one that is meant, by any of the path models."""
    if known is None and stored.name not in robot_names():
        return Check(
            "robot", f"{stored.name!r} is not built in: taken as it is in the file", ok=True
        )
    known, model = known or load_robot(stored.name), stored.path.model
    other = model != known.path.model
    right = with_path_model(known, model) if other else known
    younger = ("physics", "uncertainty")  # which older files do not have
    left_out = {name for name in younger if getattr(stored, name) is None}
    own, meant = (item.model_dump(mode="json", exclude=left_out) for item in (stored, right))
    if other and _alike(own["path"], meant["path"], FIT_TOLERANCE):
        own["path"] = meant["path"]
    others = [f"{key} is {here}, not {there}" for key, here, there in differences(own, meant)]
    name = f"{known.name!r}" + f" with path model {model}" * other
    text = f"not {name}: {'; '.join(others[:3])}" if others else f"{name}, unchanged"
    return Check("robot", text, not others)


def _allowed_modes(plan: Plan) -> Check:
    forbidden = [mode_name(p.mode) for p in plan.phases if p.mode not in plan.problem.modes]
    text = f"{', '.join(forbidden)} is not among them" if forbidden else "used, no others"
    return Check("modes of the scenario", text, not forbidden)


def _between_samples(trajectory: Trajectory) -> Check:
    broken = tuple(between_problems(trajectory))
    return Check("between samples", "; ".join(broken) or "limits are kept", not broken)


def _currents(samples: Samples) -> Check:
    """A current that flows backwards would heat as well, but no driver can send it."""
    least = float(samples.heater_current_A.min())
    return Check("heater currents", f"at least {least:zg} A", least >= 0, least, "A")


def _cost(plan: Plan, found: Cost) -> Iterator[Check]:
    """Stated cost against that of the samples; old files say no effort."""
    first, stated = float(plan.samples.t_s[0]), plan.cost._asdict()
    weight, missed_s = plan.problem.cost_weights.effort, EFFORT_TOLERANCE * (found.effort_s or 0.0)
    missed = {"effort_s": missed_s, "total": weight * missed_s}
    yield Check("begin", f"the samples begin at {first:zg} s", first == 0.0)
    for name, value in found._asdict().items():
        said, unsaid = stated[name], name == "effort_s" and not weight
        if said is None and unsaid:
            continue
        most = ROUNDING * (1 + abs(value)) + missed.get(name, 0.0)
        same = said is not None and abs(said - value) <= most
        text = f"{_number(said)}; the samples give {_number(value)}"
        yield Check(f"cost.{name}", text, same)


def _proof(plan: Plan, status: Status) -> Iterator[Check]:
    """The claims that rest on the lower bound: as far as they do not contradict each other."""
    bound, gap, asked = plan.lower_bound, plan.gap, plan.problem.gap
    if bound is None or gap is None:
        claimed = status is Status.OPTIMAL
        text = "claimed without a lower bound" if claimed else "no lower bound, none claimed"
        yield Check("status", f"{status}: {text}", status is Status.FEASIBLE)
        return
    yield _bound("lower bound", bound, plan.cost.total, "the cost")
    if (quickest := plan.fastest_cost) is not None:
        slack = ROUNDING * plan.cost.total
        between = bound - slack <= quickest <= plan.cost.total + slack
        text = f"{quickest:z.3f} s, {'' if between else 'not '}between the bound and the cost"
        yield Check("fastest_cost_s", text, between)
    earned = Status.OPTIMAL if gap <= asked else Status.FEASIBLE
    text = f"{status}; gap {gap:z.3g}, asked {asked:zg}: {earned}, planner {plan.planner}"
    yield Check("status", text, status is earned and plan.planner == "optimal")


def _confirmed(plan: Plan, document: dict[str, Any]) -> Iterator[Check]:
    """The time until all is known to be done, if it is told, by a walk through the phases."""
    said_s, least_s = (document.get(f"confirmed_{name}_s") for name in ("duration", "lower_bound"))
    if said_s is not None:
        walked = walked_s(plan) if plan.robot.describes_heat else math.nan
        off, most = abs(said_s - walked), CONFIRMED_TOLERANCE * walked
        shared = plan.problem.heaters_at_once < plan.robot.coordinates.segments  # it waits longer
        same = off <= most or (shared and said_s >= walked)
        text = f"{said_s:z.3f} s; a walk through the phases takes {walked:z.3f} s"
        yield Check("confirmed_duration_s", text, same)
    if least_s is not None:
        yield _bound("confirmed_lower_bound_s", least_s, said_s or 0.0, "confirmed_duration_s")


def _bound(name: str, bound: float, most: float, of: str) -> Check:
    """Check of a bound that a plan claims: no plan shows more than that it is not contradicted."""
    margin = most - bound
    within = bound >= 0 and margin >= -ROUNDING * most
    text = f"{bound:z.3f} s is claimed, not above {of}"
    if not within:
        text = "below zero" if bound < 0 else f"above {of} that it bounds"
    return Check(name, text, within, max(margin, 0.0) if within else -abs(margin), "s")


def _copies(result: Result, plan: Plan, document: dict[str, Any]) -> Iterator[Check]:
    """Numbers and names that stand in the file twice."""
    early = document["stopped_early"]
    text = f"{early}; the search ended as {result.ending or 'is not said'}"
    yield Check("stopped_early", text, early == result.stopped_early)
    own = {"duration_s": plan.cost.time_s, "gap": plan.gap, "search_gap": plan.search_gap}
    for name, expected in own.items():
        stored = document.get(name)
        text = f"{_number(stored)}; it should be {_number(expected)}"
        yield Check(name, text, _alike(stored, expected))
    version, problem = document["version"], plan.problem
    asked = bool(problem.tasks or problem.objects)
    older = not problem.objects and len(problem.passes) == len(problem.tasks)
    text = f"{version}, {'with' if asked else 'without'} tasks or objects"
    yield Check("version", text, asked if version == MISSION_VERSION else older)
    for name, expected in mission_document(plan.trajectory).items():
        if version == MISSION_VERSION:
            same = _alike(document.get(name), json.loads(json.dumps(expected)))
            found = f"{'' if same else 'not '}what follows from the samples"
            yield Check(name, found, same)
    name, used = document["scenario"].get("robot"), plan.robot.name
    yield Check("scenario.robot", f"{name!r}; the robot in the file is {used!r}", name == used)


def _alike(stored: object, expected: object, within: float = ROUNDING) -> bool:
    """True if plain data are the same but for rounding, ``within`` relative and absolute."""
    if isinstance(expected, dict) and isinstance(stored, dict):
        pairs = [(stored[key], expected[key]) for key in expected if key in stored]
        return stored.keys() == expected.keys() and all(_alike(*pair, within) for pair in pairs)
    if isinstance(expected, list) and isinstance(stored, list):
        pairs = list(zip(stored, expected, strict=False))
        return len(stored) == len(expected) and all(_alike(*pair, within) for pair in pairs)
    if isinstance(expected, float) and isinstance(stored, int | float):
        return math.isclose(stored, expected, rel_tol=within, abs_tol=within)
    return stored == expected


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:z.6g}"


def _stored(stored: Verification, found: Verification) -> Check:
    """Check that the verification in the file says what was found here."""
    name = "verification in the file"
    if stored.ok != found.ok:
        text = f"says {'passed' if stored.ok else 'failed'}, but it is not so"
        return Check(name, text, ok=False)
    expected = found.limits.keys() - (_YOUNGER - stored.limits.keys())
    numbers = [
        (stored.max_defect, found.max_defect),
        *zip(stored.goal_error, found.goal_error, strict=False),
        *((stored.limits.get(key, math.nan), found.limits[key]) for key in expected),
    ]
    same = len(stored.goal_error) == len(found.goal_error) and stored.problems == found.problems
    same = same and stored.limits.keys() == expected
    same = same and all(abs(a - b) <= ROUNDING + DEFECT_TOLERANCE * abs(b) for a, b in numbers)
    return Check(name, "the same" if same else "its numbers are others", same)


@public
def refined(plan: Plan, rate_Hz: float) -> Plan:
    """Add samples at a regular rate; those that the plan has stay, since its inputs change there.

    What is added has the input in force there, on the plan's path and at the temperatures expected
    there. The outcome is verified anew.

    Raises:
        InputError: If the rate is not positive, or beyond 1000 Hz.
    """
    given, known = plan.trajectory, plan.samples.t_s
    further = new_times(given.regular_times(rate_Hz), known)
    samples = given.at(np.sort(np.concatenate([known, further])))
    trajectory = replace(given, samples=samples)
    cost, verification = cost_of(trajectory), verify(trajectory)
    return replace(plan, trajectory=trajectory, cost=cost, verification=verification)
