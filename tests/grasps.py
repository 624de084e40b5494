"""Objects to grasp, and the robot drawn by hand."""

from __future__ import annotations

import numpy as np
import shapely

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.world import Object, Pose
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry

ORIGIN = Pose(x_m=0.0, y_m=0.0)


def disc(radius_m: float) -> Object:
    return Object(name="disc", pose=ORIGIN, disc={"radius_m": radius_m})


def cube(side_m: float) -> Object:
    half = side_m / 2
    return Object(name="cube", pose=ORIGIN, box={"x_m": (-half, half), "y_m": (-half, half)})


def pebble(seed: int) -> Object:
    """A random convex polygon, 30 to 60 mm across."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(5, 9)))
    around = rng.uniform(0.015, 0.03) * np.column_stack([np.cos(angles), np.sin(angles)])
    hull = shapely.MultiPoint(around * rng.uniform(0.7, 1.0, 2) + rng.uniform(-0.01, 0.01, 2))
    corners = shapely.get_coordinates(hull.convex_hull)[:-1]
    return Object(name="pebble", pose=ORIGIN, polygon_m=tuple(map(tuple, corners.tolist())))


def drawn(geometry: Geometry, q: Array) -> shapely.Geometry:
    """Units, wheels and the fibre with its radius, the fibre's arcs of 600 chords."""
    shape, radius = robot_shape(geometry, q, 601), geometry.fibre_radius_m
    parts = [shapely.Polygon(corners) for corners in (*shape.units, *shape.wheels)]
    links = [line for line in shape.links if np.ptp(line, axis=0).max() > 0]
    lines = [shapely.LineString(line) for line in (*shape.segments, *links)]
    parts += [line.buffer(radius, cap_style="flat", quad_segs=64) for line in lines]
    return shapely.union_all(parts, grid_size=1e-9)


def apart_m(body: shapely.Geometry, thing: Object, pose: Array | None = None) -> float:
    """Distance of a body to an object, minus about how deep they overlap [m]."""
    at = thing.at(np.zeros(3) if pose is None else pose)
    if at.disc is not None:
        return body.distance(shapely.Point(at.disc.x_m, at.disc.y_m)) - at.disc.radius_m
    polygon = shapely.Polygon(at.corners_m)
    if not body.intersects(polygon):
        return float(body.distance(polygon))
    shared = shapely.intersection(body, polygon)
    return -float(shared.area / max(shared.length / 2, 1e-12))


def overlap_m2(body: shapely.Geometry, thing: Object) -> float:
    """Area that a body shares with an object at the origin."""
    at = thing.own
    middle = None if at.disc is None else shapely.Point(at.disc.x_m, at.disc.y_m)
    shape = shapely.Polygon(at.corners_m) if middle is None else middle.buffer(at.disc.radius_m, 64)
    return float(shapely.intersection(body, shape).area)
