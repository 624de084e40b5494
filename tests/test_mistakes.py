"""Mistakes of a first hour: each is answered in a line or two, with what to write instead."""

from __future__ import annotations

import re
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from once import solved

from twosra_mpc import (
    InputError,
    Problem,
    Start,
    load_problem,
    load_robot,
    robot_names,
    scenario_names,
)
from twosra_mpc.errors import InputWarning
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.files import locate
from twosra_mpc.lab.batch.spec import RandomSet
from twosra_mpc.problem.goals import Goal
from twosra_mpc.robot.description import with_path_model

pytestmark = pytest.mark.filterwarnings("error::twosra_mpc.errors.InputWarning")

LONGEST = 260  # characters of a message without the list of what is known

SCENARIO = """\
robot = "2sra-v1"
time_limit_s = 5.0

[start]
x_m = 0.0
y_m = 0.0
phi_rad = 0.0
kappa_per_m = [0.0, 0.0]

[goal]
x_m = 0.1
y_m = 0.05
phi_rad = 0.5
kappa_per_m = [20.0, 10.0]
"""

# What is replaced in the scenario, by what, and what must be said of it.
EDITS: list[tuple[str, str, tuple[str, ...]]] = [
    # keys
    ("x_m = 0.1", "x = 0.1", ("goal.x = 0.1", "did you mean x_m?")),
    ("phi_rad = 0.0", "theta = 0.0", ("start.theta", "did you mean phi_rad?")),
    ("phi_rad = 0.5", "heading = 0.5", ("goal.heading", "did you mean phi_rad?")),
    ("phi_rad = 0.5", "phi_deg = 90", ("goal.phi_deg = 90", "did you mean phi_rad = 1.571?")),
    ("x_m = 0.1", "x_mm = 100", ("goal.x_mm = 100", "did you mean x_m = 0.1?")),
    ("kappa_per_m = [0.0, 0.0]", "kappa = [0.0, 0.0]", ("start.kappa", "mean kappa_per_m?")),
    ("kappa_per_m = [20.0, 10.0]", "curvature = [1.0, 2.0]", ("mean kappa_per_m?",)),
    (
        "[goal]",
        "temperature = [25.0, 25.0]\n[goal]",
        ("start.temperature =", "did you mean temperature_C?"),
    ),
    ("[goal]", "[target]", ("target", "did you mean goal?", "goal is missing")),
    ("[start]", "[Start]", ("Start", "did you mean start?", "start is missing: this key is")),
    ("[goal]", "[gaol]", ("did you mean goal?",)),
    ("robot =", "Robot =", ("did you mean robot?", "robot is missing")),
    ("phi_rad = 0.0\n", "", ("start.phi_rad is missing", "heading", "[rad]")),
    ("kappa_per_m = [0.0, 0.0]\n", "", ("start.kappa_per_m is missing", "curvatures", "[1/m]")),
    ('robot = "2sra-v1"\n', "", ("robot is missing", "a built-in name, a path to its file")),
    ("[goal]", "[start.goal]", ("start.goal", "goal of the file itself", "goal is missing")),
    ("kappa_per_m = [20.0, 10.0]", "gap = 0.02", ("goal.gap", "before the first [table]")),
    ("time_limit_s = 5.0", "time_limit = 5.0", ("did you mean time_limit_s?",)),
    ("time_limit_s = 5.0", "limit_time_s = 5.0", ("did you mean time_limit_s?",)),
    ("time_limit_s = 5.0", "time_limit_min = 2", ("did you mean time_limit_s = 120?",)),
    ("time_limit_s = 5.0", "waypoints = []", ("did you mean tasks?",)),
    ("x_m = 0.1\n", "[goal.goal]\n", ("goal.goal", "known keys here are")),
    # words
    ("[20.0, 10.0]", '[20.0, "any"]', ("goal.kappa_per_m.1 = 'any'", 'did you mean "free"?')),
    ("[20.0, 10.0]", '["FREE", 10.0]', ("goal.kappa_per_m.0 = 'FREE'", 'did you mean "free"?')),
    ("[0.0, 0.0]", '["free", 0.0]', ("start.kappa_per_m.0", "this one cannot be free")),
    ("x_m = 0.1", 'x_m = "free"', ("goal.x_m = 'free'", "leave the key out")),
    ("[goal]\n", '[goal]\ntolerance = "none"\n', ("goal.tolerance", 'did you mean "exact"?')),
    ("[goal]\n", "[goal]\ntolerance = 0.001\n", ("goal.tolerance = 0.001", '"exact", or a table')),
    ("[goal]\n", '[goal]\nmode = ["soft", "rigid"]\n', ("goal.mode.0", "1: soft, 0: rigid")),
    ("time_limit_s", 'planner = "Optimal"\ntime_limit_s', ("planner", "did you mean optimal?")),
    ("time_limit_s", 'timing = "constants"\ntime_limit_s', ("timing", "did you mean constant?")),
    ("time_limit_s", 'heating = "warm"\ntime_limit_s', ("heating", "'keep_warm'")),
    ("2sra-v1", "2sra", ("robot = '2sra'", "did you mean 2sra-v1?")),
    ("2sra-v1", "2SRA-V1", ("robot = '2SRA-V1'", "did you mean 2sra-v1?")),
    ("2sra-v1", "robots/mine.toml", ("robots/mine.toml", "taken from the scenario's folder")),
    ('robot = "2sra-v1"', 'robot = "2sra-v1"\nobstacles = ["wall"]', ("polygon_m, box, disc",)),
    # words for tables, lists and numbers
    ('robot = "2sra-v1"', "robot = 3", ("a built-in name, a path to its file",)),
    ("[goal]\n", '[goal]\nmode = "[1,0]"\n', ("did you mean [1,0], without quotes?",)),
    ("time_limit_s", 'modes = ["soft"]\ntime_limit_s', ("modes.0 = 'soft'", "stiffness modes")),
    ("[20.0, 10.0]", "(20.0, 10.0)", ("lists stand in brackets",)),
    ("phi_rad = 0.5", "phi_rad = pi/2", ("line 13", "written out, as in 1.571")),
    ("phi_rad = 0.5", 'phi_rad = "-pi / 2"', ("did you mean -1.571, written out?",)),
    ("[goal]\n", "[goal]\nx_m = 3\n", ("line 12 is 'x_m = 0.1': that stands above already",)),
    ("time_limit_s", 'gap = "1 %"\ntime_limit_s', ("did you mean 0.01, a bare number?",)),
    (
        "kappa_per_m = [20.0, 10.0]",
        "kappa_per_mm = [0.02, 0.01]",
        ("did you mean kappa_per_m = [20, 10]?",),
    ),
    ("kappa_per_m = [20.0, 10.0]", "radius_m = 0.05", ("did you mean kappa_per_m, one over",)),
    ("[20.0, 10.0]", '["rigid", 10.0]', ("a segment is straight at 0; modes say",)),
    # numbers
    ("x_m = 0.1", "x_m = 150", ("goal.x_m = 150", "150 mm are 0.15 m", "equal to 100 m")),
    ("x_m = 0.1", 'x_m = "0.1"', ("goal.x_m", "did you mean 0.1, without quotes?")),
    ("x_m = 0.1", 'x_m = "0,1"', ("goal.x_m", "did you mean 0.1, without quotes?")),
    ("x_m = 0.1", 'x_m = "5 deg"', ("goal.x_m", "numbers have no unit. allowed: a number in m")),
    ("x_m = 0.1", 'x_m = "100 mm"', ("goal.x_m", "did you mean 0.1, a bare number?")),
    ("x_m = 0.1", "x_m = [0.1]", ("goal.x_m", "did you mean 0.1, without brackets?")),
    ("x_m = 0.1", "x_m = true", ("goal.x_m = True", "number in m")),
    ("[20.0, 10.0]", "20.0", ("goal.kappa_per_m = 20.0", "did you mean a list, e.g. [20.0, 20.0]")),
    ("[20.0, 10.0]", "[20.0]", ("goal.kappa_per_m.1 is missing: a value for segment 2",)),
    ("[20.0, 10.0]", "[20, 5, 10, 5]", ("goal.kappa_per_m", "a list of 2 values, one for each")),
    ("[20.0, 10.0]", "[200.0, 10.0]", ("goal.kappa_per_m.0 = 200.0", "from -78.5 to 78.5 1/m")),
    ("[goal]", "temperature_C = [298.15, 298.15]\n[goal]", ("298.15 K are 25 degrees C",)),
    ("time_limit_s = 5.0", "gap = 5", ("gap = 5", "5 % are 0.05: did you mean 0.05?")),
    ("time_limit_s = 5.0", "time_limit_s = -1", ("time_limit_s = -1", "greater than 0 s")),
    # TOML
    ("x_m = 0.1", "x_m = 0,1", ("line 11 is 'x_m = 0,1'", "a decimal point")),
    ('"2sra-v1"', "2sra-v1", ("line 1", 'words stand in quotes, as in robot = "2sra-v1"')),
    ("x_m = 0.1", "x_m: 0.1", ("line 11", "this looks like YAML", "[start]")),
    ("[start]", "[start", ("line 4", "a table begins with its name in brackets")),
    ("x_m = 0.1", "x_m = 100 mm", ("line 11", "numbers have no unit: it stands in the key")),
    ("x_m = 0.1", "x_m =", ("line 11", "a value is missing after =")),
    ("x_m = 0.1", "phi_modulo = True", ("line 11", "true and false are written small")),
    (SCENARIO, "", ("a scenario; this file is empty", "twosra new scenario NAME")),
]

