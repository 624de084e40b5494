"""Sections of the report."""

from __future__ import annotations

from dataclasses import dataclass

from twosra_mpc.lab.paper.claims import Claim


@dataclass(frozen=True)
class Picture:
    """A figure: its file in the report's folder, and what it shows."""

    file: str
    words: str


@dataclass(frozen=True)
class Table:
    """A table of texts; columns from ``numbers`` on are numbers."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: int = 1


@dataclass(frozen=True)
class Section:
    """A part of the paper, and what comes of it.

    Attributes:
        name: Of the section's data in the report's JSON file.
        title: Heading.
        words: Paragraphs: what was computed, and how.
        claims: What the paper says of it.
        tables: Further numbers.
        pictures: Figures.
        missing: What to give for what could not be computed; empty if nothing is missing.
    """

    name: str
    title: str
    words: tuple[str, ...]
    claims: tuple[Claim, ...]
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    missing: str = ""


def percent(share: float | None) -> str:
    """A share of 0 to 1 in a table; what is too small for it is not called zero."""
    if share is None:
        return "none"
    return "below 0.01 %" if 0 < share < 1e-4 else f"{100 * share:z.2f} %"
