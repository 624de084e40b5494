"""What a peer planner answers, and how every answer is judged: by our network and verification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from twosra_mpc import Problem
from twosra_mpc.model.motion import Motion
from twosra_mpc.planning.nlp.fixed_sequence import timed
from twosra_mpc.planning.outcome import verified
from twosra_mpc.timing import TemporalNetwork, transition_model

Settings = Mapping[str, str | int | float]


@dataclass(frozen=True, eq=False)
class Answer:
    """What a peer planner found.

    Attributes:
        status: How it ended, in the words of its solvers.
        motion: Mode sequence and path; None if it found none.
    """

    status: str
    motion: Motion | None


class Peer(Protocol):
    """A planner to compare with."""

    @property
    def name(self) -> str:
        """What the report calls it."""

    @property
    def settings(self) -> Settings:
        """Everything that was tuned, by name."""

    def prepare(self, problem: Problem) -> None:
        """Compile the programs for a problem's robot; not counted in the time of ``solve``."""

    def solve(self, problem: Problem) -> Answer:
        """Plan.

        Raises:
            RuntimeError: If a solver breaks down.
        """


@dataclass(frozen=True)
class Judgement:
    """An answer under the rules of our own plans.

    Attributes:
        cost: Cost of the best schedule of the motion [s]; None if it cannot be scheduled.
        verified: Whether independent re-integration confirms every limit and the goal.
        problems: What is wrong, in words; empty if verified.
    """

    cost: float | None
    verified: bool
    problems: tuple[str, ...]


def network_of(problem: Problem, motion: Motion) -> TemporalNetwork:
    """Our temporal network of a motion's mode sequence."""
    unknown = [0.0] * len(motion.sequence)
    return transition_model(problem).network(motion.sequence, problem.goal.mode, unknown)


def judged(problem: Problem, motion: Motion) -> Judgement:
    """Schedule a motion as well as its sequence allows, sample it and verify the result."""
    network = network_of(problem, motion)
    candidate = timed(motion, network, problem, iterations=0)
    if candidate is None:
        reason = "the motion misses the goal, takes a forbidden shape, or has no schedule"
        return Judgement(None, False, (reason,))
    outcome = verified(problem, candidate, network)
    check = outcome.verification
    return Judgement(outcome.cost.total, check.ok, check.problems)
