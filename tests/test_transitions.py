"""Logged melts and freezes give back the segment they were made with, or are refused by name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files as package_files
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from conftest import Run

from benchmarks.files import melts
from benchmarks.files.melts import (
    BEGINS_C,
    ROBOT,
    TARGETS,
    TRUE,
    Rows,
    course,
    made_up,
    of_both,
    write,
)
from twosra_mpc import InputError, load_robot
from twosra_mpc.lab.identification.transition_fit import (
    LoggedTransition,
    TransitionFit,
    identify_transitions,
    read_transitions,
)
from twosra_mpc.robot.segment import TwoNodeSegment


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder, (transitions, readings) = tmp_path_factory.mktemp("log"), made_up()
    return write(transitions, folder / "melts.csv"), write(readings, folder / "readings.csv")


@pytest.fixture(scope="module")
def logged(files: tuple[Path, Path]) -> tuple[LoggedTransition, ...]:
    return read_transitions(*files, 2)


@pytest.fixture(scope="module")
def fit(logged: tuple[LoggedTransition, ...]) -> TransitionFit:
    return identify_transitions(logged, ROBOT, "melts.csv")


def test_transitions_are_read(logged: tuple[LoggedTransition, ...]) -> None:
    assert [each.kind for each in logged] == ["melt", "freeze"] * 6
    assert [each.target for each in logged[::2]] == list(TARGETS)
    assert {each.target for each in logged[1::2]} == {(0, 0)}
    for each, begins in zip(logged[::2], BEGINS_C, strict=True):
        assert each.begin_C == pytest.approx(begins, abs=0.3)


def test_the_segment_that_made_the_log_is_found(fit: TransitionFit) -> None:
    """The slower one told; with no heat known of the other, to a few per cent."""
    for name, true in TRUE.items():
        assert getattr(fit.segment, name) == pytest.approx(true, rel=0.1), name
        low, high = fit.segment.ranges[name]
        assert low <= true <= high
    assert fit.quantile(0.5) < 0.02
    assert fit.within(0.1) == len(fit.predictions) == 12
    assert isinstance(ROBOT.segment, TwoNodeSegment)
    assert fit.segment.sensor_lag_s == ROBOT.segment.sensor_lag_s


# Melts from rest and the freezes after them, of one segment: reading at the begin [C], its own
# crossings of 63 and 53 C [s]; public logs of the follow-up robot in use.
CROSSINGS = (
    *((27.4, 43.8, 68.4), (35.8, 42.6, 79.0), (28.4, 32.2, 75.2), (47.0, 22.3, 73.0)),
    *((52.9, 14.3, 102.5), (49.0, 21.5, 78.4), (40.7, 23.8, 87.9), (52.8, 14.1, 99.9)),
    (46.7, 13.0, 71.9),
)


def test_ranges_of_the_built_in_robot_hold_each_segments_own_crossings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nine of ten lie between those of a fast melt with a slow freeze, and of the contrary."""
    ranges = ROBOT.thermal_segment(0).ranges
    found = []
    for picked in ((1, 0, 0, 0), (0, 1, 1, 1)):
        corner = {name: ranges[name][at] for name, at in zip(TRUE, picked, strict=True)}
        monkeypatch.setattr(melts, "TRUE", corner)
        for begin_C, _, _ in CROSSINGS:
            (melt_s, *_), molten = course([begin_C] * 4, True, 63.0)
            found.append((melt_s, course(molten, False, 53.0)[0][0]))
    fast, slow = np.array(found).reshape(2, -1, 2)
    logged = np.array(CROSSINGS)[:, 1:]
    inside = (np.minimum(fast, slow) <= logged) & (logged <= np.maximum(fast, slow))
    assert inside.mean() >= 0.9


def test_ranges_hold_every_fit_and_are_as_wide_as_logs_differ(fit: TransitionFit) -> None:
    for name in fit.fitted:
        low, high = fit.segment.ranges[name]
        value = getattr(fit.segment, name)
        assert low <= 0.7001 * value <= 1.2999 * value <= high
        assert low <= fit.smallest[name] <= fit.largest[name] <= high


def test_one_wrong_duration_hardly_moves_the_fit(
    logged: tuple[LoggedTransition, ...], fit: TransitionFit
) -> None:
    odd = (*logged[:3], replace(logged[3], duration_s=9.0), *logged[4:])
    found = identify_transitions(odd, ROBOT, "melts.csv")
    for name in ("power_K_per_s", "body_ratio"):
        assert getattr(found.segment, name) == pytest.approx(getattr(fit.segment, name), rel=0.1)
    assert found.within(0.35) == 11


def test_a_listed_segment_is_fitted_to_its_own_crossings(run: Run) -> None:
    """Both melt at once; that of twice the power is done long before the log says so."""
    transitions, readings = of_both((1.0, 2.0))
    log, other = write(transitions, Path("melts.csv")), write(readings, Path("readings.csv"))
    given = ("fit-thermal", log, "--readings", other, "--robot", listed())
    code, out, _ = run(*given, "--segment", "2", "--out", "2.toml")
    assert code == 0
    assert "12 of 12 within 35 %" in out
    first, second = load_robot("2.toml").segments
    assert first == load_robot("listed.toml").segments[0]
    assert isinstance(second, TwoNodeSegment)
    for name, true in TRUE.items():
        share = 2.0 if name == "power_K_per_s" else 1.0
        assert getattr(second, name) == pytest.approx(share * true, rel=0.1), name
    code, _, err = run(*given, "--segment", "3")
    assert code == 2
    assert "segment = 3 is not acceptable; allowed: 1 to 2" in err


