"""The set-points of a plan as rows for the page: all of them, or evenly thinned and said so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twosra_mpc.plans.setpoints import rows
from twosra_mpc.plans.trajectory import Samples

MOST_ROWS = 1500  # a page with more of them is slow to scroll


class SetpointTable(NamedTuple):
    """Set-points as text.

    Attributes:
        names: Names of the columns, as in the CSV file.
        cells: Rows of text.
        time_s: Time of each row [s].
        words: Which rows these are.
    """

    names: list[str]
    cells: list[list[str]]
    time_s: list[float]
    words: str


def setpoint_table(samples: Samples) -> SetpointTable:
    """Return the plan's whole grid, or every k-th row and the last where it is very long."""
    names, table = rows(samples)
    step = -(-len(table) // MOST_ROWS)
    shown = table[np.unique([*range(0, len(table), step), len(table) - 1])]
    words = f"All {len(table)} rows of the plan's own grid"
    if step > 1:
        words = (
            f"{len(shown)} of {len(table)} rows of the plan's own grid, one in {step} and"
            " the last: the plan file has every row"
        )
    cells = [[_cell(n, value) for n, value in zip(names, row, strict=True)] for row in shown]
    return SetpointTable(names, cells, shown[:, 0].tolist(), words)


def _cell(name: str, value: float) -> str:
    if name.startswith("mode"):
        return str(int(value))
    digits = 3 if name.endswith(("_rad_s", "_A", "per_m")) or name.startswith("melt_") else 4
    digits = 2 if name.endswith("_C") else digits
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text
