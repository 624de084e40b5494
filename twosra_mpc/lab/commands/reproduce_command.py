"""``twosra reproduce``, ``twosra figures`` and ``twosra estimate-curvature``."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from twosra_mpc.cli.options import Plot, argument, command, ending, option, written
from twosra_mpc.cli.output import Output, counting, digits, print_table
from twosra_mpc.errors import InputError
from twosra_mpc.files import check_writable
from twosra_mpc.lab.csv_table import numbers_in
from twosra_mpc.lab.photographs.picture import PAPER_CAMERA, Camera
from twosra_mpc.lab.photographs.study import (
    BAND_NAMES,
    Estimate,
    estimate_folder,
    save_estimates,
    summary,
)

if TYPE_CHECKING:
    from twosra_mpc.lab.paper import PaperReport


@command("estimate-curvature")
def estimate_curvature_command(
    folders: Annotated[tuple[Path, ...], argument("FOLDER...")],
    scale_m: float,
    length_m: float,
    towards: Annotated[str, option(metavar="X,Y")],
    threshold: Annotated[float, option(default=120.0)],
    references: Annotated[tuple[Path, ...], option("--reference")],
    column: Annotated[str, option(default="kappa_per_m")],
    csv: Annotated[Path | None, written(ending(".csv"))],
    plot: Plot,
    figures: Path | None,
    output: Output,
) -> None:
    """Estimate the curvature of the segment that shines in each thermal photograph of FOLDER.

    By two estimators: "published", the steps of the robot's paper, and "arc", least squares of one
    arc, with a standard error and a test of whether the segment is an arc. Pictures without a
    segment, with two, or with one that is cut off are refused, by name.

    \b
    A row a picture (a pixel is 5 mm, the segment 40 mm long and held near pixel 39, 35):
      twosra estimate-curvature shots --scale .005 --length .04 --towards 39,35 --csv found.csv
    Beside references, of the column kappa_per_m of a CSV file:
      twosra estimate-curvature shots --scale .005 --length .04 --towards 39,35 --reference k.csv

    Options:
        scale_m: Width of a pixel [m].
        length_m: Of the segment [m].
        towards: A point [px] at the end the segment is followed to: positive is bent left on the
            way.
        threshold: Grey value that the segment exceeds.
        references: CSV file of reference curvatures; one for each folder.
        column: Its column of curvatures [1/m].
        csv: Write a row a picture.
        plot: Draw five pictures, and the estimates over the references (png, pdf, svg).
        figures: Draw every picture into this folder (png).
    """
    if references and len(references) != len(folders):
        raise InputError("reference", len(references), f"one for each of {len(folders)} folders")
    if figures is not None and not os.path.isdir(figures):
        raise InputError("figures", str(figures), "a folder that exists")
    seen: dict[str, Any] = {"scale_m": scale_m, "length_m": length_m, "threshold": threshold}
    camera = Camera(towards_px=pixel(towards), **seen)
    found = []
    with output.progress("reading pictures") as tell:
        for number, folder in enumerate(folders):
            given = (references[number], column) if references else None
            told = counting(tell, f"{folder.name}: picture")
            found.append(estimate_folder(folder, camera, given, told))
        every = [each for one in found for each in one]
        if csv is not None:
            save_estimates(every, csv)
        if plot is not None or figures is not None:
            from twosra_mpc.lab.figures.experiment_figures import plot_curvature  # takes a second
        if plot is not None:
            tell("drawing")
            plot_curvature(every, camera, plot)
        for number, each in enumerate(every if figures is not None else ()):
            tell(f"drawing: {number} of {len(every)}")
            if each.measured is not None and figures is not None:
                name = f"{each.path.parent.name}-{each.path.stem}.png"
                plot_curvature([each], camera, figures / name)
    output.report(lambda: _document(found), lambda: _print_estimates(found))


def pixel(text: str) -> tuple[float, float]:
    """Return the pixel (x, y) that a text names; otherwise raises an InputError."""
    x, y = numbers_in(text, "towards", "two numbers: 37,34", 2)
    return x, y


def _document(found: list[list[Estimate]]) -> dict[str, Any]:
    known = summary(found)
    known.pop("bands_mse_per_m2")
    estimates = [{**each.record, "picture": str(each.path)} for one in found for each in one]
    return {**known, "estimates": estimates}


def _print_estimates(found: list[list[Estimate]]) -> None:
    every, of = [each for one in found for each in one], summary(found)
    refused = [(str(each.path), each.refused) for each in every if each.refused]
    if refused:
        print_table(("refused picture", "allowed"), refused)
    if any(math.isfinite(each.reference_per_m) for each in every):
        _print_deviations(of)
    else:
        rows = []
        for each in every:
            if each.measured:
                error = each.measured.arc.standard_error_per_m
                values = each.published_per_m, each.arc_per_m, error
                rows.append((each.path.name, *(digits(value, 1) for value in values)))
        print_table(("picture", "published [1/m]", "arc [1/m]", "standard error"), rows)
    spread = of["published_mean_spread_per_m"]
    click.echo(
        f"{of['pictures'] - of['refused']} pictures measured, {of['refused']} refused. Published:"
        f" mean spread along the segment {math.nan if spread is None else spread:z.2f} 1/m.\n"
        f"Arc: {of['share_compatible_with_an_arc']:z.0%} of the segments are compatible with one"
        f" arc; medial lines are {1e3 * of['median_scatter_m']:z.2f} mm off theirs (median)."
    )


def _print_deviations(of: dict[str, Any]) -> None:
    rows = []
    for name, off in of["deviations"].items():
        bands = [digits(error, 1) for error in of["bands_mse_per_m2"][name]]
        of_cycles = f"{off.cycle_mse_per_m2:z.2f} ({off.cycles})" if off.cycles else "-"
        each = (f"{off.pictures}", f"{off.mse_per_m2:z.2f}", f"{off.slope:z.3f}")
        rows.append((name, *each, of_cycles.replace("nan", "-"), *bands))
    header = ("estimator", "pictures", "MSE [1/m2]", "slope", "MSE of mean repeats (how many)")
    print_table((*header, *(f"|kappa| {band}" for band in BAND_NAMES)), rows)


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
