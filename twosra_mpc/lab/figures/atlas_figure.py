"""Pictures of many plans: of a batch, of a map over goals, of planners side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import Locator, LogLocator, NullFormatter, SymmetricalLogLocator

from twosra_mpc import InputError, Plan
from twosra_mpc.arguments import public
from twosra_mpc.keys import key_of, unit_of
from twosra_mpc.lab.batch.atlas import Worth, atlas, counted, has_greedy, numeric_keys, plans
from twosra_mpc.lab.studio.goal_map import Cell
from twosra_mpc.plotting import figures, timeline_figures
from twosra_mpc.plotting.plan_figures import WIDTH_IN, plan_title

if TYPE_CHECKING:
    from pandas import DataFrame, Series


_SIZE_IN = (11.0, 7.2)  # of the figure: two rows of three panels
_TOLD_APART = 9  # sequences with a colour of their own
SEQUENCE_COLOURS = (  # told apart also without red or green
    *("#2a6fbb", "#e07b00", "#720c0c", "#acbef5", "#d4d490"),
    *("#5c234e", "#3030e8", "#e8e830", "#0c0c72"),
)
_BLUE, _LEAST_GAP = figures.RIGID_COLOUR, 1e-4  # gaps in %
_TICKS = (1.0, 2.0, 5.0)  # of a decade
OTHER_COLOUR, NO_PLAN_COLOUR = "#9e9e9e", "#eeeeee"


def plot_atlas(
    runs: DataFrame, x: str | None = None, y: str | None = None, path: str | Path | None = None
) -> Figure:
    """Draw a batch: over the varied keys ``x`` and ``y``, or over ``x`` alone if nothing else is.

    Problems that agree in both keys are one place: its most frequent sequence, its median numbers.

    Args:
        runs: The table of a batch, as `twosra_mpc.lab.batch.read_runs` returns it.
        x: A varied key; the first that is a number if none is given.
        y: Another one; the next that is a number.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If a key was not varied or is no number, there is no plan to draw, matplotlib
            cannot write such a file, or the folder cannot be written.
    """
    x, y = chosen_keys(runs, x, y)
    numbers = atlas(runs)
    if numbers.duration_s is None:
        raise InputError("runs", "no plan", "a batch in which some problem has a plan")
    with figures.styled_figure(_SIZE_IN, path) as figure:
        axes = figure.subplots(2, 3).ravel()
        draw_sequences(axes[0], runs, x, y)
        draw_quantity(axes[1], runs, x, y, "duration_s", "duration [s]")
        if has_greedy(runs):
            runs = runs.assign(saved_s=runs["greedy_duration_s"] - runs["duration_s"])
            draw_quantity(axes[2], runs, x, y, "saved_s", "saved against the greedy rule [s]")
        else:
            draw_quantity(axes[2], runs, x, y, "energy_J", "energy of the heaters [J]")
        draw_trend(axes[3], runs, x)
        draw_worth(axes[4], numbers.worth)
        draw_gaps(axes[5], runs)
        without = runs["status"][runs["duration_s"].isna()].value_counts()
        words = "".join(f", {count} {status}" for status, count in without.items())
        figure.suptitle(f"{len(plans(runs))} plans of {len(runs)} problems{words}")
    return figure


def chosen_keys(runs: DataFrame, x: str | None, y: str | None) -> tuple[str, str | None]:
    """Return the keys to draw over: those given, else the first varied ones that are numbers.

    Raises:
        InputError: If a key was not varied or is no number, or there is none.
    """
    keys = numeric_keys(runs)
    allowed = f"a varied key with several numbers: {', '.join(keys) or 'this batch has none'}"
    for name, key in (("x", x), ("y", y)):
        if key is not None and (key not in keys or key == (y if name == "x" else x)):
            raise InputError(name, key, f"{allowed}, another one for each axis")
    free = [key for key in keys if key not in (x, y)]
    if x is None:
        if not free:
            raise InputError("x", "none", allowed)
        x = free.pop(0)
    return x, y or (free[0] if free else None)


def draw_sequences(ax: Axes, runs: DataFrame, x: str, y: str | None) -> None:
    """Draw which mode sequence the plan has where; over one key, with the durations."""
    ranks = _ranks(runs)
    coded = runs.assign(code=runs["sequence"].map(ranks))
    colours = ListedColormap([NO_PLAN_COLOUR, *SEQUENCE_COLOURS, OTHER_COLOUR])
    style: dict[str, Any] = {"cmap": colours, "vmin": -0.5, "vmax": _TOLD_APART + 1.5}
    if y is None:
        ax.scatter(coded[x], coded["duration_s"], c=coded["code"], s=14, **style)
        ax.set(xlabel=_label(x), ylabel="duration [s]")
    else:
        _draw_places(ax, coded, x, y, "code", _most_frequent, style)
    keys = {name or "no plan": colours(rank) for name, rank in ranks.items() if rank <= _TOLD_APART}
    if max(ranks.values()) > _TOLD_APART:
        keys["others"] = colours(_TOLD_APART + 1)
    handles = [Patch(fc=colour, ec="0.6", lw=0.5) for colour in keys.values()]
    place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0, -0.16), "ncols": 2}
    ax.legend(handles, list(keys), fontsize=6.5, **place)
    ax.set_title("mode sequence of the plan")


def _most_frequent(codes: Series[float]) -> float:
    return float(np.bincount(codes.astype(int)).argmax())


def draw_quantity(
    ax: Axes, runs: DataFrame, x: str, y: str | None, column: str, title: str
) -> None:
    """Draw a number of the plans over two keys in colours, or over one key."""
    if y is None:
        ax.scatter(runs[x], runs[column], c=_BLUE, s=10)
        ax.set(xlabel=_label(x))
    else:
        drawn = _draw_places(
            ax, runs, x, y, column, lambda values: float(values.median()), {"cmap": "viridis"}
        )
        ax.figure.colorbar(drawn, ax=ax)
    ax.set_title(title)


def draw_trend(ax: Axes, runs: DataFrame, x: str) -> None:
    """Draw median duration over a key, with the band that holds 80 % of the plans."""
    made = plans(runs)
    edges = np.unique(made[x])
    if len(edges) > 40:  # random values: as many bands as a reader can tell apart
        edges = np.quantile(edges, np.linspace(0, 1, 21))
        places = np.clip(np.searchsorted(edges, made[x], side="right") - 1, 0, 19)
        at = (edges[1:] + edges[:-1]) / 2
    else:
        places, at = np.searchsorted(edges, made[x]), edges
    rows = [made["duration_s"].to_numpy()[places == i] for i in range(len(at))]
    low, middle, high = np.array([np.quantile(row, (0.1, 0.5, 0.9)) for row in rows]).T
    ax.fill_between(at, low, high, color=_BLUE, alpha=0.2, lw=0, label="80 % of plans")
    ax.plot(at, middle, "o-", ms=3, c=_BLUE, label="median")
    ax.set(xlabel=_label(x), title="duration [s]")
    ax.legend()


def draw_worth(ax: Axes, worth: Sequence[Worth]) -> None:
    """Draw what changes are worth: median, and the range that holds 80 % of what they save."""
    places = np.arange(len(worth))[::-1]
    low, middle, high = np.array(
        [(w.saved_s.p10, w.saved_s.median, w.saved_s.p90) for w in worth]
    ).T
    ax.hlines(places, low, high, color=_BLUE, alpha=0.35, lw=6)
    ax.plot(middle, places, "o", c=_BLUE, clip_on=False)
    ax.axvline(0.0, c="0.6", lw=0.8, zorder=0)
    for place, each in zip(places, worth, strict=True):
        words: dict[str, Any] = {"fontsize": 7.5, "transform": ax.get_yaxis_transform()}
        ax.text(0.02, place + 0.2, each.change, bbox=figures.BEHIND_WORDS, **words)
    ax.set_xscale("symlog", linthresh=1.0, subs=_TICKS)
    _name_few(ax, SymmetricalLogLocator(linthresh=1.0, base=10, subs=_TICKS))
    ax.set(yticks=(), title="what changes are worth", xlabel="saved [s of a plan]")
    ax.set_ylim(-0.5, len(worth) - 0.2)


def draw_gaps(ax: Axes, runs: DataFrame) -> None:
    """Draw the proved gaps of the plans as a histogram."""
    gaps = 100 * plans(runs)["search_gap"].dropna().to_numpy()
    title = "proved gap at full speed"
    if gaps.size:
        gaps = np.maximum(gaps, _LEAST_GAP)
        edges = np.geomspace(gaps.min() / 1.5, gaps.max() * 1.5, 31).tolist()
        ax.hist(gaps, bins=edges, color=_BLUE)
        middle = float(np.median(gaps))
        ax.axvline(middle, c=figures.SOFT_COLOUR, lw=1.2)
        title = f"proved gap at full speed, median {middle:z.2g} %"
        ax.set_xscale("log")
        _name_few(ax, LogLocator(subs=_TICKS))
    ax.set(title=title, xlabel="gap [%]", ylabel="plans")


def _name_few(ax: Axes, ticks: Locator) -> None:
    """Write numbers at these places of an axis in logarithms, and nowhere else."""
    ax.xaxis.set_major_locator(ticks)
    ax.xaxis.set_major_formatter("{x:zg}")
    ax.xaxis.set_minor_formatter(NullFormatter())


def _draw_places(
    ax: Axes,
    runs: DataFrame,
    x: str,
    y: str,
    column: str,
    of: Callable[[Series[float]], float],
    style: dict[str, Any],
) -> Any:
    """A square for each place of a grid, a dot for each problem of a random set."""
    ax.set(xlabel=_label(x), ylabel=_label(y))
    xs, ys = np.unique(runs[x]), np.unique(runs[y])
    if len(xs) * len(ys) > 4 * len(runs):
        return ax.scatter(runs[x], runs[y], c=runs[column], s=9, **style)
    known = runs.dropna(subset=[column])
    places = known.pivot_table(column, y, x, aggfunc=of).reindex(index=ys, columns=xs)
    shown = np.ma.masked_invalid(places.to_numpy(dtype=float))
    return ax.pcolormesh(xs, ys, shown, shading="nearest", **style)


def _ranks(runs: DataFrame) -> dict[str, int]:
    """Sequence -> its rank by frequency, from 1, those beyond the colours alike; no plan is 0."""
    order = plans(runs)["sequence"].value_counts().index
    ranks = {name: min(rank, _TOLD_APART + 1) for rank, name in enumerate(order, 1)}
    return ranks if (runs["sequence"] != "").all() else {"": 0, **ranks}


def _label(key: str) -> str:
    """A key with its unit."""
    name = counted(key)
    unit = unit_of(key_of(name.split()[0]))
    return f"{name} [{unit}]" if unit else name


# Paul Tol's bright colours, which the colour-blind can tell apart.
_COLOURS = ["#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377"]
_PALE = 0.75  # share of white in the colour of what takes longest
_AXES = {"x": "x [m]", "y": "y [m]", "phi": "heading [rad]"}


@public
def plot_map(
    cells: Sequence[Cell], over: tuple[str, str], path: str | Path | None = None
) -> Figure:
    """Draw a map of goals: a colour for each mode sequence, paler where it takes longer.

    Args:
        cells: Of one grid, in any order.
        over: Names of the two coordinates.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If there is nothing to draw, matplotlib cannot write such a file, or the folder
            cannot be written.
    """
    if not cells:
        raise InputError("cells", cells, "at least one cell")
    x, y = (sorted({getattr(cell, name) for cell in cells}) for name in ("x", "y"))
    names = sorted({cell.sequence for cell in cells if cell.sequence})
    colours = dict(zip(names, _COLOURS * len(names), strict=False))
    taken = [cell.duration_s for cell in cells if cell.duration_s is not None]
    least, most = (min(taken), max(taken)) if taken else (0.0, 1.0)
    picture = np.ones((len(y), len(x), 3))
    for cell in cells:
        if cell.duration_s is not None:
            share = _PALE * (cell.duration_s - least) / max(most - least, 1e-9)
            colour = (1 - share) * np.array(to_rgb(colours[cell.sequence])) + share
            picture[y.index(cell.y), x.index(cell.x)] = colour
    with figures.styled_figure((7.2, 5.4), path) as figure:
        ax = figure.add_subplot()
        steps = [(line[-1] - line[0]) / max(len(line) - 1, 1) / 2 or 0.5 for line in (x, y)]
        extent = (x[0] - steps[0], x[-1] + steps[0], y[0] - steps[1], y[-1] + steps[1])
        ax.imshow(picture, origin="lower", extent=extent, aspect="auto")
        ax.set(xlabel=_axis(over[0]), ylabel=_axis(over[1]))
        ax.set_title(f"best mode sequence; paler is longer, {least:z.0f} to {most:z.0f} s")
        handles = [Patch(color=colours[name], label=name) for name in names]
        handles.append(Patch(fc="white", ec="0.5", label="no plan"))
        figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _axis(name: str) -> str:
    return _AXES.get(name, f"curvature {name.removeprefix('kappa')} [1/m]")


HEAD_IN, THIN_LANE_IN, BETWEEN_IN = 0.3, 0.24, 0.16  # of plans side by side
MOTION: dict[str, Any] = {"color": "0.3", "alpha": 0.55, "lw": 1.2}  # there; may be very short


@public
def plot_comparison(plans: Mapping[str, Sequence[Plan]], path: str | Path | None = None) -> Figure:
    """Draw plans on one time axis: a block a problem, in it a row a plan.

    Args:
        plans: Name of each problem -> its plans, e.g. one of each planner.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If there is nothing to compare, matplotlib cannot write such a file, or the
            folder cannot be written.
    """
    every = list(chain.from_iterable(plans.values()))
    if not every:
        raise InputError("plans", dict(plans), "at least one plan")
    end_s = max(made.trajectory.duration_s for made in every) or 1.0
    heights = list[float]()
    for each in plans.values():
        heights += (HEAD_IN + THIN_LANE_IN * made.robot.geometry.segments for made in each)
        heights.append(BETWEEN_IN)
    heights.pop()
    with figures.styled_figure((WIDTH_IN, sum(heights) + 1.0), path) as figure:
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        row, axes = 0, list[Axes]()
        for name, each in plans.items():
            for made in each:
                axes.append(figure.add_subplot(grid[row], sharex=axes[0] if axes else None))
                _draw_row(axes[-1], name, made)
                axes[-1].tick_params(labelbottom=False)
                row += 1
            row += 1
        axes[-1].tick_params(labelbottom=True)
        axes[-1].set(xlim=(0.0, 1.005 * end_s), xlabel="time [s]")
        handles = [*timeline_figures.state_handles(), Patch(**MOTION, label="motion")]
        figure.legend(handles=handles, loc="outside lower center", ncols=6)
    return figure


def _draw_row(ax: Axes, name: str, made: Plan) -> None:
    """Lanes of a plan, named above; its motion as lines that are never too thin to see."""
    timeline_figures.draw_lanes(ax, made)
    for phase in made.phases:
        ax.axvspan(phase.start_s, phase.end_s, **MOTION, zorder=4)
    ax.set_title(f"{name}: {plan_title(made)}", loc="left", fontsize=9)
    ax.set_yticks(ax.get_yticks(), [tick.get_text()[-1] for tick in ax.get_yticklabels()])
    ax.set_ylabel("segment", fontsize=8)
    ax.spines["bottom"].set_visible(False)
    ax.tick_params(axis="x", length=0)
