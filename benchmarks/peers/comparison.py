"""Run the peers beside our planner, row by row, each row saved as soon as it is known."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.machine import machine, versions
from benchmarks.measurement import timed_in_turns
from benchmarks.peers.answer import Answer, Judgement, Peer, judged
from benchmarks.run_log import RunLog
from twosra_mpc import Problem, plan
from twosra_mpc.modes import sequence_name

CALLS = 5  # of our planner, after one that compiles; their medians count
_BUDGET_S = 60.0  # for these calls


@dataclass(frozen=True)
class Row:
    """One peer on one problem, and our planner on the same problem in the same run.

    Attributes:
        problem: Label of the problem.
        peer: Name of the peer.
        status: How the peer ended, in the words of its solvers.
        sequence: The mode sequence it returned; empty without one.
        verified: Whether its motion verifies.
        cost: Cost of its motion under our schedule [s]; None without one.
        problems: What is wrong with it, in words.
        wall_s: Wall time the peer took.
        cpu_s: CPU time the peer took.
        our_cost: Cost of our plan [s]; None without one.
        our_lower_bound: What our planner proved [s]; None if nothing.
        our_wall_s: Median wall time of our planner, warm.
        our_cpu_s: Median CPU time of our planner, warm.
        load: Load average of the machine when the row was done.
    """

    problem: str
    peer: str
    status: str
    sequence: str
    verified: bool
    cost: float | None
    problems: tuple[str, ...]
    wall_s: float
    cpu_s: float
    our_cost: float | None
    our_lower_bound: float | None
    our_wall_s: float
    our_cpu_s: float
    load: float


@dataclass(frozen=True)
class Reference:
    """What our planner does with a problem; times are medians of warm calls [s]."""

    cost: float | None
    lower_bound: float | None
    wall_s: float
    cpu_s: float


def settings_of(peers: Sequence[Peer]) -> dict[str, Any]:
    """Everything that must stay the same for rows to stand in one table."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return {
        "peers": {peer.name: dict(peer.settings) for peer in peers},
        "machine": machine(),
        "versions": {**versions(), "peers": digest.hexdigest()[:12]},
    }


def compare(
    problems: Sequence[tuple[str, Problem]],
    peers: Sequence[Peer],
    log: RunLog,
    on_start: Callable[[str], None],
) -> Iterator[Row]:
    """Yield a row for every problem and peer; only those that ``log`` does not hold are computed.

    Args:
        problems: (label, problem) pairs.
        peers: The peers.
        log: The rows that are known; new ones are added.
        on_start: Told what is computed next.
    """
    for label, problem in problems:
        ours: Reference | None = None
        for peer in peers:
            key = f"{label}: {peer.name}"
            if key not in log.records:
                on_start(key)
                ours = ours or reference(problem)
                log.append(key, asdict(_row(label, problem, peer, ours)))
            record = log.records[key]
            yield Row(**{**record, "problems": tuple(record["problems"])})


def reference(problem: Problem) -> Reference:
    """Plan with our planner, compiled and warm.

    Raises:
        KeyboardInterrupt: If interrupted: what the planner returns then is not its answer.
    """
    calls = {"ours": lambda: plan(problem)}
    made, timing = timed_in_turns(calls, CALLS, _BUDGET_S)["ours"]
    if made.stopped_early and made.stats.wall_s < problem.time_limit_s:
        raise KeyboardInterrupt
    cost = made.cost.total if made.found and made.cost else None
    return Reference(cost, made.lower_bound, timing.median_s, timing.cpu_median_s)


def attempt(problem: Problem, peer: Peer) -> tuple[Answer, Judgement, float, float]:
    """Let a peer plan: its answer, what it is worth, and the wall and CPU time of planning [s].

    A peer that breaks down has answered too, in the words of what broke.
    """
    with _silent():
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            peer.prepare(problem)
            wall, cpu = time.perf_counter(), time.process_time()
            answer = peer.solve(problem)
        except (RuntimeError, ArithmeticError, ValueError) as error:
            *_, words = str(error).strip().splitlines() or [type(error).__name__]
            answer = Answer(f"broke down: {words}", None)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    if answer.motion is None:
        return answer, Judgement(None, False, ("no motion",)), wall, cpu
    return answer, judged(problem, answer.motion), wall, cpu


def _row(label: str, problem: Problem, peer: Peer, ours: Reference) -> Row:
    answer, judgement, wall, cpu = attempt(problem, peer)
    return Row(
        problem=label,
        peer=peer.name,
        status=answer.status,
        sequence=sequence_name(answer.motion.sequence) if answer.motion else "",
        verified=judgement.verified,
        cost=judgement.cost,
        problems=judgement.problems,
        wall_s=wall,
        cpu_s=cpu,
        our_cost=ours.cost,
        our_lower_bound=ours.lower_bound,
        our_wall_s=ours.wall_s,
        our_cpu_s=ours.cpu_s,
        load=os.getloadavg()[0],
    )


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep the solvers' own output, which no option stops, off the report and the progress bar."""
    sys.stdout.flush()
    kept = os.dup(1)
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        try:
            with contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
                yield
        finally:
            os.dup2(kept, 1)
            os.close(kept)