# Legal numbers that are planned with, and probably in another unit.
DOUBTS = [
    ("phi_rad = 0.5", "phi_rad = 90", ("goal.phi_rad = 90", "90 degrees are 1.571 rad")),
    ("[20.0, 10.0]", "[0.03, 0.02]", ("goal.kappa_per_m", "0.03 1/mm are 30 1/m")),
    ("x_m = 0.1", "x_m = 24", ("goal.x_m = 24", "24 mm are 0.024 m")),
    ("time_limit_s", "clearance_m = 2\ntime_limit_s", ("clearance_m = 2", "0.002 m")),
    ("[goal]\n", "[goal]\ntolerance = { phi_rad = 5 }\n", ("goal.tolerance.phi_rad", "0.08727")),
]
ROBOT_DOUBTS = [
    ("end_link_m = ", "end_link_m = 33 #", ("geometry.end_link_m = 33", "33 mm are 0.033 m")),
    ("cooling_time_constant_s = ", "cooling_time_constant_s = 2 #", ("2 minutes are 120 s",)),
    ("unit_speed_m_s = ", "unit_speed_m_s = 30 #", ("30 mm/s are 0.03 m/s",)),
    ("current_max_A = ", "current_max_A = 900 #", ("900 mA are 0.9 A",)),
    ("temperature_max_C = ", "temperature_max_C = 358 #", ("358 K are 84.85 degrees C",)),
]

