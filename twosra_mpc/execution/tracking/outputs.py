r"""What is tracked in each mode: as many outputs y = T q as the mode has inputs.

.. math:: \dot y = M(q)\,u, \qquad M = T\,J(q, \sigma)\,B

B picks the inputs of the mode. M is regular, so any path of y can be followed, and what the inputs
must be follows from it. Rigid: y = (x, y, phi). Soft: y = (phi, mean curvature of the soft
segments): two units bend all of them at once, so one number is theirs to control, however many they
are. Where b0 goes meanwhile follows from the path of y, and cannot be corrected at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outputs:
    """Outputs and inputs of a mode.

    Attributes:
        inputs: Positions in v = [v1, v2, u0, v0, r0] of the mode's inputs, m of them.
        selection: T, (m, 3 + n); a mean of coordinates has weights that add up to one.
        heading: Which output is phi.
        bending: Positions in q of the curvatures that move.
    """

    inputs: tuple[int, ...]
    selection: Array
    heading: int
    bending: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of outputs, and of inputs."""
        return len(self.inputs)


@lru_cache(maxsize=32)
def outputs_of(mode: Mode) -> Outputs:
    """Outputs and inputs of a mode, whatever the number of segments."""
    size = POSE + len(mode)
    if is_rigid(mode):
        return Outputs((2, 3, 4), np.eye(POSE, size), heading=2, bending=())
    bending = tuple(POSE + segment for segment in soft_segments(mode))
    selection = np.zeros((2, size))
    selection[0, 2] = 1.0
    selection[1, list(bending)] = 1.0 / len(bending)
    return Outputs((0, 1), selection, heading=0, bending=bending)
