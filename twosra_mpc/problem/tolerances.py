"""Tolerances of plans: how much of what they must keep they may miss, all in one place.

Whatever verification forgives, plans, lower bounds and certificates forgive as well: a lower bound
holds for every plan that is verified. So none of them writes a tolerance of its own.
"""

from __future__ import annotations

import math

import numpy as np

from twosra_mpc.robot.coordinates import Array

GOAL_TOLERANCE = 1e-6
"""What is this near to a goal is in it, in m, rad and 1/m."""
DEFECT_TOLERANCE = 1e-6
"""By so much samples may depart from what their inputs lead to, in m, rad and 1/m."""
CURVATURE_TOLERANCE_PER_M = 5e-6
"""By so much curvatures may be beyond their limit."""
BEYOND_PER_M = CURVATURE_TOLERANCE_PER_M + DEFECT_TOLERANCE
"""What no curvature of a verified plan is beyond its limit."""
INDEPENDENCE_TOLERANCE = 1e-6
"""By so much wheels may be less independent than a robot that drives needs them to be."""
TIME_TOLERANCE_S = 2e-6
"""By so much transitions and phases may be shorter than they must be, or overlap."""
RATE_TOLERANCE = 1e-7
"""Share of a limit of speed, acceleration or heating by which it may be exceeded, at all times."""
ROUNDING_M = 1e-6
"""What distances may miss of what they must be: that of inputs, of sums of them, of drawings."""
UNSEEN_M = 2e-4
"""By so much a plan may miss a clearance unseen: verification proves to within it."""
OVERLAP_M = 5e-4
"""Overlap allowed with what may be touched."""
TOUCHING_M = 1e-3
"""What is grasped or pushed is no further from the robot."""
BODY_TOLERANCE_M = 5e-4
"""Overlap of the robot with itself that is allowed between the samples of a plan."""
STILL_RAD = 1e-5
"""A bend of a single soft segment by no more is none: a phase that is not needed may keep it."""
STRAIGHT_RAD = 0.02
"""A segment that is bent by no more is straight: cameras see no less, and its spring is weak."""
LEVER_TOLERANCE = 1e-6
"""What levers of wheels may miss of what they must be, in lengths of a segment per rad."""
CERTAIN_LEVER, CERTAIN_END = 0.02, 1e-5
"""What they miss where bounds say so: more than they change between samples that are looked at; and
where a bend ends, in a sample."""
WHEEL_TOLERANCE_RAD_S = 1e-6
"""By so much a wheel may turn otherwise than its inputs ask, or not rest where a phase ends."""
JUMP_TOLERANCE = 1e-6
"""Share of the largest wheel speed that all jumps of a plan may add up to."""
COMMAND_TOLERANCE = 1e-9
"""By so much a heater's current and set-point may be others than the policy's, in A and C."""
HOLD_TOLERANCE_C = 1e-6
"""By so much metal may be warmer or colder than it is held, besides a model's replay tolerance."""
LEVEL_TOLERANCE = 1e-7
"""Share of the heat of melting that may lack, besides a model's replay tolerance."""
TEMPERATURE_TOLERANCE_C, FRACTION_TOLERANCE = 0.02, 2e-3
"""By so much stated temperatures and melt fractions may be others than the currents lead to."""
UNPROVED = 5e-4
"""Share of a reported lower bound that a certificate may leave open."""
CONFIRMED_TOLERANCE = 0.01
"""Share by which two accounts of a confirmed time may differ: melts begin early, or late."""
ROUNDING = 1e-9
"""Share by which two numbers may differ that are worked out alike: a sum of n doubles is exact to
n 2^-53 of their sizes, and a plan has less than 10^6 samples. It also is what a product of two
inputs may miss, and an allowance in m, rad and 1/m for positions that are added up."""
FIT_TOLERANCE = 1e-5
"""Share by which fitted parameters of a path model may differ, by versions of the solver."""
EFFORT_TOLERANCE = 5e-8
"""Share by which an effort may differ from that of another quadrature, as older files have it:
2e-8 is the most by which those of sixteen plans do."""
QUADRATURE_TOLERANCE = 1e-4
"""Share by which energy and effort of a candidate may differ from those of its plan's samples."""
COST_TOLERANCE_S, COST_TOLERANCE = 1e-4, 1e-6
"""What a plan can save by all its tolerances: absolute (ten changes of mode), and as a share."""


def kept_from_m(own_m: Array, kept_m: float) -> Array:
    """Distance that a motion keeps from things ``own_m`` away where it begins, (m,) [m].

    As much as it has there, less what is not seen, and no more than the clearance ``kept_m``.
    """
    return np.clip(own_m - UNSEEN_M, 0.0, kept_m)


def forgiven(bound_s: float, replay_tolerance: float = 0.0) -> float:
    """Lower bound on the cost of verified plans, from one on plans that keep all exactly [s].

    Bounds know goals, curvatures and the body with their tolerances; this is for the others. Five
    events of a change of mode may each be early by `TIME_TOLERANCE_S`, and speeds and
    accelerations too large by `RATE_TOLERANCE`, which slower motion makes up for; replayed
    transitions may be shorter by a share of their time.
    """
    if math.isinf(bound_s):
        return bound_s
    return max(0.0, bound_s * (1 - COST_TOLERANCE - replay_tolerance) - COST_TOLERANCE_S)
