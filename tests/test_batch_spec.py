"""What a batch plans: specs, and the problems they come to."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from once import cases

from benchmarks.problems import load_set
from twosra_mpc import InputError, Problem, load_problem, load_robot
from twosra_mpc.files import locate
from twosra_mpc.lab.batch.problems import Posed, Problems
from twosra_mpc.lab.batch.spec import MOST_PROBLEMS, Spec, load_spec

RANDOM = {
    **{"robot": "2sra-v1", "seed": 2026, "count": 100},
    **{"position_m": 0.25, "heading_rad": np.pi, "curvature_per_m": 60.0},
}


def posed(spec: dict[str, Any], folder: Path = Path()) -> list[Posed]:
    problems = Problems(Spec(**spec), folder)
    return list(problems.posed(np.zeros(len(problems), dtype=bool)))


def test_a_random_set_is_that_of_the_benchmarks() -> None:
    drawn = posed({"random": RANDOM})
    assert [Problem(**one.document) for one in drawn] == list(load_set("random-100").values())
    for one in drawn:
        for key, value in one.varied.items():
            end, name, *entry = key.split(".")
            told = one.document[end][name]
            assert value == (told[int(entry[0])] if entry else told)
    assert len(drawn[0].varied) == 10


def test_a_random_set_without_possible_shapes_is_refused() -> None:
    with pytest.raises(InputError, match="ranges with shapes that are possible"):
        posed({"random": {**RANDOM, "curvature_per_m": 1e8, "position_m": 0.0}})


def test_a_grid_has_every_combination_once_and_the_last_key_varies_fastest() -> None:
    grid = {
        "robot.heater.melt_current_A": [0.7, 0.8],
        "goal.kappa_per_m.0": {"from": -40, "to": 40, "steps": 5},
        "heating": ["fastest", "keep_warm"],
    }
    made = posed({"scenario": "paper-1", "grid": grid})
    found = [tuple(one.varied.values()) for one in made]
    expected = [
        (current, kappa, heating)
        for current in (0.7, 0.8)
        for kappa in (-40.0, -20.0, 0.0, 20.0, 40.0)
        for heating in ("fastest", "keep_warm")
    ]
    assert found == expected
    assert [one.number for one in made] == list(range(20))
    base = load_problem("paper-1")
    for one, (current, kappa, heating) in zip(made, expected, strict=True):
        problem = Problem(**one.document)
        assert problem.robot.heater.melt_current_A == current
        assert problem.goal.configuration[3] == kappa
        assert problem.goal.configuration[4] == base.goal.configuration[4]
        assert problem.heating == heating
        assert problem.start == base.start


def test_grids_lie_over_scenarios_and_random_sets() -> None:
    grid = {"ambient_C": [15.0, 20.0]}
    made = posed({"scenarios": ["paper-1", "rigid-move"], "grid": grid})
    assert [tuple(one.varied.values()) for one in made] == [
        *(("paper-1", 15.0), ("paper-1", 20.0)),
        *(("rigid-move", 15.0), ("rigid-move", 20.0)),
    ]
    drawn = posed({"random": {**RANDOM, "count": 3}, "grid": grid})
    assert len(drawn) == 6
    assert drawn[4].document["start"] == drawn[5].document["start"]
    assert [one.varied["ambient_C"] for one in drawn[4:]] == [15.0, 20.0]


def test_robots_are_varied_before_their_keys_and_what_is_fixed_is_no_column() -> None:
    grid = {"robot.heater.ambient_C": [20.0], "robot": ["2sra-v1", "2sra-v1-paper"]}
    made = posed({"scenario": "paper-1", "grid": grid, "fixed": {"weights": {"effort": 2.0}}})
    for one, name in zip(made, ("2sra-v1", "2sra-v1-paper"), strict=True):
        problem = Problem(**one.document)
        assert problem.robot.name == load_robot(name).name
        assert problem.robot.heater.ambient_C == 20.0
        assert problem.weights.effort == 2.0
        assert list(one.varied) == ["robot.heater.ambient_C", "robot"]


def test_documents_hold_what_files_said_when_the_batch_began(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    shutil.copy(locate("2sra-v1", "robots", "robot"), here / "mine.toml")
    text = locate("paper-1", "scenarios", "scenario").read_text(encoding="utf-8")
    (here / "a.toml").write_text(text.replace('"2sra-v1"', '"mine.toml"'))
    spec = {"scenarios": ["a.toml"], "grid": {"robot.heater.ambient_C": [20.0]}}
    (made,) = posed(spec, here)
    expected = load_problem(here / "a.toml")
    shutil.rmtree(here)
    heater = expected.robot.heater.with_values(ambient_C=20.0)
    robot = expected.robot.with_values(heater=heater)
    assert Problem(**made.document) == expected.with_values(robot=robot)


def test_missions_among_obstacles_are_documents_too() -> None:
    (made,) = posed({"scenario": "pick-and-place"})
    assert Problem(**made.document) == load_problem("pick-and-place")


def test_what_is_done_is_left_out() -> None:
    problems = Problems(Spec(random={**RANDOM, "count": 5}), Path())
    every = list(problems.posed(np.zeros(5, dtype=bool)))
    left = list(problems.posed(np.array([True, False, True, True, False])))
    assert left == [every[1], every[4]]


def test_unquoted_keys_are_the_same_as_quoted_ones(tmp_path: Path) -> None:
    quoted, bare = tmp_path / "quoted.toml", tmp_path / "bare.toml"
    keys = ("robot.heater.melt_current_A", "goal.kappa_per_m.0")
    values = ("[0.7, 0.8]", "{ from = -40.0, to = 40.0, steps = 9 }")
    for path, mark in ((quoted, '"'), (bare, "")):
        lines = [f"{mark}{k}{mark} = {v}" for k, v in zip(keys, values, strict=True)]
        path.write_text("\n".join(['scenario = "paper-1"', "[grid]", *lines]))
    assert load_spec(quoted) == load_spec(bare)
    assert load_spec(bare).size == 18
    assert load_spec(bare, planner="both").planner == "both"


NO_SCENARIO = {"scenario": None}, "scenario", "one of the keys"


@pytest.mark.parametrize(
    ("changed", "field", "allowed"), [*cases("batch_spec")["wrong"], NO_SCENARIO]
)
def test_what_is_wrong_with_a_spec_is_named(
    changed: dict[str, Any], field: str, allowed: str
) -> None:
    with pytest.raises(InputError) as caught:
        posed({"scenario": "paper-1", **changed})
    assert caught.value.field == field
    assert allowed in str(caught.value)


def test_more_than_ten_million_problems_are_refused_at_once() -> None:
    side = {"from": 0.0, "to": 1.0, "steps": 3163}
    assert 3162**2 < MOST_PROBLEMS < 3163**2
    grid = {"goal.x_m": side, "goal.y_m": side}
    with pytest.raises(InputError, match="at most 10000000 problems"):
        Spec(scenario="paper-1", grid=grid)
    grid["goal.x_m"] = {**side, "steps": 3161}
    assert Spec(scenario="paper-1", grid=grid).size == 3161 * 3163
    with pytest.raises(InputError, match=r"random.count = 10000001"):
        Spec(random={**RANDOM, "count": MOST_PROBLEMS + 1})
