"""The bending test: curvature in thermal photographs against that of a camera and markers."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.files import plain_data
from twosra_mpc.lab.figures.curvature_figure import plot_curvature
from twosra_mpc.lab.figures.trial_figures import plot_spread
from twosra_mpc.lab.paper.claims import Claim, Reading, equal, every
from twosra_mpc.lab.paper.kept import Data, Part, Tell, digest
from twosra_mpc.lab.paper.section import Picture, Section, Table
from twosra_mpc.lab.photographs.picture import Camera
from twosra_mpc.lab.photographs.study import (
    ESTIMATORS,
    Estimate,
    deviations,
    estimate_folder,
)

STEPS_FIGURE, SPREAD_FIGURE = "curvature-steps.png", "curvature-spread.png"
_WHERE = "section Curvature Estimation"
BANDS = (0.0, 10.0, 20.0, 35.0, 50.0, np.inf)  # |reference| [1/m]
STRAIGHT_PER_M = 6.0  # below, the published steps hardly know anything
MSE_PER_M2, SPREAD_PER_M, REPEATS = 41.32, 12.93, 5  # published
_CLOSE = 0.02  # of a published number: what is drawn by lot moves them by 1 %
_MISSING = (
    "Give a folder with folders of photographs, each with a CSV file of references of its name:"
    " --photographs FOLDER, or --data with curvature/ in it."
)


def part(photographs: Path, column: str, camera: Camera) -> Part:
    """Return the study of the photographs of a folder, with figures."""

    def compute(folder: Path, tell: Tell) -> Data:
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
        document: Data = plain_data(_numbers(found, camera))
        return document

    settings = {
        "photographs": digest(photographs),
        "column": column,
        "camera": camera.model_dump(mode="json"),
    }
    return Part("curvature", settings, compute, (STEPS_FIGURE, SPREAD_FIGURE))


def folders_in(photographs: Path) -> list[tuple[Path, Path]]:
    """List folders of pictures with their CSV files of references, by name.

    A clone of the authors' repository 2sr-agent-control has them in ``ExpData/TempPhotos``, and the
    references of its folder ``Negative`` in ``ExpData/exp_negative_curvature.csv``.

    Raises:
        InputError: If there is none, or one has no references.
    """
    cloned = photographs / "ExpData" / "TempPhotos"
    place = cloned if cloned.is_dir() else photographs
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
    every_one = [each for one in found for each in one]
    measured = [(each, each.measured) for each in every_one if each.measured is not None]
    reference = np.array([each.reference_per_m for each, _ in measured])
    spread = np.array([m.published.spread_per_m for _, m in measured])
    known = np.array([m.published.known for _, m in measured])
    straight = np.abs(reference) < STRAIGHT_PER_M
    fits = np.array([m.arc.fits for _, m in measured])
    bands = {}
    for name, field in ESTIMATORS.items():
        off = np.array([getattr(each, field) for each, _ in measured]) - reference
        inside = [(np.abs(reference) >= a) & (np.abs(reference) < b) for a, b in _pairs()]
        bands[name] = [_mean(off[band & np.isfinite(off)] ** 2) for band in inside]
    return {
        "pictures": len(every_one),
        "refused": len(every_one) - len(measured),
        "deviations": deviations(found),
        "mean_spread_per_m": _mean(spread[np.isfinite(spread)]),
        "known_when_straight": _mean(known[straight]),
        "bands_mse_per_m2": bands,
        "bend_range_rad": [float(b) * camera.length_m for b in (reference.min(), reference.max())],
        "share_compatible_with_an_arc": float(fits.mean()),
        "median_scatter_m": float(np.median([m.arc.scatter_m for _, m in measured])),
        "largest_scatter_m": max(m.arc.scatter_m for _, m in measured),
        "length_m": camera.length_m,
    }


def _pairs() -> list[tuple[float, float]]:
    return list(itertools.pairwise(BANDS))


def _mean(values: Any) -> float | None:
    return float(np.mean(values)) if len(values) else None


def section(data: Data | None) -> Section:
    """Compare with the paper; without photographs say what to give."""
    return Section(
        name="curvature",
        title="Constant curvature",
        words=(
            "The curvature of the soft segment in each photograph, by the published steps and by"
            " least squares of one arc, against that measured by camera and markers. Two of the"
            " published steps are not in the paper: points without an estimate are left out, and"
            " the repeats are averaged.",
        ),
        claims=_claims(data),
        tables=() if data is None else (_bands(data),),
        pictures=()
        if data is None
        else (
            Picture(
                SPREAD_FIGURE,
                "Mean curvature along the segment against the reference; bands"
                " are the spread along it",
            ),
            Picture(STEPS_FIGURE, "Photograph, contour, medial line and arc of five photographs"),
        ),
        missing="" if data is not None else _MISSING,
    )


def _claims(data: Data | None) -> tuple[Claim, ...]:
    got: Data = {} if data is None else data
    return (*_of_errors(got), *_of_the_test(got), *_of_arcs(got))


def _of_errors(got: Data) -> tuple[Claim, ...]:
    published = got.get("deviations", {}).get("published", {})
    mse = {"holds": _CLOSE * MSE_PER_M2, "caveat": 0.1 * MSE_PER_M2}
    return (
        Claim(
            "The mean square error is 41.32",
            f"{_WHERE}; Fig. 7(d)",
            (
                equal(
                    "means of the repeats",
                    MSE_PER_M2,
                    published.get("cycle_mse_per_m2"),
                    "1/m2",
                    **mse,
                ),
                equal("single photographs", MSE_PER_M2, published.get("mse_per_m2"), "1/m2", **mse),
            ),
        ),
        Claim(
            "The mean standard deviation along the segment is 12.93",
            f"{_WHERE}; Fig. 7(d)",
            (
                equal(
                    "single photographs",
                    SPREAD_PER_M,
                    got.get("mean_spread_per_m"),
                    "1/m",
                    holds=_CLOSE * SPREAD_PER_M,
                    caveat=0.1 * SPREAD_PER_M,
                ),
            ),
        ),
    )


def _of_the_test(got: Data) -> tuple[Claim, ...]:
    published = got.get("deviations", {}).get("published", {})
    low, high = got.get("bend_range_rad", (None, None))
    return (
        Claim(
            "The test was repeated five times",
            _WHERE,
            (
                equal(
                    "loads and unloads found in the references, both directions",
                    2 * REPEATS,
                    published.get("cycles"),
                    caveat=1.0,
                ),
            ),
        ),
        Claim(
            "The segment was bent from -pi to pi",
            _WHERE,
            (
                equal("least bend", -np.pi, low, "rad", holds=0.05 * np.pi, caveat=0.2 * np.pi),
                equal("largest bend", np.pi, high, "rad", holds=0.05 * np.pi, caveat=0.2 * np.pi),
            ),
        ),
    )


def _of_arcs(got: Data) -> tuple[Claim, ...]:
    scatter, length = got.get("median_scatter_m"), got.get("length_m")
    return (
        Claim(
            "Small curvatures agree, and the difference grows with the bend",
            _WHERE,
            (
                every(
                    f"points with an estimate, below {STRAIGHT_PER_M:zg} 1/m",
                    got.get("known_when_straight"),
                ),
                every(
                    "published steps: pairs of bands in which the more bent has the larger error",
                    _growing(got, "published"),
                ),
                every("arc: the same", _growing(got, "arc")),
            ),
            "Where the segment lies along the picture's rows the published steps know nothing and"
            " say nearly zero, whatever it does.",
        ),
        Claim(
            "Constant curvature represents the segment adequately",
            _WHERE,
            (
                every(
                    "photographs compatible with one arc (p of 0.05 and more)",
                    got.get("share_compatible_with_an_arc"),
                ),
                Reading(
                    "median distance of the medial line from its arc, of the segment's length",
                    0.0,
                    100 * scatter / length if scatter and length else None,
                    "%",
                    1.0,
                    5.0,
                    "at most",
                ),
            ),
        ),
    )


def _growing(data: Data, name: str) -> float | None:
    """Share of the pairs of bands that are in order; None without two of them."""
    errors = [e for e in data.get("bands_mse_per_m2", {}).get(name, ()) if e is not None]
    return _mean([a < b for a, b in itertools.combinations(errors, 2)])


def _bands(data: Data) -> Table:
    rows = []
    for name in ESTIMATORS:
        off = data["deviations"][name]
        errors = [off["mse_per_m2"], off["cycle_mse_per_m2"], *data["bands_mse_per_m2"][name]]
        cells = ["-" if error is None else f"{error:z.1f}" for error in errors]
        rows.append((name, str(off["pictures"]), f"{off['slope']:z.3f}", *cells))
    header = (
        "estimator",
        "photographs",
        "slope",
        "MSE [1/m2]",
        "of mean repeats",
        *(
            f"from {low:zg}" if high == np.inf else f"{low:zg} to {high:zg}"
            for low, high in _pairs()
        ),
    )
    refused = f"; {data['refused']} of {data['pictures']} refused" if data["refused"] else ""
    return Table(f"Mean square error, by size of the reference [1/m]{refused}", header, tuple(rows))
