"""The paper's figures, drawn anew: what they show is what was run."""

from __future__ import annotations

import signal
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from once import planned

from twosra_mpc import cli, load_problem
from twosra_mpc.lab.figures import paper_figures
from twosra_mpc.lab.figures.paper_figures import (
    LEAST_SHARE,
    MODES,
    PAPER_FIGURES,
    START,
    TASK_COLOURS,
    plot_error_decrease,
    plot_forward_kinematics,
    plot_published_tasks,
)
from twosra_mpc.lab.reproduction.published_runs import published_trajectory
from twosra_mpc.robot.modes import mode_name


@cache
def forward_kinematics() -> Figure:
    return plot_forward_kinematics()


@cache
def error_decrease() -> Figure:
    return plot_error_decrease()


def test_forward_kinematics_and_planner_share_their_ends() -> None:
    for column in np.array(forward_kinematics().axes).reshape(4, len(MODES)).T:
        for ax in column[:3]:
            curves = [line.get_ydata() for line in ax.lines if len(line.get_ydata()) > 2]
            planned, driven = curves[::2], curves[1::2]
            for one, other in zip(driven, planned, strict=True):
                assert one[0] == other[0]
                assert one[-1] == pytest.approx(other[-1], abs=1e-4)


def test_forward_kinematics_is_even_and_the_planner_is_slow_then_fast() -> None:
    """The claim of the paper's figure."""
    for ax in forward_kinematics().axes[-len(MODES) :]:
        planner, forward = ax.lines[:2]
        share = forward.get_xdata()
        assert np.abs(forward.get_ydata() - (1.0 - share)).max() < 0.15
        at = np.interp(share, planner.get_xdata(), planner.get_ydata())
        assert np.all(
            at[(share > 0.0) & (share < 0.04)] > 1.0 - share[(share > 0) & (share < 0.04)]
        )
        assert np.all(
            at[(share > 0.35) & (share < 0.95)]
            < forward.get_ydata()[(share > 0.35) & (share < 0.95)]
        )


def test_the_mode_that_drove_is_planned_first_and_rigid_is_last() -> None:
    for ax, mode in zip(forward_kinematics().axes, MODES, strict=False):
        sequence = ax.get_title().splitlines()[1].split(" → ")
        assert ax.get_title().startswith(f"driven in [{mode[0]},{mode[1]}], planned\n")
        assert sequence[0] == f"[{mode[0]},{mode[1]}]"
        assert sequence[-1] == "[0,0]"
        assert len(sequence) <= 4


def test_the_error_of_the_published_loop_is_its_own() -> None:
    left = error_decrease().axes[0]
    for line, task in zip(left.lines[::2], TASK_COLOURS, strict=True):
        problem = load_problem(task)
        step_s = 0.1 if task == "paper-5" else 0.05
        goal = problem.goal.configuration
        run = published_trajectory(problem.start.configuration, goal, step_s=step_s)
        expected = np.linalg.norm(run.q - goal, axis=1)
        np.testing.assert_allclose(line.get_xdata(), (run.iteration + 1) * step_s)
        np.testing.assert_allclose(line.get_ydata(), expected / expected[0], atol=1e-9)


def test_both_planners_reach_every_target_when_they_say_so() -> None:
    right = error_decrease().axes[1]
    curves, ends = right.lines[::2], right.lines[1::2]
    assert len(curves) == 2 * len(TASK_COLOURS)
    for curve, end in zip(curves, ends, strict=True):
        assert curve.get_ydata()[0] == 1.0
        assert curve.get_ydata()[-1] < LEAST_SHARE
        assert end.get_xdata() == curve.get_xdata()[-1:]
    for optimal, greedy in zip(ends[::2], ends[1::2], strict=True):
        assert optimal.get_xdata() < greedy.get_xdata()


def test_every_published_task_has_start_target_and_path() -> None:
    figure = plot_published_tasks()
    for column, task in zip(np.array(figure.axes).reshape(2, -1).T, TASK_COLOURS, strict=True):
        problem = load_problem(task)
        rule = planned(task, planner="greedy", robot="2sra-v1-paper")  # whose time is told
        modes = " → ".join(mode_name(phase.mode) for phase in rule.phases)
        told = f"{task}\n{modes}\n{rule.duration_s:.0f} s with waits"
        assert column[0].get_title() == told
        for ax in column:
            paths = [line for line in ax.lines if line.get_zorder() == 5]  # last phase first
            start, goal = paths[-1].get_xydata()[0], paths[0].get_xydata()[-1]
            np.testing.assert_allclose(start, problem.start.configuration[:2], atol=1e-9)
            np.testing.assert_allclose(goal, problem.goal.configuration[:2], atol=2e-5)
            sequence = ax.get_title().splitlines()[-2]
            assert len(paths) == sequence.count("[")


def test_forward_kinematics_starts_where_it_says() -> None:
    top = forward_kinematics().axes[0]
    assert [line.get_ydata()[0] for line in top.lines[:4:2]] == list(START[:2])


# --- program


def test_all_figures_are_written_to_a_new_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = {name: (lambda path: path.write_text("drawn")) for name in PAPER_FIGURES}
    monkeypatch.setattr(paper_figures, "PAPER_FIGURES", made)
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as caught:
        cli.main(["figures", "paper", "--format", "pdf"])
    assert caught.value.code == 0
    expected = [f"paper/{name}.pdf" for name in PAPER_FIGURES]
    assert capsys.readouterr().out.split() == expected
    assert sorted(str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*.pdf")) == sorted(
        expected
    )
    with pytest.raises(SystemExit) as caught:
        cli.main(["figures", "nowhere/paper"])
    assert caught.value.code == 2
    assert "nowhere/paper" in capsys.readouterr().err
    signal.signal(signal.SIGTERM, before)
