"""Outlines of things in their own frames, and how far parts of a robot are from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry

STATIONS = 72  # places around an outline at which the robot is laid on
_POINTS = 65  # along a segment: chords miss an arc of 40 mm and 40 1/m by 2 um
_THIN_M = 1e-9


@dataclass(frozen=True, eq=False)
class Contour:
    """The outline of a thing: that of a polygon, or a disc about a point.

    Attributes:
        shape: Polygon, or centre of a disc.
        radius_m: Of the disc; 0 for a polygon.
    """

    shape: Any
    radius_m: float

    @classmethod
    def of(cls, outline: Obstacle) -> Contour:
        """The contour of an obstacle, in the frame it is given in."""
        if outline.disc is not None:
            disc = outline.disc
            return cls(shapely.Point(disc.x_m, disc.y_m), disc.radius_m)
        polygon = shapely.Polygon(outline.corners_m)
        shapely.prepare(polygon)
        return cls(polygon, 0.0)

    @property
    def is_disc(self) -> bool:
        """Whether it looks the same from everywhere."""
        return self.radius_m > 0

    @property
    def centroid(self) -> Array:
        """Centroid, (2,) [m]."""
        return shapely.get_coordinates(shapely.centroid(self.shape))[0]

    @property
    def area_m2(self) -> float:
        """Area."""
        return float(np.pi * self.radius_m**2 + shapely.area(self.shape))

    def distances(self, parts: Any) -> Array:
        """Distance of geometries, 0 or less where they overlap, as many [m]."""
        found: Array = shapely.distance(self.shape, parts) - self.radius_m
        return found

    def boundary(self, spacing_m: float) -> Array:
        """Points on the outline at most so far apart, corners among them, (m, 2)."""
        if not self.is_disc:
            ring = shapely.segmentize(shapely.boundary(self.shape), spacing_m)
            return shapely.get_coordinates(ring)[:-1]
        count = int(np.ceil(2 * np.pi * self.radius_m / spacing_m))
        angles = np.arange(count) * 2 * np.pi / count
        return self.centroid + self.radius_m * np.column_stack([np.cos(angles), np.sin(angles)])

    def inwards(self, parts: Any) -> tuple[Array, Array]:
        """Nearest points of geometries that do not overlap it, and directions into it, (..., 2)."""
        lines = shapely.get_coordinates(shapely.shortest_line(parts, self.shape))
        lines = lines.reshape(*np.shape(parts), 2, 2)
        ahead = lines[..., 1, :] - lines[..., 0, :]
        return lines[..., 0, :], ahead / np.maximum(np.linalg.norm(ahead, axis=-1)[..., None], 1e-15)

    def stations(self, apart_m: float) -> Array:
        """Poses at a distance from the outline, tangent to it, with +y into it, (m, 3).

        They are equally far from each other on the curve parallel to the outline, so that corners
        are met at several headings. A disc needs one.
        """
        if self.is_disc:
            x, y = self.centroid
            return np.array([[x, y - self.radius_m - apart_m, 0.0]])
        ring = shapely.get_parts(shapely.buffer(self.shape, max(apart_m, _THIN_M)))[0].exterior
        ring = ring if shapely.is_ccw(ring) else ring.reverse()
        places = np.arange(STATIONS) / STATIONS
        points = shapely.line_interpolate_point(ring, places, normalized=True)
        _, into = self.inwards(points)
        touched = shapely.get_coordinates(shapely.shortest_line(points, self.shape))[1::2]
        return np.column_stack([touched - apart_m * into, np.arctan2(-into[:, 0], into[:, 1])])


@dataclass(frozen=True, eq=False)
class Parts:
    """What moves with one segment of a robot: its arc, and the link or the unit beyond it.

    Attributes:
        solids: Links, units and wheels, (m, pieces, 4, 2) [m].
        arcs: Centre line of the fibre, (m, arcs, points, 2).
    """

    solids: Array
    arcs: Array


def parts(geometry: Geometry, q: Array, segment: int | None) -> Parts:
    """Parts of configurations (m, 3 + n) that a segment moves; None: those that b0 is on."""
    shape, inner, last = robot_shape(geometry, q, _POINTS), geometry.inner_link_of_b0, geometry.segments
    link = inner if segment is None else segment + (segment >= inner)
    none = segment is None and geometry.half_link_m == 0 and inner > 0
    solids = [_strips(shape.links[:, [] if none else [link]], geometry.fibre_radius_m)]
    for unit in {0: [0], last: [1]}.get(link, []):
        solids += [shape.units[:, [unit]], shape.wheels[:, 2 * unit : 2 * unit + 2]]
    arcs = shape.segments[:, [] if segment is None else [segment]]
    return Parts(np.concatenate(solids, axis=1), arcs)


def distances(geometry: Geometry, contour: Contour, of: Parts) -> Array:
    """Least distance of parts to a contour, (m,) [m]; at least -fibre radius where they overlap.

    Chords are nearer to what is inside of the bend than the arc, by no more than their sagitta.
    """
    solid: Array = contour.distances(shapely.polygons(of.solids)).min(axis=1, initial=np.inf)
    if not of.arcs.shape[1]:
        return solid
    fibre = contour.distances(shapely.linestrings(of.arcs)).min(axis=1)
    return np.minimum(solid, fibre - geometry.fibre_radius_m)


def wraps_rad(
    geometry: Geometry, contour: Contour, q: Array, side: int, touches_m: float
) -> Array:
    """How far normals of contacts turn along configurations (m, 3 + n) about a contour, (m,).

    Args:
        geometry: Lengths of the robot.
        contour: What they touch.
        q: Configurations.
        side: 1 with the contour on +y of b0, -1 on -y.
        touches_m: As near counts as touching.
    """
    most = np.zeros((2, len(q)))  # towards LU1, towards LU2
    for j in range(geometry.segments):
        of, way = parts(geometry, q, j), 1 if j >= geometry.inner_link_of_b0 else -1
        ends = shapely.points(of.arcs[:, 0, [0, -1]])
        fibre = np.column_stack([shapely.linestrings(of.arcs), ends])
        _, into = contour.inwards(np.column_stack([shapely.polygons(slimmer(of.solids)), fibre]))
        near = [contour.distances(shapely.polygons(of.solids))]
        near += [contour.distances(fibre) - geometry.fibre_radius_m]
        angle = np.arctan2(into[..., 1], into[..., 0]) - q[:, None, 2]
        ahead = way * (side * angle - np.pi / 2)  # from what b0 touches
        ahead = (ahead + np.pi / 2) % (2 * np.pi) - np.pi / 2
        turned = np.where(np.column_stack(near) <= touches_m, ahead, 0.0).max(axis=1)
        most[(way + 1) // 2] = np.maximum(most[(way + 1) // 2], turned)
    whole: Array = most.sum(axis=0)
    return whole


def slimmer(boxes: Array) -> Array:
    """Boxes (..., 4, 2) with the same directions, within them."""
    return 0.9 * boxes + 0.1 * boxes.mean(axis=-2, keepdims=True)


def _strips(line: Array, radius_m: float) -> Array:
    """Rectangles about lines (..., 2, 2), (..., 4, 2)."""
    a, b = line[..., 0, :], line[..., 1, :]
    along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=-1, keepdims=True), _THIN_M)
    across = max(radius_m, _THIN_M) * np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return np.stack([a - across, b - across, b + across, a + across], axis=-2)
