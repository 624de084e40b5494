"""A report is the plan: its data, its proof, its motion, and nothing that leaks."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shlex
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from matplotlib.figure import Figure
from once import solved

from twosra_mpc import (
    Goal,
    InputError,
    Plan,
    Problem,
    Result,
    Start,
    Status,
    load_plan,
    load_problem,
)
from twosra_mpc.lab.report import page as page_module
from twosra_mpc.lab.report import player
from twosra_mpc.lab.report.page import (
    Origin,
    bound_sentences,
    report_page,
    scenario_toml,
    write_report,
)
from twosra_mpc.lab.report.player import Thermometer, lanes, ticks
from twosra_mpc.plans.branches import Branch, Policy
from twosra_mpc.plans.plan import percent
from twosra_mpc.plans.trajectory import stiffness_intervals
from twosra_mpc.plotting import TimeStretch, robot_shape
from twosra_mpc.plotting.playback import PLACES
from twosra_mpc.robot.description import with_path_model

HOSTILE = (
    "</script><script>alert(1)</script><img src=https://example.org/x onerror=alert(2)>'\"&{{7}}"
)


class Page(HTMLParser):
    """What a page is made of: text by id, text of a kind of element, and every attribute."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.by_id: dict[str, str] = {}
        self.texts: dict[str, list[str]] = {}
        self.attributes: list[tuple[str, str, str]] = []
        self._within: list[tuple[str, str | None]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self._within = [(tag, dict(attrs).get("id"))]
        self.texts.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        self._within = []

    def handle_data(self, data: str) -> None:
        for tag, name in self._within:
            self.texts[tag][-1] += data
            if name is not None:
                self.by_id[name] = self.by_id.get(name, "") + data


@pytest.fixture(scope="module")
def paper() -> Result:
    return solved("paper-1")


@pytest.fixture(scope="module")
def page(paper: Result) -> str:
    return report_page(paper)


@pytest.fixture(autouse=True)
def quick_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a test makes a page of its own, its figure is not the point, and takes seconds."""
    monkeypatch.setattr(page_module, "plot_plan", lambda plan, policy: Figure())


def result_in(html: str, folder: Path) -> Result:
    """The result a reader saves from the page, read back."""
    path = folder / "saved.json"
    path.write_text(Page(html).by_id["plan-data"], encoding="utf-8")
    return load_plan(path)


def hostile(result: Result) -> Result:
    robot = result.problem.robot.with_values(name=HOSTILE, description=HOSTILE)
    problem = result.problem.with_values(robot=robot, description=HOSTILE)
    made = result.require()
    renamed = replace(made, trajectory=replace(made.trajectory, problem=problem))
    missed = Policy("mean", 9.0, 8.0, (Branch(0.5, 1, HOSTILE, 2.0, ((1, 0),), 10.0),))
    return replace(result, problem=problem, words=HOSTILE, plan=renamed, policy=missed)


def without_plan(result: Result, status: Status) -> Result:
    return replace(result, status=status, words="no way", lower_bound=None, plan=None)


# --- the data ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"planner": "greedy", "timing": "paper", "gap": 0.5, "max_phases": 3},
        {"ambient_C": 20.0, "heating": "keep_warm", "transition_quantile": 0.9},
        {"goal": Goal(x_m=0.1, kappa_per_m=(None, 2.0), mode=(0, 1), phi_modulo=False)},
        {"weights": {"energy_s_per_J": 0.5}, "modes": [[0, 0], [1, 1]], "heaters_at_once": 1},
        {"robot": "2sr-v2", "start": Start(x_m=0, y_m=0, phi_rad=1, kappa_per_m=(1, -2))},
        {"description": 'two lines\nand "quotes", '},
    ],
    ids=str,
)
def test_the_scenario_can_be_planned_again(change: dict[str, Any], tmp_path: Path) -> None:
    given = dict(load_problem("paper-1"))
    problem = Problem(**{**given, **change})
    path = tmp_path / "scenario.toml"
    path.write_text(scenario_toml(problem), encoding="utf-8")
    assert load_problem(path) == problem


def test_the_page_carries_the_scenario(paper: Result, page: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(Page(page).by_id["scenario"], encoding="utf-8")
    assert load_problem(path) == paper.problem


def test_another_path_model_is_written_out(paper: Result, tmp_path: Path) -> None:
    problem = paper.problem.with_values(robot=with_path_model(paper.problem.robot, "cardioid"))
    path = tmp_path / "scenario.toml"
    path.write_text(scenario_toml(problem), encoding="utf-8")
    assert load_problem(path).robot == problem.robot != paper.problem.robot


# --- the film ------------------------------------------------------------------------------------


def film_in(html: str) -> dict[str, Any]:
    made: dict[str, Any] = json.loads(Page(html).by_id["motion-data"])["film"]
    return made


def coordinates(points: str) -> np.ndarray:
    """SVG points in mm, y down, as m, y up."""
    return np.array([[float(v) for v in pair.split(",")] for pair in points.split()]) * (
        1e-3,
        -1e-3,
    )


def test_every_frame_shows_the_robot_at_its_time(paper: Result, page: str) -> None:
    made, plan = film_in(page), paper.require()
    assert made["time_s"][0] == 0.0
    assert made["time_s"][-1] == pytest.approx(paper.plan.duration_s, abs=1e-6)
    assert np.all(np.diff(made["time_s"]) >= 0)
    spans = stiffness_intervals(plan.trajectory)
    for frame in range(0, PLACES, 13):
        t, pose = made["time_s"][frame], made["poses"][made["pose"][frame]]
        q = plan.trajectory.configuration(t)[0]
        shape = robot_shape(plan.robot.geometry, q, player.ARC_POINTS)
        for name in ("segments", "links", "units", "wheels"):
            drawn = np.array([coordinates(points) for points in pose[name]])
            assert np.abs(drawn - getattr(shape, name)).max() < 2e-5, (name, t)
        for segment in (0, 1):
            seen = made["state"][frame][segment]
            assert any(lo - 1e-5 <= t <= hi + 1e-5 for lo, hi, s in spans[segment] if s == seen)


def test_waits_store_one_pose_and_events_are_frames(paper: Result, page: str) -> None:
    made = film_in(page)
    assert len(made["poses"]) < 0.5 * PLACES
    shown = np.array(made["time_s"])[made["events"]]
    for t in player.event_times(paper.plan):
        assert np.abs(shown - t).min() < 1.0
    for phase in paper.plan.phases:
        mode = f"[{phase.mode[0]},{phase.mode[1]}]"
        inside = [d for t, d in zip(made["time_s"], made["doing"], strict=True) if d.endswith(mode)]
        assert len(inside) > 50  # phases of milliseconds can be seen


def test_the_timeline_fills_its_lanes(any_plan: Plan) -> None:
    samples = any_plan.samples
    stretch = TimeStretch.of(any_plan.phases, float(samples.t_s[-1]))
    made = {lane.name: lane.spans for lane in lanes(any_plan, stretch)}
    assert list(made) == ["motion", "segment 1", "heater 1", "segment 2", "heater 2"]
    assert len(made["motion"]) == len(any_plan.phases)
    for segment in (1, 2):
        spans = made[f"segment {segment}"]
        assert sum(span.width for span in spans) == pytest.approx(100, abs=0.05)
        on = [item for item in any_plan.transitions if item[:2] == (segment, "soft")]
        assert bool(made[f"heater {segment}"]) == bool(on)
    marks = ticks(stretch)
    assert [tick.place for tick in marks] == sorted(tick.place for tick in marks)
    assert 2 <= sum(tick.on_narrow for tick in marks) < len(marks)
    scale = Thermometer.of(any_plan)
    assert 0 < scale.level(samples.temperature_C.min()) < scale.level(scale.liquid_C) < 100
    assert scale.level(samples.temperature_C.max()) < 100


# --- the words -----------------------------------------------------------------------------------


def test_the_certificate_says_what_is_proved(paper: Result, page: str) -> None:
    said = " ".join(bound_sentences(paper))
    assert f"less than {paper.lower_bound:.4f} s" in said
    longer = f"also sequences longer than the {paper.problem.max_phases} phases"
    assert f"[0,0], [0,1], [1,0], [1,1], {longer}" in said
    assert "Cost is the duration, nothing else." in said
    assert "path model arc" in said
    made = paper.require()
    assert f"drives gently: {made.cost.total - made.lower_bound:.2f} s above it, " in said
    assert f"{made.cost.total - made.fastest_cost:.2f} s of them on purpose" in said
    assert f"{made.fastest_cost:.4f} s, proved within " in said
    assert "0.8 A until the set-point of 65 °C" in said
    assert "Obstacles and slipping wheels are not part of the model." in page
    weighed = paper.problem.with_values(heating="least_energy")
    said = " ".join(bound_sentences(replace(paper, problem=weighed)))
    assert "the duration in s + 10 s for every joule of heater energy" in said


def test_the_bound_names_the_restrictions_it_holds_for(paper: Result) -> None:
    def said(**changes: Any) -> str:
        problem = paper.problem.with_values(**changes)
        return " ".join(bound_sentences(replace(paper, problem=problem)))

    text = said(heating="keep_warm", transition_quantile=0.9, heaters_at_once=1)
    assert "kept warm" in text
    assert "90 % of all transitions" in text
    assert "one heater on at a time" in text
    assert "constant melt and freeze times of timing “constant”" in said(timing="constant")
    assert "fixed waits of timing “paper”" in said(timing="paper")
    assert "kept warm" not in said()


def test_the_bound_of_a_mission_names_its_touches_and_phases() -> None:
    said = " ".join(bound_sentences(solved("pick-and-place")))
    assert "the touches that were considered" in said
    assert "longer than the 5 phases a task that were searched" in said


def test_without_a_bound_nothing_is_claimed() -> None:
    greedy = solved("paper-1", planner="greedy")
    assert bound_sentences(greedy) == []
    text = report_page(greedy)
    assert "What is proved" not in text
    assert "none proved" in text
    assert "Nothing is proved about how much better" in text


@pytest.mark.parametrize(
    ("share", "text"), [(0.0, "0 %"), (7e-8, "< 0.001 %"), (0.00647, "0.65 %"), (0.5, "50 %")]
)
def test_a_gap_is_written_with_the_digits_that_count(share: float, text: str) -> None:
    assert percent(share) == text


def table(text: str, caption: str) -> list[list[str]]:
    """Cells of a table of a page."""
    whole = re.search(f"<caption>{caption}.*?</table>", text, re.DOTALL)
    assert whole
    rows = re.findall(r"<tr>(<td.*?)</tr>", whole[0], re.DOTALL)
    return [[unescape(cell) for cell in re.findall("<td[^>]*>(.*?)</td>", row)] for row in rows]


def test_the_verification_is_told_with_its_numbers(paper: Result, page: str) -> None:
    made = paper.require()
    check = made.verification
    rows = {name: (limit, margin) for name, limit, margin in table(page, "Limits")}
    assert len(rows) == len(check.limits)
    assert rows["wheel speed [rad/s]"][0] == "10"
    limit, margin = rows["wheel acceleration [rad/s2]"]
    assert limit == "5"
    assert 0 <= float(margin) < 0.02  # in the quickest phase
    assert rows["curvature [1/m]"][1] == "40.5"
    assert rows["unit gap [m]"][0] == "0"
    free = paper.problem.with_values(goal=Goal(x_m=0.2, tolerance={"x_m": 0.01}))  # type: ignore[arg-type]
    trajectory = replace(made.trajectory, problem=free)
    missed = replace(check, goal_error=(-0.5, 0.0, 0.0, 0.0, float("nan")))
    plan = replace(made, trajectory=trajectory, verification=missed)
    goal = table(report_page(replace(paper, problem=free, plan=plan)), "Goal")
    assert goal[0] == ["x", "0.2 ± 0.01", "5.0e-01", "m"]
    assert [row[1] for row in goal[1:]] == ["free"] * 4
    lost = replace(plan, verification=replace(check, goal_error=(float("nan"),) * 5))
    text = report_page(replace(paper, problem=free, plan=lost))
    assert table(text, "Goal")[0][2] == "not reached"


# --- every status --------------------------------------------------------------------------------


STATUS = {
    Status.OPTIMAL: "proved to be within the asked gap of 1 % of the best",
    Status.FEASIBLE: "The gap that is proved is more than 1e-07 %",
    Status.INFEASIBLE: "It is proved that this problem has no plan",
    Status.FAILED: "Undecided: no verified plan was found",
}


@pytest.mark.parametrize("status", list(Status))
def test_every_status_has_a_report(paper: Result, status: Status, tmp_path: Path) -> None:
    found = status in (Status.OPTIMAL, Status.FEASIBLE)
    if status is Status.FEASIBLE:  # nothing is believed that does not follow from the numbers
        paper = replace(paper, problem=paper.problem.with_values(gap=1e-9))
        assert paper.plan is not None
        trajectory = replace(paper.plan.trajectory, problem=paper.problem)
        paper = replace(paper, plan=replace(paper.plan, trajectory=trajectory))
    made = replace(paper, status=status) if found else without_plan(paper, status)
    text = report_page(made)
    assert f'class="status {status}"' in text
    assert STATUS[status] in text
    assert ("motion-data" in Page(text).by_id) == found
    assert ("<img" in text) == found
    assert result_in(text, tmp_path).to_dict() == made.to_dict()


def test_a_motion_that_does_not_verify_is_shown_with_a_warning(paper: Result) -> None:
    made = replace(paper.require(), lower_bound=None)
    check = replace(made.verification, ok=False, problems=("goal.x_m is missed by 1 m",))
    failed = replace(paper, status=Status.FAILED, plan=replace(made, verification=check))
    text = report_page(failed)
    assert "Verification failed: goal.x_m is missed by 1 m." in text
    assert "do not run it" in text
    assert "This plan costs" not in text


def test_a_robot_that_is_there_already_has_a_report() -> None:
    start = solved("paper-1").problem.start
    rest = solved("paper-1", goal=Goal(x_m=start.x_m, y_m=start.y_m))
    text = report_page(rest)
    assert "The robot stays where it is" in text
    assert 'id="slider"' not in text


# --- nothing leaks -------------------------------------------------------------------------------


def test_the_policy_allows_this_page_and_nothing_else(page: str) -> None:
    parsed = Page(page)
    policy = next(v for tag, name, v in parsed.attributes if name == "content" and "src" in v)
    assert policy.startswith("default-src 'none'; img-src data:; ")
    for kind, text in (("style", parsed.texts["style"][0]), ("script", parsed.texts["script"][-1])):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    for _, name, value in parsed.attributes:
        assert name not in ("style", "onclick", "onload", "onerror")
        if name in ("src", "href", "data", "action", "srcset"):
            assert value.startswith("data:image/svg+xml;base64,")


def test_names_are_text_and_never_markup(paper: Result, page: str, tmp_path: Path) -> None:
    text = report_page(hostile(paper), Origin(HOSTILE, "0" * 64, HOSTILE))
    made, plain = Page(text), Page(page)
    for tag in ("script", "img", "style", "a", "h1", "section", "svg"):
        assert len(made.texts.get(tag, [])) == len(plain.texts.get(tag, [])), tag
    assert made.texts["h1"] == [HOSTILE]
    assert f"{HOSTILE} (probability 0.5)" in "".join(made.texts["td"])
    assert made.by_id["commands"].count(shlex.quote(HOSTILE)) == 2
    assert result_in(text, tmp_path).problem.robot.name == HOSTILE


def test_the_page_is_small_and_made_twice_the_same(paper: Result, page: str) -> None:
    assert len(page.encode()) < 3e6
    again = film_in(report_page(paper))
    assert again == film_in(page)


# --- the command ---------------------------------------------------------------------------------


@pytest.fixture
def run(run_as_is: Run) -> Run:
    """Run the program; output as it is."""
    return run_as_is


def test_the_command_writes_the_report_of_a_plan_file(
    paper: Result, run: Run, tmp_path: Path
) -> None:
    paper.save("plan.json")
    code, out, err = run("report", "plan.json", "report.html")
    assert (code, err) == (0, "")
    assert "report.html" in out
    assert "optimal" in out
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert result_in(text, tmp_path).to_dict() == paper.to_dict()
    content = (tmp_path / "plan.json").read_bytes()
    assert hashlib.sha256(content).hexdigest() in text
    again = "twosra plan scenario.toml --out plan.json\ntwosra report plan.json report.html"
    assert Page(text).by_id["commands"] == again


def test_there_is_a_report_of_having_no_plan(paper: Result, run: Run, tmp_path: Path) -> None:
    without_plan(paper, Status.INFEASIBLE).save("none.json")
    code, out, _ = run("report", "none.json", "none.html", "--json")
    assert code == 0
    size = (tmp_path / "none.html").stat().st_size
    assert json.loads(out) == {"file": "none.html", "bytes": size, "status": "infeasible"}
    assert "no way" in (tmp_path / "none.html").read_text(encoding="utf-8")


def test_writing_from_python_checks_the_ending(paper: Result, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ending in \.html"):
        write_report(paper, tmp_path / "report.txt")
    with pytest.raises(InputError, match="folder that exists"):
        write_report(paper, tmp_path / "nowhere" / "report.html")
    assert list(tmp_path.iterdir()) == []
