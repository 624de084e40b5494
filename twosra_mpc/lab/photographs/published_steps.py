"""Curvature of a segment as published: thinned to a line, smoothed by a polynomial, differentiated.

The steps are those of Labazanova et al. (RA-L 2023), section "Curvature estimation". The thinning
has to break ties between pixels that are equally far from the border; it did so at random, and here
does by a generator of fixed seed, so that a photograph gives the same number each time. The
polynomial is x over y: a segment that lies along a row of the picture has few places, or none,
where it says anything; these are left out, and counted.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from twosra_mpc.installation import require
from twosra_mpc.lab.photographs.picture import Camera, Mask, Photograph, upsampled
from twosra_mpc.robot.coordinates import Array

EXTRA = "vision"
_FINE = 168  # fine pixels on a segment's length
_BRUSH = np.ones((5, 5), dtype=bool)
_DISC = (np.hypot(*np.mgrid[-4:5, -4:5]) <= 4).astype(np.int_)  # 49 pixels
_LIFTED = 20  # white pixels of the 49 that lift a pixel
_MEDIAN = 7  # pixels, width of the median filter
_DEGREE, _WINDOW = 4, 4  # of the polynomial; points of the rolling mean
_SEED = 0  # of what breaks ties
# Eight neighbours (row, column) against the clock, from the right.
_ROUND = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))


@dataclass(frozen=True, eq=False)
class PublishedCurvature:
    """Curvature of one photograph by the published steps; points in pixels, read-only.

    Attributes:
        mean_per_m: Mean of the curvature along the segment [1/m], never negative; NaN if nowhere
            known.
        spread_per_m: Its standard deviation along the segment [1/m].
        known: Share of the line's points where a curvature is known.
        line_px: Thinned line, as it is followed (points, 2).
        smooth_px: The polynomial at its points (points, 2).
    """

    mean_per_m: float
    spread_per_m: float
    known: float
    line_px: Array
    smooth_px: Array


def published_curvature(photograph: Photograph, region: Mask, camera: Camera) -> PublishedCurvature:
    """Estimate the curvature of a segment by the published steps.

    Args:
        photograph: The photograph.
        region: The segment's pixels.
        camera: Scale, length and threshold.

    Raises:
        InputError: If scikit-image is not installed.
    """
    factor = max(1, round(_FINE / camera.length_px))
    fine, (top, left) = upsampled(photograph, region, factor)
    thin = _thinned(fine > camera.threshold)
    around = _outline(thin)
    rows, columns = around[len(around) // 2 :].T
    metre = camera.scale_m / factor
    x, y = columns * metre, -rows * metre
    smooth, curvature = _curvature(x, y)
    known = curvature[np.isfinite(curvature)]
    back = np.column_stack([smooth, -y]) / metre
    places = [(fine_px + 0.5) / factor - 0.5 + (left, top) for fine_px in (around[:, ::-1], back)]
    return PublishedCurvature(
        mean_per_m=float(known.mean()) if len(known) else np.nan,
        spread_per_m=float(known.std()) if len(known) else np.nan,
        known=len(known) / len(curvature),
        line_px=places[0][len(around) // 2 :],
        smooth_px=places[1],
    )


def _thinned(bright: Mask) -> Mask:
    """Cleaned of specks and notches, then the medial axis.

    The published bilateral filter (9, 75, 75) of black and white in 8 bits leaves what is white. It
    lifts what has 20 of the 49 pixels around it white to grey 1: white to the medial axis.
    """
    require("the published estimator", EXTRA, "scikit-image")
    from skimage.morphology import medial_axis

    around = ndimage.convolve(bright.astype(np.int_), _DISC, mode="nearest")
    bright = ndimage.binary_dilation(bright | (around >= _LIFTED), _BRUSH)
    bright = ndimage.binary_erosion(bright, _BRUSH, border_value=1)
    bright = ndimage.binary_dilation(bright, _BRUSH)
    bright = ndimage.uniform_filter(bright.astype(float), _MEDIAN) > 0.5  # median of 0 and 1
    return medial_axis(bright, rng=_SEED)  # type: ignore[no-untyped-call]


def _outline(thin: Mask) -> Array:
    """Pixels (row, column) once round a line, against the clock from its uppermost one, (n, 2).

    Border following (Suzuki and Abe 1985), of the part that is met first.
    """
    thin = np.pad(thin, 1)
    start = tuple(np.argwhere(thin)[0].tolist())
    clockwise = (*range(4, -1, -1), 7, 6, 5)  # from the left
    first = next((d for d in clockwise if thin[_beside(start, d)]), None)
    if first is None:
        return np.array([start], dtype=float) - 1
    last, at, seen, back = _beside(start, first), start, [], first
    while True:
        turn = next(d % 8 for d in range(back + 1, back + 9) if thin[_beside(at, d % 8)])
        seen.append(at)
        following = _beside(at, turn)
        if following == start and at == last:
            return np.array(seen, dtype=float) - 1
        at, back = following, (turn + 4) % 8


def _beside(at: tuple[int, ...], direction: int) -> tuple[int, ...]:
    down, right = _ROUND[direction]
    return at[0] + down, at[1] + right


def _curvature(x: Array, y: Array) -> tuple[Array, Array]:
    """Polynomial x over y, (n,) [m], and its unsigned curvature along the line, NaN if unknown."""
    if len(x) <= 3 * _WINDOW or not np.ptp(y):
        return x, np.full(len(x), np.nan)
    with warnings.catch_warnings(action="ignore"):  # a line along a row: ill-conditioned
        smooth = np.polyval(np.polyfit(y - y.min(), x, _DEGREE), y - y.min())
    x1, y1 = (_rolling(np.gradient(each)) for each in (smooth, y))
    x2, y2 = (_rolling(np.gradient(each)) for each in (x1, y1))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.abs(x1 * y2 - x2 * y1) / (x1 * x1 + y1 * y1) ** 1.5
        return smooth, _rolling(np.where(np.isfinite(found), found, np.nan))


def _rolling(values: Array) -> Array:
    """Mean of four values; NaN where there are not four."""
    whole = np.full(len(values), np.nan)
    means = sliding_window_view(values, _WINDOW).mean(axis=1)
    whole[_WINDOW // 2 : _WINDOW // 2 + len(means)] = means
    return whole
