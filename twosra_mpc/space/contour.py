"""Outlines of things in their own frames, and how far parts of a robot are from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import POSE, Array, wrapped
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.footprint import arcs, strips

STATIONS = 72  # places around an outline at which the robot is laid on
_POINTS = 65  # along a segment: chords miss an arc of 40 mm and 40 1/m by 2 um
_THIN_M = 1e-9  # a line has some width: the rounding of metres
_CORE_M = 2e-5  # overlaps are seen down to this depth
_TOUCHES_M, _SPACING_M = 2e-5, 5e-4  # contacts: as near, and looked for as far apart
_STRAIGHT, _SHARP_RAD = 1e-6, 0.2  # sine to a side's normal; turn of a corner


@dataclass(frozen=True, eq=False)
class Contour:
    """The outline of a thing: a polygon, or a disc.

    Attributes:
        shape: Polygon, or centre of a disc.
        core: What is ``radius_m`` within it, the point in the middle of a disc.
        radius_m: Of the disc; of a polygon a little, so that it is seen how parts overlap it.
        is_disc: Whether it looks the same from everywhere.
    """

    shape: Any
    core: Any
    radius_m: float
    is_disc: bool

    @classmethod
    def of(cls, outline: Obstacle) -> Contour:
        """The contour of an obstacle, in the frame it is given in."""
        if outline.disc is not None:
            middle = shapely.Point(outline.disc.x_m, outline.disc.y_m)
            return cls(middle, middle, outline.disc.radius_m, True)
        polygon = shapely.Polygon(outline.corners_m)
        core = shapely.buffer(polygon, -_CORE_M, join_style="mitre")
        shapely.prepare(core)
        return cls(polygon, core, _CORE_M, False)

    @property
    def centroid(self) -> Array:
        """Centroid, (2,) [m]."""
        return shapely.get_coordinates(shapely.centroid(self.shape))[0]

    @property
    def area_m2(self) -> float:
        """Area."""
        return np.pi * self.radius_m**2 if self.is_disc else float(shapely.area(self.shape))

    @property
    def corners(self) -> Array:
        """Corners at which the outline turns by more than 0.2 rad, (m, 2)."""
        if self.is_disc:
            return np.zeros((0, 2))
        ring = shapely.get_coordinates(self.shape.exterior)[:-1]
        ahead = np.roll(ring, -1, axis=0) - ring
        way = np.arctan2(ahead[:, 1], ahead[:, 0])
        return ring[np.abs(wrapped(way - np.roll(way, 1))) > _SHARP_RAD]

    def off_m(self, points: Array) -> Array:
        """Distances of points (m, 2) [m], negative inside."""
        return self.distances(shapely.points(points))

    def distances(self, parts: Any) -> Array:
        """Distance of geometries, negative where they overlap, as many [m]."""
        return shapely.distance(self.core, parts) - self.radius_m

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
        return lines[..., 0, :], ahead / np.maximum(
            np.linalg.norm(ahead, axis=-1)[..., None], 1e-15
        )

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
    """Parts that move with one segment of a robot: its arc, and the link or the unit beyond it.

    Attributes:
        solids: Links, units and wheels, (m, pieces, 4, 2) [m].
        arcs: Centre line of the fibre, (m, arcs, points, 2).
    """

    solids: Array
    arcs: Array


def parts(geometry: Geometry, q: Array, segment: int | None) -> Parts:
    """Parts of configurations (m, 3 + n) that a segment moves; None: those that b0 is on."""
    charge(Cost.TOUCH, len(q))
    shape, inner = robot_shape(geometry, q, 2), geometry.inner_link_of_b0
    link = inner if segment is None else segment + (segment >= inner)
    none = segment is None and geometry.half_link_m == 0 and inner > 0
    ends = shape.links[:, [] if none else [link]]
    half_width = np.array(max(geometry.fibre_radius_m, _THIN_M))
    solids = [strips(ends[..., 0, :], ends[..., 1, :], half_width)]
    for unit in {0: [0], geometry.segments: [1]}.get(link, []):
        solids += [shape.units[:, [unit]], shape.wheels[:, 2 * unit : 2 * unit + 2]]
    fibre = np.zeros((len(q), 0, _POINTS, 2))
    if segment is not None:
        bend = q[:, POSE + segment] * geometry.lengths_m[segment]
        fibre = arcs(shape.segments[:, segment], bend, _POINTS)[:, None]
    return Parts(np.concatenate(solids, axis=1), fibre)


def apart_m(geometry: Geometry, contour: Contour, of: Parts) -> tuple[Array, Array]:
    """Least distances of solids and of arcs to a contour, negative where they overlap, (m,) [m].

    Chords are nearer to what is inside of the bend than the arc, by no more than their sagitta.
    """
    solid: Array = contour.distances(shapely.polygons(of.solids)).min(axis=1, initial=np.inf)
    fibre: Array = contour.distances(shapely.linestrings(of.arcs)).min(axis=1, initial=np.inf)
    return solid, fibre - geometry.fibre_radius_m


def farthest_m(geometry: Geometry, contour: Contour, q: Array, segment: int) -> Array:
    """Largest distance of a segment of configurations (m, 3 + n) from a contour, (m,) [m]."""
    points: Any = shapely.points(robot_shape(geometry, q, _POINTS).segments[:, segment])
    farthest: Array = contour.distances(points).max(axis=1)
    return farthest - geometry.fibre_radius_m


def wraps_rad(geometry: Geometry, contour: Contour, q: Array, side: Array, near_m: float) -> Array:
    """Turns of the normals of contacts of configurations (m, 3 + n) about a contour, (m,).

    Args:
        geometry: Lengths of the robot.
        contour: What they touch.
        q: Configurations.
        side: 1 with the contour on +y of b0, -1 on -y, (m,).
        near_m: As near counts as touching.
    """
    most = np.zeros((2, len(q)))  # towards LU1, towards LU2
    for j in range(geometry.segments):
        of, way = parts(geometry, q, j), 1 if j >= geometry.inner_link_of_b0 else -1
        ends: Any = shapely.points(of.arcs[:, 0, [0, -1]])
        lines: Any = shapely.linestrings(of.arcs)
        slim: Any = shapely.polygons(slimmer(of.solids))
        fibre = np.column_stack([lines, ends])
        _, into = contour.inwards(np.column_stack([slim, fibre]))
        near = [contour.distances(shapely.polygons(of.solids))]
        near += [contour.distances(fibre) - geometry.fibre_radius_m]
        angle = np.arctan2(into[..., 1], into[..., 0]) - q[:, None, 2]
        ahead = way * (side[:, None] * angle - np.pi / 2)  # from what b0 touches
        ahead = (ahead + np.pi / 2) % (2 * np.pi) - np.pi / 2
        turned = np.where(np.column_stack(near) <= near_m, ahead, 0.0).max(axis=1)
        most[(way + 1) // 2] = np.maximum(most[(way + 1) // 2], turned)
    return most.sum(axis=0)


def slimmer(boxes: Array) -> Array:
    """Boxes (..., 4, 2) with the same directions, within them."""
    return 0.99 * boxes + 0.01 * boxes.mean(axis=-2, keepdims=True)


def contacts(geometry: Geometry, contour: Contour, q: Array) -> tuple[Array, Array]:
    """Contacts of a configuration (3 + n,) with a contour, and normals into it, both (k, 2).

    Places on the outline at which a side or an arc of the robot is, and corners of the robot at
    sides of the outline. Corners at corners are left out: they have no normal.
    """
    boundary: Any = shapely.points(contour.boundary(_SPACING_M))
    sharp = shapely.multipoints(contour.corners)
    found, into = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for j in (None, *range(geometry.segments)):
        of = parts(geometry, q[None], j)
        boxes, slim = of.solids[0], slimmer(of.solids[0])
        for box, within in zip(boxes, slim, strict=True):
            near = boundary[shapely.distance(shapely.Polygon(box), boundary) <= _TOUCHES_M]
            ends, ahead = _lines(shapely.shortest_line(shapely.Polygon(within), near))
            axis = (box[1] - box[0]) / np.linalg.norm(box[1] - box[0])
            straight = np.abs(ahead @ axis * (ahead @ [-axis[1], axis[0]])) < _STRAIGHT
            found.append(ends[straight])
            into.append(ahead[straight])
            for corner, inside in zip(box, within, strict=True):
                if contour.distances(shapely.Point(corner)) <= _TOUCHES_M:
                    ends, ahead = _lines(
                        shapely.shortest_line([shapely.Point(inside)], contour.shape)
                    )
                    ends = ends - (contour.radius_m * ahead if contour.is_disc else 0.0)
                    if not shapely.dwithin(shapely.Point(ends[0]), sharp, _TOUCHES_M):
                        found.append(ends)
                        into.append(ahead)
        for arc in of.arcs[0]:
            line = shapely.LineString(arc)
            off = shapely.distance(line, boundary) - geometry.fibre_radius_m
            lines = shapely.shortest_line(line, boundary[off <= _TOUCHES_M])
            beside = ~shapely.dwithin(lines, shapely.multipoints(arc[[0, -1]]), _THIN_M)
            ends, ahead = _lines(lines[beside])
            found.append(ends)
            into.append(ahead)
    points, normals = np.concatenate(found), np.concatenate(into)
    if contour.is_disc:
        normals = (contour.centroid - points) / contour.radius_m
    return points, normals


def _lines(lines: Any) -> tuple[Array, Array]:
    """Ends of lines on the outline, and their directions, both (k, 2)."""
    ends = shapely.get_coordinates(lines).reshape(-1, 2, 2)
    ahead = ends[:, 1] - ends[:, 0]
    return ends[:, 1], ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
