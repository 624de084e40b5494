"""What ``twosra reproduce`` is given: mistakes in it are named, and nothing is written half."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from conftest import Run
from test_reproduce import CURVATURES, PHOTOGRAPHS, lab, write_simulations

from twosra_mpc import InputError, load_robot
from twosra_mpc.lab.commands.reproduce_command import located
from twosra_mpc.lab.paper.photographs import folders_in
from twosra_mpc.lab.paper.published_tasks import SIMULATION_OF_TASK, read_simulations
from twosra_mpc.lab.reproduction.hardware import read_trials, trial_paths

__all__ = ["lab"]  # a fixture
Change = Callable[[Path], object]


@pytest.fixture
def data(lab: Path, tmp_path: Path) -> Path:
    """A copy of the laboratory's data to spoil."""
    return Path(shutil.copytree(lab, tmp_path / "data"))


def edit(name: str, old: str, new: str, count: int = 1) -> Change:
    def change(data: Path) -> object:
        text = (data / name).read_text(encoding="utf-8")
        assert old in text
        return (data / name).write_text(text.replace(old, new, count), encoding="utf-8")

    return change


def row_of(name: str, number: int, cells: str) -> Change:
    """Replace a row, counted from 1 below the heading."""

    def change(data: Path) -> object:
        lines = (data / name).read_text(encoding="utf-8").splitlines()
        lines[number] = cells
        return (data / name).write_text("\n".join(lines), encoding="utf-8")

    return change


