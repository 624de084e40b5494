"""Drives of a robot in one shape among obstacles: decided, found, made shorter, and certified.

A drive is a sequence of poses; between two of them the body twist is constant (a leg), and the
robot is at rest at each of them. A straight leg, or few poses in between, need no slices.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.flow import twists
from twosra_mpc.problem.speeds import drive_rows
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.space.footprint import SAGITTA_M, footprint, kept_m
from twosra_mpc.space.screws import (
    Bools,
    ByFew,
    Proof,
    by_one_pose,
    by_two_poses,
    clear_legs,
    continued,
    improved,
    shortest,
    times_at_speed_s,
    times_from_rest_s,
)
from twosra_mpc.space.separation import Separation

if TYPE_CHECKING:  # they import shapely
    from twosra_mpc.space.balls import Room
    from twosra_mpc.space.roadmap import Field, Roadmap
    from twosra_mpc.space.slices import FreeSlices

HEADINGS = (72, 180, 360)  # slices, finer as needed
_SPACING_M = 0.04  # of the roadmap's grid: about a unit's side
_DETOUR = 1.5  # times the straight leg: as long a drive by few poses is taken without further ado
_ELSEWHERE = 1.25  # times the fastest road: as long is one that goes round elsewhere, at most
_ENTRIES = 24  # nodes tried from a pose that no slice holds
_FINE_M = 1e-5  # sagitta of what is drawn finely, where an end touches what is around it
_SEEN_M = 5e-5  # sagitta of the outline by which legs are proved
_MOST_SUMS = 1500  # corners around times pieces: of more no map is made, only single ways
_NOTHING = np.zeros((0, 4, 2))


class Drives:
    """Drives of a robot in one shape; slices are made when they are first needed.

    Args:
        robot: The robot.
        world: What is around it.
        kappa: The shape it drives in, (n,) [1/m].
        headings: Slices of headings, coarse to fine.
        held: Convex pieces of what it carries, in b0, (pieces, 4, 2) [m].
        may: Twists (m, 3) -> which of them legs may have, where not all.
        sagitta_m: By which its pieces may stray from its arcs.
    """

    def __init__(
        self,
        robot: Robot,
        world: World,
        kappa: ArrayLike,
        headings: tuple[int, ...] = HEADINGS,
        held: Array = _NOTHING,
        may: Callable[[Array], Bools] | None = None,
        sagitta_m: float = SAGITTA_M,
    ) -> None:
        self.geometry, self.world, self.headings = robot.geometry, world, headings
        self.kappa, self._held, self._may = np.asarray(kappa, dtype=float), held, may
        self.footprint = footprint(self.geometry, self.kappa, sagitta_m).holding(held)
        self.kept_m = kept_m(world, self.geometry)
        self.rows, self._wheels = drive_rows(robot, self.kappa)
        self._most_rad_s2 = robot.limits.wheel_acceleration_rad_s2 or np.inf
        self.separation = Separation(self.footprint, world, self.kept_m)
        self._certified: dict[int, FreeSlices] = {}
        self._possible: dict[tuple[int, float], FreeSlices] = {}
        self._roadmaps: dict[int, Roadmap] = {}

    @cached_property
    def room(self) -> Room:
        """What is around it, by distance."""
        from twosra_mpc.space.balls import Room

        fine = footprint(self.geometry, self.kappa, _SEEN_M).holding(self._held)
        return Room(fine, self.world, self.kept_m)

    @cached_property
    def _few(self) -> bool:
        """Whether what is around is so little that slices of all of it are soon made."""
        corners = sum(len(item.corners_m) for item in self.world.obstacles)
        return corners * len(self.footprint.outer) <= _MOST_SUMS

    def clear(self, poses: Array) -> Array:
        """Lower bounds of what poses (m, 3) keep, (m,) [m]; at least ``kept_m`` is allowed."""
        if self._few:
            return self.separation.distances(poses)
        return self.room.spare_m(poses) + self.kept_m

    # Time and clearance of legs.

    def leg_times_s(self, start: Array, end: Array) -> Array:
        """Times of legs between poses (..., 3) from rest to rest, (...,) [s]."""
        twist = twists(start, end)
        charge(Cost.LEG, 1 + twist.size)
        turned = np.abs(twist @ self._wheels.T).max(axis=-1)
        return times_from_rest_s(times_at_speed_s(self.rows, twist), turned / self._most_rad_s2)

    def time_s(self, poses: Array) -> float:
        """Time of a drive through poses (m, 3) [s]."""
        return float(self.leg_times_s(poses[:-1], poses[1:]).sum())

    def clear_legs(self, start: Array, end: Array, lent_m: Array | None = None) -> Bools:
        """True for legs between poses (m, 3) that are proved to keep the clearance, (m,).

        With what is lent they are drawn finely, and may keep so much less from each part of an
        obstacle and each edge, as `lent_m` says.
        """
        start, end = np.atleast_2d(start), np.atleast_2d(end)
        clear = self.clear if lent_m is None else partial(self._finely.distances, lent_m=lent_m)
        twist = twists(start, end)
        found = clear_legs(clear, start, twist, self.footprint.radius_m, self.kept_m)
        return found if self._may is None else found & self._may(twist)

    def lent_m(self, end: Array, least_m: float = 0.0) -> Array | None:
        """By what a leg that has an end there (3,) may be nearer to each thing; None: not at all.

        It keeps the clearance, or from each thing that is nearer to that pose what the pose does:
        at least so much, as far as that can be drawn.
        """
        if self.clear(end[None])[0] >= self.kept_m:
            return None
        own_m = self._finely.to_things(end)
        return self.kept_m - np.clip(own_m, least_m - 2 * _FINE_M, self.kept_m)

    @cached_property
    def _finely(self) -> Separation:
        """Distances of the robot drawn to rounding, for ends that touch what is around them."""
        fine = footprint(self.geometry, self.kappa, _FINE_M).holding(self._held)
        return Separation(fine, self.world, self.kept_m)

    def proof(self, first: Array, last: Array) -> Proof:
        """Proof of clear legs; those at either end (3,) of a drive keep no more than it does."""
        lent: list[Array | None] = [None, self.lent_m(first), self.lent_m(last, self.kept_m)]
        lends = np.array([lent[1] is not None, 2 * (lent[2] is not None)], dtype=int)
        both = [less_m for less_m in lent if less_m is not None]
        lent.append(np.max(both, axis=0) if both else None)

        def proof(start: Array, end: Array) -> Bools:
            found = np.zeros(len(start), dtype=bool)
            at = lends @ [_same(start, first), _same(end, last)]
            for k in dict.fromkeys(at.tolist()):
                found[at == k] = self.clear_legs(start[at == k], end[at == k], lent[k])
            for slices in self._certified.values() if self._may is None else ():
                for i in np.flatnonzero(~found):
                    charge(Cost.MEETING)
                    found[i] = slices.hold_leg(start[i], end[i])
            return found

        return proof

    # Slices.

    def certified_slices(self, headings: int) -> FreeSlices:
        """F- of this shape."""
        from twosra_mpc.space.slices import certified_slices

        if headings not in self._certified:
            coarse_m = self.footprint.radius_m * np.pi / headings / 4  # as slices are anyhow
            made = footprint(self.geometry, self.kappa, max(SAGITTA_M, coarse_m))
            coarse = made.holding(self._held), self.world, self.kept_m, headings
            self._certified[headings] = certified_slices(*coarse)
        return self._certified[headings]

    def possible_slices(self, headings: int, kept_m: float | None = None) -> FreeSlices:
        """F+ of this shape; ``kept_m`` [m] is what a drive must keep, if less than usual."""
        from twosra_mpc.space.slices import possible_slices

        kept = self.kept_m if kept_m is None else kept_m
        if (headings, kept) not in self._possible:
            whole = footprint(self.geometry, self.kappa)
            self._possible[headings, kept] = possible_slices(whole, self.world, kept, headings)
        return self._possible[headings, kept]

    def roadmap(self, headings: int) -> Roadmap:
        """Roads through F-."""
        from twosra_mpc.space.roadmap import roadmap

        free = self.certified_slices(headings)
        if headings not in self._roadmaps:
            self._roadmaps[headings] = roadmap(free, self.rows, _SPACING_M)
        return self._roadmaps[headings]

    def field(self, pose: Array) -> Field | None:
        """Times from a pose (3,), or to it, by the finest roads known; None where they miss it."""
        headings = max(self._roadmaps, default=self.headings[0])
        held = self._few and self.certified_slices(headings).component(pose) is not None
        return self.roadmap(headings).field(*pose) if held else None

    def spread(self, most: int) -> Array:
        """Poses all over the roads, at most so many, (m, 3); none if no slice is free."""
        if not self._few or not len(self.certified_slices(self.headings[0]).parts):
            return np.empty((0, 3))
        poses = self.roadmap(self.headings[0]).poses
        return poses[:: max(1, -(-len(poses) // most))]

    def apart(self, start: Array, goal: Array) -> Bools:
        """True for poses (a, 3) and (b, 3) in different components of coarse F-, (a, b)."""
        if not self._few:
            return np.zeros((len(start), len(goal)), dtype=bool)
        slices = self.certified_slices(self.headings[0])
        known = [[slices.component(pose) for pose in poses] for poses in (start, goal)]
        here, there = (np.array([-1 if c is None else c for c in each]) for each in known)
        different = here[:, None] != there[None]
        return np.asarray(different & (here >= 0)[:, None] & (there >= 0)[None])

    def estimates_s(self, pose: Array, others: Array) -> Array:
        """About how long drives from a pose (3,) to others (m, 3) take, by roads, (m,) [s]."""
        field = self.field(pose)
        return np.zeros(len(others)) if field is None else field.estimates_s(others)

    # Drives.

    def best(self, start: Array, goal: Array) -> Array | None:
        """A good drive from start to goal (3,): poses (m, 3), or None if none was found.

        Headings go on over full turns: that of the last pose may differ from the goal's by some.
        """
        goal = continued(np.array([start, goal]))[-1]
        straight, proof = np.array([start, goal]), self.proof(start, goal)
        guess = self._by_few(by_one_pose, start, goal, proof)
        if proof(straight[:1], straight[1:]).all():
            return self._quicker(straight, guess)
        most_s = _DETOUR * self.time_s(straight)
        if not self._roadmaps and (guess is None or self.time_s(guess) > most_s):
            guess = self._quicker(guess, self._by_few(by_two_poses, start, goal, proof))
        if guess is None:
            return self._by_roads(self.headings, start, goal)
        if self.time_s(guess) <= most_s:
            return guess
        return self._quicker(guess, self._by_roads(self.headings[:1], start, goal))

    def _by_few(self, by: ByFew, start: Array, goal: Array, proof: Proof) -> Array | None:
        """A drive by one or two poses, made shorter."""
        found = by(start, goal, self._free, self.leg_times_s, proof)
        return None if found is None else self._improved(found, proof)

    def _quicker(self, *drives: Array | None) -> Array | None:
        """The quickest of drives, as far as they were found."""
        return min((found for found in drives if found is not None), key=self.time_s, default=None)

    def _by_roads(self, fineness: tuple[int, ...], start: Array, goal: Array) -> Array | None:
        if self._few:
            for headings in fineness:
                found = self._roads(headings, start, goal)
                if found is not None or self.blocked(headings, start, goal):
                    return found
            return None
        from twosra_mpc.space.balls import way

        proof, radius_m = self._by_room, self.footprint.radius_m
        found = way(self.room, radius_m, start, goal, proof)
        if found is None:
            return None
        return self._improved(shortest(continued(found), self.leg_times_s, proof), proof)

    def _roads(self, headings: int, start: Array, goal: Array) -> Array | None:
        """A drive along the roads of slices, made shorter, or one that goes round elsewhere."""
        ends = self.ends(headings, start, goal)
        if ends is None:
            return None
        field, back = (self.roadmap(headings).field(*end) for end in ends)
        path = None if field is None else field.path(ends[1])
        if field is None or back is None or path is None:
            return None
        other = field.other_path(back, path, self.footprint.radius_m, _ELSEWHERE)
        ways = [
            continued(np.array([start, *each, goal])) for each in (path, other) if each is not None
        ]
        proof = self.proof(start, goal)
        poses = min((shortest(each, self.leg_times_s, proof) for each in ways), key=self.time_s)
        return self._improved(poses, proof)

    def _by_room(self, start: Array, end: Array) -> Bools:
        """As `clear_legs`, by the outline instead of its pieces."""
        twist, radius_m = twists(start, end), self.footprint.radius_m
        found = clear_legs(self.room.spare_m, start, twist, radius_m, 0.0)
        return found if self._may is None else found & self._may(twist)

    def _improved(self, poses: Array, proof: Proof) -> Array:
        return shortest(improved(poses, self.leg_times_s, proof), self.leg_times_s, proof)

    def ends(self, headings: int, start: Array, goal: Array) -> tuple[Array, Array] | None:
        """Poses in one component of F- that straight legs join to start and goal."""
        slices = self.certified_slices(headings)
        for first in self._entries(headings, start, self.lent_m(start)):
            for last in self._entries(headings, goal, self.lent_m(goal, self.kept_m)):
                if slices.component(first) == slices.component(last) is not None:
                    return first, last
        return None

    def _entries(self, headings: int, pose: Array, lent_m: Array | None) -> list[Array]:
        """The pose itself if a slice holds it, else nodes that straight legs join to it."""
        slices = self.certified_slices(headings)
        if not len(slices.parts) or slices.component(pose) is not None:
            return [pose]
        nodes = self.roadmap(headings).poses
        at = np.broadcast_to(pose, nodes.shape)
        near = np.argsort(self.leg_times_s(at, nodes), kind="stable")[:_ENTRIES]
        joined = self.clear_legs(at[near], nodes[near], lent_m)
        return list(nodes[near[joined]])

    def blocked(self, headings: int, start: Array, goal: Array) -> bool:
        """True if F+ proves that no drive from start to goal exists."""
        from twosra_mpc.space.possible import apart

        slices = self.possible_slices(headings, self.separation.kept_from_m(start[None]))
        return apart(slices, (start, start), (goal, goal))

    def _free(self, poses: Array) -> Bools:
        return np.asarray(self.clear(poses) >= self.kept_m)


def _same(poses: Array, pose: Array) -> Bools:
    """Which of poses (m, 3) are this one (3,) to 1e-9 m and rad, over full turns, (m,)."""
    return np.asarray(np.abs(twists(poses, pose)).max(axis=1) < 1e-9)
