"""Animations of runs in closed loop, in the scene of the animations of plans."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twosra_mpc.execution.run import Run
from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.plans.trajectory import Phase
from twosra_mpc.plotting.animation import animate_story
from twosra_mpc.plotting.film import Film, OnProgress
from twosra_mpc.plotting.run_figure import (
    goal_configuration,
    joined_drives,
    reported_states,
    run_stretch,
    run_title,
)
from twosra_mpc.plotting.scene import Story


def animate_run(
    run: Run,
    path: str | Path | None = None,
    truth: Truth | None = None,
    *,
    duration_s: float = 12.0,
    on_progress: OnProgress | None = None,
) -> Film:
    """Animate a run; a notebook shows what is returned.

    Args:
        run: The run.
        path: Where to save the animation, atomically; its ending (gif, mp4) is the format.
        truth: What really happened, if it was a simulation; otherwise what was believed is shown.
        duration_s: Of the animation, without its last frame.
        on_progress: Called with the frames done and the frames in all, after each of them.

    Raises:
        InputError: If such a file cannot be written.
    """
    return animate_story(run_story(run, truth), path, duration_s, on_progress)


def run_story(run: Run, truth: Truth | None = None) -> Story:
    """What the animation of a run shows; ``truth`` as for ``animate_run``."""
    log, problem = run.log, run.problem
    time_s = log.time_s if truth is None else truth.time_s
    rows = np.clip(np.searchsorted(log.time_s, time_s + 1e-9) - 1, 0, None)
    words = {"optimal": "closed loop", "greedy": "greedy rule"}
    return Story(
        title=f"{problem.robot.name}: {words[run.executor]}",
        ending=run_title(run).splitlines()[0],
        geometry=problem.robot.geometry,
        melting_C=problem.stiffness_thresholds_C,
        goal=goal_configuration(run),
        time_s=time_s,
        q=log.q if truth is None else truth.q,
        temperature_C=log.temperature_C if truth is None else truth.temperature_C,
        melt_fraction=np.full((len(time_s), 2), np.nan) if truth is None else truth.melt_fraction,
        heated=log.setpoint_C[rows] > problem.robot.heater.rigid_setpoint_C,
        states=(reported_states(run, 0), reported_states(run, 1)),
        drives=tuple(Phase(*drive) for drive in joined_drives(run)),
        stretch=run_stretch(run),
    )
