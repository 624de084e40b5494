"""The bending test: curvature in thermal photographs against that of a camera and markers."""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.lab.figures.experiment_figures import plot_curvature, plot_spread
from twosra_mpc.lab.paper.section import Data, Section, Tell, declared
from twosra_mpc.lab.photographs.picture import Camera
from twosra_mpc.lab.photographs.study import (
    ESTIMATORS,
    Estimate,
    estimate_folder,
    summary,
)

STEPS_FIGURE, SPREAD_FIGURE = "curvature-steps.png", "curvature-spread.png"
STRAIGHT_PER_M = 6.0  # below, the published steps hardly know anything


def compute(folder: Path, tell: Tell, photographs: Path, column: str, camera: Camera) -> Data:
    """Measure the photographs of a folder, with figures."""
    found = []
    for pictures, references in folders_in(photographs):
        name = pictures.name

        def show(done: int, of: int, name: str = name) -> None:
            tell(f"{name}: {done} of {of} photographs")

        found.append(estimate_folder(pictures, camera, (references, column), show))
    tell("drawing the photographs")
    every_one = [each for one in found for each in one]
    plot_curvature(every_one, camera, folder / STEPS_FIGURE)
    plot_spread(every_one, folder / SPREAD_FIGURE)
    return _numbers(found, camera)


def folders_in(photographs: Path) -> list[tuple[Path, Path]]:
    """List folders of pictures with their CSV files of references, by name.

    A clone of the authors' repository 2sr-agent-control has them in ``ExpData/TempPhotos``, and the
    references of its folder ``Negative`` in ``ExpData/exp_negative_curvature.csv``.

    Raises:
        InputError: If there is none, or one has no references.
    """
    cloned = photographs / "ExpData" / "TempPhotos"
    place = cloned if os.path.isdir(cloned) else photographs
    folders = sorted(path for path in place.glob("*") if path.is_dir())
    if not folders:
        allowed = "a folder with folders of photographs in it, e.g. negative and positive"
        raise InputError("photographs", str(photographs), allowed)
    return [(path, _references(path)) for path in folders]


def _references(pictures: Path) -> Path:
    """The CSV file of the references of a folder of pictures."""
    beside = pictures.with_name(f"{pictures.name}.csv")
    cloned = pictures.parent.with_name(f"exp_{pictures.name.lower()}_curvature.csv")
    for path in (beside, cloned):
        if path.is_file():
            return path
    allowed = f"a CSV file of references beside the folder {pictures.name}"
    raise InputError("references", str(beside), allowed)


def _numbers(found: Sequence[Sequence[Estimate]], camera: Camera) -> dict[str, Any]:
    pairs = ((each.reference_per_m, each.measured) for one in found for each in one)
    measured = [(reference, known) for reference, known in pairs if known is not None]
    reference = np.array([reference for reference, _ in measured])
    known = np.array([known.published.known for _, known in measured])
    straight = known[np.abs(reference) < STRAIGHT_PER_M]
    return summary(found) | {
        "known_when_straight": float(straight.mean()) if len(straight) else None,
        "bend_range_rad": [float(b) * camera.length_m for b in (reference.min(), reference.max())],
        "length_m": camera.length_m,
    }


def section(data: Data | None) -> Section:
    """Compare with the paper; without photographs say what to give."""
    if data is None:
        return declared("curvature", None, missing=True)
    figures = (SPREAD_FIGURE, STEPS_FIGURE)
    return declared("curvature", _found(data), (_bands(data),), figures)


def _found(data: Data) -> Data:
    """Numbers that the claims are about."""
    published, scatter_m = data["deviations"]["published"], data["median_scatter_m"]
    return {
        "mse_of_repeats": published["cycle_mse_per_m2"],
        "mse": published["mse_per_m2"],
        "mean_spread": data["published_mean_spread_per_m"],
        "cycles": published["cycles"],
        "least_bend": data["bend_range_rad"][0],
        "largest_bend": data["bend_range_rad"][1],
        "known_when_straight": data["known_when_straight"],
        "published_growing": _growing(data, "published"),
        "arc_growing": _growing(data, "arc"),
        "compatible_with_an_arc": data["share_compatible_with_an_arc"],
        "scatter": 100 * scatter_m / data["length_m"] if scatter_m else None,
        "refusals": f"; {data['refused']} of {data['pictures']} refused" * bool(data["refused"]),
    }


def _growing(data: Data, name: str) -> float | None:
    """Share of the pairs of bands that are in order; None without two of them."""
    errors = [each for each in data["bands_mse_per_m2"][name] if each is not None]
    pairs = [a < b for a, b in itertools.combinations(errors, 2)]
    return float(np.mean(pairs)) if pairs else None


def _bands(data: Data) -> list[Data]:
    """Lines of the table of errors by size of the reference."""
    bands, off = data["bands_mse_per_m2"], data["deviations"]
    return [{"name": name, "bands": bands[name], **off[name]} for name in ESTIMATORS]
