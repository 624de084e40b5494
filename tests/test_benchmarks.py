"""Benchmarks: one log that survives every kill, success apart from correctness, one report."""

from __future__ import annotations

import io
import itertools
import json
import re
import shutil
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, NamedTuple

import pytest
import shapely
from click.testing import CliRunner, Result
from once import planned
from pydantic import TypeAdapter
from rich.console import Console
from test_mission_runs import carry, driven

from benchmarks.__main__ import main
from benchmarks.measurement import PlanRecord, Timing, timed_in_turns
from benchmarks.problems import load_set, set_names
from benchmarks.report import (
    published_tables,
    quantiles,
    share,
    shifted_geometric_mean,
    words,
    worst,
    write_report,
)
from benchmarks.run import open_log, results_of, run_study, versions
from benchmarks.run_log import NAME, RunLog
from benchmarks.scenes import LEAST_CLEARANCE_M
from benchmarks.studies import FULL, STUDIES, closed_loop, closed_loop_missions
from benchmarks.studies.closed_loop_missions import PLACED, STOPPED, WRONG, came_to
from benchmarks.studies.cold_start import RoundRecord, breakdown, own_import_times
from benchmarks.studies.missions import Case as MissionCase
from benchmarks.studies.missions import longer, reshapings_at_the_nearest
from benchmarks.studies.mutants import QUICK, ROOT, TESTS
from benchmarks.studies.scenes import blocks
from benchmarks.studies.tracker_step import Case as TrackedPhase
from benchmarks.studies.tracker_step import TrackerSteps, tracker_setup
from benchmarks.studies.tracker_step.agreement import disagreements
from benchmarks.study import Measured, Study
from benchmarks.thermal_scale import thermally_faster
from twosra_mpc import InputError, Robot, load_problem, load_robot, robot_shape
from twosra_mpc.problem.ends import check_shapes
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import RIGID, SOFT_1

TINY = ('problems=["tiny:4"]', "repeats=1")
ONE = 'problems=["published:1"]'
GOALS = ("goals", "count=3")


def arguments(folder: Path, name: str, *settings: str) -> list[str]:
    return [name, "--out", str(folder), *(part for one in settings for part in ("--set", one))]


def benchmark(folder: Path, name: str, *settings: str) -> Result:
    """Run a study with some settings."""
    return CliRunner().invoke(main, arguments(folder, name, *settings))


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """The folder of a finished run of four problems, and what was printed."""
    folder = tmp_path_factory.mktemp("tiny")
    return folder, benchmark(folder, "published", *TINY)


# --- problems and studies ------------------------------------------------------------------------


def test_the_published_problems_are_those_of_the_papers_robot_and_of_the_default_one() -> None:
    named = load_set("published")
    assert list(named)[::5] == ["paper-1", "paper-1 by 2sra-v1"]
    for label, problem in named.items():
        robot = "2sra-v1" if label.endswith(" by 2sra-v1") else "2sra-v1-paper"
        assert problem == load_problem(label.split()[0], robot=robot)


def test_sets_are_reproducible_and_valid() -> None:
    assert set(set_names()) >= {"published", "random-100", "tiny"}
    first = load_set("random-100")
    load_set.cache_clear()
    assert first == load_set("random-100")
    assert len(first) == 100
    assert max(abs(k) for p in first.values() for k in p.start.kappa_per_m) <= 60
    for problem in first.values():
        check_shapes(problem)  # raises where the units would overlap


def test_scenes_are_reproducible_and_leave_start_and_goal_room() -> None:
    first = load_set("scenes-14", 8)
    load_set.cache_clear()
    assert list(load_set("scenes-14", 9).items())[:-1] == list(first.items())
    assert len(first) == 8
    for problem in first.values():
        solid = shapely.union_all([shapely.Polygon(each.corners_m) for each in problem.obstacles])
        for end in (problem.start, problem.goal):
            shape = robot_shape(problem.robot.geometry, end.configuration)
            parts = (*shape.units, *shape.wheels, *shape.segments)
            drawn = shapely.union_all([shapely.MultiPoint(part).convex_hull for part in parts[:6]])
            assert drawn.distance(solid) > LEAST_CLEARANCE_M
            assert min(problem.workspace.margin_m(part).min() for part in parts) > LEAST_CLEARANCE_M


