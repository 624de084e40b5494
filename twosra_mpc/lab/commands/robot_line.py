"""Line to a robot, for ``stream`` and ``jog``: its options, plans for it, its ending in words."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Annotated, TypeAlias

import click

from twosra_mpc.checking.plan_file import load_plan
from twosra_mpc.cli.options import option
from twosra_mpc.cli.output import Exit
from twosra_mpc.errors import InputError, TwosraError
from twosra_mpc.lab.serial.port import SerialPort, open_serial_port
from twosra_mpc.lab.serial.stream import SentLine
from twosra_mpc.model.path_models import path_model
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.description import Robot

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
