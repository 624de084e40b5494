r"""Necessity proved by obstacles: blocks between drives, or more than any plan can do.

A drive is a motion in one shape, a block reshapes, and moves b0 by no more than ``soft_travel_m``.

- If a unit's inscribed disc has no path from its place at the start to its place at the goal, no
  plan of any shapes exists.
- If the start's shape may be kept, but the superset of what is free for it does not join the start
  to the goal, a block is needed.
- If what it joins to the start is farther than ``soft_travel_m`` from all that joins the goal
  in the goal's shape, two blocks are needed.

Where a goal leaves a box of shapes, the robot of its middle is shrunk by what the other shapes can
move any point of it.
"""

from __future__ import annotations

import numpy as np

from twosra_mpc.planning.search.nodes import InTheWay
from twosra_mpc.planning.stages.variants import Variant
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence, blocks_of, is_rigid
from twosra_mpc.space.footprint import Footprint, footprint, kept_m, moved_by_bending_m
from twosra_mpc.space.separation import Separation

_NO_DRIVE = "no drive in the start's shape: proved blocked"
HEADINGS = (72, 180)  # slices, until something is proved
_MOST_CORNERS = 20_000  # times slices: more around take longer than what they prove may save
_MOST_PER_M = 3.0  # half-width of a box of shapes that is worth looking at


