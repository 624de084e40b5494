"""Numbers of a simulated run, by what really happened, and their distribution over many runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc.execution.run import Run
from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.robot.coordinates import POSE


class Metrics(NamedTuple):
    """What a run came to.

    Attributes:
        reached: Whether the robot is in truth within the accuracy of the goal, and says so.
        ending: How the run ended.
        reason: Why, in a sentence.
        position_m: True distance from the goal box in the plane.
        heading_rad: True distance in heading.
        curvature_per_m: True distance of the curvature that is farthest off.
        time_s: Duration.
        transitions: Melts and freezes.
        allowed: Transitions of the plan and of every plan made again, as far as they were begun.
        energy_J: Heat of all heaters.
        replans: How often the rest was planned again.
        corrections: How often the pose was corrected.
        forced_s: How long wheels turned while metal was changing.
    """

    reached: bool
    ending: str
    reason: str
    position_m: float
    heading_rad: float
    curvature_per_m: float
    time_s: float
    transitions: int
    allowed: int
    energy_J: float
    replans: int
    corrections: int
    forced_s: float


def metrics(run: Run, truth: Truth) -> Metrics:
    """Sum up a run."""
    error = run.problem.goal.error(truth.q[-1].copy())
    return Metrics(
        reached=run.reached and run.accuracy.of(error) <= 1.0,
        ending=str(run.ending),
        reason=run.reason,
        position_m=float(np.hypot(error[0], error[1])),
        heading_rad=abs(float(error[2])),
        curvature_per_m=float(np.abs(error[POSE:]).max()),
        time_s=run.duration_s,
        transitions=run.transitions,
        allowed=sum(run.begun),
        energy_J=float(truth.heat_J[-1].sum()),
        replans=run.replans,
        corrections=run.corrections,
        forced_s=float(truth.forced_s[-1]),
    )


class Spread(NamedTuple):
    """Median, 90 % quantile and largest value."""

    median: float
    p90: float
    largest: float


def spread(runs: Sequence[Metrics], of: Callable[[Metrics], float]) -> Spread:
    """How a number is distributed over runs."""
    values = np.array([of(run) for run in runs], dtype=float)
    median, p90, largest = np.quantile(values, (0.5, 0.9, 1.0)).tolist()
    return Spread(median, p90, largest)
