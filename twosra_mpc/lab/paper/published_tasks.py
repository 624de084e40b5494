"""The five published tasks: as simulated by the authors, simulated anew, and planned here."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.files import number, read_text, reading
from twosra_mpc.lab.figures.paper_figures import (
    STEP_OF_TASK_S,
    STEP_S,
    TASK_COLOURS,
    plot_error_decrease,
    plot_published_tasks,
)
from twosra_mpc.lab.paper.claims import Claim, equal, every
from twosra_mpc.lab.paper.kept import Data, Part, Tell, digest
from twosra_mpc.lab.paper.section import Picture, Section, Table, percent
from twosra_mpc.lab.reproduction.published_runs import PublishedTrajectory, published_trajectory
from twosra_mpc.planning.planner import plan
from twosra_mpc.problem.problem import load_problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, sequence_name

TASKS_FIGURE, ERROR_FIGURE = "published-tasks.png", "error-decrease.png"
TASKS = tuple(TASK_COLOURS)
# Mode sequences and numbers of recorded rows of the authors' simulated trajectories, repository
# 2sr-agent-simulation (simulations 4, 2, 3, 1 and 5 are the paper's experiments 1 to 5).
PUBLISHED: dict[str, tuple[tuple[Mode, ...], int]] = {
    "paper-1": (((1, 1), (0, 1), (1, 0), (0, 0)), 140),
    "paper-2": (((1, 0), (0, 0)), 115),
    "paper-3": (((1, 1), (0, 1), (1, 0), (0, 0)), 144),
    "paper-4": (((0, 1), (0, 0)), 111),
    "paper-5": (((0, 1), (1, 0), (0, 0)), 62),
}
_COLUMNS = ("case", "x_m", "y_m", "phi_rad", "kappa1_per_m", "kappa2_per_m", "sigma1", "sigma2")
_CLONED, _CLONED_COLUMNS = "Data/simulation*.csv", ("x", "y", "phi", "k1", "k2", "s1", "s2")
_LEFT = (0.05, 0.001)  # shares of what is missing at the start


def part(simulations: Path | None) -> Part:
    """Return runs and plans of the five tasks, beside the authors' trajectories, if given."""

    def compute(folder: Path, tell: Tell) -> Data:
        rows = {} if simulations is None else read_simulations(simulations)
        data = {}
        for task in TASKS:
            tell(f"running and planning {task}")
            data[task] = _compare(task, rows.get(task))
        tell("drawing the five tasks")
        plot_published_tasks(folder / TASKS_FIGURE)
        plot_error_decrease(folder / ERROR_FIGURE)
        return data

    settings = {"simulations": None if simulations is None else digest(simulations)}
    return Part("tasks", settings, compute, (TASKS_FIGURE, ERROR_FIGURE))


def simulated(task: str) -> PublishedTrajectory:
    """Run the published loop on a published task."""
    problem = load_problem(task)
    ends = problem.start.configuration, problem.goal.configuration
    return published_trajectory(*ends, step_s=STEP_OF_TASK_S.get(task, STEP_S))


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
    if path.is_dir():
        cases = [_table(each, _CLONED_COLUMNS) for each in sorted(path.glob(_CLONED))]
        if not cases:
            raise InputError("simulations", str(path), f"a file, or a folder with {_CLONED}")
    else:
        values = _table(path, _COLUMNS)
        cases = [values[values[:, 0] == case, 1:] for case in np.unique(values[:, 0])]
    starts = {task: load_problem(task).start.configuration for task in TASKS}
    return {
        task: case
        for case in cases
        for task, start in starts.items()
        if np.allclose(case[0, :5], start, rtol=0.0, atol=1e-9)
    }


def _table(path: Path, columns: tuple[str, ...]) -> Array:
    """Columns of a CSV file, (rows, columns)."""
    source = str(path)
    with reading(source, "simulations"):
        table = [row for row in csv.reader(read_text(path, source).splitlines()) if row]
        names = [name.strip() for name in table[0]] if table else []
        for name in columns:
            if names.count(name) != 1:
                given = "missing" if name not in names else "given twice"
                allowed = f"one each of the columns {', '.join(columns)}"
                raise InputError(f"column {name}", given, allowed, source)
        places = [names.index(name) for name in columns]
        values = [
            [
                number(row[at] if at < len(row) else "", f"{names[at]}, row {index}", source)
                for at in places
            ]
            for index, row in enumerate(table[1:], 1)
        ]
        return np.array(values).reshape(-1, len(columns))


