"""From a measurement to a motion of the model over the horizon, symbolically."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.execution.tracking.stage import Stage
from twosra_mpc.robot.coordinates import POSE

Array = NDArray[np.float64]

CURVATURE_MARGIN = 1.01  # curvatures beyond the limit are taken as so many times the limit


class Start(NamedTuple):
    """A measured configuration, brought to where the model holds.

    Attributes:
        q: Configuration, (3 + n,).
        deviation: e_0, deviation of its outputs from the plan in units of the weights, (m,).
    """

    q: ca.SX
    deviation: ca.SX


class Period(NamedTuple):
    """One period of a motion.

    Attributes:
        half_way: Configuration in its middle, (3 + n,).
        step: Change of the outputs, (m,).
        kappa: Moving curvatures at its end [1/m].
        bending: Their derivative by the outputs.
    """

    half_way: ca.SX
    step: ca.SX
    kappa: ca.SX
    bending: ca.SX


def believed_start(setup: Setup, q: ca.SX, planned: ca.SX) -> Start:
    """Make a start of any finite measurement; headings count modulo 2 pi."""
    outputs = setup.outputs
    kappa = _bounded(q[POSE:], CURVATURE_MARGIN * setup.robot.limits.curvature_per_m)
    q = ca.vertcat(q[:POSE], kappa)
    deviation = ca.sparsify(ca.DM(outputs.selection)) @ q - planned
    turn = deviation[outputs.heading]
    deviation[outputs.heading] = turn - 2 * math.pi * ca.floor(turn / (2 * math.pi) + 0.5)
    deviation = _bounded(deviation, setup.largest_deviation)
    return Start(q, deviation / setup.scale)


def expected_deviations(setup: Setup, deviation: ca.SX, previous: ca.SX) -> list[ca.SX]:
    """e_0 ... e_N: the previous solution one period on, plus the response to what is new."""
    m, n, decay = setup.outputs.count, setup.horizon, setup.decay
    planned = [previous[k * m : (k + 1) * m] for k in range(n)]
    planned.append(decay * planned[-1])
    surprise = deviation - planned[0]
    return [planned[k] + decay**k * surprise for k in range(n + 1)]


def motion(setup: Setup, stage: Stage, start: Start, outputs: Sequence[ca.SX]) -> list[Period]:
    """The motion from ``start`` along outputs y_0, y_1, ...

    Outputs may follow any path; the curvatures that go with it are rolled out.
    """
    moving = list(setup.outputs.bending)
    bound = CURVATURE_MARGIN * setup.robot.limits.curvature_per_m
    kappa, bending = start.q[moving], stage.bending(start.q)
    periods = []
    for y, y_next in itertools.pairwise(outputs):
        step = y_next - y
        half_way = ca.SX(start.q)
        if moving:
            half_way[moving] = _bounded(kappa + bending @ step / 2, bound)
        else:
            half_way[:POSE] = y + step / 2
        bending = stage.bending(half_way)
        kappa = kappa + bending @ step
        periods.append(Period(half_way, step, kappa, bending))
    return periods


def _bounded(value: ca.SX, bound: float | Array) -> ca.SX:
    return ca.fmin(ca.fmax(value, -bound), bound)
