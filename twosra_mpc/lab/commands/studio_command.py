"""``twosra studio`` and ``twosra map``."""

from __future__ import annotations

import math
import webbrowser
from typing import Annotated

import click

from twosra_mpc.cli import options
from twosra_mpc.cli.options import option
from twosra_mpc.cli.output import Output, digits, print_table


@options.command("studio")
def studio_command(
    scenario: Annotated[str, options.argument(default="paper-1", **options.SCENARIO)],
    port: Annotated[int, option(type=click.IntRange(0, 65535), default=0)],
    no_browser: bool,
    load: Annotated[
        options.Load, options.overrides("work_limit", "time_limit_s", "max_phases", "risk")
    ],
    output: Output,
) -> None:
    """Open SCENARIO on a page of this computer, and plan it while you move it by hand.

    Start, goal, obstacles and objects are drawn to scale and can be dragged; mode sequence,
    duration and proved gap follow. A run in closed loop can be watched, and pushed. Nothing leaves
    this computer. Ctrl-C ends it. {studio}

    \b
    Take the paper's first problem in your hand:
      twosra studio paper-1
    On a port of your choice, for a browser that is open already:
      twosra studio pick-and-place --port 8765 --no-browser

    Options:
        port: 0 takes a free one.
        no_browser: Only print the address.
    """
    from twosra_mpc.lab.studio.server import Server  # the planner takes a second

    server = Server(load(scenario), port, scenario)
    output.report(lambda: {"address": server.address}, lambda: click.echo(server.address))
    if not no_browser:
        webbrowser.open(server.address)
    server.serve()


@options.command("map")
def map_command(
    scenario: options.Scenario,
    over: Annotated[str, option(metavar="A,B")],
    size: Annotated[int, option(type=click.IntRange(2, 101), default=17)],
    plot: options.Plot,
    load: Annotated[options.Load, options.overrides("max_phases", "risk")],
    output: Output,
) -> None:
    """Map SCENARIO: the best mode sequence and duration over two coordinates of its goal.

    A point takes up to 300 units of work, unless told otherwise; where it then has no plan, and is
    not infeasible, more work may find one.

    \b
    Which sequence is best for which shape?
      twosra map paper-1 --over kappa1,kappa2 --size 9 --plot map.png

    Options:
        over: Two of x, y, phi, kappa1, kappa2 ...
        size: Points a side.
        plot: Draw the map (png, pdf, svg).
    """
    from twosra_mpc.lab.studio.goal_map import WORK, goal_map

    names, problem = [name.strip() for name in over.split(",")], load(scenario)
    work = problem.work_limit if "work_limit" in problem.model_fields_set else WORK
    with output.progress("mapping") as tell:
        cells = []
        for cell in goal_map(problem, names, (size,), work):
            cells.append(cell)
            tell(f"mapping: {len(cells)} of {size**2} points")
    if plot is not None:
        from twosra_mpc.lab.figures import plot_map  # matplotlib takes a second

        plot_map(cells, (names[0], names[1]), plot)
    rows = []
    missing, spans = {"failed": "no plan within the limits"}, dict[str, list[float]]()
    for cell in cells:
        name = cell.sequence or missing.get(cell.status, cell.status)
        spans.setdefault(name, []).append(cell.duration_s or math.nan)
    rows = [
        (name, str(len(taken)), *(digits(end(taken), 1) for end in (min, max)))
        for name, taken in sorted(spans.items(), key=lambda each: -len(each[1]))
    ]
    output.report(
        lambda: {"over": names, "cells": cells},
        lambda: print_table(("mode sequence", "points", "least [s]", "most [s]"), rows),
    )