def test_memory_that_grows_is_told_per_robot() -> None:
    study = STUDIES["soak"].with_values(count=2, robots=2, time_limit_s=0.01)
    made = [Measured(case, study.run(case)) for case in study.cases()]
    assert all(record["plans"] == 1 and record["files"] < 100 for _, record in made)
    for number, (_, record) in enumerate(made):
        record["MB"] = 100.0 + 7.0 * number
    rows = study.report([*made, made[-1]._replace(record={**made[-1].record, "MB": 114.0})])
    assert rows["slope"] == pytest.approx(7.0)
    assert [plans for _, plans, _ in rows["rows"]] == [1, 2, 3]


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_has_cases_of_their_own_names_and_a_larger_set(name: str) -> None:
    usual = STUDIES[name]
    assert type(usual).parse(usual.model_dump(mode="json"), name) == usual  # as its log has it
    cases = [json.dumps(case._asdict()) for case in usual.cases()]
    assert len(set(cases)) == len(cases) > 0
    full = type(usual).parse({**usual.model_dump(), **FULL.get(name, {})}, name)
    assert (name in FULL) == (full != usual)
    assert next(full.cases())


def test_modules_that_are_mistaken_have_tests_beside_them() -> None:
    for module, tests in TESTS.items():
        assert (ROOT / module).is_file()
        assert all((ROOT / "tests" / f"{name}.py").is_file() for name in tests)
    assert set(QUICK) <= set(TESTS)


def test_a_name_or_setting_that_is_wrong_is_refused_by_name(tmp_path: Path) -> None:
    unknown = benchmark(tmp_path, "tinny")
    assert unknown.exit_code == 2
    assert "transition-sweep" in unknown.stderr
    for setting, field in (
        ("repeats=0", "repeats = 0"),
        ('problems=["publish"]', "problems = 'publish'"),
        ('problems=["tiny:x"]', "problems = 'tiny:x'"),
        ("color=1", "color"),
        ("repeats", "not TOML"),
    ):
        wrong = benchmark(tmp_path, "published", setting)
        assert wrong.exit_code == 2
        assert field in wrong.stderr
    assert not list(tmp_path.iterdir())


# --- the log -------------------------------------------------------------------------------------


class Numbered(NamedTuple):
    number: int


class Counting(Study):
    """Cases that count themselves; case ``stop`` is interrupted, as planning may be."""

    record: ClassVar = TypeAdapter(dict[str, int])
    question: ClassVar = "How many?"

    made: list[int] = []  # noqa: RUF012  # shared by copies on purpose
    stop: int | None = None
    swallows: bool = False

    def cases(self) -> Iterator[Numbered]:
        yield from map(Numbered, range(5))

    def run(self, case: Numbered) -> dict[str, int]:
        if case.number == self.stop:
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                if not self.swallows:
                    raise
        self.made.append(case.number)
        return {"number": case.number}


@pytest.mark.parametrize("swallows", [False, True])
def test_an_interrupted_study_goes_on_where_it_stopped(tmp_path: Path, swallows: bool) -> None:
    quiet = Console(file=io.StringIO())
    stopped = Counting(stop=2, swallows=swallows)
    assert not run_study(stopped, RunLog(tmp_path, {}), quiet)
    rest = Counting()
    log = RunLog(tmp_path, {})
    assert [case.number for case in rest.cases() if case._asdict() in log] == [0, 1]
    assert run_study(rest, log, quiet)
    assert rest.made == [2, 3, 4]
    assert [made["number"] for _, made in results_of(rest, RunLog(tmp_path, {}))] == [0, 1, 2, 3, 4]


def test_a_case_that_two_processes_measured_counts_once(tmp_path: Path) -> None:
    both = RunLog(tmp_path, {}), RunLog(tmp_path, {})
    for log, took_s in zip(both, (2.0, 3.0), strict=True):
        log.append({"number": 0}, {"number": 0}, took_s)
    assert RunLog(tmp_path, {}).cpu_s == {'{"number": 0}': 3.0}


