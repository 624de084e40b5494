"""What limits keep between the samples of a plan, proved: for plan files, where these may be few.

Nothing is to be done for rigid motion: its shape stays, its inputs grow steadily, so that most is
used of every limit at a sample. Nor for curvatures, each of which changes one way only from sample
to sample. Other motion is cut where inputs have moved a tenth of a millimetre, and integrated anew.
Where the rate of a share of a speed limit is within [m, M] for a time h, the share is nowhere more
than (M - m) h / 4 above the larger one at the ends. Parts of the robot come no nearer to each other
than half of what their gaps at the ends add up to, less how far points of them may have moved.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twosra_mpc.checking.reintegration import between, reintegrate
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.between import share_rates
from twosra_mpc.problem.limits import (
    BODY_GAP,
    UNIT_GAP,
    parts_moved_m,
    shape_margins,
    shares_used,
    speed_limits,
)
from twosra_mpc.problem.tolerances import BODY_TOLERANCE_M, RATE_TOLERANCE
from twosra_mpc.robot.coordinates import POSE

_CUT = 1e-4  # m: what an input moves between the places that are looked at


def between_problems(trajectory: Trajectory) -> Iterator[str]:
    """Limits of speed, and of gaps between parts, that are exceeded between samples."""
    samples, robot = trajectory.samples, trajectory.problem.robot
    soft = samples.mode[:-1].any(axis=1)
    fine, _ = between(samples, np.where(soft, _CUT, np.inf), least=1)
    q = reintegrate(trajectory.problem, fine)
    rows = np.flatnonzero(fine.mode[:-1].any(axis=1) & fine.moves[:-1])
    if not len(rows) or not np.isfinite(q).all():  # what is anywhere is told of already
        return
    h, a, mode = np.diff(fine.t_s)[rows], fine.a[rows], fine.mode[rows]
    places, inputs = (q[rows], q[rows + 1]), (fine.v[rows], fine.v[rows] + a * h[:, None])
    kappa = places[0][:, POSE:], places[1][:, POSE:]
    shapes, speeds = ((np.minimum(*ends), np.maximum(*ends)) for ends in (kappa, inputs))
    low, high = share_rates(robot, shapes, speeds, a, mode)
    ends = [shares_used(robot, *end, mode) for end in zip(places, inputs, strict=True)]
    beyond = iter((high - low) * h / 4)
    for limit, begin, end in zip(speed_limits(robot), *ends, strict=True):
        worst = (np.maximum(begin, end) + [next(beyond) for _ in begin]).max(axis=0)
        if worst.max() > 1 + RATE_TOLERANCE:
            by = (worst.max() - 1) * limit.most(robot)
            when = fine.t_s[rows[int(worst.argmax())]]
            when = f"at {when:z.3f} s, between samples"
            yield f"limit {limit.name} exceeded by up to {by:z.3g} {when}"
    moved_m = parts_moved_m(robot, np.abs(kappa[1] - kappa[0]))
    margins = [shape_margins(robot, end) for end in kappa]
    for gap in (UNIT_GAP, BODY_GAP):
        least = (margins[0][gap.name] + margins[1][gap.name] - moved_m) / 2
        if least.min() < -BODY_TOLERANCE_M:
            when, by = fine.t_s[rows[int(least.argmin())]], -least.min()
            yield f"limit {gap.name} exceeded by up to {by:z.3g} at {when:z.3f} s, between samples"
