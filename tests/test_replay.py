"""``twosra replay``: logs of motion in the authors' formats, predicted phase by phase."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from once import planned

from twosra_mpc import InputError, load_robot, robot_shape, with_path_model
from twosra_mpc.lab.identification.motion_log import MotionLog, read_motion_log, save_authors_csv
from twosra_mpc.lab.identification.replay import LEAST_BEND_RAD, PhaseReplay, replay
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.rolling import Drift, rolling
from twosra_mpc.robot.coordinates import Array

pytestmark = pytest.mark.filterwarnings("error::twosra_mpc.errors.InputWarning")

ROBOT = load_robot("2sra-v1")
TRIAL = "x,y,angle,k1,k2,v1,v2,u0,v0,r0,s1,s2,time"
POSES = ",time stamp,LU1 x,LU1 y,LU1 th,LU2 x,LU2 y,LU2 th"
RATE_HZ = 15

# First and last rows of the phases [1,1] and [0,0] of trial 1 as its authors logged them, rounded
# (2sr-agent-control, mainExperiment5.csv); columns of the model's state left out.
TRIAL_1 = """\
0.239,0.279,-0.225,-38.0,-22.0,0.0091080,0.0096707,0.0,0.0,0.0,1,1,15:30:16
0.239,0.279,-0.225,-37.0,-22.0,0.0090913,0.0090634,0.0,0.0,0.0,1,1,15:30:16
0.217,0.258,-0.094,-10.0,-11.0,0.0,0.0,0.0,0.0,0.0,1,1,15:30:23
0.214,0.257,-0.148,-12.0,-4.0,0.0,0.0,0.0015,-0.0033,-0.004,0,0,15:52:11
0.238,0.307,-0.145,-10.0,-7.0,0.0,0.0,0.0015,-0.0033,-0.004,0,0,15:52:19
"""


def written(path: Path, header: str, rows: object) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header.split(","))
        writer.writerows(rows)  # type: ignore[arg-type]
    return path


def clock(time_s: float) -> str:
    """Time of day, cut to a second; the log starts half a minute before midnight."""
    whole = int(86370 + time_s) % 86400
    return f"{whole // 3600:02}:{whole // 60 % 60:02}:{whole % 60:02}"


def write_transport(folder: Path) -> None:
    """A log of an object that slips by 12 mm, 3 mm beside its path, and the path as CSV and SVG.

    The path in the log begins after the object is carried, and ends before.
    """
    t, still = np.arange(0.0, 30.0, 0.5), np.zeros(60)
    x = 0.02 * np.clip(t - 5.0, 0.0, 20.0)
    object_x, path_x = x + 0.05 - 0.012 * np.clip(t - 15.0, 0.0, 1.0), np.clip(x + 0.05, 0.09, 0.35)
    header = "time,x,y,angle,object_x,object_y,object_angle,path_x,path_y"
    columns = (t, x, still, still, object_x, still + 0.003, still, path_x, still)
    written(folder / "transport.csv", header, np.column_stack(columns))
    written(folder / "path.csv", "x,y", [(0.0, 0.0), (0.6, 0.0)])
    (folder / "path.svg").write_text('<svg><path d="M0 0 h600"/></svg>', encoding="utf-8")


@pytest.mark.parametrize(("given", "left_mm"), [((), 12), (("--path", "path.csv"), 162)])
def test_an_object_that_is_carried_is_compared_with_its_path(
    run: Run, tmp_path: Path, given: tuple[str, ...], left_mm: int
) -> None:
    write_transport(tmp_path)
    code, out, err = run("replay", "transport.csv", "--robot", "2sra-v1", *given)
    assert (code, err) == (0, "")
    assert f"off its path mean 3.00 mm, worst 3.00 mm left of its path {left_mm} mm" in out
    assert "slip in the hand 12.00 mm at most" in out
    assert "carried 5.0 s to 25.0 s" in out


AGREEING = (2.0, 0.45, 0.0, 0.0)  # wheels that hardly slip while segment 1 bends


def wheel_log(
    folder: Path,
    drift: Drift,
    *,
    seconds: int = 6,
    lost: int = 0,
    wheels: tuple[float, ...] = (2.0, 0.0, 0.0, 0.0),
) -> tuple[Path, Array]:
    """Poses of both units in an image, while segment 1 is soft, and where the robot was."""
    q, path = np.zeros(5), []
    for _ in range(seconds * RATE_HZ):
        path.append(q)
        turned = np.array(wheels) / RATE_HZ
        q = rolling(ROBOT, (1, 0))(q, turned, drift).full().ravel()
    shape = robot_shape(ROBOT.geometry, np.array(path), 2)
    rows = []
    for i, (centres, ends) in enumerate(zip(shape.centres, shape.ends, strict=True)):
        poses = [
            [1e3 * x + 300, 200 - 1e3 * y, -math.degrees(angle)]
            for (x, y), angle in zip(centres, ends[:, 2], strict=True)
        ]
        if lost and i % lost == 1:
            poses[1] = [0, 0, 0.0]
        rows.append([i, clock(i / RATE_HZ), *poses[0], *poses[1]])
    return written(folder / "s1_v1_2.csv", POSES, rows), np.array(path)


def one_phase(log: MotionLog) -> PhaseReplay:
    (phase,) = replay(log, ROBOT)
    return phase


# --- reading -------------------------------------------------------------------------------------


def test_rows_of_a_log_are_put_where_they_belong(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text(f"{TRIAL}\n{TRIAL_1}")
    log = read_motion_log(path, ROBOT)
    assert not log.by_wheels
    assert log.q[2].tolist() == [0.217, 0.258, -0.094, -10.0, -11.0]
    assert log.commands[1].tolist() == [0.0090913, 0.0090634, 0.0, 0.0, 0.0]
    assert [log.mode[rows][0].tolist() for rows in log.phases] == [[1, 1], [0, 0]]
    first, second = replay(log, ROBOT)
    assert first.moved == pytest.approx([-0.022, -0.021, 0.131, 28.0, 11.0])
    assert first.split == pytest.approx(8.5 / 19.5)  # 44 %
    assert math.isnan(second.split)
    assert second.as_bent is None


def test_times_of_day_are_spread_over_their_seconds(tmp_path: Path) -> None:
    path, _ = wheel_log(tmp_path, Drift(), seconds=40)
    log = read_motion_log(path, ROBOT)
    assert np.diff(log.time_s) == pytest.approx(1 / RATE_HZ)  # over midnight, too


@pytest.mark.parametrize(
    ("columns", "factor", "doubt"),
    [
        (("x",), 1e3, "largest x_m = 239: 239 mm are"),
        (("angle",), math.degrees(1), "largest phi_rad = 12.8916: 12.8916 degrees are"),
        (("k1", "k2"), 1e-3, "38 1/mm are 38 1/m"),
        (("v1", "v2"), 1e3, "largest v1_m_s = 9.108: 9.108 mm/s are"),
        (("r0",), math.degrees(1), ""),
        (("time",), 1e3, "rows are 10 s apart; are these milliseconds"),
        (("time",), 1e6, "are these microseconds"),
        (("time",), 1e12, "are these milliseconds of a clock, or less"),
    ],
)
def test_a_trial_in_other_units_is_doubted_or_refused(
    columns: tuple[str, ...], factor: float, doubt: str, tmp_path: Path
) -> None:
    names, *rows = (line.split(",") for line in f"{TRIAL}\n{TRIAL_1}".strip().splitlines())
    for i, row in enumerate(rows):
        row[-1] = f"{(i + 5000 * (i > 2)) / 100}"
        for at in map(names.index, columns):
            row[at] = repr(float(row[at]) * factor)
    path = written(tmp_path / "trial.csv", ",".join(names), rows)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            read_motion_log(path, ROBOT)
            said = [str(each.message) for each in told]
        except InputError as error:
            said = [str(error)]
    assert bool(said) == bool(doubt)
    assert doubt in "".join(said)


def test_lost_frames_are_filled_in(tmp_path: Path) -> None:
    path, q = wheel_log(tmp_path, Drift(), lost=5)
    log = read_motion_log(path, ROBOT)
    q = q[5:-5]  # the smoothing rounds the ends off
    seen = log.q[5:-5] - log.q[0]
    assert seen[:, 3] == pytest.approx(q[:, 3] - log.q[0, 3], abs=0.2)
    assert seen[:, 2] == pytest.approx(q[:, 2], abs=5e-3)
    assert seen[:, 0] == pytest.approx(q[:, 0], abs=1e-3)


# --- replay --------------------------------------------------------------------------------------


def test_a_plan_driven_as_planned_is_predicted_to_the_end(tmp_path: Path) -> None:
    made = planned("paper-1")
    save_authors_csv(made, tmp_path / "plan.csv")
    phases = replay(read_motion_log(tmp_path / "plan.csv", made.robot), made.robot)
    driven = [phase for phase in phases if np.abs(phase.moved).max() > 1e-3]
    assert [phase.mode for phase in driven] == [phase.mode for phase in made.phases]
    for phase in driven:
        assert np.abs(phase.error[:3]).max() < 2e-4
        assert np.abs(phase.error[3:]).max() < 0.1
        if abs(phase.bend_rad[-1]) > LEAST_BEND_RAD:
            assert phase.share == pytest.approx(1.0, rel=0.01)
            assert phase.pivot_rad_per_rad == pytest.approx(0.0, abs=0.01)


def test_a_pivot_that_was_there_is_found(tmp_path: Path) -> None:
    path, _ = wheel_log(tmp_path, Drift(pivot_rad_per_rad=0.4), wheels=AGREEING)
    phase = one_phase(read_motion_log(path, ROBOT, wheel_rad_s=AGREEING, mode=(1, 0)))
    assert phase.pivot_rad_per_rad == pytest.approx(0.4, abs=0.02)
    assert phase.error_as_bent is not None
    assert phase.error_as_bent[2] == pytest.approx(0.4 * phase.bend_rad[-1], rel=0.05)
    assert phase.share == pytest.approx(1.0, rel=0.02)
    predicted, best, mean = phase.bend_rates_rad_s
    assert abs(predicted) <= abs(best) * 1.1
    assert mean == pytest.approx(phase.bend_rad[-1] / phase.time_s[-1], rel=0.05)


def test_a_wheel_that_turns_alone_drags_the_robot_round_as_it_did(tmp_path: Path) -> None:
    """A public stability log of the robot's authors (s1_v1_6.csv), every 24th frame, rounded.

    Wheel 1 turned at 6 rad/s, segment 1 was soft, all other wheels rested.
    """
    seen = np.array(
        [
            [0.127, -0.170, -1.567, 0.947, 0.0],
            [0.147, -0.168, -1.690, 8.389, 0.0],
            [0.169, -0.172, -1.886, 13.467, 0.0],
            [0.192, -0.189, -2.085, 17.019, 0.0],
            [0.207, -0.213, -2.257, 21.718, 0.0],
        ]
    )
    columns = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1, 0], (5, 1))
    rows = [[*q, *told, 1.17 * k] for k, (q, told) in enumerate(zip(seen, columns, strict=True))]
    log = read_motion_log(written(tmp_path / "log.csv", TRIAL, rows), ROBOT)
    turning = np.tile([6.0, 0.0, 0.0, 0.0], (5, 1))
    (phase,) = replay(dataclasses.replace(log, commands=turning), ROBOT)
    assert phase.error_as_bent is not None
    assert np.hypot(*phase.error_as_bent[:2]) < 0.15 * np.hypot(*phase.moved[:2])
    assert abs(phase.error_as_bent[2]) < 0.15 * abs(phase.moved[2])


def test_the_share_of_the_bend_is_found_at_any_speed_and_by_any_model(tmp_path: Path) -> None:
    path, _ = wheel_log(tmp_path, Drift(), wheels=AGREEING)
    told = read_motion_log(path, ROBOT, wheel_rad_s=(4.0, 0.9, 0.0, 0.0), mode=(1, 0))
    assert one_phase(told).share == pytest.approx(0.5, rel=0.1)
    spiral = with_path_model(ROBOT, "log_spiral")
    (phase,) = replay(told, spiral)
    limit = spiral.limits.curvature_per_m
    assert np.abs(phase.predicted[:, 3]).max() <= limit  # it stays where it reaches the limit
    assert phase.predicted[-1, 3] == phase.predicted[-2, 3] > 0.8 * limit
    assert phase.share < 0.2


@pytest.mark.parametrize("mode", [(1, 0), (0, 1), (1, 1)])
def test_where_wheels_that_do_not_slip_lead_is_told_by_commands_and_curvatures(
    tmp_path: Path, mode: tuple[int, int]
) -> None:
    """Row by row, backwards, too."""
    rng, step_s = np.random.default_rng([*mode, 9]), 1 / RATE_HZ
    done = np.zeros((120, 5))
    done[:, [0, 1]] = rng.normal(5e-4, 1e-3, (120, 1)) * [0.3, 0.7]
    start = np.array([0.1, 0.2, 0.3, -5.0, 10.0])
    q = roll_out(ROBOT, start, (mode,), done[None]).states[0]
    columns = np.hstack([np.vstack([done, done[-1:]]) / step_s, np.tile(mode, (121, 1))])
    rows = [[*q[k], *columns[k], k * step_s] for k in range(121)]
    path = written(tmp_path / "arcs.csv", TRIAL, rows)
    phase = one_phase(read_motion_log(path, ROBOT))
    assert (np.diff(phase.bend_rad) * phase.bend_rad[-1]).min() < 0
    assert phase.error_as_bent is not None
    assert np.abs(phase.error_as_bent).max() < 1e-4
    assert np.abs(phase.as_bent - q).max() < 1e-4  # all the way, not only at the end


# --- command -------------------------------------------------------------------------------------


def test_the_command_prints_and_draws(tmp_path: Path, run: Run) -> None:
    path, _ = wheel_log(tmp_path, Drift(0.8), wheels=AGREEING)
    told = "--wheels", ",".join(map(str, AGREEING)), "--mode", "1,0"
    code, out, err = run("replay", path.name, "--robot", "2sra-v1", *told, "--plot", "a.png")
    assert (code, err) == (0, "")
    assert "as bent" in out
    assert " 0.8" in out
    assert "Predicted from the wheel speeds logged, by 2sra-v1 (arc)." in out
    assert (tmp_path / "a.png").stat().st_size > 10_000
    code, out, _ = run("replay", path, "--robot", "2sra-v1", "--path-model", "log_spiral", "--json")
    document = json.loads(out)
    assert document["path_model"] == "log_spiral"
    (phase,) = document["phases"]
    assert phase["mode"] == [1, 0]
    assert phase["split"] is None
    assert phase["predicted_rad_s"] > 3 * phase["best_second_rad_s"]
    assert run("replay", path, "--robot", "2sra-v1", "--quiet") == (0, "", "")


GOOD = "0.2,0.2,0.1,1,2,0.01,0.01,0,0,0,1,1,10:00:00"


APART = [GOOD.replace("10:00:00", time_s) for time_s in ("0", "100", "200")]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,temp_C,mode\n1,2,heating\n", "column time = 'missing'"),
        (f"{TRIAL.replace('k2', 'k1')}\n", "column k1 = 'given twice'"),
        (f"{TRIAL}\n{GOOD}\n", "rows = 1 is not acceptable; allowed: at least 3"),
        (f"{TRIAL}\n{GOOD}\n{GOOD}\n{GOOD.replace('0.1,', 'nan,', 1)}\n", "angle, row 3 = 'nan'"),
        (f"{TRIAL}\n{GOOD}\n{GOOD[:20]}\n{GOOD}\n", "row 2 = ''"),
        (f"{TRIAL}\n{GOOD}\n{GOOD}\n{GOOD.replace('10:', '9:')}\n", "time, row 3 = '9:00:00'"),
        (f"{TRIAL}\n{GOOD}\n{GOOD}\n{GOOD.replace(':00:', '.')}\n", "time, row 3 = '10.00'"),
        (f"{TRIAL}\n{GOOD}\n{GOOD}\n{GOOD.replace(',1,1,', ',1,2,')}\n", "s2, row 3 = 2.0"),
        (f"{POSES}\n" + 3 * "0,10:00:00,1,1,90,0,0,0.0\n", "wheel_rad_s = None"),
        (f"{TRIAL}\n" + 3 * f"{GOOD.replace('10:00:00', '4.5')}\n", "after the row above it, 4.5"),
        (f"{TRIAL}\n" + "\n".join(APART), "allowed: one with two rows of one mode"),
    ],
)
def test_what_is_no_log_of_motion_is_refused_by_name(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_motion_log(path, ROBOT)
    assert words in str(error.value)
    assert "log.csv" in str(error.value)


def test_options_that_make_no_sense_are_refused_by_name(tmp_path: Path, run: Run) -> None:
    path, _ = wheel_log(tmp_path, Drift(), seconds=1)
    for option, value, words in (
        ("--wheels", "fast", "wheels = 'fast'"),
        ("--wheels", "1,2", "wheel_rad_s = [1.0, 2.0]"),
        ("--mode", "0,0", "mode = (0, 0)"),
        ("--mode", "1,2", "mode = '1,2'"),
        ("--path-model", "clay", "path.model = 'clay'"),
    ):
        code, _, err = run("replay", path, "--robot", "2sra-v1", option, value)
        assert code == 2
        assert words in err
    path.write_text(f"{POSES}\n" + 4 * "0,10:00:00,1,1,90,0,0,0.0\n")
    code, _, err = run("replay", path, "--robot", "2sra-v1")
    assert code == 2
    assert "LU2 = 'never seen'" in err
