"""Where the curvatures will be at the end of a plan that is driven on from a deviation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.bending import bending
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, soft_segments

Array = NDArray[np.float64]

_HALVINGS = 60  # of an interval of deviations, down to rounding


def predicted_curvatures(
    robot: Robot, deviated: Array, path: Sequence[Array], modes: Sequence[Mode]
) -> Array:
    """Curvatures at the end of a plan whose next phases are driven as they are, (n,) [1/m].

    The locomotion units bend all soft segments at once, each by the same change of its bending
    coordinate W. So in every phase the deviations of W of the soft segments are shifted by one
    number, and the tracker chooses it: it brings the mean of their curvatures to the plan's.

    Args:
        robot: The robot.
        deviated: Configuration now, (3 + n,).
        path: Configurations of the plan now and at the end of each of the phases.
        modes: Modes of these phases.
    """
    model = bending(robot)

    def coordinates(q: Array) -> Array:
        return np.array([model.coordinate(kappa) for kappa in q[POSE:].tolist()])

    deviation = coordinates(deviated) - coordinates(path[0])
    for end, mode in zip(path[1:], modes, strict=True):
        if soft := list(soft_segments(mode)):
            planned = coordinates(end)[soft]
            low, high = -deviation[soft].max(), -deviation[soft].min()
            for _ in range(_HALVINGS):
                shift = (low + high) / 2
                bent = model.curvature(planned + deviation[soft] + shift)
                if bent.mean() < end[POSE:][soft].mean():
                    low = shift
                else:
                    high = shift
            deviation[soft] += shift
    return model.curvature(coordinates(path[-1]) + deviation)
