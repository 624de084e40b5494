"""Statistics of the published planner on random problems, and of the optimal one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.files import plain_data
from twosra_mpc.lab.figures.paper_figures import plot_forward_kinematics
from twosra_mpc.lab.figures.study_figures import plot_error_curves
from twosra_mpc.lab.paper.claims import Claim, Reading, equal, every
from twosra_mpc.lab.paper.kept import Data, Kept, Part, Tell
from twosra_mpc.lab.paper.pieces import ROBOT, Study, random_problems
from twosra_mpc.lab.paper.section import Picture, Section, Table, percent
from twosra_mpc.lab.reproduction.error_curves import TIMES
from twosra_mpc.lab.reproduction.fixed_waits import fixed_waits_s
from twosra_mpc.lab.reproduction.greedy_statistics import (
    StudyProblem,
    optimal_statistics,
    statistics,
)

ONE_FIGURE = "forward-kinematics.png"
CURVES_FIGURE = "errors-of-random-problems.png"


def part(kept: Kept, problems: int, processes: int) -> Part:
    """Return the study of so many random problems of each kind."""

    def compute(folder: Path, tell: Tell) -> Data:
        study = random_problems(kept, problems, processes, tell)
        tell("drawing the random problems")
        single, best = statistics(study.single_mode), optimal_statistics(study.optimal)
        plot_forward_kinematics(folder / ONE_FIGURE)
        plot_error_curves(study.single_mode, folder / CURVES_FIGURE)
        found = {
            "single_mode": single,
            "generic": statistics(study.generic),
            "optimal": {**plain_data(best), "published_wait_s": _published_wait_s(study)},
            "faster_later": float(np.mean([_is_faster(one) for one in study.single_mode])),
        }
        document: Data = plain_data(found)
        return document

    figures = (ONE_FIGURE, CURVES_FIGURE)
    return Part("statistics", {"problems": problems, "robot": ROBOT}, compute, figures)


def section(data: Data) -> Section:
    """Compare the statistics with what the paper says of its 100 simulations."""
    single, generic, optimal = data["single_mode"], data["generic"], data["optimal"]
    of = single["all"]["problems"]
    return Section(
        name="statistics",
        title="Random problems",
        words=(
            f"{of} problems are drawn as the authors' program draws its own: a start, and a target"
            " that forward kinematics (FK) reaches in one mode (the paper: 100). Another"
            f" {generic['all']['problems']} have targets drawn without FK. As the authors plot,"
            " steps longer than 1e-5 are recorded; modes are counted in recorded steps, and in all"
            " iterations.",
        ),
        claims=_claims(single, generic, data["faster_later"]),
        tables=(_modes_table(single), _planners_table(optimal)),
        pictures=(
            Picture(
                ONE_FIGURE,
                "Forward kinematics in each mode, and the published planner on the"
                " way to where it ends",
            ),
            Picture(CURVES_FIGURE, "Error over normalised time: bands hold nine problems of ten"),
        ),
    )


def _claims(single: Data, generic: Data, faster_later: float) -> tuple[Claim, ...]:
    curves = _of_curves(single, faster_later)
    ends = tuple(
        every(words, 1.0 - _share(found["diverged"]))
        for words, found in (("targets of FK", single), ("targets drawn", generic))
    )
    note = "The gain grows without end: what has not stopped when it passes 2 runs away."
    loop = Claim("The loop ends at the target", "Algorithm 1", ends, note)
    return (*_of_modes(single, generic), *curves, loop)


def _of_modes(single: Data, generic: Data) -> tuple[Claim, Claim]:
    where = "section Simulation"
    most, most_raw = (max(map(int, single["all"][name])) for name in ("recorded", "raw"))
    return (
        Claim(
            "At most four motion modes are used",
            where,
            (
                _at_most("largest number, recorded steps", 4, most),
                _at_most("largest number, all iterations", 4, most_raw),
                every("targets of FK, recorded steps", _share(single["at_most_four"])),
                every("targets drawn, recorded steps", _share(generic["at_most_four"])),
            ),
        ),
        Claim(
            "The last mode is always rigid",
            where,
            (
                every("targets of FK, all iterations", _share(single["last_rigid_raw"])),
                every("targets of FK, recorded steps", _share(single["last_rigid"])),
                every("targets drawn, all iterations", _share(generic["last_rigid_raw"])),
                every("targets drawn, recorded steps", _share(generic["last_rigid"])),
            ),
            "Where no rigid step is recorded, it would be shorter than 1e-5.",
        ),
    )


def _of_curves(single: Data, faster_later: float) -> tuple[Claim, Claim]:
    figure = "section Simulation; Fig. 5(b)"
    return (
        Claim(
            "The configuration changes linearly by FK",
            figure,
            (
                equal(
                    "median of the largest distance of the error from a straight line",
                    0.0,
                    100.0 * single["fk_deviation"]["median"],
                    "%",
                    holds=5.0,
                    caveat=10.0,
                ),
                equal(
                    "the same, in the worst problem",
                    0.0,
                    100.0 * single["fk_deviation"]["most"],
                    "%",
                    holds=5.0,
                    caveat=15.0,
                ),
            ),
        ),
        Claim(
            "The planner starts slower than FK, and is then faster",
            figure,
            (
                every("above FK in all of the first tenth", _share(single["slower_start"])),
                every("below FK in all of the second half", faster_later),
            ),
            "While one mode can make up for the whole error, the curve is that of the gain over"
            " time, the same for every task.",
        ),
    )


def _published_wait_s(study: Study) -> float:
    """Mean of the waits of the published sequences, of problems that the optimal planner plans."""
    planned = {one.seed for one in study.optimal if not math.isnan(one.duration_s)}
    waits = [sum(fixed_waits_s(one.recorded)) for one in study.single_mode if one.seed in planned]
    return float(np.mean(waits)) if waits else math.nan


def _is_faster(problem: StudyProblem) -> bool:
    """True if the planner is below FK in the second half, up to where both are at the target."""
    pairs = list(zip(problem.error, problem.fk_error, strict=True))[TIMES // 2 : -1]
    return all(planner < fk for planner, fk in pairs)


def _share(found: Mapping[str, Any]) -> float:
    """The share of a ``Share`` that was written as plain data."""
    return float(found["count"]) / float(found["of"])


def _at_most(words: str, published: int, ours: int) -> Reading:
    return Reading(words, published, ours, "", 0.0, 2.0, "at most")


def _modes_table(single: Data) -> Table:
    groups = {"all": single["all"], **single["by_target"]}
    most = max(map(int, single["all"]["recorded"]))
    rows = [
        (
            _mode(name),
            str(group["problems"]),
            *(str(group["recorded"].get(str(count), 0)) for count in range(1, most + 1)),
            f"{group['last'].get(RIGID, 0)}",
            f"{group['raw_last'].get(RIGID, 0)}",
            _digits(group["iterations"]["median"], 0),
            _digits(group["iterations"]["most"], 0),
        )
        for name, group in groups.items()
    ]
    header = (
        *("target by FK in mode", "problems"),
        *(f"{count} mode{'s' * (count > 1)}" for count in range(1, most + 1)),
        *("rigid last (recorded)", "rigid last (all)", "iterations, median", "most"),
    )
    return Table("The published planner, targets of FK", header, tuple(rows))


_STATUSES = {
    "optimal": "proved within 1 % of the best",
    "feasible": "planned, with a larger gap",
    "refused": "refused: not possible for the robot",
    "infeasible": "proved infeasible",
    "failed": "no plan found",
}
RIGID = "(0, 0)"  # as a key of plain data


def _mode(name: str) -> str:
    return name.replace("(", "[").replace(")", "]").replace(", ", ",")


def _planners_table(optimal: Data) -> Table:
    both = optimal["both"]
    rows = [
        ("planned", f"{optimal['planned']['count']} of {optimal['problems']}"),
        *((_STATUSES[status], str(count)) for status, count in optimal["statuses"].items()),
        ("also by the greedy rule", f"{both['count']} of {both['of']}"),
        ("shorter than the greedy rule", f"{optimal['shorter']['count']} of {both['count']}"),
        ("time saved, median", percent(optimal["saved"]["median"])),
        ("duration, median", f"{_digits(optimal['duration_s']['median'])} s"),
        ("waiting of it, median", f"{_digits(optimal['waiting_s']['median'])} s"),
        (
            "proved gap, median and largest",
            f"{percent(optimal['gap']['median'])}, {percent(optimal['gap']['most'])}",
        ),
        ("rigid last", f"{optimal['last_rigid']['count']} of {optimal['last_rigid']['of']}"),
        *(
            (f"plans of {n} phase{'s' * (n != '1')}", str(count))
            for n, count in optimal["phases"].items()
        ),
        (
            "mean waits by the trials' fixed times, their sequences",
            f"{_digits(optimal['hardware_wait_s']['mean'])} s",
        ),
        (
            "the same, published sequences of the same problems",
            f"{_digits(optimal['published_wait_s'])} s",
        ),
    ]
    caption = f"The optimal planner on the same problems (robot {ROBOT}, with waits)"
    return Table(caption, ("", "found"), tuple(rows))


def _digits(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{value:z.{digits}f}"
