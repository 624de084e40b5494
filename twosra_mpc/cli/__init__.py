"""Command line: every command in the module of its subject, imported when it is called.

Results go to standard output, progress and errors to standard error. Exit codes: 0 done, 2 bad
input, 3 proved infeasible, 4 no plan within the limits (the best so far is written, if any).
"""

from __future__ import annotations

import importlib
import signal
import sys

import click

from twosra_mpc.cli.output import EXIT_BAD_INPUT, EXIT_NO_PLAN
from twosra_mpc.errors import InputError
from twosra_mpc.version import __version__

_COMMANDS = {
    "plan": "planning",
    "explain": "explain",
    "scenarios": "robots",
    "robots": "robots",
    "check-robot": "robots",
    "fit-paths": "paths",
    "compare-models": "paths",
    "fit-thermal": "thermal_fit",
    "simulate-heater": "heater_loop",
    "simulate": "simulate",
}


class _Commands(click.Group):
    """Commands whose modules are imported only when they are asked for: some take a second."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        if cmd_name not in _COMMANDS:
            return None
        module = importlib.import_module(f"twosra_mpc.cli.{_COMMANDS[cmd_name]}")
        command = getattr(module, f"{cmd_name.replace('-', '_')}_command")
        assert isinstance(command, click.Command)
        return command


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="twosra")
def commands() -> None:
    """Plan motions of the self-reconfigurable soft-rigid agent (2SRA)."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = commands.main(arguments, prog_name="twosra", standalone_mode=False)
    except InputError as error:
        click.echo(f"twosra: {error}", err=True)
        code = EXIT_BAD_INPUT
    except click.ClickException as error:
        error.show()
        code = EXIT_BAD_INPUT
    except (click.Abort, KeyboardInterrupt):
        click.echo("twosra: interrupted before there was a plan", err=True)
        code = EXIT_NO_PLAN
    sys.exit(code or 0)
