"""Peer planners: textbook ways to solve the same problems, judged like our own plans."""

from __future__ import annotations

import faulthandler
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, ClassVar, NamedTuple, Protocol

from pydantic import TypeAdapter

from benchmarks.measurement import PlanRecord, Timing, facts
from benchmarks.studies.peers.enumeration import Enumeration
from benchmarks.studies.peers.integral_approximation import IntegralApproximation
from benchmarks.studies.peers.minlp import TimeGridMinlp
from benchmarks.studies.peers.motions import Answer, Solve, judged
from benchmarks.studies.peers.spatial import SpatialMinlp
from benchmarks.study import Measured, PlanStudy
from twosra_mpc import Plan, Problem

OURS = "this package"
CRASHED = "crashed"  # its process ended by itself, without an answer
BROKE_DOWN = "broke down: "  # its solver raised, in these words
_ROUNDING = 1e-6  # relative; costs closer than this are equal
_LIMIT_S = 1800.0  # of one case, compiling included


class Peer(Protocol):
    """A planner to compare with."""

    def prepared(self, problem: Problem) -> Solve:
        """Compile what a problem needs; only the call of what is returned is timed."""


class Case(NamedTuple):
    """One planner on one problem."""

    problem: str
    planner: str


class Peers(PlanStudy):
    """Our planner and its peers, each in a process of its own.

    Attributes:
        minlp: Peer 1.
        integral_approximation: Peer 2.
        enumeration: Peer 3.
        scip: Peer 4.
        discopt: Peer 5; ``pip install discopt`` is of no use else.
    """

    record: ClassVar = TypeAdapter(PlanRecord)
    question: ClassVar = (
        "What do textbook methods cost on the same problems, and what do they find?"
    )

    minlp: TimeGridMinlp = TimeGridMinlp()
    integral_approximation: IntegralApproximation = IntegralApproximation()
    enumeration: Enumeration = Enumeration()
    scip: SpatialMinlp = SpatialMinlp(solver="SCIP")
    discopt: SpatialMinlp = SpatialMinlp(solver="discopt")

    def peers(self) -> Mapping[str, Peer]:
        """The peers by name."""
        return {
            "time-grid MINLP": self.minlp,
            "integral approximation": self.integral_approximation,
            "enumeration": self.enumeration,
            "SCIP": self.scip,
            "discopt": self.discopt,
        }

    def cases(self) -> Iterator[Case]:
        """Yield our planner and all peers, problem by problem."""
        for label in self.named:
            yield from (Case(label, planner) for planner in (OURS, *self.peers()))

    def run(self, case: Case) -> PlanRecord:
        """Plan, and judge the answer."""
        problem, started = self.named[case.problem], time.perf_counter()
        try:
            if case.planner == OURS:
                return isolated(_LIMIT_S, self.planned, problem)
            return isolated(_LIMIT_S, attempt, problem, self.peers()[case.planner])
        except BrokenProcessPool:
            took_s = time.perf_counter() - started
            words = CRASHED if took_s < _LIMIT_S else f"ended after {_LIMIT_S:zg} s"
            return _record(Answer(words, None), None, took_s, took_s)

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Every peer's answers beside ours."""
        ours = {case.problem: made for case, made in results if case.planner == OURS}
        rivals = [
            _beside(case, made, ours[case.problem])
            for case, made in results
            if case.planner != OURS
        ]
        unplanned = [label for label, made in ours.items() if not made.correct]
        return {"rivals": rivals, "unplanned": unplanned}


def _beside(case: Case, made: PlanRecord, ours: PlanRecord) -> dict[str, Any]:
    """An answer beside ours; costs are compared where both planners have a verified plan.

    When a planner crashed or broke down says nothing of how long it takes: such times are None.
    """
    cost = made.cost if made.correct else None
    above = cost / ours.cost - 1 if cost and ours.cost and ours.correct else None
    wall_s, cpu_s, bound = made.timing.median_s, made.timing.cpu_median_s, made.lower_bound
    crashed = made.status == CRASHED or made.status.startswith(BROKE_DOWN)
    return {
        **{"problem": case.problem, "peer": case.planner, "record": made, "ours": ours},
        **{"name": f"{case.problem} ({case.planner})", "above": above},
        "crashed": crashed,
        "proved": None if bound is None or not ours.cost else bound / ours.cost,
        "wall_s": None if crashed else wall_s,
        "cpu_s": None if crashed else cpu_s,
        "wall_ratio": None if crashed else wall_s / ours.timing.median_s,
        "cpu_ratio": None if crashed else cpu_s / ours.timing.cpu_median_s,
        "better": above is not None and above < -_ROUNDING,
        "below_bound": cost is not None and cost < (ours.lower_bound or 0.0) * (1 - _ROUNDING),
    }


def isolated(limit_s: float, function: Callable[..., PlanRecord], *args: Any) -> PlanRecord:
    """Call a function in a process of its own: one that crashes takes nothing else with it.

    Raises:
        BrokenProcessPool: If the process crashed, or was ended after ``limit_s`` of wall time.
    """
    # A fork of this process would inherit HiGHS' scheduler without its threads: of one that has
    # imported everything, and done nothing.
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__])
    with ProcessPoolExecutor(1, context, initializer=_begin, initargs=(limit_s,)) as pool:
        return pool.submit(function, *args).result()


def _begin(limit_s: float) -> None:
    """Print nowhere, as Bonmin and HiGHS print whatever their options say; end after a time."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    faulthandler.dump_traceback_later(limit_s, exit=True)


def attempt(problem: Problem, peer: Peer) -> PlanRecord:
    """Let a peer plan, and judge its answer.

    A peer that breaks down has answered too, in the words of what broke.
    """
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        solve = peer.prepared(problem)
        wall, cpu = time.perf_counter(), time.process_time()
        answer = solve()
    except (RuntimeError, ArithmeticError, ValueError, ImportError) as error:
        *_, words = str(error).strip().splitlines() or [type(error).__name__]
        answer = Answer(f"{BROKE_DOWN}{words}", None)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    found = judged(problem, answer.motion) if answer.motion else None
    return _record(answer, found, wall, cpu)


def _record(answer: Answer, plan: Plan | None, wall_s: float, cpu_s: float) -> PlanRecord:
    """Write down an answer under the rules of our own plans."""
    message = "; ".join(plan.verification.problems) if plan else "no motion"
    if answer.motion and not plan:
        message = "the motion misses the goal, takes a forbidden shape, or has no schedule"
    return PlanRecord(
        status=answer.status,
        message=message,
        success=answer.motion is not None,
        stopped_early=False,
        timing=Timing(wall_s, (wall_s,), (cpu_s,)),
        lower_bound=answer.bound,
        **(facts(plan) if plan else {}),
    )
