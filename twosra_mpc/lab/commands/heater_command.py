"""``twosra simulate-heater``."""

from __future__ import annotations

import math
from pathlib import Path

import click

from twosra_mpc.cli.options import ROBOT, SEED, choice_option, command, file_option, plot_option
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.control import thermistor
from twosra_mpc.control.stiffness_controller import stiffness_controller
from twosra_mpc.errors import InputError
from twosra_mpc.lab.bench.heater_loop import (
    HeaterRun,
    LinearMap,
    Stretch,
    save_run,
    simulate_heater,
    stretches,
)
from twosra_mpc.robot.description import load_robot, segment_model
from twosra_mpc.robot.modes import Stiffness

_SENSORS: dict[str, thermistor.Characteristic] = {
    "ntc": thermistor.NtcDivider(),
    "linear": LinearMap(),
}


@command("simulate-heater")
@click.option("--robot", default="2sra-v1", help="A built-in name or a file.", **ROBOT)
@click.option("--segment", type=click.IntRange(1, 4), default=1, help="Which, where they differ.")
@click.option("--profile", default="soft:120,rigid:400", help="Set-points, and for how long [s].")
@click.option("--ambient", type=float, help="Air [C]; default: the robot's.")
@click.option("--start-temperature", type=float, help="Segment at the start [C]; default: the air.")
@choice_option("Thermistor in a divider, or the paper's straight line.", [*_SENSORS], "--sensor")
@click.option("--seed", type=SEED, default=0, help="Of the sensor's noise.")
@file_option("--out", "Write every sample as CSV.")
@plot_option("Draw the run")
def simulate_heater_command(
    robot: str,
    segment: int,
    profile: str,
    ambient: float | None,
    start_temperature: float | None,
    sensor: str,
    seed: int,
    out: Path | None,
    plot: Path | None,
    output: Output,
) -> None:
    """Simulate one segment's heater in closed loop: when does it melt, when is it rigid again?

    The loop is segment, thermistor and stiffness controller. The controller reports when the
    segment has truly become soft or rigid, which is what a robot should wait for.

    \b
    Melt the paper's segment and let it freeze, with a figure:
      twosra simulate-heater --plot heater.png
    The follow-up robot, softened twice:
      twosra simulate-heater --robot 2sr-v2 --profile soft:90,rigid:60,soft:60,rigid:120
    Does it pay to keep a segment warm? Start from 55 C, and look at "liquid or solid after":
      twosra simulate-heater --start-temperature 55
    """
    described = load_robot(robot)
    targets, duration_s = parse_profile(profile)
    air_C = described.heater.ambient_C if ambient is None else ambient
    if segment > (count := described.coordinates.segments):
        raise InputError("segment", segment, f"from 1 to {count}")
    controller = stiffness_controller(described, air_C, segment - 1)
    with output.progress("running"):
        run = simulate_heater(
            segment_model(described, air_C, segment - 1),
            thermistor.temperature_sensor(described, air_C, segment - 1, _SENSORS[sensor]),
            controller,
            targets,
            duration_s,
            start_temperature_C=start_temperature,
            seed=seed,
        )
        if out is not None:
            save_run(run, out)
        if plot is not None:
            from twosra_mpc.lab.figures.heating_figures import plot_heater

            plot_heater(run, controller, described.name, plot)
    summed_up = stretches(run, controller.soft_setpoint_C)
    output.report(
        lambda: {"robot": described.name, "stretches": summed_up, "events": run.events},
        lambda: _print_run(run, summed_up),
    )


def parse_profile(text: str) -> tuple[list[tuple[float, Stiffness]], float]:
    """Turn ``soft:120,rigid:400`` into start times with set-points, and the whole duration [s].

    Raises:
        InputError: Naming the entry that is wrong.
    """
    targets: list[tuple[float, Stiffness]] = []
    time = 0.0
    for number, entry in enumerate(text.split(",")):
        name, _, lasts = entry.strip().partition(":")
        setpoint: Stiffness
        match name:
            case "soft" | "rigid":
                setpoint = name
            case _:
                raise InputError(f"profile.{number}", entry, "soft:SECONDS or rigid:SECONDS")
        targets.append((time, setpoint))
        time += _seconds(lasts, f"profile.{number}")
    return targets, time


def _seconds(text: str, field: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError(field, text, "a positive number of seconds after the colon")
    return value


def _after(time_s: float, at_once: str) -> str:
    if math.isnan(time_s):
        return "not reached"
    return at_once if time_s == 0.0 else f"{time_s:z.1f} s"


def _print_run(run: HeaterRun, summed_up: tuple[Stretch, ...]) -> None:
    rows: list[tuple[str, ...]] = [
        (
            each.setpoint,
            f"{each.start_s:z.0f} s to {each.end_s:z.0f} s",
            _after(each.changed_s, "already liquid" if each.setpoint == "soft" else "still solid"),
            _after(each.told_s, "as before"),
            "" if each.setpoint == "rigid" else _after(each.settled_s, "at once"),
            f"{each.peak_C:z.1f} C",
            f"{each.heat_J:z.0f} J",
        )
        for each in summed_up
    ]
    header = ("set-point", "time", "liquid or solid after", "reported after")
    print_table((*header, "settled after", "peak", "heat"), rows)
    rows = []
    for event in run.events:
        i = abs(run.time_s - event.time_s).argmin()
        molten = f"{100 * run.melt_fraction[i]:z.0f} %"
        temperatures = (f"{run.temperature_C[i]:z.1f} C", f"{run.measured_C[i]:z.1f} C")
        rows.append((f"{event.time_s:z.1f} s", event.kind, *temperatures, molten))
    print_table(("reported at", "event", "temperature", "by the sensor", "molten"), rows)
