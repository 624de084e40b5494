"""``twosra verify``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from twosra_mpc.checking.plan_file import PlanCheck, check_plan
from twosra_mpc.cli.options import output_options
from twosra_mpc.cli.output import (
    EXIT_BAD_INPUT,
    EXIT_NO_PLAN,
    EXIT_PLANNED,
    Output,
    print_table,
)
from twosra_mpc.errors import InputError

_HELP = """Check PLAN files independently of what they say of themselves.

The samples are integrated again by SciPy, and every rule is tested for the robot and the scenario
in the file: limits, goal, order of stiffness, heaters, metal. Energy, cost and gap are worked out
again. That the lower bound is one takes planning again: a plan does not show it.

\b
Is this plan safe to run, and what are its margins?
  twosra verify plan.json
In a script, by the exit code alone (0 verified, 4 not verified, 2 not a plan file):
  twosra verify --quiet plan.json && echo go
Several plans, for a program to read:
  twosra verify plan.json other.json --json
"""


@click.command("verify", help=_HELP)
@click.argument("plans", metavar="PLAN...", nargs=-1, required=True, type=click.Path())
@output_options
def verify_command(plans: tuple[str, ...], output: Output) -> int:
    """Check plan files; see ``_HELP``."""
    code = EXIT_PLANNED
    checked: dict[str, PlanCheck] = {}
    with output.progress("verifying") as tell:
        for path in plans:
            tell(f"verifying {path}")
            try:
                checked[path] = check_plan(path)
            except InputError as error:
                click.echo(f"twosra: {error}", err=True)
                code = max(code, EXIT_BAD_INPUT)
    if checked:
        output.report(
            lambda: [_document(path, check) for path, check in checked.items()],
            lambda: _print_all(checked),
        )
    return code if all(check.ok for check in checked.values()) else EXIT_NO_PLAN


def _document(path: str, found: PlanCheck) -> dict[str, Any]:
    return {
        "file": path,
        "verified": found.ok,
        "status": str(found.result.status),
        "problems": found.problems,
        "checks": found.checks,
    }


def _print_all(checked: dict[str, PlanCheck]) -> None:
    for path, found in checked.items():
        _print(path, found)


def _print(path: str, found: PlanCheck) -> None:
    rows = []
    for check in found.checks:
        margin = "" if check.margin is None else f"{check.margin:.3g} {check.unit}"
        rows.append(("PASS" if check.ok else "FAIL", check.name, check.found, margin))
    print_table(("", Path(path).name, "found", "margin"), rows)
    verdict = "verified" if found.ok else "NOT VERIFIED"
    click.echo(f"{path}: {verdict}")
    for problem in found.problems:
        click.echo(f"  {problem}")
