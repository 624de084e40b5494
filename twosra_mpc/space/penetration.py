"""Penetration depth of a thing in convex pieces, and the shortest way out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array, rotation
from twosra_mpc.space.convex import convex_parts

_LIMIT_SURFACE = 0.6  # of the radius of gyration of the friction, by the square root of area / pi


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
    touched = np.flatnonzero(apart < 0)
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
    within = (normals @ points.T <= reach[..., None] + 1e-9).all(axis=1)  # (p, k, m)
    return np.any(within, axis=0)


def _shared(part: Array, piece: Array) -> Array:
    """Centroid of what two convex polygons share, (2,); they overlap."""
    return _centroid(shapely.intersection(shapely.Polygon(part), shapely.Polygon(piece)))
