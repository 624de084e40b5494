"""Bend of each phase of a mission: as the relaxation does, but well inside of the goals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from twosra_mpc.model.bending import bending
from twosra_mpc.planning.solver.guess import inner_bends
from twosra_mpc.problem.goals import GoalSet, inner_goal
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence

Box = tuple[Array, Array]


def stage_bends(
    problem: Problem, goals: Sequence[GoalSet], sequences: Sequence[ModeSequence], relaxed: Array
) -> list[Array]:
    """Change of W in each phase of each stage.

    Args:
        problem: The problem.
        goals: What each stage ends in.
        sequences: Its modes.
        relaxed: Change of W in each phase of all, (phases,), by the relaxation.
    """
    here = bending(problem.robot).coordinates(problem.start.kappa_per_m)
    parts = np.split(relaxed, np.cumsum([len(each) for each in sequences])[:-1])
    found = []
    for sequence, bends, outer, inner in zip(
        sequences,
        parts,
        _kept_boxes([_w_box(problem, goal) for goal in goals], sequences),
        _kept_boxes(
            [_w_box(problem, inner_goal(problem.robot, goal)) for goal in goals], sequences
        ),
        strict=True,
    ):
        inner = inner if (inner[0] <= inner[1]).all() else outer
        box = np.array(outer) - here
        chosen = inner_bends(sequence, _into(sequence, bends, box), box, np.array(inner) - here)
        found.append(chosen)
        here = here + np.array(sequence, dtype=float).T @ chosen
    return found


def _into(sequence: ModeSequence, bends: Array, box: Array) -> Array:
    """The nearest bends that end in a box, (2, n), as a stage may begin a bit aside."""
    incidence = np.array(sequence, dtype=float).T
    reached = incidence @ bends
    step, *_ = np.linalg.lstsq(incidence, np.clip(reached, *box) - reached, rcond=1e-12)
    return bends + step


def shapes(problem: Problem, sequences: Sequence[ModeSequence], bends: Sequence[Array]) -> Array:
    """Curvatures where each stage ends, (stages, n) [1/m]."""
    facts = bending(problem.robot)
    here = facts.coordinates(problem.start.kappa_per_m)
    found = []
    for sequence, each in zip(sequences, bends, strict=True):
        here = here + np.array(sequence, dtype=float).T @ each
        found.append(facts.curvatures(here.tolist()))
    return np.array(found)


def _kept_boxes(boxes: Sequence[Box], sequences: Sequence[ModeSequence]) -> Iterator[Box]:
    """What each stage may end in so that segments that then stay rigid suit what follows."""
    for k, (low, high) in enumerate(boxes):
        rigid = np.ones(len(low), dtype=bool)
        least, most = low.copy(), high.copy()
        for sequence, (later_low, later_high) in zip(
            sequences[k + 1 :], boxes[k + 1 :], strict=True
        ):
            rigid &= ~np.array(sequence, dtype=bool).any(axis=0)
            least = np.where(rigid, np.maximum(least, later_low), least)
            most = np.where(rigid, np.minimum(most, later_high), most)
        yield least, most


def _w_box(problem: Problem, goal: GoalSet) -> Box:
    limit, ends = problem.robot.limits.curvature_per_m, goal.box(problem.start.configuration)
    low, high = bending(problem.robot).coordinates(np.clip(ends, -limit, limit)[:, POSE:])
    return low, high
