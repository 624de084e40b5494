"""The peer planners return typed answers, are judged like our plans, and a run resumes."""

from __future__ import annotations

import dataclasses
import io
import itertools
import os
import signal
import time
from collections.abc import Mapping
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from problems import random_problem
from rich.console import Console

from benchmarks.measurement import PlanRecord, Timing
from benchmarks.report import write_report
from benchmarks.run import open_log, results_of, run_study
from benchmarks.run_log import RunLog
from benchmarks.studies import peers
from benchmarks.studies.peers import BROKE_DOWN, CRASHED, OURS, Case, Peer, Peers, attempt, isolated
from benchmarks.studies.peers.enumeration import Enumeration, admissible_sequences
from benchmarks.studies.peers.integral_approximation import IntegralApproximation
from benchmarks.studies.peers.minlp import TimeGridMinlp
from benchmarks.studies.peers.motions import Answer, Solve, judged
from benchmarks.studies.peers.rounding import rounded
from benchmarks.studies.peers.spatial import ScipModel, SpatialMinlp, evaluated
from benchmarks.studies.peers.time_grid import as_motion, waits
from benchmarks.study import Measured
from twosra_mpc import InputError, Problem, load_problem
from twosra_mpc.planning.planner import plan
from twosra_mpc.robot.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH
from twosra_mpc.validation import Value

TINY = Peers(
    problems=("published:4",),
    minlp=TimeGridMinlp(stages=3, time_limit_s=5.0, longest_stage_s=2.0),
    integral_approximation=IntegralApproximation(stages=6, max_switches=1, dwell_stages=1),
    enumeration=Enumeration(max_phases=2),
)
TEXTBOOK = {name for name, peer in TINY.peers().items() if not isinstance(peer, SpatialMinlp)}
EASY = "paper-4"  # one segment must bend: two phases do
QUIET = Console(file=io.StringIO())


class Stub(Value):
    """A peer that finds nothing, breaks down with ``words``, or takes its process with it."""

    words: str = ""
    crashes: bool = False

    def prepared(self, problem: Problem) -> Solve:
        del problem
        return self._solve

    def _solve(self) -> Answer:
        if self.crashes:
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.words:
            raise RuntimeError(f"somewhere deep:\n{self.words}")
        return Answer("nothing found", None)


class Stubbed(Peers):
    """Our planner and stubs."""

    def peers(self) -> Mapping[str, Peer]:
        return {"first": Stub(), "second": Stub(crashes=True), "third": Stub()}


@pytest.fixture(scope="module")
def easy() -> Problem:
    return load_problem(EASY)


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> dict[str, PlanRecord]:
    """What our planner and the peers did with the easy problem."""
    planners = {OURS, *TEXTBOOK}
    cases = (case for case in TINY.cases() if case.problem == EASY and case.planner in planners)
    return {case.planner: TINY.run(case) for case in cases}


@pytest.mark.parametrize("peer", sorted(TEXTBOOK))
def test_each_peer_solves_an_easy_problem(rows: dict[str, PlanRecord], peer: str) -> None:
    row = rows[peer]
    assert row.status
    assert row.correct, (row.status, row.message)
    assert row.message == ""
    assert (0, 1) in row.sequence
    assert row.timing.median_s > 0
    assert row.timing.cpu_median_s > 0


def test_no_verified_cost_is_below_the_proved_bound(rows: dict[str, PlanRecord]) -> None:
    bound = rows[OURS].lower_bound
    assert bound is not None
    for row in rows.values():
        assert row.cost is not None
        assert row.cost >= bound * (1 - 1e-9)


def test_a_peer_that_finds_our_sequence_finds_our_cost(
    easy: Problem, rows: dict[str, PlanRecord]
) -> None:
    assert rows["enumeration"].cost == pytest.approx(rows[OURS].cost, rel=easy.gap)


def test_the_report_has_a_row_and_a_summary_for_every_peer(
    rows: dict[str, PlanRecord], tmp_path: Path
) -> None:
    log = open_log("peers", TINY, tmp_path)
    for case in TINY.cases():
        row = rows.get(case.planner, rows["enumeration"])  # as if others had said the same
        log.append(case._asdict(), TINY.record.dump_python(row, mode="json"))
    text = write_report(TINY, log, tmp_path)
    for peer in TINY.peers():
        assert f"| paper-4 | {peer} |" in text
        assert f"| {peer} | 0 % (0 of 4) | 100 % (4 of 4) |" in text
    assert "below our proved lower bound: none" in text


