"""The robot in one shape as convex pieces: some that hold it, and some that it holds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.problem.tolerances import ROUNDING_M
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry

SAGITTA_M = 5e-4  # by which chords may miss the arc they stand for
_NO_LENGTH_M = 1e-9  # links without a length have some, in a direction of zero
_THIN_M = 1e-6  # of inner pieces, that none is empty


@dataclass(frozen=True, eq=False)
class Footprint:
    """Convex pieces in the frame of b0, corners counter-clockwise.

    Attributes:
        outer: Pieces whose union holds the robot, (pieces, 4, 2) [m].
        inner: Pieces that the robot holds.
    """

    outer: Array
    inner: Array

    @property
    def radius_m(self) -> float:
        """Farthest corner of the outer pieces from b0."""
        return float(np.linalg.norm(self.outer, axis=-1).max())

    def shrunk(self, by_m: float) -> Footprint:
        """The same with inner pieces smaller all around: held whatever moves points by less."""
        sides = np.roll(self.inner, -1, axis=1) - self.inner
        lengths = np.linalg.norm(sides, axis=-1, keepdims=True)
        steps = by_m * sides / lengths
        kept = (lengths[..., 0] > 2 * by_m).all(axis=1)
        return Footprint(self.outer, (self.inner + steps - np.roll(steps, 1, axis=1))[kept])

    def holding(self, pieces: Array) -> Footprint:
        """The same with more outer pieces, (m, 4, 2)."""
        return Footprint(np.concatenate([self.outer, pieces]), self.inner) if len(pieces) else self


def footprint(geometry: Geometry, kappa: ArrayLike, sagitta_m: float = SAGITTA_M) -> Footprint:
    """Footprint of a robot of curvatures ``kappa`` (n,) [1/m], as by `footprints`."""
    outer, inner = footprints(geometry, np.asarray(kappa, dtype=float)[None], sagitta_m)
    return Footprint(outer[0], inner[0])


def footprints(
    geometry: Geometry, kappa: Array, sagitta_m: float = SAGITTA_M
) -> tuple[Array, Array]:
    """Outer and inner pieces of shapes (m, n) [1/m], both (m, pieces, 4, 2), in b0.

    A chord over ds of an arc strays from it by |kappa| ds^2 / 8, at most ``sagitta_m``; wedges at
    the joints are covered by longer chords.
    """
    bent = np.abs(kappa)
    lengths = np.array(geometry.lengths_m)
    counts = np.ceil(lengths * np.sqrt(bent.max(axis=0) / (8 * sagitta_m))).astype(int)
    counts = np.maximum(counts, 1)
    shape = robot_shape(geometry, np.pad(kappa, ((0, 0), (POSE, 0))), 2)
    rigid = list(_rigid_pieces(geometry, shape))
    chords = [_chords(geometry, shape, kappa, j, int(count)) for j, count in enumerate(counts)]
    return (
        np.concatenate([*rigid, *(outer for outer, _ in chords)], axis=1),
        np.concatenate([*rigid, *(inner for _, inner in chords)], axis=1),
    )


def _rigid_pieces(geometry: Geometry, shape: RobotShape) -> Iterator[Array]:
    """Units, wheels and links, each (m, pieces, 4, 2)."""
    yield shape.units
    yield shape.wheels
    lengths = [geometry.end_link_m, *[geometry.middle_link_m] * (geometry.segments - 1)]
    there = [i for i, length in enumerate([*lengths, geometry.end_link_m]) if length > 0]
    if geometry.fibre_radius_m > 0:
        ends = shape.links[:, there]
        yield strips(ends[..., 0, :], ends[..., 1, :], np.array(geometry.fibre_radius_m))


def _chords(
    geometry: Geometry, shape: RobotShape, kappa: Array, segment: int, count: int
) -> tuple[Array, Array]:
    """Outer and inner pieces of a segment of ``count`` chords, both (m, count, 4, 2)."""
    length, signed = geometry.lengths_m[segment], kappa[:, segment]
    bent, ds = np.abs(signed)[:, None], length / count
    points = arcs(shape.segments[:, segment], signed * length, count + 1)
    radius, sagitta = geometry.fibre_radius_m, bent * ds**2 / 8
    longer = radius * np.sin(np.minimum(bent * ds / 2, math.pi / 2))
    a, b = points[:, :-1], points[:, 1:]
    within = np.maximum(radius - sagitta, _THIN_M)
    return strips(a, b, radius + sagitta, longer), strips(a, b, within)


def arcs(ends: Array, bend_rad: Array, count: int) -> Array:
    """Points along arcs between ends (m, 2, 2) that turn so far (m,), (m, count, 2)."""
    chord, share = ends[:, 1] - ends[:, 0], np.linspace(0.0, 1.0, count)
    half = bend_rad[:, None] / 2
    length = share * np.sinc(half * share / np.pi) / np.sinc(half / np.pi)  # of chords to points
    turn = half * (share - 1)  # from the chord of all to these
    c, s = length * np.cos(turn), length * np.sin(turn)
    x, y = chord[:, :1], chord[:, 1:]
    return ends[:, :1] + np.stack([c * x - s * y, s * x + c * y], axis=-1)


def strips(a: Array, b: Array, half_width: Array, longer: Array | float = 0.0) -> Array:
    """Rectangles along a to b (..., 2), counter-clockwise, (..., 4, 2)."""
    along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=-1, keepdims=True), _NO_LENGTH_M)
    across = half_width[..., None] * np.stack([-along[..., 1], along[..., 0]], axis=-1)
    further = np.asarray(longer)[..., None] * along
    a, b = a - further, b + further
    return np.stack([a - across, b - across, b + across, a + across], axis=-2)


@lru_cache(maxsize=32)
def reach_per_curvature_m2(geometry: Geometry) -> Array:
    """Reach of bending a segment: largest motion of a point seen from b0, per 1/m, (n,) [m2].

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


def moved_by_bending_m(geometry: Geometry, change_per_m: ArrayLike) -> float:
    """Largest motion of a point by bends ``change_per_m``, of all segments or each (n,) [m]."""
    left = geometry.inner_link_of_b0
    reach = reach_per_curvature_m2(geometry) * np.asarray(change_per_m)
    return float(max(reach[:left].sum(), reach[left:].sum()))


def kept_m(world: World, geometry: Geometry) -> float:
    """Distance kept by outer pieces, to rounding: the clearance, and what bends are off [m]."""
    uncertain_m = moved_by_bending_m(geometry, world.curvature_uncertainty_per_m)
    return world.clearance_m + uncertain_m - ROUNDING_M
