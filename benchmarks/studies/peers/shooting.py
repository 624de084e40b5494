"""Our own multiple-shooting program of a fixed sequence, as two of the peers use it."""

from __future__ import annotations

import contextlib
import itertools

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.answer import network_of
from benchmarks.peers.time_grid import straight_line
from twosra_mpc import Problem
from twosra_mpc.model.motion import Motion
from twosra_mpc.planning.nlp.fixed_sequence import Candidate, improve
from twosra_mpc.planning.nlp.landing import available_inputs
from twosra_mpc.planning.nlp.multiple_shooting import INPUT_SCALE
from twosra_mpc.robot.modes import RIGID, SOFT_1, ModeSequence

Array = NDArray[np.float64]

INTERVALS = 5  # a phase; our planner's 10 take twice the time and gain nothing measurable here
_FIRST_INPUT = 0.03  # scaled input displacement of every interval of a cold guess


def solved(guess: Motion, problem: Problem) -> Candidate | None:
    """Solve the program of the guess's sequence, scheduled by our temporal network.

    None if there is no plan, be it that linear algebra gives up on a wild solution.
    """
    with contextlib.suppress(np.linalg.LinAlgError):
        return improve(guess, network_of(problem, guess), problem)
    return None


def cold_guess(problem: Problem, sequence: ModeSequence) -> Motion:
    """States on a straight line from start to goal, and equal small inputs."""
    phases = len(sequence)
    line = straight_line(problem, phases * INTERVALS + 1)
    usable = available_inputs(sequence, INTERVALS).reshape(phases, INTERVALS, 5)
    return Motion(
        problem.robot, sequence, usable * _FIRST_INPUT * INPUT_SCALE, by_phase(line, phases)
    )


def by_phase(nodes: Array, phases: int) -> Array:
    """Split states at phases * INTERVALS + 1 nodes into (phases, INTERVALS + 1, 5)."""
    index = np.arange(phases)[:, None] * INTERVALS + np.arange(INTERVALS + 1)
    return np.asarray(nodes[index])


def compile_programs(problem: Problem, max_phases: int) -> None:
    """Build the program of every number of phases: the first use of each compiles it."""
    alternating = tuple(itertools.islice(itertools.cycle((RIGID, SOFT_1)), max_phases))
    for phases in range(1, max_phases + 1):
        solved(cold_guess(problem, alternating[:phases]), problem)
