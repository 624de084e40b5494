"""The robot in one shape as convex pieces: some that hold it, and some that it holds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry

_SAGITTA_M = 5e-4  # by which chords may miss the arc they stand for


@dataclass(frozen=True, eq=False)
class Footprint:
    """Convex pieces in the frame of b0, corners counter-clockwise.

    Attributes:
        outer: Pieces whose union holds the robot, each (4, 2) [m].
        inner: Pieces that the robot holds.
    """

    outer: tuple[Array, ...]
    inner: tuple[Array, ...]

    @property
    def radius_m(self) -> float:
        """Farthest corner of the outer pieces from b0."""
        return float(np.linalg.norm(np.concatenate(self.outer), axis=1).max())


def footprint(geometry: Geometry, kappa: ArrayLike, sagitta_m: float = _SAGITTA_M) -> Footprint:
    """Footprint of a robot of curvatures ``kappa`` (n,) [1/m].

    A chord over ds of an arc strays from it by |kappa| ds^2 / 8, at most ``sagitta_m``; wedges at
    the joints are covered by longer chords.
    """
    return _footprint(geometry, tuple(np.asarray(kappa, dtype=float).tolist()), sagitta_m)


@lru_cache(maxsize=256)
def _footprint(geometry: Geometry, kappa: tuple[float, ...], sagitta_m: float) -> Footprint:
    pieces, segments = [*_rigid_pieces(geometry, kappa)], range(geometry.segments)
    fibre = [pair for j in segments for pair in _chords(geometry, kappa, j, sagitta_m)]
    outer, inner = zip(*fibre, strict=True)
    return Footprint((*pieces, *outer), (*pieces, *inner))


def _rigid_pieces(geometry: Geometry, kappa: tuple[float, ...]) -> Iterator[Array]:
    """Units, wheels and links."""
    shape = robot_shape(geometry, [0.0] * POSE + list(kappa), 2)
    yield from shape.units
    yield from shape.wheels
    for a, b in shape.links:
        if np.linalg.norm(b - a) > 0 and geometry.fibre_radius_m > 0:
            yield _strip(a, b, geometry.fibre_radius_m, 0.0)


def _chords(
    geometry: Geometry, kappa: tuple[float, ...], segment: int, sagitta_m: float
) -> Iterator[tuple[Array, Array]]:
    """(outer, inner) piece of each chord of a segment."""
    length, bent = geometry.lengths_m[segment], abs(kappa[segment])
    count = max(1, math.ceil(length * math.sqrt(bent / (8 * sagitta_m))))
    ds = length / count
    shape = robot_shape(geometry, [0.0] * POSE + list(kappa), count + 1)
    radius, sagitta = geometry.fibre_radius_m, bent * ds**2 / 8
    longer = radius * math.sin(min(bent * ds / 2, math.pi / 2))
    points = shape.segments[segment]
    for a, b in itertools.pairwise(points):
        within = max(radius - sagitta, 1e-6)
        yield _strip(a, b, radius + sagitta, longer), _strip(a, b, within, 0.0)


def _strip(a: Array, b: Array, half_width: float, longer: float) -> Array:
    """The rectangle along a to b, counter-clockwise."""
    along = (b - a) / np.linalg.norm(b - a)
    across = half_width * np.array([-along[1], along[0]])
    a, b = a - longer * along, b + longer * along
    return np.array([a - across, b - across, b + across, a + across])


@lru_cache(maxsize=32)
def reach_per_curvature_m2(geometry: Geometry) -> Array:
    """How far bending a segment moves any point as seen from b0, per 1/m, (n,) [m2].

    A point beyond segment j, at most d from its end as the fibre lies straight, travels at most
    l_j (l_j / 2 + d) per 1/m of kappa_j.
    """
    lengths, links = geometry.lengths_m, geometry.middle_link_m
    shape = robot_shape(geometry, [0.0] * (POSE + geometry.segments), 2)
    corners = np.concatenate([shape.units.reshape(-1, 2), shape.wheels.reshape(-1, 2)])
    tips = [(-1.0, shape.links[0][1]), (1.0, shape.links[-1][0])]
    beyond = {
        side: float(np.linalg.norm(corners[side * (corners - tip)[:, 0] > 0] - tip, axis=1).max())
        for side, tip in tips
    }
    reach = []
    for j, length in enumerate(lengths):
        left = j < geometry.inner_link_of_b0
        further = lengths[:j] if left else lengths[j + 1 :]
        out = sum(further) + links * len(further) + beyond[-1.0 if left else 1.0]
        reach.append(length * (length / 2 + max(out, geometry.fibre_radius_m)))
    return np.array(reach)


def kept_m(world: World, geometry: Geometry) -> float:
    """What outer pieces keep from obstacles: the clearance, and what curvatures may be off [m]."""
    reach, left = reach_per_curvature_m2(geometry), geometry.inner_link_of_b0
    off = max(reach[:left].sum(), reach[left:].sum()) * world.curvature_uncertainty_per_m
    return world.clearance_m + float(off)
