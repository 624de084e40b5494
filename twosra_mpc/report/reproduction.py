"""What it takes to get the same plan again: the whole problem as TOML, versions, commands."""

from __future__ import annotations

import hashlib
import json
import platform
import shlex
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import tomlkit

from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.version import __version__

_LIBRARIES = ("casadi", "numpy", "scipy")  # those that a plan's numbers come from


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
    def of(cls, path: Path) -> Origin:
        """Describe a plan file that ``load_plan`` has accepted."""
        content = path.read_bytes()
        return cls(path.name, hashlib.sha256(content).hexdigest(), json.loads(content)["package"])


def scenario_toml(problem: Problem) -> str:
    """Return the problem as one scenario file: every default filled in, the robot written out."""
    document = _writable(problem.scenario())
    kappa = document["goal"].get("kappa_per_m")
    if kappa is not None:
        document["goal"]["kappa_per_m"] = ["free" if value is None else value for value in kappa]
    robot = _writable(problem.robot.model_dump(mode="json"))
    return tomlkit.dumps({**document, "robot": robot})


def _writable(table: dict[str, Any]) -> dict[str, Any]:
    """The table without keys that have no value: TOML leaves them out."""
    return {
        key: _writable(value) if isinstance(value, dict) else value
        for key, value in table.items()
        if value is not None
    }


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
        f"{stats.wall_s:.2f} s of planning: {stats.sequences_bounded} mode sequences bounded, "
        f"{stats.sequences_solved} solved, {stats.nlp_iterations} NLP iterations."
    )
    if result.stopped_early:
        words += (
            " A limit or an interrupt ended the search before the asked gap was reached, so a"
            " faster or slower machine may find another plan."
        )
    return words
