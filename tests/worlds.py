"""Scenes among obstacles that tests share, and what is free in them, worked out another way."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from shapely import affinity

from twosra_mpc import load_robot
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array

ARC_ROBOT = load_robot("2sra-v1")
STRAIGHT = (0.0, 0.0)


def random_world(seed: int, count: int = 6, **overrides: Any) -> World:
    """Random obstacles in a workspace of 1.2 x 1.2 m: convex ones, L-shaped ones and discs."""
    rng = np.random.default_rng(seed)
    obstacles: list[dict[str, Any]] = []
    for i in range(count):
        x, y = rng.uniform(-0.5, 0.5, 2)
        size = rng.uniform(0.03, 0.09)
        if i % 3 == 0:
            around = shapely.MultiPoint(size * rng.normal(size=(6, 2)) + [x, y]).convex_hull
            obstacles.append({"polygon_m": shapely.get_coordinates(around)[:-1].tolist()})
        elif i % 3 == 1:
            corners = [(0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 2), (0, 2)]
            bent = affinity.rotate(shapely.Polygon(size * np.array(corners)), 360 * rng.uniform())
            moved = shapely.get_coordinates(affinity.translate(bent, x, y))[:-1]
            obstacles.append({"polygon_m": moved.tolist()})
        else:
            obstacles.append({"disc": {"x_m": x, "y_m": y, "radius_m": size}})
    edges = {"x_m": (-0.6, 0.6), "y_m": (-0.6, 0.6)}
    return World(**{"workspace": edges, "obstacles": obstacles, **overrides})


def corridor(width_m: float, length_m: float = 0.35) -> World:
    """Two walls along x with a gap between them about y = 0."""
    half = length_m / 2
    walls = [
        {"box": {"x_m": (-half, half), "y_m": (width_m / 2, 0.5)}},
        {"box": {"x_m": (-half, half), "y_m": (-0.5, -width_m / 2)}},
    ]
    return World(workspace={"x_m": (-0.7, 0.7), "y_m": (-0.45, 0.45)}, obstacles=walls)


def drawn(kappa: tuple[float, ...]) -> shapely.Geometry:
    """The robot at the origin: units, wheels, and all within the radius of the fibre."""
    geometry = ARC_ROBOT.geometry
    shape = robot_shape(geometry, [0.0, 0.0, 0.0, *kappa], 200)
    lines = shapely.linestrings(shape.segments).tolist() + shapely.linestrings(shape.links).tolist()
    tube = [line.buffer(geometry.fibre_radius_m, cap_style="flat") for line in lines]
    rigid = shapely.polygons(np.concatenate([shape.units, shape.wheels])).tolist()
    return shapely.union_all([*tube, *rigid])


def true_margins(world: World, kappa: tuple[float, ...], poses: Array) -> Array:
    """Distance to obstacles less the clearance, or to the edge of the workspace, (m,) [m]."""
    robot = drawn(kappa)
    solid = shapely.union_all([_solid(obstacle) for obstacle in world.obstacles])
    shapely.prepare(solid)
    corners = shapely.get_coordinates(robot)
    found = []
    for x, y, phi in poses:
        c, s = np.cos(phi), np.sin(phi)
        placed = corners @ np.array([[c, s], [-s, c]]) + [x, y]
        there = affinity.affine_transform(robot, [c, -s, s, c, x, y])
        distance = shapely.distance(there, solid)
        inside = np.inf if world.workspace is None else world.workspace.margin_m(placed).min()
        found.append(min(float(distance) - world.clearance_m, float(inside)))
    return np.array(found)


def _solid(obstacle: Any) -> shapely.Geometry:
    if obstacle.disc is not None:
        disc = obstacle.disc
        return shapely.Point(disc.x_m, disc.y_m).buffer(disc.radius_m, quad_segs=64)
    return shapely.Polygon(obstacle.corners_m)
