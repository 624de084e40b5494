"""Reference curvatures of photographs, and how far estimates are from them.

A CSV file with a column of curvatures [1/m]. A column ``picture`` with names of files says whose
they are; without one, a picture's number (``picture-017.png``: 17) is its row, the first being 0.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from twosra_mpc.errors import InputError
from twosra_mpc.lab.csv_table import CsvTable, number, read_csv
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
    table = read_csv(path, (column,), "references", least_rows=0)
    if (named := table.names.count(PICTURE)) > 1:
        raise InputError(f"column {PICTURE}", "given twice", "one, or none", table.source)
    row_of = _rows_by_name(table) if named else None
    cells, found = table.texts(column), []
    for picture in pictures:
        row = number_of(picture.stem) if row_of is None else row_of.get(picture.name, math.inf)
        if not row < len(cells):
            allowed = f"pictures with a row of their own; there are {len(cells)}, from 0"
            raise InputError(PICTURE, picture.name, allowed, table.source)
        found.append(number(cells[int(row)], f"{column}, row {int(row)}", table.source))
    return np.array(found)


def _rows_by_name(table: CsvTable) -> dict[str, float]:
    rows: dict[str, float] = {}
    for row, name in enumerate(table.texts(PICTURE)):
        if name in rows or not name:
            allowed = "the name of a file that no other row has"
            raise InputError(f"{PICTURE}, row {row}", name, allowed, table.source)
        rows[name] = row
    return rows


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
    return np.mean(each, axis=0)


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
