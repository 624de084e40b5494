"""Figures of plans: the robot in the plane, the stiffness of its segments, everything over time.

Motion phases last about a second, the holds between them minutes, so the time axis is stretched
inside the phases (`TimeStretch`). Needs no display and leaves ``rcParams`` alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.errors import NoPlanError
from twosra_mpc.figure_file import check_figure_path, save_figure
from twosra_mpc.modes import Mode, mode_name
from twosra_mpc.plan import Phase, Plan, Samples
from twosra_mpc.robot import Geometry

Array = NDArray[np.float64]

RIGID_COLOUR, SOFT_COLOUR, CHANGING_COLOUR = "#2a6fbb", "#c8202f", "#f6b04e"
SEGMENT_COLOURS = ("#222222", "#12997c")  # segment and locomotion unit 1, 2
UNIT_COLOUR, METAL_COLOUR, HEATER_COLOUR = "#eceff1", "#455a64", "#5d4037"
FAINT = 0.33  # opacity of a pose that is left behind
SIZE_IN, DPI = (10.0, 9.8), 160

STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": "medium",
    "figure.titlesize": 12,
    "figure.titleweight": "bold",
    "figure.facecolor": "white",
    "figure.constrained_layout.h_pad": 0.06,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.7,
    "pdf.fonttype": 42,
}
BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
_HATCHED = {"fc": CHANGING_COLOUR, "ec": "white", "lw": 0}
STATES: dict[str, dict[str, Any]] = {
    "rigid": {"fc": RIGID_COLOUR, "lw": 0},
    "melting": _HATCHED | {"hatch": "////"},
    "soft": {"fc": SOFT_COLOUR, "lw": 0},
    "freezing": _HATCHED | {"hatch": r"\\\\"},
    "heater current": {"fc": HEATER_COLOUR, "lw": 0},
}


def plot_plan(plan: Plan, path: str | Path | None = None) -> Figure:
    """Draw a plan: start, goal and every phase in the plane; stiffness and motion over time.

    Args:
        plan: The plan.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        NoPlanError: If the plan has no samples.
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    if plan.samples is None:
        raise NoPlanError(plan.status, plan.message)
    if path is not None:
        check_figure_path(path)
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(plan_title(plan), wrap=True)
        rows = figure.add_gridspec(2, 1, height_ratios=(0.85, 1.0))
        _draw_plane(figure.add_subfigure(rows[0]), plan, plan.samples)
        _draw_timeline(figure.add_subfigure(rows[1]), plan, plan.samples)
        for ax in figure.axes:
            ax.tick_params(labelsize=8.5)  # not from rcParams: ticks are made when drawn
        if path is not None:
            save_figure(figure, path)
    return figure


def plan_title(plan: Plan) -> str:
    """Mode sequence, duration and what is known, in one line."""
    sequence = " → ".join(mode_name(phase.mode) for phase in plan.phases) or "no motion"
    duration = "" if plan.duration_s is None else f" in {plan.duration_s:.1f} s"
    planner = "" if plan.planner == "optimal" else f"{plan.planner}, "
    gap = "no bound proved"
    if plan.gap is not None:
        gap = f"proved gap {100 * plan.gap:.2g} %" if plan.gap > 1e-5 else "proved gap < 0.001 %"
    return f"{sequence}{duration}: {planner}{plan.status}, {gap}"


class RobotShape(NamedTuple):
    """Points of the robot in the plane [m].

    Attributes:
        origin: b0, (2,).
        segments: Arcs from the middle link to the fibre ends, (2, n, 2).
        links: Middle link and the two end links, (3, 2, 2).
        units: Corners of the locomotion units, (2, 4, 2).
        wheels: Corners of wheels 1 to 4, (4, 4, 2).
    """

    origin: Array
    segments: Array
    links: Array
    units: Array
    wheels: Array


