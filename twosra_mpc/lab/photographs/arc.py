"""Curvature of a segment by one arc: least squares to its medial line, below the pixel.

The medial line is the middle of what shines, across the segment, at stations one pixel apart.
They span the segment's own length, in the middle of what is brighter than the threshold: heat
spreads beyond the ends, to what does not bend. A lens draws the middle of a bent line inwards, its
ends outwards: so the arc is drawn as a line as wide and as bright, its middle measured in the same
way, and only what the photograph differs from this drawing is fitted.

An arc of curvature kappa that is moved by a, turned by b and bent by c moves across itself by
a cos(kappa s) + b sin(kappa s) / kappa + c (1 - cos(kappa s)) / kappa^2 at arc length s: linear in
a, b and c, and regular for straight segments. Gauss-Newton steps in these three make the least
squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage, stats

from twosra_mpc.errors import InputError
from twosra_mpc.lab.photographs.picture import Camera, Mask, Photograph, check_length, cut_out
from twosra_mpc.robot.coordinates import Array

COMPATIBLE = 0.05  # least chance, if the segment were an arc, of a line at least as far off
_STEPS = 30  # of Gauss and Newton, at most
_ENOUGH = 1e-9  # px
_FINE_PX = 0.1  # between samples
_SHARE = 0.012  # of the curvature: what the drawn line does not know of the segment's own profile
_FLOOR_PX = 0.008  # what pixels and rounded grey values leave of the line's place
_REACH = 0.25  # of the length: half a profile across the segment
_TO_CENTRE = 0.8  # of the radius: the same, where the segment is bent much
_STRAIGHT = 1e-9  # 1/px
_SHARPEST_PX = 0.4  # blur of a drawn line, at least [px]
_MARGIN = 4  # px
_LEAST = 4  # stations
_SLENDER = 2.0  # times as long as wide, at least
_SOLVABLE = 1e12  # condition number of normal equations, at most
_DRAWN = 60  # points of an arc for figures


@dataclass(frozen=True, eq=False)
class Arc:
    """The arc of one photograph; points in pixels, read-only.

    Attributes:
        curvature_per_m: Its curvature [1/m], positive where it turns left towards the given end.
        standard_error_per_m: Of the curvature [1/m], by the line's noise, or its scatter if larger.
        p_value: Chance, were the segment an arc, of a line at least as far off as this one.
        scatter_m: Root mean square distance of the line from the arc [m].
        seen_m: Length of the segment that is brighter than the threshold [m].
        line_px: The medial line (stations, 2).
        arc_px: The arc, from the first of them to the last (points, 2).
    """

    curvature_per_m: float
    standard_error_per_m: float
    p_value: float
    scatter_m: float
    seen_m: float
    line_px: Array
    arc_px: Array

    @property
    def fits(self) -> bool:
        """True if the medial line is compatible with one arc."""
        return self.p_value >= COMPATIBLE


@dataclass(frozen=True)
class _Guess:
    """An arc through (x, y) [px] that heads by ``heading`` there and turns by ``kappa`` [1/px]."""

    x: float
    y: float
    heading: float
    kappa: float

    def at(self, s: Array) -> tuple[Array, Array]:
        """Points and normals, to the right of it in a picture whose y is down, (n, 2) each."""
        turned = self.heading + self.kappa * s
        mean = self.heading + self.kappa * s / 2
        chord = s * np.sinc(self.kappa * s / (2 * np.pi))
        points = np.column_stack([self.x + chord * np.cos(mean), self.y + chord * np.sin(mean)])
        return points, np.column_stack([-np.sin(turned), np.cos(turned)])

    def shifted(self, x: float, y: float) -> _Guess:
        return _Guess(self.x + x, self.y + y, self.heading, self.kappa)

    def moved(self, across: float, turn: float, bend: float) -> _Guess:
        x = self.x - across * np.sin(self.heading)
        y = self.y + across * np.cos(self.heading)
        return _Guess(float(x), float(y), self.heading + turn, self.kappa + bend)


def fit_arc(photograph: Photograph, region: Mask, camera: Camera) -> Arc:
    """Fit an arc to the medial line of a segment.

    Raises:
        InputError: If what is bright is much shorter or longer than the segment, or round.
    """
    grey, first = cut_out(photograph, region, _MARGIN)
    check_length(photograph, float(np.hypot(*np.ptp(np.argwhere(region), axis=0))), camera)
    noise = _noise(photograph.grey, region)
    dark = float(np.median(photograph.grey[~region]))
    guess = _first_guess(photograph.grey, region, camera).shifted(-first[1], -first[0])
    spline = ndimage.spline_filter(grey, order=3, mode="nearest")
    for _ in range(_STEPS):
        back, forth = _bright(spline, guess, camera)
        check_length(photograph, forth - back, camera)
        count = max(int(min(forth - back, camera.length_px)), _LEAST)
        s: Array = (back + forth) / 2 + np.arange(count, dtype=float) - (count - 1) / 2
        seen = _across(spline, guess, s, camera)
        drawn = _drawn(grey.shape, guess, (back, forth), seen, camera, dark)
        expected = _across(ndimage.spline_filter(drawn, order=3, mode="nearest"), guess, s, camera)
        offset = seen.middle - expected.middle
        design = _design(guess.kappa, s)
        wide = 2 * float(np.median(seen.half))
        normal = design.T @ design
        solvable = np.isfinite(normal).all() and np.linalg.cond(normal) < _SOLVABLE
        if not (solvable and forth - back >= _SLENDER * wide):
            allowed = "a segment; what is bright is as wide as long"
            raise InputError("picture", photograph.path.name, allowed, str(photograph.path))
        step = np.linalg.solve(normal, design.T @ offset)
        guess = guess.moved(*step.tolist())
        if np.abs(step).max() < _ENOUGH:
            break
    guess = guess.shifted(first[1], first[0])
    points, normals = guess.at(s)
    residual = offset - design @ step
    variance = (noise * seen.lever) ** 2 + _FLOOR_PX**2
    chi2, free = float(np.sum(residual**2 / variance)), len(s) - 3
    covariance = np.linalg.inv(design.T @ (design / variance[:, None]))
    error = np.hypot(np.sqrt(covariance[2, 2] * max(1.0, chi2 / free)), _SHARE * guess.kappa)
    first_px, last_px = np.linalg.norm(points[[0, -1]] - camera.towards_px, axis=1)
    sign = -1.0 if last_px < first_px else 1.0  # y is down: headings turn right
    return Arc(
        curvature_per_m=sign * guess.kappa / camera.scale_m,
        standard_error_per_m=float(error) / camera.scale_m,
        p_value=float(stats.chi2.sf(chi2, free)),
        scatter_m=float(np.sqrt(np.mean(residual**2))) * camera.scale_m,
        seen_m=(forth - back) * camera.scale_m,
        line_px=points + residual[:, None] * normals,
        arc_px=guess.at(np.linspace(s[0], s[-1], _DRAWN))[0],
    )


def _noise(grey: Array, region: Mask) -> float:
    """Standard deviation of a pixel's noise: by second differences away from what shines."""
    dark = ~ndimage.binary_dilation(region, iterations=5)
    across = np.abs(grey[:, 2:] - 2 * grey[:, 1:-1] + grey[:, :-2])[dark[:, 1:-1]]
    rounding = 1 / 12
    measured = (1.4826 * np.median(across)) ** 2 / 6 if across.size else 0.0
    return float(np.sqrt(measured + rounding))