def listed() -> Path:
    """The follow-up robot with a table for each of its segments, written to a file."""
    path = package_files("twosra_mpc").joinpath("robots", "2sr-v2.toml")
    document = tomlkit.parse(path.read_text(encoding="utf-8")).unwrap()
    length_m = document["geometry"].pop("segment_length_m")
    document["segment"] = [{"length_m": length_m, **document["segment"]} for _ in range(2)]
    Path("listed.toml").write_text(tomlkit.dumps(document), encoding="utf-8")
    return Path("listed.toml")


# --- what is refused -----------------------------------------------------------------------------


def each(column: str, change: Callable[[float], object]) -> Callable[[Rows], Rows]:
    """Change a column of every row."""
    return lambda rows: [{**row, column: change(row[column])} for row in rows]  # type: ignore[arg-type]


def both(change: Callable[[float], object]) -> Callable[[Rows], Rows]:
    return lambda rows: each("reading1_C", change)(each("reading2_C", change)(rows))


def same(rows: Rows) -> Rows:
    return rows


def relabelled(rows: Rows) -> Rows:
    other = {"melt": "freeze", "freeze": "melt"}
    return [{**row, "kind": other[str(row["kind"])]} for row in rows]


Change = Callable[[Rows], Rows]
REFUSED: dict[str, tuple[Change, Change, str, str]] = {
    "minutes": (each("duration_s", lambda t: t / 60), same, "duration_s, row 1", "minutes"),
    "hours": (each("duration_s", lambda t: t / 3600), same, "duration_s, row 1", "hours"),
    "all minutes": (
        each("duration_s", lambda t: t / 60),
        each("time_s", lambda t: t / 60),
        "duration_s",
        "minutes",
    ),
    "kelvin": (same, both(lambda y: y + 273.15), "reading1_C, reading2_C", "kelvin"),
    "counts": (same, both(lambda y: 40 * y), "reading1_C, reading2_C", "converter"),
    "swapped kinds": (relabelled, same, "kind", "labels swapped"),
    "swapped targets": (
        lambda rows: each("target1", lambda s: 1 - s)(each("target2", lambda s: 1 - s)(rows)),
        same,
        "kind",
        "targets 1 (soft)",
    ),
    "too few": (lambda rows: rows[:6], same, "kind", "at least 5 of a kind"),
    "freeze first": (lambda rows: [*rows[1:], *rows[:1]], same, "kind, first row", "a melt"),
    "no readings": (same, lambda rows: rows[60:], "transition, row 1", "readings of"),
    "no number": (each("duration_s", lambda _: "long"), same, "duration_s, row 1", "finite"),
    "unknown kind": (each("kind", lambda _: "boil"), same, "kind, row 1", "melt or freeze"),
    "no column": (
        lambda rows: [{k: v for k, v in row.items() if k != "kind"} for row in rows],
        same,
        "column kind",
        "heading",
    ),
    "empty": (same, lambda rows: [{**rows[0], "transition": ""}], "transition, row 1", "finite"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_log_that_cannot_be_right_is_refused_and_nothing_is_written(run: Run, case: str) -> None:
    change, change_readings, field, told = REFUSED[case]
    transitions, readings = made_up()
    log = write(change(transitions), Path("melts.csv"))
    other = write(change_readings(readings), Path("readings.csv"))
    given = ("fit-thermal", log, "--readings", other, "--robot", "2sr-v2", "--out", "new.toml")
    code, out, err = run(*given)
    assert (code, out) == (2, "")
    assert field in err
    assert told in err
    assert not Path("new.toml").exists()


def test_durations_that_no_segment_has_are_refused(logged: tuple[LoggedTransition, ...]) -> None:
    """Three times as long in every other melt and freeze: no model explains both."""
    odd = tuple(
        replace(each, duration_s=each.duration_s * (12.0 if i % 4 < 2 else 0.4))
        for i, each in enumerate(logged)
    )
    with pytest.raises(InputError) as caught:
        identify_transitions(odd, ROBOT, "melts.csv")
    assert caught.value.field in {"error of durations", *TRUE}
    with pytest.raises(InputError, match="two_node"):
        identify_transitions(logged, load_robot("2sra-v1"), "melts.csv")


def test_the_command_tells_every_transition_and_writes_the_robot(
    run: Run, files: tuple[Path, Path], fit: TransitionFit
) -> None:
    given = ("fit-thermal", files[0], "--readings", files[1], "--robot", "2sr-v2")
    code, out, err = run(*given, "--out", "new.toml")
    assert (code, err) == (0, "")
    assert load_robot("new.toml").segment == fit.segment
    assert "12 transitions of melts.csv" in Path("new.toml").read_text(encoding="utf-8")
    for each_one in fit.predictions:
        assert f"{each_one.logged.duration_s:.1f} {each_one.fitted_s:.1f}" in out
    assert "12 of 12 within 35 %" in out
    found = json.loads(run(*given, "--json").out)
    assert found["error_median"] == fit.quantile(0.5)
    assert [row["left_out_s"] for row in found["transitions"]] == [
        each_one.left_out_s for each_one in fit.predictions
    ]
    code, _, err = run(*given, "--score")
    assert code == 2
    assert "--readings goes with" in err
