"""Stopping a robot before it comes too near to what is around it, by where it is believed to be.

Looked at are where it is believed to be, and where the coming command and coasting after a stop
would lead, by the model and by how it has moved lately. Too near is `Patience.stop_m` and what the
belief may be off by; where a rigid drive began nearer than that, half the distance there, so that a
robot that was stopped can drive away. The edge of the workspace may be touched, as in plans.
A robot that bends is stopped before its parts meet, unless it bends back from there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twosra_mpc.errors import TwosraError
from twosra_mpc.execution.settings import Patience
from twosra_mpc.problem.limits import body_gaps_m
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, is_rigid

_WAY_OUT = 0.5  # of the distance at which a rigid drive began


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
        self._around, self._patience = (
            Proximity(world or problem.world, geometry, carried),
            patience,
        )
        self._arms_m = arms_m(geometry)
        for piece in carried:
            farthest_m = float(np.linalg.norm(piece, axis=1).max())
            self._arms_m[2] = max(self._arms_m[2], farthest_m)
        self._began_m = self._known_m = np.empty(0)
        self._known_at = problem.start.configuration

    @property
    def fresh(self) -> bool:
        """True if no drive has begun yet."""
        return not self._began_m.size

    def begin(self, q: Array) -> None:
        """Begin a drive at rest at q (3 + n,)."""
        self._began_m = self._looked_m(q[None])

    def forbids(self, mode: Mode, places: Array, deviation: Array) -> bool:
        """True if the robot must not go on.

        Args:
            mode: Mode it is in.
            places: Where it is believed to be, and where it may be before it stands, (m, 3 + n).
            deviation: Standard deviation of the belief, (3 + n,).
        """
        least_m = self._least_m(mode, deviation)
        moved_m = float((np.abs(places - self._known_at) @ self._arms_m).max())
        if (self._known_m - moved_m >= least_m).all():  # it cannot have come so near since
            return False
        return bool((self._looked_m(places) < least_m).any())

    def stop_m(self, deviation: Array) -> float:
        """Distance that is too near while the belief has a standard deviation (3 + n,) [m]."""
        return self._patience.stop_m + self._patience.stop_deviations * self.off_m(deviation)

    def off_m(self, away: Array) -> float:
        """Distances of points of the outline, about, from a difference of q (3 + n,) [m]."""
        return float(np.linalg.norm(self._arms_m * away))

    def describe(self, q: Array) -> str:
        """Say what the robot is nearest to at q (3 + n,)."""
        distance_m, name = self._around.nearest(q)
        side = "from" if distance_m >= 0 else "beyond"
        return f"{1e3 * abs(distance_m):z.1f} mm {side} {name}"

    def _looked_m(self, places: Array) -> Array:
        """Least distance of places (m, 3 + n) to each obstacle, and to the edges, (k + 1,) [m]."""
        distances_m = self._around.distances(places)
        self._known_at, self._known_m = places[0], distances_m[0]
        return distances_m.min(axis=0)

    def _least_m(self, mode: Mode, deviation: Array) -> Array:
        """Least distance to each obstacle, and to the edges, (k + 1,) [m]."""
        patience, began_m = self._patience, self._began_m
        least_m = np.full(len(began_m), self.stop_m(deviation))
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