JOG = "jog --robot 2sra-v1 --dry-run"
COMMANDS: list[tuple[str, tuple[str, ...]]] = [
    ("plan robot.toml", ("this is a robot file, for twosra check-robot, or --robot",)),
    ("check-robot mine.toml", ("this is a scenario file, for twosra plan",)),
    ("verify mine.toml", ("this is a scenario file, for twosra plan",)),
    ("verify robot.toml", ("this is a robot file",)),
    ("plan paper-1 --robot mine.toml", ("this is a scenario file",)),
    ("plan batch.toml", ("this is a batch file, for twosra batch",)),
    ("plan folder", ("scenario = 'folder'", "this is a folder")),
    ("plan mine", ("scenario = 'mine'", "did you mean mine.toml?")),
    ("plan Doorway", ("did you mean doorway?",)),
    ("plan picture.png", ("UTF-8 text",)),
    ("paln paper-1", ("Did you mean plan?",)),
    ("plan paper-1 --robots 3sra", ("--robot",)),
    ("plan paper-1 --path-model arcs", ("path.model = 'arcs'", "did you mean arc?")),
    ("plan paper-1 --timing papr", ("timing = 'papr'", "did you mean paper?", "nominal, constant")),
    ("simulate paper-1 --disturbance Hard", ("disturbance", "did you mean hard?", "none, mild")),
    ("simulate paper-1 --plant arcs", ("plant = 'arcs'", "did you mean arc?")),
    ("plan paper-1 --gap 1%", ("'--gap'", "'1%'", "did you mean 0.01?")),
    ("plan paper-1 --gap -1", ("gap = -1.0", "allowed: greater than or equal to 0")),
    ("verify none.json", ("file = 'none.json'", "allowed: a file that exists")),
    ("plan paper-1 --gap 0,01", ("'--gap'", "did you mean 0.01?")),
    ("plan paper-1 --time-limit 2min", ("'--time-limit'", "did you mean 120?")),
    ("plan paper-1 --max-phases 2.5", ("'--max-phases'", "Give a whole number.")),
    ("simulate paper-1 --seed one", ("'--seed'", "Give a whole number.")),
    ("plan paper-1 paper-2", ("One scenario at a time; twosra batch plans many.",)),
    ("plan paper-1 --out plan.xml", ("plan.xml", "a file ending in .json")),
    ("report plan.json -o report.html", ("OUT stands last, without an option", "report.html")),
    ("plan 2sra-v1", ("this is one of the robots",)),
    ("plan paper-1 --proof --planner greedy", ("--proof", "the greedy rule has none")),
    ("plan log.csv", ("this looks like a table (CSV)",)),
    ("plan map.json", ("this is a GeoJSON file, for obstacles = of a scenario",)),
    ("verify paper-1", ("twosra plan paper-1 --out plan.json",)),
    ("plan paper-1 --gap 5", ("gap = 5.0", "5 % are 0.05")),
    ("help", ("Type twosra --help, or twosra COMMAND --help.",)),
    ("version", ("Type twosra --version.",)),
    ("animate paper-1 film.gif", ("twosra plan paper-1 --out plan.json",)),
    ("check_robot x", ("Did you mean check-robot?",)),
    ("xyzzy", ("No such command 'xyzzy'",)),
    ("verify", ("Missing argument",)),
    ("schema run", ("'scenario', 'robot', 'plan'",)),
    ("plan rigid-move --rate 20", ("--rate is the rate of --csv, which is not given",)),
    ("plan rigid-move --csv a.csv --rate fast", ("--rate", "fast")),
    ("plan rigid-move --planner best", ("--planner", "best", "greedy")),
    ("simulate paper-1 --broken-heater 3", ("broken_heaters", "3", "segments 1 and 2")),
    ("simulate paper-1 --executor best", ("--executor", "best")),
    ("simulate paper-1 --runs 0", ("--runs", "0")),
    ("simulate paper-1 --seed -1", ("Invalid value for '--seed'",)),
    ("simulate paper-1 --animate a.png", ("output = 'a.png'", ".gif or .mp4")),
    ("simulate paper-1 --plot a.gift", ("output = 'a.gift'", ".png")),
    ("simulate paper-1 --out missing/a.json", ("output = 'missing/a.json'", "folder")),
    ("compare", ("SCENARIO",)),
    ("compare paper-1 paper-9", ("scenario = 'paper-9' is not acceptable",)),
    ("compare paper-1 --gap -1", ("gap",)),
    ("compare paper-1 --plot a.docx", ("a file ending in",)),
    ("compare paper-1 --plot nowhere/a.png", ("a folder that exists and can be written",)),
    ("resample plan.json a.csv", ("--rate",)),
    ("resample plan.json a.csv --rate 0", ("rate = 0.0", "at most 1000 Hz")),
    ("resample plan.json a.csv --rate fast", ("--rate", "fast")),
    ("resample plan.json a.txt --rate 1", ("output = 'a.txt'", ".csv or .json")),
    ("resample plan.json no/a.csv --rate 1", ("output = 'no/a.csv'", "folder")),
    ("resample plam.json a.csv --rate 1", ("plam.json", "a file that exists")),
    ("export plan.json plan.bag", ("allowed: a file ending in .mcap or .csv",)),
    ("export plan.json no/plan.mcap", ("a path in a folder that exists and can be written",)),
    ("export none.json plan.mcap", ("none.json",)),
    ("export plan.json plan.csv --rate 0", ("rate = 0.0 is not acceptable",)),
    ("animate plan.json plan.avi", ("a file ending in .gif or .mp4",)),
    ("animate plan.json nowhere/plan.gif", ("a folder that exists and can be written",)),
    ("animate absent.json plan.gif", ("file = 'absent.json' is not acceptable",)),
    ("animate plan.json plan.gif --seconds 0", ("'--seconds'",)),
    ("animate plan.json plan.gif --seconds nan", ("Invalid value for '--seconds'",)),
    ("import-map map.yaml --tolerance nan", ("Invalid value for '--tolerance'",)),
    ("report missing.json out.html", ("file = 'missing.json' is not acceptable",)),
    ("report plan.json out.pdf", ("a file ending in .html or .htm",)),
    ("report plan.json nowhere/out.html", ("a folder that exists and can be written",)),
    ("report plan.json folder.html", ("the path of a file, not of a folder",)),
    ("stream plan.json", ("port or dry-run = 'neither' is not acceptable",)),
    ("stream plan.json --dry-run --port x", ("port or dry-run = 'both' is not acceptable",)),
    ("stream plan.json --port /dev/no-such-port", ("port = '/dev/no-such-port' is not",)),
    ("stream plan.json --dry-run --log run.json", ("--dry-run sends nothing",)),
    ("stream plan.json --dry-run --rate 300", ("rate = 300.0", "allowed: from 1 to 200")),
    ("stream plan.json --dry-run --rate nan", ("rate_Hz = nan is not acceptable",)),
    ("stream plan.json --dry-run --robot-id -1", ("Invalid value for '--robot-id'",)),
    ("stream plan.json --dry-run --confirm maybe", ("Invalid value for '--confirm'",)),
    (f"{JOG} --forward 0.06 --for 1", ("at most limits.speed_m_s of the robot, 0.05 m/s",)),
    (f"{JOG} --turn -0.4 --for 1", ("at most limits.turn_rate_rad_s of the robot, 0.3",)),
    (f"{JOG} --wheel 2 11 --for 1", ("wheel 2 = 11.0 is not acceptable",)),
    (f"{JOG} --wheel 5 1 --for 1", ("Invalid value for '--wheel'",)),
    (f"{JOG} --forward nan --for 1", ("speed = nan is not acceptable",)),
    (f"{JOG} --heat 3 --for 1", ("heat = 3 is not acceptable; allowed: a segment from 1",)),
    (f"{JOG} --forward 0.01 --for 0", ("for = 0.0 is not acceptable",)),
    (f"{JOG} --wheel 1 1", ("for = None is not acceptable",)),
    ("jog --robot 2sra-v1 --port /dev/no-such-port", ("keys need a terminal",)),
]

