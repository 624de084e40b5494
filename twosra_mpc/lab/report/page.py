"""The page: template, style and script filled in with a plan. Nothing in it leaves the page.

Its words on what was proved and what is kept claim no more than that; scenario, versions and
commands make the same plan again.

A Content-Security-Policy allows this very style and script, by their hashes, and pictures that are
part of the page; whatever text a plan file carries can neither run nor fetch anything.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
import platform
import shlex
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import tomlkit

from twosra_mpc import Problem, Result
from twosra_mpc.arguments import public
from twosra_mpc.checking.followed import plan_off_words
from twosra_mpc.files import data_file, ending_of, environment, write_text
from twosra_mpc.installation import __version__
from twosra_mpc.keys import describe
from twosra_mpc.lab.analysis.critical_path import critical_path, hidden_activities, in_words
from twosra_mpc.lab.analysis.explanation import task_costs
from twosra_mpc.lab.report import player
from twosra_mpc.plans.plan import Verification, above_bound, percent, within
from twosra_mpc.plotting import plot_plan
from twosra_mpc.plotting.figures import picture_address
from twosra_mpc.problem.limits import LIMITS
from twosra_mpc.problem.tasks import MOST_PHASES
from twosra_mpc.problem.tolerances import DEFECT_TOLERANCE, GOAL_TOLERANCE
from twosra_mpc.robot.modes import mode_name, sequence_name
from twosra_mpc.timing import transition_model

_COORDINATES = ("x", "y", "heading φ", *(f"curvature κ{j}" for j in "₁₂₃₄"))


@public
def check_report_path(path: str | Path) -> None:
    """Check that a report may be called this.

    Raises:
        InputError: If the ending is not that of a web page.
    """
    ending_of(path, ".html", ".htm")


@public
def write_report(result: Result, path: str | Path, origin: Origin | None = None) -> None:
    """Write a report, atomically.

    Args:
        result: What planning came to, with a plan or without.
        path: Where to; the ending is .html.
        origin: The file the plan was read from, if any.

    Raises:
        InputError: If the ending is another one, or the folder cannot be written.
    """
    check_report_path(path)
    write_text(path, report_page(result, origin))


@public
def report_page(result: Result, origin: Origin | None = None) -> str:
    """Return the report as one HTML document that needs nothing else.

    Args:
        result: What planning came to, with a plan or without.
        origin: The file the plan was read from, if any.
    """
    plan = result.plan
    templates = environment("lab/report")
    templates.filters |= {"mode": mode_name, "described": describe, "percent": percent}
    templates.filters["seconds"] = _seconds
    style = data_file("lab/report/page.css")
    script = data_file("lab/report/player.js") + data_file("lab/report/page.js")
    return templates.get_template("page.html").render(
        policy=policy(style, script),
        style=style,
        script=script,
        title=result.problem.description or f"Plan for robot {result.problem.robot.name}",
        result=result,
        plan=plan,
        document=result.to_dict(),
        sequence=sequence_name(plan.sequence) if plan and plan.phases else "",
        tolerances=(DEFECT_TOLERANCE, GOAL_TOLERANCE),
        bound_sentences=bound_sentences(result),
        goal=_goal(result.problem, plan.verification) if plan else (),
        limits=LIMITS,
        finite=math.isfinite,
        path=in_words(critical_path(plan)) if plan else (),
        hidden=hidden_activities(plan) if plan else (),
        tasks=task_costs(plan) if plan else (),
        motion=player.motion_of(plan) if plan else None,
        figure=picture_address(plot_plan(plan, policy=result.policy), "svg") if plan else "",
        off_path=plan_off_words(plan.trajectory) if plan else "",
        origin=origin,
        scenario=scenario_toml(result.problem),
        commands=commands(origin),
        versions=versions(origin),
    )


def drawn(part: str, motion: dict[str, Any]) -> str:
    """Draw a part of the page: ``plane.html``, ``readings.html`` or ``timeline.html``."""
    return environment("lab/report").get_template(part).render(motion=motion)


def policy(style: str, script: str) -> str:
    """Return a Content-Security-Policy that allows what is in the page and nothing else."""
    return (
        f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; "
        f"script-src '{_hash(script)}'; base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _goal(problem: Problem, check: Verification) -> Iterable[tuple[Any, ...]]:
    """Name, unit, middle, half-width and error of each coordinate of a goal."""
    if problem.ends_anywhere:
        return ()
    goal, units = problem.goal, problem.robot.coordinates.units
    box = goal.configuration.tolist(), goal.half_width.tolist()
    return zip(_COORDINATES, units, *box, check.goal_error, strict=False)


def _seconds(value: float) -> str:
    """A duration as people read it: milliseconds, seconds, or minutes and seconds."""
    if 0 < value < 0.1:
        return f"{1e3 * value:z.0f} ms"
    if value < 60:
        return f"{value:z.2f} s"
    minutes, seconds = divmod(round(value, 1), 60.0)
    return f"{minutes:z.0f} min {seconds:z.1f} s"


_LIBRARIES = ("casadi", "highspy", "numpy", "scipy")  # those that a plan's numbers come from


def bound_sentences(result: Result) -> list[str]:
    """Say what is proved about all other plans, and about which; nothing without a bound."""
    problem, templates = result.problem, environment("lab/report")
    if result.lower_bound is None:
        return []
    templates.filters["mode"] = mode_name
    rests = any(task.rests for task in problem.tasks)
    text = templates.get_template("bound.txt").render(
        result=result,
        plan=result.plan,
        problem=problem,
        phases=f"{MOST_PHASES} phases a task" if rests else f"{problem.max_phases} phases",
        timing=transition_model(problem),
        percent=percent,
        above_bound=above_bound,
        within=within,
    )
    return text.splitlines()


@public
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
    rows += [("twosra-mpc that wrote this report", __version__)]
    rows += [("Python", platform.python_version())]
    return rows + [(name, version(name)) for name in _LIBRARIES]
