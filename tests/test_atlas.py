"""Atlas of a batch: every number against a table whose answers are plain."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import Run

from twosra_mpc import InputError
from twosra_mpc.lab.batch.atlas import atlas, numeric_keys
from twosra_mpc.lab.batch.table import frame_of, write_table
from twosra_mpc.lab.figures.atlas_figure import chosen_keys, plot_atlas

CURRENTS, BENDS = (0.7, 0.8, 0.9), (-20.0, 0.0, 20.0, 40.0)
VARIED = {"robot.heater.melt_current_A": "float64", "goal.kappa_per_m.0": "float64"}
SAVED_PER_A, SAVED_PER_BEND = 100.0, -0.5


def row(problem: int, current: float, bend: float) -> dict[str, object]:
    """A plan whose duration is linear in both keys; two problems have none."""
    duration = 400.0 - SAVED_PER_A * current - SAVED_PER_BEND * bend
    keys = {"problem": problem, **dict(zip(VARIED, (current, bend), strict=True))}
    if bend == 40.0 and current < 0.9:
        message = f"goal.kappa_per_m = {bend + current} is not acceptable"
        return keys | {"status": "refused", "message": message, "sequence": "", "verified": False}
    return keys | {
        "status": "optimal",
        "message": "",
        "sequence": "[0,0] [1,1]" if bend >= 0 else "[0,0] [0,1]",
        "duration_s": duration,
        "search_gap": 0.01 if bend else 0.0,
        "critical_melts": 1.0,
        "critical_freezes": 2.0 if bend < 0 else 1.0,
        "verified": True,
        "greedy_duration_s": duration + 50.0,
    }


def table(*, greedy: bool = True) -> pd.DataFrame:
    places = [(current, bend) for current in CURRENTS for bend in BENDS]
    rows = [row(problem, *place) for problem, place in enumerate(places)]
    blank = {"status": "", "message": "", "sequence": "", "verified": False}
    texts = {f"greedy_{name}": "" for name in ("status", "message", "sequence")}
    return frame_of([blank | texts | each for each in rows], VARIED, greedy=greedy)


def test_what_a_batch_says() -> None:
    found = atlas(table())
    assert found.problems == 12
    assert found.statuses == {"optimal": 10, "refused": 2}
    assert found.sequences == {"[0,0] [1,1]": 7, "[0,0] [0,1]": 3}
    assert found.duration_s is not None
    assert (found.duration_s.plans, found.duration_s.most) == (10, 400 - 70 + 10)
    assert found.saved_s == pytest.approx((10, *[50.0] * 5))
    assert found.gap is not None
    assert (found.gap.least, found.gap.most) == (0.0, 0.01)


def test_a_change_is_worth_what_neighbours_differ_by() -> None:
    worth = {each.change: each.saved_s for each in atlas(table()).worth}
    current, bend = VARIED
    assert worth[f"1 more of {current}"] == pytest.approx((6, *[SAVED_PER_A] * 5))
    assert bend.endswith(".0")
    assert worth[f"1 more of {bend[:-2]} 1"] == pytest.approx((7, *[SAVED_PER_BEND] * 5))
    assert worth["freezing 1 s shorter"] == pytest.approx((10, 1, 1, 1, 2, 2))
    assert worth["melting 1 s shorter"] == pytest.approx((10, *[1.0] * 5))


def test_failures_that_differ_in_numbers_are_one() -> None:
    (failure,) = atlas(table()).failures
    assert (failure.status, failure.problems, failure.first) == ("refused", 2, 3)
    assert failure.message == "goal.kappa_per_m = 40.7 is not acceptable"


def test_without_the_greedy_rule_and_without_plans() -> None:
    found = atlas(table(greedy=False))
    assert found.saved_s is None
    none = atlas(table().iloc[3:4])
    assert (none.duration_s, none.gap, none.saved_s, none.worth) == (None, None, None, ())
    assert none.sequences == {}
    with pytest.raises(InputError, match="at least one finished problem"):
        atlas(table().iloc[:0])


def test_axes_are_keys_that_vary() -> None:
    frame = table()
    current, bend = VARIED
    assert numeric_keys(frame) == [current, bend]
    assert chosen_keys(frame, None, None) == (current, bend)
    assert chosen_keys(frame, bend, None) == (bend, current)
    assert chosen_keys(frame, None, current) == (bend, current)
    one = frame[frame[bend] == 0.0]
    one.attrs = frame.attrs
    assert chosen_keys(one, None, None) == (current, None)
    for x, y in ((bend, bend), ("x", None), (None, "start.x_m")):
        with pytest.raises(InputError, match="a varied key with several numbers"):
            chosen_keys(frame, x, y)
    with pytest.raises(InputError, match="this batch has none"):
        chosen_keys(one[:1], None, None)


def test_the_picture_shows_every_place() -> None:
    figure = plot_atlas(table())
    sequences, durations, saved, trend, worth, gaps = figure.axes[:6]
    places = np.ma.getdata(sequences.collections[0].get_array()).reshape(4, 3)  # type: ignore[arg-type]
    assert places.tolist() == [[2, 2, 2], [1, 1, 1], [1, 1, 1], [0, 0, 1]]
    shown = np.ma.MaskedArray(durations.collections[0].get_array()).reshape(4, 3)
    assert shown[0].tolist() == pytest.approx([320, 310, 300])
    assert shown.mask.sum() == 2
    assert "greedy" in saved.get_title()
    assert trend.lines[0].get_ydata() == pytest.approx([330, 320, 315])
    assert len(worth.texts) == 4
    assert sum(bar.get_height() for bar in gaps.patches) == 10
    assert figure.get_suptitle() == "10 plans of 12 problems, 2 refused"


def test_one_key_and_random_places(tmp_path: Path) -> None:
    frame = table(greedy=False)
    one = frame[frame["goal.kappa_per_m.0"] == 0.0]
    one.attrs = frame.attrs
    axes = plot_atlas(one).axes
    assert axes[0].get_ylabel() == "duration [s]"
    assert "energy" in axes[2].get_title()
    rng = np.random.default_rng(0)
    many = pd.concat([frame] * 5, ignore_index=True)
    for key in VARIED:
        many[key] = rng.uniform(0.0, 1.0, len(many))
    many.attrs = frame.attrs
    axes = plot_atlas(many, path=tmp_path / "atlas.svg").axes
    assert len(axes[0].collections[0].get_offsets()) == 60
    assert (tmp_path / "atlas.svg").stat().st_size > 10_000
    with pytest.raises(InputError, match="some problem has a plan"):
        plot_atlas(frame[frame["status"] == "refused"])


def test_the_command(run: Run, tmp_path: Path) -> None:
    write_table(table(), tmp_path / "runs.parquet")
    code, out, _ = run("atlas", tmp_path, "--csv", tmp_path / "t.csv", "--plot", tmp_path / "a.png")
    assert code == 0
    for words in ("10 of 12", "[0,0] [1,1]", "freezing 1 s shorter", "is not acceptable"):
        assert words in out
    assert len(pd.read_csv(tmp_path / "t.csv")) == 12
    assert (tmp_path / "a.png").is_file()
    code, out, _ = run("atlas", tmp_path / "runs.parquet", "--json")
    assert json.loads(out)["statuses"] == {"optimal": 10, "refused": 2}
    code, _, error = run("atlas", tmp_path, "-x", "mass_kg", "--plot", tmp_path / "a.png")
    assert code == 2
    assert "x = 'mass_kg'" in error
