"""``twosra reproduce``: verdicts by rules, and a small report."""

from __future__ import annotations

import csv
import json
import math
import shlex
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from test_cli_output import examples
from test_docs import few_runs
from test_report import Page

from benchmarks.files.photographs import LENGTH_M, SCALE_M, camera, write_folder
from twosra_mpc import effort, load_problem
from twosra_mpc.lab.paper import (
    Claim,
    Reading,
    Sources,
    Verdict,
    applications,
    published_tasks,
    reproduce,
    statistics,
    unit_paths,
)
from twosra_mpc.lab.paper.paper_report import NUMBERS, PAGE
from twosra_mpc.lab.paper.section import PAPER, every
from twosra_mpc.lab.reproduction.published_runs import SIMULATIONS

CURVATURES = [0.0, -20.0, -45.0, -30.0, -2.0]
PHOTOGRAPHS = ("--scale", SCALE_M, "--length", LENGTH_M, "--towards", "39,35")
SMALL = ("--problems", 4)
TRIAL = 4
PAUSE_S = 300.0
HEADER = ("x", "y", "angle", "k1", "k2", "v1", "v2", "u0", "v0", "r0", "s1", "s2", "time")


# --- verdicts ------------------------------------------------------------------------------------


def verdicts(*ours: float | None) -> Claim:
    return Claim("so", "here", tuple(Reading("it", 1.0, one, "", 0.1, 0.5) for one in ours))


@given(st.floats(-5, 5), st.floats(0, 2), st.floats(0, 2), st.floats(1, 3))
def test_what_is_farther_off_has_no_better_verdict(
    off: float, holds: float, more: float, farther: float
) -> None:
    order = list(Verdict)
    for sense in ("equal", "at most", "at least"):
        near, far = (
            Reading("", 2.0, 2.0 + x, "", holds, holds + more, sense) for x in (off, farther * off)
        )
        if sense == "equal" or (off > 0) == (sense == "at most"):
            assert order.index(near.verdict) <= order.index(far.verdict)
        else:  # on the side that does not count
            assert near.verdict == far.verdict == Verdict.HOLDS


def test_verdicts_change_where_the_rule_says() -> None:
    found = [verdicts(one).verdict for one in (1.0, 1.1 - 1e-9, 1.11, 1.49, 1.51, float("nan"))]
    assert found == [Verdict.HOLDS] * 2 + [Verdict.CAVEAT] * 2 + [Verdict.FAILS] * 2
    assert verdicts(1.0).readings[0].rule == "up to 0.1 off; with a caveat up to 0.5 off"
    assert every("", 0.8).verdict == Verdict.CAVEAT
    assert every("", 0.79).verdict == Verdict.FAILS
    assert every("", 1.0).rule == "not below; with a caveat up to 20 % below"
    assert Reading("", 1.0, 1.0, "m", 0.5, 0.5, "at most").rule == "up to 0.5 m above"


def test_readings_that_differ_are_a_caveat_and_those_without_data_do_not_count() -> None:
    assert verdicts(1.0, 1.0, None).verdict == Verdict.HOLDS
    assert verdicts(1.0, 9.0).verdict == Verdict.CAVEAT
    assert verdicts(9.0, 9.0).verdict == Verdict.FAILS
    assert verdicts(None, None).verdict == Verdict.UNCHECKED


# --- parts that are kept -------------------------------------------------------------------------