LOG = "hardware/mine.csv"
PHOTOGRAPH = "curvature/left/shot-002.png"
REFERENCES = "curvature/left.csv"
MISTAKES: dict[str, tuple[Change, tuple[str, ...]]] = {
    "no log": (lambda d: (d / LOG).unlink(), ("hardware", "a folder with logs")),
    "log without a column": (edit(LOG, "k2", "k9"), ("mine.csv", "column k2 = 'missing'")),
    "log with a column twice": (edit(LOG, "k2", "k1"), ("mine.csv", "column k1 = 'given twice'")),
    "log with a word": (
        row_of(LOG, 3, ",".join(["0.2"] * 11 + ["red", "0.4"])),
        ("mine.csv", "s2, row 3 = 'red'"),
    ),
    "log whose time jumps": (
        row_of(LOG, 5, "0,0,0,0,0,0,0,0,0,0,0,1,0.01"),
        ("mine.csv", "time, row 5", "after the row above it"),
    ),
    "log that is no text": (
        lambda d: (d / LOG).write_bytes(b"\xff\xfe\x00"),
        ("mine.csv", "UTF-8"),
    ),
    "image that is none": (
        lambda d: (d / PHOTOGRAPH).write_text("no image"),
        ("shot-002.png", "an image file"),
    ),
    "folder without images": (
        lambda d: [path.unlink() for path in (d / "curvature/left").iterdir()],
        ("curvature/left", ".png"),
    ),
    "no folder of images": (
        lambda d: shutil.rmtree(d / "curvature/left"),
        ("curvature", "folders of photographs"),
    ),
    "no references": (lambda d: (d / REFERENCES).unlink(), ("left.csv", "beside the folder left")),
    "references without the column": (
        edit(REFERENCES, "k1", "k2"),
        ("left.csv", "column k1 = 'missing'"),
    ),
    "references with it twice": (
        edit(REFERENCES, "k1", "k1,k1"),
        ("left.csv", "column k1 = 'given twice'"),
    ),
    "reference that is no number": (
        edit(REFERENCES, str(CURVATURES[1]), "bent"),
        ("left.csv", "k1, row 1 = 'bent'"),
    ),
    "reference that is missing": (
        edit(REFERENCES, f"\n{CURVATURES[-1]}", ""),
        ("left.csv", "shot-004.png"),
    ),
}
SIMULATIONS = "published_simulations.csv"
MISTAKES_IN_SIMULATIONS: dict[str, tuple[Change, tuple[str, ...]]] = {
    "a column missing": (edit(SIMULATIONS, "sigma2", "s2"), ("column sigma2 = 'missing'",)),
    "a column twice": (edit(SIMULATIONS, "sigma2", "sigma1"), ("sigma1 = 'given twice'",)),
    "a word": (row_of(SIMULATIONS, 2, "7,1,0.2,bent,0,0,0,0,0"), ("y_m, row 2 = 'bent'",)),
    "a short row": (row_of(SIMULATIONS, 4, "7,1,0.2"), ("y_m, row 4 = ''",)),
    "nothing": (
        lambda d: (d / SIMULATIONS).write_text("", encoding="utf-8"),
        ("column case = 'missing'",),
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_in_data_are_named_and_leave_nothing(mistake: str, data: Path, run: Run) -> None:
    spoil, words = MISTAKES[mistake]
    spoil(data)
    code, out, err = run("reproduce", "--out", "paper", "--data", data, *PHOTOGRAPHS)
    assert (code, out) == (2, "")
    for each in words:
        assert each in err
    left = [path.name for path in Path("paper").rglob("*") if path.is_file()]
    # Whole figures before the mistake, if any.
    done = {"trials.png", "dtw.png"}
    assert set(left) <= (set() if spoil_is_in_logs(mistake) else done)


def spoil_is_in_logs(mistake: str) -> bool:
    return "log" in mistake


@pytest.mark.parametrize("mistake", MISTAKES_IN_SIMULATIONS)
def test_mistakes_in_simulations_are_named(mistake: str, data: Path) -> None:
    spoil, words = MISTAKES_IN_SIMULATIONS[mistake]
    spoil(data)
    with pytest.raises(InputError) as caught:
        read_simulations(data / SIMULATIONS)
    for each in (SIMULATIONS, *words):
        assert each in str(caught.value)


def test_simulations_of_other_tasks_are_left_out(tmp_path: Path) -> None:
    path = write_simulations(tmp_path / SIMULATIONS)
    assert list(read_simulations(path)) == ["paper-4"]
    edit(SIMULATIONS, "7,0,0.26,", "7,0,0.27,")(tmp_path)
    assert read_simulations(path) == {}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scale", 0), "scale_m = 0.0"),
        (("--scale", -0.005), "scale_m = -0.005"),
        (("--scale", "nan"), "scale_m"),
        (("--length", 0), "length_m = 0.0"),
        (("--towards", "37"), "two numbers"),
        (("--problems", 0), "problems = 0"),
        (("--data", "nowhere"), "hardware/ or curvature/"),
        (("--logs", "nowhere"), "nowhere"),
        (("--photographs", "nowhere"), "nowhere"),
        (("--simulations", "nowhere.csv"), "nowhere.csv"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_mistakes_in_options_are_named(
    options: tuple[Any, ...], words: str, run: Run, tmp_path: Path
) -> None:
    code, out, err = run("reproduce", "--out", "paper", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_report_needs_a_folder_that_can_be(run: Run, tmp_path: Path) -> None:
    code, _, err = run("reproduce", "--out", "nowhere/paper")
    assert code == 2
    assert "nowhere/paper" in err
    (tmp_path / "file").touch()
    assert run("reproduce", "--out", "file").code == 2


def test_an_interrupted_command_says_so(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twosra_mpc.lab.paper.reproduce", Mock(side_effect=KeyboardInterrupt))
    code, out, err = run("reproduce", "--out", "paper")
    assert (code, out) == (130, "")
    assert err == "twosra: interrupted before there was a result"


def test_clones_of_the_authors_repositories_are_read_as_they_are(data: Path) -> None:
    """Their layouts: trials and photographs in one, a file for each simulation in the other."""
    control, simulation = (data / f"2sr-agent-{name}" for name in ("control", "simulation"))
    (control / "ExpData" / "TempPhotos").mkdir(parents=True)
    (control / "Analysis").mkdir()
    (data / LOG).rename(control / "ExpData" / "mainExperiment1_1.csv")
    (control / "ExpData" / "unitsStabilityExp.csv").write_text("LU1 x\n0\n")
    for series in (path for path in (data / "curvature").iterdir() if path.is_dir()):
        named = series.name.capitalize()
        series.rename(control / "ExpData" / "TempPhotos" / named)
        references = data / "curvature" / f"{named.lower()}.csv"
        references.rename(control / "ExpData" / f"exp_{named.lower()}_curvature.csv")
    (simulation / "Data").mkdir(parents=True)
    for number, task in enumerate(("paper-4", "paper-2"), 1):
        run = SIMULATION_OF_TASK[task].run_freely()
        rows = np.column_stack([run.q, run.mode]).tolist()
        lines = ["x,y,phi,k1,k2,s1,s2", *(",".join(map(repr, row)) for row in rows)]
        (simulation / "Data" / f"simulation{number}.csv").write_text("\n".join(lines))
    found = read_simulations(simulation)
    assert set(found) == {"paper-2", "paper-4"}
    np.testing.assert_array_equal(
        found["paper-4"][:, :5], SIMULATION_OF_TASK["paper-4"].run_freely().q
    )
    assert [path.name for path in trial_paths(control)] == ["mainExperiment1_1.csv"]
    shutil.copy(control / "ExpData" / "mainExperiment1_1.csv", control / "Analysis" / "exp1.csv")
    once = [Path(log.source).stem for log in read_trials(control, load_robot("2sra-v1"))]
    assert once == ["exp1"]  # as the authors' copies, of which one counts
    assert all(references.is_file() for _, references in folders_in(control))
    assert len(folders_in(control)) == len(list((control / "ExpData" / "TempPhotos").iterdir()))
    for own in ("hardware", "curvature"):
        shutil.rmtree(data / own)
    (data / "published_simulations.csv").unlink(missing_ok=True)
    for name, place in (("logs", control), ("photographs", control), ("simulations", simulation)):
        assert located(data)[name] == place
