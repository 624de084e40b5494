"""The benchmarks take up interrupted runs, keep success apart from correctness, and report both."""

from __future__ import annotations

import io
import itertools
import json
import re
import shutil
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from benchmarks import closed_loop
from benchmarks.__main__ import main, run_suite
from benchmarks.cold_start.processes import own_import_times
from benchmarks.cold_start.tables import breakdown
from benchmarks.comparison.tables import report_lines
from benchmarks.measurement import timed_in_turns
from benchmarks.plan_record import PlanRecord
from benchmarks.problem_set import load_set, set_names
from benchmarks.report_file import publish
from benchmarks.run_log import NAME, RunLog
from benchmarks.suite import Record, Run, Suite
from benchmarks.suite_file import FOLDER, load_suite, suite_names
from benchmarks.summary import ecdf, power_law, shifted_geometric_mean
from benchmarks.transition_sweep.tables import report_lines as sweep_lines
from benchmarks.transition_sweep.thermal_scale import thermally_faster
from twosra_mpc import InputError, Robot, load_robot
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import RIGID, SOFT_1

SWEEP = """
kind = "transition-sweep"
description = "One problem, as it is and ten times faster."
repeats = 1
time_limit_s = 5.0
reference_freeze_s = 253.4
freeze_s = [253.4, 25.34]
[[problems]]
set = "published"
first = 1
"""
GROWTH = """
kind = "growth"
description = "The smallest growth."
repeats = 1
max_phases = [2]
gaps = [0.01]
phases = [3]
intervals = 4
grid = [4, 5]
[[problems]]
set = "published"
first = 1
"""
Benchmark = Callable[..., Result]


@pytest.fixture
def benchmark() -> Benchmark:
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """The folder of a finished run of the tiny suite, and what was printed."""
    folder = tmp_path_factory.mktemp("tiny")
    return folder, CliRunner().invoke(main, ["tiny", "--out", str(folder)])


def test_sets_are_reproducible_and_valid() -> None:
    assert set(set_names()) >= {"published", "random-100", "tiny"}
    first, second = load_set("random-100"), load_set("random-100")
    assert first == second
    assert len(first.problems) == 100
    assert first.redrawn > 0
    assert max(abs(k) for _, p in first.problems for k in p.start.kappa_per_m) <= 60


@pytest.mark.parametrize("name", suite_names())
def test_every_suite_loads_and_its_runs_have_names_of_their_own(name: str) -> None:
    label, suite = load_suite(name)
    keys = [run.key for run in suite.runs()]
    assert label == name
    assert keys
    assert len(set(keys)) == len(keys)


def test_the_tiny_suite_runs_and_nothing_is_worse_than_greedy(tiny: tuple[Path, Result]) -> None:
    folder, done = tiny
    assert done.exit_code == 0, done.output
    assert (folder / "report.md").read_text() == done.stdout
    assert "| optimal | 100 % (3 of 3) | 100 % (3 of 3) | 3 |" in done.stdout
    largest = re.search(r"Cost over the greedy.* largest ([0-9.]+)\.\n", done.stdout)
    assert largest is not None
    assert float(largest.group(1)) <= 1.0


def test_the_report_says_what_it_was_made_with_and_what_it_cannot_say(
    tiny: tuple[Path, Result],
) -> None:
    folder, done = tiny
    for part in (
        *("| cpu |", "| python |", "| casadi |", "| source |", "| repeats | 1 |", "One thread."),
        *("success rate", "correct rate", "median / p90 / p99", "shifted geometric mean"),
        *("Cost over the greedy planner's", "Proved gap", "published loop", "## Limitations"),
    ):
        assert part in done.stdout
    figures = re.findall(r"!\[.*?\]\((.*?)\)", done.stdout)
    assert len(figures) == 2
    for name in figures:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


def test_a_finished_run_is_not_made_again(
    tiny: tuple[Path, Result], benchmark: Benchmark, tmp_path: Path
) -> None:
    folder, done = tiny
    again = shutil.copytree(folder, tmp_path / "again")
    before = (again / NAME).read_bytes()
    assert benchmark("tiny", "--out", again).exit_code == 0
    assert (again / NAME).read_bytes() == before
    assert _without_load((again / "report.md").read_text()) == _without_load(done.stdout)


def _without_load(report: str) -> str:
    return re.sub(r"Load average.*\n", "", report)


def test_other_settings_are_refused_by_name(
    tiny: tuple[Path, Result], benchmark: Benchmark, tmp_path: Path
) -> None:
    folder, _ = tiny
    again = shutil.copytree(folder, tmp_path / "again")
    suite = (FOLDER / "tiny.toml").read_text()
    (tmp_path / "other.toml").write_text(suite.replace("repeats = 1", "repeats = 2"))
    refused = benchmark(tmp_path / "other.toml", "--out", again)
    assert refused.exit_code == 2
    assert "suite.repeats = 2 is not acceptable; allowed: 1" in refused.stderr
    assert refused.stdout == ""