HERE = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
PYTHON: list[tuple[Callable[[], object], tuple[str, ...]]] = [
    (
        lambda: Problem(robot="2sra-v1", start=[0, 0, 0, 0, 0], goal={"x_m": 0.1}),
        ("start = [0, 0, 0, 0, 0]", "give every value its key, e.g. x_m = 0.1"),
    ),
    (
        lambda: Problem(robot="2sra-v1", start=HERE, goal=np.zeros(5)),
        ("goal", "give every value its key"),
    ),
    (lambda: Problem(robot="2sra-v1", start=Start(**HERE)), ("goal is missing",)),
    (lambda: Start(x=0.0, **HERE), ("x = 0.0", "did you mean x_m?")),
    (lambda: Start(0.0, 0.0, 0.0, (0.0, 0.0)), ("Start(x_m=..., y_m=...,",)),  # type: ignore[misc]
    (
        lambda: Problem(robot="2sra-v1", start=Goal(x_m=0.1), goal=Goal(x_m=0.1)),
        ("this is a Goal, and a Start is meant",),
    ),
    (lambda: Goal(x_m="0.1"), ("did you mean 0.1, without quotes?",)),
    (lambda: Goal(kappa_per_m=(1.0, "any")), ('did you mean "free"?',)),
    (lambda: disturbance_level("medium"), ("disturbance = 'medium'", "none, mild, moderate")),
    (lambda: with_path_model(load_robot("2sra-v1"), "Arc"), ("did you mean arc?",)),
    (lambda: load_problem({"robot": "2sra-v1"}), ("Problem(**table)",)),  # type: ignore[arg-type]
]


