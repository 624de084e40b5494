"""A plan over time, one axes a quantity: stiffness of the segments, heaters, motion, temperature.

Time axes can be stretched: motion phases last about a second, the holds between them minutes.
Every function draws on any time axis; ``plan_stretch(plan).apply(ax)`` stretches it. Functions that
take a plan raise NoPlanError if there is none.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twosra_mpc.arguments import public
from twosra_mpc.checking.followed import Followed
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Interval, Phase, Stretch, stiffness_intervals
from twosra_mpc.plotting import figures
from twosra_mpc.robot.coordinates import WHEELS, Array
from twosra_mpc.robot.modes import mode_name
from twosra_mpc.validation import Positive, Share

Timed = tuple[Array, Array]  # times [s], and a row of values each
KAPPA = "κ₁", "κ₂", "κ₃", "κ₄"
Coordinate = Literal["position", "heading", "curvature"]

COORDINATES: dict[Coordinate, tuple[slice, tuple[str, ...], str]] = {
    "position": (slice(0, 2), ("x", "y"), "position\n[m]"),
    "heading": (slice(2, 3), ("φ",), "heading\n[rad]"),
    "curvature": (slice(3, None), KAPPA, "curvature\n[1/m]"),
}
STAGE_LINE: dict[str, Any] = {"c": figures.STAGE_COLOUR, "lw": 0.9, "ls": (0, (5, 2)), "zorder": 6}
SIZE_PT, LEAST_PT = 8.5, 5.0  # of words above a time axis
LEVEL = 0.28  # height of the words of a stage, of that of a curve
LETTER = 0.0095  # width of a letter on the time axis
MOTION: dict[str, Any] = {"fc": "0.9", "ec": "0.9", "lw": 0.8, "zorder": 0}  # never too thin to see


@public
class TimeStretch(NamedTuple):
    """Piecewise linear map from time to place on the axis; phases get a least width.

    Attributes:
        knots_s: Ends of phases and holds [s], increasing.
        places: Where they are on the axis, from 0 to 1.
    """

    knots_s: tuple[float, ...]
    places: tuple[float, ...]

    @classmethod
    def of(cls, phases: Sequence[Phase], end_s: Positive, least: Share = 0.15) -> TimeStretch:
        """Give each phase at least ``least`` of the length of an unstretched axis."""
        edges = {round(t, 9) for phase in phases for t in phase[1:]}
        knots = (0.0, *sorted(t for t in edges if 0.0 < t < round(end_s, 9)), end_s)
        moving = [any(p[1] <= (a + b) / 2 <= p[2] for p in phases) for a, b in pairwise(knots)]
        widths = np.maximum(np.diff(knots), least * end_s * np.array(moving))
        return cls(knots, (0.0, *(np.cumsum(widths) / widths.sum()).tolist()))

    @property
    def even(self) -> bool:
        """True if nothing is stretched."""
        return np.allclose(self.places, np.divide(self.knots_s, self.knots_s[-1]))

    def forward(self, t: Array) -> Array:
        """Place of times [s] on the axis."""
        return np.interp(t, self.knots_s, self.places)

    def inverse(self, place: Array) -> Array:
        """Times [s] of places on the axis."""
        return np.interp(place, self.places, self.knots_s)

    def seconds_per_length(self, time_s: float) -> float:
        """Length of the whole axis at the scale it has at a time [s]."""
        part = min(bisect_right(self.knots_s, time_s + 1e-9), len(self.knots_s) - 1) - 1
        shown = self.places[part + 1] - self.places[part]
        return (self.knots_s[part + 1] - self.knots_s[part]) / shown

    def ticks(self, digit: Positive = 0.0085) -> dict[float, str]:
        """Times worth a tick [s] and labels that fit; ``digit`` is the width of one on the axis."""
        end_s, chosen = self.knots_s[-1], dict[float, str]()
        rounded = np.asarray(MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(0.0, end_s))
        for t in (0.0, end_s, *self.knots_s[1:-1], *rounded[rounded < end_s].tolist()):
            text = f"{t:z.2f}".rstrip("0").rstrip(".")
            apart = np.abs(self.forward(np.array(list(chosen))) - self.forward(np.array(t)))
            widths = [digit * (1 + (len(text) + len(label)) / 2) for label in chosen.values()]
            if np.all(apart > widths):
                chosen[t] = text
        return chosen

    def apply(self, ax: Axes, digit: Positive = 0.0085) -> Axes:
        """Make this the time axis of ``ax``, with its ticks; see ``ticks``."""
        ticks = self.ticks(digit)
        ax.set_xscale("function", functions=(self.forward, self.inverse))
        ax.set(xlim=(0.0, self.knots_s[-1]))
        ax.set_xticks(list(ticks), list(ticks.values()))
        return ax


@public
def plan_stretch(plan: Plan) -> TimeStretch:
    """Time axis of a plan, stretched inside its motion phases."""
    return TimeStretch.of(plan.phases, plan.trajectory.duration_s or 1.0)


@public
def draw_timeline(ax: Axes, plan: Plan) -> Axes:
    """Draw stiffness and heaters: a lane a segment, its heater current below, motion in grey."""
    draw_lanes(ax, plan).legend(handles=state_handles(), **figures.BESIDE)
    return draw_motion(ax, plan)


def draw_lanes(ax: Axes, plan: Plan) -> Axes:
    """Draw what ``draw_timeline`` does, without motion and legend."""
    samples, full = plan.trajectory.samples, plan.robot.heater.current_max_A
    draw_stiffness(ax, stiffness_intervals(plan.trajectory), 0.5)
    for row, current in enumerate(reversed(samples.heater_current_A.T)):
        top = row - 0.5 + 0.2 * current / full
        style: dict[str, Any] = {"step": "post", **figures.STATES["heater current"]}
        ax.fill_between(samples.t_s, row - 0.5, top, **style)
    ax.set(ylim=(-0.55, samples.mode.shape[1] - 0.7))
    ax.tick_params(axis="y", length=0)
    return ax


def draw_stiffness(ax: Axes, intervals: Sequence[Sequence[Interval]], height: float) -> Axes:
    """Draw a bar a segment, the first on top, in the colours of its states."""
    for row, each in enumerate(reversed(intervals)):
        for start_s, end_s, state in each:
            ax.barh(row, end_s - start_s, height, start_s, **figures.STATES[state])
    names = [f"segment {number}" for number in range(len(intervals), 0, -1)]
    ax.set_yticks(range(len(intervals)), names)
    return ax


def intervals_of(time_s: Array, states: NDArray[Any]) -> tuple[Interval, ...]:
    """Intervals in which a row's state is that of the rows before; the last row only ends one."""
    changes = np.flatnonzero(states[1:-1] != states[:-2]) + 1
    edges, times, names = [0, *changes.tolist(), len(states) - 1], time_s.tolist(), states.tolist()
    return tuple(Interval(times[i], times[j], names[i]) for i, j in pairwise(edges))


