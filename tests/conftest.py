"""What several test files need: plans, computed once a session, and runs of the program."""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import pytest
from hypothesis import settings
from problems import exactly

from twosra_mpc import Plan, Result, cli, load_problem, plan

if TYPE_CHECKING:
    from twosra_mpc.execution.simulation.simulate import Simulation

for _ending in ("SIGINT", "SIGHUP", "SIGQUIT"):  # what nohup or a shell's & ignores is inherited
    if (number := getattr(signal, _ending, None)) and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler if _ending == "SIGINT" else signal.SIG_DFL)

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("repeatable")


def pytest_collection_finish() -> None:
    """Let no search for garbage look again at what was imported and collected."""
    gc.collect()
    gc.freeze()


Solved: TypeAlias = Callable[..., Result]
Planned: TypeAlias = Callable[..., Plan]
Simulated: TypeAlias = "Callable[..., Simulation]"

PLANNERS_AND_TIMINGS = [
    (planner, timing)
    for planner in ("optimal", "greedy")
    for timing in ("nominal", "constant", "paper")
]


@pytest.fixture(scope="session")
def solved() -> Solved:
    """Plan a built-in scenario with overrides (hashable values), exactly if asked, once each."""
    known: dict[object, Result] = {}

    def get(scenario: str = "paper-1", exact: bool = False, **overrides: Any) -> Result:
        key = (scenario, exact, *sorted(overrides.items()))
        if key not in known:
            problem = load_problem(scenario, **overrides)
            known[key] = plan(exactly(problem) if exact else problem)
        return known[key]

    return get


@pytest.fixture(scope="session")
def planned(solved: Solved) -> Planned:
    """The verified plan of a built-in scenario with overrides, once each."""
    return lambda *scenario, **overrides: solved(*scenario, **overrides).require()


@pytest.fixture(scope="session")
def simulated() -> Simulated:
    """A disturbed run of a built-in scenario on a robot, once each."""
    from twosra_mpc.execution.simulation.simulate import simulate  # OSQP takes a while

    @cache
    def run(scenario: str, seed: int, robot: str, level: str, executor: str) -> Simulation:
        problem = load_problem(scenario, robot=robot)
        return simulate(problem, disturbance=level, seed=seed, executor=executor)

    def get(
        scenario: str,
        seed: int,
        robot: str = "2sra-v1",
        level: str = "moderate",
        executor: str = "optimal",
    ) -> Simulation:
        return run(scenario, seed, robot, level, executor)

    return get


@pytest.fixture(scope="session", params=PLANNERS_AND_TIMINGS, ids="-".join)
def any_result(request: pytest.FixtureRequest, solved: Solved) -> Result:
    """What each planner comes to for paper-1 with each set of transition times."""
    planner, timing = request.param
    return solved("paper-1", planner=planner, timing=timing)


@pytest.fixture(scope="session")
def any_plan(any_result: Result) -> Plan:
    """The plan of paper-1 by each planner with each set of transition times."""
    return any_result.require()


class Outcome(NamedTuple):
    """What a run of the program left behind."""

    code: int
    out: str
    err: str


Run: TypeAlias = Callable[..., Outcome]


@pytest.fixture
def run_as_is(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[Run]:
    """Run the program in this process, in an empty folder, on a wide terminal."""
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)

    def run_once(*arguments: object) -> Outcome:
        with pytest.raises(SystemExit) as caught:
            cli.main([str(argument) for argument in arguments])
        assert isinstance(caught.value.code, int)
        return Outcome(caught.value.code, *capsys.readouterr())

    yield run_once
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def run(run_as_is: Run) -> Run:
    """Run the program as ``run_as_is`` does; output with its white space made single."""

    def run_once(*arguments: object) -> Outcome:
        code, out, err = run_as_is(*arguments)
        return Outcome(code, " ".join(out.split()), " ".join(err.split()))

    return run_once
