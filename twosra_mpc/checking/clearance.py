"""Clearance of a plan: GEOS distances of the drawn robot to obstacles, proved in between.

An opinion of its own: nothing here knows what is free, or how the planner separates pieces.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from twosra_mpc.checking.reintegration import paths
from twosra_mpc.checking.sweep import (
    CHORDS,
    Clearance,
    Stage,
    Sweep,
    least,
    sagitta_m,
    touched_in,
    uncertain_m,
)
from twosra_mpc.errors import InputError
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import Carried
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.ends import ends_to_check
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import OVERLAP_M, ROUNDING_M, kept_from_m
from twosra_mpc.problem.world import Object, Obstacle, Workspace, World
from twosra_mpc.robot.coordinates import POSE, Array, composed, rotation
from twosra_mpc.robot.geometry import Geometry

CONTACT_M = 5e-4  # by which contacts may differ in their distance
_CONTACTS_M = 1e-3  # between points of an edge that may be touched
_FINE_SIDES = 256  # of the polygons that stand for discs that are touched or carried
_LOOKED_AT_M = 1e-3  # between points of an overlap
_OVERLAPS = 60  # configurations of which it is asked how deep they overlap, at most
_WAYS_OUT = 24  # directions in which it is tried to move a thing away
_NO_LINE_M = 1e-7  # width at which a fibre without thickness is drawn
_NO_AREA_M2 = 1e-8  # a tenth of a millimetre, squared: rounding of the drawing
_GRID_M = 1e-9  # to which corners of unions are rounded: without, GEOS 3.14 may lose whole parts

Margin = tuple[float, str]  # of a limit [m], and what is wrong if it is negative


class Surroundings:
    """The obstacles of a world, asked how far configurations of a robot are from them.

    ``objects`` are obstacles as well; their discs are drawn finely, as they may be touched.
    """

    def __init__(self, world: World, geometry: Geometry, objects: Sequence[Obstacle] = ()) -> None:
        self.names = (*world.names, *(item.name for item in objects))
        self.geometry = geometry
        self._each = [shapely.Polygon(obstacle.corners_m) for obstacle in world.obstacles]
        self._each += [shapely.Polygon(fine_corners_m(item)) for item in objects]
        self._unite()

    def _unite(self) -> None:
        self._all = shapely.union_all(self._each, grid_size=_GRID_M)
        shapely.prepare(self._all)

    def only(self, some: NDArray[np.bool_]) -> Surroundings:
        """Some of the obstacles, (m,)."""
        part = copy(self)
        part.names = tuple(itertools.compress(self.names, some))
        part._each = list(itertools.compress(self._each, some))
        part._unite()
        return part

    def distances_m(self, q: Array) -> Array:
        """Distance of configurations (m, 3 + n) to the nearest obstacle, 0 where they overlap."""
        return _apart_m(self.geometry, _drawn(self.geometry, q), self._all)

    def distances_of_m(self, carried: Carrying, q: Array) -> Array:
        """Distance of what configurations (m, 3 + n) carry to the nearest obstacle, 0 if inside."""
        if carried.disc_m is None:
            return np.asarray(shapely.distance(self._all, shapely.polygons(carried.corners_m(q))))
        to_middle = shapely.distance(self._all, shapely.points(carried.poses(q)[:, :2]))
        return np.maximum(to_middle - carried.disc_m, 0.0)

    def signed_m(self, q: Array) -> Array:
        """As ``distances_m``; negative where they overlap, by the depth of the deepest point."""
        found = self.distances_m(q)
        for k in np.flatnonzero(found == 0).tolist():
            found[k] = min(0.0, self.nearest(q[k])[0])
        return found

    def nearest(self, q: Array, carried: Carrying | None = None) -> tuple[float, int, Array]:
        """Distance (negative: depth), obstacle and nearest points (2, 2) of one configuration."""
        body = self._body(q, carried)
        apart = shapely.distance(self._each, body)
        nearest = np.flatnonzero(apart <= apart.min()).tolist()
        depths = [self._depth(body, i) for i in nearest]
        depth, at = max(depths), nearest[int(np.argmax(depths))]
        line = shapely.get_coordinates(shapely.shortest_line(body, self._each[at]))
        return (-depth if apart[at] == 0 else float(apart[at])), at, line

    def each_m(self, q: Array, carried: Carrying | None = None) -> Array:
        """Distance (negative: depth) of one configuration to each obstacle, (m,)."""
        body = self._body(q, carried)
        found: Array = shapely.distance(self._each, body)
        for i in np.flatnonzero(found == 0).tolist():
            found[i] = -self._depth(body, i)
        return found

    def _body(self, q: Array, carried: Carrying | None) -> shapely.Geometry:
        """The robot as one geometry, fibre thickened, or what it carries."""
        if carried is not None:
            return shapely.Polygon(carried.corners_m(q[None])[0])
        solid, fibre = _drawn(self.geometry, q[None])
        radius = max(self.geometry.fibre_radius_m, _NO_LINE_M)
        thick = shapely.buffer(fibre[0], radius, quad_segs=16)
        return shapely.union_all([*shapely.get_parts(solid), thick], grid_size=_GRID_M)

    def _depth(self, body: shapely.Geometry, obstacle: int) -> float:
        """Depth of the deepest point of either in the other [m]."""
        shared = shapely.intersection(body, self._each[obstacle], grid_size=_GRID_M)
        if shapely.area(shared) == 0:
            return 0.0
        edges = shapely.segmentize(shapely.boundary(shapely.get_parts(shared)), _LOOKED_AT_M)
        points: Any = shapely.points(shapely.get_coordinates(edges))
        own_edges = [shapely.boundary(shape) for shape in (body, self._each[obstacle])]
        return float(np.max([shapely.distance(points, edge) for edge in own_edges]))


class Carrying:
    """An object that moves with b0, as a polygon that holds it."""

    def __init__(self, thing: Object, pose_in_b0: Array) -> None:
        self.name = thing.name
        self._pose_in_b0 = pose_in_b0
        self._own = fine_corners_m(thing.own)
        disc = thing.own.disc
        # Radius of a disc about its middle that holds those corners, if it is one.
        self.disc_m = None if disc is None else float(np.linalg.norm(self._own, axis=1).max())
        seen = fine_corners_m(thing.at(pose_in_b0))
        self.radius_m = float(np.linalg.norm(seen, axis=1).max())  # of its farthest point from b0

    def poses(self, q: Array) -> Array:
        """Poses of what configurations (m, 3 + n) carry, (m, 3)."""
        return composed(q[:, :POSE], self._pose_in_b0)

    def corners_m(self, q: Array) -> Array:
        """Corners of what configurations (m, 3 + n) carry, (m, corners, 2)."""
        poses = self.poses(q)
        return self._own @ rotation(poses[:, 2]) + poses[:, None, :2]


def fine_corners_m(item: Obstacle) -> Array:
    """Corners of a polygon that holds an obstacle, (m, 2); a disc's stray by 0.01 % of it."""
    disc = item.disc
    return item.corners_m if disc is None else disc.polygon(_FINE_SIDES, holds=True)


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


