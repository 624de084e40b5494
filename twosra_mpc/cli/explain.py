"""``twosra explain``."""

from __future__ import annotations

from typing import Any

import click

from twosra_mpc.cli.output import EXIT_INFEASIBLE, EXIT_NO_PLAN, EXIT_PLANNED, print_table
from twosra_mpc.critical_path import in_words
from twosra_mpc.explanation import Explanation, explain
from twosra_mpc.plan import Status
from twosra_mpc.problem import Problem, load_problem


@click.command("explain")
@click.argument("scenario")
@click.option("--time-limit", "time_limit_s", type=float, help="Plan at most this long each [s].")
def explain_command(scenario: str, **overrides: Any) -> int:
    """Explain the plan of SCENARIO: what its duration is made of, what other plans would cost.

    Ctrl-C prints what is known so far.
    """
    given = {key: value for key, value in overrides.items() if value is not None}
    result = _explain_with_progress(load_problem(scenario, **given))
    _print_reasons(result)
    _print_duration(result)
    if result.alternatives:
        rows = [(other.change, other.price, other.outcome) for other in result.alternatives]
        print_table(("instead", "costs more", "outcome"), rows)
    if not result.complete:
        click.echo("twosra: interrupted before all alternatives were planned", err=True)
    return _exit_code(result)


def _explain_with_progress(problem: Problem) -> Explanation:
    """Say on standard error what is being planned, where that is a terminal."""
    from rich.console import Console
    from rich.status import Status as Spinner

    console = Console(stderr=True)
    if not console.is_terminal:
        return explain(problem)
    with Spinner("planning", console=console) as spinner:
        return explain(problem, on_progress=lambda words: spinner.update(f"planning {words}"))


def _print_reasons(result: Explanation) -> None:
    made = result.plan
    rows = [("status", str(made.status)), ("outcome", made.message)]
    rows += [("why" if i == 0 else "", reason) for i, reason in enumerate(result.why)]
    print_table((made.robot.name, made.planner), rows)


def _print_duration(result: Explanation) -> None:
    if not result.critical_path:
        return
    told = in_words(result.critical_path)
    rows = [(f"{duration:8.2f} s", words) for duration, words in told]
    print_table((f"{result.plan.duration_s:8.2f} s", "is the sum of"), rows)
    if result.hidden:
        rows = [(f"{one.activity.duration_s:8.2f} s", str(one)) for one in result.hidden]
        print_table(("at no cost", "meanwhile"), rows)


def _exit_code(result: Explanation) -> int:
    if result.plan.status is Status.INFEASIBLE:
        return EXIT_INFEASIBLE
    return EXIT_PLANNED if result.plan.found and result.complete else EXIT_NO_PLAN
