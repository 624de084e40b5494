"""Arguments of commands, each declared once: the option that sets it follows from its annotation.

Its help stands in the docstring of the command. Some are shared: overrides of a scenario, and files
that are checked before any work.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin, get_type_hints

import click
from click.shell_completion import CompletionItem

from twosra_mpc import InputError, Problem, files, load_problem, plotting, with_path_model
from twosra_mpc.cli.output import Output
from twosra_mpc.installation import install_command
from twosra_mpc.keys import stem_of
from twosra_mpc.robot.paths import PATH_MODELS

Check = Callable[[Path], object]  # raises InputError where a file may not be written
Load = Callable[..., Problem]
Declared = Callable[[str, Any, str], list[click.Parameter]]  # of an argument's name, type, words


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


SOURCE, FILE = Source(), File()


def option(*names: str, **settings: Any) -> Declared:
    """Declare the option that sets an argument; ``--out`` is ``-o``, too.

    Its type is that of the annotation: a bool is a flag, and a tuple may be given several times.
    What may be None or has a default need not be given.

    Args:
        names: What is typed; default: the argument's name, without its unit.
        settings: Of click's option.
    """

    def declared(name: str, annotation: Any, words: str) -> list[click.Parameter]:
        typed, several, free = _typed(annotation)
        needed = not (free or several or "is_flag" in typed or "default" in settings)
        given = {"multiple": several, "required": needed, "help": words, **typed, **settings}
        usual = f"--{stem_of(name).replace('_', '-')}", *["-o"] * (name == "out")
        return [click.Option([name, *(names or usual)], **given)]

    return declared


def argument(metavar: str | None = None, **settings: Any) -> Declared:
    """Declare an argument by its place; of a tuple there is at least one."""

    def declared(name: str, annotation: Any, _words: str) -> list[click.Parameter]:
        typed, several, _ = _typed(annotation)
        many: dict[str, Any] = {"nargs": -1} if several else {}
        given = {"metavar": metavar, "required": "default" not in settings, **typed, **settings}
        return [click.Argument([name], **many, **given)]

    return declared


def _typed(annotation: Any) -> tuple[dict[str, Any], bool, bool]:
    """Settings of click by an annotation; whether there may be several values, and none."""
    parts, several = get_args(annotation), get_origin(annotation) is tuple
    kind = parts[0] if several or NoneType in parts else annotation
    free = NoneType in parts
    if kind is bool:
        return {"is_flag": True} | ({"default": None} if free else {}), several, free
    kind = click.Choice(get_args(kind)) if get_origin(kind) is Literal else kind
    return {"type": FILE if kind is Path else kind}, several, free


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


def word(usual: Iterable[str], **settings: Any) -> Declared:
    """Declare an option that completes usual words; whoever takes it refuses others by name.

    Its help names them in the place of ``{}``.
    """
    declared = option(shell_complete=completed(lambda: usual), **settings)
    return lambda name, annotation, words: declared(
        name, annotation, words.format(", ".join(usual))
    )


SCENARIO, ROBOT = _built_in("scenarios"), _built_in("robots")
Scenario: TypeAlias = Annotated[str, argument(**SCENARIO)]
RobotName: TypeAlias = Annotated[str, argument(**ROBOT)]

_EXTRA = re.compile(r"\{(\w+)\}")
TIMINGS = ("nominal", "constant", "paper")  # of the built-in robots


class _Overrides:
    """Options that override keys of a scenario file, its ``path_model`` and its ``exact``.

    Options:
        planner: Override the scenario.
        robot: Override it: a built-in name or a file.
        path_model: Override the robot's path model: {}.
        timing: Override the transition times: {}, or the robot's own.
        gap: Relative gap to stop at, e.g. 0.01.
        work_limit: Stop the search after so much work; 1000 units are about a second.
        time_limit_s: Stop it after so much CPU time, whatever it has done [s].
        risk: What counts of uncertain time: nominal, mean, or 0.9.
        max_phases: Longest mode sequence searched.
        exact: Meet the goal exactly.
    """

    planner: Literal["optimal", "greedy"] | None
    robot: Annotated[str | None, option(**ROBOT)]
    path_model: Annotated[str | None, word(PATH_MODELS)]
    timing: Annotated[str | None, word(TIMINGS)]
    gap: float | None
    work_limit: float | None
    time_limit_s: float | None
    risk: Annotated[float | str | None, option(type=Risk())]
    max_phases: int | None
    exact: bool | None


class _Shared:
    """Options of every command.

    Options:
        as_json: Print JSON instead of tables.
        quiet: Print errors only; see the exit code.
        debug: Show where in the program a bug is.
    """

    as_json: Annotated[bool, option("--json")]
    quiet: Annotated[bool, option("--quiet", "-q")]
    debug: Annotated[bool, option(expose_value=False)]


def _documented(of: object) -> tuple[str, dict[str, str]]:
    """Docstring without its options, and what it says of each of them."""
    text, _, options = (inspect.getdoc(of) or "").partition("\n\nOptions:\n")
    said = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", options, re.MULTILINE)
    return text, {name: " ".join(words.split()) for name, words in said}


def _declared(of: object, *without: str) -> list[click.Parameter]:
    """Parameters of click by the annotations of a function or a class."""
    _, words = _documented(of)
    found = list[click.Parameter]()
    for name, hint in get_type_hints(of, include_extras=True).items():
        kind, declare = get_args(hint) if get_origin(hint) is Annotated else (hint, option())
        if name not in (*without, "output", "return"):
            found += declare(name, kind, words.get(name, ""))
    return found


def overrides(*without: str) -> Declared:
    """Declare ``load``, which loads a scenario, by options that override keys of it.

    Args:
        without: Those that there are not.
    """
    return lambda _name, _annotation, _words: _declared(_Overrides, *without)


def command(name: str) -> Callable[[Callable[..., Any]], click.Command]:
    """Make a function a command, whose annotations declare what sets its arguments.

    As ``output`` it is given what ``--json`` and ``--quiet`` chose; a file that is written to
    standard output is alone there. Its help is what the function says of itself, with how to
    install an extra for the extra's name in braces.
    """

    def decorate(function: Callable[..., Any]) -> click.Command:
        own = get_type_hints(function)

        @functools.wraps(function)
        def run(*, as_json: bool, quiet: bool, **given: Any) -> Any:
            outputs = click.get_current_context().meta.get("outputs", ())
            free = "stdout" not in map(files.stream_of, outputs)
            chosen = {key: given.pop(key) for key in [*given] if key not in own}
            if "load" in own:
                given["load"] = functools.partial(_load, **chosen)
            with files.outputs_are_no_inputs(outputs):
                output = Output(as_json=as_json and free, quiet=quiet or not free)
                return function(output=output, **given)

        words, _ = _documented(function)
        words = _EXTRA.sub(lambda found: install_command(found[1]), words)
        made = click.command(name, help=words)(run)
        made.params += _declared(function) + _declared(_Shared)
        return made

    return decorate


def _load(
    scenario: str, path_model: str | None = None, exact: bool | None = None, **chosen: Any
) -> Problem:
    """Load a scenario; to be run it counts with uncertain times, where it does not say whether."""
    to_run = chosen.pop("to_run", False)
    problem = load_problem(scenario, **{k: v for k, v in chosen.items() if v is not None})
    uncertain = problem.only_time and problem.robot.uncertainty is not None
    if to_run and uncertain and "risk" not in problem.model_fields_set:
        problem = problem.with_values(risk="mean")
    if exact:
        problem = problem.with_values(goal=problem.goal.with_values(tolerance="exact"))
    robot = problem.robot if path_model is None else with_path_model(problem.robot, path_model)
    return problem.with_values(robot=robot)


def out_argument(check: Check) -> Declared:
    """Declare OUT, the file to write; who names it by an option is told where it stands."""

    def told(ctx: click.Context, _: click.Parameter, given: str | None) -> None:
        if given is not None:
            usage = " ".join(ctx.command.collect_usage_pieces(ctx)[1:-1])
            ctx.fail(f"OUT stands last, without an option: {ctx.command_path} {usage} {given}")

    unseen: dict[str, Any] = {"hidden": True, "is_eager": True, "expose_value": False}
    named = click.Option(["-o", "--out", "_"], callback=told, **unseen)
    return lambda name, _annotation, _words: [named, click.Argument([name], type=NewFile(check))]


def ending(*allowed: str) -> Check:
    """Return the check that a file has one of these endings."""
    return lambda target: files.ending_of(target, *allowed)


def written(*checks: Check) -> Declared:
    """Declare an option for a file to write."""
    return option(type=NewFile(*checks))


def figure(target: Path) -> None:
    """Check that a figure can be written here; what draws is loaded only then."""
    plotting.check_figure_path(target)


def film(target: Path) -> None:
    """Check that a film can be written here; what draws is loaded only then."""
    plotting.check_animation_path(target)


Plot: TypeAlias = Annotated[Path | None, written(figure)]


def _checked_rate(
    _ctx: click.Context, _param: click.Parameter, rate_Hz: float | None
) -> float | None:
    if rate_Hz is not None:
        from twosra_mpc.plans.trajectory import check_rate  # CasADi takes a second

        check_rate(rate_Hz)
    return rate_Hz


RATE = option("--rate", metavar="HZ", callback=_checked_rate)  # rows of set-points per second
