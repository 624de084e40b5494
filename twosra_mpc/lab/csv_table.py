"""Logs as CSV files: a heading with the names of the columns, and a row for each record."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.files import LARGEST, read_text, reading
from twosra_mpc.robot.coordinates import Array

_FINER = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
_ROWS_S = 0.004, 4.0  # from row to row, of a log


class CsvTable(NamedTuple):
    """Rows of a CSV file below its heading, without empty ones.

    Attributes:
        source: Name of the file.
        names: Names of the columns.
        rows: Cells of each row; a short row has fewer.
    """

    source: str
    names: list[str]
    rows: list[list[str]]

    def check(self, columns: Sequence[str], least_rows: int = 1) -> None:
        """Refuse a table without these columns, or with one of them twice, or with fewer rows.

        Raises:
            InputError: Naming the column.
        """
        for column in columns:
            if self.names.count(column) != 1:
                given = "given twice" if column in self.names else "missing"
                allowed = f"a heading with one each of the columns {', '.join(columns)}"
                hint = f"its heading is {','.join(self.names)!r}." if self.names else ""
                raise InputError(f"column {column}", given, allowed, self.source, hint=hint)
        if len(self.rows) < least_rows:
            allowed = f"at least {'one row' if least_rows == 1 else least_rows} below the heading"
            raise InputError("rows", len(self.rows), allowed, self.source)

    def texts(self, column: str) -> list[str]:
        """Cells of a column, without blanks around them; of a short row it is empty."""
        at = self.names.index(column)
        return [row[at].strip() if at < len(row) else "" for row in self.rows]

    def numbers(self, *columns: str) -> Array:
        """Numbers in some columns, (rows, columns).

        Raises:
            InputError: If a cell is no finite number; column and row, from 1, are named.
        """
        found = [
            [number(text, f"{column}, row {row}", self.source) for row, text in enumerate(texts, 1)]
            for column, texts in zip(columns, map(self.texts, columns), strict=True)
        ]
        return np.array(found, dtype=float).reshape(len(columns), -1).T


def read_csv(
    path: str | Path, columns: Sequence[str], what: str = "log", least_rows: int = 1
) -> CsvTable:
    """Read a CSV file that has these columns.

    Cells are parted by whichever of comma, semicolon and tab the heading has most of; where that is
    no comma, numbers may have a decimal comma.

    Args:
        path: The file.
        columns: Names of columns that must be there, each once.
        what: Kind of file, to be named in errors.
        least_rows: Rows that it must have.

    Raises:
        InputError: If it cannot be read, a column is missing or given twice, or rows are missing.
    """
    source = str(path)
    with reading(source, what):
        lines = read_text(Path(path), source).splitlines()
        mark = max(",;\t", key=next(filter(str.strip, lines), "").count)
        filled = [row for row in csv.reader(lines, delimiter=mark) if any(map(str.strip, row))]
        names, *rows = filled or [[]]
    if mark != ",":
        rows = [[cell.replace(",", ".") for cell in row] for row in rows]
    table = CsvTable(source, [name.strip() for name in names], rows)
    table.check(columns, least_rows)
    return table


def number(text: str, field: str, source: str) -> float:
    """Return the number in a cell.

    Raises:
        InputError: If it is none, or not finite, or beyond ``LARGEST``.
    """
    try:
        value = math.nan if "_" in text else float(text)  # Python takes 1_5 for 15
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        of_clock = math.isfinite(value) and field.startswith("time")
        hint = "are these milliseconds of a clock, or less? Times are seconds." if of_clock else ""
        allowed = f"a finite number, at most {LARGEST:zg} in size"
        raise InputError(field, text, allowed, source, hint=hint)
    return value


def numbers_in(text: str, field: str, allowed: str, count: int | None = None) -> list[float]:
    """Return the numbers, so many if that is told, of an option: parted by commas.

    Raises:
        InputError: If it has others.
    """
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or len(found) != (count or len(found)):
        raise InputError(field, text, allowed)
    return found


def finer_unit(time_s: Array) -> str:
    """Ask for the unit of times (rows,) too far apart for seconds; empty if they are not."""
    step = float(np.median(np.abs(np.diff(time_s)))) if len(time_s) > 1 else 0.0
    of_log = (unit for unit, many in _FINER.items() if _ROWS_S[0] <= step / many <= _ROWS_S[1])
    unit = next(of_log, "") if step > _ROWS_S[1] else ""
    return f"are these {unit}? Times are seconds." if unit else ""
