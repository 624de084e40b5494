"""``twosra figures``."""

from __future__ import annotations

import os
from pathlib import Path

import click

from twosra_mpc.cli.options import choice_option, command
from twosra_mpc.cli.output import Output
from twosra_mpc.files import check_writable


@command("figures")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@choice_option("Of the files.", ("png", "pdf", "svg"), "--format", "ending")
def figures_command(folder: Path, ending: str, output: Output) -> None:
    """Draw the figures of the paper anew, from our own runs, into FOLDER.

    \b
    forward-kinematics  configuration by forward kinematics, and as the published planner gets there
    error-decrease      distance to the target over loop time, and over real time with all waits
    published-tasks     start, target and path of the five tasks, as published and as planned here

    \b
      twosra figures paper --format pdf
    """
    from twosra_mpc.lab.figures.paper_figures import PAPER_FIGURES  # matplotlib takes a second

    if not os.path.isdir(folder):
        check_writable(folder)
        folder.mkdir()
    targets = {name: folder / f"{name}.{ending}" for name in PAPER_FIGURES}
    for target in targets.values():
        check_writable(target)
    with output.progress("drawing") as tell:
        for name, target in targets.items():
            tell(f"drawing {name}")
            PAPER_FIGURES[name](target)
    files = [str(target) for target in targets.values()]
    output.report(lambda: files, lambda: click.echo("\n".join(files)))
