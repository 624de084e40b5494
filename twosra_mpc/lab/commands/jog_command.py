"""``twosra jog``."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Annotated

import click

from twosra_mpc.cli.options import ROBOT, command, option
from twosra_mpc.cli.output import Exit, Output
from twosra_mpc.errors import InputError
from twosra_mpc.execution.robot_interface import Reading
from twosra_mpc.lab.bench.jog import Asked, Jog, Keys, for_a_time, heated_mode, jog, wheels_of_twist
from twosra_mpc.lab.commands import robot_line
from twosra_mpc.lab.serial.port import SteppedClock, SystemClock
from twosra_mpc.lab.serial.stream import Recorder
from twosra_mpc.robot.coordinates import WHEELS
from twosra_mpc.robot.description import Robot, load_robot

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
    robot_id: robot_line.RobotId,
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
    robot_line.check_line(port, dry_run)
    robot = robot_line.numbered(load_robot(name), robot_id)
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
        output.report(lambda: line.sent, lambda: robot_line.show_lines(line.sent))
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

    with robot_line.line_to(port) as opened:
        return robot_line.exit_code_of(drive)


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
