"""The peer planners return typed answers, are judged like our plans, and a run resumes."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from problems import random_problem

from benchmarks.peers.answer import Answer, Peer, Settings, judged
from benchmarks.peers.comparison import Row, attempt, compare, settings_of
from benchmarks.peers.enumeration import Enumeration, admissible_sequences
from benchmarks.peers.integral_approximation import IntegralApproximation
from benchmarks.peers.minlp import TimeGridMinlp
from benchmarks.peers.report import cost_ratio, report
from benchmarks.peers.rounding import rounded
from benchmarks.peers.time_grid import as_motion, waits
from benchmarks.peers.worker import Worker, WorkerDiedError
from benchmarks.run_log import RunLog
from twosra_mpc import InputError, Problem, load_problem
from twosra_mpc.planning.planner import plan
from twosra_mpc.robot.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH

TINY: tuple[Peer, ...] = (
    TimeGridMinlp(stages=3, time_limit_s=5.0, longest_stage_s=2.0),
    IntegralApproximation(stages=6, max_switches=1, dwell_stages=1),
    Enumeration(max_phases=2),
)


@dataclass(frozen=True)
class Stub:
    """A peer that finds nothing, breaks down with ``words``, or takes its process with it."""

    name: str = "stub"
    words: str = ""
    crashes: bool = False

    @property
    def settings(self) -> Settings:
        return {"words": self.words}

    def prepare(self, problem: Problem) -> None:
        del problem

    def solve(self, problem: Problem) -> Answer:
        del problem
        if self.crashes:
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.words:
            raise RuntimeError(f"somewhere deep:\n{self.words}")
        return Answer("nothing found", None)


@pytest.fixture(scope="module")
def easy() -> Problem:
    """One segment must bend: two phases do."""
    return load_problem("paper-4")


@pytest.fixture(scope="module")
def rows(easy: Problem, tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    log = RunLog(tmp_path_factory.mktemp("peers"), settings_of(TINY))
    return list(compare([("paper-4", easy)], TINY, log, on_start=lambda _: None))


@pytest.mark.parametrize("which", range(len(TINY)), ids=[peer.name for peer in TINY])
def test_each_peer_solves_an_easy_problem(rows: list[Row], which: int) -> None:
    row = rows[which]
    assert row.peer == TINY[which].name
    assert row.status
    assert row.verified, (row.status, row.problems)
    assert row.problems == ()
    assert "[0,1]" in row.sequence
    assert row.wall_s > 0
    assert row.cpu_s > 0


def test_no_verified_cost_is_below_the_proved_bound(rows: list[Row]) -> None:
    for row in rows:
        assert row.cost is not None
        assert row.our_lower_bound is not None
        assert row.cost >= row.our_lower_bound * (1 - 1e-9)
        assert row.our_cost is not None
        assert row.our_lower_bound <= row.our_cost


def test_a_peer_that_finds_our_sequence_finds_our_cost(easy: Problem, rows: list[Row]) -> None:
    ratio = cost_ratio(rows[-1])
    assert ratio == pytest.approx(1.0, abs=easy.gap)


def test_the_report_has_a_row_and_a_summary_for_every_peer(rows: list[Row]) -> None:
    text = report(rows, TINY)
    for peer in TINY:
        assert f"| paper-4 | {peer.name} |" in text
        assert f"| {peer.name} | 1 of 1 |" in text
    assert "below our proved lower bound: none" in text


def test_a_resumed_run_computes_only_what_is_missing(easy: Problem, tmp_path: Path) -> None:
    peers = [Stub("first"), Stub("second", crashes=True), Stub("third")]
    begun: list[str] = []

    def run() -> list[Row]:
        log = RunLog(tmp_path, settings_of(peers))
        return list(compare([("a", easy)], peers, log, on_start=begun.append))

    whole = run()
    assert [row.status for row in whole] == [
        "nothing found",
        "crashed: the process died with exit code -11",
        "nothing found",
    ]
    assert run() == whole
    assert begun == ["a: first", "a: second", "a: third"]
    log = RunLog(tmp_path, settings_of(peers))
    log.path.write_text(log.path.read_text()[:-20])  # interrupted while writing the last row
    assert [row.peer for row in run()] == ["first", "second", "third"]
    assert begun[3:] == ["a: third"]


def test_a_call_that_takes_too_long_is_ended_and_the_next_one_answered() -> None:
    worker = Worker(time_limit_s=60.0)
    assert worker.call(abs, -1) == 1
    worker.time_limit_s = 0.1
    with pytest.raises(WorkerDiedError, match="ended after"):
        worker.call(time.sleep, 30.0)
    worker.time_limit_s = 60.0
    with pytest.raises(ZeroDivisionError):
        worker.call(divmod, 1, 0)
    assert worker.call(abs, -2) == 2


def test_rows_of_other_settings_are_not_mixed(tmp_path: Path) -> None:
    RunLog(tmp_path, settings_of(TINY))
    with pytest.raises(InputError, match="time-grid MINLP"):
        RunLog(tmp_path, settings_of([TimeGridMinlp(stages=4)]))


def test_a_breakdown_is_reported_in_words(easy: Problem) -> None:
    made = attempt(easy, Stub(words="Uncaught error in Bonmin"))
    assert made.status == "broke down: Uncaught error in Bonmin"
    assert not made.judgement.verified
    assert made.judgement.cost is None


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
    assert made.sequence == ""
    assert made.judgement.problems == ("no motion",)


def test_a_sequence_on_which_linear_algebra_gives_up_is_not_solved(
    easy: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def give_up(*_: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr("benchmarks.peers.shooting.improve", give_up)
    answer = Enumeration(max_phases=2).solve(easy)
    assert answer.status.startswith("IPOPT: solved 0 of ")
    assert answer.motion is None


def test_the_waits_are_those_of_the_network(easy: Problem) -> None:
    least = waits(easy.model_copy(update={"timing": "constant"}))
    assert least.melted == pytest.approx((63.0, 63.0))
    assert least.melting == pytest.approx((37.0, 37.0))
    assert least.freezing == pytest.approx((235.0, 235.0))


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


def test_a_motion_that_misses_the_goal_is_judged_in_words(easy: Problem) -> None:
    motion = as_motion(easy, [RIGID], np.full((1, 5), 1e-3))
    assert motion is not None
    judgement = judged(easy, motion)
    assert not judgement.verified
    assert "misses the goal" in judgement.problems[0]


def test_rounding_keeps_its_limits() -> None:
    shares = np.random.default_rng(1).dirichlet(np.ones(4), 12)
    found = rounded(shares, [[2, 3]], max_switches=2, dwell_stages=3, time_limit_s=10.0)
    assert found.choice is not None
    runs = np.flatnonzero(np.diff([-1, *found.choice, -1]))
    assert len(runs) - 1 <= 3
    assert np.diff(runs)[:-1].min() >= 3
    assert {2, 3} & set(found.choice)
    chosen = np.eye(4)[list(found.choice)]
    assert np.abs(np.cumsum(shares - chosen, axis=0)).max() == pytest.approx(found.error, abs=1e-2)


def test_rounding_reproduces_integral_shares() -> None:
    wanted = (0, 0, 0, 2, 2, 3, 3, 3)
    found = rounded(np.eye(4)[list(wanted)], [], max_switches=3, dwell_stages=2, time_limit_s=10.0)
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
