"""Holds of objects: proof that one cannot leave, or friction while it is pushed.

An opinion of its own: nothing here knows slices, pieces or how the planner grasps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.checking.clearance import (
    centroid_and_area,
    contacts,
    depths_m,
    leaves_straight,
    robot_distances_m,
)
from twosra_mpc.checking.sweep import sagitta_m
from twosra_mpc.effort import Cost, charge
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse, rotation
from twosra_mpc.robot.geometry import Geometry

Bools = NDArray[np.bool_]

# Sides of boxes, and how far around the object's pose it is looked, in x and in y [m].
_LEVELS = ((6e-3, 0.12), (2e-3, 0.12), (1e-3, 0.06), (5e-4, 0.04), (2.5e-4, 0.015))
_FAR_M = math.sqrt(2) * _LEVELS[0][1]  # beyond all of them
_TURN = 0.18  # [m]: boxes of a side s are 2 pi s / _TURN high
_WITHIN_M = 1e-5  # rounding of drawings
_ALONG = 60  # points at which discs within an object may have their centres, along its longer side
_SLIVER = 0.02  # of an object's largest disc: what smaller discs must add to count
_SURFACE = 0.6  # of the radius of a disc as large: where friction under an object acts
_AT_ONCE = 1000  # boxes
_MISSED = 1e-3  # of a load: what contact forces may miss of it


def cage_proved(
    geometry: Geometry,
    thing: Object,
    pose: Array,
    q: Array,
    overlap_m: float,
    finest_m: float = 0.0,
) -> bool:
    """True if an object provably cannot leave the robot at a configuration; False: unknown.

    The object's poses are cut into boxes (x, y, heading). A disc within the object that overlaps
    the robot by more than it moves over a box blocks that box; what is left is flooded from where
    the object is, and must not come to the edge of what is looked at. So nothing rests on samples:
    a box counts as free unless all of it is proved to be blocked. The object is taken to be smaller
    by ``overlap_m`` all around, so that it may begin where it touches. Where it can be moved
    straight out there is no proof to be looked for.

    Args:
        geometry: The robot's.
        thing: The object.
        pose: Where it is, (3,).
        q: The robot, (3 + n,).
        overlap_m: How deep it overlaps the robot there [m].
        finest_m: Smallest side of a box.
    """
    seen = composed(inverse(q[:POSE]), pose)
    still = np.concatenate([np.zeros(POSE), q[POSE:]])  # b0 is the frame
    if leaves_straight(geometry, thing, seen, still, _FAR_M):
        return False
    discs = _discs(thing)
    discs[:, 2] -= overlap_m + _WITHIN_M
    for step, within_m in (level for level in _LEVELS if level[0] >= finest_m):
        headings = 1 if thing.disc is not None else round(_TURN / step)
        boxes = Boxes(step, round(within_m / step), headings)
        free = _free(geometry, still, seen, discs, boxes)
        if not _leads_away(free, headings):
            return True
    return False


class Boxes(NamedTuple):
    """Boxes of poses: their side in x and y [m], how many each way, and how many headings."""

    step: float
    each_way: int
    headings: int


def _discs(thing: Object) -> Array:
    """Discs within an object that nearly fill it: x, y, radius, (m, 3)."""
    if thing.disc is not None:
        return np.array([[0.0, 0.0, thing.disc.radius_m]])
    own = thing.own
    low, high = own.corners_m.min(axis=0), own.corners_m.max(axis=0)
    along = np.arange(0.5, _ALONG) * float((high - low).max()) / _ALONG
    x, y = np.meshgrid(along[along < high[0] - low[0]], along[along < high[1] - low[1]])
    points = np.vstack([low + np.column_stack([x.ravel(), y.ravel()]), low + (high - low) / 2])
    depth = depths_m(own, points)
    order = np.argsort(-depth, kind="stable")
    left = np.column_stack([points, depth])[order[depth[order] > 0]]
    found = []
    while len(left):
        found.append(disc := left[0])
        beyond = np.hypot(*(left[:, :2] - disc[:2]).T) + left[:, 2] - disc[2]
        left = left[beyond > _SLIVER * depth.max()]
    return np.array(found).reshape(-1, 3)


def _free(
    geometry: Geometry, q: Array, pose: Array, discs: Array, boxes: Boxes
) -> Callable[[int], Bools]:
    """Number of a heading -> boxes around a pose that are not proved to be blocked, (x, y).

    The pose is in the middle of the middle one of the first heading.
    """
    step, each_way, headings = boxes
    offset = np.linalg.norm(discs[:, :2], axis=1)
    pad = math.ceil(float(offset.max()) / step) + 1
    along = step * np.arange(-each_way - pad, each_way + pad + 1)
    points = np.stack(np.meshgrid(pose[0] + along, pose[1] + along, indexing="ij"), axis=-1)
    charge(Cost.POINT, points[..., 0].size)
    apart = robot_distances_m(geometry, q, points) + sagitta_m(geometry, q[None])
    moved = step / math.sqrt(2) + offset * math.pi / headings  # within a box
    moved += np.where(offset > 0, step / math.sqrt(2), 0.0)  # centres are looked up at grid points
    count = 2 * each_way + 1

    def free(heading: int) -> Bools:
        charge(Cost.BOX, len(discs) * count**2 // _AT_ONCE)
        phi, found = pose[2] + heading * math.tau / headings, np.ones((count, count), dtype=bool)
        begin = pad + np.rint(discs[:, :2] @ rotation(phi) / step).astype(int)
        for (i, j), reach in zip(begin.tolist(), (discs[:, 2] - moved).tolist(), strict=True):
            found &= apart[i : i + count, j : j + count] >= reach
        return found

    return free


def _leads_away(free: Callable[[int], Bools], headings: int) -> bool:
    """True if free boxes that share sides lead from the middle to the edge in x and y.

    Headings go round, and are asked for when the flood comes to them.
    """
    dry = {0: free(0)}
    middle = np.zeros_like(dry[0])
    middle[tuple(size // 2 for size in middle.shape)] = True
    floods = {0: middle}
    while floods:
        heading, flood = floods.popitem()
        if heading not in dry:
            dry[heading] = free(heading)
        boxes = dry[heading]
        flood = _filled(boxes, flood & boxes)
        if flood[[0, -1]].any() or flood[:, [0, -1]].any():
            return True
        if flood.any():
            boxes &= ~flood
            for beside in ((heading - 1) % headings, (heading + 1) % headings):
                floods[beside] = floods.get(beside, False) | flood
    return False


def _filled(free: Bools, flood: Bools) -> Bools:
    """Free boxes of one heading to which a flood gets, along rows and columns."""
    lines = (_runs(free), _runs(free.T).T)
    while True:
        before = flood
        for runs in lines:
            wet = np.zeros(free.size + 1, dtype=bool)
            wet[runs[flood]] = True
            flood = wet[runs] & free
        if np.array_equal(flood, before):
            return flood


def _runs(free: Bools) -> NDArray[np.intp]:
    """Numbers of the runs of free boxes along rows."""
    begins = free.copy()
    begins[:, 1:] &= ~free[:, :-1]
    return begins.ravel().cumsum().reshape(free.shape)


def pushes(geometry: Geometry, thing: Object, pose_in_b0: Array, q: Array, twists: Array) -> Bools:
    """True for twists (m, 3) of b0 that push an object such that it stays in the robot, (m,).

    Friction under an object that slides slowly resists a load (v, c^2 w) about its centroid, where
    c is 0.6 of the radius of a disc as large (an ellipsoidal limit surface). It stays if contact
    forces within their friction cones add up to that load. Contacts are the points of its edge
    that are nearest to the robot, and those half a millimetre further away.
    """
    from scipy.optimize import nnls  # only then anyone waits for it

    still = np.concatenate([np.zeros(POSE), q[POSE:]])  # b0 is the frame
    placed = thing.at(pose_in_b0)
    points, inward = contacts(geometry, placed, still)
    (x, y), area = centroid_and_area(placed)
    c = _SURFACE * math.sqrt(area / math.pi)
    angle = math.atan(thing.friction or 0.0)
    forces = np.concatenate([inward @ rotation(angle), inward @ rotation(-angle)])
    arms = np.tile(points - [x, y], (2, 1))
    moments = arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]
    cone = np.column_stack([forces, moments / c]).T
    u, v, r = twists.T
    loads = np.column_stack([u - r * y, v + r * x, c * r])
    size = np.linalg.norm(loads, axis=1, keepdims=True)
    loads = np.round(loads / np.where(size > 0, size, 1.0), 9)
    each, which = np.unique(loads, axis=0, return_inverse=True)
    held = np.array([not load.any() or nnls(cone, load)[1] <= _MISSED for load in each])
    return held[which.ravel()]
