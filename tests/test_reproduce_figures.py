"""Figures of the report on the paper show the numbers that they are made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from test_reproduce import CURVATURES, TRIAL, write_log

from benchmarks.files.photographs import camera, write_folder
from twosra_mpc.lab.figures.experiment_figures import plot_distances, plot_spread, plot_trials
from twosra_mpc.lab.identification.motion_log import read_motion_log
from twosra_mpc.lab.paper.trials import DTW
from twosra_mpc.lab.photographs.study import estimate_folder
from twosra_mpc.lab.reproduction.published_runs import SIMULATIONS
from twosra_mpc.robot.description import load_robot


def test_trials_are_drawn_row_by_row_and_their_error_over_time(tmp_path: Path) -> None:
    log = read_motion_log(write_log(tmp_path / "mine.csv"), load_robot("2sra-v1"))
    run = SIMULATIONS[TRIAL].run()
    place, heading, bends, error = plot_trials({TRIAL: log}, {TRIAL: run}).axes
    for ax, columns in ((place, (0, 1)), (heading, (2,)), (bends, (3, 4))):
        measured = ax.lines[: len(columns)]
        for line, column in zip(measured, columns, strict=True):
            np.testing.assert_allclose(line.get_ydata(), log.q[:, column])
        assert len(ax.lines) == 2 * len(columns)
    (line,) = error.lines
    np.testing.assert_allclose(line.get_xdata(), log.time_s)
    assert line.get_ydata()[0] == 1.0
    assert len(error.patches) == len(log.phases) == 2


def test_distances_are_outlined_as_published_and_filled_as_found() -> None:
    ours = {1: (1.0, 2.0, 3.0, 4.0, 5.0)}
    (ax,) = plot_distances(DTW, ours).axes
    hollow = to_rgba("none")
    outlines = [bar.get_height() for bar in ax.patches if bar.get_facecolor() == hollow]
    filled = [bar.get_height() for bar in ax.patches if bar.get_facecolor() != hollow]
    assert sorted(outlines) == sorted(value for each in DTW.values() for value in each)
    assert filled == list(ours[1])


def test_the_spread_is_about_the_mean(tmp_path: Path) -> None:
    towards = write_folder(tmp_path / "left", CURVATURES)
    rows = "\n".join(["k1", *map(str, CURVATURES)])
    (tmp_path / "left.csv").write_text(rows, encoding="utf-8")
    found = estimate_folder(tmp_path / "left", camera(towards), (tmp_path / "left.csv", "k1"))
    (ax,) = plot_spread(found).axes
    reference, mean, arc = (line.get_ydata() for line in ax.lines)
    assert reference.min() == pytest.approx(min(CURVATURES), abs=1.0)
    assert np.abs(arc - reference).max() < 4.0
    (band,) = ax.collections
    y = band.get_paths()[0].vertices[:, 1]
    assert y.min() <= mean.min()
    assert y.max() >= mean.max()
