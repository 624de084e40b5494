"""Peer 3: solve every mode sequence and keep the best.

The nonlinear program of a sequence is our own (direct multiple shooting, IPOPT, our temporal
network), started cold: states on a straight line from start to goal, equal small inputs. What this
peer lacks is the bounds, the guess made from them and the search.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from benchmarks.studies.peers import motions
from benchmarks.studies.peers.motions import Answer, Solve, bent_segments
from benchmarks.study import Count
from twosra_mpc import Problem
from twosra_mpc.robot.modes import ModeSequence, is_rigid
from twosra_mpc.validation import Value


class Enumeration(Value):
    """Peer 3 and what was tuned.

    Attributes:
        max_phases: Longest sequence.
    """

    max_phases: Count = 4

    def prepared(self, problem: Problem) -> Solve:
        """Compile the programs; the answer is the shortest motion that verifies."""
        motions.compile_programs(problem, self.max_phases)

        def solve() -> Answer:
            sequences = list(admissible_sequences(problem, self.max_phases))
            tried = (
                motions.solved(motions.cold_guess(problem, sequence), problem)
                for sequence in sequences
            )
            found = [candidate for candidate in tried if candidate is not None]
            status = f"IPOPT: solved {len(found)} of {len(sequences)} sequences"
            for candidate in sorted(found, key=lambda candidate: float(candidate.times.max())):
                outcome = motions.judged(problem, candidate.motion)
                if outcome and outcome.verification.ok:
                    return Answer(status, candidate.motion)
            return Answer(f"{status}, none verified", None)

        return solve


def admissible_sequences(problem: Problem, max_phases: int) -> Iterator[ModeSequence]:
    """Yield the mode sequences that might do: no mode repeats, what must bend is soft sometime.

    A rigid phase may have zero length. So a sequence that is another one without its rigid phase
    at an end where the robot is rigid anyway is left out.
    """
    may_drive, ends = any(map(is_rigid, problem.modes)), (problem.start_mode, problem.goal.mode)
    for count in range(1, max_phases + 1):
        for sequence in itertools.product(problem.modes, repeat=count):
            repeats = any(a == b for a, b in itertools.pairwise(sequence))
            bendable = all(any(mode[j] for mode in sequence) for j in bent_segments(problem))
            open_ended = any(
                is_rigid(stiffness) and not is_rigid(mode)
                for stiffness, mode in zip(ends, (sequence[0], sequence[-1]), strict=True)
            )
            if bendable and not repeats and not (count < max_phases and may_drive and open_ended):
                yield sequence
