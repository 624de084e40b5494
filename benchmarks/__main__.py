"""``python -m benchmarks SET``: run a problem set and write its report."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.progress import Progress

from benchmarks.problem_set import load_set, set_names
from benchmarks.report import report, run_set


@click.command()
@click.argument("name", metavar="SET", type=click.Choice(set_names()))
@click.option("--out", type=click.Path(path_type=Path), help="Write the report here as well.")
def main(name: str, out: Path | None) -> None:
    """Run both planners on a problem set and print a Markdown report."""
    problems = load_set(name)
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task(name, total=len(problems.problems))
        runs = run_set(problems, on_done=lambda _: progress.advance(task))
    text = report(problems, runs)
    if out is not None:
        out.write_text(text, encoding="utf-8")
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
