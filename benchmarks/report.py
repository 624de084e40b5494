"""Reports: Markdown templates filled with tables, and how numbers are written in them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from benchmarks.measurement import PlanRecord
from benchmarks.run import results_of
from benchmarks.run_log import RunLog
from benchmarks.study import Study
from twosra_mpc.errors import printable
from twosra_mpc.files import reading, write_text

NAME = "report.md"


def write_report(study: Study, log: RunLog, folder: Path) -> str:
    """Write report and figures of a study that was run to its end; return the report.

    Its template has the name of the study's module. It gets the study, its results, the log's
    facts, and what the study's own ``report`` adds.

    Raises:
        InputError: If records in the log are not such as the study makes.
    """
    template = _ENVIRONMENT.get_template(f"{type(study).__module__.rpartition('.')[2]}.md")
    results = results_of(study, log)
    given = {"study": study, "results": results, "loads": log.loads, "about": log.about}
    with reading(str(log.path), "records"):
        text = template.render(**given, **study.report(results, folder))
    text = printable(text, len(text))  # whatever words a record has
    write_text(folder / NAME, text)
    return text


def head(columns: str) -> str:
    """Begin a Markdown table with columns that are separated by bars."""
    return f"| {columns} |\n|{'---|' * (columns.count('|') + 1)}"


def figure(file: str, caption: str) -> str:
    """Show a figure with its caption."""
    return f"![{caption}]({file})\n\n*{caption}*"


def joined(values: Iterable[Any], form: str = "") -> str:
    """Numbers in one table cell, separated by slashes; a dash without any."""
    return " / ".join(f"{value:{form}}" for value in values) or "-"


def words(value: Any) -> str:
    """A value in a table cell."""
    text = ", ".join(map(words, value)) if isinstance(value, list | tuple) else str(value)
    return text.replace("|", "/")


def share(flags: Iterable[bool]) -> str:
    """A rate with what it counts, e.g. ``99 % (99 of 100)``."""
    counted = list(flags)
    return f"{100 * np.mean(counted):.3g} % ({sum(counted)} of {len(counted)})"


def milliseconds(seconds: float) -> str:
    """A time in ms, three digits."""
    value = 1e3 * seconds
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def percent(ratio: float | None) -> str:
    """A ratio in percent, two digits; a dash where there is none."""
    return "-" if ratio is None else f"{100 * ratio:.2g} %"


def quantiles(
    values: Iterable[float | None], at: Sequence[float], form: str, scale: float = 1.0
) -> str:
    """Quantiles of what is known, separated by slashes; a dash where nothing is."""
    known = [scale * value for value in values if value is not None]
    return joined(np.quantile(known, at) if known else (), form)


def shifted_geometric_mean(values: Sequence[float], shift: float) -> float:
    """Geometric mean of ``values + shift``, less ``shift``; small values weigh little in it."""
    return float(np.exp(np.log(np.asarray(values) + shift).mean()) - shift)


def power_law(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Fit y = scale * x ** slope by least squares of the logarithms; return (scale, slope)."""
    slope, offset = np.polyfit(np.log(x), np.log(y), 1)
    return float(np.exp(offset)), float(slope)


def worst(plans: Mapping[str, PlanRecord], others: Mapping[str, PlanRecord], most: int = 5) -> str:
    """List the slowest plans, the largest gaps, and every plan and other one not correct."""
    slow = sorted(plans.items(), key=lambda item: -item[1].timing.median_s)[:most]
    loose = sorted(plans.items(), key=lambda item: -(item[1].gap or 0.0))[:most]
    slowest = (f"{label} ({milliseconds(plan.timing.median_s)} ms)" for label, plan in slow)
    loosest = (f"{label} ({percent(plan.gap)})" for label, plan in loose)
    lines = [f"- Slowest: {', '.join(slowest)}.", f"- Largest proved gaps: {', '.join(loosest)}."]
    for label, plan in {**plans, **others}.items():
        if not plan.correct:
            words = "says it has a plan, which does not verify" if plan.success else plan.message
            lines.append(f"- Not correct: {label} ({plan.status}): {words}")
    return "\n".join(lines)


_ENVIRONMENT = Environment(  # Markdown, which needs no escaping
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    autoescape=False,
)
_ENVIRONMENT.filters |= {
    item.__name__: item for item in (joined, words, share, milliseconds, percent, quantiles)
}
_ENVIRONMENT.globals |= {"head": head, "figure": figure, "worst": worst}
