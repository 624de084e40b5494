"""The table of a batch: a row a problem, in Parquet files.

pandas is the frame: most laboratories have it, and it writes Parquet with the frame's ``attrs``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.files import reading, write_bytes
from twosra_mpc.installation import BATCH, require

if TYPE_CHECKING:
    import pandas as pd

RUNS, PARTS = "runs.parquet", "parts"  # in the folder of a batch: the whole table, and pieces of it

# Column -> type in the table. A number that there is none of is NaN, a text is empty.
RESULT_COLUMNS = {
    **dict.fromkeys(("status", "message", "sequence"), "str"),
    **dict.fromkeys(("cost", "lower_bound", "gap", "duration_s", "waiting_s"), "float64"),
    **dict.fromkeys(("fastest_cost", "search_gap"), "float64"),
    **dict.fromkeys(("moving_s", "energy_J", "critical_melts", "critical_freezes"), "float64"),
    **dict.fromkeys(("wall_s", "cpu_s"), "float64"),
    "verified": "bool",
}
# With both planners, what the greedy rule came to.
GREEDY_COLUMNS = {
    f"greedy_{name}": RESULT_COLUMNS[name]
    for name in (
        *("status", "message", "sequence", "cost", "duration_s", "waiting_s", "moving_s"),
        *("energy_J", "wall_s", "cpu_s"),
    )
}


@public
def read_runs(path: str | Path) -> pd.DataFrame:
    """Read the table of a batch, finished or not, in the order of its problems.

    ``attrs["varied"]`` lists the columns that say in what the problems differ. Status is that of a
    plan (optimal, feasible, infeasible, failed), or "refused" for a problem that is bad input.

    Args:
        path: The folder that ``twosra batch`` wrote, or a Parquet file in it.

    Raises:
        InputError: If there is no such table, nothing is finished yet, or pandas is missing.
    """
    require("a batch", "batch", *BATCH)
    import pandas as pd

    paths = table_paths(Path(path)) if os.path.isdir(path) else [Path(path)]
    if not paths:
        allowed = "a folder of twosra batch with a finished problem in it"
        raise InputError("runs", str(path), allowed)
    frames = [_read(one) for one in paths]
    whole = pd.concat(frames).drop_duplicates("problem").sort_values("problem", ignore_index=True)
    whole.attrs = frames[0].attrs
    return whole


def table_paths(folder: Path) -> list[Path]:
    """The whole table, or the pieces of it that are finished; what a crash left half is none."""
    whole = folder / RUNS
    return [whole] if whole.is_file() else sorted((folder / PARTS).glob("[!.]*.parquet"))


def problems_in(path: Path) -> NDArray[np.int64]:
    """Numbers of the problems in a table.

    Raises:
        InputError: If it is none.
    """
    return _read(path, ["problem"])["problem"].to_numpy()


def _read(path: Path, columns: list[str] | None = None) -> pd.DataFrame:
    import pandas as pd

    with reading(str(path), "runs", "a Parquet file that twosra batch wrote"):
        frame = pd.read_parquet(path, columns=columns)
        if columns is None:
            columns = ["problem", *frame.attrs["varied"], *RESULT_COLUMNS]
        frame[columns]  # are there
        return frame.astype({name: RESULT_COLUMNS.get(name, frame[name].dtype) for name in columns})


def frame_of(
    rows: Iterable[Mapping[str, Any]], varied: Mapping[str, str], *, greedy: bool
) -> pd.DataFrame:
    """Make a table of rows.

    Args:
        rows: Column -> value of each problem.
        varied: Column -> type of what is varied.
        greedy: Whether there are plans of the greedy rule beside the others.
    """
    import pandas as pd

    kinds = {"problem": "int64", **varied, **RESULT_COLUMNS, **(GREEDY_COLUMNS if greedy else {})}
    frame = pd.DataFrame.from_records(list(rows), columns=list(kinds)).astype(kinds)
    frame.attrs["varied"] = list(varied)
    return frame


def write_table(frame: pd.DataFrame, path: Path) -> None:
    """Write a table as a whole or not at all; its ``attrs`` go into the file's metadata.

    Raises:
        InputError: If it cannot be written.
    """
    write_bytes(path, frame.to_parquet(index=False))
