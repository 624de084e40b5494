"""``twosra fit-thermal``, and robot files copied with all but the identified segment."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import click
import tomlkit
from tomlkit.items import AoT, Table

from twosra_mpc.cli.options import ROBOT, Plot, argument, command, option, written
from twosra_mpc.cli.output import Output, counting, digits, print_table
from twosra_mpc.files import attributes, write_text
from twosra_mpc.keys import describe
from twosra_mpc.lab.identification import log_fit, thermal_fit
from twosra_mpc.lab.identification.heating_log import HeatingLog, read_heating_log
from twosra_mpc.lab.identification.log_fit import Residuals
from twosra_mpc.lab.identification.log_response import CORRECTED_S
from twosra_mpc.lab.identification.thermal_fit import LOGS_DIFFER, ThermalFit
from twosra_mpc.lab.identification.transition_fit import (
    SHORTEST_S,
    TransitionFit,
    identify_transitions,
    read_transitions,
)
from twosra_mpc.robot.description import Robot, load_robot, robot_document
from twosra_mpc.robot.segment import TwoNodeSegment

Scores = list[tuple[HeatingLog, thermal_fit.Score]]
Fit = TypeVar("Fit", thermal_fit.ThermalFit, TransitionFit)
Outcome = tuple[Fit, TwoNodeSegment, list[str]]  # with the robot's own segment, and doubts

_WARM_K = 1.0  # a first reading this far above the air is worth a word
_HEADER = ("heating RMS [C]", "cooling RMS [C]", "both RMS [C]", "largest [C]")


@command("fit-thermal")
def fit_thermal_command(
    log: Annotated[Path, argument()],
    robot: Annotated[str, option(**ROBOT)],
    ambient_C: float | None,
    out: Annotated[Path | None, written()],
    plot: Plot,
    others: Annotated[tuple[Path, ...], option("--held-out")],
    readings: Path | None,
    segment: Annotated[int, option(type=click.IntRange(min=1), default=1, metavar="N")],
    only_score: Annotated[bool, option("--score")],
    output: Output,
) -> None:
    """Identify the segments of a robot from LOG, a CSV file of heating and cooling, or of melts.

    LOG has the columns time_s, temp_C (raw sensor) and mode (heating, hold, cooling); or, with
    --readings, transition, target1, target2 (1 soft), kind (melt, freeze) and duration_s. A log in
    wrong units or with swapped labels, or a fit that tells nothing, is refused: no file is written.

    \b
    Fit the robot's segment, and see how well each cycle is told by the others:
      twosra fit-thermal heating.csv --robot 2sr-v2 --out fitted.toml --plot fit.png
    How well does the robot as it is explain a log?
      twosra fit-thermal heating.csv --robot 2sr-v2 --score
    Fit the durations of melts and freezes of a robot in use:
      twosra fit-thermal melts.csv --readings readings.csv --robot 2sr-v2 --out fitted.toml

    Options:
        robot: Whose segment it is: a built-in name or a file.
        ambient_C: Air [C]; default: the first reading.
        out: Write a robot file with the fit.
        plot: Draw the fit (png, pdf, svg).
        others: Score the fit on this log too, with nothing fitted to it; may be given several
            times.
        readings: LOG has melts and freezes: their temperatures (transition, time_s, reading1_C,
            ...).
        segment: Which one, of a robot whose file lists its segments.
        only_score: Only score the robot as it is.
    """
    described, number = load_robot(robot), segment - 1
    if readings is not None and (only_score or others or plot or ambient_C is not None):
        raise click.UsageError("--readings goes with --robot and --out only")
    if only_score and (out or plot):
        raise click.UsageError("--score fits nothing: there is nothing to write to --out or --plot")

    def fitted(identify: Callable[[thermal_fit.OnProgress], Fit], air_C: float) -> Outcome[Fit]:
        with output.progress("fitting") as tell:
            fit = identify(counting(tell, "fitting: fit"))
            if out is not None:
                write_identified_robot(robot, out, fit, number)
        own = thermal_fit.two_node_segment(described, number)
        return fit, own, log_fit.doubts(described, fit.segment, fit.fitted, air_C, number)

    if readings is not None:
        logged = read_transitions(log, readings, described.geometry.segments)
        found, own, doubts = fitted(
            lambda tell: identify_transitions(logged, described, str(log), tell, number),
            described.heater.ambient_C,
        )
        document = {**_transition_document(found), "warnings": doubts}
        output.report(lambda: document, lambda: _print_transitions(found, own, doubts))
        return
    recorded = read_heating_log(log, ambient_C)
    unseen = [read_heating_log(path) for path in others]
    if only_score:
        own = thermal_fit.two_node_segment(described, number)
        scores = [(each, thermal_fit.score(each, own)) for each in (recorded, *unseen)]
        output.report(lambda: _scores(scores), lambda: _print_scores(described, scores))
        return
    fit, own, doubts = fitted(
        lambda tell: thermal_fit.identify(recorded, described, tell, number), recorded.ambient_C
    )
    if plot is not None:
        from twosra_mpc.lab.figures.identification_figures import plot_thermal_fit

        plot_thermal_fit(fit, plot)
    scores = [(each, thermal_fit.score(each, fit.segment, fit.parameters.law)) for each in unseen]
    doubts += log_fit.holds_called_heating(recorded)
    output.report(
        lambda: {**_document(fit, scores), "warnings": doubts},
        lambda: _print_fit(recorded, fit, own, scores, doubts),
    )


def _transition_document(fit: TransitionFit) -> dict[str, Any]:
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
                **attributes(each, "fitted_s", "left_out_s", "error"),
            }
            for each in fit.predictions
        ],
    }


def _print_transitions(fit: TransitionFit, own: TwoNodeSegment, doubts: list[str]) -> None:
    rows = []
    for name in fit.fitted:
        span = f"{fit.smallest[name]:z.4g} to {fit.largest[name]:z.4g}"
        known = f"{getattr(own, name):z.4g}"
        rows.append((describe(name), f"{getattr(fit.segment, name):z.4g}", span, known))
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
    click.echo("".join(f"Warning: {doubt}.\n" for doubt in doubts), nl=False)


def _document(fit: thermal_fit.ThermalFit, scores: Scores) -> dict[str, Any]:
    """The fit as plain data; a number that is not known is null."""
    return {
        "log": fit.source,
        "robot": fit.robot,
        "segment": fit.segment.model_dump(mode="json"),
        **attributes(fit, "parameters", "standard_errors", "residuals", "held_out"),
        **attributes(fit, "own_residuals", "held_out_rms_C"),
        "scores": _scores(scores),
    }


def _scores(scores: Scores) -> list[dict[str, Any]]:
    return [{"log": log.source, "residuals": of.residuals, "law": of.law} for log, of in scores]


def _print_fit(
    log: HeatingLog,
    fit: thermal_fit.ThermalFit,
    own: TwoNodeSegment,
    scores: Scores,
    doubts: list[str],
) -> None:
    _print_parameters(fit, own)
    rows = [
        ("as fitted", *_residuals(fit.residuals), digits(fit.held_out_rms_C, 3)),
        (f"as in {fit.robot}, heater law fitted", *_residuals(fit.own_residuals), "-"),
        *((f"as fitted, on {at.source}", *_residuals(of.residuals), "-") for at, of in scores),
    ]
    print_table(("residual of the segment", *_HEADER, "cycles left out, RMS [C]"), rows)
    if fit.held_out:
        left_out = [(f"cycle {one.cycle + 1}", *_residuals(one.residuals)) for one in fit.held_out]
        print_table(("left out of the fit", *_HEADER), left_out)
    else:
        click.echo("No cross-validation by cycles: it takes two that heat and cool.\n")
    warm = log.despiked_C[0] - log.ambient_C
    start = f" It starts {warm:z.1f} K above: taken as cooled for long." if warm > _WARM_K else ""
    click.echo(
        f"Scored: {fit.residuals.points} points {fit.log.step_s:zg} s apart, heating and cooling; "
        f"in a hold the power is unknown, and the first {CORRECTED_S:zg} s after it help to find "
        f"its end.\nSpikes replaced: {int(log.spikes.sum())}. Air: {log.ambient_C:z.4g} C.{start}"
    )
    click.echo("".join(f"Warning: {doubt}.\n" for doubt in doubts), nl=False)


def _print_scores(robot: Robot, scores: Scores) -> None:
    rows = []
    for log, found in scores:
        law = f"K_p {found.law.gain_per_K:z.4f} 1/K, duty at 54 C {found.law.duty_at_54C:z.3f}"
        rows.append((log.source, *_residuals(found.residuals), law))
    print_table((f"{robot.name} on", *_HEADER, "heater law, fitted to the log"), rows)


def _print_parameters(fit: thermal_fit.ThermalFit, own: TwoNodeSegment) -> None:
    rows = []
    for name in thermal_fit.Parameters._fields:
        value, error, low, high = (
            getattr(each, name)
            for each in (fit.parameters, fit.standard_errors, fit.smallest, fit.largest)
        )
        span = f"{low:z.4g} to {high:z.4g}" if fit.held_out else "-"
        known = f"{getattr(own, name):z.4g}" if name in thermal_fit.SEGMENT_FIELDS else "-"
        rows.append((describe(name), f"{value:z.4g}", f"{error:z.2g}", span, known))
    fixed = f"{own.sensor_gain:z.4g}"
    rows.append(("sensor gain", fixed, "not identifiable", "-", fixed))
    header = ("parameter", "identified", "standard error", "without one cycle", f"in {fit.robot}")
    print_table(header, rows)


def _residuals(found: Residuals) -> tuple[str, ...]:
    return tuple(digits(value, 3) for value in found[:-1])  # all but the number of points


def write_identified_robot(
    source: str | Path, target: str | Path, fit: ThermalFit | TransitionFit, number: int = 0
) -> None:
    """Write a copy of a robot file whose ``[segment]`` has the identified values and ranges.

    Of a file that lists its segments, this is the one of a number, from 0. Everything else,
    comments included, stays as it is.

    Raises:
        InputError: If ``source`` is not TOML, or ``target`` cannot be written.
    """
    document = robot_document(source)
    segment = document["segment"]
    if isinstance(segment, AoT):
        segment = segment[number]
    assert isinstance(segment, Table)
    for name in fit.fitted:
        segment[name] = getattr(fit.segment, name)
    segment.comment(f"identified anew from {fit.summary}")
    if "ranges" not in segment:
        segment["ranges"] = tomlkit.table()
    ranges = segment["ranges"]
    assert isinstance(ranges, Table)
    for name in fit.fitted:
        ranges[name] = list(fit.segment.ranges[name])
    ranges.comment(
        "5 to 95 %: standard error, all fits that leave a part out, and at least"
        f" {100 * LOGS_DIFFER:zg} % on either side, as fits to logs of one segment differ"
    )
    write_text(target, tomlkit.dumps(document))
