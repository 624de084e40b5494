"""Guard of a robot: where objects are believed to be, and a stop before anything is too near.

Looked at are where the robot is believed to be, and where the coming command and coasting after a
stop would lead, by the model and by how it has moved lately. Too near is `Patience.stop_m` and what
the distance believed may be off by; where a rigid drive began nearer than that, half the distance
there, so that a robot that was stopped can drive away. The edge of the workspace may be touched, as
in plans.

A robot that bends is stopped before its parts meet, unless it bends back from there. Objects are
means of what the camera has seen, made to fit the robot. What is held is proved to be caged as it
is seen, and planned where it has room.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.errors import InputError, TwosraError
from twosra_mpc.execution.robot_interface import Camera
from twosra_mpc.execution.settings import Patience
from twosra_mpc.problem.limits import body_gaps_m
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array, Coordinates, composed, inverse, wrapped
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, is_rigid

if TYPE_CHECKING:
    from twosra_mpc.space.contour import Thing
    from twosra_mpc.space.possible import Enclosure


_WAY_OUT = 0.5  # of the distance at which a rigid drive began
_SLOWEST = 0.125  # of the planned speed


class TooNearError(TwosraError):
    """The robot stands, for it would have come too near to something."""


class MeetsItselfError(TooNearError):
    """The robot stands, for it would have bent into itself."""


def bends_into_itself(robot: Robot, q: Array, places: Array) -> bool:
    """True if parts overlap at one of these places (m, 3 + n), and more than they do at q."""
    gaps_m = body_gaps_m(robot, np.vstack([q, places])[:, POSE:])
    return bool(gaps_m[1:].min() < min(0.0, float(gaps_m[0])))


class Guard:
    """Guard: what is around a robot, and how near it may come."""

    def __init__(
        self,
        problem: Problem,
        patience: Patience,
        world: World | None = None,
        carried: Sequence[Array] = (),
    ) -> None:
        """Guard a robot among the obstacles and within the workspace of a problem.

        Args:
            problem: The problem.
            patience: How near is too near.
            world: What to keep from, if not the problem's obstacles alone.
            carried: Convex pieces of what it carries, in b0, each (k, 2).
        """
        from twosra_mpc.space.separation import Proximity, arms_m

        geometry = problem.robot.geometry
        self._around = Proximity(world or problem.world, geometry, carried)
        self._patience = patience
        self._arms_m = arms_m(geometry)
        for piece in carried:
            farthest_m = float(np.linalg.norm(piece, axis=1).max())
            self._arms_m[2] = max(self._arms_m[2], farthest_m)
        self._known_at, self._began_m = problem.start.configuration, np.empty(0)
        self._known_m = np.zeros(len(self._around.names))

    def begin(self, q: Array) -> None:
        """Begin a drive at rest at q (3 + n,)."""
        self._known_m = np.zeros(len(self._around.names))
        self._began_m, _ = self._room_m(q[None], np.zeros_like(q))

    def forbids(self, mode: Mode, places: Array, deviation: Array) -> bool:
        """True if the robot must not go on.

        Args:
            mode: Mode it is in.
            places: Where it is believed to be, and where it may be before it stands, (m, 3 + n).
            deviation: Standard deviation of the belief, (3 + n,).
        """
        if not self._began_m.size:
            self.begin(places[0])
        room_m, stop_m = self._room_m(places, deviation)
        return bool((room_m < self._least_m(mode, stop_m)).any())

    def pace(self, places: Array, deviation: Array) -> float:
        """Share of the planned speed, 1 from twice the distance that is too near.

        A robot that is slower is seen better, and may come nearer.

        Args:
            places: Where it is believed to be, and where it will be soon, (m, 3 + n).
            deviation: Standard deviation of the belief, (3 + n,).
        """
        room_m, stop_m = self._room_m(places, deviation, times=2.0)
        share = (room_m / stop_m)[:-1].min(initial=2.0) - 1
        return float(np.clip(share, _SLOWEST, 1.0))

    def stop_m(self, deviation: Array) -> float:
        """Largest distance that is too near while the belief has a deviation (3 + n,) [m]."""
        return self._patience.stop_m + self._patience.stop_deviations * self.off_m(deviation)

    def off_m(self, away: Array) -> float:
        """Distances of points of the outline, about, from a difference of q (3 + n,) [m]."""
        return float(np.linalg.norm(self._arms_m * away))

    def describe(self, q: Array) -> str:
        """Say what the robot is nearest to at q (3 + n,)."""
        distance_m, name = self._around.nearest(q)
        side = "from" if distance_m >= 0 else "beyond"
        return f"{1e3 * abs(distance_m):z.1f} mm {side} {name}"

    def _room_m(self, places: Array, deviation: Array, times: float = 1.0) -> tuple[Array, Array]:
        """Least room of places (m, 3 + n) to each obstacle and the edges, (k + 1,) [m].

        And what is too little: by so much nearer the first is where it may be, (k + 1,). It is
        looked at unless there is so many times the most that this can be anyway.
        """
        moved_m = float((np.abs(places - self._known_at) @ self._arms_m).max())
        room_m, stop_m = self._known_m - moved_m, self.stop_m(deviation)
        if (room_m >= times * stop_m).all():
            return room_m, np.full_like(room_m, stop_m)
        q, patience = places[0], self._patience
        off = np.diag(patience.stop_deviations * deviation)
        distances_m = self._around.distances(np.vstack([places, q + off, q - off]))
        at_m, off_m = np.split(distances_m, [len(places)])
        self._known_at, self._known_m = q, at_m[0]
        nearer_m = (at_m[0] - off_m).reshape(2, len(q), -1).max(axis=0, initial=0.0)
        return at_m.min(axis=0), patience.stop_m + np.linalg.norm(nearer_m, axis=0)

    def _least_m(self, mode: Mode, stop_m: Array) -> Array:
        """Least distance to each obstacle, and to the edges, (k + 1,) [m]."""
        patience, began_m, least_m = self._patience, self._began_m, stop_m.copy()
        if is_rigid(mode):
            way_out_m = np.minimum(np.maximum(_WAY_OUT * began_m, patience.stop_m), began_m)
            least_m = np.minimum(least_m, way_out_m)
        least_m[-1] = min(0.0, float(began_m[-1]))
        return least_m


def guard_of(problem: Problem, patience: Patience) -> Guard | None:
    """A guard, where there is anything around the robot."""
    if not problem.obstacles and problem.workspace is None:
        return None
    return Guard(problem, patience)


_LEAST_GAIN = 0.1  # at 15 Hz what has moved is noticed within a second; 0.23 of a frame's noise


class ObjectsSeen:
    """Poses of objects in the plane, and as seen from b0 by frames that show both.

    Those from b0 do not lag while the robot carries an object, however late the frames are.

    Attributes:
        seen: Whether any frame has shown them.
        poses: In the plane, (objects, 3) [m, m, rad].
        in_b0: As seen from b0, (objects, 3).
    """

    def __init__(self, problem: Problem) -> None:
        """Believe that they are where the problem says."""
        self.poses = np.array([item.pose.pose for item in problem.objects])
        self.in_b0 = composed(inverse(problem.start.configuration[:POSE]), self.poses)
        self.seen, count = False, len(self.poses)
        self._count, self._share = np.zeros(count), np.ones(count)

    def deviation(self, camera: Camera) -> Array:
        """Standard deviation of a pose by frames of this camera, (3,) [m, m, rad]."""
        frame = camera.variance(Coordinates(1))[:POSE]
        return np.sqrt(self._share.max() * frame) if self.seen else np.zeros(POSE)

    def forget(self) -> None:
        """Believe the next frames alone."""
        self._count[:] = 0

    def take(self, frames: Array, objects: Array | None) -> None:
        """Take in frames: of the robot, (k, 3 + n), and of the objects, (k, objects, 3).

        An object that is not found in a frame is NaN there.
        """
        if objects is None:
            return
        for frame, poses in zip(frames, objects, strict=True):
            found = np.isfinite(poses).all(axis=1)
            self._count, self.seen = self._count + found, self.seen or bool(found.any())
            gain = np.where(found, np.maximum(1.0 / np.maximum(self._count, 1), _LEAST_GAIN), 0.0)
            self._share = (1 - gain) ** 2 * self._share + gain**2
            poses = np.where(found[:, None], poses, self.poses)
            in_b0 = composed(inverse(frame[:POSE]), poses)
            self.poses = _towards(self.poses, poses, gain[:, None])
            self.in_b0 = _towards(self.in_b0, in_b0, gain[:, None])


def _towards(poses: Array, seen: Array, gain: Array) -> Array:
    away = seen - poses
    away[:, 2] = wrapped(away[:, 2])
    moved: Array = poses + gain * away
    return moved


_OVERLAP_M = 5e-5  # of an object and the robot that is none
_SAGITTA_M = 5e-5
_LEAST_BENT = 0.9  # of the curvatures seen, for a robot that seems to overlap what it holds
_TRIES = 20  # to move an object out of the robot


def cage_of(problem: Problem, q: Array, number: int, in_b0: Array) -> Enclosure | None:
    """Cage of an object where it is seen, or fits if they seem to overlap; None if it does not."""
    from twosra_mpc.contact.grip import caged

    poses = np.tile(composed(q[:POSE], in_b0), (len(problem.objects), 1))
    q = fitted(problem, q, poses, [number])
    where = composed(inverse(q[:POSE]), poses[number])
    try:
        return caged(problem.robot.geometry, q[POSE:], problem.objects[number], where)
    except InputError:
        return None


def fitted(problem: Problem, q: Array, poses: Array, held: list[int]) -> Array:
    """Configuration in which the robot overlaps no object; its curvatures alone are changed.

    Objects that seem to overlap it are moved out of it, the shortest way: poses (objects, 3) are
    changed. Where one that is held has no room, the robot cannot be bent as far as it seems.
    """
    from twosra_mpc.space.contour import Thing

    things = [Thing(item) for item in problem.objects]
    for share in np.linspace(1.0, _LEAST_BENT, _TRIES):
        made = np.concatenate([q[:POSE], share * q[POSE:]])
        if all(_moved_out(problem, made, poses[i], things[i]) for i in held):
            break
    for i in set(range(len(things))) - set(held):
        _moved_out(problem, made, poses[i], things[i])
    return made


def _moved_out(problem: Problem, q: Array, pose: Array, thing: Thing) -> bool:
    """Move an object out of the robot, and return whether that could be done; pose is changed."""
    from twosra_mpc.space.contour import Pieces
    from twosra_mpc.space.footprint import footprint
    from twosra_mpc.space.separation import placed

    pieces = footprint(problem.robot.geometry, q[POSE:], _SAGITTA_M).outer
    around = Pieces(placed(pieces, q[None, :POSE])[0])
    for _ in range(_TRIES):
        contact = thing.deepest(pose, around)
        if contact is None or contact.depth_m <= _OVERLAP_M:
            return True
        pose[:2] += contact.depth_m * contact.way
    return False