def _compare(task: str, recorded: Array | None) -> dict[str, Any]:
    run, problem = simulated(task), load_problem(task, robot="2sra-v1-paper")
    greedy = plan(problem.with_values(planner="greedy")).require()
    found = plan(problem).require()
    target = problem.goal.configuration
    rows = np.column_stack([run.q, run.mode])
    same = None
    if recorded is not None:
        alike = recorded.shape == rows.shape
        same = float(np.abs(recorded - rows).max()) if alike else float("inf")
    return {
        "sequence": [mode for mode, _ in groupby(map(tuple, run.mode[1:].tolist()))],
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
    given = any(of[task]["largest_difference"] is not None for task in TASKS)
    missing = "Trajectories: give the authors' simulations with --simulations FILE."
    return Section(
        name="tasks",
        title="Five pose-shape tasks",
        words=(
            "Algorithm 1 is run as published, on the model as published (steps of 0.05 s; 0.1 s for"
            " task 5, which its authors' data need). It has no time for melting and freezing. The"
            " table has what both planners take with it, for the robot as the paper models it.",
        ),
        claims=tuple(_claims(of)),
        tables=(_runs(of), _durations(of)),
        pictures=(
            Picture(
                TASKS_FIGURE, "The five tasks, as published (top) and as planned here (bottom)"
            ),
            Picture(
                ERROR_FIGURE,
                "Decrease of the distance to the target: in the published loop, and in time with"
                " all waits",
            ),
        ),
        missing="" if given else missing,
    )


def _claims(of: dict[str, Any]) -> Iterator[Claim]:
    """Claims of the paper on the five simulations, beside what they do here."""
    figure, five = "Fig. 6(a)", "of the five tasks"
    sequences, lengths = (
        float(np.mean([_as_published(task, of[task])[at] for task in TASKS])) for at in (0, 1)
    )
    reached = float(np.mean([of[task]["distance_left"] == 0.0 for task in TASKS]))
    last = {left: float(np.mean([of[task]["last"][str(left)] for task in TASKS])) for left in _LEFT}
    yield Claim(
        "The five simulations use these modes, in this order", figure, (every(five, sequences),)
    )
    yield Claim("The five simulations have so many recorded rows", figure, (every(five, lengths),))
    name = "largest difference of any coordinate (m, rad, 1/m) or mode"
    differences = {task: of[task]["largest_difference"] for task in TASKS}
    same = tuple(
        equal(f"{task}: {name}", 0.0, difference, holds=1e-9, caveat=1e-2)
        for task, difference in differences.items()
    )
    yield Claim("The five simulations take these trajectories", figure, same)
    to_the_bit = every("of the five tasks, to the last bit", reached)
    yield Claim("The simulated planner meets its targets", "Algorithm 1", (to_the_bit,))
    later = tuple(
        every(
            f"{five}: {100 * (1 - left):zg} % of x and y done later than of the shape", last[left]
        )
        for left in _LEFT
    )
    yield Claim(
        "x and y are what the planner fits last",
        "section Pose-Shape Formation",
        later,
        "The shape is bent first, then a rigid phase makes up for what is left in x and y.",
    )


def _as_published(task: str, one: dict[str, Any]) -> tuple[bool, bool]:
    """True if modes are those published, and if the number of recorded rows is."""
    modes, rows = PUBLISHED[task]
    return sequence_name(one["sequence"]) == sequence_name(modes), one["recorded_rows"] == rows


def _runs(of: dict[str, Any]) -> Table:
    rows = [
        (
            task,
            sequence_name(PUBLISHED[task][0]),
            sequence_name(one["sequence"]),
            str(PUBLISHED[task][1]),
            str(one["recorded_rows"]),
            str(one["iterations"]),
        )
        for task, one in of.items()
    ]
    header = ("task", "published modes", "ours", "published rows", "ours", "iterations")
    return Table("The published simulations, run anew", header, tuple(rows), numbers=3)


def _durations(of: dict[str, Any]) -> Table:
    rows = [
        (
            task,
            sequence_name(one["greedy_sequence"]),
            f"{one['greedy_duration_s']:z.1f}",
            sequence_name(one["sequence_planned"]),
            f"{one['duration_s']:z.1f}",
            percent(one["gap"]),
        )
        for task, one in of.items()
    ]
    ours = ("this planner", "duration [s]", "proved gap at full speed")
    header = ("task", "greedy rule", "duration [s]", *ours)
    return Table("With melting and freezing", header, tuple(rows), numbers=6)