def robot_shape(geometry: Geometry, q: ArrayLike, points: int = 40) -> RobotShape:
    """Place the robot at q = [x, y, phi, kappa1, kappa2] [m, m, rad, 1/m, 1/m], shape (5,)."""
    x, y, phi, *kappa = np.asarray(q, dtype=float)
    half_link, half_side = geometry.middle_link_m / 2, geometry.unit_side_m / 2
    rolling, across = geometry.wheel_radius_m, geometry.wheel_thickness_m / 2
    (h2, h3), h1 = geometry.front_wheel_m, geometry.side_wheel_m
    segments, units, wheels = [], [], []
    links = [np.array([(-half_link, 0.0), (half_link, 0.0)])]
    for side, curvature in zip((-1, 1), kappa, strict=True):
        arc = segment_arc(geometry, curvature, side, points)
        end, turn = arc[-1], side * curvature * geometry.segment_length_m
        segments.append(arc)
        links.append(_moved([(0.0, 0.0), (side * geometry.end_link_m, 0.0)], end, turn))
        units.append(_moved(_box(side * h2, 0.0, half_side, half_side), end, turn))
        wheels.append(_moved(_box(side * h1, 0.0, across, rolling), end, turn))
        wheels.append(_moved(_box(side * h2, -side * h3, rolling, across), end, turn))
    origin = np.array([x, y])
    placed = (_moved(part, origin, phi) for part in (segments, links, units, wheels))
    return RobotShape(origin, *placed)


def segment_arc(geometry: Geometry, kappa: float, side: int, points: int = 40) -> Array:
    """Arc of the segment on one side (-1 or 1) of b0, from the middle link out [m], (points, 2)."""
    run = np.linspace(0.0, geometry.segment_length_m, points)
    half = kappa * run / 2
    along, across = np.sinc(2 * half / np.pi), np.sin(half) * np.sinc(half / np.pi)
    return np.stack([side * (geometry.middle_link_m / 2 + run * along), run * across], axis=1)


def _box(x: float, y: float, half_x: float, half_y: float) -> Array:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.array([x, y]) + corners * (half_x, half_y)


def _moved(points: ArrayLike, origin: Array, turn: float) -> Array:
    """Points (..., 2) turned by ``turn`` [rad], then shifted by ``origin``."""
    c, s = np.cos(turn), np.sin(turn)
    moved: Array = np.asarray(points, dtype=float) @ np.array([(c, s), (-s, c)]) + origin
    return moved


def draw_robot(
    ax: Axes,
    geometry: Geometry,
    q: ArrayLike,
    mode: Mode,
    *,
    alpha: float = 1.0,
    linewidth: float = 4.0,
) -> list[Artist]:
    """Draw the robot at q [m, m, rad, 1/m, 1/m]: soft segments red, rigid ones blue.

    Args:
        ax: Axes in m.
        geometry: Lengths of the robot.
        q: Configuration, shape (5,).
        mode: 1 where a segment is soft.
        alpha: Opacity.
        linewidth: Width of the segments [pt]; the other lines scale with it.

    Returns:
        Every artist drawn, the two segments first.
    """
    shape = robot_shape(geometry, q)
    style: dict[str, Any] = {"alpha": alpha, "zorder": 3, "solid_capstyle": "butt"}
    fill: dict[str, Any] = {"alpha": alpha, "zorder": 3, "lw": linewidth / 5}
    artists: list[Artist] = []
    for arc, soft in zip(shape.segments, mode, strict=True):
        artists += ax.plot(*arc.T, lw=linewidth, c=SOFT_COLOUR if soft else RIGID_COLOUR, **style)
    for link in shape.links:
        artists += ax.plot(*link.T, lw=linewidth / 1.7, c=METAL_COLOUR, **style)
    for unit in shape.units:
        artists += ax.fill(*unit.T, fc=UNIT_COLOUR, ec=METAL_COLOUR, **fill)
    for wheel in shape.wheels:
        artists += ax.fill(*wheel.T, fc=METAL_COLOUR, ec="none", **fill)
    return artists


