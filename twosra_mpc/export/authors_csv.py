"""A plan as CSV with the columns of the authors' trajectories, for their scripts to read."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from twosra_mpc.arguments import public
from twosra_mpc.files import write_text
from twosra_mpc.plans.plan import Plan


@public
def save_authors_csv(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write configuration, input and stiffness of a plan, one row a sample, atomically.

    Units are SI: m, rad, 1/m, m/s, rad/s, s. Inputs and stiffness hold from their row to the next.

    Args:
        plan: The plan.
        path: Where to write it.
        rate_Hz: Rows per second, besides those where phases begin and end; default: the plan's
            own grid.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the rate or the path is not acceptable.
    """
    samples = plan.require().trajectory.held(rate_Hz)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    numbers = range(1, plan.robot.geometry.segments + 1)
    curvatures, modes = ([f"{letter}{j}" for j in numbers] for letter in "ks")
    inputs = ("v1", "v2", "u0", "v0", "r0")
    writer.writerow(["x", "y", "angle", *curvatures, *inputs, *modes, "time"])
    columns = (samples.q + 0.0, samples.v + 0.0, samples.mode, samples.t_s)
    for q, v, mode, time_s in zip(*(column.tolist() for column in columns), strict=True):
        writer.writerow((*q, *v, *mode, time_s))
    write_text(path, text.getvalue())
