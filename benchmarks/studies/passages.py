"""Rigid drives through passages, ever narrower: which are certified, and which blocked?"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks.study import Numbers, Study
from twosra_mpc import Problem, load_problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.drives import Drives

if TYPE_CHECKING:  # it imports shapely
    from twosra_mpc.space.possible import Box

_START, _GOAL = np.array([-0.36, -0.04, 1.0]), np.array([0.36, 0.04, -1.0])
_STRAIGHT = np.zeros(2)


class Case(NamedTuple):
    """A passage."""

    width_m: float


@dataclass(frozen=True)
class PassageRecord:
    """What was found of one passage.

    Attributes:
        verdict: Certified, blocked or undecided.
        headings: Slices of headings that decided.
        decided_s: CPU time of the decision.
        drive_s: CPU time of the drive after it; None without one.
    """

    verdict: str
    headings: int
    decided_s: float
    drive_s: float | None


class Passages(Study):
    """A straight robot and a passage of 0.35 m, ever narrower.

    Attributes:
        widths_m: Widths of the passage.
    """

    record: ClassVar = TypeAdapter(PassageRecord)
    question: ClassVar = "Rigid drives through narrow passages: which are decided, and how fast?"

    widths_m: Numbers = (0.120, 0.090, 0.070, 0.0665, 0.066, 0.0615, 0.061, 0.055)

    def cases(self) -> Iterator[Case]:
        """Yield the passages."""
        yield from map(Case, self.widths_m)

    def run(self, case: Case) -> PassageRecord:
        """Decide, and drive."""
        problem, clock = corridor(case.width_m), time.process_time
        began = clock()
        drives = Drives(problem.robot, problem.world, _STRAIGHT)
        verdict, headings = decide(drives, _START, _GOAL)
        decided = clock()
        found = drives.best(_START, _GOAL) if verdict == "certified" else None
        drive_s = None if found is None else clock() - decided
        return PassageRecord(verdict, headings, decided - began, drive_s)


def corridor(width_m: float) -> Problem:
    """The scenario ``corridor`` with a passage of another width."""
    walls = [(width_m / 2, 0.3), (-0.3, -width_m / 2)]
    boxes = [{"box": {"x_m": (-0.175, 0.175), "y_m": wall}} for wall in walls]
    return load_problem("corridor", obstacles=boxes)


def decide(drives: Drives, start: Array, goal: Array) -> tuple[str, int]:
    """Str on a drive from a pose (3,) to another one, and how many headings decided; 0: none.

    A pose that no slice holds may be joined to one by a straight leg.
    """
    if drives.proof(start, goal)(start[None], goal[None]).all():
        return "certified", 0
    for fineness in drives.headings:
        if drives.ends(fineness, start, goal) is not None:
            return "certified", fineness
        if drives.blocked(fineness, start, goal):
            return "blocked", fineness
    return "undecided", drives.headings[-1]


def decide_between(drives: Drives, start: Box, goal: Box) -> str:
    """Str on drives from one box of poses to another; infinite ends are free."""
    from twosra_mpc.space.possible import apart  # shapely

    kept_m = _kept_by_the_first_leg(drives, *start)
    for fineness in drives.headings:
        sure = drives.certified_slices(fineness)
        if not apart(sure, start, goal):
            return "certified"
        if apart(drives.possible_slices(fineness, kept_m), start, goal):
            return "blocked"
    return "undecided"


def _kept_by_the_first_leg(drives: Drives, low: Array, high: Array) -> float:
    """Clearance that drives which start in a box of headings must keep."""
    if low[2] == high[2]:
        return drives.separation.kept_from_m(low[None])
    turned = np.linspace(0.0, 2 * np.pi, drives.headings[-1])
    poses = np.column_stack([np.tile(low[:2], (len(turned), 1)), turned])
    between = drives.footprint.radius_m * float(turned[1])
    return drives.separation.kept_from_m(poses, between)
