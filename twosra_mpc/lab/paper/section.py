"""Sections of the report, their claims as numbers, and the verdict on each of them by a rule.

What the paper says in each section is in ``paper.toml``. A claim has one reading or several, for a
text may mean more than one thing ("the last mode": of all iterations, or of those that were
recorded?). The rule of a reading is how far our number may be from the published one for it to
hold, and how far with a caveat. A claim holds if all its readings do, does not hold if none does
even with a caveat, and holds with a caveat in between. Readings without data are left out.
"""

from __future__ import annotations

import string
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

from twosra_mpc.arguments import Word
from twosra_mpc.files import attributes, data_file
from twosra_mpc.robot.modes import sequence_name


class Verdict(Word):
    """Verdict of our numbers on a claim."""

    HOLDS = "holds"
    CAVEAT = "holds with a caveat"
    FAILS = "does not hold"
    UNDECIDED = "undecided: no plan was found"
    UNCHECKED = "cannot be checked: no data"


PAPER = tomllib.loads(data_file("lab/paper/paper.toml"))
_DIRECTION = {"equal": "off", "at most": "above", "at least": "below"}


@dataclass(frozen=True)
class Reading:
    """One way to put a claim in numbers.

    Attributes:
        words: What is counted or measured.
        published: What the paper says, in ``unit``.
        ours: What we find, in ``unit``; None without data.
        unit: Of both; empty for plain numbers.
        holds: How far off it holds.
        caveat: How far off it holds with a caveat.
        sense: Which differences count: both, or only those above or below what is published.
    """

    words: str
    published: float
    ours: float | None
    unit: str
    holds: float
    caveat: float
    sense: Literal["equal", "at most", "at least"] = "equal"

    @property
    def difference(self) -> float | None:
        """Ours less published, None without data."""
        return None if self.ours is None else self.ours - self.published

    @property
    def verdict(self) -> Verdict:
        """Verdict by the rule; a number that is none (NaN) does not hold."""
        if self.difference is None:
            return Verdict.UNCHECKED
        above = {"equal": abs(self.difference), "at most": self.difference}
        off = above.get(self.sense, -self.difference)
        if off <= self.holds:
            return Verdict.HOLDS
        return Verdict.CAVEAT if off <= self.caveat else Verdict.FAILS

    @property
    def rule(self) -> str:
        """The rule in words."""
        unit, where = f" {self.unit}" if self.unit else "", _DIRECTION[self.sense]
        exactly = {"equal": "exactly", "at most": "not above", "at least": "not below"}[self.sense]
        first = f"up to {self.holds:z.3g}{unit} {where}" if self.holds else exactly
        if self.caveat <= self.holds:
            return first
        return f"{first}; with a caveat up to {self.caveat:z.3g}{unit} {where}"


@dataclass(frozen=True)
class Claim:
    """Claim of the paper, its place, and what comes of it.

    Attributes:
        words: The claim, in our words.
        where: Section, figure or table of the paper.
        readings: At least one.
        note: What to know of it, if anything.
        undecided: Whether it rests on a plan that was not found, though there may be one.
    """

    words: str
    where: str
    readings: tuple[Reading, ...]
    note: str = ""
    undecided: bool = False

    @property
    def verdict(self) -> Verdict:
        """On all readings that have data together."""
        if self.undecided:
            return Verdict.UNDECIDED
        found = {reading.verdict for reading in self.readings} - {Verdict.UNCHECKED}
        if not found:
            return Verdict.UNCHECKED
        return found.pop() if len(found) == 1 else Verdict.CAVEAT

    def document(self) -> dict[str, Any]:
        """The claim as plain data, verdicts and rules in words."""
        worked_out = "difference", "rule", "verdict"
        readings = [{**asdict(one), **attributes(one, *worked_out)} for one in self.readings]
        return {
            "claim": self.words,
            "where": self.where,
            "verdict": str(self.verdict),
            "readings": readings,
            "note": self.note,
        }


def every(words: str, share: float | None) -> Reading:
    """Reading of a claim about all cases, by the share (0 to 1) in which it holds.

    It holds with a caveat where it is so in four cases of five.
    """
    percent = None if share is None else 100.0 * share
    return Reading(words, 100.0, percent, "%", 0.0, 20.0, "at least")


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


class _Cells(string.Formatter):
    """Formats of cells, to which ``!m`` is a sequence of modes, and ``!p`` a share in per cent.

    What is not known is a dash, and a text stays as it is.
    """

    def convert_field(self, value: Any, conversion: Any) -> Any:
        words: dict[Any, Callable[[Any], str]] = {"m": sequence_name, "p": percent}
        if conversion not in words:
            return super().convert_field(value, conversion)
        return value if isinstance(value, str) else words[conversion](value)

    def format_field(self, value: Any, format_spec: str) -> str:
        if value is None:
            return "-"
        return value if isinstance(value, str) else super().format_field(value, format_spec)


def _table(about: Data, found: Data, lines: Iterable[Data]) -> Table:
    """Make a table as declared: a row for each line of data."""
    cells = (tuple(_Cells().vformat(one, (), line) for one in about["cells"]) for line in lines)
    caption, header = about["caption"].format_map(found), tuple(about["header"])
    return Table(caption, header, tuple(cells), about.get("numbers", 1))


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
    lines: Iterable[Iterable[Data]] = (),
    pictures: Iterable[str] = (),
    *,
    missing: bool = False,
    others: Iterable[Claim] = (),
) -> Section:
    """A section with what the paper says in it.

    Args:
        name: Of the section.
        found: Numbers by name; None where there is no data.
        lines: Of each of its tables, the data of its rows.
        pictures: Files of figures.
        missing: Whether to say what to give.
        others: Claims that are not declared, shown first.
    """
    about = PAPER[name]
    claims = (
        Claim(
            one["words"],
            one["where"],
            tuple(_reading(found, **each) for each in one["readings"]),
            one.get("note", "").format_map(found or {}),
        )
        for one in about.get("claims", ())
    )
    return Section(
        name=name,
        title=about["title"],
        words=(about["words"].format_map(found or {}),),
        claims=(*others, *claims),
        tables=tuple(
            _table(each, found or {}, of)
            for each, of in zip(about.get("tables", ()), lines, strict=False)
        ),
        pictures=tuple(Picture(file, about["pictures"][file]) for file in pictures),
        missing=about["missing"] if missing else "",
    )


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
