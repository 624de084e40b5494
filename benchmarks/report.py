"""Reports: Markdown templates filled with tables, and how numbers are written in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from benchmarks.measurement import PlanRecord
from benchmarks.run import results_of
from benchmarks.run_log import RunLog
from benchmarks.study import Study
from twosra_mpc import InputError
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
    with reading(str(log.path), "records"):
        text = _template(study).render(**_given(study, log, folder))
    text = printable(text, len(text))  # whatever words a record has
    write_text(folder / NAME, text)
    return text


def published_tables(study: Study, log: RunLog, folder: Path) -> dict[str, list[tuple[str, ...]]]:
    """Cells of the tables that a finished study publishes, the names of the columns first.

    They are the blocks ``table``, ``table_boxes`` and so on of its template; here they go by what
    follows after ``table``.

    Raises:
        InputError: As `write_report`; or if the study publishes none.
    """
    template = _template(study)
    with reading(str(log.path), "records"):
        given = template.new_context(_given(study, log, folder))
        names = [name for name in template.blocks if name.startswith("table")]
        texts = {name: "".join(template.blocks[name](given)) for name in names}
    tables = {name.removeprefix("table"): text for name, text in texts.items() if "|" in text}
    if not tables:
        raise InputError("study", log.about["study"], "one whose template has a block named table")
    return {name: _cells(printable(text, len(text))) for name, text in tables.items()}


def _template(study: Study) -> Template:
    return _ENVIRONMENT.get_template(f"{type(study).__module__.rpartition('.')[2]}.md")


def _given(study: Study, log: RunLog, folder: Path) -> dict[str, Any]:
    """All that templates may ask for."""
    results = results_of(study, log)
    cpu_s = sum(log.cpu_s.values())
    given = {"study": study, "results": results, "cpu_s": cpu_s, "about": log.about}
    told = study.report(results)
    for file, draw in told.pop("figures", {}).items():
        draw(folder / file)
    return {**given, **told}


def _cells(table: str) -> list[tuple[str, ...]]:
    """Cells of a Markdown table, row by row."""
    lines = [line.strip()[1:-1].split("|") for line in table.splitlines() if line.startswith("|")]
    head, _, *rows = [tuple(cell.strip() for cell in line) for line in lines]
    return [head, *rows]


def number(value: float, form: str) -> str:
    """A number, without the sign of what is rounded to zero."""
    return format(value, f"z{form}") if form else str(value)


def head(columns: str) -> str:
    """Begin a Markdown table with columns that are separated by bars."""
    return f"| {columns} |\n|{'---|' * (columns.count('|') + 1)}"


def table(rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table of texts, the names of the columns first."""
    return "\n".join([head(" | ".join(rows[0])), *(f"| {' | '.join(row)} |" for row in rows[1:])])


def figure(file: str, caption: str) -> str:
    """Show a figure with its caption."""
    return f"![{caption}]({file})\n\n*{caption}*"


def joined(values: Iterable[Any], form: str = "") -> str:
    """Numbers in one table cell, separated by slashes; a dash without any."""
    return " / ".join(number(value, form) for value in values) or "-"


def words(value: Any) -> str:
    """A value in a table cell."""
    text = ", ".join(map(words, value)) if isinstance(value, list | tuple) else str(value)
    return text.replace("|", "/")


def share(flags: Iterable[bool]) -> str:
    """A rate with what it counts, e.g. ``99 % (99 of 100)``."""
    counted = list(flags)
    return f"{100 * np.mean(counted):z.3g} % ({sum(counted)} of {len(counted)})"


def counted(values: Iterable[str]) -> str:
    """How often there is each of some words, e.g. ``2 sensor failed, 1 gave up``; or a dash."""
    return ", ".join(f"{count} {word}" for word, count in Counter(values).most_common()) or "-"


def milliseconds(seconds: float) -> str:
    """A time in ms, three digits."""
    value = 1e3 * seconds
    return f"{value:z.0f}" if value >= 100 else f"{value:z.3g}"


def percent(ratio: float | None) -> str:
    """A ratio in percent, two digits; a dash where there is none."""
    return "-" if ratio is None else f"{100 * ratio:z.2g} %"


def quantiles(
    values: Iterable[float | None], at: Sequence[float], form: str, scale: float = 1.0
) -> str:
    """Quantiles of what is known, separated by slashes; a dash where nothing is."""
    known = [scale * value for value in values if value is not None]
    return joined(np.quantile(known, at) if known else (), form)


def shifted_geometric_mean(values: Sequence[float], shift: float) -> float:
    """Geometric mean of ``values + shift``, less ``shift``; small values weigh little in it."""
    return float(np.exp(np.log(np.asarray(values) + shift).mean()) - shift)


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
    item.__name__: item
    for item in (number, joined, words, share, counted, milliseconds, percent, quantiles)
}
_ENVIRONMENT.globals |= {"head": head, "table": table, "figure": figure, "worst": worst}
