"""Animations show what the plan says, are pixel-true, small, and written whole or not at all."""

from __future__ import annotations

import base64
import io
import re
from functools import cache, partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from conftest import Run
from matplotlib import rc_context
from matplotlib.colors import same_color
from matplotlib.lines import Line2D
from once import planned, solved
from PIL import Image

from twosra_mpc import InputError, load_problem
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.plan import planned_words
from twosra_mpc.plotting import animate_plan, check_animation_path, film
from twosra_mpc.plotting.figures import (
    CHANGING_COLOUR,
    FREEZING_COLOUR,
    RIGID_COLOUR,
    SOFT_COLOUR,
    STYLE,
)
from twosra_mpc.plotting.film import LEAST, Film
from twosra_mpc.plotting.plan_figures import plan_title
from twosra_mpc.plotting.playback import PLACES, Playback, plan_playback
from twosra_mpc.plotting.scene import Scene
from twosra_mpc.timing import Transition

COLOURS = {"rigid": RIGID_COLOUR, "soft": SOFT_COLOUR, "freezing": FREEZING_COLOUR}
README_LIMIT = 3_000_000  # bytes that a page shows without making its reader wait


@cache
def playback(name: str) -> Playback:
    return plan_playback(planned(name), LEAST)


@cache
def scene(name: str) -> Scene:
    with rc_context(STYLE):
        told = plan_title(planned(name)).replace("\n", ", ")
        return Scene(playback(name), (name, told), duration_s=12.0)


def row_at(name: str, time_s: float) -> int:
    """The first row that is not before a time."""
    return int(np.searchsorted(playback(name).time_s, time_s - 1e-9))


def shown_at(name: str, time_s: float) -> str:
    """Everything that is written in the scene."""
    scene(name).show(row_at(name, time_s))
    return " ".join(text.get_text() for ax in scene(name).figure.axes for text in ax.texts)


def melt(name: str) -> Transition:
    return next(item for item in planned(name).transitions if item.to == "soft")


# --- what is shown


def test_the_words_tell_clock_pace_state_and_outcome() -> None:
    result, change = planned("paper-2"), melt("paper-2")
    melting = shown_at("paper-2", (change.onset_s + change.done_s) / 2)
    pace = playback("paper-2").stretch.seconds_per_length(change.done_s - 1.0) / 12.0
    assert f"segment {change.segment} is melting  ({pace:.0f} times as fast)" in melting
    soft = next(phase for phase in result.phases if any(phase.mode))
    assert "bending in mode [1,0]" in shown_at("paper-2", (soft.start_s + soft.end_s) / 2)
    freezing = shown_at("paper-2", soft.end_s + 100.0)
    row = row_at("paper-2", soft.end_s + 100.0)
    minutes, seconds = divmod(playback("paper-2").time_s[row], 60.0)
    assert f"{minutes:.0f} min {seconds:04.1f} s" in freezing
    assert "is freezing" in freezing
    assert "°C" in freezing
    assert "liquid" in freezing
    ended = shown_at("paper-2", result.duration_s)
    assert f"[0,0] → [1,0] in {planned_words(result)}: optimal" in ended


def test_two_segments_that_do_the_same_are_named_together() -> None:
    last = planned("paper-1").phases[-1].end_s
    assert "both segments are freezing" in shown_at("paper-1", last + 10.0)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.999, 1.0])
def test_the_robot_stands_where_the_plan_has_it_in_the_colours_of_its_state(share: float) -> None:
    result, here = planned("paper-1"), scene("paper-1")
    row = round(share * (PLACES - 1))
    here.show(row)
    q = result.trajectory.configuration(playback("paper-1").time_s[row])[0]
    arcs = robot_shape(result.robot.geometry, q).segments
    lines = [line for line in here.figure.axes[0].lines if line.get_linewidth() == 8]
    states = playback("paper-1").states(row)
    for line, arc, state in zip(lines, arcs, states, strict=False):
        np.testing.assert_allclose(line.get_xydata(), arc, rtol=0, atol=1e-9)
        assert same_color(line.get_color(), COLOURS.get(state, CHANGING_COLOUR))
    hatched = [line for line in lines[2:] if isinstance(line, Line2D)]
    assert len(hatched) == sum(state in ("melting", "freezing") for state in states)


def test_the_end_shows_the_stiffness_that_is_reached() -> None:
    assert playback("paper-1").states(PLACES - 2) == ["freezing"] * 2
    assert playback("paper-1").states(PLACES - 1) == ["rigid"] * 2


def test_a_heater_is_marked_exactly_while_it_is_on() -> None:
    shown = playback("paper-2")
    current = planned("paper-2").trajectory.at(shown.time_s).heater_current_A
    np.testing.assert_array_equal(shown.heated, current > 0)
    assert shown.heated.any()
    change = melt("paper-1")
    warming = row_at("paper-1", (planned("paper-1").phases[0].end_s + change.onset_s) / 2)
    assert playback("paper-1").doing(warming) == f"heater {change.segment} is on"


def test_waits_are_compressed_and_motion_is_slowed_down() -> None:
    result = planned("paper-1")
    stretch = playback("paper-1").stretch
    waiting = stretch.seconds_per_length(result.phases[-1].end_s + 1.0)
    for phase in result.phases:
        driving = stretch.seconds_per_length((phase.start_s + phase.end_s) / 2)
        assert driving < waiting / 10
    place = stretch.forward(np.array([200.0, 210.0]))
    assert 10.0 / np.diff(place)[0] == pytest.approx(stretch.seconds_per_length(205.0))


