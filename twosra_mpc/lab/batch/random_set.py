"""Random problems: where they begin and end, from a seed and ranges."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from twosra_mpc.errors import InputError
from twosra_mpc.problem.limits import SHAPE_LIMITS, shape_margins
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.validation import NonNegative, Value

_BLOCK = 256  # pairs drawn at once
_MOST_BLOCKS = 40  # in a row without any that is possible


class RandomSet(Value):
    """Random problems of a robot, start and goal uniform in ranges symmetric about zero.

    Drawn again are those whose start or goal has a shape that a limit forbids, e.g. units that
    overlap. The first so many of a longer set are those of a shorter one.
    """

    robot: str
    seed: Annotated[int, Field(ge=0)]
    count: Annotated[int, Field(ge=1)]
    position_m: NonNegative
    heading_rad: NonNegative
    curvature_per_m: NonNegative

    def ends(self, robot: Robot) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
        """Yield start and goal of each problem, as tables of a scenario.

        Raises:
            InputError: If hardly any shape within the ranges is possible.
        """
        ranges = (self.position_m, self.heading_rad, self.curvature_per_m)
        most = np.abs(np.tile(robot.coordinates.each(*ranges), 2))  # of -0.0, too
        rng, left, vain = np.random.default_rng(self.seed), self.count, 0
        while left:
            drawn = rng.uniform(-most, most, (_BLOCK, len(most))).reshape(_BLOCK, 2, -1)
            kept = drawn[_possible(robot, drawn)][:left]
            left, vain = left - len(kept), 0 if len(kept) else vain + 1
            if vain == _MOST_BLOCKS:
                allowed = f"ranges with shapes that are possible; {vain * _BLOCK} draws had none"
                raise InputError("curvature_per_m", self.curvature_per_m, allowed)
            yield from ((_table(start), _table(goal)) for start, goal in kept.tolist())


def _table(q: list[float]) -> dict[str, Any]:
    x_m, y_m, phi_rad, *kappa_per_m = q
    return {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad, "kappa_per_m": kappa_per_m}


def _possible(robot: Robot, drawn: Array) -> NDArray[np.bool_]:
    """True for pairs (m, 2, 3 + n) whose shapes no limit forbids."""
    margins = shape_margins(robot, drawn[:, :, POSE:].reshape(2 * len(drawn), -1))
    least = [margins[limit.name] for limit in SHAPE_LIMITS if not limit.driving]
    return np.min(least, axis=0).reshape(-1, 2).min(axis=1) >= 0
