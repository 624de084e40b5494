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
from twosra_mpc.files import write_text

NAME = "report.md"
_AT = (0.5, 0.9, 0.99, 1.0)

Row = dict[str, str]  # column -> cell


def write_report(study: Study, log: RunLog, folder: Path) -> str:
    """Write report and figures of a study that was run to its end; return the report."""
    about = log.about
    text = _ENVIRONMENT.get_template(f"{type(study).__module__.rpartition('.')[2]}.md").render(
        name=about["study"],
        question=study.question,
        facts=_pairs("machine and versions", {**about["machine"], **about["versions"]}),
        settings=_pairs("setting", about["settings"]),
        loads=log.loads,
        **study.report(results_of(study, log), folder),
    )
    write_text(folder / NAME, text)
    return text


def _pairs(title: str, facts: Mapping[str, Any]) -> list[Row]:
    words = {key: ", ".join(map(str, v)) if isinstance(v, list) else v for key, v in facts.items()}
    return [{title: key, "": str(value)} for key, value in words.items()]


def table(rows: Sequence[Row]) -> str:
    """Write a Markdown table; the first row's keys are the header."""
    lines = [rows[0].keys(), ["---"] * len(rows[0]), *(row.values() for row in rows)]
    cells = ([cell.replace("|", "/") for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


def figure(file: str, caption: str) -> str:
    """Show a figure with its caption."""
    return f"![{caption}]({file})\n\n*{caption}*"


def share(flags: Sequence[bool]) -> str:
    """A rate with what it counts, e.g. ``99 % (99 of 100)``."""
    return f"{100 * sum(flags) / len(flags):.3g} % ({sum(flags)} of {len(flags)})"


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
    return " / ".join(f"{np.quantile(known, q):{form}}" for q in at) if known else "-"


def shifted_geometric_mean(values: Sequence[float], shift: float) -> float:
    """Geometric mean of ``values + shift``, less ``shift``; small values weigh little in it."""
    return float(np.exp(np.log(np.asarray(values) + shift).mean()) - shift)


def power_law(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Fit y = scale * x ** slope by least squares of the logarithms; return (scale, slope)."""
    slope, offset = np.polyfit(np.log(x), np.log(y), 1)
    return float(np.exp(offset)), float(slope)


def summary(plans: Sequence[PlanRecord]) -> Row:
    """Sum up plans of several problems."""
    warm = [plan.timing for plan in plans]
    return {
        "success rate": share([plan.success for plan in plans]),
        "correct rate": share([plan.correct for plan in plans]),
        "proved optimal": str(sum(plan.status == "optimal" for plan in plans)),
        "proved infeasible": str(sum(plan.status == "infeasible" for plan in plans)),
        "stopped early": str(sum(plan.stopped_early for plan in plans)),
        "different sequences": str(len({plan.sequence for plan in plans})),
        "solved median / max": quantiles([plan.solved for plan in plans], (0.5, 1.0), ".0f"),
        "cost [s] median / max": quantiles([plan.cost for plan in plans], (0.5, 1.0), ".1f"),
        "gap [%] median / p90 / max": quantiles(
            [plan.gap for plan in plans], (0.5, 0.9, 1.0), ".2g", 100
        ),
        "wall time [ms] median / p90 / p99 / max": quantiles(
            [timing.median_s for timing in warm], _AT, ".1f", 1e3
        ),
        "CPU time [ms] median / p90 / p99 / max": quantiles(
            [timing.cpu_median_s for timing in warm], _AT, ".1f", 1e3
        ),
        "longest first call [ms]": milliseconds(max(timing.first_s for timing in warm)),
    }


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
_ENVIRONMENT.filters |= {"table": table, "milliseconds": milliseconds, "quantiles": quantiles}
_ENVIRONMENT.globals |= {"figure": figure}
