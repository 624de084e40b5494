"""Plans and runs of problems that several tests look at, made once a session."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from problems import exactly

from twosra_mpc import Plan, Problem, Result, load_problem, plan

if TYPE_CHECKING:
    from twosra_mpc.execution.simulation.simulate import Simulation

solution = cache(plan)


@cache
def cases(name: str) -> dict[str, list[Any]]:
    """Tables of ``cases/NAME.toml``."""
    path = Path(__file__).parent / "cases" / f"{name}.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))


def solved(scenario: str = "paper-1", exact: bool = False, **overrides: Any) -> Result:
    """What a built-in scenario with overrides comes to, to be met exactly if asked."""
    problem = load_problem(scenario, **overrides)
    return solution(exactly(problem) if exact else problem)


def planned(scenario: str = "paper-1", exact: bool = False, **overrides: Any) -> Plan:
    """The verified plan of a built-in scenario with overrides."""
    return solved(scenario, exact, **overrides).require()


@cache
def _run(problem: Problem, level: str, seed: int, executor: str) -> Simulation:
    """A run of a simulated robot by the plan of a problem, or by the greedy rule."""
    from twosra_mpc.execution.simulation.simulate import simulate  # OSQP takes a while

    made = solution(problem).require() if executor == "optimal" else None
    return simulate(problem, disturbance=level, seed=seed, executor=executor, plan=made)


def simulated(
    scenario: str,
    seed: int,
    robot: str = "2sra-v1",
    level: str = "moderate",
    executor: str = "optimal",
    **overrides: Any,
) -> Simulation:
    """A disturbed run of a built-in scenario on a robot."""
    return _run(load_problem(scenario, robot=robot, **overrides), level, seed, executor)
