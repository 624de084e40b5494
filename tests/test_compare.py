"""``twosra compare``: both planners side by side, as a table, as data and as a figure."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest
from conftest import Run
from once import planned

IMPOSSIBLE = """
robot = "2sra-v1"
modes = [[0, 0]]
[start]
x_m = 0.0
y_m = 0.0
phi_rad = 0.0
kappa_per_m = [0.0, 0.0]
[goal]
x_m = 0.0
kappa_per_m = [30.0, 0.0]
"""


@pytest.fixture
def run(run: Run) -> Run:
    """Run ``twosra compare``; see ``conftest``."""
    return partial(run, "compare")


def test_a_table_has_both_planners_of_every_scenario(run: Run) -> None:
    code, out, err = run("paper-1", "rigid-move", "--plot", "comparison.svg")
    assert (code, err) == (0, "")
    for column in ("mode sequence", "waiting", "moving", "transitions", "energy", "cost ratio"):
        assert column in out
    assert "paper-1 optimal [0,0] > [1,0] > [1,1] 341.5 s 1.000 optimal driven gently; at" in out
    assert "paper-1 optimal 328.8 s 12.61 s 4 628 J" in out
    assert "paper-1 greedy [1,1] > [1,0] > [0,1] > [0,0] 795.7 s 2.330 feasible" in out
    assert "rigid-move greedy [0,0]" in out
    assert Path("comparison.svg").read_bytes().startswith(b"<?xml")


def test_json_has_the_numbers_of_the_plans(run: Run) -> None:
    code, out, err = run("paper-2", "--json")
    assert (code, err) == (0, "")
    records = json.loads(out)
    assert [record["planner"] for record in records] == ["optimal", "greedy"]
    for record in records:
        made = planned("paper-2", planner=record["planner"])
        assert record["scenario"] == "paper-2"
        assert record["modes"] == [list(phase.mode) for phase in made.phases]
        assert record["duration_s"] == pytest.approx(made.duration_s)
        assert record["waiting_s"] + record["moving_s"] == pytest.approx(made.duration_s)
        assert record["energy_J"] == pytest.approx(made.cost.energy_J)
        assert record["transitions"] == made.cost.transitions
        assert (record["gap"] is None) == (record["planner"] == "greedy")
    assert records[0]["cost_ratio"] == 1.0
    assert records[1]["cost_ratio"] == pytest.approx(records[1]["cost_s"] / records[0]["cost_s"])


def test_what_has_no_plan_is_a_row_without_numbers(run: Run) -> None:
    Path("impossible.toml").write_text(IMPOSSIBLE)
    code, out, err = run("impossible.toml", "--plot", "nothing.png")
    assert code == 3
    assert "impossible.toml optimal infeasible" in out
    assert "impossible.toml greedy failed" in out
    assert "no plan to draw in nothing.png" in err
    code, out, _ = run("impossible.toml", "rigid-move", "--json", "--plot", "some.png")
    assert code == 3
    assert [record["cost_s"] is None for record in json.loads(out)] == [True, True, False, False]
    assert Path("some.png").exists()
    assert not Path("nothing.png").exists()
