r"""Separations of the robot's own parts from each other, for any number of segments.

Parts are units, wheels, end links, segments and the links between them. Each is one or more
rectangles: a segment has one for each of its chords, which holds its piece of the tube. Rectangles
are apart by the largest separation along any of their sides (separating axis theorem), minus the
depth where they overlap. That changes at most by as much as points of one move as seen from the
other. Circles around several of them bound it at little cost.

Parts that are joined cannot meet. A segment that turns by at most half a circle stays in front of
its end faces; what it is joined to there, another segment beyond a link included, is behind them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.chain import arc, composed, fibre_end_pose, fibre_poses
from twosra_mpc.model.rows import by_rows
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Body

UNIT_NAMES = ("unit 1", "unit 2")
FAR_M = 0.01  # separations beyond this are only bounded
_HALF_TURN = math.pi * (1 + 1e-9)  # rad, and rounding
_BATCH = 256  # shapes
_BESIDE_M = 1e-9  # rounding in where wheels are mounted


class Part(NamedTuple):
    """A part of the robot, in the frame of b0.

    Attributes:
        name: For messages.
        place: Along the fibre: 0 is LU1 and its end link, then segments (odd) and links in turn.
        rectangles: Middle (x, y), unit vector (c, s) along it and half lengths of each, 6xk.
        turned_rad: How far the fibre may turn from the part's end face towards LU1 to the far end
            of each rectangle, and likewise from the one towards LU2, (2, k); inf: it is in front.
        radius_m: Most of the half diagonals of its rectangles.
        around: Middle (x, y) and radius of a circle that holds it, and maybe others, 3x1.
    """

    name: str
    place: int
    rectangles: ca.SX
    turned_rad: Array
    radius_m: float
    around: ca.SX


class SelfCollision:
    """The separations of a robot's parts from each other.

    Attributes:
        names: Part of each of the k rectangles.
        bound: Kappa (n,) -> lower bound of the least distance between parts [m].
        reach_m: No point of a part moves by more than this, times the angle by which segments bend
            more, as seen from another part.
        eased_m2: How much less the two of a pair overlap, at most, per curvature of each segment,
            (pairs, n): only what bends between them counts.
    """

    def __init__(self, body: Body) -> None:
        kappa = ca.SX.sym("kappa", body.geometry.segments)
        parts = [*_parts(body, kappa)]
        part_of = [part for part in parts for _ in range(part.rectangles.shape[1])]
        self.names = [part.name for part in part_of]
        self.reach_m = _reach_m(body)
        stacked = ca.horzcat(*(part.rectangles for part in parts))
        self._rectangles = ca.Function("rectangles", [kappa], [stacked])
        self._radii_m = np.array([part.radius_m for part in part_of])
        first, second = np.array(_could_meet(parts)).T
        (straight,) = self._at(np.zeros((1, body.geometry.segments)))
        places = np.array([part.place for part in part_of])
        kept = separation(straight[:, first], straight[:, second]) > 0
        kept |= places[second] - places[first] != 1  # else it is mounted above its own segment
        self._first, self._second = first[kept], second[kept]
        self.eased_m2 = self._eased_m2(body, places, np.hstack([part.turned_rad for part in parts]))
        circles = {
            (id(part_of[i].around), id(part_of[k].around)): (part_of[i].around, part_of[k].around)
            for i, k in zip(self._first, self._second, strict=True)
        }
        apart = [ca.norm_2(a[:2] - b[:2]) - a[2] - b[2] for a, b in circles.values()]
        self.bound = ca.Function("bound", [kappa], [ca.mmin(ca.vertcat(*apart))], {"cse": True})

    def units(self, kappa: ca.SX) -> ca.SX:
        """Separation of the two units in a shape [m]."""
        rectangles = self._rectangles(kappa)
        first, second = (rectangles[:, self.names.index(name)] for name in UNIT_NAMES)
        return separation(first, second)

    def least(self, kappa: ca.SX) -> ca.SX:
        """Least separation in a shape [m]."""
        rectangles = self._rectangles(kappa)
        pairs = (rectangles[:, at.tolist()] for at in (self._first, self._second))
        return ca.mmin(separation(*pairs).T)

    def separations(self, kappa: Array) -> Array:
        """Separation of each pair of rectangles in shapes (m, n), (m, pairs) [m].

        Those beyond `FAR_M` are lower bounds.
        """
        batches = (kappa[i : i + _BATCH] for i in range(0, len(kappa), _BATCH))
        return np.concatenate([np.zeros((0, len(self._first))), *map(self._separations, batches)])

    def nearest(self, kappa: Array) -> tuple[str, str, float]:
        """The two parts that are nearest, or overlap most, in a shape (n,), and how far apart."""
        found = self.separations(kappa[None])[0]
        k = int(found.argmin())
        return self.names[self._first[k]], self.names[self._second[k]], float(found[k])

    def _eased_m2(self, body: Body, places: Array, turned_rad: Array) -> Array:
        """As ``eased_m2``: what points of one travel at most, as seen from the other.

        That holds for overlaps, which are the least way out. To a chord only the arc s up to its
        far end counts: it travels by s (s / 2 + its radius), and grows by less than s (s / 2 + the
        radius of the fibre).
        """
        segments, lengths_m = 2 * np.arange(body.geometry.segments) + 1, body.geometry.lengths_m
        arcs_m = np.where(places % 2, turned_rad, 0.0) / body.limits.curvature_per_m
        far_m = np.minimum(arcs_m + self._radii_m + body.geometry.fibre_radius_m, self.reach_m)
        own: Array = arcs_m * far_m
        first, second = (places[ends, None] - segments for ends in (self._first, self._second))
        between = self.reach_m * np.array(lengths_m) * ((first < 0) & (second > 0))
        ends = own[1, self._first, None] * (first == 0) + own[0, self._second, None] * (second == 0)
        return np.asarray(between + ends)

    def _separations(self, kappa: Array) -> Array:
        rectangles = self._at(kappa)
        between = rectangles[:, :2, self._second] - rectangles[:, :2, self._first]
        found: Array = np.hypot(between[:, 0], between[:, 1])
        found -= self._radii_m[self._first] + self._radii_m[self._second]
        row, pair = np.nonzero(found < FAR_M)
        near = (rectangles[row, :, at[pair]].T for at in (self._first, self._second))
        found[row, pair] = separation(*near)
        return found

    def _at(self, kappa: Array) -> Array:
        """Rectangles in shapes (m, n), (m, 6, k)."""
        (found,) = by_rows(self._rectangles, kappa)
        return found.reshape(len(kappa), -1, 6).swapaxes(1, 2)


@per_body()
def self_collision(body: Body) -> SelfCollision:
    """Write down the separations of all parts of a robot that could meet."""
    return SelfCollision(body)


def separation(a: Any, b: Any) -> Any:
    """Separations of rectangles along their sides, as columns of `Part`: arrays or symbols."""
    symbolic = isinstance(a, ca.SX)
    largest, size = (ca.fmax, ca.fabs) if symbolic else (np.maximum, np.abs)
    (ax, ay, ac, az, al, aw), (bx, by, bc, bz, bl, bw) = (
        [r[i, :] for i in range(6)] for r in (a, b)
    )
    x, y, c, s = bx - ax, by - ay, size(ac * bc + az * bz), size(ac * bz - az * bc)
    by_a = largest(
        size(ac * x + az * y) - al - c * bl - s * bw, size(ac * y - az * x) - aw - s * bl - c * bw
    )
    by_b = largest(
        size(bc * x + bz * y) - bl - c * al - s * aw, size(bc * y - bz * x) - bw - s * al - c * aw
    )
    return largest(by_a, by_b)


def _parts(body: Body, kappa: ca.SX) -> Iterator[Part]:
    geometry, q = body.geometry, ca.vertcat(0, 0, 0, kappa)
    yield from _unit(body, q, 0)
    for j in range(geometry.segments):
        yield _segment(body, q, j)
        if j + 1 < geometry.segments and geometry.middle_link_m:
            joint, half = fibre_poses(geometry, q, j, ca.DM(1.0)), geometry.middle_link_m / 2
            pose, name = composed(joint, ca.DM([half, 0.0, 0.0])), f"{j + 1} and {j + 2}"
            size = half, geometry.fibre_radius_m
            around = ca.vertcat(pose[:2], math.hypot(*size))
            name = f"the link between segments {name}"
            yield _rigid(name, 2 * j + 2, pose, size, around)
    yield from _unit(body, q, 1)


def _unit(body: Body, q: ca.SX, unit: int) -> Iterator[Part]:
    """A locomotion unit, its wheels and its end link."""
    geometry, side = body.geometry, (-1, 1)[unit]
    end, place = fibre_end_pose(geometry, q, unit), unit * 2 * geometry.segments
    half, outward = geometry.unit_frame_m / 2, geometry.end_link_m / 2
    out_m, aside_m = geometry.unit_middle_m
    tread = geometry.wheel_radius_m, geometry.wheel_thickness_m / 2
    wheels, middle_m = (2 * unit, 2 * unit + 1), (side * out_m, aside_m, 0.0)
    boxes = [(UNIT_NAMES[unit], middle_m, (half, half))]
    boxes += [(f"wheel {i + 1}", geometry.wheel_placement[i], tread) for i in wheels]
    extents = np.array([_extent(pose, size) for _, pose, size in boxes])
    low, high = extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)
    middle = composed(end, ca.DM([*(low + high) / 2, 0.0]))
    around = ca.vertcat(middle[:2], math.hypot(*(high - low) / 2))
    for (name, pose, size), inner in zip(boxes, (side * extents[..., 0]).min(axis=1), strict=True):
        yield _rigid(name, place, composed(end, ca.DM(pose)), size, around, inner >= -_BESIDE_M)
    link = composed(end, ca.DM([side * outward, 0.0, 0.0]))
    size = outward, geometry.fibre_radius_m
    around = ca.vertcat(link[:2], math.hypot(*size))
    yield _rigid(f"the link of unit {unit + 1}", place, link, size, around)


def _extent(pose: tuple[float, float, float], size: tuple[float, float]) -> tuple[Array, Array]:
    """Least and largest (x, y) of a rectangle."""
    c, s = abs(math.cos(pose[2])), abs(math.sin(pose[2]))
    reach = np.array([c * size[0] + s * size[1], s * size[0] + c * size[1]])
    return np.array(pose[:2]) - reach, np.array(pose[:2]) + reach


def _rigid(
    name: str,
    place: int,
    pose: ca.SX,
    size: tuple[float, float],
    around: ca.SX,
    behind: bool = True,
) -> Part:
    rectangle = ca.vertcat(pose[:2], ca.cos(pose[2]), ca.sin(pose[2]), *size)
    turned_rad = np.full((2, 1), 0.0 if behind else math.inf)
    return Part(name, place, rectangle, turned_rad, math.hypot(*size), around)


def _segment(body: Body, q: ca.SX, segment: int) -> Part:
    """Rectangles about the chords of a segment.

    The tube over ds lies between its radius r outside of the arc's middle, and r + abs(kappa) ds^2
    / 8 inside of it; it is no longer than ds (1 + abs(kappa) r).
    """
    geometry, radius = body.geometry, body.geometry.fibre_radius_m
    length, kappa = geometry.lengths_m[segment], q[POSE + segment]
    most = body.limits.curvature_per_m
    count = body.chords(segment)
    ds = length / count
    pose, step = fibre_poses(geometry, q, segment, ca.DM(0.5 / count)), arc(kappa, ca.DM(ds))
    inward, rectangles = kappa * ds**2 / 16, []
    half = ca.vertcat(ds / 2 * (1 + ca.fabs(kappa) * radius), radius + ca.fabs(inward))
    for _ in range(count):
        c, s = ca.cos(pose[2]), ca.sin(pose[2])
        rectangles.append(ca.vertcat(pose[0] - s * inward, pose[1] + c * inward, c, s, half))
        pose = composed(pose, step)
    ends = fibre_poses(geometry, q, segment, ca.DM([[0.0, 1.0]]))[:2, :]
    corner = radius + most * ds * (radius + ds / 4)
    around = ca.vertcat(ca.sum2(ends) / 2, length / 2 + corner)
    numbers = np.arange(count)
    turned_rad = most * ds * np.array([numbers + 1, count - numbers])
    radius_m = math.hypot(ds / 2 * (1 + most * radius), radius + most * ds**2 / 16)
    name = f"the fibre of segment {segment + 1}"
    return Part(name, 2 * segment + 1, ca.horzcat(*rectangles), turned_rad, radius_m, around)


def _could_meet(parts: list[Part]) -> list[tuple[int, int]]:
    """Pairs of rectangles, by number, of parts that are not joined; the first nearer to LU1."""
    found, begin = [], 0
    for n, a in enumerate(parts):
        size = a.rectangles.shape[1]
        first = begin
        for b in parts[n:]:
            joints, of_fibre = b.place - a.place, a.place % 2 == 1
            for i, k in itertools.product(range(size), range(b.rectangles.shape[1])):
                turned = max(a.turned_rad[1, i], b.turned_rad[0, k])
                if not joints:  # the same segment, from the one to the other, or the same unit
                    ahead = a.turned_rad[1, i] - a.turned_rad[1, 0] + a.turned_rad[0, k]
                    turned = ahead if of_fibre and i < k else 0.0
                joined = joints < 2 or (joints == 2 and of_fibre)
                if not joined or turned > _HALF_TURN:
                    found.append((begin + i, first + k))
            first += b.rectangles.shape[1]
        begin += size
    return found


def _reach_m(body: Body) -> float:
    """Farthest that parts may be from where the fibre bends, and what chords grow per angle [m]."""
    geometry = body.geometry
    half, (out_m, aside_m) = geometry.unit_frame_m / 2, geometry.unit_middle_m
    corners = [math.hypot(out_m + half, half + abs(aside_m))]
    tread = math.hypot(geometry.wheel_radius_m, geometry.wheel_thickness_m / 2)
    corners += [math.hypot(x, y) + tread for x, y, _ in geometry.wheel_placement]
    links = (geometry.segments - 1) * geometry.middle_link_m
    grown = max(geometry.lengths_m) / 8 + geometry.fibre_radius_m
    return sum(geometry.lengths_m) + links + max(corners) + grown