def test_a_claim_whose_plan_was_not_found_is_undecided_and_says_why(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(effort, "OVERTIME", 0)
    monkeypatch.setattr(applications, "load_problem", partial(load_problem, work_limit=1.0))
    data = applications.compute(tmp_path, lambda _: None)
    told = applications.section(data)
    assert [claim.verdict for claim in told.claims] == [Verdict.UNDECIDED] * len(data)
    assert all("raise work_limit" in claim.note for claim in told.claims)
    assert not told.pictures
    assert not list(tmp_path.iterdir())


# --- a small report ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def quick() -> Iterator[None]:
    """Draw little where figures have tests of their own; the longer mission is left out."""
    with pytest.MonkeyPatch.context() as patch:
        draw_little(patch)
        patch.setattr(applications, "SCENARIOS", {"conform-cylinder": "conform to a cylinder"})
        yield


def draw_little(patch: pytest.MonkeyPatch) -> None:
    """Let the report's figures be blank."""
    for module, name in (
        (published_tasks, "plot_published_tasks"),
        (published_tasks, "plot_error_decrease"),
        (unit_paths, "plot_paths"),
        (applications, "plot_plan"),
        (statistics, "plot_forward_kinematics"),
    ):
        patch.setattr(module, name, lambda *given: Figure(figsize=(1, 1)).savefig(given[-1]))


def write_log(path: Path, columns: tuple[str, ...] = HEADER) -> Path:
    """A trial that does as simulated, 15 rows a second, with a pause between its phases."""
    run = SIMULATIONS[TRIAL].run()
    modes = np.vstack([run.mode[1], run.mode[1:]])
    waited = PAUSE_S * np.cumsum(np.append(0, np.any(np.diff(modes, axis=0), axis=1)))
    time_s = np.arange(len(run.q)) / 15.0 + waited
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for q, v, mode, t in zip(run.q, run.velocity, modes, time_s, strict=True):
            writer.writerow([*q, *v, *mode, t])
    return path


def write_simulations(path: Path) -> Path:
    run = SIMULATIONS[TRIAL].run()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*published_tasks._COLUMNS[:1], "row", *published_tasks._COLUMNS[1:]])
        for row, (q, mode) in enumerate(zip(run.q, run.mode, strict=True)):
            writer.writerow([7, row, *q, *mode])
    return path


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, photographs with references, and a simulation."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "hardware").mkdir()
    write_log(folder / "hardware" / "mine.csv")
    (folder / "curvature").mkdir()
    write_folder(folder / "curvature" / "left", CURVATURES)
    rows = "\n".join(["k1", *map(str, CURVATURES)])
    (folder / "curvature" / "left.csv").write_text(rows, encoding="utf-8")
    write_simulations(folder / "published_simulations.csv")
    return folder


