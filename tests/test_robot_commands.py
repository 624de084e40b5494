"""Path models: plans under each, fits from the command line; and checking robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twosra_mpc import InputError, Status, load_problem, load_robot, plan
from twosra_mpc.checking.reintegration import reintegrate
from twosra_mpc.cli import main
from twosra_mpc.lab.commands.robot_file_commands import write_fitted_robot
from twosra_mpc.lab.identification.path_fitting import fit_spirals, fitted_path_tables
from twosra_mpc.robot.description import PATH_MODELS, with_path_model
from twosra_mpc.robot.paths import CardioidPath, LogSpiralPath


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_a_plan_ends_at_its_goal_under_its_own_path_model_and_elsewhere_under_others() -> None:
    problem = load_problem("paper-1", robot="2sra-v1-paper")
    robots = [with_path_model(problem.robot, model) for model in PATH_MODELS]
    variants = [problem.with_values(robot=robot) for robot in robots]
    made = [plan(variant) for variant in variants]
    assert {each.status for each in made} == {Status.OPTIMAL}
    samples = [each.require().samples for each in made]
    ends = np.array(
        [[reintegrate(moved, one)[-1] - one.q[-1] for moved in variants] for one in samples]
    )
    own = np.eye(len(variants), dtype=bool)
    assert np.abs(ends[own]).max() < 1e-6
    assert (np.abs(ends[~own][:, 3:]).max(axis=1) > 0.5).all()
    # Planned with the printed row III, a robot that bends half as fast stops half way: kappa1 goes
    # from -38 to about -25 instead of -15, kappa2 from -24 to about -14 instead of -5.
    spiral, corrected, arc = (PATH_MODELS.index(model) for model in PATH_MODELS[:3])
    short = ends[spiral, corrected, 3:]
    assert short[0] == pytest.approx(-10, abs=2)
    assert short[1] == pytest.approx(-9, abs=2)
    assert made[arc].require().duration_s > made[spiral].require().duration_s


@pytest.mark.parametrize("model", ["log_spiral_corrected", "cardioid"])
def test_fit_paths_writes_a_robot_that_keeps_its_comments(model: str, tmp_path: Path) -> None:
    target, figure = tmp_path / "fitted.toml", tmp_path / "paths.png"
    arguments = ["fit-paths", "2sra-v1-paper", "--out", str(target), "--model", model]
    assert run(*arguments, "--plot", str(figure)) == 0
    robot, original = load_robot(target), load_robot("2sra-v1-paper")
    assert robot.path.model == model
    assert robot.geometry == original.geometry
    assert robot.limits == original.limits
    assert "II-B: rho_w" in target.read_text()
    assert figure.stat().st_size > 10_000


def test_fit_paths_prints_fits_beside_the_built_in_numbers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("fit-paths", "2sra-v1-paper") == 0
    out = capsys.readouterr().out
    for fit in fit_spirals(load_robot("2sra-v1-paper").geometry):
        assert f"{fit.scale:.4f}, {fit.growth:.4f}" in out
    assert "2.3250, 0.3165" in out
    assert run("fit-paths", "2sr-v2") == 0
    assert "0.0490, 0.6048" in capsys.readouterr().out


def test_fit_paths_refuses_json_and_unwritable_targets(tmp_path: Path) -> None:
    robot = load_robot("2sra-v1-paper")
    source = tmp_path / "robot.json"
    source.write_text(robot.model_dump_json())
    with pytest.raises(InputError, match="a TOML file"):
        write_fitted_robot(source, tmp_path / "out.toml", robot, "cardioid")
    assert run("fit-paths", "2sra-v1-paper", "--out", str(tmp_path / "no" / "out.toml")) == 2


def test_path_models_are_kept_swapped_or_fitted() -> None:
    robot = load_robot("2sra-v1-paper")
    assert with_path_model(robot, "log_spiral") is robot
    swapped = with_path_model(robot, "log_spiral_corrected")
    assert isinstance(swapped.path, LogSpiralPath)
    assert isinstance(robot.path, LogSpiralPath)
    assert swapped.path.scale == robot.path.scale
    fitted = with_path_model(robot, "cardioid")
    assert isinstance(fitted.path, CardioidPath)
    spiral_again = with_path_model(fitted, "log_spiral_corrected")
    assert isinstance(spiral_again.path, LogSpiralPath)
    np.testing.assert_allclose(spiral_again.path.scale, robot.path.scale, rtol=2e-3)


@pytest.mark.parametrize("name", ["2sra-v1", "2sr-v2"])
def test_known_paths_are_those_that_are_fitted(name: str) -> None:
    robot = with_path_model(load_robot(name), "arc")
    for model, table in fitted_path_tables(robot).items():
        known = with_path_model(robot, model).path.model_dump(mode="json")
        assert known.keys() == table.keys()
        for key, value in table.items():
            assert known[key] == (
                value if isinstance(value, str) else pytest.approx(value, rel=1e-5)
            )


def test_paths_of_other_lengths_are_fitted_first() -> None:
    robot = load_robot("2sra-v1")
    longer = robot.with_values(geometry=robot.geometry.with_values(middle_link_m=0.031))
    with pytest.raises(InputError, match="twosra fit-paths"):
        with_path_model(longer, "cardioid")


@pytest.mark.parametrize("name", ["2sra-v1-paper", "2sra-v1", "2sr-v2", "3sra"])
def test_check_robot_reports_singular_shapes(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("check-robot", name) == 0
    out = " ".join(capsys.readouterr().out.split())
    if name == "2sr-v2":
        assert "nowhere within the curvature limits" in out
    elif name == "3sra":
        assert "kappa = (21.5, 43.9, 37.4) 1/m" in out
        assert "of 3 segments in curves" in out
    else:
        assert "kappa = (39.6, 58.8) 1/m" in out
        assert "units overlap" in out
