"""Outlines of things in their own frames: how far parts of a robot are, and how deep in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.world import Object, Obstacle
from twosra_mpc.robot.coordinates import POSE, Array, rotation, wrapped
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import arcs, strips

_LIMIT_SURFACE = 0.6  # of the radius of gyration of the friction, by the square root of area / pi
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

    Places on the outline to which a side or an arc of the robot is nearest, and corners of the
    robot nearest to sides of the outline: a gap around them closes as it pushes. Corners at corners
    are left out: they have no normal.
    """
    boundary: Any = shapely.points(contour.boundary(_SPACING_M))
    sharp = shapely.multipoints(contour.corners)
    found, into, all_of = [np.zeros((0, 2))], [np.zeros((0, 2))], (None, *range(geometry.segments))
    apart = (np.min(apart_m(geometry, contour, parts(geometry, q[None], j))) for j in all_of)
    touches_m = max(float(min(apart)), 0.0) + _TOUCHES_M
    for j in all_of:
        of = parts(geometry, q[None], j)
        boxes, slim = of.solids[0], slimmer(of.solids[0])
        for box, within in zip(boxes, slim, strict=True):
            near = boundary[shapely.distance(shapely.Polygon(box), boundary) <= touches_m]
            ends, ahead = _lines(shapely.shortest_line(shapely.Polygon(within), near))
            axis = (box[1] - box[0]) / np.linalg.norm(box[1] - box[0])
            straight = np.abs(ahead @ axis * (ahead @ [-axis[1], axis[0]])) < _STRAIGHT
            found.append(ends[straight])
            into.append(ahead[straight])
            for corner, inside in zip(box, within, strict=True):
                if contour.distances(shapely.Point(corner)) <= touches_m:
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
            lines = shapely.shortest_line(line, boundary[off <= touches_m])
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


class Contact(NamedTuple):
    """Overlap of a thing and a piece.

    Attributes:
        depth_m: How far it must be moved to be out.
        way: The direction, (2,).
        at: Where it is pushed, (2,) [m].
        piece: The piece that pushes it.
    """

    depth_m: float
    way: Array
    at: Array
    piece: int


class Pieces:
    """Convex polygons of as many corners each, counter-clockwise, (p, k, 2), and their sides."""

    def __init__(self, corners: Array) -> None:
        self.corners = corners
        self.ahead = np.roll(corners, -1, axis=1) - corners
        self.squared = (self.ahead**2).sum(axis=-1)
        self.normals, self.reach = _sides(corners)


class Thing:
    """An object's shape for contact: a disc as it is, anything else as convex parts.

    Attributes:
        middle: Its centroid in its own frame, (2,) [m].
        radius_m: Of a circle about its own origin that holds it.
        friction: Its coefficient against the robot.
        lever_m: c of its limit surface: a load (f, m) turns it by m / c^2 for every f it slides.
    """

    def __init__(self, item: Object) -> None:
        self.disc_m = None if item.disc is None else item.disc.radius_m
        self.friction = item.friction or 0.0
        self.own = item.own.corners_m
        self.parts = convex_parts(self.own)
        outline = shapely.Polygon(self.own)
        self.middle = _centroid(outline)
        self.radius_m = float(np.linalg.norm(self.own, axis=1).max())
        self.lever_m = _LIMIT_SURFACE * math.sqrt(outline.area / math.pi)

    def placed(self, pose: Array) -> list[Array]:
        """Its convex parts at a pose (3,), each (k, 2)."""
        turn = rotation(pose[2])
        return [part @ turn + pose[:2] for part in self.parts]

    def deepest(self, pose: Array, pieces: Pieces) -> Contact | None:
        """Deepest contact with pieces; None where there is none."""
        if self.disc_m is not None:
            found = _of_disc(pose[:2], self.disc_m, pieces)
        else:
            contacts = [_of_part(part, pieces) for part in self.placed(pose)]
            found = max(contacts, key=lambda contact: contact.depth_m)
        return found if found.depth_m > 0 else None


def _centroid(shape: shapely.Geometry) -> Array:
    """Centroid, (2,) [m]."""
    return shapely.get_coordinates(shapely.centroid(shape))[0]


def _sides(corners: Array) -> tuple[Array, Array]:
    """Outward normals of polygons (..., k, 2), and how far these reach on them, (..., k)."""
    ahead = np.roll(corners, -1, axis=-2) - corners
    normals = np.stack([ahead[..., 1], -ahead[..., 0]], axis=-1)
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    return normals, (normals * corners).sum(axis=-1)


def _of_disc(centre: Array, radius_m: float, pieces: Pieces) -> Contact:
    share = ((centre - pieces.corners) * pieces.ahead).sum(axis=-1) / pieces.squared
    nearest = pieces.corners + share.clip(0.0, 1.0)[..., None] * pieces.ahead
    away = np.linalg.norm(centre - nearest, axis=-1)
    beyond = (pieces.normals @ centre - pieces.reach).max(axis=1)  # of the farthest side
    inside = beyond <= 0
    distance = np.where(inside, beyond, away.min(axis=1))
    piece = int(distance.argmin())
    side = int(away[piece].argmin())
    way = pieces.normals[piece, side]
    if not inside[piece] and away[piece, side] > 0:
        way = (centre - nearest[piece, side]) / away[piece, side]
    return Contact(radius_m - float(distance[piece]), way, nearest[piece, side], piece)


def _of_part(part: Array, pieces: Pieces) -> Contact:
    """By separating axes; ways through a side that another piece hides do not lead out."""
    own, own_reach = _sides(part)
    corners, normals, reach = pieces.corners, pieces.normals, pieces.reach
    by_part = (corners @ own.T).min(axis=1) - own_reach
    by_piece = (normals @ part.T).min(axis=-1) - reach
    apart = np.maximum(by_part.max(axis=1), by_piece.max(axis=1))
    touched = np.flatnonzero(apart < -_THIN_M)
    deepest = Contact(0.0, np.zeros(2), np.zeros(2), 0)
    for piece in touched.tolist():
        middles = corners[piece] + pieces.ahead[piece] / 2
        hidden = _within(middles, np.delete(normals, piece, 0), np.delete(reach, piece, 0))
        depths = np.concatenate([-by_part[piece], np.where(hidden, np.inf, -by_piece[piece])])
        least = int(depths.argmin())
        if depths[least] > deepest.depth_m:
            way = np.concatenate([-own, normals[piece]])[least]
            at = _shared(part, corners[piece])
            deepest = Contact(float(depths[least]), way, at, piece)
    return deepest


def _within(points: Array, normals: Array, reach: Array) -> NDArray[np.bool_]:
    """True where points (m, 2) lie within any of the pieces with these sides."""
    within = (normals @ points.T <= reach[..., None] + _THIN_M).all(axis=1)  # (p, k, m)
    return np.any(within, axis=0)


def _shared(part: Array, piece: Array) -> Array:
    """Centroid of what two convex polygons share, (2,); they overlap."""
    return _centroid(shapely.intersection(shapely.Polygon(part), shapely.Polygon(piece)))
