"""Words of a page on what was proved and what is kept, claiming no more than that.

And what it takes to get the same plan again: the whole problem as TOML, versions, commands.
"""

from __future__ import annotations

import hashlib
import json
import platform
import shlex
from importlib.metadata import version
from typing import Any, NamedTuple

import tomlkit

from twosra_mpc.arguments import public
from twosra_mpc.files import environment
from twosra_mpc.installation import __version__
from twosra_mpc.plans.plan import above_bound, percent, within
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import MOST_PHASES
from twosra_mpc.robot.modes import mode_name
from twosra_mpc.timing import transition_model

_LIBRARIES = ("casadi", "highspy", "numpy", "scipy")  # those that a plan's numbers come from


def bound_sentences(result: Result) -> list[str]:
    """Say what is proved about all other plans, and about which; nothing without a bound."""
    problem, templates = result.problem, environment("report")
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
    rows += [
        ("twosra-mpc that wrote this report", __version__),
        ("Python", platform.python_version()),
    ]
    return rows + [(name, version(name)) for name in _LIBRARIES]