def _first_guess(grey: Array, region: Mask, camera: Camera) -> _Guess:
    """Circle through the bright pixels, weighted by how bright they are (Karimaki 1991)."""
    y, x = np.nonzero(region)
    w = grey[region] - camera.threshold
    w = w / w.sum()
    middle = np.array([w @ x, w @ y])
    u, v = x - middle[0], y - middle[1]
    r2 = u * u + v * v
    c = np.cov(np.vstack([u, v, r2]), aweights=w, ddof=0)
    q1 = c[2, 2] * c[0, 1] - c[0, 2] * c[1, 2]
    q2 = c[2, 2] * (c[0, 0] - c[1, 1]) - c[0, 2] ** 2 + c[1, 2] ** 2
    phi = 0.5 * np.arctan2(2 * q1, q2)
    half = (np.sin(phi) * c[0, 2] - np.cos(phi) * c[1, 2]) / c[2, 2]
    delta = -half * (w @ r2)
    root = np.sqrt(max(1 - 4 * delta * half, 1e-9))
    rho = 2 * delta / (1 + root)
    x0, y0 = middle + rho * np.array([np.sin(phi), -np.cos(phi)])
    return _Guess(float(x0), float(y0), float(phi), float(-2 * half / root))


def _bright(spline: Array, guess: _Guess, camera: Camera) -> tuple[float, float]:
    """From where to where along the arc [px] it is brighter than the threshold."""
    most = 0.9 * np.pi / max(abs(guess.kappa), _STRAIGHT)  # not round to where it came from
    far = np.arange(0.0, min(camera.length_px, most), _FINE_PX)
    ends = []
    for side in (-1.0, 1.0):
        over = _values(spline, guess.at(side * far)[0]) - camera.threshold
        last = max(int(np.argmin([*(over > 0), False])) - 1, 0)
        i = min(last, len(far) - 2)
        more = over[i] / (over[i] - over[i + 1]) if over[i] > 0 >= over[i + 1] else 0.0
        ends.append(side * float(far[last] + _FINE_PX * more))
    return ends[0], ends[1]


