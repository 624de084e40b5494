"""Random problems computed in pieces, by several processes; each piece is kept when it is done."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from typing import NamedTuple

from twosra_mpc.lab.paper.kept import Data, Kept, Part, Tell
from twosra_mpc.lab.reproduction.greedy_statistics import (
    Kind,
    OptimalProblem,
    StudyProblem,
    optimal_study,
    published_study,
)

PIECE = 20  # problems of a piece: seconds of work, which an interrupt loses
KINDS: tuple[Kind, ...] = ("single-mode", "generic")
ROBOT = "2sra-v1-paper"


@dataclass(frozen=True)
class Study:
    """Random problems with what both planners do; the optimal one only where FK made the target."""

    single_mode: list[StudyProblem]
    generic: list[StudyProblem]
    optimal: list[OptimalProblem]


class _Piece(NamedTuple):
    """Problems of one kind, drawn from the seeds ``first`` to ``end - 1``."""

    kind: Kind
    first: int
    end: int

    def part(self) -> Part:
        """The piece as something to keep."""
        name = f"random-{self.kind}-{self.first}"
        settings = {"robot": ROBOT, "piece": list(self)}
        return Part(name, settings, lambda _folder, _tell: self.compute())

    def compute(self) -> Data:
        """Both planners on these problems."""
        found = list(published_study(range(self.first, self.end), self.kind))
        planned = optimal_study(found, ROBOT) if self.kind == "single-mode" else ()
        return {
            "published": [one.to_dict() for one in found],
            "optimal": [one.to_dict() for one in planned],
        }


def random_problems(kept: Kept, problems: int, processes: int, tell: Tell) -> Study:
    """Return so many random problems of each kind, those that are not kept computed.

    Args:
        kept: Where pieces are kept.
        problems: How many of each kind, from seed 0 on.
        processes: How many compute at a time; 1: this one.
        tell: Is told how far it is.
    """
    pieces = [
        _Piece(kind, first, min(first + PIECE, problems))
        for kind in KINDS
        for first in range(0, problems, PIECE)
    ]
    data = {piece: found for piece in pieces if (found := kept.read(piece.part())) is not None}
    missing, drawn = [piece for piece in pieces if piece not in data], len(KINDS) * problems
    with closing(_computed(missing, processes)) as computed:
        for piece, found in computed:
            data[piece] = kept.write(piece.part(), found)
            tell(f"random problems: {sum(one.end - one.first for one in data)} of {drawn}")
    published = {
        kind: [
            StudyProblem.from_dict(one)
            for piece in pieces
            if piece.kind == kind
            for one in data[piece]["published"]
        ]
        for kind in KINDS
    }
    planned = [OptimalProblem.from_dict(one) for piece in pieces for one in data[piece]["optimal"]]
    return Study(published["single-mode"], published["generic"], planned)


def _computed(
    pieces: Sequence[_Piece], processes: int
) -> Generator[tuple[_Piece, Data], None, None]:
    """Yield pieces as they are done; whatever ends this early ends the processes, too."""
    if processes == 1:
        for piece in pieces:
            yield piece, piece.compute()
        return
    # Not by a fork: the line of progress is drawn by a thread.
    spawn, others = multiprocessing.get_context("spawn"), set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, spawn, initializer=_ignore_interrupts)
    try:
        waiting = {pool.submit(piece.compute): piece for piece in pieces}
        for done in as_completed(waiting):
            yield waiting[done], done.result()
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _ignore_interrupts() -> None:
    """Leave Ctrl-C, which a terminal sends to all of its processes, to the first of them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
