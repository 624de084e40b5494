"""``twosra reproduce`` and ``twosra figures``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click

from twosra_mpc.cli.options import argument, command, option
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.errors import InputError
from twosra_mpc.files import check_writable
from twosra_mpc.lab.commands.curvature_command import pixel
from twosra_mpc.lab.photographs.picture import PAPER_CAMERA, Camera

if TYPE_CHECKING:
    from twosra_mpc.lab.paper import PaperReport


_AUTHORS = "https://github.com/Louashka/2sr-agent-control and 2sr-agent-simulation"
_FOLDER = click.Path(path_type=Path, file_okay=False)
_SCALE = "Width of a pixel [m].  [default: 0.00476]"  # of all its digits only these


@command("reproduce")
def reproduce_command(
    folder: Annotated[Path, option("--out", "-o", type=_FOLDER)],
    data: Path | None,
    logs: Path | None,
    photographs: Path | None,
    simulations: Path | None,
    column: Annotated[str, option(default="k1")],
    scale_m: Annotated[
        float, option(default=PAPER_CAMERA.scale_m, show_default=False, help=_SCALE)
    ],
    length_m: Annotated[float, option(default=PAPER_CAMERA.length_m)],
    towards: Annotated[str, option(metavar="X,Y", default="37,34")],
    problems: Annotated[int, option(default=100)],
    output: Output,
) -> None:
    """Compare the robot's paper with what comes of it here: every figure, table and claim.

    Writes report.html, its figures and numbers.json into a folder. Each claim has what is
    published, what we find, and a verdict by a rule. Trials and photographs are not part of this
    package: without them their claims are not checked, and the report says what to give.

    \b
    All that needs no data:
      twosra reproduce --out paper
    With the authors' data, clones of their repositories 2sr-agent-control and
    2sr-agent-simulation (https://github.com/Louashka) in the folder lab:
      twosra reproduce --out paper --data lab

    Options:
        folder: Folder for the report.
        data: Folder with hardware/, curvature/, or clones in it.
        logs: Folder of logs of trials, instead of hardware/.
        photographs: Folder of photographs, instead of curvature/.
        simulations: The authors' simulations, a CSV file or clone.
        column: Column of reference curvatures [1/m].
        length_m: Of the segment in them [m].
        towards: Pixel at its end to follow it to.
        problems: Random problems of each kind.
    """
    camera = Camera(scale_m=scale_m, length_m=length_m, towards_px=pixel(towards))
    if data is not None:
        found = located(data)
        logs, photographs = logs or found["logs"], photographs or found["photographs"]
        simulations = simulations or found["simulations"]
    from twosra_mpc.lab.paper import Sources, reproduce  # matplotlib takes a second

    sources = Sources(logs, photographs, simulations, column, camera)
    with output.progress("reading") as tell:
        report = reproduce(folder, sources, problems=problems, tell=tell)
    output.report(report.document, lambda: _print(report, folder))


_PLACES = {  # option -> folder or file of one's own, authors' repository, what shows its clone
    "logs": ("hardware", "control", "ExpData"),
    "photographs": ("curvature", "control", "ExpData/TempPhotos"),
    "simulations": ("published_simulations.csv", "simulation", "Data"),
}


def located(data: Path) -> dict[str, Path | None]:
    """Logs, photographs and simulations in a folder, or in clones of the authors' repositories.

    Raises:
        InputError: If there is nothing of all that.
    """
    found: dict[str, Path | None] = {}
    for kind, (own, repository, part) in _PLACES.items():
        clones = (data, data / f"2sr-agent-{repository}")
        cloned = next((clone for clone in clones if os.path.exists(clone / part)), None)
        found[kind] = data / own if os.path.exists(data / own) else cloned
    if not any(found.values()):
        allowed = f"a folder with hardware/ or curvature/ in it, or clones of {_AUTHORS}"
        raise InputError("data", str(data), allowed)
    return found


def _print(report: PaperReport, folder: Path) -> None:
    rows = [
        (section.title, claim.words, claim.where, str(claim.verdict))
        for section in report.sections
        for claim in section.claims
    ]
    print_table(("", "the paper says", "where", "verdict"), rows)
    for section in report.sections:
        if section.missing:
            click.echo(f"{section.title}: {section.missing}")
    counts = ", ".join(f"{count} {verdict}" for verdict, count in report.verdicts.items())
    click.echo(f"{counts}\n{folder / 'report.html'}")


@command("figures")
def figures_command(
    folder: Annotated[Path, argument(type=_FOLDER)],
    ending: Annotated[Literal["png", "pdf", "svg"], option("--format", default="png")],
    output: Output,
) -> None:
    """Draw the figures of the paper anew, from our own runs, into FOLDER.

    \b
    forward-kinematics  configuration by forward kinematics, and as the published planner gets there
    error-decrease      distance to the target over loop time, and over real time with all waits
    published-tasks     start, target and path of the five tasks, as published and as planned here

    \b
      twosra figures paper --format pdf

    Options:
        ending: Of the files.
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
