"""Path parameters from the fibre's lengths alone: the paper's spirals, its successor's cardioids.

A locomotion unit (LU) follows the end of a fibre whose soft segments are arcs of constant length
and curvature. Paper section "LU Paths Estimation" replaces that path by logarithmic spirals, the
follow-up robot by cardioids. Both are fitted here, for any lengths, in three cases:

I    one segment is soft, the LU next to it moves; the link is held.
II   one segment is soft, the LU beyond the link and the straight rigid segment moves.
III  both segments are soft and bend equally, one LU moves.

Frame of all points: the held end of the soft fibre is the origin, the straight fibre lies along -x,
a positive bending angle alpha = kappa l turns it towards +y. Paths and curves are mirror images
about the x axis for negative alpha. A point's *turn* about a centre is its polar angle from -x
towards +y; the paper's spiral angle theta and the successor's phi are turn + a constant.

Source of the set-up: Table I, whose numbers it reproduces to 0.1 % (a, b) and 0.5 % (centre); in
the table the sign of c_x of row II is that of the mirrored frame.

`twosra_mpc.robot.description` has the fits to the lengths of the built-in robots.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares, minimize_scalar

from twosra_mpc import InputError, Robot
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry

Case: TypeAlias = Literal["I", "II", "III"]

CASES: tuple[Case, ...] = ("I", "II", "III")
ANGLE_RATIO = (1.5, 1.0, 0.75)  # m_k: bending angle per spiral angle, eqs. kappa_fit1 to kappa_fit3
SMOOTHING_RAD = 0.01  # rounds the kink of the spirals' radius at alpha = 0
CARDIOID_BEND_RAD = np.pi / 2  # the follow-up robot bends within +-pi / (2 l)

# Up to a full circle a segment in I and II, half a circle in III, uniform in curvature. The paper
# does not give the sampling, and it moves b by up to 2 %; these are the points nearest to Table I.
SPIRAL_BENDS_RAD: dict[Case, Array] = {
    "I": np.linspace(0.0, 2 * np.pi, 316)[1:],
    "II": np.linspace(0.0, 2 * np.pi, 201)[1:],
    "III": np.linspace(0.0, np.pi, 41),
}
SPIRAL_START_RAD: dict[Case, float] = {"I": np.pi, "II": np.pi, "III": 0.0}

_CENTRES = 7  # tried along x and along y, before the best three are refined
_WORST = 0.15  # root mean square residual accepted, per distance of the straight fibre's ends


@dataclass(frozen=True)
class SpiralFit:
    """Radius a e^{-b theta} about a free centre, as a row of Table I; unit of length: l.

    Attributes:
        scale: a / l, where theta is counted from ``start_rad``.
        growth: b > 0; the radius falls with the bend, whichever way it goes.
        centre: (c_x / l, c_y / l), for a bend towards +y.
        rms_l: Root mean square of the radial residuals / l.
        max_l: Largest absolute radial residual / l.
        start_rad: theta of the straight fibre: pi in I and II, 0 in III. Table I means the same,
            but eq. kappa takes all its rows from pi, which halves the radius of spiral III.
    """

    scale: float
    growth: float
    centre: tuple[float, float]
    rms_l: float
    max_l: float
    start_rad: float

    @property
    def scale_from_pi(self) -> float:
        """Scale of the same spiral with theta = pi when straight, as eq. kappa has it."""
        return float(self.scale * np.exp(self.growth * (np.pi - self.start_rad)))


@dataclass(frozen=True)
class CardioidFit:
    """Radius 2 a (1 - cos phi) with phi = pi + c alpha about a free centre, the cusp.

    Attributes:
        radius_m: a [m].
        phi_per_alpha: c, the slope of the least-squares line through phi over alpha.
        centre_m: (c_x, c_y) [m]; c_y is 0 by symmetry.
        rms_m: Root mean square of the radial residuals [m].
        max_m: Largest absolute radial residual [m].
    """

    radius_m: float
    phi_per_alpha: float
    centre_m: tuple[float, float]
    rms_m: float
    max_m: float


def exact_path(case: Case, geometry: Geometry, alpha: ArrayLike) -> Array:
    """Moving fibre end, seen from the held end, on constant-curvature arcs.

    Args:
        case: I, II or III.
        geometry: Lengths; only the segments' and the middle link's count.
        alpha: Bending angles of each soft segment (n,) [rad].

    Returns:
        Points [m], shape (n, 2).

    Raises:
        InputError: If there is no such case.
    """
    length, link = geometry.lengths_m[0], geometry.middle_link_m
    angle = np.atleast_1d(np.asarray(alpha, dtype=float))
    heading = np.exp(1j * angle)  # of the far end of an arc whose near end heads along +x
    arc = length * np.exp(0.5j * angle) * np.sinc(angle / (2 * np.pi))
    match case:
        case "I":
            end = arc
        case "II":
            end = arc + (link + length) * heading
        case "III":
            end = arc + (link + arc) * heading
        case _:
            raise InputError("case", case, f"one of {', '.join(CASES)}")
    return np.stack([-end.real, end.imag], axis=1)


def fit_spirals(geometry: Geometry) -> tuple[SpiralFit, ...]:
    """Fit spirals I, II and III as Table I was fitted: radially, with a free centre.

    Raises:
        InputError: If no spiral follows a path of these lengths.
    """
    return tuple(_fit_spiral(case, geometry) for case in CASES)


def fit_cardioids(
    geometry: Geometry, alpha_max: float = CARDIOID_BEND_RAD
) -> tuple[CardioidFit, ...]:
    """Fit cardioids I, II and III radially, with a free centre on the axis of symmetry.

    Args:
        geometry: Lengths of the fibre.
        alpha_max: Largest absolute bending angle of each soft segment [rad], at most pi.

    Raises:
        InputError: If no cardioid follows a path of these lengths.
    """
    return tuple(_fit_cardioid(case, geometry, alpha_max) for case in CASES)


def fitted_path_tables(robot: Robot) -> dict[str, dict[str, Any]]:
    """Return the ``[path]`` tables of a robot file, by model, fitted to the robot's lengths.

    ``log_spiral`` counts theta from pi in all three cases (eq. kappa), so its ``scale`` is
    ``SpiralFit.scale_from_pi``; ``log_spiral_corrected`` counts III from 0, so its ``scale`` reads
    like Table I. Both say the same: no phase need be stored.

    Args:
        robot: The robot; only its geometry counts.

    Raises:
        InputError: As `fit_spirals` and `fit_cardioids`.
    """
    spirals, cardioids = fit_spirals(robot.geometry), fit_cardioids(robot.geometry)
    shared = {
        "growth": _written(fit.growth for fit in spirals),
        "angle_ratio": list(ANGLE_RATIO),
        "smoothing_rad": SMOOTHING_RAD,
    }
    scales = {
        "log_spiral": _written(fit.scale_from_pi for fit in spirals),
        "log_spiral_corrected": _written(fit.scale for fit in spirals),
    }
    cardioid = {
        "model": "cardioid",
        "radius_m": _written(fit.radius_m for fit in cardioids),
        "phi_per_alpha": _written(fit.phi_per_alpha for fit in cardioids),
    }
    tables = {model: {"model": model, "scale": scale, **shared} for model, scale in scales.items()}
    return {**tables, "cardioid": cardioid}


def _fit_spiral(case: Case, geometry: Geometry) -> SpiralFit:
    """Least squares of r - A e^{-b turn} over (A, b, c_x, c_y), from the best of many centres."""
    path = exact_path(case, geometry, SPIRAL_BENDS_RAD[case]) / geometry.lengths_m[0]

    def residual(guess: Array) -> Array:
        radius, turn = polar(path, guess[2], guess[3])
        return np.asarray(radius - guess[0] * np.exp(-guess[1] * turn))

    fits = [least_squares(residual, start, method="lm") for start in _spiral_starts(path)]
    best = min(fits, key=lambda fit: float(fit.cost))
    straight, growth, x, y = best.x.tolist()
    left, start = residual(best.x), SPIRAL_START_RAD[case]
    converged = bool(best.success) and straight > 0.0 and growth > 0.0
    rms, largest = _residuals_of_fit(converged, f"spiral {case}", geometry, left, path)
    scale = straight * float(np.exp(growth * start))
    return SpiralFit(scale, growth, (x, y), rms, largest, start)


def _spiral_starts(path: Array) -> list[Array]:
    """Three starting points (4,): centres within the path, the rest from a line through log r."""
    (left, low), (right, high) = path.min(axis=0), path.max(axis=0)
    starts = []
    for x in np.linspace(left, right, _CENTRES + 2)[1:-1]:
        for y in np.linspace(low, high, _CENTRES + 2)[1:-1]:
            radius, turn = polar(path, x, y)
            slope, offset = np.polyfit(turn, np.log(np.maximum(radius, 1e-9)), 1, w=radius)
            error = _rms(radius - np.exp(offset + slope * turn))
            starts.append((error, np.array([np.exp(offset), -slope, x, y])))
    return [start for _, start in sorted(starts, key=lambda item: item[0])[:3]]


def _fit_cardioid(case: Case, geometry: Geometry, alpha_max: float) -> CardioidFit:
    """Least squares over (a, c_x); a follows from c_x, so this is a search along a line."""
    alpha = np.linspace(0.0, alpha_max, 201)  # the other half of the path is its mirror image
    path = exact_path(case, geometry, alpha) / geometry.lengths_m[0]

    def cost(x: float) -> float:
        return _rms(_about_cusp(path, float(x))[2])

    grid = -path[0, 0] * np.linspace(-0.9, 1.5, 121)
    nearest = int(np.clip(np.argmin([cost(x) for x in grid]), 1, len(grid) - 2))
    low, high = grid[nearest - 1], grid[nearest + 1]
    best = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    x = float(best.x)
    a, turn, left = _about_cusp(path, x)
    converged = bool(best.success) and low + 1e-6 < x < high - 1e-6 and a > 0.0
    rms, largest = _residuals_of_fit(converged, f"cardioid {case}", geometry, left, path)
    slope, length = float(alpha @ turn / (alpha @ alpha)), geometry.lengths_m[0]
    return CardioidFit(a * length, slope, (x * length, 0.0), rms * length, largest * length)


def _about_cusp(path: Array, x: float) -> tuple[float, Array, Array]:
    """Best a of a cardioid with its cusp at (x, 0), turns of the path about it, residuals."""
    radius, turn = polar(path, x, 0.0)
    unit = 2 * (1 + np.cos(turn))  # 2 (1 - cos phi) with phi = pi + turn
    a = float(radius @ unit / (unit @ unit))
    return a, turn, radius - a * unit


def _residuals_of_fit(
    converged: bool, what: str, geometry: Geometry, left: Array, path: Array
) -> tuple[float, float]:
    """RMS and largest residual of a fit that converged to the curve meant and follows the path."""
    reach, rms = float(np.hypot(*path[0])), _rms(left)
    if not (converged and rms <= _WORST * reach):
        lengths = {name: getattr(geometry, name) for name in ("segment_length_m", "middle_link_m")}
        found = f"rms residual {rms / reach:z.2g} of the distance between the fibre's ends"
        raise InputError("geometry", lengths, f"lengths whose path a {what} follows ({found})")
    return rms, float(np.max(np.abs(left)))


def polar(points: Array, x: float, y: float) -> tuple[Array, Array]:
    """Distance from (x, y) and turn about it, continuous along the points (n, 2)."""
    across, up = (points - (x, y)).T
    return np.hypot(across, up), np.unwrap(np.arctan2(up, -across))


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def _written(values: Iterable[float]) -> list[float]:
    """Round to what is worth writing in a file: seven significant digits."""
    return [float(f"{value:z.7g}") for value in values]
