"""Spoilt files of every kind, a few of each; ``python -m benchmarks files`` spoils more."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest
from PIL import Image

from benchmarks.files.mutations import MUTATIONS
from benchmarks.files.spoilt import KINDS, attacked
from twosra_mpc import InputError, files, load_problem, load_robot
from twosra_mpc.checking.plan_file import load_plan
from twosra_mpc.cli import main, planning
from twosra_mpc.errors import printable
from twosra_mpc.files import write_text
from twosra_mpc.lab.batch.problems import Problems
from twosra_mpc.lab.batch.spec import RandomSet, Spec
from twosra_mpc.lab.photographs.picture import read_photograph


@pytest.mark.parametrize("kind", KINDS)
def test_the_program_says_what_is_wrong_with_a_spoilt_file(kind: str) -> None:
    found = list(attacked(kind, range(1)))
    assert len(found) == len(MUTATIONS)
    assert [each for each in found if each is not None] == []


SPOILT = {
    "digits": ("x_m", "9" * 5000, "valid TOML"),
    "nested": ("x_m", "[" * 5000, "valid TOML"),
    "far": ("x_m", "150", "less than or equal to 100"),
    "tiny": ("time_limit_s", "1e-300", "at least 1e-12"),
    "control": ('"\\u001b[31m"', "1", r"\\x1b"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_what_no_computer_can_plan_with_is_refused_by_name(name: str, tmp_path: Path) -> None:
    key, value, allowed = SPOILT[name]
    path = tmp_path / "scenario.toml"
    table = f"[start]\n{key} = {value}\n" if key == "x_m" else f"{key} = {value}\n"
    path.write_text(f'robot = "2sra-v1"\n{table}', encoding="utf-8")
    with pytest.raises(InputError, match=allowed) as error:
        load_problem(path)
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 3000


def test_a_segment_that_is_never_called_liquid_is_refused_by_name() -> None:
    robot = load_robot("2sr-v2")
    segment = robot.thermal_segment(0).with_values(liquid_above_C=80.0)
    given = {"segments": (segment,) * 2} if robot.segments else {"segment": segment}
    with pytest.raises(InputError, match=r"liquid_above_C = 80.0 .* less than heater"):
        robot.with_values(**given)


def test_a_key_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text('{"format": "twosra-plan", "version": 2, "version": 3}', encoding="utf-8")
    with pytest.raises(InputError, match="the key 'version' is there twice"):
        load_plan(path)


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    built_in = Path(sys.modules["twosra_mpc"].__path__[0]) / "robots" / "2sra-v1.toml"
    path = tmp_path / "robot.toml"
    path.write_text(built_in.read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert load_robot(path) == load_robot("2sra-v1")


@pytest.mark.parametrize("sign", ["\x1b", "\x00", "\x9b", "\ud800"])
def test_a_name_is_text_that_every_screen_picture_and_file_can_hold(sign: str) -> None:
    """JSON can write half a character, of which no file of UTF-8 can be made."""
    problem = load_problem("pick-and-place")
    for named in (problem.objects[0], problem.obstacles[0], problem.tasks[0], problem.robot):
        assert named.with_values(name="工作台 \U0001f916") != named
        with pytest.raises(InputError, match=r"name = .* text without control characters"):
            named.with_values(name=f"a{sign}b")


def test_what_is_said_has_no_control_characters_and_an_end() -> None:
    assert printable("a\x1b[2J\x07") == "a\\x1b[2J\\x07"
    assert printable("x" * 1000, 10) == "xxxxxxxxxx..."
    error = InputError("start.x_m", list(range(10_000)), "one number")
    assert len(str(error)) < 200
    told = str(error.among([InputError(f"k{n}", n, "less") for n in range(40)])).splitlines()
    assert (len(told), told[-1]) == (14, "and 28 more")


@pytest.mark.parametrize("debug", [False, True])
def test_a_bug_is_called_one(
    debug: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("nobody foresaw this")

    monkeypatch.setattr(planning, "plan_until_interrupted", broken)
    with pytest.raises(SystemExit) as ended:
        main(["plan", "paper-1", *(["--debug"] if debug else [])])
    said = capsys.readouterr().err
    assert ended.value.code == 70
    assert "this is a bug (ZeroDivisionError: nobody foresaw this). Please report it" in said
    assert ("Traceback" in said) is debug


@pytest.mark.skipif(not Path("/proc/1").exists(), reason="who is alive is not known")
def test_what_a_killed_program_left_is_gone_with_the_next_write(tmp_path: Path) -> None:
    out, dead = tmp_path / "plan.json", tmp_path / ".plan.json-4194305"  # beyond all numbers
    alive, other = tmp_path / ".plan.json-1", tmp_path / ".plan.json-new"
    for path in (out, dead, alive, other):
        path.write_text("before")
    write_text(out, "now")
    assert out.read_text() == "now"
    assert set(tmp_path.iterdir()) == {out, alive, other}


def test_an_image_too_large_to_be_one_is_refused_quietly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    Image.new("L", (30, 40)).save(path := tmp_path / "shot.png")
    with pytest.raises(InputError, match=r"an image file .*DecompressionBombWarning"):
        read_photograph(path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no endless device")
def test_a_device_that_never_ends_is_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MOST_SIGNS", 1000)
    with pytest.raises(InputError, match="at most 1000 characters"):
        load_plan("/dev/zero")


def test_a_link_that_leads_round_in_a_circle_is_no_output(tmp_path: Path) -> None:
    (circle := tmp_path / "plan.json").symlink_to(circle)
    with pytest.raises(InputError, match="a path that leads to a file"):
        write_text(circle, "now")
    with pytest.raises(SystemExit) as ended:
        main(["plan", "paper-1", "--out", str(circle)])
    assert ended.value.code == 2
    assert circle.is_symlink()


@pytest.mark.parametrize("error", [NotImplementedError, InputError("file", 1, "a readable one")])
def test_an_interrupt_of_which_a_library_makes_an_error_is_one(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def swallowed(*_: object, **__: object) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise error from None

    monkeypatch.setattr(planning, "plan_until_interrupted", swallowed)
    with pytest.raises(SystemExit) as ended:
        main(["plan", "paper-1"])
    assert ended.value.code == 130
    assert "bug" not in capsys.readouterr().err


def test_two_outputs_need_two_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    both = str(tmp_path / "plan.json")
    with pytest.raises(SystemExit) as ended:
        main(["plan", "paper-1", "--out", both, "--csv", both])
    assert ended.value.code == 2
    assert "another file for each thing that is written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_name_too_long_for_a_file_is_the_name_of_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a file that exists"):
        load_robot("x" * 5000)
    random = RandomSet(
        robot="2sra-v1", seed=1, count=1, position_m=-0.0, heading_rad=0, curvature_per_m=1
    )
    assert len(list(random.ends(load_robot("2sra-v1")))) == 1
    spec = Spec(random=random.with_values(robot="x" * 5000))
    with pytest.raises(InputError, match="a file that exists"):
        Problems(spec, tmp_path)
