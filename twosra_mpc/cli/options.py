"""Options that commands share: output, overrides of a scenario, files checked before any work."""

from __future__ import annotations

import functools
import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from twosra_mpc import files, plotting
from twosra_mpc.cli.output import Output
from twosra_mpc.errors import InputError
from twosra_mpc.installation import install_command
from twosra_mpc.problem.problem import Problem, load_problem
from twosra_mpc.robot.description import with_path_model
from twosra_mpc.robot.paths import PATH_MODELS

Function = Callable[..., Any]
Decorator = Callable[[Function], Function]
Check = Callable[[Path], object]  # raises InputError where a file may not be written
Load = Callable[..., Problem]


def completed(
    words: Callable[[], Iterable[str]], *, or_file: bool = False
) -> Callable[..., list[CompletionItem]]:
    """Completion of words, which are asked for when it is; or of the name of a file."""

    def complete(_ctx: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
        found = [CompletionItem(word) for word in words() if word.startswith(begun)]
        return [*found, *[CompletionItem(begun, type="file")] * or_file]

    return complete


def _built_in(folder: str) -> dict[str, Any]:
    """Settings of an argument that is the name of a built-in scenario or robot, or a file."""
    names = functools.partial(files.built_in_names, folder)
    return {"shell_complete": completed(names, or_file=True), "type": SOURCE}


def word_option(name: str, words: str, usual: Iterable[str], **settings: Any) -> Decorator:
    """Add an option that completes the usual words; whoever takes it refuses others by name."""
    return click.option(name, help=words, shell_complete=completed(lambda: usual), **settings)


class Source(click.types.StringParamType):
    """Source of input: a name or a file; "-" is standard input."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Turn what was given into a name or the path of a file."""
        return "/dev/stdin" if value == "-" else value


class File(click.Path):
    """A file that is read."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Turn what was given into a path."""
        return Path(SOURCE.convert(value, param, ctx))


class Risk(click.types.StringParamType):
    """What counts of an uncertain time: a word, or a quantile."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Turn what was given into a number where it is one; the problem refuses what is wrong."""
        try:
            return float(value)
        except ValueError:
            return value


SOURCE = Source()
SCENARIO, ROBOT = _built_in("scenarios"), _built_in("robots")
FILE = File()
SEED = click.IntRange(min=0)

_EXTRA = re.compile(r"\{(\w+)\}")
_JSON = click.Option(["--json", "as_json"], is_flag=True, help="Print JSON instead of tables.")
_QUIET = click.Option(["--quiet", "-q"], is_flag=True, help="Print errors only; see the exit code.")
_DEBUG = click.Option(
    ["--debug"], is_flag=True, expose_value=False, help="Show where in the program a bug is."
)
_PLANNERS = click.Choice(["optimal", "greedy"])
_WORK = "Stop the search after so much work; 1000 units are about a second."
_SECONDS = "Stop it after so much CPU time, whatever it has done [s]."
TIMINGS = ("nominal", "constant", "paper")  # of the built-in robots
_TIMES = f"{', '.join(TIMINGS)}, or the robot's own"
_SCENARIO_OPTIONS: dict[str, Decorator] = {
    "planner": click.option("--planner", type=_PLANNERS, help="Override the scenario."),
    "robot": click.option("--robot", help="Override it: a built-in name or a file.", **ROBOT),
    "path_model": word_option(
        "--path-model", f"Override the robot's path model: {', '.join(PATH_MODELS)}.", PATH_MODELS
    ),
    "timing": word_option("--timing", f"Override the transition times: {_TIMES}.", TIMINGS),
    "gap": click.option("--gap", type=float, help="Relative gap to stop at, e.g. 0.01."),
    "work_limit": click.option("--work-limit", type=float, help=_WORK),
    "time_limit_s": click.option("--time-limit", "time_limit_s", type=float, help=_SECONDS),
    "risk": click.option(
        "--risk", type=Risk(), help="What counts of uncertain time: nominal, mean, or 0.9."
    ),
    "max_phases": click.option("--max-phases", type=int, help="Longest mode sequence searched."),
    "exact": click.option("--exact", is_flag=True, default=None, help="Meet the goal exactly."),
}


def command(name: str) -> Callable[[Function], click.Command]:
    """Make a function a command; as ``output`` it is given what ``--json``, ``--quiet`` chose.

    A file that is written to standard output is alone there.
    Its help is what the function says of itself, with how to install an extra for the extra's name
    in braces.
    """

    def decorate(function: Function) -> click.Command:
        @functools.wraps(function)
        def run(*, as_json: bool, quiet: bool, **given: Any) -> Any:
            outputs = click.get_current_context().meta.get("outputs", ())
            free = "stdout" not in map(files.stream_of, outputs)
            chosen = Output(as_json=as_json and free, quiet=quiet or not free)
            with files.outputs_are_no_inputs(outputs):
                return function(output=chosen, **given)

        words = _EXTRA.sub(lambda found: install_command(found[1]), function.__doc__ or "")
        made = click.command(name, help=words)(run)
        made.params += [_JSON, _QUIET, _DEBUG]
        return made

    return decorate


def scenario_options(*without: str) -> Decorator:
    """Add options that override keys of a scenario; the command is given ``load``, to load one so.

    Args:
        without: Keys of a scenario file, ``path_model`` or ``exact``, that it does not override.
    """
    names = [name for name in _SCENARIO_OPTIONS if name not in without]

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def command(*args: Any, **given: Any) -> Any:
            asked = {name: given.pop(name) for name in names}
            chosen = {name: value for name, value in asked.items() if value is not None}
            return function(*args, load=functools.partial(_load, **chosen), **given)

        decorated: Function = command
        for name in reversed(names):
            decorated = _SCENARIO_OPTIONS[name](decorated)
        return decorated

    return decorate


def _load(
    scenario: str, path_model: str | None = None, exact: bool = False, **overrides: Any
) -> Problem:
    """Load a scenario; to be run it counts with uncertain times, where it does not say whether."""
    to_run = overrides.pop("to_run", False)
    problem = load_problem(scenario, **overrides)
    uncertain = problem.only_time and problem.robot.uncertainty is not None
    if to_run and uncertain and "risk" not in problem.model_fields_set:
        problem = problem.with_values(risk="mean")
    if exact:
        problem = problem.with_values(goal=problem.goal.with_values(tolerance="exact"))
    robot = problem.robot if path_model is None else with_path_model(problem.robot, path_model)
    return problem.with_values(robot=robot)


class Finite(click.FloatRange):
    """A range of numbers, among which NaN is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Turn what was given into a number, and check it."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number", param, ctx)
        return number


class NewFile(click.Path):
    """A file to write; one that cannot be written, or may not be, is refused at once."""

    def __init__(self, *checks: Check) -> None:
        super().__init__(path_type=Path)
        self._checks = (files.check_writable, *checks)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Turn what was given into a path, and check it; "-" is standard output."""
        value = "/dev/stdout" if value == "-" else value
        target = super().convert(value, param, ctx)
        assert isinstance(target, Path)  # as asked for above
        taken = click.get_current_context().meta.setdefault("outputs", [])
        if os.path.realpath(target) in map(os.path.realpath, taken) and str(target) != os.devnull:
            raise InputError("output", str(target), "another file for each thing that is written")
        taken.append(target)
        for check in self._checks:
            check(target)
        return target


def out_argument(check: Check) -> Decorator:
    """Add OUT, the file to write; who names it by an option is told where it stands."""

    def told(ctx: click.Context, _: click.Parameter, given: str | None) -> None:
        if given is not None:
            usage = " ".join(ctx.command.collect_usage_pieces(ctx)[1:-1])
            ctx.fail(f"OUT stands last, without an option: {ctx.command_path} {usage} {given}")

    unseen: dict[str, Any] = {"hidden": True, "is_eager": True, "expose_value": False}
    named = click.option("-o", "--out", "_", callback=told, **unseen)
    argument = click.argument("out", type=NewFile(check))
    return lambda function: argument(named(function))


def ending(*allowed: str) -> Check:
    """Return the check that a file has one of these endings."""
    return lambda target: files.ending_of(target, *allowed)


def choice_option(words: str, choices: Sequence[str], *names: str) -> Decorator:
    """Add an option of these names that is one of a few words, by default the first."""
    return click.option(*names, type=click.Choice(choices), default=choices[0], help=words)


def file_option(name: str, words: str, *checks: Check) -> Decorator:
    """Add an option for a file to write; ``--out`` is ``-o``, too."""
    short = ("-o",) if name == "--out" else ()
    return click.option(name, *short, type=NewFile(*checks), help=words)


def figure(target: Path) -> None:
    """Check that a figure can be written here; what draws is loaded only then."""
    plotting.check_figure_path(target)


def film(target: Path) -> None:
    """Check that a film can be written here; what draws is loaded only then."""
    plotting.check_animation_path(target)


def plot_option(words: str) -> Decorator:
    """Add ``--plot`` for a figure."""
    return file_option("--plot", f"{words} (png, pdf, svg).", figure)


def rate_option(words: str, *, required: bool = False) -> Decorator:
    """Add ``--rate`` for rows of set-points per second [Hz]."""

    def checked(_ctx: click.Context, _param: click.Parameter, rate: float | None) -> float | None:
        if rate is not None:
            from twosra_mpc.plans.trajectory import check_rate  # CasADi takes a second

            check_rate(rate)
        return rate

    asked: dict[str, Any] = {"required": required, "callback": checked, "help": words}
    return click.option("--rate", "rate_Hz", type=float, metavar="HZ", **asked)
