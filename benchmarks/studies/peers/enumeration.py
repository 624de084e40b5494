"""Peer 3: solve every mode sequence and keep the best.

The nonlinear program of a sequence is our own (``nlp.fixed_sequence.improve``: direct multiple
shooting, IPOPT, our temporal network), started cold: states on a straight line from start to goal,
equal small inputs. What this peer lacks is the bounds, the guess made from them and the search.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import asdict, dataclass

from benchmarks.peers.answer import Answer, Settings, network_of
from benchmarks.peers.shooting import INTERVALS, cold_guess, compile_programs, solved
from benchmarks.peers.time_grid import bent_segments
from twosra_mpc import Problem
from twosra_mpc.planning.nlp.fixed_sequence import Candidate
from twosra_mpc.planning.outcome import verified
from twosra_mpc.robot.modes import RIGID, ModeSequence


@dataclass(frozen=True)
class Enumeration:
    """Peer 3 and what was tuned."""

    max_phases: int = 4

    @property
    def name(self) -> str:
        """What the report calls it."""
        return "enumeration"

    @property
    def settings(self) -> Settings:
        """Everything that was tuned."""
        return {**asdict(self), "intervals": INTERVALS}

    def prepare(self, problem: Problem) -> None:
        """Compile the programs."""
        compile_programs(problem, self.max_phases)

    def solve(self, problem: Problem) -> Answer:
        """Plan; the answer is the shortest motion that verifies."""
        sequences = list(admissible_sequences(problem, self.max_phases))
        tried = (solved(cold_guess(problem, sequence), problem) for sequence in sequences)
        found = [candidate for candidate in tried if candidate is not None]
        status = f"IPOPT: solved {len(found)} of {len(sequences)} sequences"
        for candidate in sorted(found, key=_duration):
            network = network_of(problem, candidate.motion)
            if verified(problem, candidate, network).verification.ok:
                return Answer(status, candidate.motion)
        return Answer(f"{status}, none verified", None)


def _duration(candidate: Candidate) -> float:
    return float(candidate.times.max())


def admissible_sequences(problem: Problem, max_phases: int) -> Iterator[ModeSequence]:
    """Yield the mode sequences that might do: no mode repeats, what must bend is soft sometime.

    A rigid phase may have zero length. So a sequence that is another one without its rigid phase
    at an end where the robot is rigid anyway is left out.
    """
    bends = bent_segments(problem)
    for count in range(1, max_phases + 1):
        for sequence in itertools.product(problem.modes, repeat=count):
            repeats = any(a == b for a, b in itertools.pairwise(sequence))
            bendable = all(any(mode[j] for mode in sequence) for j in bends)
            extensible = count < max_phases and RIGID in problem.modes
            open_first = problem.start_mode == RIGID != sequence[0]
            open_last = problem.goal.mode == RIGID != sequence[-1]
            if bendable and not repeats and not (extensible and (open_first or open_last)):
                yield sequence