def assert_helpful(said: str, words: tuple[str, ...]) -> None:
    """It says these words, in at most three short lines."""
    for word in words:
        assert word in said, said
    assert "Traceback" not in said
    lines = said.splitlines()
    assert len(lines) <= 4, said
    listed = r"known keys here are .*|allowed: .*one of .*|a built-in .*"
    assert all(len(re.sub(listed, "", line)) <= LONGEST for line in lines), said
    assert not re.search("pydantic|validation error|NoneType|<class|object at", said)


@pytest.fixture(autouse=True)
def there(tmp_path: Path) -> None:
    """Files that a beginner has around."""
    (tmp_path / "mine.toml").write_text(SCENARIO)
    robot = locate("2sra-v1", "robots", "robot").read_text(encoding="utf-8")
    (tmp_path / "robot.toml").write_text(robot.replace('"2sra-v1"', '"mine"'))
    (tmp_path / "log.csv").write_text("time_s,temperature_C\n0,25\n")
    (tmp_path / "map.json").write_text('{"type": "FeatureCollection", "features": []}')
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.html").mkdir()
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n")
    (tmp_path / "batch.toml").write_text("[random]\nseed = 0\n[grid]\n")


@pytest.mark.parametrize(("old", "new", "words"), EDITS)
def test_a_slip_in_a_scenario_is_answered_with_what_to_write(
    old: str, new: str, words: tuple[str, ...], run_as_is: Run, tmp_path: Path
) -> None:
    assert old in SCENARIO
    (tmp_path / "mine.toml").write_text(SCENARIO.replace(old, new, 1), encoding="utf-8")
    code, out, err = run_as_is("plan", "mine.toml")
    assert (code, out) == (2, "")
    assert_helpful(err, words)
    assert "mine.toml" in err


