"""Animations of plans.

Time passes at a constant pace along the stretched time axis of the scene: driving takes a few
seconds, and minutes of waiting a few seconds more; the clock in the corner tells. Needs no display.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context

from twosra_mpc.plans.plan import Plan
from twosra_mpc.plotting import film
from twosra_mpc.plotting.film import Film, OnProgress, check_animation_path, record
from twosra_mpc.plotting.plan_figure import plan_title
from twosra_mpc.plotting.playback import PLACES, Playback, plan_playback
from twosra_mpc.plotting.scene import Scene
from twosra_mpc.plotting.style import STYLE

LEAST = 0.25  # of the length of the unstretched time axis that a motion phase takes


def animate_plan(
    plan: Plan,
    path: str | Path | None = None,
    *,
    duration_s: float = 12.0,
    on_progress: OnProgress | None = None,
) -> Film:
    """Animate a plan; a notebook shows what is returned.

    Args:
        plan: The plan.
        path: Where to save the animation, atomically; its ending (gif, mp4) is the format.
        duration_s: Of the animation, without its last frame.
        on_progress: Called with the frames done and the frames in all, after each of them.

    Raises:
        InputError: If such a file cannot be written.
    """
    titles = plan.robot.name, plan_title(plan)
    return animate(plan_playback(plan, LEAST), titles, path, duration_s, on_progress)


def animate(
    playback: Playback,
    titles: tuple[str, str],
    path: str | Path | None,
    duration_s: float,
    on_progress: OnProgress | None,
) -> Film:
    """Film a plan or a run, with what is written above it and at its end; as ``animate_plan``."""
    if path is not None:
        check_animation_path(path)
    count = max(2, round(duration_s * film.FRAMES_PER_S))
    rows = np.rint(np.linspace(0, PLACES - 1, count)).astype(int).tolist()
    with rc_context(STYLE):
        return record(Scene(playback, titles, duration_s), rows, path, on_progress)
