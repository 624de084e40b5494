"""Statistics of the published loop on random problems, as the paper has them of its 100."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from twosra_mpc.lab.figures.paper_figures import plot_forward_kinematics
from twosra_mpc.lab.paper.claims import Claim, Reading, equal, every
from twosra_mpc.lab.paper.section import Data, Picture, Section, Table, Tell
from twosra_mpc.lab.reproduction.published_runs import StopReason
from twosra_mpc.lab.reproduction.random_problems import RandomRun, random_runs
from twosra_mpc.robot.modes import MODES, is_rigid, mode_name

FIGURE = "forward-kinematics.png"
_MOST_MODES = 4  # by the paper
_KINDS = {"single_mode": "targets of FK", "generic": "targets drawn"}


def compute(folder: Path, tell: Tell, problems: int) -> Data:
    """Run the published loop on so many random problems of each kind, and count."""
    tell("running random problems")
    single, generic = random_runs(problems, "single-mode"), random_runs(problems, "generic")
    plot_forward_kinematics(folder / FIGURE)
    deviations = [one.fk_deviation for one in single]
    groups = {mode_name(mode): [one for one in single if one.target_mode == mode] for mode in MODES}
    return {
        "problems": problems,
        "single_mode": _shares(single),
        "generic": _shares(generic),
        "most_modes": max(len(one.run.sequence) for one in single),
        "most_modes_raw": max(len(one.run.every_mode) for one in single),
        "fk_deviation": {"median": float(np.median(deviations)), "most": max(deviations)},
        "slower_at_first": _share(single, lambda one: one.slower_at_first),
        "faster_later": _share(single, lambda one: one.faster_later),
        "by_target": {name: _row(group) for name, group in {"all": single, **groups}.items()},
    }


def _share(runs: Sequence[RandomRun], holds: Callable[[RandomRun], bool]) -> float:
    return float(np.mean([holds(one) for one in runs]))


def _shares(runs: Sequence[RandomRun]) -> dict[str, float]:
    """Shares of the runs in which the paper's claims hold."""
    return {
        "at_most_four": _share(runs, lambda one: len(one.run.sequence) <= _MOST_MODES),
        "last_rigid": _share(runs, lambda one: is_rigid(one.run.sequence[-1])),
        "last_rigid_raw": _share(runs, lambda one: is_rigid(one.run.every_mode[-1])),
        "ended": _share(runs, lambda one: one.run.stop is not StopReason.DIVERGED),
    }


def _row(runs: Sequence[RandomRun]) -> list[str]:
    """Number of runs; of those with 1 to 4 modes; of those rigid last; their iterations."""
    modes, iterations = (
        [len(one.run.sequence) for one in runs],
        [one.run.iterations for one in runs],
    )
    counts = [
        len(runs),
        *(modes.count(count) for count in range(1, _MOST_MODES + 1)),
        sum(is_rigid(one.run.sequence[-1]) for one in runs),
        sum(is_rigid(one.run.every_mode[-1]) for one in runs),
    ]
    extent = [f"{np.median(iterations):z.0f}", str(max(iterations))] if runs else ["-", "-"]
    return [*map(str, counts), *extent]


def section(data: Data) -> Section:
    """Compare the statistics with what the paper says of its 100 simulations."""
    return Section(
        name="statistics",
        title="Random problems",
        words=(
            f"{data['problems']} problems are drawn as the authors' program draws its own: a start,"
            " and a target that forward kinematics (FK) reaches in one mode (the paper: 100). As"
            " many have targets drawn without FK. As the authors plot, steps longer than 1e-5 are"
            " recorded; modes are counted in recorded steps, and in all iterations.",
        ),
        claims=(*_of_modes(data), *_of_curves(data), _of_ends(data)),
        tables=(_table(data["by_target"]),),
        pictures=(
            Picture(
                FIGURE,
                "Forward kinematics in each mode, and the published planner on the"
                " way to where it ends",
            ),
        ),
    )


def _of_modes(data: Data) -> tuple[Claim, Claim]:
    where = "section Simulation"
    steps = {"last_rigid_raw": "all iterations", "last_rigid": "recorded steps"}
    return (
        Claim(
            "At most four motion modes are used",
            where,
            (
                _at_most("largest number, recorded steps", data["most_modes"]),
                _at_most("largest number, all iterations", data["most_modes_raw"]),
                *_by_kind(data, {"at_most_four": "recorded steps"}),
            ),
        ),
        Claim(
            "The last mode is always rigid",
            where,
            tuple(_by_kind(data, steps)),
            "Where no rigid step is recorded, it would be shorter than 1e-5.",
        ),
    )


def _of_curves(data: Data) -> tuple[Claim, Claim]:
    figure, off = "section Simulation; Fig. 5(b)", data["fk_deviation"]
    distance = "median of the largest distance of the error from a straight line"
    worst = "the same, in the worst problem"
    return (
        Claim(
            "The configuration changes linearly by FK",
            figure,
            (
                equal(distance, 0.0, 100.0 * off["median"], "%", holds=5.0, caveat=10.0),
                equal(worst, 0.0, 100.0 * off["most"], "%", holds=5.0, caveat=15.0),
            ),
        ),
        Claim(
            "The planner starts slower than FK, and is then faster",
            figure,
            (
                every("above FK in all of the first tenth", data["slower_at_first"]),
                every("below FK in all of the second half", data["faster_later"]),
            ),
            "While one mode can make up for the whole error, the curve is that of the gain over"
            " time, the same for every task.",
        ),
    )


def _of_ends(data: Data) -> Claim:
    note = "The gain grows without end: what has not stopped when it passes 2 runs away."
    ends = tuple(every(words, data[kind]["ended"]) for kind, words in _KINDS.items())
    return Claim("The loop ends at the target", "Algorithm 1", ends, note)


def _by_kind(data: Data, counted: Mapping[str, str]) -> Iterator[Reading]:
    for kind, words in _KINDS.items():
        for name, steps in counted.items():
            yield every(f"{words}, {steps}", data[kind][name])


def _at_most(words: str, ours: int) -> Reading:
    return Reading(words, _MOST_MODES, ours, "", 0.0, 2.0, "at most")


def _table(rows: dict[str, list[str]]) -> Table:
    header = (
        *("target by FK in mode", "problems"),
        *(f"{count} mode{'s' * (count > 1)}" for count in range(1, _MOST_MODES + 1)),
        *("rigid last (recorded)", "rigid last (all)", "iterations, median", "most"),
    )
    cells = tuple((name, *row) for name, row in rows.items())
    return Table("The published planner, targets of FK", header, cells)
