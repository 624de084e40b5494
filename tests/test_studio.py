"""The studio's answers and its server, without a browser."""

from __future__ import annotations

import http.client
import json
import math
import re
import threading
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlparse

import jsonschema
import numpy as np
import pytest
from chromium import eventually
from conftest import Run as RunProgram
from once import solved

from twosra_mpc import InputError, Problem, load_plan, load_problem, plan, robot_shape
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.lab.studio import Server, widget
from twosra_mpc.lab.studio.answers import Ask, Pull, Saved, answers, asked_problem, document, saved
from twosra_mpc.lab.studio.goal_map import goal_map, moved
from twosra_mpc.lab.studio.live import LiveRun, Push, Run

HOSTILE = "<img src=x onerror=alert(1)>"
PAPER = load_problem("paper-1")


def never() -> bool:
    return False


def kinds(ask: Ask) -> dict[str, dict[str, Any]]:
    """The last record of each kind."""
    return {record["kind"]: record for record in answers(ask, never)}


@pytest.fixture(scope="module")
def server() -> Server:
    """A server that ends with the program."""
    made = Server(PAPER)
    made.serve_in_background()
    return made


def post(
    server: Server, path: str, message: object, most: int = 1000, **headers: str
) -> tuple[int, list[dict[str, Any]]]:
    """Status and records of an answer, at most so many; then the connection is closed."""
    address = urlparse(server.address)
    own = {"X-Token": parse_qs(address.query)["token"][0], "Content-Type": "application/json"}
    connection = http.client.HTTPConnection(address.hostname or "", address.port, timeout=60)
    text = message if isinstance(message, str) else json.dumps(message)
    connection.request("POST", path, text, own | headers)
    answer = connection.getresponse()
    records = [json.loads(line) for line, _ in zip(answer, range(most), strict=False)]
    connection.close()
    return answer.status, records


@pytest.mark.parametrize("name", ["paper-1", "rigid-move", "doorway", "grasp-cube"])
def test_an_answer_is_what_the_planner_finds(name: str) -> None:
    problem, found = load_problem(name), kinds(Ask(problem=document(load_problem(name))))
    made, result = solved(name).require(), found["result"]
    assert Problem(**found["scene"]["problem"]) == problem
    assert result["complete"]
    assert result["cost_s"] == pytest.approx(made.cost.total, rel=problem.gap)
    assert result["gap"] <= problem.gap
    assert ("bound" in found) == (name == "doorway")
    if "bound" in found:
        assert 0 < found["bound"]["lower_bound_s"] <= made.cost.total


def test_a_film_is_the_plans_and_the_greedy_rules_beside_it() -> None:
    found = kinds(Ask(problem=document(PAPER), film=True, greedy=True))
    film = found["film"]["data"]["film"]
    assert film["time_s"][-1] == pytest.approx(solved("paper-1").require().duration_s)
    greedy = plan(PAPER.with_values(planner="greedy")).require()
    assert found["film"]["greedy_s"] == greedy.duration_s
    assert len(film["ghost"]["pose"]) == len(film["pose"])
    assert 0 <= found["confirmed"]["gap"] < 0.1
    for part in ("plane", "readings", "timeline"):
        assert found["film"][part]


def test_messages_are_as_the_guide_says() -> None:
    text = (Path(__file__).parent.parent / "docs/guide/studio.md").read_text()
    blocks = re.findall(r'title="(\w+).schema.json"\n(.*?)```', text, flags=re.DOTALL)
    schema = {name: json.loads(block) for name, block in blocks}
    assert schema["ask"]["properties"].keys() == Ask.model_fields.keys()
    ask = Ask(problem=document(PAPER), pull=Pull(end="goal", segment=0, x_m=0.1, y_m=0.2))
    jsonschema.validate(ask.model_dump(mode="json"), schema["ask"])
    result = kinds(ask)["result"]
    jsonschema.validate(result, schema["result"])
    assert result.keys() == schema["result"]["properties"].keys()


def test_who_gives_up_is_not_answered() -> None:
    problem = document(load_problem("doorway"))
    got = [record["kind"] for record in answers(Ask(problem=problem), lambda: True)]
    assert got == ["scene"]


def test_a_long_search_makes_room_for_others_and_ends_as_without_them() -> None:
    problem = document(load_problem("doorway"))
    plan(load_problem("doorway"))  # a world that is known is not counted again
    waits = iter([True] * 3)
    hurried = list(answers(Ask(problem=problem), never, lambda: next(waits, False)))
    calm = list(answers(Ask(problem=problem), never))
    assert "waiting" in [record["kind"] for record in hurried]
    assert [record for record in hurried if record["kind"] != "waiting"] == calm
    assert calm[-1]["complete"]


