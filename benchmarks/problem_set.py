"""Problem sets: files with a seed, not code paths."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twosra_mpc import Goal, InputError, Problem, Robot, Start, load_problem, load_robot
from twosra_mpc.problem.limits import check_shapes

FOLDER = Path(__file__).parent / "sets"


@dataclass(frozen=True)
class ProblemSet:
    """A named list of problems.

    Attributes:
        name: Name of its file.
        problems: (label, problem) pairs.
        redrawn: Random problems that were drawn again because the units would overlap.
    """

    name: str
    problems: tuple[tuple[str, Problem], ...]
    redrawn: int


def set_names() -> list[str]:
    """Names of the problem sets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_set(name: str) -> ProblemSet:
    """Load a problem set by name."""
    data = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    if "scenarios" in data:
        named = tuple((scenario, load_problem(scenario)) for scenario in data["scenarios"])
        return ProblemSet(name, named, redrawn=0)
    rng = np.random.default_rng(data["seed"])
    robot = load_robot(data["robot"])
    ranges = (data["position_m"], data["heading_rad"], data["curvature_per_m"])
    problems: list[tuple[str, Problem]] = []
    redrawn = 0
    for problem in _draw(rng, robot, ranges):
        if len(problems) == data["count"]:
            break
        try:
            check_shapes(problem)
        except InputError:
            redrawn += 1
            continue
        problems.append((f"{name}/{len(problems)}", problem))
    return ProblemSet(name, tuple(problems), redrawn)


def _draw(
    rng: np.random.Generator, robot: Robot, ranges: tuple[float, float, float]
) -> Iterator[Problem]:
    position, heading, curvature = ranges
    while True:
        ends = []
        for _ in range(2):
            x, y = rng.uniform(-position, position, 2)
            phi = rng.uniform(-heading, heading)
            first, second = rng.uniform(-curvature, curvature, 2).tolist()
            ends.append((x, y, phi, (first, second)))
        start, goal = ends
        yield Problem(
            robot=robot,
            start=Start(x_m=start[0], y_m=start[1], phi_rad=start[2], kappa_per_m=start[3]),
            goal=Goal(x_m=goal[0], y_m=goal[1], phi_rad=goal[2], kappa_per_m=goal[3]),
        )
