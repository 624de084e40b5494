"""``twosra scenarios``, ``twosra robots``."""

from __future__ import annotations

import click

from twosra_mpc.cli.options import output_options
from twosra_mpc.cli.output import EXIT_PLANNED, Output, numbers, print_table
from twosra_mpc.problem.problem import Problem, load_problem, scenario_names
from twosra_mpc.robot.description import load_robot, robot_names

_SCENARIOS_HELP = """List the built-in scenarios.

\b
What is there to plan?
  twosra scenarios
One of them with every default filled in, as a start for your own:
  twosra scenarios --json
"""


@click.command("scenarios", help=_SCENARIOS_HELP)
@output_options
def scenarios_command(output: Output) -> int:
    """List the built-in scenarios; see ``_SCENARIOS_HELP``."""
    problems = {name: load_problem(name) for name in scenario_names()}
    output.report(
        lambda: [{"name": name, **each.scenario()} for name, each in problems.items()],
        lambda: _print_scenarios(problems),
    )
    return EXIT_PLANNED


def _print_scenarios(problems: dict[str, Problem]) -> None:
    rows = []
    for name, problem in problems.items():
        start, goal = problem.start.configuration, problem.goal.configuration
        rows.append((name, problem.description, numbers(start), numbers(goal)))
    print_table(("scenario", "what it asks", "start", "goal [m, m, rad, 1/m, 1/m]"), rows)


_ROBOTS_HELP = """List the built-in robots.

\b
Which robots are there?
  twosra robots
All their numbers, SI, unit in the name:
  twosra robots --json
"""


@click.command("robots", help=_ROBOTS_HELP)
@output_options
def robots_command(output: Output) -> int:
    """List the built-in robots; see ``_ROBOTS_HELP``."""
    robots = [load_robot(name) for name in robot_names()]
    rows = [(r.name, r.path.model, ", ".join(r.timing), r.description) for r in robots]
    output.report(
        lambda: [robot.model_dump(mode="json") for robot in robots],
        lambda: print_table(("robot", "path model", "timings", "description"), rows),
    )
    return EXIT_PLANNED