def _draw_plane(figure: SubFigure, plan: Plan, samples: Samples) -> None:
    """Overview on the left; on the right, if there are several phases, a panel each."""
    phases = plan.phases if len(plan.phases) > 1 else ()
    outer = figure.add_gridspec(1, 2 if phases else 1, width_ratios=(1.0, 1.1) if phases else None)
    panels = [figure.add_subplot(outer[0])]
    _draw_overview(panels[0], plan, samples)
    rows = 2 if len(phases) <= 6 else 3
    columns = -(-len(phases) // rows)
    grid = outer[-1].subgridspec(rows, max(2 * columns, 1))
    for number, phase in enumerate(phases):
        row, column = divmod(number, columns)
        left = 2 * column + (row == rows - 1) * (rows * columns - len(phases))  # centred
        panels.append(figure.add_subplot(grid[row, left : left + 2]))
        _draw_phase(panels[-1], plan, samples, number, phase)
    times = [0.0, *(t for phase in plan.phases for t in phase[1:])]
    seen = [robot_shape(plan.robot.geometry, _q_at(samples, t)).wheels for t in times]
    for panel in panels:
        panel.set_aspect("equal", adjustable="datalim")
        panel.update_datalim(np.concatenate(seen).reshape(-1, 2))
    _plane_legend(figure)


def _draw_overview(ax: Axes, plan: Plan, samples: Samples) -> None:
    geometry, ends, modes = plan.robot.geometry, samples.q[[0, -1]], samples.mode[[0, -1]].tolist()
    draw_robot(ax, geometry, ends[0], modes[0], alpha=FAINT, linewidth=5)
    draw_robot(ax, geometry, ends[1], modes[1], linewidth=5)
    for phase in reversed(plan.phases):  # the end of a phase lies over the start of the next
        _draw_path(ax, samples, phase)
    shapes = [robot_shape(geometry, q) for q in ends]
    start, goal = (shape.units.mean(axis=1) for shape in shapes)
    for number, (x, y) in enumerate(goal):
        ax.text(x, y, f"{number + 1}", ha="center", va="center", fontsize=8.5, zorder=4)
    apart = np.linalg.norm(start[:, None] - goal, axis=2)
    i, j = np.argmax(apart.min(axis=1)), np.argmax(apart.min(axis=0))
    j = 1 - j if apart[i, j] < geometry.unit_side_m else j  # one label a unit
    for name, centre, shape in zip(("start", "goal"), (start[i], goal[j]), shapes, strict=True):
        outward = (centre - shape.origin) / np.linalg.norm(centre - shape.origin)
        tip, shift = centre + 0.9 * geometry.unit_side_m * outward, (5 * outward).tolist()
        side = ("center", "left", "right")[round(outward[0])]
        style: dict[str, Any] = {"ha": side, "va": "center", "fontweight": "bold", "zorder": 7}
        ax.annotate(name, tip, shift, textcoords="offset points", **style)
    ax.margins(0.15, 0.1)
    ax.set(xlabel="x [m]", ylabel="y [m]")


def _draw_phase(ax: Axes, plan: Plan, samples: Samples, number: int, phase: Phase) -> None:
    geometry, mode = plan.robot.geometry, phase.mode
    draw_robot(ax, geometry, _q_at(samples, phase.start_s), mode, alpha=FAINT, linewidth=3)
    draw_robot(ax, geometry, _q_at(samples, phase.end_s), mode, linewidth=3)
    _draw_path(ax, samples, phase)
    ax.set_title(f"{number + 1}: {mode_name(phase.mode)}, {_duration(phase)}")
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set(visible=True, color="0.8")


def _draw_path(ax: Axes, samples: Samples, phase: Phase) -> None:
    """Path of b0 during a phase: blue while driving, red while bending."""
    low, high = np.searchsorted(samples.t_s, (phase.start_s - 1e-9, phase.end_s + 1e-9))
    colour = SOFT_COLOUR if any(phase.mode) else RIGID_COLOUR
    style: dict[str, Any] = {"marker": "o", "ms": 3.5, "mfc": "white", "markevery": [-1]}
    ax.plot(*samples.q[low:high, :2].T, color=colour, lw=1.5, zorder=5, **style)


def _plane_legend(figure: SubFigure) -> None:
    blue, red = RIGID_COLOUR, SOFT_COLOUR
    entries: dict[str, Any] = {
        "start (of phase)": Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR, alpha=FAINT),
        "goal (end of phase)": Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR),
        "rigid segment": Line2D([], [], color=blue, lw=4),
        "soft segment": Line2D([], [], color=red, lw=4),
        "path of the middle link": tuple(Line2D([], [], color=c, lw=1.5) for c in (blue, red)),
    }
    style: dict[str, Any] = {"ncols": 5, "handler_map": {tuple: HandlerTuple(ndivide=None)}}
    figure.legend(entries.values(), entries, loc="outside lower center", **style)


