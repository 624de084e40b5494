"""``twosra jog``."""

from __future__ import annotations

import click

from twosra_mpc.cli.options import ROBOT, command
from twosra_mpc.cli.output import EXIT_PLANNED, Output, Tell
from twosra_mpc.execution.robot_interface import Reading
from twosra_mpc.lab.bench.jog import Jog, heated_mode, jog, wheels_of_twist
from twosra_mpc.lab.commands import robot_line
from twosra_mpc.lab.serial.port import SteppedClock, SystemClock
from twosra_mpc.lab.serial.stream import Recorder
from twosra_mpc.robot.coordinates import WHEELS
from twosra_mpc.robot.description import load_robot


@command("jog")
@robot_line.PORT
@robot_line.DRY_RUN
@click.option("--robot", "name", required=True, help="A built-in name or a file.", **ROBOT)
@click.option("--forward", "along", default=0.0, help="Along x of its middle link [m/s].")
@click.option("--sideways", "across", default=0.0, help="Along y of it [m/s].")
@click.option("--turn", default=0.0, help="Turning rate [rad/s].")
@click.option(
    "--wheel",
    "wheels",
    type=(click.IntRange(1, WHEELS), float),
    multiple=True,
    help="Number of a wheel, and its speed [rad/s], besides the rest.",
)
@click.option("--heat", type=int, multiple=True, help="Number of a segment to heat.")
@click.option("--for", "duration_s", type=float, metavar="S", required=True, help="For how long.")
@click.option("--cold", is_flag=True, help="The segments are as cold as the air.")
@robot_line.ROBOT_ID
def jog_command(
    port: str | None,
    dry_run: bool,
    name: str,
    along: float,
    across: float,
    turn: float,
    wheels: tuple[tuple[int, float], ...],
    heat: tuple[int, ...],
    duration_s: float,
    cold: bool,
    robot_id: int | None,
    output: Output,
) -> int:
    """Drive a robot by hand, a little at a time: the first thing to do with a new one.

    Forward, sideways and turn are of a straight robot, all solid. Speeds rise within the robot
    file's acceleration and are refused beyond its limits. Heaters are switched by the reported
    temperatures; if there are none, by the model's heat, and only with --cold. At the end, by
    Ctrl-C and after every error wheels stand and heaters are off.

    \b
    See what would be sent, without a robot:
      twosra jog --robot 2sra-v1 --forward 0.01 --for 2 --dry-run
    Which way does wheel 1 turn? (with the robot on blocks)
      twosra jog --robot 2sra-v1 --port /dev/ttyUSB0 --wheel 1 2.0 --for 1
    Does heater 1 warm segment 1?
      twosra jog --robot 2sra-v1 --port /dev/ttyUSB0 --heat 1 --for 20
    """
    robot_line.check_line(port, dry_run)
    robot = robot_line.numbered(load_robot(name), robot_id)
    speed = wheels_of_twist(robot, (along, across, turn))
    for wheel, own in wheels:
        speed[wheel - 1] += own
    asked = Jog(speed, heated_mode(robot, heat))
    if port is None:
        clock = SteppedClock()
        line = Recorder(clock)
        jog(robot, line, clock, asked, duration_s, cold=True)
        output.report(lambda: line.sent, lambda: robot_line.show_lines(line.sent))
        return EXIT_PLANNED

    def drive() -> int:
        with output.progress("listening for temperatures") as tell:
            known = _Known(tell)
            jog(robot, opened, SystemClock(), asked, duration_s, cold=cold, on_reading=known)
        output.record(("jogged", robot.name), {"known at the end": known.words})
        return EXIT_PLANNED

    with robot_line.line_to(port) as opened:
        return robot_line.exit_code_of(drive)


class _Known:
    """Progress line: what is known, and what is sent."""

    def __init__(self, tell: Tell) -> None:
        self._tell, self.words = tell, ""

    def __call__(self, reading: Reading, sent: Jog) -> None:
        heated = ["on" if each else "off" for each in sent.heated]
        known = [
            reading.describe(j) if reading.stiffness[j] else f"segment {j + 1} does not report"
            for j in range(len(heated))
        ]
        self.words = ", ".join(known)
        speeds = " ".join(f"{each:z.2f}" for each in sent.wheel_rad_s)
        self._tell(f"wheels [{speeds}] rad/s, heaters {' '.join(heated)}; {self.words}")
