"""Table I and the figure of the locomotion units' paths: spirals fitted to the fibre anew."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from twosra_mpc.lab.figures.identification_figures import plot_paths
from twosra_mpc.lab.identification.path_fitting import CASES, fit_spirals
from twosra_mpc.lab.paper.section import Data, Section, Tell, declared
from twosra_mpc.robot.description import load_robot

FIGURE = "paths.png"
_NAMES = ("scale", "growth", "x", "y")
_GROWTH_OF_III = 0.2229  # published
_ROBOT = "2sra-v1"
_LENGTHS_M = (0.01, 1.0)  # between which the paper varied l


def compute(folder: Path, tell: Tell) -> Data:
    """Fit the three spirals, and draw them."""
    tell("fitting the spirals of Table I")
    robot = load_robot(_ROBOT)
    plot_paths(robot, folder / FIGURE)
    rows = {case: _row(fit) for case, fit in zip(CASES, fit_spirals(robot.geometry), strict=True)}
    geometries = (robot.geometry.with_values(segment_length_m=length) for length in _LENGTHS_M)
    changes = [
        [abs(b / a - 1.0) for a, b in zip(_row(short), _row(long), strict=True)]
        for short, long in zip(*map(fit_spirals, geometries), strict=True)
    ]
    return {
        "spirals": rows,
        "radius_by_equation": math.exp(-_GROWTH_OF_III * math.pi),
        "change_of_spiral_1": 100.0 * max(changes[0]),
        "change_of_b_of_spiral_2": 100.0 * changes[1][1],
    }


def _row(fit: Any) -> list[float]:
    return [fit.scale, fit.growth, *fit.centre]


def section(data: Data) -> Section:
    """Compare with Table I."""
    fits = dict[str, float]()
    for case, row in data["spirals"].items():
        fits |= {f"{case}.{name}": one for name, one in zip(_NAMES, row, strict=True)}
    return declared("paths", data | fits, pictures=(FIGURE,))
