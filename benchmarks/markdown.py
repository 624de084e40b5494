"""Markdown: tables, and how numbers are written in them."""

from __future__ import annotations

from collections.abc import Sequence


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table, with an empty line behind it."""
    return [
        f"| {' | '.join(header)} |",
        f"|{'---|' * len(header)}",
        *(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows),
        "",
    ]


def share(part: int, whole: int) -> str:
    """A rate with what it counts, e.g. ``99 % (99 of 100)``."""
    return f"{100 * part / whole:.3g} % ({part} of {whole})" if whole else "-"


def milliseconds(seconds: float) -> str:
    """A time in ms, three digits."""
    value = 1e3 * seconds
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def percent(ratio: float | None) -> str:
    """A ratio in percent, two digits; a dash where there is none."""
    return "-" if ratio is None else f"{100 * ratio:.2g} %"


def figure(file: str, caption: str) -> list[str]:
    """A figure with its caption."""
    return [f"![{caption}]({file})", "", f"*{caption}*", ""]