def _q_at(samples: Samples, t: float) -> Array:
    return np.array([np.interp(t, samples.t_s, column) for column in samples.q.T])


def _duration(phase: Phase) -> str:
    seconds = phase.end_s - phase.start_s
    return f"{1000 * seconds:.0f} ms" if seconds < 0.1 else f"{seconds:.2f} s"


class TimeStretch(NamedTuple):
    """Piecewise linear map from time to place on the axis; phases get a least width.

    Attributes:
        knots_s: Ends of phases and holds [s], increasing.
        places: Where they are on the axis, from 0 to 1.
    """

    knots_s: tuple[float, ...]
    places: tuple[float, ...]

    @classmethod
    def of(cls, phases: Sequence[Phase], end_s: float, least: float = 0.15) -> TimeStretch:
        """Give each phase at least ``least`` of the length of an unstretched axis."""
        edges = {round(t, 9) for phase in phases for t in phase[1:]}
        knots = (0.0, *sorted(t for t in edges if 0.0 < t < round(end_s, 9)), end_s)
        moving = [any(p[1] <= (a + b) / 2 <= p[2] for p in phases) for a, b in pairwise(knots)]
        widths = np.maximum(np.diff(knots), least * end_s * np.array(moving))
        return cls(knots, (0.0, *(np.cumsum(widths) / widths.sum()).tolist()))

    def forward(self, t: Array) -> Array:
        """Place of times [s] on the axis."""
        return np.interp(t, self.knots_s, self.places)

    def inverse(self, place: Array) -> Array:
        """Times [s] of places on the axis."""
        return np.interp(place, self.places, self.knots_s)

    def ticks(self, digit: float = 0.0085) -> dict[float, str]:
        """Times worth a tick [s] and labels that fit; ``digit`` is the width of one on the axis."""
        end_s, chosen = self.knots_s[-1], dict[float, str]()
        rounded = np.asarray(MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(0.0, end_s))
        for t in (0.0, end_s, *self.knots_s[1:-1], *rounded[rounded < end_s].tolist()):
            text = f"{t:.2f}".rstrip("0").rstrip(".")
            apart = np.abs(self.forward(np.array(list(chosen))) - self.forward(np.array(t)))
            widths = [digit * (1 + (len(text) + len(label)) / 2) for label in chosen.values()]
            if np.all(apart > widths):
                chosen[t] = text
        return chosen


def _draw_timeline(figure: SubFigure, plan: Plan, samples: Samples) -> None:
    axes = figure.subplots(5, 1, sharex=True, height_ratios=(1.25, 1.0, 1.0, 1.0, 0.6))
    stretch = TimeStretch.of(plan.phases, float(samples.t_s[-1]) or 1.0)
    ticks, end_s = stretch.ticks(), stretch.knots_s[-1]
    axes[-1].set_xscale("function", functions=(stretch.forward, stretch.inverse))
    even = np.allclose(stretch.places, np.divide(stretch.knots_s, end_s))
    note = "time [s]" + ("" if even else ", stretched inside the motion phases (grey)")
    axes[-1].set(xlim=(0.0, end_s), xlabel=note)
    axes[-1].set_xticks(list(ticks), list(ticks.values()))
    _draw_stiffness(axes[0], plan, samples, stretch)
    _draw_curvatures(axes[1], samples)
    _draw_wheel_speeds(axes[2], samples)
    _draw_temperatures(axes[3], plan, samples)
    _draw_melt_fractions(axes[4], samples)
    for ax in axes[1:]:
        ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
        ax.legend(**BESIDE)
    for ax, phase in product(axes, plan.phases):
        ax.axvspan(phase.start_s, phase.end_s, color="0.9", lw=0, zorder=0)
    figure.align_ylabels(axes)


