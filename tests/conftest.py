"""What several test files need: plans of all planners, and runs of the program."""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import pytest
from forks import Forks, forking
from hypothesis import settings
from once import solved

from twosra_mpc import Plan, Result, cli

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

for _ending in ("SIGINT", "SIGHUP", "SIGQUIT"):  # what nohup or a shell's & ignores is inherited
    if (number := getattr(signal, _ending, None)) and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler if _ending == "SIGINT" else signal.SIG_DFL)

# Few, for two cores; before a release: --hypothesis-profile=thorough.
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=10)
settings.register_profile("thorough", deadline=None, max_examples=200)
settings.load_profile("repeatable")


def pytest_collection_finish() -> None:
    """Search rarely for garbage, as the program does, and never in what was imported by now."""
    gc.set_threshold(200_000, 20, 20)
    gc.collect()
    gc.freeze()


PLANNERS_AND_TIMINGS = [
    (planner, timing)
    for planner in ("optimal", "greedy")
    for timing in ("nominal", "constant", "paper")
]


@pytest.fixture(scope="session", params=PLANNERS_AND_TIMINGS, ids="-".join)
def any_result(request: pytest.FixtureRequest) -> Result:
    """What each planner comes to for paper-1 with each set of transition times."""
    planner, timing = request.param
    return solved("paper-1", planner=planner, timing=timing)


@pytest.fixture(scope="session")
def any_plan(any_result: Result) -> Plan:
    """The plan of paper-1 by each planner with each set of transition times."""
    return any_result.require()


@pytest.fixture(scope="session")
def forks() -> Iterator[Forks]:
    """The program, in a process of its own, which is a fork."""
    with forking() as made:
        yield made


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """A headless browser that logs its console and every request."""
    from chromium import chromium  # Selenium takes a while

    with chromium(tmp_path_factory.mktemp("chromium")) as started:
        yield started


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
