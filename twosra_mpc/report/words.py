"""Words of a page: status, bound and verification, claiming no more than was proved.

And what it takes to get the same plan again: the whole problem as TOML, versions, commands.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import shlex
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any, NamedTuple

import tomlkit

from twosra_mpc.installation import __version__
from twosra_mpc.keys import describe
from twosra_mpc.plans.plan import Plan, Status, Verification, above_bound, percent, within
from twosra_mpc.plans.result import Result
from twosra_mpc.plans.stretches import stretches
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import MOST_PHASES, Grasp, grasps
from twosra_mpc.problem.tolerances import DEFECT_TOLERANCE, GOAL_TOLERANCE
from twosra_mpc.robot.modes import mode_name
from twosra_mpc.timing import transition_model

_NONE = "\N{EN DASH}"
_LIBRARIES = ("casadi", "highspy", "numpy", "scipy")  # those that a plan's numbers come from
_COORDINATES = ("x", "y", "heading φ", *(f"curvature κ{j}" for j in "₁₂₃₄"))


class GoalRow(NamedTuple):
    """One coordinate of the goal: what was asked, and how far the re-integrated plan is from it."""

    name: str
    unit: str
    asked: str
    error: str


class LimitRow(NamedTuple):
    """One limit of the robot and the margin that the plan leaves to it."""

    name: str
    limit: str
    margin: str


def status_sentence(result: Result) -> str:
    """Say what a status means."""
    checked, asked = "Verified by independent re-integration", f"{100 * result.problem.gap:zg} %"
    match result.status:
        case Status.OPTIMAL:
            return f"{checked}, and proved to be within the asked gap of {asked} of the best."
        case Status.FEASIBLE if result.lower_bound is None:
            return f"{checked}. Nothing is proved about how much better another one could be."
        case Status.FEASIBLE:
            return f"{checked}. The gap that is proved is more than {asked}, which was asked for."
        case Status.INFEASIBLE:
            return "It is proved that this problem has no plan; the message at the top says why."
        case Status.FAILED:
            return "Undecided: no verified plan was found, and it is not proved that there is none."


def bound_sentences(result: Result) -> Iterator[str]:
    """Say what is proved about all other plans, and about which; nothing without a bound."""
    if result.lower_bound is None:
        return
    problem, plan = result.problem, result.plan
    yield (
        f"No plan for this problem that heats as below costs less than {result.lower_bound:z.4f} s:"
        " this is the optimum of a relaxation of it, a proved lower bound and not an estimate."
    )
    if plan is not None and plan.gap is not None:
        yield (
            f"This plan costs {plan.cost.total:z.4f} s, so no other one can be better by more than"
            f" {plan.cost.total - result.lower_bound:z.2g} s, or {percent(plan.gap)} of its cost."
        )
    if plan is not None and plan.slower_by and plan.fastest_cost is not None:
        yield (
            f"It drives gently: {above_bound(plan)}. At full speed, as the search found it, it"
            f" costs {plan.fastest_cost:z.4f} s, {within(plan.search_gap or 0.0)}. What the asked"
            " gap lets it cost more is spent on lower speeds."
        )
    yield f"Cost is {_cost_formula(problem)}."
    modes = ", ".join(mode_name(mode) for mode in problem.modes)
    phases = f"{problem.max_phases} phases"
    if problem.is_mission:
        phases = f"{MOST_PHASES} phases a task"
        if problem.objects:
            yield "It is one over plans with the touches that were considered; the guide has them."
    yield (
        f"The bound covers every sequence of the modes {modes}, also sequences longer than the"
        f" {phases} that were searched, with every path that path model"
        f" {problem.robot.path.model} can take within the robot's limits."
    )
    timing = transition_model(problem)
    times = timing.words
    if problem.heaters_at_once < problem.robot.coordinates.segments:
        times += ", one heater on at a time"
    yield (
        f"It holds for {times}, under {timing.policy}; a different heater controller has"
        " different times."
    )


def caveat_sentences(result: Result) -> Iterator[str]:
    """Say what neither the bound nor the verification is about."""
    yield (
        "All of this is about the model. On hardware a unit that should hold pivots while the"
        " other one bends: expect 1 to 15 cm and up to 1.5 rad after a soft phase, unless a camera"
        " closes the loop."
    )
    if result.problem.objects:
        yield (
            "An object is taken to rest until it is grasped and while the robot opens, and to move"
            " with the robot in between: that it is pushed away or slips is not part of the model."
        )
    if result.problem.obstacles or result.problem.objects:
        yield "Slipping wheels, and obstacles that move, are not part of the model."
    else:
        yield "Obstacles and slipping wheels are not part of the model."
    if result.status is Status.FAILED and result.plan is not None:
        yield "The motion shown here did not pass verification: do not run it."


def _cost_formula(problem: Problem) -> str:
    weights, terms = problem.cost_weights, ["the duration in s"]
    if weights.energy_s_per_J:
        terms.append(f"{weights.energy_s_per_J:zg} s for every joule of heater energy")
    if weights.transition_s:
        terms.append(f"{weights.transition_s:zg} s for every melt or freeze")
    if weights.effort:
        terms.append(
            f"{weights.effort:zg} times the effort: the sum of the squared wheel speeds, each over"
            " the largest, integrated"
        )
    return " + ".join(terms) if len(terms) > 1 else "the duration, nothing else"


def verification_sentence(check: Verification) -> str:
    """Say what independent re-integration found."""
    if not check.ok:
        return f"Verification failed: {'; '.join(check.problems)}."
    return (
        "Verification passed: the samples were integrated anew by another method, with adaptive"
        " steps, and limits, order of melts and freezes, heater commands and goal were checked. The"
        " samples and their"
        f" re-integration differ by at most {check.max_defect:z.2g} (m, rad or 1/m; allowed are"
        f" {DEFECT_TOLERANCE:zg}); the goal may be missed by {GOAL_TOLERANCE:zg}."
    )


def goal_rows(problem: Problem, check: Verification) -> list[GoalRow]:
    """Return the goal coordinate by coordinate, with the error after re-integration."""
    rows = []
    goal, width = problem.goal.configuration.tolist(), problem.goal.half_width.tolist()
    units = problem.robot.coordinates.units
    items = zip(_COORDINATES, units, goal, width, check.goal_error, strict=False)
    for name, unit, asked, box, error in items:
        if math.isnan(asked):
            rows.append(GoalRow(name, unit, "free", _NONE))
        else:
            words = f"{asked:zg}" + (f" ± {box:z.2g}" if box else "")
            rows.append(GoalRow(name, unit, words, _residual(error)))
    return rows


def _residual(error: float) -> str:
    if not math.isfinite(error):
        return "not reached"
    return f"{abs(error):z.1e}" if error else "0"


def limit_rows(plan: Plan, check: Verification) -> list[LimitRow]:
    """Return the robot's limits with the least margin that the plan leaves to each."""
    robot, heater = plan.robot, plan.robot.heater
    limits = {
        **robot.limits.model_dump(),
        "temperature_max_C": heater.temperature_max_C,
        "heater_current_A": heater.current_max_A,
        "clearance_m": plan.problem.clearance_m,
    }
    rows = []
    for name, margin in check.limits.items():
        bound = f"{limits[name]:zg}" if name in limits else _NONE
        left = f"{margin:z.3g}" if margin else "0: used in full"
        rows.append(LimitRow(describe(name), bound, left))
    return rows


