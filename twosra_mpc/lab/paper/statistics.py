"""Statistics of the published loop on random problems, as the paper has them of its 100."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from twosra_mpc.lab.figures.paper_figures import plot_forward_kinematics
from twosra_mpc.lab.paper.section import Data, Tell
from twosra_mpc.lab.reproduction.published_runs import RandomRun, StopReason, random_runs
from twosra_mpc.robot.modes import is_rigid

FIGURE = "forward-kinematics.png"
_MOST_MODES = 4  # by the paper


def compute(folder: Path, tell: Tell, problems: int) -> Data:
    """Run the published loop on so many random problems of each kind, and count."""
    tell("running random problems")
    single, generic = random_runs(problems, "single-mode"), random_runs(problems, "generic")
    plot_forward_kinematics(folder / FIGURE)
    return {
        "problems": problems,
        **{f"single.{name}": share for name, share in _shares(single).items()},
        **{f"generic.{name}": share for name, share in _shares(generic).items()},
        "most_modes": max(len(one.run.sequence) for one in single),
        "most_modes_raw": max(len(one.run.every_mode) for one in single),
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
