"""Motions as the peers make and we judge them: our shooting program, network and verification."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import Plan, Problem
from twosra_mpc.model.flow import Motion
from twosra_mpc.planning.solver.fixed_sequence import Candidate, scheduled, solve, verified
from twosra_mpc.planning.solver.guess import available_inputs
from twosra_mpc.planning.solver.multiple_shooting import INPUT_SCALE
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import ModeSequence
from twosra_mpc.timing import TemporalNetwork, transition_model

Array = NDArray[np.float64]

INTERVALS = 5  # a phase; our planner's 10 take twice the time and gain nothing measurable here
_FIRST_INPUT = 0.03  # scaled input displacement of every interval of a cold guess


class Answer(NamedTuple):
    """What a peer says.

    Attributes:
        status: How it ended, in the words of its solvers.
        motion: What it found; None if nothing.
        bound: What it has proved of all solutions of its own program [s]; None if nothing.
    """

    status: str
    motion: Motion | None
    bound: float | None = None


Solve = Callable[[], Answer]  # a peer for one problem, its programs compiled


def network_of(problem: Problem, sequence: ModeSequence) -> TemporalNetwork:
    """Our temporal network of a mode sequence."""
    return transition_model(problem).network(sequence, problem.goal.mode, [0.0] * len(sequence))


def judged(problem: Problem, motion: Motion) -> Plan | None:
    """Schedule a motion as well as its sequence allows, sample it and verify the result.

    None if it misses the goal, takes a forbidden shape, or has no schedule.
    """
    network = network_of(problem, motion.sequence)
    candidate = scheduled(motion, network, problem, iterations=0)
    return verified(problem, candidate, network) if candidate else None


def solved(guess: Motion, problem: Problem) -> Candidate | None:
    """Solve our multiple-shooting program of the guess's sequence.

    None if there is no plan, be it that linear algebra gives up on a wild solution.
    """
    with contextlib.suppress(np.linalg.LinAlgError):
        return solve(guess, network_of(problem, guess.sequence), problem)
    return None


def cold_guess(problem: Problem, sequence: ModeSequence) -> Motion:
    """States on a straight line from start to goal, and equal small inputs."""
    phases = len(sequence)
    nodes = np.arange(phases)[:, None] * INTERVALS + np.arange(INTERVALS + 1)
    usable = available_inputs(sequence, INTERVALS).reshape(phases, INTERVALS, -1)
    states = straight_line(problem, phases * INTERVALS + 1)[nodes]
    return Motion(problem.robot, sequence, usable * _FIRST_INPUT * INPUT_SCALE, states)


def compile_programs(problem: Problem, max_phases: int) -> None:
    """Build the program of every number of phases: the first use of each compiles it."""
    alternating = itertools.cycle(problem.modes[:2])
    sequence = tuple(itertools.islice(alternating, max_phases))
    for phases in range(1, max_phases + 1):
        solved(cold_guess(problem, sequence[:phases]), problem)


def straight_line(problem: Problem, nodes: int) -> Array:
    """States on a straight line from start to goal, (nodes, 3 + n): the guess of every peer."""
    start = problem.start.configuration
    return np.linspace(start, problem.goal.aim(start), nodes)


def bent_segments(problem: Problem) -> list[int]:
    """Segments (from 0) whose curvature must change."""
    start = problem.start.configuration
    low, high = problem.goal.box(start)
    return np.flatnonzero(((start < low) | (start > high))[POSE:]).tolist()
