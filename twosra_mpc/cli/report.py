"""``twosra report``."""

from __future__ import annotations

from pathlib import Path

import click

from twosra_mpc.cli.options import output_options
from twosra_mpc.cli.output import EXIT_PLANNED, Output, check_writable, print_table
from twosra_mpc.plan import load_plan

_HELP = """Write a report on PLAN, a file written by "twosra plan --out", as the HTML page OUT.

The page needs nothing else and asks nothing of any network: send it as it is. It has the plan in
numbers, what is proved and what was verified, an animation, figures, set-points, and the scenario
and robot to plan it again. A plan file that holds no plan has a report with the reason.

\b
A plan and its report:
  twosra plan paper-1 --out plan.json
  twosra report plan.json report.html
"""


@click.command("report", help=_HELP)
@click.argument("plan", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@output_options
def report_command(plan: Path, out: Path, output: Output) -> int:
    """Write a report; see ``_HELP``."""
    from twosra_mpc.report import Origin, check_report_path, write_report  # takes a second

    check_writable(out)
    check_report_path(out)
    given = load_plan(plan)
    with output.progress("drawing"):
        write_report(given, out, Origin.of(plan))
    document = {"file": str(out), "bytes": out.stat().st_size, "status": str(given.status)}
    rows = [(name, f"{value}") for name, value in document.items()]
    output.report(lambda: document, lambda: print_table((given.robot.name, "report"), rows))
    return EXIT_PLANNED
