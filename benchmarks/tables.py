"""Tables of README and documentation, written from records between markers.

``<!-- table: NAME -->`` begins a table, ``<!-- end of table: NAME -->`` ends it; of several names
rows stand below one another. Changes since a table was measured are told in a line of its own, as
they were when it was written last. The built documentation writes it anew.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from benchmarks.records import ROOT, Record, load_records
from twosra_mpc import InputError
from twosra_mpc.files import read_text, write_text

_MARKED = re.compile(
    r"^<!-- table: (?P<names>[^\n]*) -->\n.*?^<!-- end of table: (?P=names) -->$",
    re.DOTALL | re.MULTILINE,
)
_CHANGED = re.compile(r"^\*Changed since then in [^\n]*\*\n\n", re.MULTILINE)


def pages(root: Path = ROOT) -> list[Path]:
    """README and all pages of the documentation."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def filled(text: str, records: Mapping[str, Record], root: Path = ROOT) -> str:
    """A page with all of its tables written anew.

    Raises:
        InputError: If a table asks for a record that is not there, or for records whose columns
            differ.
    """
    return _MARKED.sub(lambda found: _table(found["names"], records, root), text)


def unmarked(text: str) -> str:
    """A page without what it says of changes since its tables were measured."""
    return _CHANGED.sub("", text)


def named(text: str) -> list[str]:
    """Names of the records that a page shows."""
    return [name for found in _MARKED.finditer(text) for name in found["names"].split()]


def write_tables(root: Path = ROOT, folder: Path | None = None) -> list[str]:
    """Write all tables anew; names of the records of which something measured has changed.

    Raises:
        InputError: As `filled`; or if a record stands in no page, or a page cannot be written.
    """
    records = load_records(folder or root / "benchmarks" / "records")
    shown = list[str]()
    for path in pages(root):
        text = read_text(path, str(path))
        shown += named(text)
        if (now := filled(text, records, root)) != text:
            write_text(path, now)
    for name in records:
        if name not in shown:
            allowed = f"a record with a place: <!-- table: {name} --> in README or docs"
            raise InputError("record", name, allowed)
    return [name for name, record in records.items() if record.changed(root)]


def _table(names: str, records: Mapping[str, Record], root: Path) -> str:
    """A table with its markers."""
    for name in names.split():
        if name not in records:
            raise InputError("table", name, f"one of the records {', '.join(records)}")
    some = [records[name] for name in names.split()]
    if len({record.columns for record in some}) > 1:
        raise InputError("table", names, "records with the same columns")
    rows = [_row(row) for record in some for row in record.rows]
    ruled = [_row(some[0].columns), f"|{'---|' * len(some[0].columns)}", *rows]
    origins = [f"*{record.origin}*" for record in some]
    changed = list(dict.fromkeys(path for record in some for path in record.changed(root)))
    parts = ["\n".join(ruled), *origins]
    if changed:
        folders = ", ".join(path.removeprefix("twosra_mpc/") for path in changed)
        parts.append(f"*Changed since then in twosra_mpc: {folders}.*")
    body = "\n\n".join(parts)
    return f"<!-- table: {names} -->\n\n{body}\n\n<!-- end of table: {names} -->"


def _row(cells: tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"