def depths_m(item: Obstacle, points: Array) -> Array:
    """Depths of points (..., 2) within a thing [m]; negative outside, by their distance."""
    shape, at = shapely.Polygon(fine_corners_m(item)), shapely.points(points)
    shapely.prepare(shape)
    inside = shapely.contains_properly(shape, at)
    to_edge = shapely.distance(shapely.boundary(shape), at)
    return np.where(inside, to_edge, -shapely.distance(shape, at))


def robot_distances_m(geometry: Geometry, q: Array, points: Array) -> Array:
    """Distance of points (..., 2) to a robot at a configuration (3 + n,), 0 within it [m]."""
    (solid,), (fibre,) = _drawn(geometry, q[None])
    return _apart_m(geometry, (solid, fibre), shapely.points(points))


def _apart_m(geometry: Geometry, drawn: tuple[Any, Any], others: Any) -> Array:
    """Distances of drawn robots, or of one, to something, 0 where they overlap [m]."""
    to_solid, to_fibre = (shapely.distance(part, others) for part in drawn)
    return np.maximum(np.minimum(to_solid, to_fibre - geometry.fibre_radius_m), 0.0)


def leaves_straight(geometry: Geometry, thing: Object, pose: Array, q: Array, far_m: float) -> bool:
    """True if a thing gets so far from a robot that rests at q (3 + n,), straight, overlap-free.

    It is asked of the hull of all that it passes, in directions all around.
    """
    (solid,), (fibre,) = _drawn(geometry, q[None])
    angles = np.arange(_WAYS_OUT) * math.tau / _WAYS_OUT
    ways = far_m * np.column_stack([np.cos(angles), np.sin(angles)])
    corners = fine_corners_m(thing.at(pose))
    passed = np.concatenate([np.tile(corners, (_WAYS_OUT, 1, 1)), corners + ways[:, None]], axis=1)
    hulls = shapely.convex_hull(shapely.linestrings(passed))
    free = shapely.distance(hulls, fibre) > geometry.fibre_radius_m
    return bool((free & ~shapely.intersects(hulls, solid)).any())


