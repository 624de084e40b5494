"""Independent check of what a plan does around obstacles, and of the boxes it drives through."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from twosra_mpc.checking.missions import mission_problems, rounded, times_wrong
from twosra_mpc.checking.sweep import Clearance, Sweep, stages, swept
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.limits import CLEARANCE, CONTACT, SOFT_TRAVEL, WORKSPACE
from twosra_mpc.problem.tolerances import ROUNDING


class Around(NamedTuple):
    """Findings about a plan's surroundings.

    Attributes:
        margins: Name of each limit -> margin [m]; none without obstacles.
        words: What is wrong, for the limits that are broken.
        tasks: Tasks that are not done, in words.
    """

    margins: dict[str, float]
    words: dict[str, str]
    tasks: tuple[str, ...]


def examine_around(trajectory: Trajectory) -> Around:
    """Check the clearance to obstacles, the travel while soft, and the tasks before the goal."""
    problem = trajectory.problem
    in_the_way = bool(problem.obstacles or problem.objects)
    if not in_the_way and not problem.tasks:
        return Around({}, {}, ())
    sweep = swept(problem, trajectory.samples)
    if sweep is None:  # it is anywhere
        lost = "a curvature runs away: where the robot is, is not known"
        return Around({CLEARANCE: -1.0} if in_the_way else {}, {CLEARANCE: lost}, ())
    if wrong := tuple(times_wrong(trajectory)):
        return Around({}, {}, wrong)
    found = {}
    if in_the_way:
        from twosra_mpc.checking import clearance  # loads GEOS

        of = stages(trajectory, sweep)
        found = {
            CLEARANCE: clearance.kept(trajectory, sweep, of),
            CONTACT: clearance.overlap_left(problem, sweep, of),
            WORKSPACE: clearance.within_m(problem, sweep, of),
            SOFT_TRAVEL: _soft_travel(trajectory, sweep),
        }
    margins = {name: margin for name, (margin, _) in found.items() if margin < np.inf}
    words = {name: text for name, (margin, text) in found.items() if margin < 0}
    told = mission_problems if problem.is_mission else _tasks_not_done
    return Around(margins, words, tuple(told(trajectory, sweep)))


def closest_approach(trajectory: Trajectory) -> Clearance | None:
    """Closest approach of a plan to an obstacle, to 0.2 mm; None where there is none.

    Objects count where they must be kept clear of, and what is carried counts as the robot.
    """
    problem = trajectory.problem
    if not problem.obstacles and not problem.objects:
        return None
    if (sweep := swept(problem, trajectory.samples)) is None:
        return None
    from twosra_mpc.checking.clearance import closest  # loads GEOS

    return closest(problem, sweep, stages(trajectory, sweep))


def _soft_travel(trajectory: Trajectory, sweep: Sweep) -> tuple[float, str]:
    """Margin of ``limits.soft_travel_m`` from the end of a drive to the next one's beginning.

    Before the first drive counts, too, and after the last one.
    """
    most, samples = trajectory.problem.robot.limits.soft_travel_m, trajectory.samples
    left, words = most, ""
    moving = np.flatnonzero(samples.moves[:-1])
    soft = samples.mode[moving].max(axis=1, initial=0) > 0
    for _, run in itertools.groupby(range(len(moving)), key=soft.__getitem__):
        rows = moving[list(run)]
        begin, end = samples.t_s[rows[0]], samples.t_s[rows[-1] + 1]
        first, last = np.searchsorted(sweep.t_s, [begin, end])
        moved = float(np.linalg.norm(sweep.q[last, :2] - sweep.q[first, :2]))
        if samples.mode[rows[0]].any() and most - moved < left:
            left = most - moved
            when = f"from {begin:z.1f} s to {end:z.1f} s"
            words = (
                f"soft, the middle link moves {moved:z.3g} m {when} (soft_travel_m = {most:zg} m)"
            )
    return 0.0 if abs(left) <= ROUNDING else left, words


def _tasks_not_done(trajectory: Trajectory, sweep: Sweep) -> Iterator[str]:
    """Tasks whose box b0 does not enter, after those before it."""
    since = 0
    for number, task in enumerate(trajectory.problem.passes, start=1):
        inside = rounded(task).met(sweep.q[since:, :3])
        if not inside.any():
            named = f"{task.do} {task.name}".strip()
            yield f"task {number} ({named}) is not done"
            return
        since += int(inside.argmax())
