"""What a tracker can be told: weights, limits that the robot file does not have, solver effort."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from twosra_mpc.validation import NonNegative, Positive, Value


class TrackerWeights(Value):
    """What a deviation from the plan costs.

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
    response_s: Positive = 0.3
    curvature_penalty: Positive = 100.0


class TrackerLimits(Value):
    """Limits of the drives, and how far from the plan the prediction starts at most.

    Attributes:
        wheel_rate_rad_s2: Largest change of a wheel command per second; stopping is exempt.
        dead_zone_rad_s: Smallest wheel command that turns a wheel. A smaller one is sent as zero or
            as this, whichever is nearer, as far as the rate limit lets it.
        deviation_m: Larger deviations of x and y are taken as this: the wheels run at their limit
            anyway, and the linearised limits hold near the plan.
        deviation_rad: The same for the heading.
        deviation_per_m: The same for a curvature.
    """

    wheel_rate_rad_s2: Positive = 100.0
    dead_zone_rad_s: NonNegative = 0.0
    deviation_m: Positive = 0.05
    deviation_rad: Positive = 0.5
    deviation_per_m: Positive = 20.0


class SolverSettings(Value):
    """Accuracy and effort of the quadratic program.

    Attributes:
        tolerance: Largest primal and dual residual; about the error of the first speeds, relative
            to their limits.
        max_iterations: Iterations after which the point reached is used as it is, if its residuals
            are small, and the step has failed otherwise.
    """

    tolerance: Positive = 3e-4
    max_iterations: Annotated[int, Field(ge=1)] = 100