def contacts(geometry: Geometry, item: Obstacle, q: Array) -> tuple[Array, Array]:
    """Points of a thing's edge that a robot touches, and the normals into it there, (m, 2) each.

    These are the nearest, and those half a millimetre further away.
    """
    corners = fine_corners_m(item)
    sides = np.roll(corners, -1, axis=0) - corners
    long = np.linalg.norm(sides, axis=1)
    count = np.ceil(long / _CONTACTS_M).astype(int) + 1
    at = np.repeat(np.arange(len(corners)), count)
    share = (np.arange(len(at)) - (np.cumsum(count) - count)[at]) / (count - 1)[at]
    points = corners[at] + share[:, None] * sides[at]
    inward = (sides[:, ::-1] * [-1.0, 1.0] / long[:, None])[at]  # corners are counter-clockwise
    apart = robot_distances_m(geometry, q, points)
    near = apart <= apart.min() + CONTACT_M
    return points[near], inward[near]


def centroid_and_area(item: Obstacle) -> tuple[Array, float]:
    """Centroid (2,) [m] and area [m2] of a thing."""
    shape = shapely.Polygon(fine_corners_m(item))
    return shapely.get_coordinates(shapely.centroid(shape))[0], float(shapely.area(shape))


def closest(problem: Problem, sweep: Sweep, of: Sequence[Stage]) -> Clearance | None:
    """Closest approach of a sweep, and of what is carried, to what must be kept clear of."""
    found = [
        _closest(around, sweep, stage.first, stage.last, carried)
        for stage, around, carried in _pairs(problem, of)
    ]
    return min(found, key=lambda item: item.least_m, default=None)


def _pairs(
    problem: Problem, of: Iterable[Stage]
) -> Iterator[tuple[Stage, Surroundings, Carrying | None]]:
    """Yield each stage with what to keep clear of; where something is held, again for that."""
    for stage in of:
        if not stage.world.obstacles and not stage.resting:
            continue
        around = Surroundings(stage.world, problem.robot.geometry, stage.resting)
        yield stage, around, None
        if stage.held is not None:
            yield stage, around, carrying(problem, stage.held)


def carrying(problem: Problem, held: Carried) -> Carrying:
    """Objects that are held."""
    return Carrying(problem.objects[held.object], held.pose_in_b0)


