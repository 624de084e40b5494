"""Folders of photographs: each picture measured or refused by name, and a CSV file of all."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.files import write_text
from twosra_mpc.lab.photographs.arc import Arc, fit_arc
from twosra_mpc.lab.photographs.picture import (
    Camera,
    Mask,
    Photograph,
    find_segment,
    pictures_in,
    read_photograph,
)
from twosra_mpc.lab.photographs.published_steps import PublishedCurvature, published_curvature
from twosra_mpc.lab.photographs.references import Deviation, deviation, read_references

COLUMNS = (
    *("folder", "picture", "reference_per_m"),
    *("published_mean_per_m", "published_spread_per_m", "published_known"),
    *("arc_per_m", "arc_standard_error_per_m", "arc_p_value", "arc_scatter_m", "arc_seen_m"),
    "refused",
)
Tell = Callable[[int, int], None]

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
        numbers = [each.reference_per_m, each.published_per_m, *_numbers(each.measured)]
        cells = ["" if math.isnan(value) else f"{value:z.6g}" for value in numbers]
        writer.writerow([each.path.parent.name, each.path.name, *cells, each.refused])
    write_text(path, text.getvalue())


def _numbers(measured: Measured | None) -> list[float]:
    """Columns after the published mean."""
    if measured is None:
        return [math.nan] * 7
    published, arc = measured.published, measured.arc
    return [
        *(published.spread_per_m, published.known),
        *(arc.curvature_per_m, arc.standard_error_per_m, arc.p_value, arc.scatter_m, arc.seen_m),
    ]


def deviations(found: Sequence[Sequence[Estimate]]) -> dict[str, Deviation]:
    """Deviations of both estimators from references, over all folders of estimates."""
    return {
        name: deviation(
            [
                (
                    np.array([getattr(each, field) for each in one]),
                    np.array([each.reference_per_m for each in one]),
                )
                for one in found
            ]
        )
        for name, field in ESTIMATORS.items()
    }
