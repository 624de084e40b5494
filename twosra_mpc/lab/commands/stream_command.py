"""``twosra stream``."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import click

from twosra_mpc.cli.options import argument, command, ending, option, written
from twosra_mpc.cli.output import Exit, Output, print_table
from twosra_mpc.execution.run import Ending, Run
from twosra_mpc.lab.commands import robot_line
from twosra_mpc.lab.serial.markers import load_markers
from twosra_mpc.lab.serial.port import SystemClock
from twosra_mpc.lab.serial.pose_lines import pose_lines
from twosra_mpc.lab.serial.robot import RATE_HZ
from twosra_mpc.lab.serial.stream import Confirm, StreamState, check_sendable, preview, stream
from twosra_mpc.planning.policy import relies
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.modes import mode_name


@command("stream")
def stream_command(
    source: Annotated[Path, argument("PLAN")],
    accept_paper_wheels: bool,
    port: str | None,
    dry_run: bool,
    rate_Hz: Annotated[float, option("--rate", metavar="HZ", default=RATE_HZ)],
    confirm: Annotated[Literal["required", "never"], option(default="required")],
    camera: Annotated[str | None, option(metavar="-|PORT")],
    markers: Path | None,
    log: Annotated[Path | None, written(ending(".json"))],
    robot_id: robot_line.RobotId,
    output: Output,
) -> int:
    """Send PLAN to a robot over a serial line, and switch the robot off at the end.

    Wheel speeds [rad/s] and heater states go out in the line format of the authors' firmware at
    115200 baud. The robot must report temperatures (lines A58.2, B24.9 and so on: readings of
    segments 1 and 2 in C) within 5 s: a phase begins when they confirm that the segments are soft
    and rigid as it needs, and heaters are switched by them.

    A robot that reports nothing is driven with --confirm never: phases begin at the plan's times,
    and heaters are switched by the model's heat. That needs a plan made with transition_quantile,
    which waits for slow segments too, and segments as cold as the plan says.

    With --camera the plan is tracked by what a tracking system sees, corrected, and planned again.
    It writes lines, on standard input or to a UDP port of this computer: Unix time [s], x, y [m],
    phi [rad], and the curvature [1/m] of each segment, separated by spaces or commas. With
    --markers a line has x, y and heading of each marker instead.

    Plans with the paper's wheel map are refused: without slip they bend the robot by 17 to 48 % of
    what is planned. Plan with 2sra-v1.

    Ctrl-C, Ctrl-\\, Ctrl-Z, SIGTERM, a closed terminal, every other signal that a program can catch
    and every error stop the wheels and switch the heaters off. Keep a hand at the switch all the
    same: after kill -9, or if the line breaks, the robot goes on with its last command until its
    firmware's watchdog ends it, which may take 2 s; without one (docs/hardware.md) it goes on for
    ever.

    Needs pyserial: {serial}

    \b
    See what would be sent, without a robot:
      twosra plan paper-2 --out plan.json
      twosra stream plan.json --dry-run
    Send it, and write down what was sent and reported:
      twosra stream plan.json --port /dev/ttyUSB0 --log run.json
    Follow it by a tracking system that writes lines of poses:
      tracker | twosra stream plan.json --port /dev/ttyUSB0 --camera - --rate 20
    One of several robots on the same radio:
      twosra stream plan.json --port COM3 --robot-id 1

    Options:
        accept_paper_wheels: Take the paper's wheel map as well.
        port: Serial port of the robot, e.g. /dev/ttyUSB0 or COM3.
        dry_run: Print times and lines; needs no port.
        rate_Hz: Commands (and camera frames) per second; the default is the authors' controller's.
        confirm: Whether phases begin by temperature reports, or at the plan's times.
        camera: Follow poses: standard input, or a UDP port.
        markers: Poses are those of markers on the robot (.toml).
        log: Write what was sent and reported, as a run (.json).
        robot_id: Sent at the end of each line, instead of the robot file's.
    """
    robot_line.check_line(port, dry_run)
    if dry_run and (camera or log):
        raise click.UsageError("--dry-run sends nothing: there is nothing to follow or to --log")
    if markers and not camera:
        raise click.UsageError("--markers says what the poses of --camera are of")
    plan = robot_line.drivable_plan(source, accept_paper_wheels=accept_paper_wheels)
    robot = robot_line.numbered(plan.robot, robot_id)
    problem = plan.problem.with_values(robot=robot)
    plan = replace(plan, trajectory=replace(plan.trajectory, problem=problem))
    check_sendable(plan, Confirm(confirm))
    if problem.risk == "nominal" and robot.uncertainty is not None and relies(plan.sequence):
        advice = "may share a bend unequally: a plan made with --risk mean takes less on average"
        click.echo(f"twosra: segments that are soft at once {advice}", err=True)
    if port is None:
        sent = preview(plan, rate_Hz)
        output.report(lambda: sent, lambda: robot_line.show_lines(sent))
        return Exit.PLANNED
    with ExitStack() as open_until_the_end:
        opened = open_until_the_end.enter_context(robot_line.line_to(port))
        poses = None
        if camera is not None:
            placed = None if markers is None else load_markers(markers)
            lines = pose_lines(camera, robot, rate_Hz, placed)
            poses = open_until_the_end.enter_context(lines)

        def drive() -> int:
            with output.progress("opening the line") as tell:
                run = stream(
                    plan,
                    opened,
                    SystemClock(),
                    rate_Hz=rate_Hz,
                    confirm=Confirm(confirm),
                    poses=poses,
                    log=log,
                    on_state=lambda state: tell(_where(state)),
                )
            return _ending_code(plan, run, output)

        return robot_line.exit_code_of(drive)


def _ending_code(plan: Plan, run: Run, output: Output) -> int:
    """Say how a stream ended that came to its end."""
    document = {"ending": run.ending, "reason": run.reason, "drives": run.drives}
    output.report(lambda: document, lambda: _print_drives(plan, run))
    if run.ending in (Ending.LOGGED, Ending.REACHED):
        return Exit.PLANNED
    click.echo(f"twosra: {run.ending}: {run.reason}", err=True)
    return Exit.UNSEEN if run.ending is Ending.UNSEEN else Exit.NO_PLAN


def _where(state: StreamState) -> str:
    """Progress of a stream in a line."""
    known = f"  ({state.known})" if state.known else ""
    return f"{state.time_s:z7.1f} s  {state.during}{known}"


def _print_drives(plan: Plan, run: Run) -> None:
    rows = [
        (words, f"{mode_name(mode)}", f"{start_s:z8.2f} s to {end_s:z8.2f} s")
        for words, drives in (("planned", plan.phases), ("driven", run.drives))
        for mode, start_s, end_s in drives
    ]
    print_table((run.reason, "mode", "from and to"), rows)