@public
def draw_motion(ax: Axes, plan: Plan) -> Axes:
    """Shade the motion phases in grey."""
    for phase in plan.phases:
        ax.axvspan(phase.start_s, phase.end_s, **MOTION)
    return ax


def name_phases(ax: Axes, phases: Sequence[Phase], stretch: TimeStretch, text: str) -> None:
    """Write number, mode and duration of phases, as ``text`` has them, above a stretched axis.

    Where phases are many, the words are small.
    """
    told = [
        text.format(number=number, mode=mode_name(phase.mode), took=phase_duration(phase))
        for number, phase in enumerate(phases, start=1)
    ]
    longest = max((len(line) for words in told for line in words.split("\n")), default=0)
    middles = [float(stretch.forward(np.array(phase[1:])).mean()) for phase in phases]
    share = min(np.diff(middles), default=1.0) / (LETTER * longest or 1.0)
    size = SIZE_PT * min(1.0, max(share, LEAST_PT / SIZE_PT))
    style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": size}
    for words, middle in zip(told, middles, strict=True):
        ax.text(middle, 1.0, words, transform=ax.transAxes, **style)


def label_levels(each: Sequence[Stretch], stretch: TimeStretch) -> list[int]:
    """Level of the words of each stage, from 0, so that none lie over others or their lines."""
    levels: list[int] = []
    taken: list[tuple[float, float]] = []  # from where to where, the last stage first
    for number, stage in reversed(list(enumerate(each, start=1))):
        begin = float(stretch.forward(np.array(stage.to_s)))
        end = begin + LETTER * (1 + len(stage_words(number, stage)))
        over = [level for level, (left, _) in zip(levels, taken, strict=True) if left < end]
        levels.append(1 + max(over) if over else 0)
        taken.append((begin, end))
    return levels[::-1]


def stage_words(number: int, stage: Stretch) -> str:
    """Words of the time axis for a stage, where it is done."""
    return f"{number} {figures.short(stage.words)}"


def name_stages(ax: Axes, each: Sequence[Stretch], levels: Sequence[int]) -> None:
    """Write what is done when, on levels from below, each with a line down from its words."""
    for number, (stage, level) in enumerate(zip(each, levels, strict=True), start=1):
        ax.plot([stage.to_s] * 2, [-0.5, level + 0.75], **STAGE_LINE)
        words: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": SIZE_PT}
        told = stage_words(number, stage)
        ax.annotate(told, (stage.to_s, level + 0.4), (3, 0), color=figures.STAGE_COLOUR, **words)
    ax.set(ylim=(-0.5, max(levels, default=0) + 0.9), yticks=[])
    ax.spines[:].set_visible(False)
    ax.tick_params(axis="x", length=0, labelbottom=False)


def phase_duration(phase: Phase) -> str:
    """Duration of a phase in words that fit its length."""
    seconds = phase.end_s - phase.start_s
    return f"{1000 * seconds:z.0f} ms" if seconds < 0.1 else f"{seconds:z.2f} s"


def state_handles(*without: str) -> list[Patch]:
    """Legend of the colours of ``draw_timeline``."""
    shown = figures.STATES.keys() - {*without}
    return [Patch(label=name, **look) for name, look in figures.STATES.items() if name in shown]


