"""Identification finds the parameters that a log was made with, and says how well it knows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from conftest import Run
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.files.heating import AIR_C, GAIN, TRUE, TrueHistory, true_history, write_log
from twosra_mpc import InputError, load_robot
from twosra_mpc.files import locate
from twosra_mpc.lab.commands import thermal_fit_command
from twosra_mpc.lab.commands.thermal_fit_command import write_identified_robot
from twosra_mpc.lab.figures.identification_figures import plot_thermal_fit
from twosra_mpc.lab.identification.heating_log import (
    EvenLog,
    HeatingLog,
    read_heating_log,
    resample,
)
from twosra_mpc.lab.identification.log_fit import Fitted, doubts, fit, pooled_rms_C, residuals
from twosra_mpc.lab.identification.log_response import (
    CORRECTED_S,
    HeaterLaw,
    SensorLag,
    TwoNodePlant,
    driven,
)
from twosra_mpc.lab.identification.thermal_fit import (
    LOGS_DIFFER,
    SEGMENT_FIELDS,
    UNIT,
    Parameters,
    ThermalFit,
    identify,
    score,
    two_nodes,
)
from twosra_mpc.robot.segment import TwoNodeSegment
from twosra_mpc.thermal.two_node import TwoNode

Array = NDArray[np.float64]

ROBOT = load_robot("2sr-v2")
FAMILY = two_nodes(GAIN)
HISTORY = true_history((30.0, 45.0))
ON_AND_OFF = true_history((35.0, 45.0), hold_duty=lambda since_s: 0.5 if since_s % 16 < 7 else 0.02)
NEVER_HELD = true_history((0.0, 0.0))


def segment(parameters: Parameters) -> TwoNodeSegment:
    assert isinstance(ROBOT.segment, TwoNodeSegment)
    values = {name: getattr(parameters, name) for name in SEGMENT_FIELDS}
    return ROBOT.segment.with_values(**values, ranges={})


def with_spikes(log: HeatingLog) -> HeatingLog:
    sensor = log.sensor_C.copy()
    sensor[17::97] += 15.0
    return replace(log, sensor_C=sensor)


def fitted_once(log: EvenLog) -> Fitted:
    """Fit from the nominal start alone, which is faster."""
    return fit(FAMILY, log, [each.start for each in FAMILY.parameters])


def approx(values: Sequence[float], rel: float) -> Any:
    return pytest.approx(tuple(values), rel=rel)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(HISTORY.log(1.0), tmp_path_factory.mktemp("log") / "log.csv")


@pytest.fixture(scope="module")
def fitted(path: Path) -> ThermalFit:
    """The fit to a log of two cycles, at 1 Hz."""
    counts: list[tuple[int, int]] = []
    found = identify(read_heating_log(path), ROBOT, lambda *count: counts.append(count))
    assert counts == [(k, 3) for k in range(1, 4)]
    return found


# --- the pieces against independent integration --------------------------------------------------


def test_two_nodes_take_the_steps_of_the_differential_equation() -> None:
    p, a, beta, b = TRUE[:4]
    plant = TwoNodePlant(TwoNode(p, a, beta, b, *UNIT), 0.5)
    duty = np.random.default_rng(0).random(60)
    states = driven(plant, (10.0, 4.0), duty)
    x = np.array([10.0, 4.0])
    for k, u in enumerate(duty):
        done = solve_ivp(
            lambda _, x, u=u: [p * u - a * (x[0] - x[1]), a / beta * (x[0] - x[1]) - b * x[1]],
            (0.0, 0.5),
            x,
            rtol=1e-10,
            atol=1e-10,
        )
        x = done.y[:, -1]
        assert states[k + 1] == pytest.approx(x, rel=1e-8)


def test_the_body_of_a_led_core_is_the_body_of_a_driven_one() -> None:
    plant = TwoNodePlant(TwoNode(*TRUE[:4], *UNIT), 0.5)
    free = driven(plant, (30.0, 10.0), np.linspace(0.0, 0.4, 200))
    led = plant.led(10.0, free[:, 0])
    assert led[:, 0].tolist() == free[:, 0].tolist()
    assert led[:, 1] == pytest.approx(free[:, 1], abs=1e-3)


def test_a_long_cooled_segment_keeps_its_shape_while_it_cools() -> None:
    plant = TwoNodePlant(TwoNode(*TRUE[:4], *UNIT), 0.5)
    start = plant.resting(10.0)
    states = driven(plant, start, np.zeros(600))
    assert start[0] == 10.0
    assert states[:, 1] / states[:, 0] == pytest.approx(start[1] / 10.0, rel=1e-6)
    assert 0 < states[-1, 0] < 8.0


def test_the_sensor_is_two_lags_behind_a_share_of_the_core() -> None:
    sensor, time_s = SensorLag(GAIN, 2.8, 0.5), 0.5 * np.arange(200)
    core = 30.0 + 10.0 * np.sin(time_s / 7)
    first, second = sensor.follow(core, np.array([20.0, 18.0])).T

    def rate(t: float, lags: Array) -> list[float]:
        contact = GAIN * np.interp(t, time_s, core)
        return [(contact - lags[0]) / 2.8, (lags[0] - lags[1]) / 2.8]

    done = solve_ivp(rate, (0.0, time_s[-1]), (20.0, 18.0), t_eval=time_s, max_step=0.1)
    assert first == pytest.approx(done.y[0], abs=2e-3)
    assert second == pytest.approx(done.y[1], abs=7e-3)


def test_the_inverted_sensor_finds_the_core_behind_readings() -> None:
    sensor, time_s = SensorLag(GAIN, 2.8, 0.5), 0.5 * np.arange(200)
    core = 40.0 + 1.5 * np.sin(time_s / 5)
    first, second = sensor.follow(core, np.full(2, GAIN * core[0])).T
    found, lag, reading = sensor.core_behind(second)
    inside = slice(20, -20)
    assert found[inside] == pytest.approx(core[inside], abs=0.15)
    assert lag[inside] == pytest.approx(first[inside], abs=0.05)
    assert reading == pytest.approx(second, abs=0.05)


def test_the_heater_law_is_a_clipped_straight_line() -> None:
    law = HeaterLaw(0.05, 0.4)
    duties = [law.duty(reading_C) for reading_C in (54.0, 50.0, 42.0, 20.0, 62.0, 80.0)]
    assert duties == pytest.approx([0.4, 0.6, 1.0, 1.0, 0.0, 0.0])


# --- recovering what a log was made with ---------------------------------------------------------


@pytest.mark.parametrize(
    ("made", "rate_Hz", "noise_C", "tolerance"),
    [
        (HISTORY, 1.0, 0.02, 0.08),  # when the heater was switched is known to half a second
        (HISTORY, 4.0, 0.02, 0.05),
        (HISTORY, 48.0, 0.02, 0.02),
        (HISTORY, 4.0, 0.0, 0.015),
        (ON_AND_OFF, 4.0, 0.02, 0.06),
        (NEVER_HELD, 4.0, 0.02, 0.06),
    ],
    ids=["1 Hz", "4 Hz", "48 Hz", "no noise", "on and off", "never held"],
)
def test_the_parameters_of_a_log_are_recovered(
    made: TrueHistory, rate_Hz: float, noise_C: float, tolerance: float
) -> None:
    found = fitted_once(resample(made.log(rate_Hz, noise_C)))
    assert found.values == approx(TRUE, tolerance)


def test_a_stronger_heater_is_recovered_too() -> None:
    true = Parameters(2.3, 0.022, 2.5, 0.004, 3.2, 0.06, 0.35)
    found = fitted_once(resample(true_history((30.0, 45.0), true).log(4.0)))
    assert found.values[:5] == approx(true[:5], 0.02)  # too fast for the law to show


def test_spikes_hardly_move_the_fit() -> None:
    clean = HISTORY.log(4.0)
    log = with_spikes(clean)
    assert log.spikes.sum() > 10
    found, expected = fitted_once(resample(log)), fitted_once(resample(clean))
    assert found.values == approx(expected.values, 0.01)


def test_more_noise_is_more_uncertainty() -> None:
    quiet, loud = (fitted_once(resample(HISTORY.log(4.0, noise))) for noise in (0.02, 0.2))
    for name, small, large, value, true in zip(
        Parameters._fields,
        quiet.standard_errors,
        loud.standard_errors,
        loud.values,
        TRUE,
        strict=True,
    ):
        assert 3 < large / small < 30, name
        assert abs(value - true) < 5 * large, name


def test_what_a_log_does_not_tell_has_an_infinite_standard_error() -> None:
    even = resample(HISTORY.log(2.0))
    cooling_only = even.scoring(~even.heating & (even.cycle == 0) & (even.time_s < 130.0))
    blind = replace(cooling_only, heating_share=0 * even.heating_share)
    found = dict(zip(Parameters._fields, fitted_once(blind).standard_errors, strict=True))
    for name in ("power_K_per_s", "law_gain_per_K", "law_duty_at_54C"):
        assert math.isinf(found[name])
    assert math.isfinite(found["coupling_per_s"])


# --- the whole identification --------------------------------------------------------------------


def test_the_fit_explains_its_log_better_than_the_robots_file(fitted: ThermalFit) -> None:
    assert fitted.residuals.rms_C < 0.1
    assert fitted.own_residuals.rms_C > 1.5 * fitted.residuals.rms_C


def test_residuals_are_those_of_the_response(fitted: ThermalFit) -> None:
    off = fitted.response.sensor_C - fitted.log.sensor_C
    scored, heating = fitted.log.scored, fitted.log.heating
    found = fitted.residuals
    assert found.rms_C == pytest.approx(np.sqrt(np.mean(off[scored] ** 2)))
    assert found.heating_rms_C == pytest.approx(np.sqrt(np.mean(off[scored & heating] ** 2)))
    assert found.cooling_rms_C == pytest.approx(np.sqrt(np.mean(off[scored & ~heating] ** 2)))
    assert found.max_C == np.abs(off[scored]).max()
    assert found.points == scored.sum()
    assert not scored[fitted.log.held].any()
    parts = [residuals(fitted.log.scoring(fitted.log.cycle == k), fitted.response) for k in (0, 1)]
    assert pooled_rms_C(parts) == pytest.approx(found.rms_C)


def test_residuals_of_nothing_are_no_number() -> None:
    even = resample(HISTORY.log(2.0))
    nothing = residuals(even.scoring(even.cycle > 7), FAMILY.respond(TRUE, even))
    assert nothing.points == 0
    assert all(math.isnan(value) for value in nothing[:4])
    assert math.isnan(pooled_rms_C([nothing]))


def test_leaving_a_cycle_out_is_fitting_the_others(fitted: ThermalFit) -> None:
    assert [part.cycle for part in fitted.held_out] == [0, 1]
    for part in fitted.held_out:
        left = fitted.log.cycle == part.cycle
        again = fitted_once(fitted.log.scoring(~left))
        assert part.parameters == approx(again.values, 5e-3)
        response = FAMILY.respond(part.parameters, fitted.log)
        assert part.residuals == residuals(fitted.log.scoring(left), response)
    pooled = pooled_rms_C([part.residuals for part in fitted.held_out])
    assert fitted.held_out_rms_C == pooled > fitted.residuals.rms_C


def test_a_cycle_left_out_is_not_looked_at(fitted: ThermalFit) -> None:
    sensor = fitted.log.sensor_C.copy()
    sensor[(fitted.log.cycle == 1) & ~fitted.log.held] += 5.0
    other = replace(fitted.log, sensor_C=sensor).scoring(fitted.log.cycle == 0)
    part = next(part for part in fitted.held_out if part.cycle == 1)
    assert fit(FAMILY, other, part.parameters).values == approx(part.parameters, 1e-3)


def test_ranges_hold_every_fit_and_the_standard_error(fitted: ThermalFit) -> None:
    for name in SEGMENT_FIELDS:
        low, high = fitted.segment.ranges[name]
        value, error = getattr(fitted.parameters, name), getattr(fitted.standard_errors, name)
        spread = max(1.645 * error, LOGS_DIFFER * value)
        assert low == pytest.approx(min(getattr(fitted.smallest, name), value - spread), rel=1e-3)
        assert high == pytest.approx(max(getattr(fitted.largest, name), value + spread), rel=1e-3)
        for part in fitted.held_out:
            inside = getattr(part.parameters, name)
            assert getattr(fitted.smallest, name) <= inside <= getattr(fitted.largest, name)
    assert ROBOT.segment is not None
    assert fitted.segment.ranges["sensor_gain"] == ROBOT.segment.ranges["sensor_gain"]


def test_the_segment_has_what_was_found_and_keeps_the_rest(fitted: ThermalFit) -> None:
    assert isinstance(ROBOT.segment, TwoNodeSegment)
    for name in SEGMENT_FIELDS:
        found = getattr(fitted.segment, name)
        assert found == pytest.approx(getattr(fitted.parameters, name), rel=1e-4)
    for name in ("sensor_gain", "solid_below_C", "liquid_above_C", "core_heat_J_per_K"):
        assert getattr(fitted.segment, name) == getattr(ROBOT.segment, name)


def test_a_segment_without_two_nodes_is_refused() -> None:
    lumped = load_robot("2sra-v1")
    constant = {"constant": lumped.timing["constant"]}
    bare = lumped.with_values(segment=None, timing=constant)
    for robot, given in ((lumped, "lumped"), (bare, "missing")):
        with pytest.raises(InputError, match="two_node") as caught:
            identify(HISTORY.log(1.0), robot)
        assert (caught.value.field, caught.value.value) == ("segment.model", given)


# --- scoring -------------------------------------------------------------------------------------


def test_the_true_segment_leaves_the_noise() -> None:
    found = score(HISTORY.log(4.0), segment(TRUE), TRUE.law)
    assert found.law == TRUE.law
    assert found.residuals.rms_C == pytest.approx(0.02, abs=0.02)


def test_a_segment_whose_sensor_does_not_lag_can_be_scored() -> None:
    sudden = segment(TRUE).with_values(sensor_lag_s=0.0)
    assert 0.5 < score(HISTORY.log(4.0), sudden, TRUE.law).residuals.rms_C < 10.0


def test_without_a_law_the_law_is_fitted_and_nothing_else() -> None:
    found = score(HISTORY.log(4.0), segment(TRUE))
    assert found.law == approx(TRUE.law, 0.02)
    worse = score(HISTORY.log(4.0), segment(TRUE._replace(coupling_per_s=0.021)))
    assert worse.residuals.rms_C > 5 * found.residuals.rms_C


def test_a_fit_describes_a_log_it_has_not_seen(fitted: ThermalFit) -> None:
    unseen = true_history((70.0, 20.0, 40.0)).log(2.0, seed=5)
    found = score(unseen, fitted.segment, fitted.parameters.law)
    assert found.residuals.rms_C < 0.25
    assert isinstance(ROBOT.segment, TwoNodeSegment)
    assert score(unseen, ROBOT.segment).residuals.rms_C > found.residuals.rms_C


def test_a_segment_that_starts_warm_has_cooled_for_long() -> None:
    made = true_history((30.0, 30.0), enough_C=30.0)
    whole = made.log(2.0)
    later = whole.time_s >= made.phases[2][0] - 50.0  # still cooling
    samples = (each[later] for each in (whole.time_s, whole.sensor_C, whole.mode))
    assert score(HeatingLog("", *samples, AIR_C), segment(TRUE), TRUE.law).residuals.rms_C < 0.1


def test_readings_after_a_hold_correct_its_end_only_for_some_seconds() -> None:
    even = resample(HISTORY.log(4.0))
    expected = FAMILY.respond(TRUE, even)
    end = np.flatnonzero(even.held & (even.cycle == 1))[-1]
    late = even.time_s > even.time_s[end] + CORRECTED_S + even.step_s
    sensor = np.where(late, even.sensor_C - 3.0, even.sensor_C)
    found = FAMILY.respond(TRUE, replace(even, sensor_C=sensor))
    assert found.sensor_C.tolist() == expected.sensor_C.tolist()


# --- robot file, figure, command -----------------------------------------------------------------


def test_the_robot_file_carries_the_fit_and_keeps_its_comments(
    fitted: ThermalFit, tmp_path: Path
) -> None:
    write_identified_robot("2sr-v2", tmp_path / "mine.toml", fitted)
    found = load_robot(tmp_path / "mine.toml")
    assert found.segment == fitted.segment
    assert found == ROBOT.with_values(segment=fitted.segment)
    before = locate("2sr-v2", "robots", "robot").read_text(encoding="utf-8")
    after = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    for line in before.splitlines():
        if "#" in line:
            assert line[line.index("#") :] in after
    assert "identified anew from log.csv" in after


def test_ranges_are_added_to_a_robot_file_without(fitted: ThermalFit, tmp_path: Path) -> None:
    text = locate("2sr-v2", "robots", "robot").read_text(encoding="utf-8")
    start, end = text.index("[segment.ranges]"), text.index("[timing.nominal]")
    (tmp_path / "bare.toml").write_text(text[:start] + text[end:], encoding="utf-8")
    write_identified_robot(tmp_path / "bare.toml", tmp_path / "mine.toml", fitted)
    found = load_robot(tmp_path / "mine.toml").segment
    assert found is not None
    assert found.ranges == {name: fitted.segment.ranges[name] for name in SEGMENT_FIELDS}


def test_a_json_robot_is_not_rewritten(fitted: ThermalFit, tmp_path: Path) -> None:
    (tmp_path / "robot.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="a TOML file"):
        write_identified_robot(tmp_path / "robot.json", tmp_path / "mine.toml", fitted)


def test_the_figure_shows_the_fit_and_is_written(fitted: ThermalFit, tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    figure = plot_thermal_fit(fitted, tmp_path / "fit.png")
    assert dict(mpl.rcParams) == before
    assert (tmp_path / "fit.png").read_bytes().startswith(b"\x89PNG")
    sensor, nodes, _, off = figure.axes
    lines = {str(line.get_label()): line for line in sensor.get_lines() + nodes.get_lines()}
    assert np.asarray(lines["measured"].get_ydata()).tolist() == fitted.log.sensor_C.tolist()
    for phase, flags in (("heating", fitted.log.heating), ("cooling", ~fitted.log.heating)):
        drawn = np.asarray(lines[f"model, {phase}"].get_ydata())
        assert np.isfinite(drawn).tolist() == (flags & ~fitted.log.held).tolist()
    body = np.asarray(lines["body"].get_ydata())
    assert body == pytest.approx(
        np.interp(fitted.log.time_s, HISTORY.time_s, HISTORY.state_C[:, 1]), abs=0.5
    )
    largest = max(np.nanmax(np.abs(np.asarray(line.get_ydata()))) for line in off.get_lines())
    assert largest == fitted.residuals.max_C
    assert len([patch for patch in off.patches if patch.get_width() > 25.0]) == 2  # the two holds


def test_the_command_prints_and_writes_what_the_function_finds(
    run: Run, path: Path, fitted: ThermalFit, tmp_path: Path
) -> None:
    unseen = write_log(true_history((60.0,)).log(1.0), tmp_path / "unseen.csv")
    files = ("--out", "mine.toml", "--plot", "fit.png", "--held-out", unseen)
    code, out, err = run("fit-thermal", path, "--robot", "2sr-v2", *files)
    assert (code, err) == (0, "")
    assert load_robot("mine.toml").segment == fitted.segment  # the same, to the last digit
    assert Path("fit.png").stat().st_size > 10_000
    for value, error in zip(fitted.parameters, fitted.standard_errors, strict=True):
        assert f" {value:.4g} {error:.2g} " in out
    for words, off, left_out in (
        ("as fitted", fitted.residuals, f"{fitted.held_out_rms_C:.3f}"),
        ("as in 2sr-v2, heater law fitted", fitted.own_residuals, "-"),
    ):
        rms = f"{off.heating_rms_C:.3f} {off.cooling_rms_C:.3f} {off.rms_C:.3f} {off.max_C:.3f}"
        assert f"{words} {rms} {left_out}" in out
    rms = score(read_heating_log(unseen), fitted.segment, fitted.parameters.law).residuals.rms_C
    assert f" {rms:.3f} " in out[out.index(f"on {unseen}") :]
    assert "cycle 2" in out
    assert "Spikes replaced: 0" in out


def test_findings_unlike_the_robots_file_are_warned_of(fitted: ThermalFit) -> None:
    own = ROBOT.thermal_segment(0)
    assert doubts(ROBOT, own, fitted.fitted, ROBOT.heater.ambient_C + 9.9) == []
    assert isinstance(own, TwoNodeSegment)
    slow = own.with_values(power_K_per_s=own.power_K_per_s / 2, body_loss_per_s=0.02)
    found = doubts(ROBOT, slow, fitted.fitted, ROBOT.heater.ambient_C - 15)
    assert [words.split()[0] for words in found[:2]] == ["power_K_per_s", "body_loss_per_s"]
    assert "7.6 C, is 15 K from heater.ambient_C (22.6 C)" in found[2]
    assert len(found) == 3


def test_one_cycle_is_fitted_without_cross_validation(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits: list[ThermalFit] = []

    def spy(*arguments: Any) -> ThermalFit:
        fits.append(identify(*arguments))
        return fits[-1]

    monkeypatch.setattr(thermal_fit_command.thermal_fit, "identify", spy)
    log = write_log(true_history((40.0,)).log(1.0), Path("one.csv"))
    code, out, _ = run("fit-thermal", log, "--robot", "2sr-v2", "--ambient", "20.6")
    assert code == 0
    assert "No cross-validation by cycles" in out
    assert "Air: 20.6 C. It starts 2.0 K above: taken as cooled for long." in out
    (found,) = fits
    assert found.held_out == ()
    assert math.isnan(found.held_out_rms_C)
    assert found.smallest == found.parameters == found.largest


def test_a_robot_can_be_scored_without_a_fit(run: Run, path: Path) -> None:
    code, out, _ = run("fit-thermal", path, "--robot", "2sr-v2", "--score")
    assert code == 0
    assert isinstance(ROBOT.segment, TwoNodeSegment)
    found = score(read_heating_log(path), ROBOT.segment)
    assert f"{path} {found.residuals.heating_rms_C:.3f}" in out
    assert f"K_p {found.law.gain_per_K:.4f} 1/K" in out
    code, _, err = run("fit-thermal", path, "--robot", "2sr-v2", "--score", "--out", "a.toml")
    assert code == 2
    assert "nothing to write" in err


def test_bad_input_is_told_before_anything_is_fitted(run: Run, path: Path) -> None:
    for arguments, told in (
        ((path, "--robot", "2sra-v1"), "segment.model = 'lumped'"),
        ((path, "--robot", "2sr-v2", "--plot", "a.docx"), "ending in"),
        (
            (path, "--robot", "2sr-v2", "--out", "none/a.toml"),
            "folder that exists and can be written",
        ),
        ((path, "--robot", "2sr-v2", "--held-out", "none.csv"), "none.csv"),
        ((path, "--robot", "2sr-v2", "--ambient", "99"), "ambient_C = 99"),
        ((path,), "--robot"),
    ):
        code, out, err = run("fit-thermal", *arguments)
        assert (code, out) == (2, "")
        assert told in err
    assert not list(Path.cwd().iterdir())
