"""What a cold start says in Markdown."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

import numpy as np

from benchmarks.cold_start.processes import CASADI, NOTHING, PLAN
from benchmarks.markdown import figure, milliseconds, percent, table
from benchmarks.suite import Record
from benchmarks.summary import quantiles

FIGURE = "cold-start.png"
_PACKAGES = {
    "casadi": "casadi",
    "numpy": "numpy",
    "scipy": "scipy",
    "pydantic": "pydantic",
    "pydantic_core": "pydantic",
    "annotated_types": "pydantic",
    "typing_extensions": "pydantic",
    "typing_inspection": "pydantic",
    "matplotlib": "matplotlib",
    "rich": "click, rich",
    "click": "click, rich",
    "twosra_mpc": "twosra_mpc",
    "standard library": "standard library",
}
_INTERPRETER, _BUILDING, _PLANNING = "interpreter", "building functions", "planning"
_EXIT, _REST = "exit of the process", "everything else"

Parts = dict[str, float]  # name -> s


def names(scenario: str) -> dict[str, str]:
    """Commands as one would type them."""
    return {
        PLAN: f"twosra plan {scenario}",
        CASADI: 'python -c "import casadi"',
        NOTHING: "python -c pass",
    }


def wall_times(records: Sequence[Record], command: str) -> list[float]:
    """Wall times of a command [s]."""
    return [record["wall_s"][command] for record in records]


def cpu_times(records: Sequence[Record], command: str) -> list[float]:
    """CPU times of a command [s]."""
    return [record["cpu_s"][command] for record in records]


def breakdown(records: Sequence[Record]) -> Parts:
    """Split the median time of a plan into its parts, by medians."""
    total = statistics.median(wall_times(records, PLAN))
    first, again, leaving = (
        statistics.median(record["plan_s"][name] for record in records)
        for name in ("first_s", "again_s", "exit_s")
    )
    parts = {_INTERPRETER: statistics.median(wall_times(records, NOTHING))}
    parts |= {f"import {name}": seconds for name, seconds in _imports(records).items()}
    parts |= {_BUILDING: max(0.0, first - again), _PLANNING: again, _EXIT: leaving}
    return parts | {_REST: total - sum(parts.values())}


def _imports(records: Sequence[Record]) -> Parts:
    """Median import time of each group of packages, longest first."""
    rounds = []
    for record in records:
        groups: Parts = {}
        for package, seconds in record["imports_s"].items():
            group = _PACKAGES.get(package, "other packages")
            groups[group] = groups.get(group, 0.0) + seconds
        rounds.append(groups)
    all_groups = {group for groups in rounds for group in groups}
    medians = {g: statistics.median(one.get(g, 0.0) for one in rounds) for g in all_groups}
    return dict(sorted(medians.items(), key=lambda item: -item[1]))


def report_lines(records: Sequence[Record], parts: Parts, scenario: str) -> list[str]:
    """Everything the report says of a cold start."""
    rows = []
    for command, name in names(scenario).items():
        wall = [1e3 * seconds for seconds in wall_times(records, command)]
        cpu = [1e3 * seconds for seconds in cpu_times(records, command)]
        rows.append(
            (f"`{name}`", *(quantiles(times, (0.0, 0.5, 0.9), ".0f") for times in (wall, cpu)))
        )
    plans, alone = wall_times(records, PLAN), wall_times(records, CASADI)
    ratios = [a / b for a, b in zip(plans, alone, strict=True)]
    total = statistics.median(plans)
    work = statistics.median(cpu_times(records, PLAN)) / statistics.median(
        cpu_times(records, CASADI)
    )
    return [
        "## From the shell",
        "",
        *table(
            (
                "command",
                "wall time [ms] least / median / p90",
                "CPU time [ms] least / median / p90",
            ),
            rows,
        ),
        f"A plan takes {total / statistics.median(alone):.2f} times as long as importing CasADi "
        f"(ratio of the medians of {len(records)} rounds; median of the rounds' ratios "
        f"{np.median(ratios):.2f}, least time over least time {min(plans) / min(alone):.2f}, "
        f"medians of CPU time {work:.2f}).",
        "",
        *figure(FIGURE, "Cold start: every process (dots) and medians, and where the time goes."),
        "## Where the time goes",
        "",
        *table(
            ("part", "time [ms]", "share"),
            [(name, milliseconds(s), percent(s / total)) for name, s in parts.items()],
        ),
        "## Limitations",
        "",
        "- Files are in the operating system's cache and byte code is compiled: cold means a new "
        "process, not a machine that was just started.",
        "- Import times are own times under `-X importtime`, which slows importing a little; "
        "native libraries count for the package that loads them. `import twosra_mpc` includes "
        "building its validated models.",
        "- Building functions is the first plan in a process less the second one; exit is the time "
        "from a process's last statement to its end. Everything else is the difference to the "
        "whole: printing, and noise between processes.",
        "",
    ]
