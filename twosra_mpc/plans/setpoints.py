"""The set-points of a plan as a table, on its own grid or at a regular rate."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.arguments import public
from twosra_mpc.files import write_text
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.robot.coordinates import POSE, Array


def rows(samples: Samples) -> tuple[list[str], Array]:
    """Set-points as a table: (names of the columns, one row a sample)."""
    named = columns(samples)
    return list(named), np.column_stack(list(named.values()))


def columns(samples: Samples) -> dict[str, Array]:
    """Columns of the table by their names, units included, in order."""
    return {
        "t_s": samples.t_s,
        **_numbered("mode{}", samples.mode),
        **_numbered("wheel{}_rad_s", samples.wheel_rad_s),
        **_numbered("heater{}_C", samples.heater_setpoint_C),
        **_numbered("current{}_A", samples.heater_current_A),
        **dict(zip(("x_m", "y_m", "phi_rad"), samples.q.T, strict=False)),
        **_numbered("kappa{}_per_m", samples.q[:, POSE:]),
        **_numbered("temperature{}_C", samples.temperature_C),
        **_numbered("melt_fraction{}", samples.melt_fraction),
    }


def _numbered(name: str, values: Array | NDArray[np.int64]) -> dict[str, Array]:
    """Columns of an array under a name with their number, from 1."""
    return {name.format(i): column for i, column in enumerate(values.T, start=1)}


@public
def save_setpoints(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write the set-points of a plan as CSV, atomically; every row holds to the next.

    Wheels turn as far as in the plan: their speeds are means from row to row.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the rate or the path is not acceptable.
    """
    names, table = rows(plan.require().trajectory.held(rate_Hz))
    text, formats = io.StringIO(), ["%d" if name.startswith("mode") else "%s" for name in names]
    np.savetxt(text, table + 0.0, formats, delimiter=",", header=",".join(names), comments="")
    write_text(path, text.getvalue())
