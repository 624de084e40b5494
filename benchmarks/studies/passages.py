"""Rigid drives through passages: decided by slices, and tried by OMPL's RRT-Connect (optional)."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks.study import Count, Measured, Numbers, Study
from twosra_mpc import Problem, load_problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.drives import Drives
from twosra_mpc.validation import Positive

_START, _GOAL = np.array([-0.36, -0.04, 1.0]), np.array([0.36, 0.04, -1.0])
_STRAIGHT = np.zeros(2)
_RESOLUTION = 0.002  # of the extent of OMPL's space, 2.8: a state is checked every 6 mm


class Case(NamedTuple):
    """A passage, and how often it was tried before."""

    width_m: float
    run: int


@dataclass(frozen=True)
class PassageRecord:
    """What was found of one passage.

    Attributes:
        verdict: Ours: certified, blocked or undecided.
        headings: Slices of headings that decided.
        decided_s: CPU time of the decision.
        drive_s: CPU time of the drive after it; None without one.
        rrt_solved: Whether RRT-Connect found a path; None if package ompl is not installed.
        rrt_s: CPU time it took, or spent in vain.
        rrt_checks: Poses it checked.
    """

    verdict: str
    headings: int
    decided_s: float
    drive_s: float | None
    rrt_solved: bool | None = None
    rrt_s: float | None = None
    rrt_checks: int | None = None


class Passages(Study):
    """A straight robot and a passage of 0.35 m, ever narrower.

    Attributes:
        widths_m: Widths of the passage.
        runs: Runs at each of them; RRT-Connect is random.
        limit_s: Wall time that RRT-Connect is given.
    """

    record: ClassVar = TypeAdapter(PassageRecord)
    question: ClassVar = "Rigid drives through narrow passages: decided or searched for?"

    widths_m: Numbers = (0.120, 0.090, 0.078, 0.055)
    runs: Count = 5
    limit_s: Positive = 30.0

    def cases(self) -> Iterator[Case]:
        """Yield the passages, each as often as asked."""
        for width in self.widths_m:
            yield from (Case(width, run) for run in range(self.runs))

    def run(self, case: Case) -> PassageRecord:
        """Decide, drive, and let the peer try."""
        problem, clock = corridor(case.width_m), time.process_time
        began = clock()
        drives = Drives(problem.robot, problem.world, _STRAIGHT)
        decision = drives.decide(_START, _GOAL)
        decided = clock()
        found = drives.best(_START, _GOAL) if decision.verdict == "certified" else None
        drive_s = None if found is None else clock() - decided
        ours = (decision.verdict, decision.headings, decided - began, drive_s)
        if importlib.util.find_spec("ompl") is None:
            return PassageRecord(*ours)
        checked = _Counted(drives)
        began = clock()
        solved = _rrt_connect(problem, checked, self.limit_s)
        return PassageRecord(*ours, solved, clock() - began, checked.count)

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Runs by width."""
        del folder
        by_width: dict[float, list[PassageRecord]] = {}
        for case, made in results:
            by_width.setdefault(case.width_m, []).append(made)
        return {"by_width": by_width}


def corridor(width_m: float) -> Problem:
    """The scenario ``corridor`` with a passage of another width."""
    walls = [(width_m / 2, 0.3), (-0.3, -width_m / 2)]
    boxes = [{"box": {"x_m": (-0.175, 0.175), "y_m": wall}} for wall in walls]
    return load_problem("corridor", obstacles=boxes)


class _Counted:
    """Whether a pose keeps the clearance, by our own distances; counts how often it is asked."""

    def __init__(self, drives: Drives) -> None:
        self._drives, self.count = drives, 0

    def __call__(self, state: Any) -> bool:
        self.count += 1
        pose = np.array([[state.getX(), state.getY(), state.getYaw()]])
        return bool(self._drives.clear(pose)[0] >= self._drives.kept_m)


def _rrt_connect(problem: Problem, free: Callable[[Any], bool], limit_s: float) -> bool:
    """Whether OMPL's RRT-Connect finds a path in SE(2)."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_ERROR)
    assert problem.workspace is not None
    space, bounds = base.SE2StateSpace(), base.RealVectorBounds(2)
    for axis, (low, high) in enumerate(problem.workspace.corners_m.T.tolist()):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(free)
    setup.setStartAndGoalStates(_state(space, _START), _state(space, _GOAL))
    about = setup.getSpaceInformation()
    about.setStateValidityCheckingResolution(_RESOLUTION)
    setup.setPlanner(geometric.RRTConnect(about))
    setup.solve(limit_s)
    return bool(setup.haveExactSolutionPath())


def _state(space: Any, pose: Array) -> Any:
    state, (x, y, phi) = space.allocState(), pose.tolist()
    state.setX(x)
    state.setY(y)
    state.setYaw(phi)
    return state
