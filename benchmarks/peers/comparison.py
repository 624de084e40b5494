"""Run the peers beside our planner, row by row, each row saved as soon as it is known."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.machine import machine, versions
from benchmarks.measurement import timed_in_turns
from benchmarks.peers.answer import Answer, Judgement, Peer, judged
from benchmarks.peers.worker import Worker, WorkerDiedError
from benchmarks.run_log import RunLog
from twosra_mpc import Problem, plan
from twosra_mpc.robot.modes import sequence_name

CALLS = 5  # of our planner, after one that compiles; their medians count
_BUDGET_S = 60.0  # for these calls
_TIME_LIMIT_S = 1800.0  # of one row, compiling included
_NO_MOTION = Judgement(None, False, ("no motion",))


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
        cpu_s: CPU time the peer took; the wall time if it crashed.
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


@dataclass(frozen=True)
class Attempt:
    """What a peer did with a problem; times are those of planning alone [s]."""

    status: str
    sequence: str
    judgement: Judgement
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
    worker = Worker(_TIME_LIMIT_S)
    for label, problem in problems:
        ours: Reference | None = None
        for peer in peers:
            key = f"{label}: {peer.name}"
            if key not in log.records:
                on_start(key)
                ours = ours or worker.call(reference, problem)
                made = _attempt_in(worker, problem, peer)
                log.append(key, asdict(_row(label, peer, made, ours)))
            record = log.records[key]
            yield Row(**{**record, "problems": tuple(record["problems"])})


def reference(problem: Problem) -> Reference:
    """Plan with our planner, compiled and warm."""
    calls = {"ours": lambda: plan(problem)}
    made, timing = timed_in_turns(calls, CALLS, _BUDGET_S)["ours"]
    cost = made.plan.cost.total if made.plan else None
    return Reference(cost, made.lower_bound, timing.median_s, timing.cpu_median_s)


def attempt(problem: Problem, peer: Peer) -> Attempt:
    """Let a peer plan, and judge its answer.

    A peer that breaks down has answered too, in the words of what broke.
    """
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
        return Attempt(answer.status, "", _NO_MOTION, wall, cpu)
    sequence = sequence_name(answer.motion.sequence)
    return Attempt(answer.status, sequence, judged(problem, answer.motion), wall, cpu)


def _attempt_in(worker: Worker, problem: Problem, peer: Peer) -> Attempt:
    started = time.perf_counter()
    try:
        return worker.call(attempt, problem, peer)
    except WorkerDiedError as error:
        took = time.perf_counter() - started
        return Attempt(f"crashed: {error}", "", _NO_MOTION, took, took)


def _row(label: str, peer: Peer, made: Attempt, ours: Reference) -> Row:
    return Row(
        problem=label,
        peer=peer.name,
        status=made.status,
        sequence=made.sequence,
        verified=made.judgement.verified,
        cost=made.judgement.cost,
        problems=made.judgement.problems,
        wall_s=made.wall_s,
        cpu_s=made.cpu_s,
        our_cost=ours.cost,
        our_lower_bound=ours.lower_bound,
        our_wall_s=ours.wall_s,
        our_cpu_s=ours.cpu_s,
        load=os.getloadavg()[0],
    )
