"""Playback of a plan or a run at regular places along a stretched time axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.checking.followed import Followed
from twosra_mpc.checking.surroundings import closest_approach
from twosra_mpc.checking.sweep import Clearance
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import (
    CHANGING,
    SAME_TIME_S,
    Interval,
    Phase,
    State,
    Stretch,
    state_at,
    stiffness_intervals,
    stretches,
)
from twosra_mpc.plotting.timeline_figures import TimeStretch
from twosra_mpc.plotting.world_figures import goals, targets
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import is_rigid, mode_name, named

PLACES = 1001  # along the time axis


@dataclass(frozen=True, eq=False)
class Playback:
    """A plan or a run as a film shows it; arrays have one row a place on the time axis.

    Attributes:
        problem: Its robot, and what is around it.
        goals: Configurations to reach [m, m, rad, 1/m ...], (3 + n,) each.
        nearest: Where it is nearest to an obstacle, if that is known.
        phases: When the robot is driven, and in which mode.
        intervals: Stiffness of each segment over time.
        stretch: Time axis.
        time_s: Time, (rows,).
        q: Configuration [m, m, rad, 1/m ...], (rows, 3 + n).
        temperature_C: Of the segments, (rows, n).
        melt_fraction: Of the segments, NaN where not known, (rows, n).
        heated: Whether the heaters are on, (rows, n).
        stages: What is done from when to when; none without a mission.
        objects: Poses of the objects that are known [m, m, rad], (rows, objects, 3).
        targets: Where objects shall be carried: number of the object, from 0, and pose (3,).
        off: How paths are followed; none where that is not shown.
    """

    problem: Problem
    goals: tuple[Array, ...]
    nearest: Clearance | None
    phases: tuple[Phase, ...]
    intervals: tuple[tuple[Interval, ...], ...]
    stretch: TimeStretch
    time_s: Array
    q: Array
    temperature_C: Array
    melt_fraction: Array
    heated: NDArray[np.bool_]
    stages: tuple[Stretch, ...] = ()
    objects: Array = field(default_factory=lambda: np.zeros((PLACES, 0, POSE)))
    targets: tuple[tuple[int, Array], ...] = ()
    off: tuple[Followed, ...] = ()

    def states(self, row: int) -> list[State]:
        """State of each segment."""
        return [state_at(each, self.time_s[row]) for each in self.intervals]

    def doing(self, row: int) -> str:
        """Activity in words, after the task that it is for, if there is one."""
        time_s = self.time_s[row] + SAME_TIME_S
        for number, stage in enumerate(self.stages, start=1):
            if time_s < stage.to_s:
                return f"{number} of {len(self.stages)}: {stage.words}; {self._moving(row, time_s)}"
        return self._moving(row, time_s)

    def _moving(self, row: int, time_s: float) -> str:
        """Motion first, then what is waited for."""
        for phase in self.phases:
            if phase.start_s <= time_s < phase.end_s:
                verb = "driving" if is_rigid(phase.mode) else "bending"
                return f"{verb} in mode {mode_name(phase.mode)}"
        states = self.states(row)
        changing = [
            _all("segment", [state == what for state in states], what)
            for what in dict.fromkeys(states)
            if what in CHANGING
        ]
        if changing:
            return " and ".join(changing)
        if self.heated[row].any():
            return _all("heater", self.heated[row].tolist(), "on")
        return "cooling" if "soft" in states else "waiting"


def plan_playback(plan: Plan, least: float = 0.15) -> Playback:
    """Play a plan, each motion phase for at least ``least`` of an unstretched axis.

    Raises:
        NoPlanError: If there is no plan.
    """
    trajectory = plan.trajectory
    stretch = TimeStretch.of(plan.phases, trajectory.duration_s or 1.0, least)
    shown = trajectory.at(places_s(stretch))
    return Playback(
        problem=plan.problem,
        goals=tuple(goals(trajectory)),
        nearest=closest_approach(trajectory),
        phases=plan.phases,
        intervals=stiffness_intervals(trajectory),
        stretch=stretch,
        time_s=shown.t_s,
        q=shown.q,
        temperature_C=shown.temperature_C,
        melt_fraction=shown.melt_fraction,
        heated=shown.heater_current_A > 0.0,
        stages=stretches(trajectory),
        objects=object_poses(trajectory, shown.t_s, shown.q),
        targets=tuple(targets(trajectory)),
    )


def places_s(stretch: TimeStretch) -> Array:
    """Times at regular places along a time axis [s], (PLACES,)."""
    return stretch.inverse(np.linspace(0.0, 1.0, PLACES))


def _all(what: str, flags: Sequence[bool], state: str) -> str:
    """Say of those whose flag is set what they are."""
    chosen = [number for number, flag in enumerate(flags, start=1) if flag]
    return f"{named(what, chosen, len(flags))} {'is' if len(chosen) == 1 else 'are'} {state}"
