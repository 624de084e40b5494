"""Outlines of the robot's parts, to tell shapes in which it would pass through itself.

They share nothing with the package: outlines of many points, laid out by complex numbers, as
polygons of GEOS.
"""

from __future__ import annotations

import cmath
import itertools
from collections.abc import Iterator

import numpy as np
import shapely

from twosra_mpc.robot.geometry import Geometry

_POINTS = 120  # along a segment


def _parts(geometry: Geometry, kappa: np.ndarray) -> Iterator[tuple[int, shapely.Polygon]]:
    """(place along the fibre, outline) of every part, from LU1 to LU2."""
    at, along, last = 0j, 1 + 0j, 2 * geometry.segments

    def box(x: float, y: float, angle: float, long: float, wide: float) -> shapely.Polygon:
        turned = cmath.exp(1j * angle)
        corners = [complex(a * long, b * wide) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        places = [at + along * (complex(x, y) + turned * corner) for corner in corners]
        return shapely.Polygon([(z.real, z.imag) for z in places])

    def unit(side: int, place: int) -> Iterator[tuple[int, shapely.Polygon]]:
        half, link = geometry.unit_frame_m / 2, geometry.end_link_m
        middle = side * (link + geometry.unit_side_m / 2)
        yield place, box(middle, geometry.unit_offset_m, 0, half, half)
        yield place, box(side * link / 2, 0, 0, link / 2, geometry.fibre_radius_m)
        for x, y, angle in geometry.wheel_placement[2 * (side > 0) : 2 * (side > 0) + 2]:
            tread = geometry.wheel_radius_m, geometry.wheel_thickness_m / 2
            yield place, box(x, y, angle, *tread)

    yield from unit(-1, 0)
    for j, (length, k) in enumerate(zip(geometry.lengths_m, kappa, strict=True)):
        run = np.linspace(0, length, _POINTS)
        turn = np.exp(1j * k * run)
        middle = (turn - 1) / (1j * k) if abs(k) > 1e-9 else run + 0j
        sides = [at + along * (middle + s * 1j * geometry.fibre_radius_m * turn) for s in (1, -1)]
        edge = np.concatenate([sides[0], sides[1][::-1]])
        yield 2 * j + 1, shapely.Polygon(np.column_stack([edge.real, edge.imag]))
        at, along = at + along * middle[-1], along * turn[-1]
        if j + 1 < geometry.segments:
            if half := geometry.middle_link_m / 2:
                yield 2 * j + 2, box(half, 0, 0, half, geometry.fibre_radius_m)
            at += along * 2 * half
    yield from unit(1, last)


def overlap_m2(geometry: Geometry, kappa: np.ndarray) -> float:
    """Largest area that two parts share which are no neighbours along the fibre."""
    return max(a.intersection(b).area for a, b in _pairs(geometry, kappa))


def apart_m(geometry: Geometry, kappa: np.ndarray) -> float:
    """Least distance between two parts which are no neighbours along the fibre; 0: they meet."""
    return float(min(shapely.distance(a, b) for a, b in _pairs(geometry, kappa)))


def _pairs(
    geometry: Geometry, kappa: np.ndarray
) -> Iterator[tuple[shapely.Polygon, shapely.Polygon]]:
    welded = not geometry.middle_link_m  # segments are joined to each other

    def joined(i: int, k: int) -> bool:
        return k - i <= (2 if welded and i % 2 else 1)

    pairs = itertools.combinations(_parts(geometry, kappa), 2)
    return ((a, b) for (i, a), (k, b) in pairs if not joined(i, k))
