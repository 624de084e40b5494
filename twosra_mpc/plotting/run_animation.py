"""Animations of runs in closed loop, in the scene of the animations of plans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.run import Run
from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.plotting.animation import animate
from twosra_mpc.plotting.film import Film, OnProgress
from twosra_mpc.plotting.playback import Playback, places_s
from twosra_mpc.plotting.run_figure import (
    goal_configuration,
    joined_drives,
    reported_states,
    run_stretch,
    run_title,
)

Array = NDArray[np.float64]


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
    words = {"optimal": "closed loop", "greedy": "greedy rule"}[run.executor]
    titles = f"{run.problem.robot.name}: {words}", run_title(run).splitlines()[0]
    return animate(run_playback(run, truth), titles, path, duration_s, on_progress)


def run_playback(run: Run, truth: Truth | None = None) -> Playback:
    """Play a run; ``truth`` as for ``animate_run``. Between its rows, a log is interpolated."""
    log, problem, stretch = run.log, run.problem, run_stretch(run)
    times = np.minimum(places_s(stretch), log.time_s[-1])
    recorded = log if truth is None else truth

    def then(values: Array) -> Array:
        return np.column_stack([np.interp(times, recorded.time_s, v) for v in values.T])

    unknown = np.full((len(times), problem.robot.coordinates.segments), np.nan)
    sent = np.clip(np.searchsorted(log.time_s, times + 1e-9) - 1, 0, None)
    return Playback(
        geometry=problem.robot.geometry,
        goal=goal_configuration(run),
        melting_C=problem.stiffness_thresholds_C,
        phases=tuple(joined_drives(run)),
        intervals=reported_states(run),
        stretch=stretch,
        time_s=times,
        q=then(recorded.q),
        temperature_C=then(recorded.temperature_C),
        melt_fraction=unknown if truth is None else then(truth.melt_fraction),
        heated=log.setpoint_C[sent] > problem.robot.heater.rigid_setpoint_C,
    )
