"""``twosra resample``: regular rows for a controller, or a denser plan that is still a plan."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from once import planned, solved

from twosra_mpc import Result, load_plan
from twosra_mpc.checking.plan_file import check_plan, refined
from twosra_mpc.plans.setpoints import save_setpoints
from twosra_mpc.plans.trajectory import SAME_TIME_S


@pytest.fixture
def run(run: Run) -> Run:
    """Run ``twosra resample``, in a folder with ``plan.json``."""
    solved("shape-change").save("plan.json")
    return partial(run, "resample")


def test_a_refined_plan_passes_every_check(any_result: Result, tmp_path: Path) -> None:
    dense = refined(any_result.require(), 1.7)
    replace(any_result, plan=dense).save(tmp_path / "dense.json")
    found = check_plan(tmp_path / "dense.json")
    assert found.ok, found.problems


def test_a_refined_plan_has_the_plan_s_samples_and_the_regular_ones() -> None:
    given = planned("paper-1")
    dense, samples = refined(given, 2.0).samples, given.samples
    kept = np.isin(dense.t_s, samples.t_s)
    assert kept.sum() == len(samples)
    for name in ("q", "v", "a", "mode", "heater_setpoint_C", "heater_current_A"):
        np.testing.assert_array_equal(getattr(dense, name)[kept], getattr(samples, name))
    for name in ("wheel_rad_s", "temperature_C", "melt_fraction"):
        np.testing.assert_allclose(getattr(dense, name)[kept], getattr(samples, name), atol=1e-9)
    assert np.isin(np.round(dense.t_s[~kept] * 2.0, 9) % 1.0, 0.0).all()
    regular = np.arange(int(samples.t_s[-1] * 2.0) + 1) / 2.0
    assert np.abs(dense.t_s[:, None] - regular).min(axis=0).max() <= SAME_TIME_S
    assert np.diff(dense.t_s).min() > 0
    assert np.diff(dense.t_s).max() <= 0.5 + 2 * SAME_TIME_S


def test_refining_keeps_everything_but_samples_and_verification() -> None:
    given = planned("paper-1")
    before, after = given.to_dict(), refined(given, 1.0).to_dict()
    for key in before.keys() - {"samples", "verification", "cost"}:
        assert before[key] == after[key]
    assert after["cost"] == pytest.approx(before["cost"], rel=1e-8)  # but for quadrature


def test_a_plan_that_rests_has_one_sample() -> None:
    resting = planned("rigid-move", goal={"x_m": 0.0})
    assert len(refined(resting, 10.0).samples) == 1


# --- program -------------------------------------------------------------------------------------


def test_csv_is_that_of_the_set_points(run: Run, tmp_path: Path) -> None:
    code, out, err = run("plan.json", "a.csv", "--rate", 10)
    assert (code, err) == (0, "")
    assert "rate_Hz 10.0" in out
    save_setpoints(planned("shape-change"), "b.csv", 10.0)
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()


def test_json_stays_a_plan(run: Run, tmp_path: Path) -> None:
    code, out, err = run("plan.json", "dense.json", "--rate", 4, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["file"] == "dense.json"
    dense, given = load_plan(tmp_path / "dense.json").require(), planned("shape-change")
    assert dense.cost == pytest.approx(given.cost, rel=1e-8)
    assert len(dense.samples) > 5 * len(given.samples)
    assert check_plan(tmp_path / "dense.json").ok
