"""Heating logs are read and checked by the row, cleaned of spikes, and put on an even grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.files.heating import AIR_C, true_history, write_log
from twosra_mpc import InputError
from twosra_mpc.lab.identification.heating_log import HeatingLog, read_heating_log, resample, runs

HISTORY = true_history((30.0, 20.0))
LOG = HISTORY.log(rate_Hz=2.0)


def rows(mode: str, count: int, sensor_C: float = 40.0) -> list[list[str]]:
    return [["", f"{sensor_C}", mode] for _ in range(count)]


def text(body: list[list[str]], heading: str = "time_s,temp_C,mode") -> str:
    """A log with a time a second where there is none."""
    lines = [heading]
    for i, (time, *rest) in enumerate(body):
        lines.append(",".join([time or f"{i}", *rest]))
    return "\n".join(lines) + "\n"


def good() -> list[list[str]]:
    return rows("heating", 5, AIR_C) + rows("heating", 26) + rows("hold", 5) + rows("cooling", 25)


def read(tmp_path: Path, content: str, ambient_C: float | None = None) -> HeatingLog:
    path = tmp_path / "log.csv"
    path.write_text(content, encoding="utf-8")
    return read_heating_log(path, ambient_C)


# --- reading -------------------------------------------------------------------------------------


def test_a_written_log_is_read_back(tmp_path: Path) -> None:
    found = read_heating_log(write_log(LOG, tmp_path / "log.csv"))
    assert found.time_s == pytest.approx(LOG.time_s, abs=1e-4)
    assert found.sensor_C == pytest.approx(LOG.sensor_C, abs=1e-4)
    assert found.mode.tolist() == LOG.mode.tolist()
    assert found.ambient_C == found.sensor_C[0]
    assert read_heating_log(tmp_path / "log.csv", 20.0).ambient_C == 20.0


def test_order_of_columns_spaces_and_a_byte_order_mark_do_not_matter(tmp_path: Path) -> None:
    body = [[mode, f" {sensor}", f"{i}"] for i, (_, sensor, mode) in enumerate(good())]
    odd = read(tmp_path, "\ufeff" + text(body, "mode, temp_C,time_s").replace("\n", "\r\n"))
    plain = read(tmp_path, text(good()))
    assert odd.time_s.tolist() == plain.time_s.tolist()
    assert odd.sensor_C.tolist() == plain.sensor_C.tolist()
    assert odd.mode.tolist() == plain.mode.tolist()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_log_is_the_same_whatever_parts_its_cells(
    mark: str, encoding: str, tmp_path: Path
) -> None:
    """With a decimal comma where the comma parts none, as spreadsheets write it."""
    content = text(good())
    if mark != ",":
        content = content.replace(",", mark).replace(".", ",")
    (tmp_path / "log.csv").write_text(f"\n \n{content}", encoding=encoding)
    assert read_heating_log(tmp_path / "log.csv") == read(tmp_path, text(good()))


def test_flexible_is_another_word_for_hold(tmp_path: Path) -> None:
    content = text(good())
    found = read(tmp_path, content.replace("hold", "flexible"))
    assert found.mode.tolist() == read(tmp_path, content).mode.tolist()


def test_a_log_cannot_be_changed() -> None:
    for values in (LOG.time_s, LOG.sensor_C, LOG.mode, resample(LOG).sensor_C):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = values[1]


# --- what is refused -----------------------------------------------------------------------------


def with_cell(row: int, column: int, value: str) -> Callable[[], str]:
    def content() -> str:
        body = good()
        body[row - 1][column] = value
        return text(body)

    return content


REFUSED: dict[str, tuple[Callable[[], str], str, str]] = {
    "empty file": (lambda: "", "column time_s", "time_s, temp_C, mode"),
    "no column temp_C": (lambda: text(good(), "time_s,T,mode"), "column temp_C", "time_s, temp_C"),
    "no column mode": (lambda: text(good(), "time_s,temp_C,m"), "column mode", "time_s, temp_C"),
    "no rows": (lambda: text([]), "rows", "at least one row"),
    "text": (with_cell(3, 1, "warm"), "temp_C, row 3", "a finite number"),
    "nothing": (with_cell(4, 1, ""), "temp_C, row 4", "a finite number"),
    "digits apart": (with_cell(5, 1, "2_5"), "temp_C, row 5", "a finite number"),
    "nan": (with_cell(5, 1, "nan"), "temp_C, row 5", "a finite number"),
    "infinite": (with_cell(6, 0, "inf"), "time_s, row 6", "a finite number"),
    "unknown word": (with_cell(7, 2, "melting"), "mode, row 7", "heating, hold, cooling"),
    "time repeated": (with_cell(8, 0, "6"), "time_s, row 8", "later than the row before it (6 s)"),
    "time reversed": (with_cell(9, 0, "2.5"), "time_s, row 9", "later than the row before it"),
    "a row cut short": (lambda: text(good()) + "99\n", "temp_C, row 62", "a finite number"),
    "an hour missing": (
        lambda: text(good()) + "4e3,40,cooling\n",
        "time_s, row 62",
        "60 s at most",
    ),
    "no cooling": (lambda: text(good()[:36]), "mode", "at least 20 rows of cooling"),
    "hardly cooling": (lambda: text(good()[:50]), "mode", "at least 20 rows of cooling"),
    "no heating": (lambda: text(rows("cooling", 90)), "mode", "at least 20 rows of heating"),
    "hold first": (lambda: text(rows("hold", 3) + good()), "mode, row 1", "heating or cooling"),
    "never warm": (lambda: text(good()).replace("40.0", "23"), "temp_C", "rise 5 K above the air"),
    "colder than the air": (
        lambda: text(good() + rows("cooling", 5, 19.0)),
        "ambient_C",
        "at most the coldest reading (19 C)",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_log_is_refused_by_column_and_row(tmp_path: Path, case: str) -> None:
    content, field, allowed = REFUSED[case]
    with pytest.raises(InputError) as caught:
        read(tmp_path, content())
    assert caught.value.field == field
    assert allowed in caught.value.allowed
    assert caught.value.source == str(tmp_path / "log.csv")


@pytest.mark.parametrize("offset", [0.0, 1.7e12])
@pytest.mark.parametrize("seconds", [0.02, 0.1, 1.0])
def test_milliseconds_are_asked_for(tmp_path: Path, seconds: float, offset: float) -> None:
    late = [[f"{offset + 1e3 * seconds * i:f}", *row[1:]] for i, row in enumerate(good())]
    with pytest.raises(InputError, match=r"time_s.* are these milliseconds.* Times are seconds\."):
        read(tmp_path, text(late))


@pytest.mark.parametrize("column", ["time_s", "sensor_C"])
def test_a_log_made_in_memory_is_checked_as_well(column: str) -> None:
    broken = getattr(LOG, column).copy()
    broken[[6, 9]] = np.inf
    with pytest.raises(InputError, match="row 7 = inf"):
        replace(LOG, **{column: broken})


def test_slow_samples_are_refused(tmp_path: Path) -> None:
    body = [[f"{10 * i}", *rest] for i, (_, *rest) in enumerate(good())]
    with pytest.raises(InputError, match=r"time_s = 10\.0 .* at most 5 s between rows"):
        read(tmp_path, text(body))


def test_air_that_is_no_number_or_hotter_than_a_reading_is_refused(tmp_path: Path) -> None:
    for ambient_C in (float("nan"), 25.0):
        with pytest.raises(InputError) as caught:
            read(tmp_path, text(good()), ambient_C)
        assert caught.value.field == "ambient_C"


def test_a_file_that_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a file that exists"):
        read_heating_log(tmp_path / "none.csv")


# --- cycles, spikes, grid ------------------------------------------------------------------------


def test_a_cycle_starts_with_each_heating() -> None:
    first = HISTORY.phases[2][0]
    assert LOG.cycle.tolist() == (LOG.time_s >= first).astype(int).tolist()


def test_what_comes_before_the_first_heating_belongs_to_the_first_cycle() -> None:
    idle = np.arange(5)
    time = np.concatenate([idle, LOG.time_s + 5])
    sensor = np.concatenate([np.full(5, AIR_C), LOG.sensor_C])
    mode = np.concatenate([np.full(5, "cooling"), LOG.mode])
    later = HeatingLog("", time, sensor, mode, AIR_C)
    assert later.cycle.tolist() == [0] * 5 + LOG.cycle.tolist()


@pytest.mark.parametrize("rate_Hz", [1.0, 48.0])
def test_spikes_and_only_spikes_are_replaced(rate_Hz: float) -> None:
    clean = HISTORY.log(rate_Hz)
    assert not clean.spikes.any()
    sensor, where = clean.sensor_C.copy(), [0, 20, 75, 76, 120, len(clean.time_s) - 1]
    sensor[where] += [9.0, -30.0, 5.0, 4.0, 20.0, -9.0]
    spiky = HeatingLog("", clean.time_s, sensor, clean.mode, AIR_C)
    assert np.flatnonzero(spiky.spikes).tolist() == where
    assert np.abs(spiky.despiked_C - clean.sensor_C).max() < 2.5 / rate_Hz + 0.1


def test_a_spike_in_the_first_reading_is_not_the_air(tmp_path: Path) -> None:
    body = rows("heating", 3, 22.0) + good()
    body[0][1] = "58.8"
    assert read(tmp_path, text(body)).ambient_C == 22.0


@pytest.mark.parametrize("rate_Hz", [1.0, 2.0, 48.0])
def test_a_log_is_the_same_on_the_grid_whatever_its_rate(rate_Hz: float) -> None:
    even = resample(HISTORY.log(rate_Hz, noise_C=0.0))
    assert even.step_s == (1.0 if rate_Hz == 1.0 else 0.5)
    assert np.diff(even.time_s) == pytest.approx(even.step_s)
    true = np.interp(even.time_s, HISTORY.time_s, HISTORY.state_C[:, 3])
    assert np.abs(even.sensor_C - true).max() < 0.05
    assert even.scored.tolist() == (~even.held).tolist()


@pytest.mark.parametrize("rate_Hz", [1.0, 2.0, 48.0])
def test_the_time_spent_heating_is_that_of_the_samples(rate_Hz: float) -> None:
    log = HISTORY.log(rate_Hz)
    even = resample(log)
    heating = 0.0
    for first, end in runs(log.mode == "heating"):  # half a sample's time on either side
        heating += log.time_s[min(end, len(log.time_s) - 1)] + log.time_s[end - 1]
        heating -= log.time_s[first] + log.time_s[max(first - 1, 0)]
    assert even.step_s * even.heating_share.sum() == pytest.approx(heating / 2)
    assert np.all((even.heating_share >= 0) & (even.heating_share <= 1 + 1e-9))


def test_uneven_samples_are_put_on_the_grid_and_gaps_are_not_scored() -> None:
    full = HISTORY.log(4.0, noise_C=0.0)
    gap = (full.time_s > 120.0) & (full.time_s < 130.0)
    keep = ~gap & (np.random.default_rng(1).random(len(full.time_s)) < 0.8)
    keep[0] = True
    thin = HeatingLog("", full.time_s[keep], full.sensor_C[keep], full.mode[keep], AIR_C)
    even = resample(thin)
    inside = (even.time_s > 120.5) & (even.time_s < 129.5)
    assert not even.scored[inside].any()
    assert even.scored[(even.time_s > 140.0) & ~even.held].mean() > 0.95
    true = np.interp(even.time_s, HISTORY.time_s, HISTORY.state_C[:, 3])
    assert np.abs(even.sensor_C - true)[even.scored].max() < 0.15


def test_scoring_a_part_changes_nothing_else() -> None:
    even = resample(LOG)
    part = even.scoring(even.cycle == 1)
    assert part.scored.sum() == (even.scored & (even.cycle == 1)).sum() > 0
    assert part.sensor_C is even.sensor_C