@pytest.fixture(scope="module")
def written(quick: None, lab: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a report with data, by the library."""
    folder = tmp_path_factory.mktemp("report") / "paper"
    reproduce(folder, sources_in(lab), problems=4)
    return folder


def sources_in(lab: Path) -> Sources:
    paths = (lab / name for name in ("hardware", "curvature", "published_simulations.csv"))
    return Sources(*paths, camera=camera((39.0, 35.0)))


def numbers(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / NUMBERS).read_text(encoding="utf-8"))
    return found


def claims(folder: Path) -> dict[str, dict[str, Any]]:
    return {one["claim"]: one for one in numbers(folder)["claims"]}


def test_every_claim_has_a_verdict_that_follows_from_its_numbers(written: Path) -> None:
    document = numbers(written)
    assert sum(document["verdicts"].values()) == len(document["claims"]) > 25
    fields = ("words", "published", "ours", "unit", "holds", "caveat", "sense")
    for one in document["claims"]:
        readings = tuple(Reading(**{name: r[name] for name in fields}) for r in one["readings"])
        assert Claim(one["claim"], one["where"], readings).verdict == one["verdict"]
        for reading, saved in zip(readings, one["readings"], strict=True):
            assert (reading.verdict, reading.rule) == (saved["verdict"], saved["rule"])
            assert reading.difference == saved["difference"]


def test_table_i_is_found_again_but_for_a_sign(written: Path) -> None:
    found = claims(written)
    assert found["Parameters of spiral I"]["verdict"] == "holds"
    third = [one["verdict"] for one in found["Parameters of spiral III"]["readings"]]
    assert third == ["holds"] * 4 + ["does not hold"]  # with its equation the radius is half
    second = found["Parameters of spiral II"]
    assert [one["verdict"] for one in second["readings"]].count("does not hold") == 1
    assert second["readings"][2]["ours"] == pytest.approx(-0.1988, abs=1e-3)


def test_equations_are_held_against_geometry(written: Path) -> None:
    found = {
        one["claim"]: one for one in numbers(written)["claims"] if one["section"] == "equations"
    }
    ours = {claim: [r["ours"] for r in one["readings"]] for claim, one in found.items()}
    # Side wheels of the paper's robot lose the turn where units overlap, mirrored once.
    assert ours["The robot is omnidirectional at any configuration"] == [2, 0]
    least, most = ours["Wheel speeds follow from the speed of a unit on its path"]
    assert 19 < least < most < 73  # as a test of trajectories has it with another integration
    assert ours["The heading's row of the soft Jacobian"] == [pytest.approx(-1.0, abs=1e-9)]
    (shift_mm,) = ours["Displacements are those of the configuration q_0 at the start of the plan"]
    assert shift_mm == pytest.approx(22.3, abs=0.1)
    a, b, length, link = 2.4471, 0.2229, 0.04, 0.03  # Table I, row III; the robot's lengths [m]
    printed = 0.75 / (length * a * length * math.exp(-b * math.pi))
    (ratio,) = ours["Spiral III of Table I gives the rate at which two soft segments bend"]
    assert ratio == pytest.approx(printed * length * (2 * length + link), rel=1e-9)
    supply_V, off_C = ours["0 to 85 C are mapped to 1.1 to 3.3 V"]
    hot, cold = (10e3 * math.exp(3950 * (1 / (t + 273.15) - 1 / 298.15)) for t in (85.0, 0.0))
    fixed = 1.1 * cold / (supply_V - 1.1)
    assert supply_V * fixed / (hot + fixed) == pytest.approx(3.3)
    assert off_C > 10


def test_the_simulations_are_those_published(written: Path) -> None:
    found = claims(written)
    for words in (
        "The five simulations use these modes, in this order",
        "The five simulations have so many recorded rows",
        "The simulated planner meets its targets",
    ):
        assert found[words]["verdict"] == "holds"
    given_rows = found["The five simulations take these trajectories"]["readings"]
    assert [one["verdict"] for one in given_rows].count("holds") == 1  # the others are not there
    assert "x and y are what the planner fits last" in found


def test_a_trial_that_does_as_simulated_is_near_and_waits(written: Path) -> None:
    data = numbers(written)["numbers"]["trials"]["logs"]["mine"]
    assert data["trial"] == TRIAL
    assert data["sequence"] == data["simulated"]
    assert all(data["nearest"][:3])
    assert max(data["dtw"]["mean"][:2]) < 1e-3
    assert data["waiting"]["waits_s"] == pytest.approx(PAUSE_S, abs=0.1)
    assert len(data["bends"]) == sum(map(any, data["sequence"]))
    assert all(abs(np.array(one["error"][3:])).max() == 0 for one in data["bends"])
    found = claims(written)
    assert found["Simulation and robot show a similar pattern of movement"]["verdict"] == "holds"
    axes = found["The axes of Fig. 7(a, c) are the time the trials took"]
    assert axes["verdict"] == "does not hold"
    shares = [one["ours"] for one in axes["readings"] if one["ours"] is not None]
    assert shares == [pytest.approx(100 * data["waiting"]["share_waiting"], abs=1e-9)]
    assert found["DTW distances of trial 2"]["verdict"] == "cannot be checked: no data"
    assert "2" in numbers(written)["missing"]["trials"]


def test_photographs_are_measured_against_their_references(written: Path) -> None:
    data = numbers(written)["numbers"]["curvature"]
    assert (data["pictures"], data["refused"]) == (len(CURVATURES), 0)
    assert data["deviations"]["arc"]["mse_per_m2"] < 4.0
    least, most = (LENGTH_M * k for k in (min(CURVATURES), max(CURVATURES)))
    assert data["bend_range_rad"] == pytest.approx([least, most])
    assert claims(written)["The mean square error is 41.32"]["verdict"] == "does not hold"


def test_the_page_has_every_claim_and_figure_and_no_link_out(written: Path) -> None:
    html = (written / PAGE).read_text(encoding="utf-8")
    page = Page(html)
    text = "".join(page.texts["th"]) + "".join(page.texts["a"])
    for claim in numbers(written)["claims"]:
        assert claim["claim"] in text
    ids = {value for _, name, value in page.attributes if name == "id"}
    links = [value for _, name, value in page.attributes if name == "href"]
    assert links
    assert {link.removeprefix("#") for link in links} <= ids
    drawn = [value for tag, name, value in page.attributes if (tag, name) == ("img", "src")]
    assert len(drawn) == len(list(written.glob("*.png"))) > 8
    assert all(value.startswith("data:image/png;base64,") for value in drawn)
    assert {place for *_, place in PAPER["shown"]} & ids


def test_without_data_it_says_what_to_give(written: Path, run: Run, tmp_path: Path) -> None:
    shutil.copytree(written, tmp_path / "paper")
    code, out, err = run("reproduce", "--out", "paper", *SMALL, "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document == numbers(tmp_path / "paper")
    unchecked = [one["section"] for one in document["claims"] if "no data" in one["verdict"]]
    assert set(unchecked) == {"curvature", "trials", "tasks"}
    assert set(document["missing"]) == {"curvature", "trials", "tasks"}


def test_the_examples_run(
    written: Path, lab: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(statistics, "random_runs", few_runs)
    shutil.copytree(written, tmp_path / "paper")
    shutil.copytree(lab, tmp_path / "lab")
    found = examples("reproduce")
    assert len(found) == 2
    for example in found:
        code, out, err = run(*shlex.split(example)[1:])
        assert (code, err) == (0, ""), example
        assert out.endswith(f"paper/{PAGE}\n".strip())
        assert "Table I holds" in out
        assert ("--photographs FOLDER" in out) == ("--data" not in example), example