class TaskRow(NamedTuple):
    """One task of a mission: what, when it is done, how long it takes, where, and what holds."""

    what: str
    done_s: float
    took_s: float
    configuration: str
    held: str


def task_rows(plan: Plan) -> list[TaskRow]:
    """Return the stages of a mission; none where a plan only reaches a goal."""
    trajectory, rows = plan.trajectory, list[TaskRow]()
    held = "held since the start" if plan.problem.start.holding else _NONE
    taking = grasps(plan.problem.tasks)
    for number, stage in enumerate(stretches(trajectory)):
        words = _at(trajectory.configuration([stage.to_s])[0].tolist())
        if number in taking:
            held = _hold(plan.problem, taking[number])
        elif stage.task is not None and stage.task.lets_go:
            held = _NONE
        rows.append(TaskRow(stage.words, stage.to_s, stage.to_s - stage.from_s, words, held))
    return rows


def _at(q: list[float]) -> str:
    """A configuration to mm, hundredths of rad, tenths of 1/m."""
    x, y, phi, *kappa = q
    bends = ", ".join(f"{value:z.1f}" for value in kappa)
    return f"({x:z.3f}, {y:z.3f}) m, {phi:z.2f} rad, {bends} 1/m"


def _hold(problem: Problem, task: Grasp) -> str:
    """Hold that keeps an object where it is in the robot."""
    if task.hold == "caged":
        return "caged: proved, it cannot leave"
    (friction,) = (item.friction for item in problem.objects if item.name == task.object)
    return f"pushed: held only while contact is kept (friction {friction:zg})"


class Origin(NamedTuple):
    """The plan file a report is about.

    Attributes:
        name: Name of the file, without its folder.
        sha256: Checksum of its bytes, in hexadecimal digits.
        package: Version of this package that wrote it.
    """

    name: str
    sha256: str
    package: str

    @classmethod
    def of(cls, name: str, content: bytes) -> Origin:
        """Describe what is in a plan file that ``plan_in`` has accepted."""
        return cls(name, hashlib.sha256(content).hexdigest(), json.loads(content)["package"])


def scenario_toml(problem: Problem) -> str:
    """Return the problem as one scenario file: every default filled in, the robot written out."""
    document = _writable(problem.scenario())
    robot = _writable(problem.robot.model_dump(mode="json"))
    return tomlkit.dumps({**document, "robot": robot})


def _writable(value: Any) -> Any:
    """A value without keys that have no value: TOML has none. In lists, they are free."""
    if isinstance(value, dict):
        return {key: _writable(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        return ["free" if item is None else _writable(item) for item in value]
    return value


def commands(origin: Origin | None) -> str:
    """Return the shell commands that plan the scenario again and write the report again."""
    plan_file = shlex.quote(origin.name if origin else "plan.json")
    return f"twosra plan scenario.toml --out {plan_file}\ntwosra report {plan_file} report.html"


def versions(origin: Origin | None) -> list[tuple[str, str]]:
    """Return (what, version) of everything that made the plan and the report."""
    rows = [("twosra-mpc that made the plan", origin.package)] if origin else []
    rows += [
        ("twosra-mpc that wrote this report", __version__),
        ("Python", platform.python_version()),
    ]
    return rows + [(name, version(name)) for name in _LIBRARIES]


def effort(result: Result) -> str:
    """Say how much work the plan was, and whether the search ended by itself."""
    stats = result.stats
    words = (
        f"{stats.wall_s:z.2f} s of planning: {stats.sequences_bounded} mode sequences bounded, "
        f"{stats.sequences_solved} solved, {stats.nlp_iterations} NLP iterations."
    )
    if stats.work is not None:
        words += f" {stats.work:z.0f} units of work, the same on every machine."
    if result.stopped_early:
        words += (
            " A limit or an interrupt ended the search before the asked gap was reached: with a"
            " larger one there may be a better plan."
        )
    return words
