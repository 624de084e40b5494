"""``twosra simulate``, the figure and the film of a run."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from matplotlib import rcParams
from once import simulated
from PIL import Image

from twosra_mpc import load_problem
from twosra_mpc.execution.run import Ending
from twosra_mpc.execution.simulation.simulate import Simulation, simulate
from twosra_mpc.plotting import film
from twosra_mpc.plotting.run_figures import (
    joined_drives,
    plot_run,
    reported_states,
    run_playback,
    run_stretch,
    run_title,
)
from twosra_mpc.plotting.scene import Scene

ARC = "2sra-v1"


@pytest.fixture
def run(run: Run) -> Run:
    """Run ``twosra simulate``; see ``conftest``."""
    return partial(run, "simulate")


@pytest.fixture(scope="module")
def done() -> Simulation:
    """A disturbed run with melts, freezes and a correction."""
    return simulated("paper-2", 2)


# --- program -------------------------------------------------------------------------------------


def test_a_run_is_summed_up_written_and_drawn(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film, "FRAMES_PER_S", 1)
    files = ("--out", "a.json", "--plot", "a.png", "--animate", "a.gif")
    code, out, err = run("rigid-move", "--robot", ARC, "--seed", 1, *files)
    assert (code, err) == (0, "")
    assert "ending reached" in out
    assert "planned were 6.1 s" in out
    assert "0 J in 0 transitions" in out
    assert "planned again never" in out
    document = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert document["seed"] == 1
    assert document["reason"] in out
    for event in document["events"]:
        assert event["text"] in out
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG\r\n")
    with Image.open(tmp_path / "a.gif") as shown:
        assert shown.size == (800, 660)
        assert getattr(shown, "n_frames", 1) > 5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.gif", "a.json", "a.png"]


def test_many_runs_are_a_distribution(run: Run) -> None:
    code, out, err = run("rigid-move", "--robot", ARC, "--runs", 3)
    assert (code, err) == (0, "")
    assert "median 90 % largest" in out
    assert "reached 3 of 3" in out
    assert "duration [s]" in out


def test_a_run_that_does_not_reach_its_goal_says_why_and_has_its_code(run: Run) -> None:
    code, out, _ = run("paper-2", "--robot", ARC, "--broken-heater", 1, "--disturbance", "mild")
    assert code == 4
    assert "ending heater failed" in out
    assert "without heater 1: proved infeasible" in out


def test_a_robot_that_arrived_unseen_has_a_code_of_its_own(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unseen(*given: Any, **asked: Any) -> Simulation:
        done = simulate(*given, **asked)
        return replace(done, run=replace(done.run, ending=Ending.UNSEEN))

    monkeypatch.setattr("twosra_mpc.cli.simulate_command.simulate", unseen)
    code, out, _ = run("rigid-move", "--robot", ARC)
    assert code == 5
    assert "ending arrived unseen" in out


def test_the_greedy_rule_can_be_run(run: Run) -> None:
    code, out, _ = run("rigid-move", "--robot", ARC, "--executor", "greedy")
    assert code == 0
    assert "executor greedy, disturbance moderate" in out


def test_nothing_is_run_without_a_plan(run: Run, tmp_path: Path) -> None:
    task = load_problem("paper-2").scenario() | {"modes": [[0, 0], [0, 1]]}
    del task["start"]["temperature_C"]
    (tmp_path / "no.json").write_text(json.dumps(_without_none(task)), encoding="utf-8")
    code, out, err = run("no.json")
    assert (code, out) == (3, "")
    assert "there is nothing to run: proved infeasible" in err


def _without_none(document: dict[str, object]) -> dict[str, object]:
    return {
        key: _without_none(value) if isinstance(value, dict) else value
        for key, value in document.items()
        if value is not None
    }


# --- figure --------------------------------------------------------------------------------------


def test_the_figure_shows_what_was_planned_and_what_happened(tmp_path: Path) -> None:
    before, replanned = dict(rcParams), simulated("paper-1", 6)
    figure = plot_run(replanned.run, replanned.truth, tmp_path / "run.pdf")
    assert dict(rcParams) == before
    assert (tmp_path / "run.pdf").read_bytes().startswith(b"%PDF")
    titles = {ax.get_title() for ax in figure.axes}
    drives = joined_drives(replanned.run)
    assert sum(": [" in title for title in titles) == len(drives) >= 4
    labels = {line.get_label() for ax in figure.axes for line in ax.get_lines()}
    assert {"planned", "camera", "by the sensor", "κ₁", "wheel 4"} <= labels
    assert "planned again once" in run_title(replanned.run)
    assert (
        f"after {replanned.run.duration_s:.0f} s (planned: 341.5 s, 376.4 s as confirmed)"
        in run_title(replanned.run)
    )


def test_a_run_without_truth_or_plan_is_drawn_too(tmp_path: Path) -> None:
    found = simulate(load_problem("rigid-move", robot=ARC), executor="greedy", seed=1).run
    plot_run(found, path=tmp_path / "run.svg")
    assert "<svg" in (tmp_path / "run.svg").read_text(encoding="utf-8")
    assert "planned" not in run_title(found)


def test_what_a_goal_leaves_free_has_no_distance_from_it() -> None:
    free = load_problem("rigid-move", robot=ARC).with_values(goal={"x_m": 0.05, "y_m": 0.0})
    figure = plot_run(simulate(free, executor="greedy", seed=1).run)
    names = {line.get_label() for line in figure.axes[-1].get_lines()}
    assert "position" in names
    assert "heading" not in names


def test_reported_states_follow_each_other_to_the_end(done: Simulation) -> None:
    for segment, expected in (
        (0, ["rigid", "melting", "soft", "freezing", "rigid"]),
        (1, ["rigid"]),
    ):
        states = reported_states(done.run)[segment]
        assert [state for _, _, state in states] == expected
        assert states[0][0] == 0.0
        assert states[-1][1] == done.run.duration_s
        ends = [end for _, end, _ in states[:-1]]
        assert ends == [start for start, _, _ in states[1:]]


def test_the_time_axis_is_stretched_where_the_robot_was_driven(done: Simulation) -> None:
    stretch, drives = run_stretch(done.run), joined_drives(done.run)
    for drive in drives:
        low, high = stretch.forward(np.array([drive.start_s, drive.end_s]))
        assert high - low > 0.05
    times = np.linspace(0.0, done.run.duration_s, 200)
    assert stretch.inverse(stretch.forward(times)) == pytest.approx(times, abs=1e-6)


# --- film ----------------------------------------------------------------------------------------


def test_a_film_shows_the_clock_the_stiffness_and_the_end(done: Simulation) -> None:
    playback = run_playback(done.run, done.truth)
    scene = Scene(playback, ("a run", run_title(done.run)), 12.0)

    def words_at(time_s: float) -> str:
        scene.show(int(np.searchsorted(playback.time_s, time_s)))
        return " ".join(text.get_text() for ax in scene.figure.axes for text in ax.texts)

    soft = next(change.time_s for change in done.run.changes if change.to == "soft")
    assert "segment 1 is melting" in words_at(soft - 5.0)
    assert "bending in mode [1,0]" in words_at(soft + 0.2)
    freezing = words_at(soft + 150.0)
    assert "segment 1 is freezing" in freezing
    row = int(np.searchsorted(playback.time_s, soft + 150.0))
    pace = playback.stretch.seconds_per_length(soft + 150.0) / 12.0
    assert f"({pace:.0f} times as fast)" in freezing
    minutes, seconds = divmod(playback.time_s[row], 60.0)
    assert f"{minutes:.0f} min {seconds:04.1f} s" in freezing
    assert "The goal is reached" in words_at(done.run.duration_s)