def _closest(
    around: Surroundings, sweep: Sweep, first: int, last: int, carried: Carrying | None
) -> Clearance:
    """The nearest of the fine times ``first`` to ``last``; where some overlap, the deepest."""
    seen: list[NDArray[np.intp]] = []

    def distances(at: NDArray[np.intp]) -> Array:
        q = sweep.q[at]
        found = around.distances_m(q) if carried is None else around.distances_of_m(carried, q)
        seen.append(at[found == 0])
        return found

    travelled = sweep.travelled_m if carried is None else sweep.carried_m(carried.radius_m)
    found = least(distances, travelled, first, last)
    at, nearest = found.at, around.nearest(sweep.q[found.at], carried)
    overlapping = sorted({*np.concatenate(seen).tolist()})
    for other in overlapping[:: 1 + len(overlapping) // _OVERLAPS]:
        if (deeper := around.nearest(sweep.q[other], carried))[0] < nearest[0]:
            at, nearest = other, deeper
    least_m, obstacle, points = nearest
    drawn_m = sagitta_m(around.geometry, sweep.q[first : last + 1]) if carried is None else 0.0
    return Clearance(
        least_m=min(least_m, found.distance_m),
        proved_m=max(0.0, found.proved_m - drawn_m),
        at_s=float(sweep.t_s[at]),
        configuration=sweep.q[at],
        obstacle=obstacle,
        name=around.names[obstacle],
        points_m=points,
        of="" if carried is None else carried.name,
    )


def kept(trajectory: Trajectory, sweep: Sweep, of: Sequence[Stage]) -> Iterator[Margin]:
    """Margins of the clearance that a plan must keep.

    Uncertain curvatures add to what must be kept. A start that is nearer to some obstacles keeps
    its own distance from each of them, to the accuracy of the sweep, until its first leg ends: all
    that it moves in one direction. So does an object that stands nearer when it is taken.
    """
    problem = trajectory.problem
    needed = problem.clearance_m + uncertain_m(problem)
    for stage, around, carried in _pairs(problem, of):
        begins = stage.first == 0 if carried is None else stage.taken
        spans = [(around, stage.first, stage.last, needed)]
        if begins:
            spans = _leaving(trajectory, sweep, stage, around, carried)
        for obstacles, first, end, asked in spans:
            found = _closest(obstacles, sweep, first, end, carried)
            words = _too_near(problem, found, asked, asked < needed)
            yield _settled(found.least_m - asked), words


def _settled(margin_m: float) -> float:
    """A margin, zero within the rounding of drawings [m]."""
    return 0.0 if abs(margin_m) <= ROUNDING_M else margin_m


def _leaving(
    trajectory: Trajectory,
    sweep: Sweep,
    stage: Stage,
    around: Surroundings,
    carried: Carrying | None,
) -> list[tuple[Surroundings, int, int, float]]:
    """Obstacles, spans of fine times and what must be kept [m], where a stage may begin nearer."""
    problem, begin, last = trajectory.problem, stage.first, stage.last
    needed = problem.clearance_m + uncertain_m(problem)
    own = around.each_m(sweep.q[begin], carried)
    kept = kept_from_m(own, needed)
    near = kept < needed
    if not near.any() or own.min() < -ROUNDING_M:
        return [(around, begin, last, needed)]
    samples, now = trajectory.samples, sweep.t_s[begin]
    ways = (samples.t_s[end] for _, end, way, _ in paths(samples) if way.any())
    ends = next((end for end in ways if end > now), np.inf)
    away = min(int(np.searchsorted(sweep.t_s, ends)), last)
    spans = [(around.only(~near), begin, away, needed)] if not near.all() else []
    for i in np.flatnonzero(near).tolist():
        one = around.only(np.arange(len(own)) == i)
        spans.append((one, begin, away, float(kept[i])))
    return [*spans, (around, away, last, needed)] if away < last else spans


def within_m(problem: Problem, sweep: Sweep, of: Sequence[Stage]) -> Iterator[Margin]:
    """Margins of what is carried to the workspace's edges."""
    for stage in of:
        if stage.held is None or problem.workspace is None:
            continue
        carried, edges = carrying(problem, stage.held), problem.workspace

        def margins(at: NDArray[np.intp], of: Carrying = carried, to: Workspace = edges) -> Array:
            return to.margin_m(of.corners_m(sweep.q[at])).min(axis=-1)

        found = least(margins, sweep.carried_m(carried.radius_m), stage.first, stage.last)
        margin, when = _settled(found.distance_m), f"at {sweep.t_s[found.at]:z.1f} s"
        yield margin, f"the {carried.name} leaves the workspace by {-1e3 * margin:z.3g} mm {when}"


def overlap_left(problem: Problem, sweep: Sweep, of: Sequence[Stage]) -> Iterator[Margin]:
    """Margins of the overlap allowed with what may be touched."""
    for stage in of:
        for item in stage.touched:
            around = touching(problem, item)

            def signed(at: NDArray[np.intp], to: Surroundings = around) -> Array:
                return to.signed_m(sweep.q[at])

            found = least(signed, sweep.travelled_m, stage.first, stage.last, -OVERLAP_M)
            left = _settled(OVERLAP_M + min(found.distance_m, 0.0))
            deep, when = 1e3 * (OVERLAP_M - left), f"at {sweep.t_s[found.at]:z.1f} s"
            words = f"overlaps {item.name} by {deep:z.3g} mm {when}"
            yield left, f"{words} (where it may touch it, {1e3 * OVERLAP_M:zg} mm)"


def touching(problem: Problem, item: Obstacle) -> Surroundings:
    """One thing that may be touched."""
    return Surroundings(World(), problem.robot.geometry, (item,))


def _too_near(problem: Problem, found: Clearance, asked: float, own: bool) -> str:
    who = f"the {found.of} " if found.of else ""
    if found.least_m <= 0:
        deep = f"{-1e3 * found.least_m:z.3g} mm at {found.at_s:z.1f} s"
        return f"{who}runs into {found.name} by {deep}"
    here = f"comes within {1e3 * found.least_m:z.3g} mm of {found.name} at {found.at_s:z.1f} s"
    if own:
        since = "when it was taken" if found.of else "at its start"
        return f"{who}{here}, nearer than {since} ({1e3 * asked:z.3g} mm)"
    wide = 1e3 * (asked - problem.clearance_m)
    uncertain = f", and {wide:z.3g} mm for curvature_uncertainty_per_m" if wide else ""
    return f"{who}{here} (clearance_m = {1e3 * problem.clearance_m:zg} mm{uncertain})"


def check_obstacles(problem: Problem) -> None:
    """Refuse a start that overlaps something, and a goal that is too near to an obstacle.

    Only a goal that leaves little choice is: if that holds of its middle and of all its corners. A
    start may overlap what its first task takes as much as a plan may.

    Raises:
        InputError: Naming the end, the obstacles, and how deep the deepest point of either lies in
            the other, or what is missing of ``clearance_m``.
    """
    held, found = problem.start.holding, list[InputError]()
    things = [each.at(each.pose.pose) for each in problem.objects if each.name != held]
    obstacles, asked = (
        (problem.world, problem.robot.geometry),
        problem.clearance_m + uncertain_m(problem),
    )
    for name, q in ends_to_check(problem):
        if name == "start":
            around, touched = Surroundings(*obstacles, things), touched_in(problem, 0)
            needed = np.array([-OVERLAP_M if each in touched else 0.0 for each in around.names])
        else:
            around = Surroundings(*obstacles)
            own_m = np.maximum(around.each_m(problem.start.configuration), 0.0)
            needed = kept_from_m(own_m, asked)
        if (around.distances_m(q) > needed.max(initial=0.0)).any():
            continue
        each = np.array([around.each_m(one) for one in q])
        if (each < needed - ROUNDING_M).any(axis=1).all():
            allowed = _what_lacks(around, each[0], needed, asked)
            found.append(InputError(name, tuple(q[0].tolist()), allowed))
    if found:
        raise found[0].among(found[1:])


def _what_lacks(around: Surroundings, apart: Array, needed: Array, asked: float) -> str:
    """Requirement that an end of a problem breaks: overlaps, else what is too near."""
    named = [*zip(around.names, apart.tolist(), needed.tolist(), strict=True)]
    hit = [
        f"{name} by {-1e3 * m:z.1f} mm" for name, m, most in named if m < min(most, 0) - ROUNDING_M
    ]
    if hit:
        return f"a robot that overlaps no obstacle; here it overlaps {', '.join(hit)}"
    near = [
        f"{name} is {1e3 * m:z.3g} mm away, {1e3 * (least - m):z.3g} mm too near"
        for name, m, least in named
        if m < least
    ]
    return (
        f"a robot {1e3 * asked:z.3g} mm or more from every obstacle (clearance_m, and what"
        f" curvature_uncertainty_per_m adds); here {', '.join(near)}: move it or lower clearance_m"
    )


def check_apart(field: str, thing: Obstacle, world: World) -> None:
    """Refuse a thing that overlaps an obstacle, or is not within the workspace.

    Raises:
        InputError: Naming ``field``, and what it overlaps.
    """
    own = shapely.Polygon(thing.inner_corners_m)
    middle = tuple(shapely.get_coordinates(shapely.centroid(own))[0].tolist())
    for name, obstacle in zip(world.names, world.obstacles, strict=True):
        shared = shapely.intersection(own, shapely.Polygon(obstacle.inner_corners_m))
        if shapely.area(shared) > _NO_AREA_M2:
            allowed = f"a place where {thing.name} overlaps nothing; here it overlaps {name}"
            raise InputError(field, middle, allowed)
    edge = world.workspace
    if edge is not None and edge.margin_m(thing.inner_corners_m).min() < -ROUNDING_M:
        raise InputError(field, middle, f"a place where {thing.name} is within the workspace")