def test_a_plan_without_motion_stands_still() -> None:
    start = load_problem("rigid-move").start
    rest = planned("rigid-move", goal={"x_m": start.x_m, "y_m": start.y_m})
    with Image.open(io.BytesIO(animate_plan(rest, duration_s=1.0).data)) as gif:
        first = np.asarray(gif.convert("RGB"))
        gif.seek(getattr(gif, "n_frames", 1) - 1)
        assert np.array_equal(first, np.asarray(gif.convert("RGB")))


# --- files


def test_every_frame_of_a_gif_is_the_picture_of_its_moment() -> None:
    """Only changes are stored; put together they must be the whole picture again."""
    here = scene("paper-1")
    rows = [row_at("paper-1", time_s) for time_s in (0.0, 20.0, 62.9, 63.0, 99.5, 99.5, 300.0)]
    with rc_context(STYLE):
        data = film.gif(here, rows, lambda *_: None)
        pictures = [here.image(row) for row in rows]
    with Image.open(io.BytesIO(data)) as gif:
        frames, lasting = [], []
        for number in range(getattr(gif, "n_frames", 1)):
            gif.seek(number)
            frames.append(np.asarray(gif.convert("RGB"), dtype=float))
            lasting.append(gif.info["duration"])
    assert sum(lasting) == 80 * (len(rows) - 1) + 1000 * film.LAST_FRAME_S
    assert len(frames) == len(pictures)
    for frame, picture in zip(frames, pictures, strict=True):
        assert frame[0, 0].tolist() == [255.0, 255.0, 255.0]
        off = np.abs(frame - np.asarray(picture, dtype=float)).max(axis=2)
        assert np.mean(off) < 1.0
        assert np.mean(off > 40) < 1e-3  # the palette has the colours that are used


def test_drawing_only_what_moves_gives_the_whole_picture() -> None:
    here, row = scene("paper-1"), row_at("paper-1", 80.0)
    with rc_context(STYLE):
        quick = np.asarray(here.image(row), dtype=float)
        here.figure.canvas.draw()
        whole = np.asarray(here.figure.canvas.buffer_rgba(), dtype=float)[..., :3]  # type: ignore[attr-defined]
    assert np.mean(np.abs(quick - whole).max(axis=2) > 8) < 2e-3


def test_an_animation_is_small_reports_progress_and_leaves_settings_alone(tmp_path: Path) -> None:
    before, told = dict(mpl.rcParams), list[tuple[int, int]]()
    shown = animate_plan(
        planned("paper-2"),
        tmp_path / "plan.GIF",
        duration_s=2.0,
        on_progress=lambda done, total: told.append((done, total)),
    )
    assert dict(mpl.rcParams) == before
    assert [file.name for file in tmp_path.iterdir()] == ["plan.GIF"]
    assert (tmp_path / "plan.GIF").read_bytes() == shown.data
    assert told == [(frame, 25) for frame in range(1, 26)]
    assert 6 * len(shown.data) < README_LIMIT
    with Image.open(io.BytesIO(shown.data)) as gif:
        assert gif.size == (800, 660)
        assert gif.info["loop"] == 0


def test_a_notebook_shows_the_film_itself() -> None:
    html = Film(b"GIF89a", "image/gif", 800)._repr_html_()
    assert "GIF89a" not in repr(Film(b"GIF89a", "image/gif", 800))
    found = re.fullmatch(r'<img src="data:image/gif;base64,(\S+)" width="800" alt="\w+">', html)
    assert found is not None
    assert base64.b64decode(found[1]) == b"GIF89a"
    video = Film(b"mp4", "video/mp4", 800)._repr_html_()
    assert video.startswith('<video src="data:video/mp4;base64,bXA0" width="800" controls')


def test_mp4_is_what_ffmpeg_makes_of_the_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in for ffmpeg that writes the raw frames it is given."""
    stand_in = tmp_path / "ffmpeg"
    stand_in.write_text('#!/bin/sh\nfor last; do :; done\ncat > "$last"\n')
    stand_in.chmod(0o755)
    monkeypatch.setitem(mpl.rcParams, "animation.ffmpeg_path", str(stand_in))
    monkeypatch.setattr(film, "LAST_FRAME_S", 0.2)
    shown = animate_plan(planned("rigid-move"), tmp_path / "plan.mp4", duration_s=0.2)
    assert shown.media_type == "video/mp4"
    assert len(shown.data) == 4 * 800 * 660 * (2 + 2)
    assert (tmp_path / "plan.mp4").read_bytes() == shown.data


def test_an_mp4_without_ffmpeg_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(mpl.rcParams, "animation.ffmpeg_path", str(tmp_path / "ffmpeg"))
    with pytest.raises(InputError, match="ffmpeg, which is not installed"):
        check_animation_path("run.mp4")


# --- program


@pytest.fixture
def run(run_as_is: Run) -> Run:
    """Run ``twosra animate``; see ``conftest``."""
    return partial(run_as_is, "animate")


def test_a_plan_file_becomes_an_animation(run: Run, tmp_path: Path) -> None:
    solved("rigid-move").save("plan.json")
    code, out, err = run("plan.json", "plan.gif", "--seconds", "1")
    assert (code, err) == (0, "")
    assert re.search(r"file +plan\.gif *\n *bytes +\d+ ", out)
    with Image.open(tmp_path / "plan.gif") as gif:
        assert getattr(gif, "n_frames", 1) == 12