class _Across(NamedTuple):
    """Profiles across an arc at its stations (n,): where their middles are, and more.

    ``lever``: noise of the middle [px] for a noise of one grey value in every pixel. ``peak``:
    greatest grey value. ``half``: half the width above the threshold [px].
    """

    middle: Array
    lever: Array
    peak: Array
    half: Array


def _across(spline: Array, guess: _Guess, s: Array, camera: Camera) -> _Across:
    reach = min(_REACH * camera.length_px, _TO_CENTRE / max(abs(guess.kappa), _STRAIGHT))
    n = np.arange(-reach, reach + _FINE_PX / 2, _FINE_PX)
    points, normals = guess.at(s)
    grey = _values(spline, points[:, None] + n[:, None] * normals[:, None])
    weights = np.clip(grey - camera.threshold / 2, 0.0, None)
    total = np.maximum(weights.sum(axis=1), 1e-9)
    middle = weights @ n / total
    levers = np.where(weights > 0, n - middle[:, None], 0.0)
    lever = np.sqrt((levers**2).sum(axis=1) / _FINE_PX) / total
    half = (grey > camera.threshold).sum(axis=1) * _FINE_PX / 2
    return _Across(middle, lever, grey.max(axis=1), half)


def _drawn(
    shape: tuple[int, ...],
    guess: _Guess,
    ends: tuple[float, float],
    seen: _Across,
    camera: Camera,
    dark: float,
) -> Array:
    """Picture of the arc as a line blurred to the width and brightness that are seen."""
    peak = float(np.median(seen.peak))
    level = np.clip((camera.threshold - dark) / (peak - dark), 0.05, 0.95)
    blur = max(float(np.median(seen.half)) / np.sqrt(-2 * np.log(level)), _SHARPEST_PX)
    half = (ends[1] - ends[0]) / 2 + blur * stats.norm.ppf(level)
    along = sum(ends) / 2 + np.linspace(-half, half, 1 + 2 * int(np.ceil(4 * half)))
    x, y = guess.at(along)[0].T
    u = np.exp(-0.5 * ((np.arange(shape[1])[:, None] - x) / blur) ** 2)
    v = np.exp(-0.5 * ((np.arange(shape[0])[:, None] - y) / blur) ** 2)
    drawn = v @ u.T
    return dark + (peak - dark) * drawn * (along[1] - along[0]) / (np.sqrt(2 * np.pi) * blur)


def _values(spline: Array, places: Array) -> Array:
    """Grey values at places (..., 2) [px]."""
    at = np.moveaxis(places, -1, 0)[::-1]
    return ndimage.map_coordinates(spline, at, order=3, mode="nearest", prefilter=False)


def _design(kappa: float, s: Array) -> Array:
    """Design matrix: moves, turns and bends of an arc across itself (see the module), (n, 3)."""
    half = s * np.sinc(kappa * s / (2 * np.pi))  # 2 sin(kappa s / 2) / kappa
    whole = s * np.sinc(kappa * s / np.pi)
    return np.column_stack([np.cos(kappa * s), whole, half**2 / 2])
