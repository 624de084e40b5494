"""Independent check of the order of a plan's transitions, and of constant times."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.tolerances import TIME_TOLERANCE_S
from twosra_mpc.timing import Transition, transition_model
from twosra_mpc.timing.transitions import own_transitions


def transition_problems(trajectory: Trajectory) -> Iterator[str]:
    """Order and duration of the transitions of each segment, and the stiffness at the end."""
    problem, transitions = trajectory.problem, trajectory.transitions
    for earlier, after in itertools.pairwise(trajectory.phases):
        if after.start_s < earlier.end_s - TIME_TOLERANCE_S:
            yield f"the phase at {after.start_s:z.3f} s starts before the one before it has ended"
    timing, known = transition_model(problem), trajectory.samples.t_s[:, None]
    for j, stiffness in enumerate(problem.start_mode):
        before: Transition | None = None
        for item in own_transitions(transitions, j):
            name = f"segment {j + 1} to {item.to} at {item.heater_s:z.3f} s"
            if (item.to == "soft") == bool(stiffness):
                yield f"{name}: it is {item.to} already"
            if item.heater_s < (before.done_s if before else 0.0) - TIME_TOLERANCE_S:
                yield f"{name}: before the transition before it is done"
            if not item.heater_s - TIME_TOLERANCE_S <= item.onset_s <= item.done_s:
                yield f"{name}: heater, onset and done are out of order"
            if np.abs(known - np.array([item[2:]])).min(axis=0).max() > TIME_TOLERANCE_S:
                yield f"{name}: heater, onset or done is at no sample"
            for text in timing.violations(item, before, transitions):
                yield f"{name}: {text}"
            stiffness, before = int(item.to == "soft"), item
        if not problem.ends_anywhere and stiffness != problem.goal.mode[j]:
            wanted = "soft" if problem.goal.mode[j] else "rigid"
            yield f"segment {j + 1} does not end {wanted}"
