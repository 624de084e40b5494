"""A plan with more samples: a plan file is denser where it must be, and stays a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.checking.cost import cost_of
from twosra_mpc.checking.verification import verify
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import new_times


@public
def refined(plan: Plan, rate_Hz: float) -> Plan:
    """Add samples at a regular rate; those that the plan has stay, since its inputs change there.

    What is added has the input in force there, on the plan's path and at the temperatures expected
    there. The outcome is verified anew.

    Raises:
        InputError: If the rate is not positive, or beyond 1000 Hz.
    """
    given, known = plan.trajectory, plan.samples.t_s
    further = new_times(given.regular_times(rate_Hz), known)
    samples = given.at(np.sort(np.concatenate([known, further])))
    trajectory = replace(given, samples=samples)
    cost, verification = cost_of(trajectory), verify(trajectory)
    return replace(plan, trajectory=trajectory, cost=cost, verification=verification)
