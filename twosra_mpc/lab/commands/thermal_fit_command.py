"""``twosra fit-thermal``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.options import FILE, ROBOT, command, file_option
from twosra_mpc.cli.output import Output, counting, print_table
from twosra_mpc.lab.identification import plausibility
from twosra_mpc.lab.identification.fitted_segment import FITTED, two_node_segment
from twosra_mpc.lab.identification.identified_robot import write_identified_robot
from twosra_mpc.lab.identification.transition_fit import (
    SHORTEST_S,
    TransitionFit,
    identify_transitions,
    read_transitions,
)
from twosra_mpc.robot.description import load_robot
from twosra_mpc.robot.segment import TwoNodeSegment

_NAMES = {
    "power_K_per_s": "full power [K/s]",
    "coupling_per_s": "core to body [1/s]",
    "body_ratio": "heat of body / of core",
    "body_loss_per_s": "body to air [1/s]",
}


@command("fit-thermal")
@click.argument("log", type=FILE)
@click.option(
    "--readings",
    type=FILE,
    required=True,
    help="Temperatures meanwhile (transition, time_s, reading1_C, ...).",
)
@click.option(
    "--robot", required=True, help="Whose segment it is: a built-in name or a file.", **ROBOT
)
@file_option("--out", "Write a robot file with the fit.")
@click.option(
    "--segment",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Which one, of a robot whose file lists its segments.",
)
def fit_thermal_command(
    log: Path, readings: Path, robot: str, out: Path | None, segment: int, output: Output
) -> None:
    """Identify the segments of a robot from LOG, a CSV file of its melts and freezes.

    LOG has the columns transition, target1, target2 (1 soft), kind (melt, freeze) and duration_s. A
    log in wrong units or with swapped labels, or a fit that tells nothing, is refused: no file is
    written.

    \b
    Fit the segments of a robot in use:
      twosra fit-thermal melts.csv --readings readings.csv --robot 2sr-v2 --out fitted.toml
    """
    described = load_robot(robot)
    logged = read_transitions(log, readings, described.geometry.segments)
    with output.progress("fitting") as tell:
        count = counting(tell, "fitting: fit")
        fit = identify_transitions(logged, described, str(log), count, segment - 1)
        if out is not None:
            write_identified_robot(robot, out, fit, segment - 1)
    own = two_node_segment(described, segment - 1)
    doubts = plausibility.doubts(described, fit.segment, segment - 1)
    output.report(lambda: {**_document(fit), "warnings": doubts}, lambda: _print(fit, own, doubts))


def _document(fit: TransitionFit) -> dict[str, Any]:
    """The fit as plain data."""
    return {
        "log": fit.source,
        "robot": fit.robot,
        "segment": fit.segment.model_dump(mode="json"),
        "error_median": fit.quantile(0.5),
        "error_p90": fit.quantile(0.9),
        "within_35_percent": fit.within(0.35),
        "transitions": [
            {
                "transition": each.logged.number,
                "kind": each.logged.kind,
                "logged_s": each.logged.duration_s,
                "fitted_s": each.fitted_s,
                "left_out_s": each.left_out_s,
                "error": each.error,
            }
            for each in fit.predictions
        ],
    }


def _print(fit: TransitionFit, own: TwoNodeSegment, doubts: list[str]) -> None:
    rows = []
    for name in FITTED:
        span = f"{fit.smallest[name]:z.4g} to {fit.largest[name]:z.4g}"
        known = f"{getattr(own, name):z.4g}"
        rows.append((_NAMES[name], f"{getattr(fit.segment, name):z.4g}", span, known))
    print_table(("parameter", "identified", "with a part left out", f"in {fit.robot}"), rows)
    times = [
        (
            f"{each.logged.number}",
            each.logged.kind,
            *(f"{s:z.1f}" for s in (each.logged.duration_s, each.fitted_s, each.left_out_s)),
            f"{each.error:+z.0%}",
        )
        for each in fit.predictions
    ]
    header = ("transition", "kind", "logged [s]", "fitted [s]", "left out [s]", "error")
    print_table(header, times)
    click.echo(
        f"Each left out of the fit, durations are off by {fit.quantile(0.5):z.1%} (median), nine of"
        f" ten within {fit.quantile(0.9):z.1%}; {fit.within(0.35)} of {len(fit.predictions)} within"
        f" 35 %. What lasted less than {SHORTEST_S:zg} s is told, but not fitted."
    )
    for doubt in doubts:
        click.echo(f"Warning: {doubt}.")
