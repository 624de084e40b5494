"""The studio in Chromium: a problem is dragged, its plan follows, and nothing else happens."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import eventually, one, opened, requested
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.select import Select

from twosra_mpc import load_problem
from twosra_mpc.lab.studio import Server

HOSTILE = "<img src=x onerror=\"document.title='run'\">"


@pytest.fixture(scope="module")
def server() -> Server:
    """A server that ends with the program."""
    made = Server(load_problem("paper-1"), name="paper-1")
    made.serve_in_background()
    return made


@pytest.fixture
def page(browser: Chrome, server: Server) -> Iterator[Chrome]:
    """The page of a problem that is planned and played, in a tab that keeps nothing yet."""
    browser.switch_to.new_window("tab")
    opened(browser, server.address, 1200)
    assert eventually(lambda: said(browser, "status") == "optimal" and played(browser))
    yield browser
    told = browser.get_log("browser")
    browser.close()
    browser.switch_to.window(browser.window_handles[0])
    assert told == []


def said(page: Chrome, name: str) -> str:
    return one(page, f"#{name}").text


def played(page: Chrome) -> bool:
    return bool(
        page.execute_script("return !!document.querySelector('#timeline:not(.stale) #slider')")
    )


def drag(page: Chrome, selector: str, *steps: tuple[int, int]) -> None:
    hand = ActionChains(page, duration=10).move_to_element(one(page, selector)).click_and_hold()
    for step in steps:
        hand.move_by_offset(*step)
    hand.release().perform()


def problem_of(page: Chrome) -> dict[str, dict[str, list[float]]]:
    found: dict[str, dict[str, list[float]]] = page.execute_script("return problem")
    return found


def test_a_goal_that_is_bent_by_hand_has_another_sequence(page: Chrome) -> None:
    before, kappa = said(page, "sequence"), problem_of(page)["goal"]["kappa_per_m"]
    assert before == "[0,0] > [1,0] > [1,1]"
    drag(page, ".handle.goal[data-name=segment0]", *[(2, 6)] * 12)
    assert eventually(lambda: said(page, "sequence") not in ("", before))
    assert eventually(lambda: played(page))
    now = problem_of(page)["goal"]["kappa_per_m"]
    assert now[1] == kappa[1]
    assert now[0] != kappa[0]
    one(page, "#undo").click()
    assert eventually(lambda: said(page, "sequence") == before)
    assert problem_of(page)["goal"]["kappa_per_m"] == kappa
    one(page, "#redo").click()
    assert problem_of(page)["goal"]["kappa_per_m"] == now


def test_the_keyboard_moves_start_and_goal(page: Chrome) -> None:
    x = problem_of(page)["goal"]["x_m"]
    handle = one(page, ".handle.goal[data-name=place]")
    handle.send_keys(Keys.ARROW_RIGHT)
    handle.send_keys(Keys.SHIFT, Keys.ARROW_RIGHT)
    assert problem_of(page)["goal"]["x_m"] == pytest.approx(x + 0.03)  # type: ignore[operator]
    assert eventually(lambda: played(page))


def test_a_wrong_number_is_named_and_a_reload_keeps_the_problem(page: Chrome) -> None:
    field = one(page, "input[data-field='goal.kappa_per_m.0']")
    field.clear()
    field.send_keys("500", Keys.TAB)
    assert eventually(lambda: "78.5" in said(page, "message"))
    assert one(page, "input[aria-invalid]").get_attribute("data-field") == "goal.kappa_per_m.0"
    field = one(page, "input[data-field='goal.kappa_per_m.0']")
    field.clear()
    field.send_keys("-20", Keys.TAB)
    assert eventually(lambda: said(page, "status") == "optimal" and played(page))
    page.refresh()
    assert eventually(lambda: said(page, "status") == "optimal" and played(page))
    assert problem_of(page)["goal"]["kappa_per_m"] == [-20, -5]


def test_many_drags_leave_memory_and_latency_as_they_were(page: Chrome) -> None:
    heap = "return (gc => performance.memory.usedJSHeapSize)()"
    page.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    before = page.execute_script(heap)
    for way in (1, -1) * 10:
        drag(page, ".handle.goal[data-name=place]", *[(way * 2, 0)] * 10)
    assert eventually(lambda: played(page))
    page.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    assert page.execute_script(heap) < before + 5e6
    assert page.execute_script("return latencies.length") > 10
    assert page.execute_script("return document.querySelectorAll('*').length") < 1000


def test_two_tabs_do_not_disturb_each_other(page: Chrome, server: Server) -> None:
    first = page.current_window_handle
    page.switch_to.new_window("tab")
    page.get(server.address)
    assert eventually(lambda: said(page, "status") == "optimal")
    Select(one(page, "#scenario")).select_by_value("rigid-move")
    assert eventually(lambda: said(page, "sequence") == "[0,0]")
    page.close()
    page.switch_to.window(first)
    assert said(page, "sequence") == "[0,0] > [1,0] > [1,1]"
    drag(page, ".handle.goal[data-name=place]", (5, 0))
    assert eventually(lambda: played(page))


def test_a_run_is_started_pushed_and_stopped(page: Chrome, server: Server) -> None:
    page.execute_script("document.getElementById('pace-of-run').value = 0.3")
    one(page, "#run").click()
    assert eventually(lambda: "phase 1" in said(page, "run-clock"))
    drag(page, "#live .true polygon", (20, 0), (20, 0))
    assert eventually(lambda: one(page, "#events").text)
    assert said(page, "run") == "Stop"
    one(page, "#run").click()
    assert eventually(lambda: "stopped" in said(page, "run-clock") and not server._runs)


def test_the_greedy_rule_the_map_and_the_world(page: Chrome) -> None:
    Select(one(page, "#planner")).select_by_value("both")
    assert eventually(lambda: re.match(r"\d+ min", said(page, "greedy")))
    assert page.execute_script("return document.querySelectorAll('#slower polygon').length") > 4
    one(page, "#map-make").click()
    assert eventually(lambda: page.execute_script("return byId('map').children.length") >= 25)
    before = problem_of(page)["goal"]["kappa_per_m"][1]
    one(page, "#map").click()
    across, up = problem_of(page)["goal"]["kappa_per_m"]
    assert across == pytest.approx(0, abs=1)  # the middle of the map
    assert up != before
    one(page, "#add-disc").click()
    assert eventually(
        lambda: page.execute_script("return document.querySelector('#plane .obstacle')")
    )
    place = "return JSON.stringify(problem.obstacles[0].disc)"
    y_m = json.loads(page.execute_script(place))["y_m"]
    drag(page, "#plane .obstacle", (0, -40))
    assert json.loads(page.execute_script(place))["y_m"] > y_m


def test_names_are_shown_and_not_run_and_no_request_leaves(page: Chrome, server: Server) -> None:
    script = (
        "problem.obstacles = [{name: arguments[0], disc: {x_m: 0.5, y_m: 0.5, radius_m: 0.01}}];"
    )
    page.execute_script(script + "problem.description = arguments[0]; show(problem)", HOSTILE)
    assert eventually(lambda: HOSTILE in said(page, "world"))
    assert eventually(lambda: played(page))
    assert page.title == "paper-1: studio of twosra_mpc"
    addresses = requested(page)
    assert addresses
    allowed = server.address.split("?")[0]
    assert [each for each in addresses if not each.startswith((allowed, "data:", "blob:"))] == []


@pytest.mark.parametrize(("width", "scheme"), [(400, "light"), (800, "dark"), (1060, "light")])
def test_nothing_sticks_out(page: Chrome, server: Server, width: int, scheme: str) -> None:
    opened(page, server.address, width, prefers_color_scheme=scheme)
    assert eventually(lambda: played(page))
    inner = page.execute_script("return document.documentElement.clientWidth")
    assert page.execute_script("return document.documentElement.scrollWidth") <= inner
    ground = one(page, "body").value_of_css_property("background-color")
    assert ("255, 255, 255" in ground) == (scheme == "light")


def test_a_server_that_ends_is_noticed(browser: Chrome, tmp_path: Path) -> None:
    arguments = [sys.executable, "-m", "twosra_mpc", "studio", "rigid-move", "--no-browser"]
    process = subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    )
    try:
        assert process.stdout is not None
        opened(browser, process.stdout.readline().strip())
        assert eventually(lambda: said(browser, "status") == "optimal")
        assert not one(browser, "#lost").is_displayed()
    finally:
        process.terminate()
        _, said_last = process.communicate(timeout=20)
    assert (process.returncode, said_last) == (0, "")
    assert eventually(lambda: one(browser, "#lost").is_displayed())
