"""The report of a suite: what was run, on what, and what came out."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from benchmarks.machine import machine, versions
from benchmarks.markdown import table
from benchmarks.run_log import RunLog
from benchmarks.suite import Suite
from twosra_mpc.files import write_text

NAME = "report.md"


def settings_of(suite: Suite) -> dict[str, Any]:
    """Everything that must stay the same for runs to stand in one report."""
    return {
        "suite": suite.model_dump(mode="json"),
        "machine": machine(),
        "versions": versions(),
    }


def write_report(name: str, suite: Suite, log: RunLog, folder: Path, load_before: float) -> str:
    """Write report and figures into ``folder``; return the report.

    Args:
        name: Name of the suite.
        suite: The suite.
        log: Its finished runs.
        folder: Where to.
        load_before: Load average of the machine when this process began.
    """
    records = [log.records[run.key] for run in suite.runs()]
    settings = log.settings
    lines = [
        f"# {name}",
        "",
        suite.description,
        "",
        *table(("machine and versions", ""), _pairs(settings["machine"] | settings["versions"])),
        f"One thread. Load average of the machine: {load_before:.1f} when this process began, "
        f"{os.getloadavg()[0]:.1f} when it ended.",
        "",
        *table(("setting", ""), _pairs(settings["suite"])),
        *suite.report(records, folder),
    ]
    text = "\n".join(lines)
    write_text(folder / NAME, text)
    return text


def _pairs(settings: dict[str, Any]) -> list[tuple[str, str]]:
    return [(key, _words(value)) for key, value in settings.items()]


def _words(value: Any) -> str:
    if isinstance(value, dict):
        return " ".join(str(item) for item in value.values() if item is not None)
    if isinstance(value, list):
        return ", ".join(_words(item) for item in value)
    return str(value)