def test_a_name_that_is_no_suite_and_a_file_that_is_wrong_are_errors(
    benchmark: Benchmark, tmp_path: Path
) -> None:
    unknown = benchmark("tinny", "--out", tmp_path)
    assert unknown.exit_code == 2
    assert "transition-sweep" in unknown.stderr
    wrong = tmp_path / "wrong.toml"
    for text, field in (
        (SWEEP.replace("transition-sweep", "sweep"), "kind"),
        (SWEEP.replace("repeats = 1", "repeats = 0"), "repeats"),
        (SWEEP.replace("published", "publish"), "problems.set"),
    ):
        wrong.write_text(text)
        with pytest.raises(InputError) as caught:
            list(load_suite(str(wrong))[1].runs())
        assert caught.value.field == field


class Counting(Suite):
    """Runs that count themselves; run ``stop`` does what ``action`` says first."""

    made: list[int] = []  # noqa: RUF012  # shared by copies on purpose
    stop: int | None = None
    swallows: bool = False

    def runs(self) -> Iterator[Run]:
        """Five runs."""
        for number in range(5):
            yield Run(f"run {number}", lambda number=number: self._measure(number))

    def report(self, records: Sequence[Record], folder: Path) -> list[str]:
        """Nothing."""
        return []

    def _measure(self, number: int) -> Record:
        if number == self.stop:
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                if not self.swallows:
                    raise
        self.made.append(number)
        return {"number": number}


@pytest.mark.parametrize("swallows", [False, True])
def test_an_interrupted_suite_goes_on_where_it_stopped(tmp_path: Path, swallows: bool) -> None:
    quiet = Console(file=io.StringIO())
    stopped = Counting(description="", stop=2, swallows=swallows)
    assert not run_suite(stopped, RunLog(tmp_path, {}), quiet)
    assert list(RunLog(tmp_path, {}).records) == ["run 0", "run 1"]
    rest = Counting(description="")
    assert run_suite(rest, RunLog(tmp_path, {}), quiet)
    assert rest.made == [2, 3, 4]
    assert RunLog(tmp_path, {}).records == {f"run {n}": {"number": n} for n in range(5)}


def test_half_a_line_is_dropped_wherever_it_ends(tmp_path: Path) -> None:
    log = RunLog(tmp_path, {"a": 1})
    log.append("first", {"x": 1.5})
    complete = log.path.read_bytes()
    log.append("second", {"x": 2.5})
    whole = log.path.read_bytes()
    for length in range(len(whole)):
        log.path.write_bytes(whole[:length])
        expected = {"first": {"x": 1.5}} if length >= len(complete) else {}
        again = RunLog(tmp_path, {"a": 1})
        assert again.records == expected
        again.append("third", {"x": 3.5})
        assert RunLog(tmp_path, {"a": 1}).records == {**expected, "third": {"x": 3.5}}


def test_a_damaged_line_and_other_settings_are_named(tmp_path: Path) -> None:
    log = RunLog(tmp_path, {"suite": {"repeats": 1, "gap": 0.01}, "source": "abc"})
    for settings, field in (
        ({"suite": {"repeats": 1, "gap": 0.02}, "source": "abc"}, "suite.gap"),
        ({"suite": {"repeats": 1, "gap": 0.01}, "source": "abd"}, "source"),
        ({"suite": {"repeats": 1, "gap": 0.01, "limit": 1}, "source": "abc"}, "suite.limit"),
        ({"suite": {"repeats": 1}, "source": "abc"}, "suite.gap"),
    ):
        with pytest.raises(InputError) as caught:
            RunLog(tmp_path, settings)
        assert caught.value.field == field
    for damage in ('{"key": "x"\n', '{"key": "x"}\n', "3\n"):
        log.path.write_text(json.dumps({"settings": {}}) + "\n" + damage)
        with pytest.raises(InputError, match="line 2"):
            RunLog(tmp_path, {})


def test_success_and_correct_rates_differ_when_a_plan_does_not_verify(
    tiny: tuple[Path, Result],
) -> None:
    folder, _ = tiny
    lines = [json.loads(line) for line in (folder / NAME).read_text().splitlines()[1:]]
    problems = [
        {name: PlanRecord.from_record(one) for name, one in line["record"].items()}
        for line in lines
    ]
    assert all(one["optimal"].correct for one in problems)
    for change in ({"verified": False}, {"goal_error": 1e-3}, {"goal_error": None}):
        wrong = replace(problems[0]["optimal"], **change)
        assert wrong.success
        assert not wrong.correct
        assert wrong.gap is None
        text = "\n".join(report_lines([{**problems[0], "optimal": wrong}, *problems[1:]], 60, 0.01))
        assert "| optimal | 100 % (3 of 3) | 66.7 % (2 of 3) |" in text
        assert f"Not correct: {wrong.problem}, optimal" in text


