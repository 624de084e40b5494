"""``twosra report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from twosra_mpc.checking.plan_file import checked_text
from twosra_mpc.cli import options
from twosra_mpc.cli.output import Output
from twosra_mpc.files import read_bytes, text_of
from twosra_mpc.lab import report


@options.command("report")
def report_command(
    plan: Annotated[Path, options.argument()],
    out: Annotated[Path, options.out_argument(options.ending(".html", ".htm"))],
    output: Output,
) -> None:
    """Write a report on PLAN, a file written by "twosra plan --out", as the HTML page OUT.

    The page needs nothing else and asks nothing of any network: send it as it is. It has the plan
    in numbers, what is proved and what was verified, an animation, figures, and the scenario and
    robot to plan it again. A plan file that holds no plan has a report with the
    reason.

    \b
    A plan and its report:
      twosra plan paper-1 --out plan.json
      twosra report plan.json report.html
    """
    content = read_bytes(plan, str(plan))
    given = checked_text(text_of(content, str(plan)), str(plan)).believed(str(plan))
    with output.progress("drawing the report"):
        report.write_report(given, out, report.Origin.of(plan.name, content))
    document = {"file": str(out), "bytes": out.stat().st_size, "status": str(given.status)}
    output.record((given.problem.robot.name, "report"), document)
