r"""Setup of the quadratic program of a mode: what is tracked, weights and limits.

In each mode as many outputs y = T q are tracked as the wheels determine motions z.

.. math:: \dot y = T\,N(q)\,z

T N is regular, so any path of y can be followed, and what the wheels must do follows from it.
Rigid: y = (x, y, phi). Soft: the pose and the mean curvature of the soft segments, for the units
bend all of them at once, so one number is theirs to control, however many they are. In the paper's
wheel map only the side wheels turn while a segment is soft: then y = (phi, mean curvature), where
b0 goes meanwhile follows from its path, and cannot be corrected at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import Field

from twosra_mpc.model.kinematics import driven
from twosra_mpc.robot.coordinates import POSE, Array, Coordinates
from twosra_mpc.robot.description import Body
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments
from twosra_mpc.validation import Positive, Value


class TrackerWeights(Value):
    """Weights: what a deviation from the plan costs.

    Attributes:
        position_m: Unit of deviations of x and y; one unit costs one half per period.
        heading_rad: Unit of deviations of phi.
        curvature_per_m: Unit of deviations of the curvatures.
        response_s: Time constant with which a deviation decays while no limit is active.
        curvature_penalty: Cost of exceeding the curvature limit by one unit; an exact penalty, so
            the limit is kept wherever it can be kept.
    """

    position_m: Positive = 0.005
    heading_rad: Positive = 0.05
    curvature_per_m: Positive = 2.0
    response_s: Positive = 1.0
    curvature_penalty: Positive = 100.0


class TrackerLimits(Value):
    """Limits of the drives, and how far from the plan the prediction starts at most.

    Attributes:
        wheel_rate_rad_s2: Largest change of a wheel command per second, for a robot whose file has
            no ``wheel_acceleration_rad_s2``; stopping is exempt.
        deviation_m: Larger deviations of x and y are taken as this: the wheels run at their limit
            anyway, and the linearised limits hold near the plan.
        deviation_rad: The same for the heading.
        deviation_soft_m: The same in soft modes: a pose that a rigid drive can correct must not use
            up the speed that is there for bending, nor hold the robot in a shape in which its
            wheels cannot both keep the pose and bend.
        deviation_soft_rad: The same for the heading.
        deviation_per_m: The same for a curvature.
    """

    wheel_rate_rad_s2: Positive = 100.0
    deviation_m: Positive = 0.05
    deviation_rad: Positive = 0.5
    deviation_soft_m: Positive = 0.003
    deviation_soft_rad: Positive = 0.025
    deviation_per_m: Positive = 20.0


class SolverSettings(Value):
    """Accuracy and effort of the quadratic program.

    Attributes:
        tolerance: Largest primal and dual residual; the first speeds are off by about three times
            this share of their range at most, from minus to plus their limit.
        max_iterations: Iterations after which the point reached is used as it is, if its residuals
            are small, and the step has failed otherwise.
    """

    tolerance: Positive = 3e-5
    max_iterations: Annotated[int, Field(ge=1)] = 600


@dataclass(frozen=True, eq=False)
class Outputs:
    """Outputs of a mode.

    Attributes:
        selection: T, (m, 3 + n); a mean of coordinates has weights that add up to one.
        pose: Positions in q of the first outputs, phi is the last of them.
        bending: Positions in q of the curvatures that move; their mean is the last output.
    """

    selection: Array
    pose: tuple[int, ...]
    bending: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of outputs."""
        return len(self.selection)

    @property
    def heading(self) -> int:
        """Position of phi among the outputs."""
        return len(self.pose) - 1


@lru_cache(maxsize=32)
def outputs_of(body: Body, mode: Mode) -> Outputs:
    """Outputs of a mode: as many as the wheels determine."""
    size, motions = POSE + len(mode), driven(body, mode).size2_out("N")
    bending = tuple(POSE + segment for segment in soft_segments(mode))
    pose = tuple(range(POSE)[-(motions - bool(bending)) :])
    selection = np.eye(size)[list(pose)]
    if bending:
        selection = np.vstack([selection, np.eye(size)[list(bending)].mean(axis=0)])
    return Outputs(selection, pose, bending)


@dataclass(frozen=True)
class Setup:
    """Body, mode, horizon N, period h and what deviations cost; the numbers that follow.

    Compiled programs are kept by it, so there is nothing in it that they do not depend on.
    """

    body: Body
    mode: Mode
    horizon: int
    period_s: float
    weights: TrackerWeights
    limits: TrackerLimits
    facets: int = 0  # of the cone that keeps what is pushed

    @property
    def coordinates(self) -> Coordinates:
        """Coordinates: where the parts of a configuration are."""
        return Coordinates(len(self.mode))

    @property
    def outputs(self) -> Outputs:
        """Outputs that the mode tracks."""
        return outputs_of(self.body, self.mode)

    @property
    def variables(self) -> int:
        """Variables of the program: the deviations, and a slack where limits may be exceeded."""
        return self.outputs.count * self.horizon + int(self.slack)

    @property
    def slack(self) -> bool:
        """True if there are limits that a robot may be beyond: of curvatures, and of a push."""
        return bool(self.outputs.bending) or self.facets > 0

    @property
    def scale(self) -> Array:
        """Deviation of each output that costs one, (m,) [m, m, rad or rad, 1/m]."""
        weights = self.weights
        return self._of_outputs(weights.position_m, weights.heading_rad, weights.curvature_per_m)

    @property
    def largest_deviation(self) -> Array:
        """Deviation of each output at which a prediction starts at most, (m,)."""
        limits = self.limits
        pose = limits.deviation_soft_m, limits.deviation_soft_rad
        if is_rigid(self.mode):
            pose = limits.deviation_m, limits.deviation_rad
        return self._of_outputs(*pose, limits.deviation_per_m)

    def _of_outputs(self, position: float, heading: float, curvature: float) -> Array:
        each = self.coordinates.each(position, heading, curvature)
        return self.outputs.selection @ each

    @property
    def rho(self) -> float:
        """Cost of a change of the deviation per period, relative to the deviation itself."""
        return (self.weights.response_s / self.period_s) ** 2

    @property
    def terminal(self) -> float:
        """Cost of the last deviation, for all the periods beyond the horizon."""
        return (1 + math.sqrt(1 + 4 * self.rho)) / 2

    @property
    def decay(self) -> float:
        """Share that is left of a deviation after one period while no limit is active."""
        return self.rho / (self.rho + self.terminal)

    @property
    def wheel_change(self) -> float:
        """Largest change of a wheel command from one period to the next [rad/s]."""
        own = self.body.limits.wheel_acceleration_rad_s2
        return (own or self.limits.wheel_rate_rad_s2) * self.period_s
