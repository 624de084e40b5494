r"""Objects on the ground, moved by a robot, quasi-statically: where nothing pushes, they rest.

What the robot overlaps is moved out the shortest way, in steps in which no point of the robot goes
farther than 1 mm. A push along n at r from the centroid moves the object by the ellipsoidal limit
surface of its friction with the ground (Howe and Cutkosky 1996),

.. math:: (v, \omega) \propto (n,\ (r \times n) / c^2), \qquad c = 0.6 \sqrt{\text{area} / \pi},

and where robot and object have friction, it is dragged along the surface that pushes it, by at most
the coefficient times the push. Objects push each other, and what stands does not give way.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array, rotation
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.contour import Contact, Pieces, Thing
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import footprints
from twosra_mpc.space.separation import arms_m, placed

_Touch = tuple[int, Contact, int | str | None]

SQUEEZED_M = 1e-3  # an overlap that is left where nothing gives way
TOUCH_M = 1e-5  # an overlap that is none
_STEP_M = 1e-3
_SAGITTA_M = 5e-5  # of the chords that stand for the fibre
_ROUNDS = 60


class ObjectPlant:
    """Objects while a robot moves among them.

    Attributes:
        poses: Of the objects, (objects, 3) [m, m, rad].
        squeezed: What was squeezed first, against what and how deep, in words; empty if nothing.
    """

    def __init__(self, problem: Problem, geometry: Geometry) -> None:
        """Put the objects where they are at t = 0, round a robot of this true geometry."""
        self._geometry, self._arms_m = geometry, arms_m(geometry)
        self._names = [item.name for item in problem.objects]
        self._things = [Thing(item) for item in problem.objects]
        self._radii_m = np.array([thing.radius_m for thing in self._things])
        self._walls = [
            (name, Pieces(part[None]))
            for name, item in zip(problem.world.names, problem.obstacles, strict=True)
            for part in convex_parts(item.corners_m)
        ]
        self.poses = np.array([item.pose.pose for item in problem.objects])
        self.squeezed = ""
        self._shape: tuple[bytes, Array] = (b"", np.empty(0))

    def follow(self, before: Array, after: Array) -> bool:
        """Let the robot go from one configuration (3 + n,) to another, nearly straight.

        Returns:
            True if everything gave way.
        """
        travel_m = float(np.abs(after - before) @ self._arms_m)
        away_m = np.linalg.norm(self.poses[:, :2] - after[:2], axis=1) - self._radii_m
        if travel_m == 0 or (away_m > self._arms_m[2] + travel_m).all():
            return True
        steps = math.ceil(travel_m / _STEP_M)
        last, gave_way = self._pieces(before), True
        for k in range(1, steps + 1):
            pieces = self._pieces(before + k / steps * (after - before))
            gave_way &= self._give_way(last if last.shape == pieces.shape else pieces, pieces)
            last = pieces
        return gave_way

    def _pieces(self, q: Array) -> Array:
        """The robot as convex pieces, (pieces, 4, 2)."""
        bent = q[POSE:].tobytes()
        if self._shape[0] != bent:
            self._shape = bent, footprints(self._geometry, q[None, POSE:], _SAGITTA_M)[0][0]
        return placed(self._shape[1], q[None, :POSE])[0]

    def _give_way(self, before: Array, after: Array) -> bool:
        """Move objects out of the robot, and then out of each other and of what stands."""
        rested, held_m = self.poses.copy(), np.zeros(len(self._things))
        robot = Pieces(after)
        for _ in range(_ROUNDS):
            touches = list(self._touches(robot, (self.poses != rested).any(axis=1)))
            if not touches:
                return True
            i, contact, by = max(touches, key=lambda touch: touch[1].depth_m)
            if by is None:
                self._push(i, contact.way, contact.depth_m, contact.at)
                held_m[i] += self._things[i].friction * contact.depth_m
                piece = before[contact.piece], after[contact.piece]
                held_m[i] -= self._drag(i, contact, held_m[i], rested[i], *piece)
            elif isinstance(by, int):
                self._push(i, contact.way, contact.depth_m / 2, contact.at)
                self._push(by, -contact.way, contact.depth_m / 2, contact.at)
            else:
                self._push(i, contact.way, contact.depth_m, contact.at)
        if not self.squeezed and contact.depth_m > SQUEEZED_M:
            what = "the robot" if by is None else self._names[by] if isinstance(by, int) else by
            self.squeezed = f"{self._names[i]} in {what} by {1e3 * contact.depth_m:z.1f} mm"
        return False

    def _touches(self, robot: Pieces, moved: Array) -> Iterator[_Touch]:
        """Overlaps: object, how, and by what: another object, a wall, or None, the robot."""
        for i, thing in enumerate(self._things):
            sets: list[tuple[Pieces, int | str | None]] = [(robot, None)]
            if moved[i]:
                sets += [(part, name) for name, part in self._walls]
            for j, other in enumerate(self._things):
                if j != i and (moved[i] or moved[j]):
                    sets += [(Pieces(part[None]), j) for part in other.placed(self.poses[j])]
            for pieces, by in sets:
                contact = thing.deepest(self.poses[i], pieces)
                if contact is not None and contact.depth_m > TOUCH_M:
                    yield i, contact, by

    def _push(self, i: int, way: Array, by_m: float, at: Array) -> None:
        """Push an object at a point until that has gone so far along a way (2,)."""
        thing, phi = self._things[i], float(self.poses[i, 2])
        turned = thing.middle @ rotation(phi)
        middle = turned + self.poses[i, :2]
        arm = float((at - middle)[0] * way[1] - (at - middle)[1] * way[0]) / thing.lever_m
        slid_m = by_m / (1 + arm**2)
        turn = slid_m * arm / thing.lever_m
        origin = middle + slid_m * way - turned @ rotation(turn)
        self.poses[i] = [*origin, phi + turn]

    def _drag(
        self, i: int, contact: Contact, most_m: float, rested: Array, before: Array, after: Array
    ) -> float:
        """Let friction hold an object at a piece that has moved, (4, 2), and return by how far."""
        if most_m <= 0:
            return 0.0
        along = np.array([-contact.way[1], contact.way[0]])
        with_robot = contact.at - _carried_back(contact.at, after, before)
        own = contact.at - _carried_back(contact.at, _frame(self.poses[i]), _frame(rested))
        held_m = min(max(float((with_robot - own) @ along), -most_m), most_m)
        self._push(i, along, held_m, contact.at)
        return abs(held_m)


def _frame(pose: Array) -> Array:
    """Two points that a body at a pose (3,) carries along, (2, 2)."""
    return pose[:2] + np.array([[0.0, 0.0], [math.cos(pose[2]), math.sin(pose[2])]])


def _carried_back(at: Array, after: Array, before: Array) -> Array:
    """Former place of a point of a body, two points of which are known after and before."""
    (ax, ay), (bx, by) = after[1] - after[0], before[1] - before[0]
    turn = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return before[0] + (at - after[0]) @ rotation(turn)