@pytest.mark.parametrize("name", ["paper-1", "three-segments"])
@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_segment_follows_the_hand_as_near_as_it_can(name: str, end: str) -> None:
    problem, rng = load_problem(name), np.random.default_rng(1)
    given = getattr(problem, end).configuration
    for j in range(len(given) - 3):
        q = given.copy()
        q[3 + j] = rng.uniform(-50, 50)
        shape = robot_shape(problem.robot.geometry, q, 2)
        outer = (0, 1)[j >= (len(given) - 3) // 2]
        at = shape.centres[outer] if j in (0, len(given) - 4) else shape.segments[j, -outer]
        pull = Pull(end=end, segment=j, x_m=float(at[0]), y_m=float(at[1]))  # type: ignore[arg-type]
        bent = asked_problem(Ask(problem=document(problem), pull=pull))
        changed = getattr(bent, end).configuration
        assert abs(changed[3 + j] - q[3 + j]) < 0.4
        assert np.delete(changed, 3 + j) == pytest.approx(np.delete(q, 3 + j))
    beyond = Pull(end="goal", segment=9, x_m=0.0, y_m=0.0)
    with pytest.raises(InputError, match=r"pull\.segment"):
        asked_problem(Ask(problem=document(problem), pull=beyond))


def test_a_map_has_the_plans_of_its_points_and_each_point_once() -> None:
    cells = list(goal_map(PAPER, ("kappa1", "kappa2"), (2, 3)))
    assert len({cell[:2] for cell in cells}) == len(cells) == 9
    for cell in cells[::4]:
        there = moved(PAPER, ("kappa1", "kappa2"), cell[:2])
        if cell.status == "infeasible":
            with pytest.raises(InputError):
                plan(there)
        elif cell.status == "found":
            assert cell.duration_s == plan(there).require().duration_s
    with pytest.raises(InputError, match="two of x, y, phi, kappa1, kappa2"):
        list(goal_map(PAPER, ("x", "x")))
    with pytest.raises(InputError, match="a goal"):
        list(goal_map(load_problem("grasp-cube"), ("x", "y")))


def test_a_map_is_drawn_and_told(run: RunProgram) -> None:
    code, out, _ = run("map", "rigid-move", "--over", "x, phi", "--size", 2, "--plot", "map.png")
    assert code == 0
    assert Path("map.png").read_bytes().startswith(b"\x89PNG")
    assert "[0,0] 4" in out
    code, out, _ = run("map", "rigid-move", "--over", "x,y", "--size", 2, "--json")
    assert [cell["sequence"] for cell in json.loads(out)["cells"]] == ["[0,0]"] * 4
    assert run("map", "rigid-move", "--over", "x,z")[0] == 2


def test_a_run_is_what_the_executor_does_and_a_push_is_made_good() -> None:
    asked = Run(problem=document(load_problem("rigid-move")), disturbance="mild")
    live, pushed = LiveRun(asked), 0.0
    for number, frame in enumerate(live.frames()):
        if number == 20:
            before = frame["true"]["origin"]
            live.pushes.append(Push(x_m=0.02, phi_rad=0.1))
        if number == 21:
            x0, x1 = (float(at.split(",")[0]) for at in (before, frame["true"]["origin"]))
            pushed = x1 - x0
    assert pushed > 15  # mm
    assert frame["ended"] == "reached"
    goal = load_problem("rigid-move").goal.configuration
    x, y = (float(at) / 1000 for at in frame["true"]["origin"].split(","))
    assert math.hypot(x - goal[0], -y - goal[1]) < 0.003


def test_a_live_run_is_the_run_that_is_simulated() -> None:
    """Clearance that the level needs included."""
    wall = {"name": "wall", "disc": {"x_m": 0.1, "y_m": 0.05, "radius_m": 0.02}}
    problem = Problem(**document(load_problem("rigid-move")) | {"obstacles": [wall]})
    frames = list(LiveRun(Run(problem=document(problem), seed=3)).frames())
    told = [tuple(event) for frame in frames for event in frame["events"]]
    assert told == list(simulate(problem, seed=3).run.events)
    assert any("clearance are needed" in text for _, _, text in told)
    assert frames[0]["plan"] is not None


def test_a_push_moves_the_plant() -> None:
    for plant in ("arc", "mujoco"):
        robot = SimulatedRobot(PAPER, plant)
        before = robot.q.copy()
        robot.push(np.array([0.01, -0.02, 0.3]))
        assert robot.q - before == pytest.approx([0.01, -0.02, 0.3, 0, 0], abs=0.01)


def test_what_is_saved_is_the_problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    problem = document(PAPER)
    scenario = saved(Saved(problem=problem, form="toml"))
    assert Problem(**tomllib.loads(scenario["text"])) == PAPER
    (tmp_path / "plan.json").write_text(saved(Saved(problem=problem, form="json"))["text"])
    made = load_plan("plan.json")
    assert made.problem == PAPER
    exec(saved(Saved(problem=problem, form="py"))["text"], {})
    assert load_plan("plan.json").to_dict() == made.to_dict() | {
        "stats": load_plan("plan.json").to_dict()["stats"]
    }
    assert saved(Saved(problem=problem, form="csv"))["text"].startswith("t_s,")
    assert saved(Saved(problem=problem, form="html"))["text"].startswith("<!DOCTYPE html>")


def test_the_server_answers_its_page_alone(server: Server) -> None:
    problem = {"problem": document(PAPER)}
    assert post(server, "/plan", problem)[1][-1]["found"]
    for wrong in (
        {"X-Token": "another"},
        {"Origin": "http://example.org"},
        {"Host": "example.org"},
        {"Host": "127.0.0.1:1"},
    ):
        status, records = post(server, "/plan", problem, **wrong)
        assert (status, records[0]["kind"]) == (403, "refused"), wrong
    assert post(server, "/plan", {"problem": "x" * 10_000_000})[0] == 413
    for wrong_message in (
        "no JSON",
        "[1]",
        "[" * 100_000,
        {"problems": 1},
        {"problem": {}, "film": "yes"},
    ):
        status, records = post(server, "/plan", wrong_message)
        assert (status in (200, 400), records[-1]["kind"]) == (True, "refused"), wrong_message
    outside = document(PAPER)
    outside["goal"]["kappa_per_m"] = [500.0, 0.0]
    refused = post(server, "/plan", {"problem": outside})[1][-1]
    assert refused["field"] == "goal.kappa_per_m.0"
    assert "78.5" in refused["message"]
    address = urlparse(server.address)
    connection = http.client.HTTPConnection(address.hostname or "", address.port)
    connection.request("GET", "/?token=wrong")
    assert connection.getresponse().status == 403
    connection.close()


def test_closed_connections_leave_nothing_running(server: Server) -> None:
    post(server, "/open", {"scenario": "paper-1"})
    threads = threading.active_count()
    for _ in range(5):
        post(server, "/plan", {"problem": document(load_problem("corridor"))}, most=1)
        status, records = post(server, "/run", {"problem": document(PAPER), "speed": 1e3}, most=5)
        assert status == 200
        assert [record["kind"] for record in records[:2]] == ["run", "frame"]
    assert post(server, "/plan", {"problem": document(PAPER)})[1][-1]["found"]
    assert eventually(lambda: threading.active_count() <= threads and not server._runs)


def test_a_search_knows_that_another_page_waits(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, told = list[Ask](), list[str]()

    def search(
        ask: Ask, _: Callable[[], bool], others_wait: Callable[[], bool]
    ) -> Iterator[dict[str, Any]]:
        yield {"kind": "result"}
        if ask.film:  # the long one
            begun.append(ask)
            yield {"kind": "waiting" if eventually(others_wait) else "alone"}

    monkeypatch.setattr("twosra_mpc.lab.studio.server.answers", search)

    def long() -> None:
        told.extend(record["kind"] for record in post(server, "/plan", asked | {"film": True})[1])

    asked = {"problem": document(PAPER)}
    thread = threading.Thread(target=long)
    thread.start()
    assert eventually(lambda: begun)
    assert post(server, "/plan", asked)[1] == [{"kind": "result"}]
    thread.join()
    assert told == ["result", "waiting"]


def test_all_kinds_of_messages_are_answered(server: Server) -> None:
    status, cells = post(server, "/map", {"problem": document(PAPER), "over": ["x", "y"]}, most=4)
    assert [record["kind"] for record in cells] == ["ranges", "cell", "cell", "cell"]
    assert post(server, "/open", {"scenario": "paper-2"})[1][0]["problem"]["robot"] == "2sra-v1"
    assert post(server, "/open", {"scenario": "/etc/passwd"})[0] == 400
    assert post(server, "/push", {"run": "none"})[0] == 400
    assert post(server, "/save", {"problem": document(PAPER), "form": "py"})[1][0]["text"]
    assert status == 200


def test_a_notebook_shows_it() -> None:
    frame = widget(PAPER, height=700)
    assert frame.src.startswith("http://127.0.0.1:")
    assert str(frame.height) == "700"


def test_a_port_that_is_taken_is_refused(server: Server) -> None:
    with pytest.raises(InputError, match="a free port"):
        Server(PAPER, urlparse(server.address).port or 0)
