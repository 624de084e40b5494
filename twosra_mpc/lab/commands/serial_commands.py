"""``twosra stream`` and ``twosra jog``: a robot at the end of a serial line."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import click

from twosra_mpc import InputError, Plan, Robot, TwosraError, load_plan, load_robot
from twosra_mpc.cli.options import ROBOT, argument, command, ending, option, written
from twosra_mpc.cli.output import Exit, Output, print_table
from twosra_mpc.execution.robot_interface import Reading
from twosra_mpc.execution.run import Ending, Run
from twosra_mpc.lab.bench.jog import Asked, Jog, Keys, for_a_time, heated_mode, jog, wheels_of_twist
from twosra_mpc.lab.serial.markers import load_markers
from twosra_mpc.lab.serial.port import SerialPort, SteppedClock, SystemClock, open_serial_port
from twosra_mpc.lab.serial.pose_lines import pose_lines
from twosra_mpc.lab.serial.robot import RATE_HZ
from twosra_mpc.lab.serial.stream import (
    Confirm,
    Recorder,
    SentLine,
    StreamState,
    check_sendable,
    preview,
    stream,
)
from twosra_mpc.model.path_models import path_model
from twosra_mpc.planning.policy import relies
from twosra_mpc.robot.coordinates import WHEELS
from twosra_mpc.robot.modes import mode_name

RobotId: TypeAlias = Annotated[int | None, option(type=click.IntRange(min=0))]


def check_line(port: str | None, dry_run: bool) -> None:
    """Refuse a line to a robot together with a dry run, and neither of them.

    Raises:
        InputError: If so.
    """
    if (port is None) != dry_run:
        given = "both" if dry_run else "neither"
        raise InputError("port or dry-run", given, "a --port, or --dry-run without one")


def numbered(robot: Robot, robot_id: int | None) -> Robot:
    """The robot, with another number if there is one."""
    return robot if robot_id is None else robot.with_values(robot_id=robot_id)


def show_lines(sent: list[SentLine]) -> None:
    """Print what would be sent, and when."""
    shown = [f"{time_s:z10.3f}  {line}".replace("\n", "\\n") for time_s, line in sent]
    click.echo("\n".join(shown))


def line_to(name: str) -> closing[SerialPort]:
    """Open the line to a robot; it is closed at the end of the block."""
    return closing(open_serial_port(name))


def exit_code_of(drive: Callable[[], int]) -> int:
    """Drive, and say in words what ended that early; returns the exit code."""
    try:
        return drive()
    except InputError:
        raise
    except TwosraError as error:
        click.echo(f"twosra: {error}", err=True)
    except KeyboardInterrupt:
        click.echo("twosra: interrupted; wheels and heaters are off", err=True)
    return Exit.NO_PLAN


def drivable_plan(source: Path, *, accept_paper_wheels: bool) -> Plan:
    """Load a plan from a file.

    Raises:
        InputError: If its wheel speeds are the paper's, unless these are accepted.
    """
    made = load_plan(source).require()
    if path_model(made.robot).wheel_map == "paper" and not accept_paper_wheels:
        allowed = (
            "a plan for 2sra-v1, or another robot of exact arcs, or --accept-paper-wheels:"
            " without slip the paper's wheel map bends a robot by 17 to 48 % of what is planned"
        )
        raise InputError("robot.path.model", made.robot.path.model, allowed, str(source))
    return made


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
    robot_id: RobotId,
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
    check_line(port, dry_run)
    if dry_run and (camera or log):
        raise click.UsageError("--dry-run sends nothing: there is nothing to follow or to --log")
    if markers and not camera:
        raise click.UsageError("--markers says what the poses of --camera are of")
    plan = drivable_plan(source, accept_paper_wheels=accept_paper_wheels)
    robot = numbered(plan.robot, robot_id)
    problem = plan.problem.with_values(robot=robot)
    plan = replace(plan, trajectory=replace(plan.trajectory, problem=problem))
    check_sendable(plan, Confirm(confirm))
    if problem.risk == "nominal" and robot.uncertainty is not None and relies(plan.sequence):
        advice = "may share a bend unequally: a plan made with --risk mean takes less on average"
        click.echo(f"twosra: segments that are soft at once {advice}", err=True)
    if port is None:
        sent = preview(plan, rate_Hz)
        output.report(lambda: sent, lambda: show_lines(sent))
        return Exit.PLANNED
    with ExitStack() as open_until_the_end:
        opened = open_until_the_end.enter_context(line_to(port))
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

        return exit_code_of(drive)


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


_KEYED_M_S, _KEYED_RAD_S = 0.01, 0.1  # of what a key asks for, a crawl


@command("jog")
def jog_command(
    port: str | None,
    dry_run: bool,
    name: Annotated[str, option("--robot", **ROBOT)],
    along: Annotated[float | None, option("--forward")],
    across: Annotated[float | None, option("--sideways")],
    turn: float | None,
    wheels: Annotated[
        tuple[tuple[int, float], ...], option("--wheel", type=(click.IntRange(1, WHEELS), float))
    ],
    heat: tuple[int, ...],
    duration_s: Annotated[float | None, option("--for", metavar="S")],
    cold: bool,
    robot_id: RobotId,
    output: Output,
) -> int:
    """Drive a robot by hand, a little at a time: the first thing to do with a new one.

    Without --for, by keys: w s forward and back, q e left and right, a d turn, 1 2 3 4 a wheel (-
    the other way), h j k l heaters of segments 1 to 4 on and off, x the end. A key must be held:
    half a second after the last one the wheels stand, and heaters go off after two minutes without
    a key.

    With --for, what the options say, for so many seconds; forward, sideways and turn are of a
    straight robot, all solid. Speeds rise within the robot file's acceleration and are refused
    beyond its limits. Heaters are switched by the reported temperatures; if there are none, by the
    model's heat, and only with --cold. At the end, by Ctrl-C and after every error wheels stand and
    heaters are off.

    \b
    See what would be sent, without a robot:
      twosra jog --robot 2sra-v1 --forward 0.01 --for 2 --dry-run
    Which way does wheel 1 turn? (with the robot on blocks)
      twosra jog --robot 2sra-v1 --port /dev/ttyUSB0 --wheel 1 2.0 --for 1
    Does heater 1 warm segment 1?
      twosra jog --robot 2sra-v1 --port /dev/ttyUSB0 --heat 1 --for 20

    Options:
        port: Serial port of the robot, e.g. /dev/ttyUSB0 or COM3.
        dry_run: Print times and lines; needs no port.
        name: A built-in name or a file.
        along: Along x of its middle link [m/s].
        across: Along y of it [m/s].
        turn: Turning rate [rad/s].
        wheels: Number of a wheel, and its speed [rad/s], besides the rest.
        heat: Number of a segment to heat.
        duration_s: For how long; else by keys.
        cold: The segments are as cold as the air.
        robot_id: Sent at the end of each line, instead of the robot file's.
    """
    check_line(port, dry_run)
    robot = numbered(load_robot(name), robot_id)
    if duration_s is None:
        if dry_run or wheels or heat or across:
            raise InputError("for", None, "a time [s]: only keys need none")
        speeds = _KEYED_M_S if along is None else along, _KEYED_RAD_S if turn is None else turn
        with _pressed() as receive:
            return _drive(robot, port, Keys(robot, receive, *speeds), cold, output)
    speed = wheels_of_twist(robot, (along or 0.0, across or 0.0, turn or 0.0))
    for wheel, own in wheels:
        speed[wheel - 1] += own
    asked = for_a_time(robot, Jog(speed, heated_mode(robot, heat)), duration_s)
    return _drive(robot, port, asked, cold, output)


def _drive(robot: Robot, port: str | None, asked: Asked, cold: bool, output: Output) -> int:
    if port is None:
        clock = SteppedClock()
        line = Recorder(clock)
        jog(robot, line, clock, asked, cold=True)
        output.report(lambda: line.sent, lambda: show_lines(line.sent))
        return Exit.PLANNED

    def drive() -> int:
        known = ""
        with output.progress("listening for temperatures") as tell:

            def show(reading: Reading, sent: Jog) -> None:
                nonlocal known
                heated = ["on" if each else "off" for each in sent.heated]
                known = ", ".join(
                    reading.describe(j) if told else f"segment {j + 1} does not report"
                    for j, told in enumerate(reading.stiffness)
                )
                speeds = " ".join(f"{each:z.2f}" for each in sent.wheel_rad_s)
                tell(f"wheels [{speeds}] rad/s, heaters {' '.join(heated)}; {known}")

            jog(robot, opened, SystemClock(), asked, cold=cold, on_reading=show)
        output.record(("jogged", robot.name), {"known at the end": known})
        return Exit.PLANNED

    with line_to(port) as opened:
        return exit_code_of(drive)


@contextmanager
def _pressed() -> Iterator[Callable[[], str]]:
    """Yield what returns the keys pressed since the last call; the terminal is restored."""
    if not sys.stdin.isatty() or os.name == "nt":
        raise InputError("for", None, "a time [s]: keys need a terminal, on Linux or macOS")
    import termios
    import tty

    source = sys.stdin.fileno()
    before = termios.tcgetattr(source)

    def receive() -> str:
        if not select.select([source], [], [], 0.0)[0]:
            return ""
        try:
            return os.read(source, 1024).decode("ascii", errors="replace") or "x"
        except OSError:  # the terminal is closed: the end
            return "x"

    try:
        tty.setcbreak(source)  # Ctrl-C stays what it is
        yield receive
    finally:
        with suppress(termios.error):
            termios.tcsetattr(source, termios.TCSADRAIN, before)
