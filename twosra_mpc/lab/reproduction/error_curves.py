"""Distance to the target over normalised time: curves from 1 to 0, compared."""

from __future__ import annotations

import numpy as np

from twosra_mpc.robot.coordinates import Array

TIMES = 101  # normalised times 0, 0.01 ... 1
Curve = tuple[float, ...]  # (TIMES,), shares of the largest distance


def error_curve(q: Array, goal: Array) -> Curve:
    """Published distance (unweighted) of rows (n, 5) as a share of its largest, to 1e-6."""
    distance = np.linalg.norm(q - goal, axis=1)
    rows = np.linspace(0.0, 1.0, len(q))
    curve = np.interp(np.linspace(0.0, 1.0, TIMES), rows, distance / max(distance.max(), 1e-300))
    return tuple(curve.round(6).tolist())


def deviation(curve: Curve) -> float:
    """Largest distance of a curve from the straight line from 1 to 0."""
    return float(np.abs(np.array(curve) - np.linspace(1.0, 0.0, TIMES)).max())


def starts_above(curve: Curve, other: Curve) -> bool:
    """True if it is above the other over all of the first tenth (not at 0, where both are 1)."""
    return all(mine > yours for mine, yours in zip(curve[1:11], other[1:11], strict=True))
