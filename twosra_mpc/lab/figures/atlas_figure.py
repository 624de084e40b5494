"""Pictures of a batch: sequences and durations over what was varied, savings, gaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import Locator, LogLocator, NullFormatter, SymmetricalLogLocator

from twosra_mpc.errors import InputError
from twosra_mpc.keys import key_of, unit_of
from twosra_mpc.lab.batch.atlas import Worth, atlas, counted, has_greedy, numeric_keys, plans
from twosra_mpc.plotting import figures
from twosra_mpc.robot.coordinates import Array

if TYPE_CHECKING:
    from pandas import DataFrame

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


def _most_frequent(codes: Array) -> float:
    return float(np.bincount(codes.astype(int)).argmax())


def draw_quantity(
    ax: Axes, runs: DataFrame, x: str, y: str | None, column: str, title: str
) -> None:
    """Draw a number of the plans over two keys in colours, or over one key."""
    if y is None:
        ax.scatter(runs[x], runs[column], c=_BLUE, s=10)
        ax.set(xlabel=_label(x))
    else:
        drawn = _draw_places(ax, runs, x, y, column, np.nanmedian, {"cmap": "viridis"})
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
    of: Callable[[Array], float],
    style: dict[str, Any],
) -> Any:
    """A square for each place of a grid, a dot for each problem of a random set."""
    ax.set(xlabel=_label(x), ylabel=_label(y))
    xs, ys = np.unique(runs[x]), np.unique(runs[y])
    if len(xs) * len(ys) > 4 * len(runs):
        return ax.scatter(runs[x], runs[y], c=runs[column], s=9, **style)
    places = np.full((len(ys), len(xs)), np.nan)
    rows, columns = np.searchsorted(ys, runs[y]), np.searchsorted(xs, runs[x])
    for _, group in runs.assign(row_=rows, column_=columns).groupby([x, y]):
        known = group[column].dropna().to_numpy(dtype=float)
        if known.size:
            places[group["row_"].iloc[0], group["column_"].iloc[0]] = of(known)
    return ax.pcolormesh(xs, ys, np.ma.masked_invalid(places), shading="nearest", **style)


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
