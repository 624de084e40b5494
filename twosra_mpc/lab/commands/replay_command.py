"""``twosra replay``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import click

from twosra_mpc import InputError, Robot, load_robot, with_path_model
from twosra_mpc.checking.followed import OFF_PATH, off_words
from twosra_mpc.cli.options import ROBOT, Plot, argument, command, option
from twosra_mpc.cli.output import Output, digits, print_table
from twosra_mpc.files import attributes
from twosra_mpc.lab.csv_table import numbers_in, read_csv
from twosra_mpc.lab.identification.motion_log import (
    IN_HAND,
    MotionLog,
    Transport,
    read_motion_log,
    transport,
)
from twosra_mpc.lab.identification.replay import PhaseReplay, replay
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import mode_name


@command("replay")
def replay_command(
    log: Annotated[Path, argument()],
    robot: Annotated[str, option(**ROBOT)],
    path_model: str | None,
    wheels: str | None,
    mode: str | None,
    path: Path | None,
    plot: Plot,
    output: Output,
) -> None:
    """Predict the phases of a LOG, and say how far off they end.

    LOG is a CSV file: a trial (x, y, angle, k1, k2, v1, v2, u0, v0, r0, s1, s2, time, as the
    authors of the robot log and `twosra export plan.csv` writes), or poses of both units while
    wheels turn at a known speed (time stamp, LU1 x, LU1 y, LU1 th, LU2 x, LU2 y, LU2 th in mm and
    degrees). "As bent": along the history of curvatures that was measured.

    A log of an object that is carried (time, x, y, angle, object_x, object_y, object_angle, perhaps
    path_x, path_y) is compared with its path: how far off, and how far it slipped in the hand.

    \b
    A trial, with its figure:
      twosra replay exp1.csv --robot 2sra-v1 --plot exp1.png
    Wheel speed and mode by the file's name (segment 1 soft, wheel 1 at 6 rad/s), and as options:
      twosra replay s1_v1_6.csv --robot 2sra-v1 --path-model log_spiral
      twosra replay poses.csv --robot 2sra-v1 --wheels 6,0,0,0 --mode 1,0
    How well was an object led along a path?
      twosra replay transport.csv --robot 2sra-v1 --path path.svg

    Options:
        robot: Which robot: a built-in name or a file.
        path_model: Predict by this path model, e.g. arc; default: the robot's.
        wheels: Wheel speeds of a log of wheels [rad/s], e.g. 6,0,0,0.
        mode: Mode of a log of wheels, e.g. 1,0.
        path: Path of the object in the log: CSV or SVG.
        plot: Draw every phase as measured and as predicted (png, pdf, svg).
    """
    described = load_robot(robot)
    if path_model is not None:
        described = with_path_model(described, path_model)
    speeds = None if wheels is None else numbers_in(wheels, "wheels", "four numbers: 6,0,0,0")
    bits = None if mode is None else numbers_in(mode, "mode", "0 or 1 for each segment: 1,0")
    if bits is not None and not set(bits) <= {0.0, 1.0}:
        raise InputError("mode", mode, "0 or 1 for each segment: 1,0")
    driven = None if bits is None else tuple(map(int, bits))
    table = read_csv(log, ())
    led = transport(table, path)
    if led is None and path is not None:
        raise InputError("--path", str(path), f"a log with columns {', '.join(IN_HAND)}")
    if led is not None and not {"v1", "LU1 x"} & set(table.names):
        if plot is not None:
            raise InputError("--plot", str(plot), "a log of what was commanded")
        document = {"log": str(log), "robot": described.name, "transport": led._asdict()}
        output.report(lambda: document, lambda: _print_transport(led))
        return
    recorded = read_motion_log(log, described, wheel_rad_s=speeds, mode=driven)
    phases = replay(recorded, described)
    if plot is not None:
        from twosra_mpc.lab.figures.identification_figures import plot_replay  # matplotlib is slow

        plot_replay(recorded, described, phases, plot)
    found = recorded, described, phases
    more = {} if led is None else {"transport": led._asdict()}
    output.report(lambda: {**_document(*found), **more}, lambda: _print(*found))
    if led is not None and not output.as_json and not output.quiet:
        _print_transport(led)


def _print_transport(led: Transport) -> None:
    """Print how an object was carried."""
    slip = "slip in the hand", f"{1e3 * led.slip_m:z.2f} mm at most"
    rows = [("carried", f"{led.from_s:z.1f} s to {led.to_s:z.1f} s"), slip]
    if led.off_path_mean_m is not None and led.off_path_m is not None and led.left_m is not None:
        rows.append((OFF_PATH, off_words(led.off_path_mean_m, led.off_path_m)))
        rows.append(("left of its path", f"{1e3 * led.left_m:z.0f} mm"))
    print_table(("object", ""), rows)


def _document(log: MotionLog, robot: Robot, phases: list[PhaseReplay]) -> dict[str, Any]:
    """The replay as plain data, SI; what is not known is null."""
    return {
        "log": log.source,
        "robot": robot.name,
        "path_model": robot.path.model,
        "commands": "wheels" if log.by_wheels else "inputs",
        "phases": [
            {
                "mode": phase.mode,
                "start_s": phase.time_s[0],
                "end_s": phase.time_s[-1],
                "rows": len(phase.time_s),
                **attributes(phase, "moved", "error", "error_as_bent"),
                "bend_rad": phase.bend_rad[-1],
                "predicted_bend_rad": phase.predicted_bend_rad[-1],
                **attributes(phase, "share", "pivot_rad_per_rad", "split"),
                **dict(zip(_RATES, phase.bend_rates_rad_s, strict=True)),
            }
            for phase in phases
        ],
    }


_RATES = ("predicted_rad_s", "best_second_rad_s", "mean_rad_s")


def _print(log: MotionLog, robot: Robot, phases: list[PhaseReplay]) -> None:
    curvatures = tuple(f"kappa{j + 1} [1/m]" for j in range(robot.coordinates.segments))
    header = ("phase", "mode", "time [s]", "end errors", "x [mm]", "y [mm]", "heading [rad]")
    rows = []
    for number, phase in enumerate(phases, 1):
        first = str(number), mode_name(phase.mode), f"{phase.time_s[-1] - phase.time_s[0]:z.1f}"
        for words, error in (
            ("of the commands", phase.error),
            ("as bent", phase.error_as_bent),
            ("of standing still", phase.moved),
        ):
            if error is not None:
                rows.append((*first, words, *_cells(error)))
                first = ("", "", "")
    print_table((*header, *curvatures), rows)
    bent = [
        (
            str(number),
            mode_name(phase.mode),
            *(digits(rate, 2) for rate in phase.bend_rates_rad_s),
            *(digits(value, 2) for value in (phase.share, phase.pivot_rad_per_rad, phase.split)),
        )
        for number, phase in enumerate(phases, 1)
        if any(phase.mode)
    ]
    if bent:
        rates = ("bend rate predicted [rad/s]", "best second", "mean")
        shares = ("share of the bend reached", "pivot [rad/rad]", "split")
        print_table(("phase", "mode", *rates, *shares), bent)
    commands = "wheel speeds" if log.by_wheels else "inputs"
    click.echo(f"Predicted from the {commands} logged, by {robot.name} ({robot.path.model}).")


def _cells(error: Array) -> list[str]:
    x, y, heading = error[:POSE].tolist()
    kappas = [f"{kappa:+z.1f}" for kappa in error[POSE:].tolist()]
    return [f"{1e3 * x:+z.0f}", f"{1e3 * y:+z.0f}", f"{heading:+z.2f}", *kappas]
