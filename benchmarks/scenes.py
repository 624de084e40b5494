"""Random scenes: convex obstacles in a square workspace, and poses and shapes between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from twosra_mpc import InputError, Problem, load_robot
from twosra_mpc.problem.limits import broken_by_shapes
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.footprint import footprint
from twosra_mpc.space.separation import Separation

_TRIES = 10_000  # of the ends of a scene
LEAST_CLEARANCE_M = 0.005  # of start and goal, to obstacles and to the edge of the workspace


def scenes(
    name: str,
    *,
    robot: str,
    seed: int,
    count: int,
    obstacles: int,
    half_width_m: float,
    radius_m: tuple[float, float],
    curvature_per_m: float,
    clearance_m: float | None = None,
) -> Iterator[tuple[str, Problem]]:
    """Yield (label, problem) of random scenes; positions and headings are uniform.

    Args:
        name: Of the set.
        robot: A built-in robot, or a file.
        seed: Of all that is random.
        count: Scenes.
        obstacles: In each of them; they may overlap.
        half_width_m: Of the square workspace, whose middle is the origin.
        radius_m: Least and largest radius of the circles that the obstacles' corners lie on.
        curvature_per_m: Largest curvature of start and goal.
        clearance_m: What plans keep, and start and goal have; by default plans keep the usual, and
            start and goal have 5 mm.
    """
    rng, described = np.random.default_rng(seed), load_robot(robot)
    edges, ends_m = (-half_width_m, half_width_m), clearance_m or LEAST_CLEARANCE_M
    kept = {} if clearance_m is None else {"clearance_m": clearance_m}
    for number in range(count):
        things = tuple(_convex(rng, half_width_m, radius_m) for _ in range(obstacles))
        world = World(workspace={"x_m": edges, "y_m": edges}, obstacles=things, **kept)
        ends: list[dict[str, Any]] = []
        for _ in range(_TRIES):
            if len(ends) == 2:
                break
            position, heading = rng.uniform(*edges, 2), rng.uniform(-math.pi, math.pi)
            kappa = rng.uniform(-curvature_per_m, curvature_per_m, described.coordinates.segments)
            q = np.array([*position, heading, *kappa])
            allowed = broken_by_shapes(described, kappa[None]) is None
            if allowed and stands(described.geometry, world, q, ends_m):
                x, y, phi, *bends = q.tolist()
                ends.append({"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": tuple(bends)})
        if len(ends) < 2:
            raise InputError("obstacles", obstacles, "so few that a robot fits between them")
        start, goal = ends
        yield f"{name}/{number}", Problem(robot=described, start=start, goal=goal, **dict(world))


def stands(geometry: Geometry, world: World, q: Array, clearance_m: float) -> bool:
    """Whether a robot at q (3 + n,) keeps a clearance to obstacles and workspace [m]."""
    around = Separation(footprint(geometry, q[POSE:]), world, 0.0)
    return bool(around.distances(q[None, :POSE])[0] >= clearance_m)


def _convex(
    rng: np.random.Generator, half_width_m: float, radius_m: tuple[float, float]
) -> Obstacle:
    """A polygon of three to seven corners on a circle with its middle in the workspace."""
    count = int(rng.integers(3, 8))
    angles = math.tau * (np.arange(count) + rng.uniform(0.0, 0.8, count)) / count
    middle, radius = rng.uniform(-half_width_m, half_width_m, 2), rng.uniform(*radius_m)
    corners = middle + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return Obstacle(polygon_m=tuple((x, y) for x, y in corners.tolist()))