def test_half_a_line_is_dropped_with_a_word_wherever_it_ends(tmp_path: Path) -> None:
    study = Counting()
    log = RunLog(tmp_path, {"a": 1})
    log.append({"number": 0}, {"number": 0})
    complete = log.path.read_bytes()
    log.append({"number": 1}, {"number": 1})
    whole = log.path.read_bytes()
    for length in range(len(whole)):
        log.path.write_bytes(whole[:length])
        again, said = RunLog(tmp_path, {"a": 1}), io.StringIO()
        kept = {"number": 0} in again
        assert kept == (length >= len(complete))
        assert {"number": 1} not in again
        assert again.dropped == (not whole[:length].endswith(b"\n") and length > 0)
        if length % 20 == 0:
            assert run_study(study, again, Console(file=said, width=500))
            assert ("dropped half a record" in said.getvalue()) == again.dropped
            assert len(results_of(study, RunLog(tmp_path, {"a": 1}))) == 5


def test_a_run_that_is_killed_within_a_record_ends_with_the_same_table(tmp_path: Path) -> None:
    """A record is on the disk as soon as it is made; all that a kill leaves is half a line."""
    whole = benchmark(tmp_path / "whole", *GOALS)
    assert whole.exit_code == 0, whole.output
    assert "| refused |" in whole.stdout
    assert "- Goal" not in whole.stdout  # all are planned or refused as a grid of them says
    head, *records = (tmp_path / "whole" / NAME).read_bytes().splitlines(keepends=True)
    (tmp_path / "killed").mkdir()
    log, kept = tmp_path / "killed" / NAME, b"".join([head, *records[:-1]])
    log.write_bytes(kept + records[-1][: len(records[-1]) // 2])
    again = benchmark(tmp_path / "killed", *GOALS)
    assert again.exit_code == 0, again.output
    assert log.read_bytes().startswith(kept)
    assert _without_cpu(again.stdout) == _without_cpu(whole.stdout)


def _without_cpu(report: str) -> str:
    return re.sub(r"CPU time.*\n", "", report)


def test_what_differs_is_named_and_a_damaged_line_too(tmp_path: Path) -> None:
    log = RunLog(tmp_path, {"settings": {"repeats": 1, "gap": 0.01}, "versions": {"source": "abc"}})
    for about, field in (
        ({"settings": {"repeats": 1, "gap": 0.02}, "versions": {"source": "abc"}}, "settings.gap"),
        (
            {"settings": {"repeats": 1, "gap": 0.01}, "versions": {"source": "abd"}},
            "versions.source",
        ),
        ({"settings": {"repeats": 1}, "versions": {"source": "abc"}}, "settings.gap"),
        ({"settings": {"repeats": 1, "gap": 0.01}}, "versions"),
        (
            {"settings": {"repeats": 1, "gap": 0.01}, "versions": {"source": "abc"}, "limit": 1},
            "limit",
        ),
    ):
        with pytest.raises(InputError) as caught:
            RunLog(tmp_path, about)
        assert caught.value.field == field
    first = log.path.read_text().splitlines()[0]
    for damage in ('{"case": "x"\n', '{"case": "x"}\n', "3\n"):
        log.path.write_text(f"{first}\n{damage}")
        with pytest.raises(InputError, match="line 2"):
            RunLog(tmp_path, log.about)


def test_a_log_made_otherwise_is_refused_before_anything_is_measured(
    tiny: tuple[Path, Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _ = tiny
    again = shutil.copytree(folder, tmp_path / "again")
    before = (again / NAME).read_bytes()
    for study, settings, said in (
        ("published", [TINY[0], "repeats=2"], "settings.repeats = 2 is not acceptable; allowed: 1"),
        ("random-100", TINY, "study = 'random-100' is not acceptable; allowed: 'published'"),
    ):
        refused = benchmark(again, study, *settings)
        assert refused.exit_code == 2
        assert said in refused.stderr
        assert refused.stdout == ""
    monkeypatch.setattr("twosra_mpc.__version__", "99.0")
    refused = benchmark(again, "published", *TINY)
    assert refused.exit_code == 2
    assert "versions.twosra_mpc = '99.0' is not acceptable" in refused.stderr
    assert (again / NAME).read_bytes() == before


def test_a_folder_that_cannot_be_written_is_refused_before_any_run(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    refused = benchmark(tmp_path / "file" / "out", "published")
    assert refused.exit_code == 2
    assert "a folder to write to" in refused.stderr


# --- reports -------------------------------------------------------------------------------------


def test_nothing_is_worse_than_greedy(tiny: tuple[Path, Result]) -> None:
    folder, done = tiny
    assert done.exit_code == 0, done.output
    assert (folder / "report.md").read_text() == done.stdout
    assert "| optimal | 100 % (4 of 4) | 100 % (4 of 4) | 4 |" in done.stdout
    largest = re.search(r"Cost over the greedy.* / ([0-9.]+)\.\n", done.stdout)
    assert largest is not None
    assert float(largest.group(1)) <= 1.0


def test_the_report_says_what_it_was_made_with_and_what_it_cannot_say(
    tiny: tuple[Path, Result],
) -> None:
    folder, done = tiny
    for part in (
        *("| cpu |", "| python |", "| casadi |", "| source |", "| repeats | 1 |", "One thread."),
        *("success rate", "correct rate", "median / p90 / p99", "shifted geometric mean"),
        *("Cost over the greedy planner's", "gap [%]", "published loop", "## Limitations"),
    ):
        assert part in done.stdout
    figures = re.findall(r"!\[.*?\]\((.*?)\)", done.stdout)
    assert len(figures) == 2
    for name in figures:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


def test_a_finished_run_is_not_made_again(tiny: tuple[Path, Result], tmp_path: Path) -> None:
    folder, done = tiny
    again = shutil.copytree(folder, tmp_path / "again")
    before = (again / NAME).read_bytes()
    assert benchmark(again, "published", *TINY).stdout == done.stdout
    assert (again / NAME).read_bytes() == before


def test_success_and_correct_rates_differ_when_a_plan_does_not_verify(
    tiny: tuple[Path, Result], tmp_path: Path
) -> None:
    folder = shutil.copytree(tiny[0], tmp_path / "again")
    study = STUDIES["published"].with_values(problems=("tiny:4",), repeats=1)
    log = open_log("published", study, folder)
    (case, planners), *_ = results_of(study, log)
    assert all(one["optimal"].correct for _, one in results_of(study, log))
    for change in ({"verified": False}, {"goal_error": 1e-3}, {"goal_error": None}):
        wrong = replace(planners["optimal"], **change)
        assert wrong.success
        assert not wrong.correct
        assert wrong.gap is None
        log.append(case._asdict(), TypeAdapter(dict[str, PlanRecord]).dump_python(
            {**planners, "optimal": wrong}, mode="json"
        ))  # fmt: skip
        text = write_report(study, log, folder)
        assert "| optimal | 100 % (4 of 4) | 75 % (3 of 4) |" in text
        assert f"Not correct: {case.problem} (optimal): says it has a plan" in text


def test_the_sweep_draws_its_figures_and_tells_whether_the_sequence_changes(tmp_path: Path) -> None:
    settings = (ONE, "repeats=1", "time_limit_s=5.0", "freeze_s=[253.4, 25.34]")
    done = benchmark(tmp_path, "transition-sweep", *settings)
    assert done.exit_code == 0, done.output
    assert {path.name for path in tmp_path.glob("*.png")} == {"sequences.png", "proofs.png"}
    assert "\n| 253.4 | 1 | 100 % (1 of 1) | 100 % (1 of 1) | 1 |" in done.stdout
    assert "in 0 of 1 problems" in done.stdout
    usual = STUDIES["transition-sweep"]
    changed = {"problems": ("published:1",), "freeze_s": (253.4, 25.34)}
    study = type(usual)(**{**usual.model_dump(), **changed})
    read = study.record.validate_python
    slow, fast = (json.loads(x) for x in (tmp_path / NAME).read_text().splitlines()[1:])
    other = replace(read(fast["record"]), sequence=(RIGID, SOFT_1))
    cases = list(study.cases())
    results = list(map(Measured, cases, (read(slow["record"]), other)))
    assert study.report(results)["different"] == 1


def test_the_closed_loop_counts_what_reached_its_goal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(closed_loop, "labelled", lambda _: {"tiny/0": load_problem("rigid-move")})
    asked = ('problems=["tiny:1"]', "seeds=1", 'executors=["greedy"]', 'path_models=["arc"]')
    done = benchmark(tmp_path, "closed-loop", *asked)
    assert done.exit_code == 0, done.output
    assert "| greedy rule | exact arcs | moderate | 1 of 1 |" in done.stdout
    assert "Every run reached its goal." in done.stdout


def test_the_closed_loop_names_what_did_not_work(tmp_path: Path) -> None:
    usual = STUDIES["closed-loop-hard"]
    one = {"problems": ("published:1",), "seeds": 1, "executors": ("optimal",)}
    study = type(usual)(**{**usual.model_dump(), **one})
    log = open_log("closed-loop-hard", study, tmp_path)
    (case,) = study.cases()
    errors = {"position_m": 3e-3, "heading_rad": 0.0, "curvature_per_m": 0.0}
    counts = {"transitions": 3, "allowed": 2, "replans": 1, "corrections": 0}
    told = {"reached": False, "ending": "gave up", "reason": "3 mm too far", "off": True}
    times = {"time_s": 100.0, "planned_s": 80.0, "over_planned": 1.25}
    times |= {"energy_J": 5.0, "forced_s": 1.0}
    log.append(case._asdict(), {**told, **errors, **counts, **times})
    text = write_report(study, log, tmp_path)
    assert "| this package | exact arcs | hard | 0 of 1 | 100 / 100 / 100 | 1.25 / 1.25 |" in text
    assert "- optimal, arc, paper-1, seed 1: gave up: 3 mm too far" in text
    assert "transitions that no plan asked for: 1." in text
    assert "a goal which they had not reached: 0." in text
    (table,) = published_tables(study, log, tmp_path).values()
    assert table[1:] == [
        ("this package", "hard", "0 of 1", "100 / 100", "1.25 / 1.25", "3.00", "1", "1 gave up")
    ]
    assert "ended with a wheel or a heater on: 0." in text
    assert "while metal was changing: 1.0 s." in text


def test_no_bound_is_above_what_brute_force_finds(tmp_path: Path) -> None:
    settings = ('problems=["published:2"]', "times_faster=[1.0]", "starts=1", "phases=3")
    done = benchmark(tmp_path, "certificate", *settings)
    assert done.exit_code == 0, done.output
    row = next(line for line in done.stdout.splitlines() if line.startswith("| 1 | 2 |"))
    _, _, _, sequences, solved, violated, _, excess, _, _ = (c.strip() for c in row.split("|"))
    assert int(sequences) >= int(solved) >= 1  # paper-1 needs a phase more
    assert violated == "0"
    assert float(excess) <= 0.1


def test_scenes_are_planned_with_obstacles_and_without(tmp_path: Path) -> None:
    benchmark_run = benchmark(tmp_path, "scenes", 'problems=["scenes-6:1"]')
    assert benchmark_run.exit_code == 0, benchmark_run.output
    study = type(STUDIES["scenes"]).parse(
        {**STUDIES["scenes"].model_dump(), "problems": ("scenes-6:1",)}, "scenes"
    )
    ((_, made),) = results_of(study, open_log("scenes", study, tmp_path))
    among, free = made["among obstacles"], made["without obstacles"]
    assert among.correct
    assert free.lower_bound <= among.cost
    report = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "| scenes-6 | 100 % (1 of 1) |" in report
    assert blocks(((0, 0), (1, 0), (1, 1), (0, 0), (0, 1))) == 2


def test_passages_are_decided(tmp_path: Path) -> None:
    done = benchmark(tmp_path, "passages", "widths_m=[0.09, 0.05]")
    assert done.exit_code == 0, done.output
    assert "| 90.0 | certified |" in done.stdout
    assert "| 50.0 | blocked |" in done.stdout


AGREED = 1e-4  # of the range of each speed


def test_steps_of_the_tracker_are_timed_and_compared() -> None:
    study = TrackerSteps(runs=1, states=4)
    rigid = next(study.cases())
    made = study.run(rigid)
    assert made["mode"] == "[0,0]"
    assert made["unsolved"] == 0
    assert made["apart_percent"][-1] < 100 * AGREED
    assert 0 < made["taken_ms"][0] <= made["taken_ms"][1]


@pytest.mark.parametrize("case", list(TrackerSteps().cases()), ids=str)
def test_the_first_input_is_that_of_the_nonlinear_program(case: TrackedPhase) -> None:
    of = planned(case.scenario)
    setup = tracker_setup(of, case.phase)
    apart = disagreements(of, case.phase, setup, states=2)
    assert max(apart) < AGREED
    assert min(apart) > 0.0


# --- numbers -------------------------------------------------------------------------------------


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
    assert quantiles([1.0, None, 3.0], (0.0, 0.5, 1.0), ".0f", 10) == "10 / 20 / 30"
    assert quantiles([None], (0.5,), ".0f") == "-"
    assert share([True, False, True]) == "66.7 % (2 of 3)"
    assert words(["a|b", 1]) == "a/b, 1"


def test_the_worst_are_named_slowest_and_loosest_first() -> None:
    plans = {
        str(n): PlanRecord(
            *("optimal", "", True, False, Timing(1.0, (n / 10,), (n / 10,))),
            verified=True,
            cost=100.0,
            lower_bound=100.0 - 10 + n,
            goal_error=0.0,
        )
        for n in range(1, 8)
    }
    failed = PlanRecord("failed", "nothing found", False, True, Timing(1.0, (1.0,), (1.0,)))
    slow, loose, wrong = worst(plans, {"x": failed}).splitlines()
    assert slow.startswith("- Slowest: 7 (700 ms), 6 (600 ms)")
    assert loose.startswith("- Largest proved gaps: 1 (9 %), 2 (8 %)")
    assert wrong == "- Not correct: x (failed): nothing found"


def test_cold_start_parts_add_up_to_the_whole() -> None:
    text = (
        "import time: self [us] | cumulative | imported package\n"
        "import time:       400 |        400 |   numpy.core\n"
        "import time:       100 |        500 | numpy\n"
    )
    assert own_import_times(text) == pytest.approx({"numpy.core": 4e-4, "numpy": 1e-4})
    record = RoundRecord(
        wall_s={"twosra plan": 2.0, "import casadi": 0.4, "python -c pass": 0.1},
        cpu_s={},
        imports_s={"numpy": 0.3, "pydantic": 0.2, "other packages": 0.05},
        plan_s={"first": 0.9, "again": 0.2, "exit": 0.15},
    )
    parts = breakdown([record])
    assert sum(parts.values()) == pytest.approx(2.0)
    assert parts["import pydantic"] == pytest.approx(0.2)
    assert parts["building functions"] == pytest.approx(0.7)
    assert parts["everything else"] == pytest.approx(0.3)


# --- missions ------------------------------------------------------------------------------------


def test_missions_are_planned_beside_goal_by_goal(tmp_path: Path) -> None:
    asked = {"count": 1, "goals": (2,), "boxes_per_m": (20.0,), "box_goals": 2, "gap": 0.05}
    settings = (f"{key}={json.dumps(value)}" for key, value in asked.items())
    done = benchmark(tmp_path, "missions", *settings)
    assert done.exit_code == 0, done.output
    assert "| 2 | 100 % (1 of 1) | 0 |" in done.stdout
    assert "| 20 | 100 % (1 of 1) |" in done.stdout
    study = STUDIES["missions"].with_values(**asked)
    (_, whole), (_, box) = results_of(study, open_log("missions", study, tmp_path))
    assert not longer(whole, study.gap)
    assert longer({**whole, "cost": 1.1 * whole["warm"]}, study.gap)
    assert box["reshapings"] <= box["nearest"]


def test_missions_of_boxes_that_differ_in_width_have_the_same_goals() -> None:
    study = STUDIES["missions"]
    narrow, wide = (study.mission(MissionCase(4, box, 0)) for box in (5.0, 20.0))
    for one, other in zip(narrow.tasks, wide.tasks, strict=True):
        assert (one.goal.configuration == other.goal.configuration).all()
        assert (one.goal.half_width < other.goal.half_width).any()
    assert reshapings_at_the_nearest(wide) <= 4


@pytest.mark.parametrize(
    ("kappas", "count"), [((15.0, 12.0), 1), ((15.0, -20.0), 2), ((5.0, -5.0), 0)]
)
def test_the_nearest_point_reshapes_where_the_shape_is_in_no_box(
    kappas: tuple[float, float], count: int
) -> None:
    box = {"kappa_per_m": (10.0, 10.0)}
    first, last = ({"x_m": 0.1, "kappa_per_m": (k, 0.0), "tolerance": box} for k in kappas)
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    problem = load_problem("rigid-move", start=start, goal=last)
    problem = problem.with_values(tasks=[{"do": "reach", **first}])
    assert reshapings_at_the_nearest(problem) == count


def test_a_mission_with_objects_is_planned_beside_goal_by_goal(tmp_path: Path) -> None:
    done = benchmark(tmp_path, "pick-and-place", 'scenarios=["conform-cylinder"]', "repeats=1")
    assert done.exit_code == 0, done.output
    assert "| conform-cylinder | True |" in done.stdout


def test_what_a_mission_came_to_is_by_what_really_happened() -> None:
    good = {"ending": "reached", "reason": "all tasks are done", "touched": "", "squeezed": ""}
    made = {**good, "object_m": 0.004, "object_rad": None}
    assert came_to(made) == PLACED
    assert came_to({**made, "object_m": 0.006}) == WRONG
    assert came_to({**made, "touched": "touched wall at 3 s"}) == WRONG
    assert came_to({**made, "ending": "object lost", "object_m": 0.2}) == STOPPED
    assert came_to({**made, "ending": "object lost", "reason": ""}) == WRONG


def test_missions_in_closed_loop_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = driven(carry(to=(0.03, -0.01, 0.1))).require()
    monkeypatch.setattr(closed_loop_missions, "_planned", lambda *_: made)
    asked = ("seeds=1", 'scenario="conform-cylinder"', 'level="none"')
    done = benchmark(tmp_path, "closed-loop-missions", *asked)
    assert done.exit_code == 0, done.output
    assert "| conform-cylinder | none |" in done.stdout
    assert "of 1 |" in done.stdout


def test_records_name_every_package_that_takes_part() -> None:
    """What the program imports, by the names under which it is distributed."""
    found = versions()
    taking_part = ("casadi", "numpy", "osqp", "highspy", "mujoco", "scipy", "shapely")
    for name in taking_part:
        assert re.match(r"\d+\.\d+", found[name])
    assert not found.keys() & {"pytest", "ruff", "mypy", "mkdocs-material"}


def test_each_claim_of_the_paper_is_a_row(tmp_path: Path) -> None:
    study = STUDIES["paper"]
    log = open_log("paper", study, tmp_path)
    readings = [
        {"published": 1.0, "ours": None, "unit": "mm"},
        {"published": 2.0, "ours": 2.5, "unit": ""},
    ]
    claim = {"claim": "It is so", "where": "Fig. 1", "verdict": "holds", "readings": readings}
    tables = {"curvature": []}
    record = {"claims": [claim], "tables": tables, "verdicts": {"holds": 1}}
    log.append(next(study.cases())._asdict(), record)
    made = published_tables(study, log, tmp_path)
    assert made[""][1] == ("It is so (Fig. 1)", "1 mm / 2", "- / 2.5", "holds")
    assert "_curvature" not in made