@pytest.mark.parametrize(("command", "words"), COMMANDS)
def test_a_slip_at_the_prompt_is_answered_with_what_to_type(
    command: str, words: tuple[str, ...], run_as_is: Run, tmp_path: Path
) -> None:
    solved("rigid-move").save(tmp_path / "plan.json")
    before = sorted(tmp_path.iterdir())
    code, out, err = run_as_is(*command.split())
    assert (code, out) == (2, "")
    assert_helpful(err, words)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(("make", "words"), PYTHON)
def test_a_slip_in_python_is_answered_with_what_to_write(
    make: Callable[[], object], words: tuple[str, ...]
) -> None:
    with pytest.raises(InputError) as error:
        make()
    assert_helpful(str(error.value), words)


@pytest.mark.parametrize(("old", "new", "words"), DOUBTS)
def test_a_number_in_another_unit_is_planned_with_and_doubted(
    old: str, new: str, words: tuple[str, ...], run_as_is: Run, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text(SCENARIO.replace(old, new, 1), encoding="utf-8")
    code, out, err = run_as_is("plan", "mine.toml", "--quiet", "--work-limit", "1")
    assert code in (0, 3, 4), err
    assert out == ""
    assert err.startswith("twosra: warning: mine.toml: ")
    assert_helpful(err, (*words, "did you mean"))
    with pytest.warns(InputWarning, match="did you mean") as told:
        problem = load_problem(tmp_path / "mine.toml")
    assert [str(each.message) for each in told] == [
        f"{tmp_path / 'mine.toml'}: {doubt}" for doubt in problem.unit_doubts
    ]
    document = tomllib.loads((tmp_path / "mine.toml").read_text(encoding="utf-8"))
    for make in (lambda: Problem(**document), lambda: problem.with_values(max_phases=3)):
        with pytest.warns(InputWarning) as told:
            make()
        assert [str(each.message) for each in told] == [*problem.unit_doubts]
        assert {each.filename for each in told} == {__file__}, "the line of whoever made it"


@pytest.mark.parametrize(("old", "new", "words"), ROBOT_DOUBTS)
def test_a_number_of_a_robot_in_another_unit_is_doubted_or_refused(
    old: str, new: str, words: tuple[str, ...], run_as_is: Run, tmp_path: Path
) -> None:
    text = (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "robot.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    code, _, err = run_as_is("check-robot", "robot.toml")
    assert code in (0, 2), err
    for word in words:
        assert word in err
    assert len(err.splitlines()) == 1, err


def test_no_problem_that_is_right_is_doubted() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in scenario_names():
            assert load_problem(name).unit_doubts == ()
        for name in robot_names():
            load_robot(name)
        robot = load_robot("2sra-v1")
        wide = {"x_m": (-100.0, 100.0), "y_m": (-100.0, 100.0)}
        ends = {"start": load_problem("corridor").start, "goal": {"x_m": 0.2}}
        given = {"robot": robot, **ends, "workspace": wide}
        assert Problem.parse(given, "mine").unit_doubts == ()
        for ranges in ((0.3, 3.14, 70.0), (4.0, 6.28, 40.0), (0.01, 0.1, 1.0)):
            names = ("position_m", "heading_rad", "curvature_per_m")
            drawn = RandomSet(
                robot="2sra-v1", seed=3, count=300, **dict(zip(names, ranges, strict=True))
            )
            for start, goal in drawn.ends(robot):
                assert Problem(robot=robot, start=start, goal=goal).unit_doubts == ()
