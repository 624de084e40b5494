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
from twosra_mpc.plotting.film import Film, Moment, OnProgress, check_animation_path, record
from twosra_mpc.plotting.plan_figure import plan_title
from twosra_mpc.plotting.scene import Scene, Story
from twosra_mpc.plotting.style import STYLE
from twosra_mpc.plotting.time_axis import TimeStretch
from twosra_mpc.plotting.timeline import samples_of, segment_states

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
    return animate_story(plan_story(plan), path, duration_s, on_progress)


def animate_story(
    story: Story, path: str | Path | None, duration_s: float, on_progress: OnProgress | None
) -> Film:
    """Animate a story; arguments and errors as for ``animate_plan``."""
    if path is not None:
        check_animation_path(path)
    with rc_context(STYLE):
        return record(Scene(story), _moments(story, duration_s), path, on_progress)


def _moments(story: Story, duration_s: float) -> list[Moment]:
    """Frames at even places along the stretched time axis, as far as the story goes."""
    count = max(2, round(duration_s * film.FRAMES_PER_S))
    places = story.stretch.inverse(np.linspace(0.0, 1.0, count))
    times = np.minimum(places, story.time_s[-1]).tolist()
    return [
        Moment(time_s, story.stretch.seconds_per_length(time_s) / duration_s) for time_s in times
    ]


def plan_story(plan: Plan) -> Story:
    """What the animation of a plan shows."""
    samples = samples_of(plan)
    end_s = float(samples.t_s[-1])
    after_s = end_s + 1e-3  # so that the last state is the one that is reached
    return Story(
        title=plan.robot.name,
        ending=plan_title(plan),
        geometry=plan.robot.geometry,
        melting_C=plan.problem.stiffness_thresholds_C,
        goal=samples.q[-1],
        time_s=samples.t_s,
        q=samples.q,
        temperature_C=samples.temperature_C,
        melt_fraction=samples.melt_fraction,
        heated=samples.heater_current_A > 0.0,
        states=(segment_states(plan, 1, after_s), segment_states(plan, 2, after_s)),
        drives=plan.phases,
        stretch=TimeStretch.of(plan.phases, end_s or 1.0, LEAST),
    )
