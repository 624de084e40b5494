"""``twosra stream``."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import click

from twosra_mpc.cli.options import command, plan_to_drive
from twosra_mpc.cli.output import EXIT_NO_PLAN, EXIT_PLANNED, Output, Tell, print_table
from twosra_mpc.errors import InputError
from twosra_mpc.execution.run import Drive
from twosra_mpc.execution.serial.clock import SteppedClock, SystemClock
from twosra_mpc.execution.serial.port import Port, open_serial_port
from twosra_mpc.execution.serial.robot import RATE_HZ
from twosra_mpc.execution.serial.stream import (
    Confirm,
    StreamError,
    StreamState,
    check_sendable,
    stream,
)
from twosra_mpc.execution.settings import Patience
from twosra_mpc.installation import install_command
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.modes import mode_name

_HELP = f"""Send PLAN to a robot over a serial line, and switch the robot off at the end.

Wheel speeds [rad/s] and heater states go out in the line format of the authors' firmware at 115200
baud. If the robot reports temperatures (lines A58.2, B24.9 and so on: readings of segments 1 and 2
in C), a phase begins when they confirm that the segments are soft and rigid as it needs. If nothing
is reported within {Patience().listen_s:g} s, phases begin at the plan's times.

Plans with the paper's wheel map are refused: without slip they bend the robot by 17 to 45 % of what
is planned. Plan with 2sra-v1.

Ctrl-C, SIGTERM, a closed terminal and every error stop the wheels and switch the heaters off. Keep
a hand at the switch all the same: the robot goes on with its last command if the line breaks.

Needs pyserial: {install_command("serial")}

\b
See what would be sent, without a robot:
  twosra plan paper-2 --out plan.json
  twosra stream plan.json --dry-run
Send it, and refuse to drive on trust:
  twosra stream plan.json --port /dev/ttyUSB0 --confirm required
One of several robots on the same radio:
  twosra stream plan.json --port COM3 --robot-id 1
"""


@command("stream", _HELP)
@plan_to_drive
@click.option("--port", help="Serial port of the robot, e.g. /dev/ttyUSB0 or COM3.")
@click.option("--dry-run", is_flag=True, help="Print times and lines; needs no port.")
@click.option(
    "--rate",
    "rate_Hz",
    type=float,
    metavar="HZ",
    default=RATE_HZ,
    help="Commands per second while driving; the default is that of the authors' controller.",
)
@click.option(
    "--confirm",
    type=click.Choice([choice.value for choice in Confirm]),
    default=Confirm.IF_REPORTED.value,
    help="Whether temperature reports are needed for a phase to begin.",
)
@click.option("--robot-id", type=click.IntRange(min=0), help="Sent at the end of each command.")
def stream_command(
    plan: Plan,
    port: str | None,
    dry_run: bool,
    rate_Hz: float,
    confirm: str,
    robot_id: int | None,
    output: Output,
) -> int:
    """Send a plan; see ``_HELP``."""
    if (port is None) != dry_run:
        given = "both" if dry_run else "neither"
        raise InputError("port or dry-run", given, "a --port, or --dry-run without one")
    check_sendable(plan)
    if port is None:
        _show(plan, output, rate_Hz=rate_Hz, robot_id=robot_id)
        return EXIT_PLANNED
    asked: dict[str, Any] = {"rate_Hz": rate_Hz, "robot_id": robot_id, "confirm": Confirm(confirm)}
    with closing(open_serial_port(port)) as opened:
        return _send(plan, opened, output, **asked)


class _Recorder:
    """A line to nowhere that keeps what is sent."""

    def __init__(self, clock: SteppedClock) -> None:
        self._clock = clock
        self.sent: list[dict[str, Any]] = []

    def write(self, data: bytes) -> None:
        self.sent.append({"time_s": self._clock.now_s(), "line": data.decode("ascii")})

    def read_lines(self) -> list[bytes]:
        return []


def _show(plan: Plan, output: Output, **options: Any) -> None:
    """Print what would be sent, and when."""
    clock = SteppedClock()
    line = _Recorder(clock)
    stream(plan, line, clock, confirm=Confirm.NEVER, **options)
    shown = [f"{item['time_s']:10.3f}  {item['line']}".replace("\n", "\\n") for item in line.sent]
    output.report(lambda: line.sent, lambda: click.echo("\n".join(shown)))


def _send(plan: Plan, port: Port, output: Output, **options: Any) -> int:
    """Send a plan, with its progress on standard error."""
    try:
        with output.progress("opening the line") as tell:
            drives = stream(plan, port, SystemClock(), on_state=_Progress(tell), **options)
    except StreamError as error:
        click.echo(f"twosra: {error}", err=True)
        return EXIT_NO_PLAN
    except KeyboardInterrupt:
        click.echo("twosra: interrupted; wheels and heaters are off", err=True)
        return EXIT_NO_PLAN
    output.report(lambda: {"drives": drives}, lambda: _print_drives(plan, drives))
    return EXIT_PLANNED


class _Progress:
    """Tells where a stream is, and once if nothing confirms what it does."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._warned = False

    def __call__(self, state: StreamState) -> None:
        if state.reported is False and not self._warned:
            self._warned = True
            words = "nothing confirms the temperatures: phases begin at the plan's times"
            click.echo(f"twosra: {words}", err=True)
        known = f"  ({state.known})" if state.known else ""
        self._tell(f"{state.time_s:7.1f} s  {state.during}{known}")


def _print_drives(plan: Plan, drives: tuple[Drive, ...]) -> None:
    rows = [
        (
            f"drive {mode_name(drive.mode)}",
            f"{drive.start_s:8.2f} s to {drive.end_s:8.2f} s",
            f"{phase.start_s:8.2f} s to {phase.end_s:8.2f} s",
        )
        for drive, phase in zip(drives, plan.phases, strict=True)
    ]
    print_table(("phase", "driven", "planned"), rows)
