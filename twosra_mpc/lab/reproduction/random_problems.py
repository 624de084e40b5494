"""Random problems and the published loop on them: drawn as its authors draw, and without structure.

The authors' script (2sr-agent-simulation, ``control.py``) draws a start, a stiffness and an input
by Python's ``random``, and lets forward kinematics make the target with both constant for 10 s: one
mode alone leads to every target. Its draws have no seed; with one, in the same order, they can be
repeated on any machine.
"""

from __future__ import annotations

import math
import random
from typing import Literal, NamedTuple

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.lab.reproduction.published_model import SEGMENT_M, published_jacobian
from twosra_mpc.lab.reproduction.published_runs import PublishedTrajectory, published_trajectory
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode

STEP_S, STEPS = 0.05, 200  # of forward kinematics
MOST_PER_M = 1.5 * math.pi / SEGMENT_M  # it ends before a curvature beyond
GENERIC = np.array([0.25, 0.25, math.pi, 78.0, 78.0])  # [m, m, rad, 1/m, 1/m], to both sides

Kind = Literal["single-mode", "generic"]


class RandomRun(NamedTuple):
    """The published loop on a random problem.

    Attributes:
        target_mode: Mode in which forward kinematics made the target; None if it was drawn.
        run: The loop's trajectory.
    """

    target_mode: Mode | None
    run: PublishedTrajectory


@public
def random_runs(problems: int, kind: Kind) -> list[RandomRun]:
    """Runs on so many problems, drawn from the seeds 0, 1, ...

    Args:
        problems: How many.
        kind: "single-mode" as the authors draw, "generic" with a target drawn like the start: x, y
            within 0.25 m, any phi, curvatures within 78 1/m.
    """
    found = []
    for seed in range(problems):
        mode: Mode | None = None
        if kind == "single-mode":
            driven, mode = draw_single_mode(seed)
        else:
            driven = np.random.default_rng(seed).uniform(-GENERIC, GENERIC, (2, len(GENERIC)))
        found.append(RandomRun(mode, published_trajectory(driven[0], driven[-1])))
    return found


def draw_single_mode(seed: int) -> tuple[Array, Mode]:
    """Draw a start at the origin, a mode and an input; the way driven, (rows, 5), and the mode.

    phi is drawn from -0.6 to 0.06 rad (as in the script), curvatures within 60 1/m, speeds of units
    within 8 mm/s, of the rigid robot within 30 mm/s and 0.1 rad/s.
    """
    draw = random.Random(seed)
    phi = draw.uniform(-0.6, 0.06)
    start = np.array([0.0, 0.0, phi, *(draw.uniform(-60.0, 60.0) for _ in range(2))])
    mode = (draw.randint(0, 1), draw.randint(0, 1))
    v = np.array([draw.uniform(-most, most) for most in (0.008, 0.008, 0.03, 0.03, 0.1)])
    return forward_kinematics(start, mode, v), mode


def forward_kinematics(start: Array, mode: Mode, v: Array) -> Array:
    """Drive with a constant input by Euler's rule; configurations (rows, 5), the start first."""
    rows = [start]
    for _ in range(STEPS):
        q = rows[-1] + STEP_S * (published_jacobian(rows[-1], start, mode) @ v)
        if np.abs(q[3:]).max() > MOST_PER_M:
            break
        rows.append(q)
    return np.array(rows)
