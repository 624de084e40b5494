"""Exports of plans: CSV as the authors write it, and files that cannot be written."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from once import planned, solved

from twosra_mpc import Follow, InputError
from twosra_mpc.lab.export.ros2_mcap import save_ros2_bag
from twosra_mpc.lab.identification.motion_log import save_authors_csv
from twosra_mpc.plans.carried import object_poses

# --- CSV -----------------------------------------------------------------------------------------


def rows_of(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array(rows, dtype=float)


@pytest.mark.parametrize("rate_Hz", [None, 10.0])
def test_csv_values_equal_the_plan(rate_Hz: float | None, tmp_path: Path) -> None:
    plan = planned("paper-1")
    samples = plan.trajectory.held(rate_Hz)
    save_authors_csv(plan, tmp_path / "plan.csv", rate_Hz)
    header, table = rows_of(tmp_path / "plan.csv")
    assert ",".join(header) == "x,y,angle,k1,k2,v1,v2,u0,v0,r0,s1,s2,time"
    expected = np.column_stack([samples.q, samples.v, samples.mode, samples.t_s])
    np.testing.assert_array_equal(table, expected)


def test_csv_has_what_is_carried_and_where_it_should_be(tmp_path: Path) -> None:
    line = Follow(object="cup", path=[(0.0, 0.2), (0.3, 0.2)])
    problem = planned("rigid-move").problem.with_values(
        objects=[{"name": "cup", "disc": {"radius_m": 0.03}, "pose": {"x_m": 0.0, "y_m": 0.2}}],
        start=planned("rigid-move").problem.start.with_values(holding="cup"),
        tasks=[line],
    )
    trajectory = replace(planned("rigid-move").trajectory, problem=problem, done_s=(5.0,))
    made = replace(planned("rigid-move"), trajectory=trajectory)
    save_authors_csv(made, tmp_path / "plan.csv")
    header, table = rows_of(tmp_path / "plan.csv")
    assert header[13:] == ["object_x", "object_y", "object_angle", "path_x", "path_y"]
    poses = object_poses(trajectory, table[:, 12])[:, 0]
    np.testing.assert_allclose(table[:, 13:16], poses, atol=1e-9)
    assert (table[:, 17] == 0.2).all()
    assert (np.diff(table[:, 16]) >= 0).all()


# --- refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("save", "name"), [(save_ros2_bag, "p.mcap"), (save_authors_csv, "p.csv")])
def test_a_wrong_rate_is_refused_and_nothing_is_written(
    tmp_path: Path, save: Any, name: str
) -> None:
    with pytest.raises(InputError, match="rate"):
        save(planned("paper-2"), tmp_path / name, -1.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["plan.mcap", "plan.csv"])
def test_the_command_writes_and_says_what(run: Run, tmp_path: Path, name: str) -> None:
    solved("paper-2").save(tmp_path / "plan.json")
    outcome = run("export", "plan.json", name, "--rate", "1")
    assert (outcome.code, outcome.err) == (0, "")
    assert name in outcome.out
    assert (tmp_path / name).stat().st_size > 1000
    assert len(list(tmp_path.iterdir())) == 2
    outcome = run("export", "plan.json", name, "--json")
    found = json.loads(outcome.out)
    assert found["robot"] == "2sra-v1"


def test_the_papers_wheel_map_is_refused_unless_it_is_accepted(run: Run, tmp_path: Path) -> None:
    solved("rigid-move", robot="2sra-v1-paper").save(tmp_path / "paper.json")
    for name in ("plan.csv", "plan.mcap"):
        refused = run("export", "paper.json", name)
        assert (refused.code, refused.out) == (2, "")
        assert "paper.json: robot.path.model = 'log_spiral' is not acceptable" in refused.err
        assert "bends a robot by 17 to 48 % of what is planned" in refused.err
        assert not (tmp_path / name).exists()
        accepted = run("export", "paper.json", name, "--accept-paper-wheels")
        assert (accepted.code, accepted.err) == (0, "")
        assert (tmp_path / name).exists()
