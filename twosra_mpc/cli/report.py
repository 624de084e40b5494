"""``twosra report``."""

from __future__ import annotations

from pathlib import Path

import click

from twosra_mpc.cli.options import out_argument, output_options
from twosra_mpc.cli.output import EXIT_PLANNED, Output
from twosra_mpc.plans.document import load_plan

_HELP = """Write a report on PLAN, a file written by "twosra plan --out", as the HTML page OUT.

The page needs nothing else and asks nothing of any network: send it as it is. It has the plan in
numbers, what is proved and what was verified, an animation, figures, set-points, and the scenario
and robot to plan it again. A plan file that holds no plan has a report with the reason.

\b
A plan and its report:
  twosra plan paper-1 --out plan.json
  twosra report plan.json report.html
"""


def _page(target: Path) -> None:
    from twosra_mpc.report import check_report_path  # matplotlib takes a second

    check_report_path(target)


@click.command("report", help=_HELP)
@click.argument("plan", type=click.Path(path_type=Path))
@out_argument(_page)
@output_options
def report_command(plan: Path, out: Path, output: Output) -> int:
    """Write a report; see ``_HELP``."""
    from twosra_mpc.report import Origin, write_report  # matplotlib takes a second

    given = load_plan(plan)
    with output.progress("drawing the report"):
        write_report(given, out, Origin.of(plan))
    document = {"file": str(out), "bytes": out.stat().st_size, "status": str(given.status)}
    output.record((given.problem.robot.name, "report"), document)
    return EXIT_PLANNED
