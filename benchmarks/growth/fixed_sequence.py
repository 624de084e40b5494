"""One nonlinear program of a fixed mode sequence, from a robot at rest."""

from __future__ import annotations

import itertools
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.measurement import Timing, timed_in_turns
from twosra_mpc import Problem
from twosra_mpc.model.motion import roll_out
from twosra_mpc.planning.nlp.fixed_sequence import improve
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, ModeSequence
from twosra_mpc.timing import transition_model


@dataclass(frozen=True)
class SequenceSolve:
    """A solved program.

    Attributes:
        problem: Label of the problem.
        phases: Number of phases.
        intervals: Shooting intervals per phase.
        iterations: Iterations of the solver; None if it found nothing.
        timing: Times of the calls: solver, fine roll-out, landing and schedule.
    """

    problem: str
    phases: int
    intervals: int
    iterations: int | None
    timing: Timing

    @property
    def iteration_s(self) -> float:
        """CPU time per iteration of the solver, everything included [s]; NaN without any."""
        return self.timing.cpu_median_s / self.iterations if self.iterations else float("nan")

    def to_record(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> SequenceSolve:
        """Read plain data back."""
        timing = record["timing"]
        times = Timing(timing["first_s"], tuple(timing["wall_s"]), tuple(timing["cpu_s"]))
        return cls(**{**record, "timing": times})


def cyclic_sequence(phases: int) -> ModeSequence:
    """Rigid, segment 1 soft, segment 2 soft, and so on: reaches any goal from three phases on."""
    return tuple(itertools.islice(itertools.cycle((RIGID, SOFT_1, SOFT_2)), phases))


def solve_record(
    label: str, problem: Problem, phases: int, intervals: int, repeats: int, budget_s: float
) -> SequenceSolve:
    """Solve the program of ``cyclic_sequence(phases)`` from a guess that does not move.

    With such a guess the work does not depend on how good the planner's own guesses are.
    """
    sequence = cyclic_sequence(phases)
    network = transition_model(problem).network(sequence, problem.goal.mode, [0.0] * phases)
    rest = np.zeros((phases, intervals, 5))
    guess = roll_out(problem.robot, problem.start.configuration, sequence, rest)
    solve = partial(improve, guess, network, problem)
    candidate, timing = timed_in_turns({"solve": solve}, repeats, budget_s)["solve"]
    iterations = candidate.iterations if candidate else None
    return SequenceSolve(label, phases, intervals, iterations, timing)