def test_the_sweep_draws_its_figures_and_tells_whether_the_sequence_changes(
    benchmark: Benchmark, tmp_path: Path
) -> None:
    (tmp_path / "sweep.toml").write_text(SWEEP)
    done = benchmark(tmp_path / "sweep.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {
        *("sequences.png", "total-time.png", "gap-and-wall-time.png")
    }
    assert "\n| 253.4 | 1 | 100 % (1 of 1) | 100 % (1 of 1) | 1 |" in done.stdout
    log = (tmp_path / "out" / NAME).read_text().splitlines()
    slow, fast = (json.loads(line)["record"] for line in log[1:])
    plans = {one["freeze_s"]: PlanRecord.from_record(one["plan"]) for one in (slow, fast)}
    same = plans | {25.34: replace(plans[25.34], sequence=plans[253.4].sequence)}
    other = plans | {25.34: replace(plans[25.34], sequence=(RIGID, SOFT_1))}
    assert "in 0 of 1 problems" in "\n".join(sweep_lines({"p": same}, 253.4, 5.0))
    assert "in 1 of 1 problems" in "\n".join(sweep_lines({"p": other}, 253.4, 5.0))


def test_growth_reports_slopes(benchmark: Benchmark, tmp_path: Path) -> None:
    (tmp_path / "growth.toml").write_text(GROWTH)
    done = benchmark(tmp_path / "growth.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert re.search(r"CPU time grows as intervals per phase\^", done.stdout)
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"phases.png", "grid.png"}


def test_a_thermally_faster_robot_melts_and_freezes_as_much_faster() -> None:
    robot = load_robot("2sra-v1")
    melt, freeze = _transition_times(robot)
    for factor in (0.8, 10.0, 500.0):
        fast_melt, fast_freeze = _transition_times(thermally_faster(robot, factor))
        assert factor * fast_melt == pytest.approx(melt, rel=1e-9)
        assert factor * fast_freeze == pytest.approx(freeze, rel=1e-9)


def _transition_times(robot: Robot) -> tuple[float, float]:
    heater, model = robot.heater, segment_model(robot, robot.heater.ambient_C, 0)
    cold, hot = model.initial(heater.ambient_C), model.initial(heater.soft_setpoint_C)
    melt = model.time_until(cold, heater.melt_current_A, model.liquid_level)
    return melt, model.time_until(hot, 0.0, model.solid_level)


def test_functions_are_called_in_turns_until_the_budget_is_used() -> None:
    calls: list[str] = []
    functions = {name: lambda name=name: calls.append(name) for name in "ab"}
    timed_in_turns(functions, repeats=2, budget_s=60.0)
    assert calls == ["a", "b"] * 3
    made = timed_in_turns(functions, repeats=9, budget_s=1e-12)
    assert calls == ["a", "b"] * 4
    assert all(timing.wall_s == (timing.first_s,) for _, timing in made.values())
    naps = iter([0.0, 0.02, 0.02, 0.0])
    made = timed_in_turns({"nap": lambda: time.sleep(next(naps))}, repeats=9, budget_s=0.03)
    assert len(made["nap"][1].wall_s) == 2


def test_summaries() -> None:
    for shift, value in itertools.product((0.01, 10.0), (0.0, 3.0)):
        assert shifted_geometric_mean([value] * 4, shift) == pytest.approx(value)
    assert shifted_geometric_mean([1.0, 100.0], 1e-9) == pytest.approx(10.0)
    assert shifted_geometric_mean([1.0, 100.0], 1e9) == pytest.approx(50.5, rel=1e-3)
    assert power_law([1, 2, 4], [3, 12, 48]) == pytest.approx((3.0, 2.0))
    assert ecdf([2.0, 1.0], count=4) == ([1.0, 2.0], [0.25, 0.5])


def test_cold_start_parts_add_up_to_the_whole() -> None:
    text = (
        "import time: self [us] | cumulative | imported package\n"
        "import time:       400 |        400 |   numpy.core\n"
        "import time:       100 |        500 | numpy\n"
    )
    assert own_import_times(text) == pytest.approx({"numpy.core": 4e-4, "numpy": 1e-4})
    record: Record = {
        "wall_s": {"plan": 2.0, "casadi": 0.4, "nothing": 0.1},
        "imports_s": {"numpy": 0.3, "pydantic_core": 0.1, "pydantic": 0.1, "wheel": 0.05},
        "plan_s": {"first_s": 0.9, "again_s": 0.2, "exit_s": 0.15},
    }
    parts = breakdown([record])
    assert sum(parts.values()) == pytest.approx(2.0)
    assert parts["import pydantic"] == pytest.approx(0.2)
    assert parts["building functions"] == pytest.approx(0.7)
    assert parts["everything else"] == pytest.approx(0.3)


def test_a_report_is_printed_and_written_where_that_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    publish("# report\n", None)
    publish("# report\n", tmp_path / "report.md")
    assert capsys.readouterr().out == 2 * "# report\n"
    assert [path.read_text() for path in tmp_path.iterdir()] == ["# report\n"]


def test_a_report_that_cannot_be_written_is_refused_before_any_run(tmp_path: Path) -> None:
    missing = str(tmp_path / "missing" / "report.md")
    refused = CliRunner().invoke(closed_loop.main, ["--out", missing])
    assert refused.exit_code == 2
    assert "a folder that can be written" in " ".join(refused.output.split())
    assert not list(tmp_path.iterdir())