class Necessity(InTheWay):
    """Number of blocks that every plan needs; what is worked out stays known."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self._geometry = problem, problem.robot.geometry
        self.needed = 0
        self._apart_m: Array | None = None  # what drives must bridge at least
        self.impossible: str | None = None
        self._left = [self._no_path_at_all, *(lambda n=n: self._by_slices(n) for n in HEADINGS)]

    def blocks(self, sequence: ModeSequence | None) -> str | None:
        """Reason why a sequence, or any if None, cannot be carried out, by what is known so far."""
        if sequence is None or self.impossible is not None:
            return self.impossible
        count = blocks_of(sequence)
        if count >= self.needed:
            return None
        return self.words if count else _NO_DRIVE

    @property
    def words(self) -> str:
        """Words for what is known."""
        if self.needed == 0:
            return "nothing is proved of the obstacles"
        if self.needed == 1:
            return _NO_DRIVE
        far = f"limits.soft_travel_m = {self.problem.robot.limits.soft_travel_m:zg} m"
        return f"one reshaping is not enough: its drives, proved, end more than {far} apart"

    def least_drives_s(self, sequence: ModeSequence) -> list[float]:
        """Least durations of drives: of one block's before and after, of two blocks' between them.

        What a drive leads past, it must drive: at most at ``limits.speed_m_s``.
        """
        least, count = [0.0] * len(sequence), blocks_of(sequence)
        limits = self.problem.robot.limits
        if limits.speed_m_s is None or count not in (1, 2):
            return least
        while self._apart_m is None and self._left:
            self._left.pop(0)()
        if self._apart_m is None:
            return least
        before, between, after = np.maximum(self._apart_m, 0.0) / limits.speed_m_s
        drives = [i for i, mode in enumerate(sequence) if is_rigid(mode)]
        if len(drives) == count + 1:
            times_s = (before, after) if count == 1 else (0.0, between, 0.0)
            for i, time_s in zip(drives, times_s, strict=True):
                least[i] = float(time_s)
        return least

    def proves_impossible(self, sequence: ModeSequence) -> bool:
        """True if a sequence is proved impossible, by what is known or is worked out now."""
        while self.blocks(sequence) is None and self._left:
            self._left.pop(0)()
        return self.blocks(sequence) is not None

    def _no_path_at_all(self) -> None:
        from twosra_mpc.space.possible import within_obstacles

        for i, task in enumerate(self.problem.passes, start=1):
            if within_obstacles(self.problem.world, *task.ends):
                named = f" ({task.name})" if task.name else ""
                self.impossible = f"all of the box of task {i}{named} is within obstacles"
        unit = unit_without_way(self.problem)
        if unit is not None:
            self.impossible = f"locomotion unit {unit} has no way there, whatever the robot's shape"

    def _by_slices(self, headings: int) -> None:
        problem, geometry = self.problem, self._geometry
        start, goal = problem.start.configuration, problem.goal.configuration
        rigid = problem.robot.rigid
        solid = problem.start_stiffness == problem.goal.mode == rigid
        known = not np.isnan(goal[POSE:]).any()
        known &= problem.goal.half_width[POSE:].max() <= _MOST_PER_M
        if not (solid and known and problem.obstacles):  # only then ``soft_travel_m`` is a rule
            return
        corners = sum(len(item.corners_m) for item in problem.obstacles)
        if headings * corners > _MOST_CORNERS:
            return
        from twosra_mpc.space.possible import Region, components_in
        from twosra_mpc.space.slices import possible_slices

        kept, world = kept_m(problem.world, geometry), problem.world
        low, high = (end[:POSE] for end in problem.goal.box_met(start))
        shape = footprint(geometry, start[POSE:])
        near = Separation(shape, world, kept).kept_from_m(start[None, :POSE]) < kept
        same, held = same_shape(problem), last_shape(problem)
        last = possible_slices(held, world, kept, headings) if held else None
        to_goal = components_in(last, low, high) if last else frozenset()
        if last and not to_goal and not (near and same):  # one leg may do, and keep less
            self.impossible = "no pose and shape of the goal keeps clear of what is around it"
        if near or self.impossible:  # the first leg may keep less: nothing is proved of drives
            return
        first = possible_slices(shape, world, kept, headings)
        from_start = components_in(first, start[:POSE], start[:POSE])
        blocked = not same or from_start.isdisjoint(components_in(first, low, high))
        self.needed = max(self.needed, int(blocked))
        if last is None:
            return
        ahead, behind = Region.of(first, from_start), Region.of(last, to_goal)
        apart_m, soft_m = ahead.apart_m(behind), problem.robot.limits.soft_travel_m
        if blocked and apart_m > soft_m:
            self.needed = 2
            self._left.clear()
        before_m = behind.from_box_m(start, start) - soft_m
        after_m = ahead.from_box_m(low, high) - soft_m
        self._apart_m = np.array([before_m, apart_m - 2 * soft_m, after_m])


def necessities(variant: Variant) -> list[InTheWay]:
    """Necessity of each stage by its obstacles: known of the first, where it is a goal."""
    first, *others = variant.members[0]
    asked = first.stage
    plain = first.reaches and not (asked.touches or asked.holds) and asked.last is not None
    found = Necessity(variant.reaching(first)) if plain else InTheWay()
    return [found, *(InTheWay() for _ in others)]


def same_shape(problem: Problem) -> bool:
    """True if the goal may be reached in the shape of the start."""
    kappa = problem.start.configuration[POSE:]
    low, high = (end[POSE:] for end in problem.goal.box_met(problem.start.configuration))
    return bool(((low <= kappa) & (kappa <= high)).all())


def last_shape(problem: Problem) -> Footprint | None:
    """Invariant that every shape of the goal shares with its middle one; None if none."""
    kappa, width = problem.goal.configuration[POSE:], problem.goal.half_width[POSE:]
    if np.isnan(kappa).any() or width.max() > _MOST_PER_M:
        return None
    geometry = problem.robot.geometry
    held = footprint(geometry, kappa).shrunk(moved_by_bending_m(geometry, width))
    return held if len(held.inner) else None


def unit_without_way(problem: Problem, *, wheels: bool = False) -> int | None:
    """A locomotion unit, 1 or 2, that is proved to have no way to the goal in any shape.

    By its inscribed disc or, with ``wheels``, by all of it at every heading, which takes longer.
    """
    goal, width = problem.goal.configuration, problem.goal.half_width
    if not problem.obstacles or not np.isfinite(goal).all() or width.max() > _MOST_PER_M:
        return None
    from twosra_mpc.space.possible import blocked_unit, unit_apart

    # Around b0 a unit's points move by less than the footprint's radius a radian.
    geometry, world, start = problem.robot.geometry, problem.world, problem.start.configuration
    radius = footprint(geometry, goal[POSE:]).radius_m
    off_m = float(np.hypot(*width[:2])) + radius * float(width[2])
    off_m += moved_by_bending_m(geometry, width[POSE:])
    near = Separation(footprint(geometry, start[POSE:]), world, world.clearance_m)
    kept = near.kept_from_m(start[None, :POSE])  # as the first leg may keep less
    if not wheels:
        return blocked_unit(geometry, world, start, goal, off_m, kept)
    off = off_m, float(width[2] + width[POSE:] @ geometry.lengths_m)
    return unit_apart(geometry, world, (start, goal), off, kept)
