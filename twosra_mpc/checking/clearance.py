"""How far a plan keeps from obstacles: GEOS distances of the drawn robot, proved in between.

An opinion of its own: nothing here knows what is free, or how the planner separates pieces.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from twosra_mpc.checking.reintegration import paths
from twosra_mpc.checking.sweep import CHORDS, Clearance, Sweep, least, sagitta_m, uncertain_m
from twosra_mpc.errors import InputError
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.limits import ends_to_check
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import UNSEEN_M, World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry

_LOOKED_AT_M = 1e-3  # between points of an overlap
_OVERLAPS = 60  # configurations of which it is asked how deep they overlap, at most
_NO_LINE_M = 1e-7
_ROUNDING_M = 1e-6
_GRID_M = 1e-9  # to which corners of unions are rounded: without, GEOS 3.14 may lose whole parts


class Surroundings:
    """The obstacles of a world, asked how far configurations of a robot are from them."""

    def __init__(self, world: World, geometry: Geometry) -> None:
        self.names = world.names
        self.geometry = geometry
        self._each = [shapely.Polygon(obstacle.corners_m) for obstacle in world.obstacles]
        self._all = shapely.union_all(self._each, grid_size=_GRID_M)
        shapely.prepare(self._all)

    def distances_m(self, q: Array) -> Array:
        """Distance of configurations (m, 3 + n) to the nearest obstacle, 0 where they overlap."""
        solid, fibre = _drawn(self.geometry, q)
        to_fibre = shapely.distance(self._all, fibre) - self.geometry.fibre_radius_m
        found: Array = np.maximum(np.minimum(shapely.distance(self._all, solid), to_fibre), 0.0)
        return found

    def nearest(self, q: Array) -> tuple[float, int, Array]:
        """Distance (negative: depth), obstacle and nearest points (2, 2) of one configuration."""
        body = self._body(q)
        apart = np.array([shapely.distance(shape, body) for shape in self._each])
        nearest = np.flatnonzero(apart <= apart.min()).tolist()
        depths = [self._depth(body, i) for i in nearest]
        depth, at = max(depths), nearest[int(np.argmax(depths))]
        line = shapely.get_coordinates(shapely.shortest_line(body, self._each[at]))
        return (-depth if apart[at] == 0 else float(apart[at])), at, line

    def overlaps(self, q: Array) -> Iterator[tuple[str, float]]:
        """Yield name and depth [m] of every obstacle that a configuration overlaps."""
        body = self._body(q)
        for i, name in enumerate(self.names):
            if (depth := self._depth(body, i)) > _ROUNDING_M:
                yield name, depth

    def _body(self, q: Array) -> shapely.Geometry:
        """The robot as one geometry, fibre thickened."""
        solid, fibre = _drawn(self.geometry, q[None])
        radius = max(self.geometry.fibre_radius_m, _NO_LINE_M)
        thick = shapely.buffer(fibre[0], radius, quad_segs=16)
        return shapely.union_all([*shapely.get_parts(solid), thick], grid_size=_GRID_M)

    def _depth(self, body: shapely.Geometry, obstacle: int) -> float:
        """Depth of the deepest point of either in the other [m]."""
        shared = shapely.intersection(body, self._each[obstacle], grid_size=_GRID_M)
        if shapely.area(shared) == 0:
            return 0.0
        edges = shapely.segmentize(shapely.boundary(shared), _LOOKED_AT_M)
        points: Any = shapely.points(shapely.get_coordinates(edges))
        own_edges = [shapely.boundary(shape) for shape in (body, self._each[obstacle])]
        return float(np.max([shapely.distance(points, edge) for edge in own_edges]))


def _drawn(geometry: Geometry, q: Array) -> tuple[Any, Any]:
    """Units, wheels and links of configurations (m, 3 + n), and the centre lines of segments."""
    shape = robot_shape(geometry, q, CHORDS + 1)
    a, b = shape.links[..., 0, :], shape.links[..., 1, :]
    long = np.linalg.norm(b - a, axis=-1, keepdims=True)
    along = (b - a) / np.maximum(long, _NO_LINE_M)
    across = max(geometry.fibre_radius_m, _NO_LINE_M) * along[..., ::-1] * np.array([-1.0, 1.0])
    links = np.stack([a - across, b - across, b + across, a + across], axis=-2)
    links = links[:, long[0, :, 0] > _NO_LINE_M]
    boxes = np.concatenate([shape.units, shape.wheels, links], axis=1)
    solid: Any = shapely.polygons(boxes.reshape(-1, 4, 2))
    fibre: Any = shapely.linestrings(shape.segments.reshape(-1, CHORDS + 1, 2))
    of_solid, of_fibre = (np.arange(len(part)) // (len(part) // len(q)) for part in (solid, fibre))
    return (
        shapely.multipolygons(solid, indices=of_solid),
        shapely.multilinestrings(fibre, indices=of_fibre),
    )


def closest(problem: Problem, sweep: Sweep) -> Clearance:
    """Where a sweep is nearest to an obstacle."""
    around = Surroundings(problem.world, problem.robot.geometry)
    return _closest(around, sweep, 0, len(sweep.t_s) - 1)


def _closest(around: Surroundings, sweep: Sweep, first: int, last: int) -> Clearance:
    """The nearest of the fine times ``first`` to ``last``; where some overlap, the deepest."""
    seen: list[NDArray[np.intp]] = []

    def distances(at: NDArray[np.intp]) -> Array:
        found = around.distances_m(sweep.q[at])
        seen.append(at[found == 0])
        return found

    found = least(distances, sweep.travelled_m, first, last)
    at, nearest = found.at, around.nearest(sweep.q[found.at])
    overlapping = np.unique(np.concatenate(seen))
    for other in overlapping[:: 1 + len(overlapping) // _OVERLAPS].tolist():
        if (deeper := around.nearest(sweep.q[other]))[0] < nearest[0]:
            at, nearest = other, deeper
    least_m, obstacle, points = nearest
    return Clearance(
        least_m=min(least_m, found.distance_m),
        proved_m=max(0.0, found.proved_m - sagitta_m(around.geometry, sweep.q[first : last + 1])),
        at_s=float(sweep.t_s[at]),
        configuration=sweep.q[at],
        obstacle=obstacle,
        name=around.names[obstacle],
        points_m=points,
    )


def kept(trajectory: Trajectory, sweep: Sweep) -> tuple[float, str]:
    """What is left of the clearance that a plan must keep [m], and what is wrong if too little.

    Uncertain curvatures add to what must be kept. A start that is nearer keeps its own distance, to
    the accuracy of the sweep, until its first leg ends: all that it moves in one direction.
    """
    problem, last = trajectory.problem, len(sweep.t_s) - 1
    around = Surroundings(problem.world, problem.robot.geometry)
    needed = problem.clearance_m + uncertain_m(problem)
    at_start, away = float(around.distances_m(sweep.q[:1])[0]), 0
    stretches = []
    if at_start < needed and not list(around.overlaps(sweep.q[0])):
        samples = trajectory.samples
        ways = (samples.t_s[end] for _, end, way, _ in paths(samples) if way.any())
        away = min(int(np.searchsorted(sweep.t_s, next(ways, np.inf))), last)
        stretches = [(0, away, max(at_start - UNSEEN_M, 0.0))]
    if away < last or not stretches:
        stretches.append((away, last, needed))
    worst, words = np.inf, ""
    for first, end, asked in stretches:
        found = _closest(around, sweep, first, end)
        margin = found.least_m - asked
        if abs(margin) <= _ROUNDING_M:
            margin = 0.0
        if margin < worst:
            worst, words = margin, _too_near(problem, found, asked, asked < needed)
    return worst, words


def _too_near(problem: Problem, found: Clearance, asked: float, own: bool) -> str:
    if found.least_m <= 0:
        return f"runs into {found.name} by {-1e3 * found.least_m:.3g} mm at {found.at_s:.1f} s"
    here = f"comes within {1e3 * found.least_m:.3g} mm of {found.name} at {found.at_s:.1f} s"
    if own:
        return f"{here}, nearer than at its start ({1e3 * asked:.3g} mm)"
    wide = 1e3 * (asked - problem.clearance_m)
    uncertain = f", and {wide:.3g} mm for curvature_uncertainty_per_m" if wide else ""
    return f"{here} (clearance_m = {1e3 * problem.clearance_m:g} mm{uncertain})"


def check_obstacles(problem: Problem) -> None:
    """Refuse a start, or a goal that leaves little choice, that overlaps an obstacle.

    A goal is refused if its middle and all its corners overlap.

    Raises:
        InputError: Naming the end, the obstacles, and how deep the deepest point of either lies in
            the other.
    """
    if not problem.obstacles:
        return
    around = Surroundings(problem.world, problem.robot.geometry)
    found = []
    for name, q in ends_to_check(problem):
        if (around.distances_m(q) > 0).any():
            continue
        hit = [f"{other} by {1e3 * deep:.1f} mm" for other, deep in around.overlaps(q[0])]
        if hit:
            allowed = f"a robot that overlaps no obstacle; here it overlaps {', '.join(hit)}"
            found.append(InputError(name, tuple(q[0].tolist()), allowed))
    if found:
        raise found[0].among(found[1:])