def segment_states(plan: Plan, segment: int, end_s: float) -> list[tuple[float, float, str]]:
    """(from, to, state) of segment 1 or 2 [s]; "rigid", "melting", "soft" or "freezing"."""
    changes = [(0.0, "soft" if plan.problem.start_mode[segment - 1] else "rigid")]
    for item in plan.transitions:
        if item.segment == segment:
            changing = "melting" if item.to == "soft" else "freezing"
            changes += [(item.onset_s, changing), (item.done_s, item.to)]
    ends = [*(t for t, _ in changes[1:]), end_s]
    return [(t, end, what) for (t, what), end in zip(changes, ends, strict=True) if end > t]


def _draw_stiffness(ax: Axes, plan: Plan, samples: Samples, stretch: TimeStretch) -> None:
    """A bar a segment with its heater current below; the motion phases named above."""
    for segment, row in ((1, 1.0), (2, 0.0)):
        for low, high, state in segment_states(plan, segment, stretch.knots_s[-1]):
            ax.barh(row, high - low, 0.5, low, **STATES[state])
        bottom, current = row - 0.5, samples.heater_current_A[:, segment - 1]
        top = bottom + 0.2 * current / plan.robot.heater.current_max_A
        ax.fill_between(samples.t_s, bottom, top, step="post", **STATES["heater current"])
    for number, phase in enumerate(plan.phases):
        middle = stretch.forward(np.array(phase[1:])).mean()
        text = f"{number + 1}: {mode_name(phase.mode)}\n{_duration(phase)}"
        ax.text(middle, 1.0, text, transform=ax.transAxes, ha="center", va="bottom", fontsize=8.5)
    ax.set(ylim=(-0.55, 1.3), yticks=(0, 1), yticklabels=("segment 2", "segment 1"))
    ax.tick_params(axis="y", length=0)
    ax.legend(handles=[Patch(label=name, **look) for name, look in STATES.items()], **BESIDE)


def _draw_curvatures(ax: Axes, samples: Samples) -> None:
    for j, colour in enumerate(SEGMENT_COLOURS):
        ax.plot(samples.t_s, samples.q[:, 3 + j], color=colour, label=rf"$\kappa_{j + 1}$")
    ax.set(ymargin=0.12, ylabel="curvature\n[1/m]")


def _draw_wheel_speeds(ax: Axes, samples: Samples) -> None:
    for wheel, speed in enumerate(samples.wheel_rad_s.T):
        colour, dashes = SEGMENT_COLOURS[wheel // 2], ("-", "--")[wheel % 2]
        ax.step(samples.t_s, speed, dashes, c=colour, where="post", label=f"wheel {wheel + 1}")
    ax.set(ymargin=0.12, ylabel="wheel speed\n[rad/s]")


def _draw_temperatures(ax: Axes, plan: Plan, samples: Samples) -> None:
    solid, liquid = plan.problem.stiffness_thresholds_C
    melting = f"{solid:g} °C" if solid == liquid else f"{solid:g} to {liquid:g} °C"
    ax.axhspan(solid, liquid, color="0.5", lw=1, ls=":", alpha=0.5, label=f"changing, {melting}")
    for j, colour in enumerate(SEGMENT_COLOURS):
        style: dict[str, Any] = {"c": colour, "lw": 1, "ls": "--", "label": f"set-point {j + 1}"}
        ax.plot(samples.t_s, samples.temperature_C[:, j], color=colour, label=f"segment {j + 1}")
        ax.step(samples.t_s, samples.heater_setpoint_C[:, j], where="post", **style)
    ax.set(ymargin=0.12, ylabel="temperature\n[°C]")


def _draw_melt_fractions(ax: Axes, samples: Samples) -> None:
    for j, colour in enumerate(SEGMENT_COLOURS):
        liquid = samples.melt_fraction[:, j]
        ax.plot(samples.t_s, liquid, color=colour, label=f"segment {j + 1}")
        ax.fill_between(samples.t_s, liquid, color=colour, alpha=0.15, lw=0)
    ax.set(ylim=(0.0, 1.12), ylabel="melt\nfraction [-]")
