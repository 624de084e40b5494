"""Folders of photographs: each picture measured or refused by name, and held against references.

References are a CSV file with a column of curvatures [1/m]. A column ``picture`` with names of
files says whose they are; without one, a picture's number (``picture-017.png``: 17) is its row, the
first being 0. A CSV file of all estimates can be written.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from twosra_mpc.errors import InputError
from twosra_mpc.files import write_text
from twosra_mpc.lab.csv_table import CsvTable, number, read_csv
from twosra_mpc.lab.photographs.arc import Arc, fit_arc
from twosra_mpc.lab.photographs.picture import (
    Camera,
    Mask,
    Photograph,
    find_segment,
    number_of,
    pictures_in,
    read_photograph,
)
from twosra_mpc.lab.photographs.published_steps import PublishedCurvature, published_curvature
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


def deviation(folders: Sequence[tuple[Array, Array]]) -> Deviation:
    """Compare estimates with references.

    Args:
        folders: Estimates and references [1/m] of each folder, (n,) each; NaN is not known.
    """
    known = [(e[ok], r[ok]) for e, r in folders if (ok := np.isfinite(e) & np.isfinite(r)).any()]
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


_PUBLISHED = ("spread_per_m", "known")  # fields of the published steps, and of the arc, in tables
_ARC = ("curvature_per_m", "standard_error_per_m", "p_value", "scatter_m", "seen_m")
COLUMNS = (
    *("folder", "picture", "reference_per_m", "published_mean_per_m"),
    *(f"published_{name}" for name in _PUBLISHED),
    *(f"arc_{name.removeprefix('curvature_')}" for name in _ARC),
    "refused",
)
Tell = Callable[[int, int], None]

BANDS = tuple(itertools.pairwise((0.0, 10.0, 20.0, 35.0, 50.0, math.inf)))  # |reference| [1/m]
BAND_NAMES = (*(f"{low:zg} to {high:zg}" for low, high in BANDS[:-1]), f"from {BANDS[-1][0]:zg}")
ESTIMATORS = {"published": "published_per_m", "arc": "arc_per_m"}


@dataclass(frozen=True, eq=False)
class Measured:
    """Both estimates of one picture."""

    photograph: Photograph
    region: Mask
    published: PublishedCurvature
    arc: Arc


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimate of one picture.

    Attributes:
        path: The picture.
        reference_per_m: Its reference [1/m]; NaN if there is none.
        measured: Both estimates; None if the picture was refused.
        refused: Why it was; empty if it was not.
    """

    path: Path
    reference_per_m: float
    measured: Measured | None
    refused: str = ""

    @property
    def arc_per_m(self) -> float:
        """Curvature by the arc [1/m], NaN if refused."""
        return self.measured.arc.curvature_per_m if self.measured else math.nan

    @property
    def published_per_m(self) -> float:
        """Published mean [1/m], NaN if not known; it has no sign but the reference's, or the arc's.

        The published study copied the sign of its references.
        """
        if self.measured is None:
            return math.nan
        known = math.isfinite(self.reference_per_m)
        signed = self.reference_per_m if known else self.arc_per_m
        return math.copysign(self.measured.published.mean_per_m, signed)

    @property
    def record(self) -> dict[str, Any]:
        """Value for each of `COLUMNS`; None where it is not known."""
        parts = (self.measured.published, self.measured.arc) if self.measured else (None, None)
        values = [self.path.parent.name, self.path.name, self.reference_per_m, self.published_per_m]
        for part, names in zip(parts, (_PUBLISHED, _ARC), strict=True):
            values += [getattr(part, name, None) for name in names]
        return dict(zip(COLUMNS, [*values, self.refused or None], strict=True))


def estimate_folder(
    folder: str | Path,
    camera: Camera,
    references: tuple[Path, str] | None = None,
    tell: Tell = lambda _done, _of: None,
) -> list[Estimate]:
    """Estimate the curvature in every picture of a folder.

    Args:
        folder: The folder.
        camera: Scale, length and threshold, and where the segment ends.
        references: CSV file of reference curvatures and the name of its column.
        tell: Is called with how many pictures are done, and of how many.

    Raises:
        InputError: If there is no picture, a file is no image, references are not acceptable, or
            every picture is refused.
    """
    paths = pictures_in(folder)
    given = np.full(len(paths), np.nan)
    if references is not None:
        given = read_references(*references, paths)
    photographs = [read_photograph(path) for path in paths]
    found = []
    for photograph, reference in zip(photographs, given.tolist(), strict=True):
        found.append(_estimate(photograph, reference, camera))
        tell(len(found), len(paths))
    if all(each.refused for each in found):
        allowed = f"one with a picture of a segment; the first was refused: {found[0].refused}"
        raise InputError("folder", str(folder), allowed)
    return found


def _estimate(photograph: Photograph, reference: float, camera: Camera) -> Estimate:
    try:
        region = find_segment(photograph, camera)
        arc = fit_arc(photograph, region, camera)
    except InputError as error:
        return Estimate(photograph.path, reference, None, error.allowed)
    published = published_curvature(photograph, region, camera)
    measured = Measured(photograph, region, published, arc)
    return Estimate(photograph.path, reference, measured)


def save_estimates(estimates: Sequence[Estimate], path: str | Path) -> None:
    """Write a row a picture as CSV (``COLUMNS``), atomically; what is not known is empty.

    Raises:
        InputError: If the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for each in estimates:
        writer.writerow(map(_cell, each.record.values()))
    write_text(path, text.getvalue())


def _cell(value: str | float | None) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:z.6g}"
    return value or ""


def summary(found: Sequence[Sequence[Estimate]]) -> dict[str, Any]:
    """Numbers of folders of estimates; deviations and errors by band only with references."""
    every = [each for one in found for each in one]
    measured = [each.measured for each in every if each.measured is not None]
    spread = np.array([each.published.spread_per_m for each in measured])
    errors = [each.arc.standard_error_per_m for each in measured]
    return {
        "pictures": len(every),
        "refused": len(every) - len(measured),
        "published_mean_spread_per_m": _mean(spread[np.isfinite(spread)]),
        "share_compatible_with_an_arc": _mean([each.arc.fits for each in measured]),
        "median_scatter_m": float(np.median([each.arc.scatter_m for each in measured])),
        "median_standard_error_per_m": float(np.median(errors)),
        "deviations": {
            name: deviation([series(one, name) for one in found]) for name in ESTIMATORS
        },
        "bands_mse_per_m2": {name: _by_band(*series(every, name)) for name in ESTIMATORS},
    }


def series(estimates: Sequence[Estimate], name: str) -> tuple[Array, Array]:
    """Estimates by one of the estimators, and references [1/m], (n,) each."""
    found = [getattr(each, ESTIMATORS[name]) for each in estimates]
    return np.array(found), np.array([each.reference_per_m for each in estimates])


def _by_band(estimate: Array, reference: Array) -> list[float | None]:
    """Mean square error of the estimates in each band of references; None in an empty one."""
    off, size = (estimate - reference) ** 2, np.abs(reference)
    inside = [off[(low <= size) & (size < high)] for low, high in BANDS]
    return [_mean(band[np.isfinite(band)]) for band in inside]


def _mean(values: Array | Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None
