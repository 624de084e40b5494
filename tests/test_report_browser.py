"""A report in Chromium: it moves as the plan says, obeys the keyboard, and asks no network."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chromium import eventually, one, opened, requested
from matplotlib.figure import Figure
from once import solved
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from twosra_mpc import Goal, Plan, Status, load_plan, load_problem
from twosra_mpc.lab.paper.paper_report import paper_page
from twosra_mpc.lab.paper.section import Claim, Picture, Reading, Section, Table, Verdict
from twosra_mpc.lab.report import page, player, write_report
from twosra_mpc.plotting import robot_shape
from twosra_mpc.plotting.playback import PLACES

HOSTILE = (
    "</script><script>document.title='run'</script><img src=x onerror=\"document.title='run'\">"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reports")


@pytest.fixture(scope="module")
def paper(folder: Path) -> Plan:
    """The plan of paper-1; its report is written as paper.html."""
    found = solved("paper-1")
    write_report(found, folder / "paper.html")
    return found.require()


@pytest.fixture
def report(browser: Chrome, paper: Plan, folder: Path) -> Chrome:
    """The browser, showing the report of ``paper``."""
    return opened(browser, folder / "paper.html")


def move_to(browser: Chrome, frame: int) -> None:
    """Move the slider as a hand does."""
    script = "const s = document.getElementById('slider'); s.value = arguments[0];"
    browser.execute_script(script + "s.dispatchEvent(new Event('input'))", frame)


def frame_of(browser: Chrome) -> int:
    return int(one(browser, "#slider").get_property("value"))


def drawn(browser: Chrome, kind: str) -> np.ndarray:
    """Points of what the page draws of the robot [m, y up]."""
    found = browser.find_elements(By.CSS_SELECTOR, f"#robot .{kind}")
    points = [element.get_attribute("points") or "" for element in found]
    pairs = [[pair.split(",") for pair in part.split()] for part in points]
    return np.array(pairs, dtype=float) * (1e-3, -1e-3)


def test_the_page_renders_without_a_complaint(report: Chrome, paper: Plan) -> None:
    assert report.title == "experiment 1 of the paper: plan report"
    assert report.get_log("browser") == []
    image = one(report, ".figures img")
    assert report.execute_script("return arguments[0].naturalWidth", image) > 500
    style = "return getComputedStyle(arguments[0]).position"
    assert (
        report.execute_script(style, one(report, "#cursor")) == "absolute"
    )  # the style is allowed


def test_no_request_leaves_the_page(report: Chrome) -> None:
    one(report, "#next").click()
    one(report, "#save").click()
    sent = requested(report)
    assert sent  # the page itself: the log is working
    assert {address.split(":")[0] for address in sent} <= {"file", "data", "blob"}


def test_the_plan_file_can_be_saved_from_the_page(report: Chrome, tmp_path: Path) -> None:
    allow = {"behavior": "allow", "downloadPath": str(tmp_path)}
    report.execute_cdp_cmd("Browser.setDownloadBehavior", allow)
    one(report, "#save").click()
    assert eventually((tmp_path / "plan.json").exists)
    assert load_plan(tmp_path / "plan.json").to_dict() == solved("paper-1").to_dict()


def test_commands_and_scenario_can_be_copied(report: Chrome, paper: Plan, tmp_path: Path) -> None:
    for name, ending in (("commands", "report.html"), ("scenario", "")):
        button = one(report, f"[data-copy={name}]")
        button.click()
        assert button.text == "Copied"
        text = report.execute_script("return getSelection().toString()")
        assert text.strip().endswith(ending)
    (tmp_path / "copied.toml").write_text(text, encoding="utf-8")
    assert load_problem(tmp_path / "copied.toml") == paper.problem


def test_the_slider_moves_the_robot_where_the_plan_has_it(report: Chrome, paper: Plan) -> None:
    data = one(report, "#motion-data").get_attribute("textContent") or ""
    times, seen = json.loads(data)["film"]["time_s"], []
    for frame in (0, 60, 300, 480, 500, 1000):
        move_to(report, frame)
        q = paper.trajectory.configuration(times[frame])[0]
        shape = robot_shape(paper.robot.geometry, q, player.ARC_POINTS)
        for kind, points in (
            ("unit", shape.units),
            ("wheel", shape.wheels),
            ("segment", shape.segments),
            ("link", shape.links),
        ):
            assert np.abs(drawn(report, kind) - points).max() < 2e-5, (kind, frame)
        seen.append(drawn(report, "unit"))
    assert min(np.abs(b - seen[0]).max() for b in seen[3:]) > 1e-3
    minutes, seconds = divmod(paper.trajectory.duration_s, 60.0)
    assert one(report, "#clock").text == f"{minutes:.0f} min {seconds:05.2f} s"


def test_stiffness_and_temperature_follow_the_slider(report: Chrome, paper: Plan) -> None:
    data = json.loads(one(report, "#motion-data").get_attribute("textContent") or "")["film"]
    for frame in (0, 220, 460, 700):
        move_to(report, frame)
        for number, row in enumerate(report.find_elements(By.CSS_SELECTOR, "#segments tbody tr")):
            state, warm, *_ = [cell.text for cell in row.find_elements(By.TAG_NAME, "td")]
            assert state == data["state"][frame][number]
            expected = paper.trajectory.at(data["time_s"][frame]).temperature_C[0, number]
            assert float(warm) == pytest.approx(expected, abs=0.06)
        shown = report.find_elements(By.CSS_SELECTOR, "#robot .segment")
        assert [s.get_attribute("data-state") for s in shown] == data["state"][frame]
        colours = [s.value_of_css_property("stroke") for s in shown]
        assert (colours[0] == colours[1]) == (
            data["state"][frame][0].endswith("ing") == data["state"][frame][1].endswith("ing")
            and (data["state"][frame][0] == data["state"][frame][1])
        )


def test_play_and_pause(report: Chrome) -> None:
    play = one(report, "#play")
    assert (play.text, frame_of(report)) == ("Play", 0)
    play.click()
    assert play.text == "Pause"
    assert eventually(lambda: frame_of(report) > 10)
    play.click()
    stopped = frame_of(report)
    assert play.text == "Play"
    time.sleep(0.15)
    assert frame_of(report) == stopped
    move_to(report, PLACES - 4)
    play.click()
    assert eventually(lambda: play.text == "Replay")
    assert frame_of(report) == PLACES - 1
    play.click()
    assert eventually(lambda: 0 < frame_of(report) < PLACES - 1)


def test_a_higher_speed_plays_faster(report: Chrome) -> None:
    pace = one(report, "#pace")
    move_to(report, 700)
    normal = float(pace.text.split()[0])
    one(report, "#speed option[value='4']").click()
    assert float(pace.text.split()[0]) == pytest.approx(4 * normal, rel=0.02)


def test_the_keyboard_is_enough(report: Chrome) -> None:
    slider = one(report, "#slider")
    slider.send_keys(Keys.ARROW_RIGHT)
    assert frame_of(report) == 1
    slider.send_keys(Keys.END)
    assert frame_of(report) == PLACES - 1
    assert "the end of the plan" in (slider.get_attribute("aria-valuetext") or "")
    slider.send_keys(Keys.HOME)
    slider.send_keys(Keys.SPACE)
    assert one(report, "#play").text == "Pause"
    slider.send_keys(Keys.SPACE)
    assert one(report, "#play").text == "Play"


def test_events_are_reached_by_button(report: Chrome, paper: Plan) -> None:
    seen = [one(report, "#clock").text]
    while frame_of(report) < PLACES - 1:
        one(report, "#next").click()
        seen.append(one(report, "#clock").text)
    data = json.loads(one(report, "#motion-data").get_attribute("textContent") or "")
    assert len(seen) == len(data["film"]["events"]) > len(paper.phases) + len(paper.transitions)
    one(report, "#previous").click()
    assert one(report, "#clock").text == seen[-2]


def test_a_click_on_the_timeline_goes_there(report: Chrome) -> None:
    track = one(report, "#tracks svg.curve-row")
    report.execute_script("arguments[0].scrollIntoView({block: 'center'})", track)
    ActionChains(report).move_to_element(track).click().perform()
    assert frame_of(report) == pytest.approx(PLACES / 2, abs=5)
    cursor = one(report, "#cursor").rect["x"] - track.rect["x"]
    assert cursor == pytest.approx(track.rect["width"] / 2, abs=5)


def test_reduced_motion_steps_from_event_to_event(
    browser: Chrome, paper: Plan, folder: Path
) -> None:
    opened(browser, folder / "paper.html", prefers_reduced_motion="reduce")
    assert "reduced motion" in one(browser, "#pace").text
    one(browser, "#speed option[value='4']").click()
    data = json.loads(one(browser, "#motion-data").get_attribute("textContent") or "")
    events = data["film"]["events"]
    one(browser, "#play").click()
    assert eventually(lambda: frame_of(browser) > 0)
    one(browser, "#play").click()
    assert frame_of(browser) in events


@pytest.mark.parametrize("width", [400, 1000, 1400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_sticks_out_and_colours_follow(
    browser: Chrome, paper: Plan, folder: Path, width: int, scheme: str
) -> None:
    opened(browser, folder / "paper.html", width, prefers_color_scheme=scheme)
    inner = browser.execute_script("return document.documentElement.clientWidth")
    assert browser.execute_script("return document.documentElement.scrollWidth") <= inner
    for selector in (".plane svg", ".readings", "#segments", "#tracks", ".controls"):
        box = one(browser, selector).rect
        assert 0 <= box["x"] <= box["x"] + box["width"] <= inner, selector
    ground = one(browser, "body").value_of_css_property("background-color")
    assert ("255, 255, 255" in ground) == (scheme == "light")


def names_by_role(browser: Chrome) -> dict[str, list[str]]:
    """What a screen reader is told of the page: the names of its nodes, by their role."""
    named: dict[str, list[str]] = {}
    for node in browser.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]:
        if not node["ignored"]:
            role = str(node["role"].get("value"))
            named.setdefault(role, []).append(str(node.get("name", {}).get("value", "")))
    return named


def test_every_control_has_a_name(report: Chrome) -> None:
    roles = {"button", "slider", "combobox", "image", "region"}
    # the browser makes this tree at its leisure, some time after the page is shown
    assert eventually(lambda: roles <= names_by_role(report).keys())
    named = names_by_role(report)
    for role in roles:
        assert all(named[role]), (role, named[role])


def test_hostile_names_stay_text(
    browser: Chrome, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = solved("paper-1")
    robot = result.problem.robot.with_values(name=HOSTILE)
    problem = result.problem.with_values(robot=robot, description=HOSTILE)
    monkeypatch.setattr(page, "plot_plan", lambda plan, policy: Figure())
    write_report(replace(result, problem=problem, words=HOSTILE), folder / "hostile.html")
    opened(browser, folder / "hostile.html")
    assert browser.title == f"{HOSTILE}: plan report"
    assert one(browser, "h1").get_attribute("textContent") == HOSTILE
    assert browser.get_log("browser") == []


def test_pages_without_motion_work_too(
    browser: Chrome, paper: Plan, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "plot_plan", lambda plan, policy: Figure())
    start = paper.problem.start
    rest = solved("paper-1", goal=Goal(x_m=start.x_m, y_m=start.y_m))
    none = replace(rest, status=Status.FAILED, plan=None)
    for name, made in (("rest.html", rest), ("none.html", none)):
        write_report(made, folder / name)
        opened(browser, folder / name)
        assert browser.get_log("browser") == [], name
        assert one(browser, "#save").is_displayed()
        assert browser.find_elements(By.ID, "slider") == []


@pytest.mark.parametrize("width", [400, 1100])
def test_the_report_on_the_paper_stays_within_the_page(
    browser: Chrome, folder: Path, width: int
) -> None:
    Figure(figsize=(8, 2)).savefig(folder / "blank.png")
    readings = tuple(Reading(HOSTILE, 1.0, ours, HOSTILE, 0.0, 1.0) for ours in (1.0, 5.0, None))
    section = Section(
        name="one",
        title=HOSTILE,
        words=(HOSTILE,),
        claims=(Claim(HOSTILE, HOSTILE, readings, HOSTILE),),
        tables=(Table(HOSTILE, ("a", "b"), ((HOSTILE, "1"),)),),
        pictures=(Picture("blank.png", HOSTILE),),
        missing=HOSTILE,
    )
    counts = dict.fromkeys(Verdict, 1)
    (folder / "study.html").write_text(paper_page([section], counts, folder), encoding="utf-8")
    opened(browser, folder / "study.html", width, prefers_color_scheme="dark")
    assert browser.title == "The paper, reproduced"
    assert browser.get_log("browser") == []
    inner = browser.execute_script("return document.documentElement.clientWidth")
    assert browser.execute_script("return document.documentElement.scrollWidth") <= inner
    image = one(browser, "img")
    assert browser.execute_script("return arguments[0].naturalWidth", image) > 100
    colours = {mark.value_of_css_property("color") for mark in marks(browser)}
    assert len(marks(browser)) == len(Verdict) + 2
    assert len(colours) == len(Verdict)
    assert "20, 25, 29" in one(browser, "body").value_of_css_property("background-color")


def marks(browser: Chrome) -> list[WebElement]:
    return browser.find_elements(By.CSS_SELECTOR, ".status")
