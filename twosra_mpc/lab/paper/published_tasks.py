"""The five published tasks: as simulated by the authors, simulated anew, and planned here."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.lab.csv_table import read_csv
from twosra_mpc.lab.figures.paper_figures import (
    SIMULATION_OF_TASK,
    both_plans,
    plot_error_decrease,
    plot_published_tasks,
)
from twosra_mpc.lab.paper.section import Data, Section, Tell, declared
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import sequence_name

TASKS_FIGURE, ERROR_FIGURE = "published-tasks.png", "error-decrease.png"
TASKS = tuple(SIMULATION_OF_TASK)
_COLUMNS = ("case", "x_m", "y_m", "phi_rad", "kappa1_per_m", "kappa2_per_m", "sigma1", "sigma2")
_CLONED, _CLONED_COLUMNS = "Data/simulation*.csv", ("x", "y", "phi", "k1", "k2", "s1", "s2")
_LEFT = (0.05, 0.001)  # shares of what is missing at the start


def compute(folder: Path, tell: Tell, simulations: Path | None) -> Data:
    """Run and plan the five tasks, beside the authors' trajectories, if given."""
    rows = {} if simulations is None else read_simulations(simulations)
    data = {}
    for task in TASKS:
        tell(f"running and planning {task}")
        data[task] = _compare(task, rows.get(task))
    tell("drawing the five tasks")
    plot_published_tasks(folder / TASKS_FIGURE)
    plot_error_decrease(folder / ERROR_FIGURE)
    return data


def read_simulations(path: Path) -> dict[str, Array]:
    """Read recorded trajectories: a row a step, cases told apart by their column ``case``.

    A clone of the authors' repository 2sr-agent-simulation has a file for each case.

    Returns:
        Configurations and modes [m, m, rad, 1/m, 1/m, 1, 1], (rows, 7), of each published task
        that a case starts as; other cases are left out.

    Raises:
        InputError: If the file cannot be read, a column is missing or given twice, or a cell is no
            finite number.
    """
    if os.path.isdir(path):
        cases = [_table(each, _CLONED_COLUMNS) for each in sorted(path.glob(_CLONED))]
        if not cases:
            raise InputError("simulations", str(path), f"a file, or a folder with {_CLONED}")
    else:
        values = _table(path, _COLUMNS)
        cases = [values[values[:, 0] == case, 1:] for case in np.unique(values[:, 0])]
    starts = {task: simulation.start for task, simulation in SIMULATION_OF_TASK.items()}
    return {
        task: case
        for case in cases
        for task, start in starts.items()
        if np.allclose(case[0, :5], start, rtol=0.0, atol=1e-9)
    }


def _table(path: Path, columns: tuple[str, ...]) -> Array:
    """Columns of a CSV file, (rows, columns)."""
    return read_csv(path, columns, "simulations", least_rows=0).numbers(*columns)


def _compare(task: str, recorded: Array | None) -> dict[str, Any]:
    simulation, (found, greedy) = SIMULATION_OF_TASK[task], both_plans(task)
    run, target = simulation.run_freely(), simulation.goal
    rows = np.column_stack([run.q, run.mode])
    same = None
    if recorded is not None:
        alike = recorded.shape == rows.shape
        same = float(np.abs(recorded - rows).max()) if alike else float("inf")
    return {
        "sequence": run.sequence,
        "recorded_rows": len(run.q),
        "iterations": run.iterations,
        "distance_left": float(np.linalg.norm(run.final_q - target)),
        "last": {
            left: _row(run.q[:, :2] - target[:2], left)
            > _row(run.q[:, POSE:] - target[POSE:], left)
            for left in _LEFT
        },
        "largest_difference": same if same is None or np.isfinite(same) else 1e9,
        "greedy_duration_s": greedy.duration_s,
        "greedy_sequence": greedy.sequence,
        "duration_s": found.duration_s,
        "sequence_planned": found.sequence,
        "gap": found.search_gap,
    }


def _row(missing: Array, left: float) -> int:
    """First recorded row from which on less than this share is missing for good."""
    far = np.linalg.norm(missing, axis=1)
    return int(np.flatnonzero(far > left * far[0]).max(initial=-1)) + 1


def section(data: Data) -> Section:
    """Compare runs with what was published."""
    of = {task: data[task] for task in TASKS}
    differences = {task: one["largest_difference"] for task, one in of.items()}
    pairs = [(one, SIMULATION_OF_TASK[task]) for task, one in of.items()]
    same = [sequence_name(a["sequence"]) == sequence_name(b.sequence) for a, b in pairs]
    found = differences | {
        "sequences": np.mean(same),
        "rows": np.mean([one["recorded_rows"] == published.rows for one, published in pairs]),
        "reached": np.mean([one["distance_left"] == 0.0 for one in of.values()]),
        **{
            f"last_{left}": np.mean([one["last"][str(left)] for one in of.values()])
            for left in _LEFT
        },
    }
    lines = [
        {**one, "task": task, "published": SIMULATION_OF_TASK[task]} for task, one in of.items()
    ]
    return declared(
        "tasks",
        found,
        (lines, lines),
        (TASKS_FIGURE, ERROR_FIGURE),
        missing=set(differences.values()) == {None},
    )
