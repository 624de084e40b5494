"""Reference curvatures of photographs, and how far estimates are from them.

A CSV file with a column of curvatures [1/m]. A column ``picture`` with names of files says whose
they are; without one, a picture's number (``picture-017.png``: 17) is its row, the first being 0.
"""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from twosra_mpc.errors import InputError
from twosra_mpc.files import read_text, reading
from twosra_mpc.lab.photographs.picture import number_of
from twosra_mpc.robot.coordinates import Array

PICTURE = "picture"
POINTS = 27  # places of a cycle at which repeats are averaged
_SMOOTHED = 2.0  # pictures: a cycle's top is not one of its wiggles


class Deviation(NamedTuple):
    """Distance of estimates from references: of single pictures, and of means of the repeats.

    Attributes:
        pictures: How many have both.
        mse_per_m2: Mean square of the difference [1/m2].
        slope: Of the estimates over the references, through zero.
        cycles: Repeats (load and unload) found in the references.
        cycle_mse_per_m2: Mean square of the difference of their means; NaN without repeats.
    """

    pictures: int
    mse_per_m2: float
    slope: float
    cycles: int
    cycle_mse_per_m2: float


def read_references(path: str | Path, column: str, pictures: Sequence[Path]) -> Array:
    """Read the curvature of each picture from a CSV file.

    Args:
        path: The file.
        column: Heading of the curvatures [1/m].
        pictures: Paths of the pictures.

    Returns:
        Curvatures [1/m], (pictures,).

    Raises:
        InputError: If the file cannot be read, a column is missing or given twice, a curvature is
            no finite number (with its row, the first being 0), or a picture has none or two.
    """
    with reading(str(path), "references"):
        return _read(Path(path), column, pictures)


def _read(path: Path, column: str, pictures: Sequence[Path]) -> Array:
    source = str(path)
    rows = csv.reader(read_text(path, source).splitlines())
    names = [name.strip() for name in next(rows, [])]
    if names.count(column) != 1:
        given = "given twice" if column in names else "missing"
        raise InputError(f"column {column}", given, f"one of {', '.join(names) or 'any'}", source)
    if names.count(PICTURE) > 1:
        raise InputError(f"column {PICTURE}", "given twice", "one, or none", source)
    table = [row for row in rows if any(cell.strip() for cell in row)]
    row_of = _rows_by_name(table, names.index(PICTURE), source) if PICTURE in names else None
    found = []
    for picture in pictures:
        number = number_of(picture.stem) if row_of is None else row_of.get(picture.name, math.inf)
        if not number < len(table):
            allowed = f"pictures with a row of their own; there are {len(table)}, from 0"
            raise InputError(PICTURE, picture.name, allowed, source)
        found.append(_curvature(table, int(number), names.index(column), column, source))
    return np.array(found)


def _rows_by_name(table: list[list[str]], column: int, source: str) -> dict[str, float]:
    rows: dict[str, float] = {}
    for number, row in enumerate(table):
        name = row[column].strip() if column < len(row) else ""
        if name in rows or not name:
            allowed = "the name of a file that no other row has"
            raise InputError(f"{PICTURE}, row {number}", name, allowed, source)
        rows[name] = number
    return rows


def _curvature(table: list[list[str]], row: int, at: int, column: str, source: str) -> float:
    text = table[row][at] if at < len(table[row]) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{column}, row {row}", text, "a finite number", source)
    return value


def load_cycles(reference: Array) -> list[slice]:
    """Cut a series of curvatures (n,) after its least bends between the tops of load and unload."""
    bend = np.abs(reference)
    smooth = gaussian_filter1d(bend, _SMOOTHED, mode="nearest")
    high = smooth > smooth.max() / 2
    edges = np.flatnonzero(np.diff(np.concatenate([[False], high, [False]]).astype(int)))
    tops = [a + int(np.argmax(smooth[a:b])) for a, b in edges.reshape(-1, 2)]
    cuts = [a + int(np.argmin(bend[a:b])) + 1 for a, b in itertools.pairwise(tops)]
    return [slice(a, b) for a, b in zip([0, *cuts], [*cuts, len(bend)], strict=True)]


def mean_of_cycles(values: Array, cycles: Sequence[slice]) -> Array:
    """Average repeats of a series (n,), each resampled to POINTS places, (POINTS,)."""
    here = np.linspace(0.0, 1.0, POINTS)
    each = [np.interp(here, np.linspace(0.0, 1.0, len(v)), v) for v in (values[c] for c in cycles)]
    mean: Array = np.mean(each, axis=0)
    return mean


def deviation(series: Sequence[tuple[Array, Array]]) -> Deviation:
    """Compare estimates with references.

    Args:
        series: Estimates and references [1/m] of each folder, (n,) each; NaN is not known.
    """
    known = [(e[ok], r[ok]) for e, r in series if (ok := np.isfinite(e) & np.isfinite(r)).any()]
    if not known:
        return Deviation(0, math.nan, math.nan, 0, math.nan)
    estimate, reference = (np.concatenate(each) for each in zip(*known, strict=True))
    cut = [load_cycles(r) for _, r in known]
    means = [
        mean_of_cycles(e, cycles) - mean_of_cycles(r, cycles)
        for (e, r), cycles in zip(known, cut, strict=True)
    ]
    repeated = all(len(cycles) > 1 for cycles in cut)
    power = float(reference @ reference)
    return Deviation(
        pictures=len(reference),
        mse_per_m2=float(np.mean((estimate - reference) ** 2)),
        slope=float(estimate @ reference) / power if power else math.nan,
        cycles=sum(map(len, cut)),
        cycle_mse_per_m2=float(np.mean(np.concatenate(means) ** 2)) if repeated else math.nan,
    )
