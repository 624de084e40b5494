"""What a tracker can be told: weights, limits that the robot file does not have, solver effort."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from twosra_mpc.validation import NonNegative, Positive, Value


class TrackerWeights(Value):
    """What a deviation from the plan costs.

    Attributes:
        position_m: Deviation of x or y that costs one.
        heading_rad: Deviation of phi that costs one.
        curvature_per_m: Deviation of a curvature that costs one.
        response_s: Time constant with which a deviation decays while no limit is active.
        curvature_penalty: Cost of exceeding the curvature limit by ``curvature_per_m``; an exact
            penalty, so the limit is kept wherever it can be kept.
    """

    position_m: Positive = 0.005
    heading_rad: Positive = 0.03
    curvature_per_m: Positive = 0.5
    response_s: Positive = 0.3
    curvature_penalty: Positive = 100.0


class TrackerLimits(Value):
    """Limits of the drives, and how far from the plan a measurement is believed.

    Attributes:
        wheel_rate_rad_s2: Largest change of a wheel command per second; a stop after a failure is
            exempt.
        dead_zone_rad_s: Smallest wheel command that turns a wheel. A smaller one is sent as zero or
            as this, whichever is nearer, as far as the rate limit lets it.
        deviation_m: Deviations of x and y are taken as no larger than this.
    """

    wheel_rate_rad_s2: Positive = 100.0
    dead_zone_rad_s: NonNegative = 0.0
    deviation_m: Positive = 0.1


class SolverSettings(Value):
    """Accuracy and effort of the quadratic program.

    Attributes:
        tolerance: Largest primal and dual residual of a solution; wheel limits and weighted
            deviations are of the order of one.
        max_iterations: Iterations after which a step has failed.
    """

    tolerance: Positive = 1e-4
    max_iterations: Annotated[int, Field(ge=1)] = 200
