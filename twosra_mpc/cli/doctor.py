"""``twosra doctor``."""

from __future__ import annotations

import functools
import importlib
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Literal, NamedTuple

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from twosra_mpc import check_plan, load_problem, plan
from twosra_mpc.cli.options import command
from twosra_mpc.cli.output import Exit, Output, print_table
from twosra_mpc.execution.tracking.tracker import CommandStatus, Measurement, Tracker
from twosra_mpc.installation import DISTRIBUTION, __version__, install_command

_EXTRA = re.compile(r"extra == ['\"](.+?)['\"]")  # in the marker of a requirement
_packages_of_modules = functools.cache(metadata.packages_distributions)  # takes half a second


class Finding(NamedTuple):
    """Subject of a check, and its finding."""

    what: str
    verdict: Literal["PASS", "FAIL", "none"]
    details: str


@command("doctor")
def doctor_command(output: Output) -> int:
    """Check this installation: versions, solvers, extras, and a plan made and verified.

    Every line says PASS, FAIL, or "none" for something optional that is not there. The exit code is
    4 if anything fails.

    \b
    Does everything work here?
      twosra doctor
    For a bug report, or for a program:
      twosra doctor --json
    """
    findings: list[Finding] = []
    with output.progress("checking") as tell:
        for finding in examine():
            findings.append(finding)
            tell(f"checking: {finding.what} {finding.verdict}")
    failed = any(each.verdict == "FAIL" for each in findings)
    document, header = {"ok": not failed, "findings": findings}, ("", "twosra doctor", "found")
    rows = [(each.verdict, each.what, each.details) for each in findings]
    output.report(lambda: document, lambda: print_table(header, rows))
    return Exit.NO_PLAN if failed else Exit.PLANNED


def examine() -> Iterator[Finding]:
    """Look at everything, one after the other."""
    yield Finding("system", "PASS", f"{platform.platform()}, {DISTRIBUTION} {__version__}")
    yield _tried("Python", python_version)
    needed = dict[str, list[Requirement]]()  # extra, empty for what is always needed -> packages
    try:
        for item in map(Requirement, metadata.requires(DISTRIBUTION) or []):
            extra = _EXTRA.search(str(item.marker))
            needed.setdefault(extra[1] if extra else "", []).append(item)
    except metadata.PackageNotFoundError:
        yield Finding("packages", "FAIL", f"not known: install {DISTRIBUTION} with pip")
    for item in needed.pop("", []):
        yield _tried(item.name, lambda item=item: package(item))  # type: ignore[misc]
    for extra_name, items in needed.items():
        yield _complete(extra_name, [item.name for item in items])
    ffmpeg = shutil.which("ffmpeg")
    missing = Finding("ffmpeg", "none", "films as mp4 need it; gif works without")
    yield Finding("ffmpeg", "PASS", ffmpeg) if ffmpeg else missing
    yield _tried("self-test: a plan is made, tracked, written, read and verified", self_test)


def _tried(what: str, probe: Callable[[], str]) -> Finding:
    """Look at one thing; whatever goes wrong is what was found."""
    try:
        return Finding(what, "PASS", probe())
    except Exception as error:
        first = (str(error).splitlines() or [""])[0]
        return Finding(what, "FAIL", f"{type(error).__name__}: {first}")


def python_version() -> str:
    """Version of Python, if it is new enough."""
    needed = SpecifierSet(metadata.metadata(DISTRIBUTION)["Requires-Python"])
    _check_version(platform.python_version(), needed)
    return f"{platform.python_version()}, {sys.executable}"


def package(item: Requirement) -> str:
    """Version of a dependency, if it is new enough and can be imported."""
    version = metadata.version(item.name)
    _check_version(version, item.specifier)
    for module, sources in _packages_of_modules().items():
        if item.name in map(str.lower, sources) and not module.startswith("_"):
            importlib.import_module(module)
    return version


def _check_version(version: str, needed: SpecifierSet) -> None:
    if not needed.contains(version, prereleases=True):
        floor = str(needed).removeprefix(">=")
        raise RuntimeError(f"{version} is too old: at least {floor} is needed")


def _complete(extra: str, names: list[str]) -> Finding:
    """An extra: complete, or how to install it."""
    if missing := [name for name in names if not list(metadata.distributions(name=name))]:
        how = f"{install_command(extra)} (missing: {', '.join(missing)})"
        return Finding(f"extra: {extra}", "none", how)
    return Finding(f"extra: {extra}", "PASS", ", ".join(names))


def self_test() -> str:
    """Plan by a nonlinear program, track the plan for a step, and check the file that it makes."""
    made = plan(load_problem("shape-change", gap=0.0))
    planned, iterations = made.require(), made.stats.nlp_iterations
    if not iterations:
        raise RuntimeError("IPOPT's solutions were of no use")
    tracker = Tracker(planned.robot)
    tracker.reset(planned)
    begin_s, start = planned.phases[0].start_s, planned.problem.start.configuration
    command = tracker.step(Measurement(time_s=begin_s, phase=0, q=start))
    if command.status is not CommandStatus.SOLVED:
        raise RuntimeError(f"OSQP: {command.message}")
    with tempfile.TemporaryDirectory() as folder:
        made.save(path := Path(folder) / "plan.json")
        found = check_plan(path)
    if not found.ok:
        raise RuntimeError("; ".join(found.problems))
    return f"IPOPT: {iterations} iterations; {len(found.checks)} checks passed; {made.message}"
