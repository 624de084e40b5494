"""Verified plans of one mode sequence where nothing is in the way: guess first, then the NLP."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from twosra_mpc.model.flow import Motion
from twosra_mpc.planning.nlp.fixed_sequence import INTERVALS, Candidate, scheduled, solve
from twosra_mpc.planning.nlp.guess import (
    bend_changes,
    bends_around,
    guess_motion,
    inner_bends,
    inner_goal,
    moved_inside,
    swerved,
)
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.single_goal.gentle import cheapest
from twosra_mpc.planning.single_goal.outcome import verified
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.limits import may_drive
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.timing import TemporalNetwork

_ASIDE_RAD = 0.4  # of the second start of a drive


class Solved(NamedTuple):
    """A verified plan, and what it was made of."""

    plan: Plan
    candidate: Candidate
    network: TemporalNetwork


class SequenceSolver:
    """Yields verified plans of one mode sequence: the guess and, if it is not enough, the NLP's."""

    def __init__(self, problem: Problem, deadline: float = math.inf) -> None:
        self.problem = problem
        self._box = bend_changes(problem, problem.goal)
        least = np.clip(0.0, *self._box)
        nearest = np.array([least, least])  # where a margin does not fit, bending less may
        self._aims = (bend_changes(problem, inner_goal(problem)), nearest)
        self.deadline = deadline  # of time.perf_counter(); the NLP is not begun after it
        self.iterations = 0

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound
    ) -> Iterator[tuple[float, Solved] | None]:
        """Yield (cost, plan) of every attempt, each dearer than the one before; None: it failed."""
        problem = self.problem
        inside, nearest = (
            inner_bends(network.sequence, bound.bends, self._box, aim) for aim in self._aims
        )
        guess, first = self._guessed(network, inside)
        if first is None and not np.array_equal(inside, nearest):
            guess, first = self._guessed(network, nearest)
        if (
            first is None
            and (around := bends_around(problem, network.sequence, inside)) is not None
        ):
            guess, first = self._guessed(network, around)
        near = first is not None and first[0] - bound.cost <= problem.gap * first[0]
        if not (near or np.array_equal(inside, bound.bends)):  # the edge of the goal costs least
            _, edge = self._guessed(network, bound.bends)
            first = edge if edge and (first is None or edge[0] < first[0]) else first
        yield first
        starts = [guess]
        jumps = problem.robot.limits.wheel_acceleration_rad_s2 is None  # else bends of a way cost
        if jumps and not any(map(any, network.sequence)):  # all there is to do is to drive
            starts.append(swerved(guess, _ASIDE_RAD))
        for start in starts:
            if time.perf_counter() > self.deadline:
                return
            candidate = solve(start, network, problem)
            self.iterations += candidate.iterations if candidate else 0
            yield checked(problem, candidate, network)

    def _guessed(
        self, network: TemporalNetwork, bends: Array
    ) -> tuple[Motion, tuple[float, Solved] | None]:
        """The guess that bends as told, and the plan that it is."""
        guess = self._guess(network, bends)
        made = scheduled(guess, network, self.problem, iterations=0)
        return guess, checked(self.problem, made, network)

    def _guess(self, network: TemporalNetwork, bends: Array) -> Motion:
        problem, sequence = self.problem, network.sequence
        start, usable = problem.start.configuration, may_drive(problem, sequence)
        goal = problem.goal
        made = guess_motion(problem.robot, start, goal, sequence, bends, INTERVALS, usable)
        return moved_inside(made, problem)


def checked(
    problem: Problem, candidate: Candidate | None, network: TemporalNetwork
) -> tuple[float, Solved] | None:
    """(cost, plan) of a candidate at its durations of least cost; None if it does not verify."""
    if candidate is None:
        return None
    candidate = cheapest(problem, candidate, network)
    made = verified(problem, candidate, network)
    if not made.verification.ok:
        return None
    return made.cost.total, Solved(made, candidate, network)