def test_a_resumed_run_computes_only_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = Stubbed(problems=("published:1",), repeats=1)
    begun: list[str] = []
    run = Peers.run
    monkeypatch.setattr(
        Peers, "run", lambda self, case: begun.append(case.planner) or run(self, case)
    )

    def records() -> list[PlanRecord]:
        log = RunLog(tmp_path, {})
        assert run_study(study, log, QUIET)
        return [record for _, record in results_of(study, log)]

    whole = records()
    assert [row.status for row in whole] == ["optimal", "nothing found", CRASHED, "nothing found"]
    assert records() == whole
    assert begun == [OURS, "first", "second", "third"]
    log = RunLog(tmp_path, {})
    log.path.write_text(log.path.read_text()[:-20])  # interrupted while writing the last row
    assert [row.status for row in records()] == [row.status for row in whole]
    assert begun[4:] == ["third"]


def test_a_crash_is_no_time(rows: dict[str, PlanRecord]) -> None:
    """Neither in its row nor in the summary, which are of those that answered."""
    answers = {"paper-1": "nothing found", "paper-2": CRASHED, "paper-3": f"{BROKE_DOWN}why"}
    results = []
    for label, status in answers.items():
        results.append(Measured(Case(label, OURS), rows[OURS]))
        took = Timing(1.0, (1.0,), (1.0,)) if status == CRASHED else rows[OURS].timing
        made = dataclasses.replace(rows["enumeration"], status=status, timing=took)
        results.append(Measured(Case(label, "peer"), made))
    told = TINY.report(results)["rivals"]
    assert [row["crashed"] for row in told] == [False, True, True]
    assert [row[name] for row in told for name in ("wall_ratio", "cpu_ratio")] == [
        *(1.0, 1.0, None, None, None, None)
    ]


def test_a_process_that_is_ended_at_its_limit_has_not_crashed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(peers, "_LIMIT_S", 0.01)
    study = Stubbed(problems=("published:1",), repeats=1)
    assert study.run(Case("paper-1", "second")).status == "ended after 0.01 s"


def test_a_process_that_takes_too_long_or_crashes_is_told_and_the_next_call_answered() -> None:
    with pytest.raises(BrokenProcessPool):
        isolated(0.1, time.sleep, 30.0)
    with pytest.raises(ZeroDivisionError):
        isolated(60.0, divmod, 1, 0)
    assert isolated(60.0, abs, -2) == 2


def test_rows_of_other_settings_are_not_mixed(tmp_path: Path) -> None:
    open_log("peers", TINY, tmp_path)
    other = TINY.with_values(minlp=TimeGridMinlp(stages=4))
    with pytest.raises(InputError, match=r"settings\.minlp\.stages = 4"):
        open_log("peers", other, tmp_path)


def test_a_breakdown_is_reported_in_words(easy: Problem) -> None:
    made = attempt(easy, Stub(words="Uncaught error in Bonmin"))
    assert made.status == "broke down: Uncaught error in Bonmin"
    assert not made.success
    assert made.cost is None


@pytest.mark.parametrize(
    ("peer", "words"),
    [
        (TimeGridMinlp(stages=2, time_limit_s=2.0, longest_stage_s=0.001), "Bonmin: "),
        (IntegralApproximation(stages=2, max_switches=0, dwell_stages=1), "no plan of the rounded"),
        (Enumeration(max_phases=1), "solved 0 of 1"),
    ],
    ids=["minlp", "integral approximation", "enumeration"],
)
def test_a_peer_without_a_plan_says_why(peer: Peer, words: str) -> None:
    made = attempt(load_problem("paper-1"), peer)
    assert words in made.status
    assert made.sequence == ()
    assert made.message == "no motion"


