"""Command line: every command in the module of its subject, imported when it is called.

Results go to standard output, progress and errors to standard error. Exit codes: see ``output``.
"""

from __future__ import annotations

import _thread
import importlib
import os
import re
import signal
import sys
import threading
import tomllib
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click
from click.shell_completion import CompletionItem

from twosra_mpc import errors
from twosra_mpc.cli.output import Exit
from twosra_mpc.files import data_file
from twosra_mpc.installation import __version__
from twosra_mpc.interrupts import Interrupts, noted_interrupts
from twosra_mpc.keys import near_number, near_word

# Section of the help -> command -> its module in this package, and what it does in one line.
_COMMANDS: dict[str, dict[str, list[str]]] = tomllib.loads(data_file("cli/commands.toml"))
_MODULES = {name: module for section in _COMMANDS.values() for name, (module, _) in section.items()}
_WORDS = {name: words for section in _COMMANDS.values() for name, (_, words) in section.items()}

_ELSEWHERE = {  # what other programs have as a command -> what is typed here
    "help": "type twosra --help, or twosra COMMAND --help.",
    "version": "type twosra --version.",
    "init": "type twosra new scenario NAME.",
}


class _Commands(click.Group):
    """Commands whose modules are imported only when they are asked for: some take a second."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        del ctx
        return list(_MODULES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        if cmd_name not in _MODULES:
            return None
        module = importlib.import_module(f"twosra_mpc.{_MODULES[cmd_name]}")
        command = getattr(module, f"{cmd_name.replace('-', '_')}_command")
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        hint = _ELSEWHERE.get(args[0]) or near_word(args[0], _MODULES)
        if args[0] not in _MODULES and hint:
            ctx.fail(f"No such command {args[0]!r}. {hint[0].upper()}{hint[1:]}")
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        # Not click's own, which imports every command to ask for its help.
        names = [name for name in _WORDS if name.startswith(incomplete)]
        items = [CompletionItem(name, help=_WORDS[name]) for name in names]
        return items + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        del ctx
        width = max(map(len, _MODULES))
        for title, section in _COMMANDS.items():
            with formatter.section(title):
                rows = [(name.ljust(width), words) for name, (_, words) in section.items()]
                formatter.write_dl(rows)


_SETTINGS = {"help_option_names": ["-h", "--help"], "show_default": True}


@click.group(cls=_Commands, context_settings=_SETTINGS)
@click.version_option(__version__, prog_name="twosra")
def commands() -> None:
    """Plan motions of the self-reconfigurable soft-rigid agent (2SRA).

    \b
    Start here:
      twosra plan paper-1 --out plan.json --plot plan.png
      twosra verify plan.json
      twosra new scenario mine
      twosra COMMAND --help

    Results go to standard output, as tables or with --json as JSON; progress and errors go to
    standard error.

    \b
    Exit codes:
      0  done
      1  whoever was reading the output stopped doing so
      2  bad input, or a file that cannot be read or written
      3  proved infeasible
      4  no plan, not verified, or not reached (the best so far is written, if any)
      5  arrived, but by dead reckoning: the camera had not seen the robot lately
      70 a bug of this program: please report it; --debug shows where it is
      130 interrupted before there was a result

    Completion of commands, options, scenarios and robots: put
    eval "$(_TWOSRA_COMPLETE=bash_source twosra)" into ~/.bashrc (zsh_source into ~/.zshrc, or
    fish_source).
    """


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    usual = sys.unraisablehook

    def swallowed(lost: sys.UnraisableHookArgs) -> None:
        """Ask again for an interrupt that fell into a callback of Python, which cannot raise it."""
        if lost.exc_type is KeyboardInterrupt:
            threading.Timer(1e-3, _thread.interrupt_main).start()
        else:
            usual(lost)

    sys.unraisablehook = swallowed
    with noted_interrupts() as interrupts, _warnings_in_words() as told:
        code = _run(arguments, interrupts, told)
    sys.exit(code)


@contextmanager
def _warnings_in_words() -> Iterator[list[str]]:
    """Say doubts about input in a line, also with --quiet: a result may be of another problem.

    Yields the list of what was said, which ``--json`` repeats.
    """
    told: list[str] = []
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *at: Any, **more: Any) -> None:
            if issubclass(category, errors.InputWarning):
                told.append(str(message))
                click.echo(f"twosra: warning: {message}", err=True)
            else:
                usual(message, category, *at, **more)

        warnings.simplefilter("default", errors.InputWarning)
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box in the picture says it
        warnings.showwarning = show
        yield told


def _run(arguments: list[str] | None, interrupts: Interrupts, told: list[str]) -> int:
    """Run the command line, and say what goes wrong; returns the exit code."""
    try:
        code = commands.main(arguments, prog_name="twosra", standalone_mode=False, obj=told)
        sys.stdout.flush()
    except (click.Abort, KeyboardInterrupt):
        return _interrupted()
    except Exception as error:
        if interrupts.requested:  # a library made an error of its own of it
            return _interrupted()
        return _failed(error, debug="--debug" in (sys.argv if arguments is None else arguments))
    return code or 0


def _interrupted() -> int:
    click.echo("twosra: interrupted before there was a result", err=True)
    return Exit.INTERRUPTED


def _failed(error: Exception, *, debug: bool) -> int:
    """Say what went wrong; returns the exit code."""
    match error:
        case errors.InputError():
            said, code = str(error), Exit.BAD_INPUT
        case errors.NoPlanError():
            said = str(error)
            code = Exit.INFEASIBLE if error.status == "infeasible" else Exit.NO_PLAN
        case click.ClickException():
            if isinstance(error, click.UsageError) and (hint := _meant(error)):
                error = click.UsageError(f"{error.format_message()} {hint}", error.ctx)
            error.show()
            return Exit.BAD_INPUT
        case BrokenPipeError():  # whoever read the output has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return Exit.BROKEN_PIPE
        case OSError():
            reason, code = error.strerror or str(error), Exit.BAD_INPUT
            said = f"{error.filename}: {reason}" if error.filename else reason
        case MemoryError():
            said, code = "this takes more memory than there is", Exit.BAD_INPUT
        case errors.TwosraError() if not isinstance(error, errors.ContradictionError):
            said, code = str(error), Exit.NO_PLAN  # the robot's end
        case _:  # the last resort
            name = errors.printable(f"{type(error).__name__}: {error}")
            said = f"this is a bug ({name}). Please report it with the command, its files, what"
            said, code = f'{said} "twosra doctor" prints and what --debug adds', Exit.BUG
    click.echo(f"twosra: {said}", err=True)
    if debug and code == Exit.BUG:
        traceback.print_exception(error)
    return code


def _meant(error: click.UsageError) -> str:
    """Say what to type instead of what the command line could not read; empty if unknown."""
    params = error.ctx.command.params if error.ctx else ()
    extra = re.match("Got unexpected extra arguments?", error.message)
    if extra and any(each.name == "scenario" for each in params):
        return "One scenario at a time; twosra batch plans many."
    given = re.match(r"'(.*)' is not a valid (float|integer)", error.message)
    if not given or not isinstance(error, click.BadParameter) or not error.param:
        return ""
    if given[2] == "integer":
        return "Give a whole number."
    hint = near_number(error.param.name or "", given[1], optional=False, listed=False)
    meant = hint.partition(",")[0]
    return f"{meant}?" if meant.startswith("did you mean") else ""
