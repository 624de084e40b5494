"""Sections of the report; what the paper says in each is in ``paper.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from twosra_mpc.files import data_file
from twosra_mpc.lab.paper.claims import Claim, Reading, every

Tell = Callable[[str], None]
Data = dict[str, Any]  # plain data of a section, of which its claims, tables and figures are made


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


def declared(
    name: str,
    found: Data | None,
    tables: Iterable[Table] = (),
    pictures: Iterable[str] = (),
    *,
    missing: bool = False,
    others: Iterable[Claim] = (),
) -> Section:
    """A section with what the paper says in it.

    Args:
        name: Of the section.
        found: Numbers by name; None where there is no data.
        tables: Further numbers.
        pictures: Files of figures.
        missing: Whether to say what to give.
        others: Claims that are not declared, shown first.
    """
    about = tomllib.loads(data_file("lab/paper/paper.toml"))[name]
    claims = (_claim(found, **one) for one in about.get("claims", ()))
    return Section(
        name=name,
        title=about["title"],
        words=(about["words"].format_map(found or {}),),
        claims=(*others, *claims),
        tables=tuple(tables),
        pictures=tuple(Picture(file, about["pictures"][file]) for file in pictures),
        missing=about["missing"] if missing else "",
    )


def _claim(
    found: Data | None, words: str, where: str, readings: list[dict[str, Any]], note: str = ""
) -> Claim:
    made = tuple(_reading(found, **one) for one in readings)
    return Claim(words, where, made, note.format_map(found or {}))


def _reading(found: Data | None, words: str, **rule: Any) -> Reading:
    name = rule.pop("ours", None) or rule["every"]
    ours = None if found is None else found[name]
    if "every" in rule:
        return every(words, ours)
    rule = {"unit": "", "holds": 0.0, "caveat": 0.0, **rule}
    if "share" in rule:
        size = abs(rule["published"])
        rule["holds"], rule["caveat"] = (share * size for share in rule.pop("share"))
    return Reading(words, ours=ours, **rule)


def percent(share: float | None) -> str:
    """A share of 0 to 1 in a table; what is too small for it is not called zero."""
    if share is None:
        return "none"
    return "below 0.01 %" if 0 < share < 1e-4 else f"{100 * share:z.2f} %"