def test_a_sequence_on_which_linear_algebra_gives_up_is_not_solved(
    easy: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def give_up(*_: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr("benchmarks.studies.peers.motions.solve", give_up)
    answer = Enumeration(max_phases=2).prepared(easy)()
    assert answer.status.startswith("IPOPT: solved 0 of ")
    assert answer.motion is None


def test_the_waits_are_those_of_the_network(easy: Problem) -> None:
    least = waits(easy.with_values(timing="constant"))
    assert least == pytest.approx(np.array([[63.0, 37.0, 235.0]] * 2))


def test_stages_of_one_mode_become_a_phase_and_what_rests_is_left_out() -> None:
    problem = random_problem(0)
    moves = np.full((6, 5), 1e-3)
    moves[[2, 5]] = 0.0
    motion = as_motion(problem, [RIGID, RIGID, SOFT_BOTH, SOFT_1, SOFT_1, SOFT_2], moves)
    assert motion is not None
    assert motion.sequence == (RIGID, SOFT_1)
    assert not motion.inputs[0, :, :2].any()
    assert not motion.inputs[1, :, 2:].any()
    assert motion.inputs[:, :, [0, 4]].sum() == pytest.approx(4e-3)
    assert as_motion(problem, [RIGID], np.zeros((1, 5))) is None


def test_a_motion_that_misses_the_goal_is_no_plan(easy: Problem) -> None:
    motion = as_motion(easy, [RIGID], np.full((1, 5), 1e-3))
    assert motion is not None
    assert judged(easy, motion) is None


def test_an_answer_that_misses_the_goal_is_not_correct_and_says_so(
    easy: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = as_motion(easy, [RIGID], np.full((1, 5), 1e-3))
    monkeypatch.setattr(Stub, "_solve", lambda self: Answer("found", motion))
    made = attempt(easy, Stub())
    assert made.success
    assert not made.correct
    assert "misses the goal" in made.message


def test_rounding_keeps_its_limits() -> None:
    shares = np.random.default_rng(1).dirichlet(np.ones(4), 12)
    found = rounded(shares, [[2, 3]], max_switches=2, dwell_stages=3, time_limit_s=60.0)
    assert found.choice is not None
    runs = np.flatnonzero(np.diff([-1, *found.choice, -1]))
    assert len(runs) - 1 <= 3
    assert np.diff(runs)[:-1].min() >= 3
    assert {2, 3} & set(found.choice)
    chosen = np.eye(4)[list(found.choice)]
    assert np.abs(np.cumsum(shares - chosen, axis=0)).max() == pytest.approx(found.error, abs=1e-2)


def test_rounding_reproduces_integral_shares() -> None:
    wanted = (0, 0, 0, 2, 2, 3, 3, 3)
    found = rounded(np.eye(4)[list(wanted)], [], max_switches=3, dwell_stages=2, time_limit_s=60.0)
    assert found.choice == wanted
    assert found.error == pytest.approx(0.0, abs=1e-6)


def test_admissible_sequences_are_all_there_is_up_to_resting_rigid_phases() -> None:
    problem = load_problem("paper-1")  # both segments must bend
    sequences = set(admissible_sequences(problem, 3))
    assert (RIGID, SOFT_BOTH, RIGID) in sequences
    assert (SOFT_1, SOFT_2, SOFT_1) in sequences
    assert (SOFT_BOTH,) not in sequences  # contained in the first
    assert (RIGID, SOFT_1, RIGID) not in sequences  # segment 2 never bends
    assert len(sequences) == sum(
        1
        for a in MODES
        for b in MODES
        for c in MODES
        if a != b != c and any(m[0] for m in (a, b, c)) and any(m[1] for m in (a, b, c))
    )
    assert plan(problem).require().phases[0].mode == RIGID


def test_scip_proves_the_least_value_of_a_casadi_function() -> None:
    """Of all operations that are told, against all points of a fine grid."""
    x = ca.SX.sym("x", 2)
    value = ca.sin(3 * x[0]) * ca.cos(x[1]) + ca.fabs(x[0] - x[1]) / (2 + x[0] ** 2)
    value += ca.fmax(x[0] - 1, -x[1]) + ca.sqrt(9 + ca.exp(x[1] - 4))
    function, model = ca.Function("f", [x], [value]), ScipModel()
    variables = [model.variable(-2.0, 2.0) for _ in range(2)]
    ((cost,),) = evaluated(function, [variables], model)
    _, bound, at = model.solve(cost, 20.0)
    grid = np.array(list(itertools.product(np.linspace(-2, 2, 81), repeat=2))).T
    least = float(function.map(grid.shape[1])(grid).full().min())
    assert at is not None
    incumbent = float(function([at(variable) for variable in variables]))
    assert bound <= incumbent + 1e-6
    assert bound == pytest.approx(incumbent, rel=1e-4)
    assert least - 0.02 <= incumbent <= least + 1e-6


def test_scip_takes_the_time_grid_and_says_how_it_ended(easy: Problem) -> None:
    answer = SpatialMinlp(solver="SCIP", stages=1, time_limit_s=0.5).prepared(easy)()
    assert answer.status.startswith("SCIP: timelimit")
    assert answer.motion is None
    assert answer.bound is None or answer.bound <= plan(easy).require().cost.total