@public
def draw_configuration(ax: Axes, plan: Plan, coordinate: Coordinate = "curvature") -> Axes:
    """Draw position, heading or the curvatures over time."""
    samples, (columns, names, label) = plan.trajectory.samples, COORDINATES[coordinate]
    for j, (values, name) in enumerate(zip(samples.q[:, columns].T, names, strict=False)):
        ax.plot(samples.t_s, values, label=name, **figures.segment_curve(j))
    return finished(ax, label)


@public
def draw_wheel_speeds(ax: Axes, plan: Plan) -> Axes:
    """Draw the speeds of the four wheels over time: ramps, and jumps where they jump."""
    samples, end = plan.trajectory.samples, plan.trajectory.wheel_rad_s_before
    ends = np.stack([samples.wheel_rad_s[:-1], end], axis=1).reshape(-1, WHEELS)
    return wheel_speeds(ax, np.repeat(samples.t_s, 2)[1:-1], ends)


def wheel_speeds(ax: Axes, time_s: Array, wheel_rad_s: Array, drawstyle: str = "default") -> Axes:
    """Draw speeds of the four wheels, (rows, 4)."""
    for wheel, speed in enumerate(wheel_rad_s.T):
        style = figures.segment_curve(wheel // 2, ("-", "--")[wheel % 2])
        ax.plot(time_s, speed, label=f"wheel {wheel + 1}", drawstyle=drawstyle, **style)
    return finished(ax, "wheel speed\n[rad/s]")


def draw_off_path(ax: Axes, found: Sequence[Followed]) -> Axes:
    """Draw how far what follows a path is from it, and how far it may be."""
    for each in found:
        ax.plot(each.t_s, 1e3 * each.off_m, c=figures.NEAREST_COLOUR, lw=1.0)
        ends, most = each.t_s[[0, -1]], [1e3 * each.within_m] * 2
        ax.plot(ends, most, c=figures.TASK_COLOUR, lw=1.0, ls="--")
    ax.set_ylim(bottom=0.0)
    return ax


@public
def draw_temperatures(ax: Axes, plan: Plan) -> Axes:
    """Draw expected temperatures and set-points over time, and the range in which metal melts."""
    samples = plan.trajectory.samples
    warm, asked = (samples.t_s, samples.temperature_C), (samples.t_s, samples.heater_setpoint_C)
    return temperatures(ax, plan.problem.stiffness_thresholds_C, warm, asked)


def temperatures(
    ax: Axes, melting_C: tuple[float, float], warm: Timed, asked: Timed, sensed: Timed | None = None
) -> Axes:
    """Draw temperatures, set-points and readings of the segments, each (rows,) and (rows, n)."""
    mark_melting(ax, melting_C)
    for j, (of_segment, setpoint) in enumerate(zip(warm[1].T, asked[1].T, strict=True)):
        ax.plot(warm[0], of_segment, label=f"segment {j + 1}", **figures.segment_curve(j))
        if sensed is not None:
            ax.plot(sensed[0], sensed[1][:, j], **figures.segment_curve(j, ":"))
        ax.step(asked[0], setpoint, where="post", **figures.segment_curve(j, "--"))
    if sensed is not None:
        ax.plot([], [], c=figures.PLANNED_COLOUR, lw=1, ls=":", label="by the sensor")
    ax.plot([], [], c=figures.PLANNED_COLOUR, lw=1, ls="--", label="set-point")
    return finished(ax, "temperature\n[°C]")


def mark_melting(ax: Axes, melting_C: tuple[float, float], **look: Any) -> None:
    """Shade the temperatures at which metal melts."""
    solid, liquid = melting_C
    melting = f"{solid:zg} °C" if solid == liquid else f"{solid:z.3g} to {liquid:z.3g} °C"
    style: dict[str, Any] = {"color": "0.5", "lw": 1, "ls": ":", "alpha": 0.5}
    ax.axhspan(solid, liquid, **{**style, "label": f"changing, {melting}", **look})


@public
def draw_melt_fractions(ax: Axes, plan: Plan) -> Axes:
    """Draw expected melt fractions over time."""
    samples = plan.trajectory.samples
    for j, liquid in enumerate(samples.melt_fraction.T):
        look = figures.segment_curve(j)
        ax.plot(samples.t_s, liquid, label=f"segment {j + 1}", **look)
        ax.fill_between(samples.t_s, liquid, color=look["color"], alpha=0.15, lw=0)
    finished(ax, "melt\nfraction [-]").set_ylim(0.0, 1.12)
    return ax


def finished(ax: Axes, label: str) -> Axes:
    """Label the quantity of an axes, and name its curves beside it."""
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
    ax.set(ymargin=0.12)
    ax.set_ylabel(label, fontsize=SIZE_PT)
    many = len(ax.get_legend_handles_labels()[1]) > 5
    ax.legend(**figures.BESIDE, **({"fontsize": 7, "labelspacing": 0.2} if many else {}))
    return ax
