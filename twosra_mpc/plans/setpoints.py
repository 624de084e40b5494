"""The set-points of a plan as a table, on its own grid or at a regular rate, and as CSV."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.arguments import public
from twosra_mpc.files import ending_of, write_text
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.robot.coordinates import POSE, Array


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
    ending_of(path, ".csv")
    write_text(path, setpoints_csv(plan, rate_Hz))


def setpoints_csv(plan: Plan, rate_Hz: float | None = None) -> str:
    """Return the set-points of a plan as CSV, as `save_setpoints` writes them.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the rate is not acceptable.
    """
    return csv_of(columns(plan.require().trajectory.held(rate_Hz)))


def csv_of(named: dict[str, Array]) -> str:
    """Columns under their names; modes are whole numbers."""
    formats = ["%d" if column.dtype.kind == "i" else "%s" for column in named.values()]
    text, table = io.StringIO(), np.column_stack(list(named.values())) + 0.0
    np.savetxt(text, table, formats, delimiter=",", header=",".join(named), comments="")
    return text.getvalue()
