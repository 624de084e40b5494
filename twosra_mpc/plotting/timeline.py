"""A plan over time, one axes a quantity: stiffness of the segments, heaters, motion, temperature.

Every function draws on any time axis; ``plan_stretch(plan).apply(ax)`` stretches it.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twosra_mpc.errors import NoPlanError
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Phase, Samples
from twosra_mpc.plotting.style import BESIDE, SEGMENT_COLOURS, STATES
from twosra_mpc.plotting.time_axis import TimeStretch
from twosra_mpc.robot.modes import mode_name

Coordinate = Literal["position", "heading", "curvature"]

COORDINATES: dict[Coordinate, tuple[slice, tuple[str, ...], str]] = {
    "position": (slice(0, 2), ("x", "y"), "position\n[m]"),
    "heading": (slice(2, 3), (r"$\phi$",), "heading\n[rad]"),
    "curvature": (slice(3, 5), (r"$\kappa_1$", r"$\kappa_2$"), "curvature\n[1/m]"),
}
MOTION: dict[str, Any] = {"fc": "0.9", "ec": "0.9", "lw": 0.8, "zorder": 0}  # never too thin to see


def samples_of(plan: Plan) -> Samples:
    """Samples of a plan.

    Raises:
        NoPlanError: If it has none.
    """
    if plan.samples is None:
        raise NoPlanError(plan.status, plan.message)
    return plan.samples


def configuration_at(samples: Samples, time_s: float) -> NDArray[np.float64]:
    """Configuration q (5,) [m, m, rad, 1/m, 1/m] at a time between the samples."""
    return np.array([np.interp(time_s, samples.t_s, column) for column in samples.q.T])


def plan_stretch(plan: Plan) -> TimeStretch:
    """Time axis of a plan, stretched inside its motion phases.

    Raises:
        NoPlanError: If the plan has no samples.
    """
    return TimeStretch.of(plan.phases, float(samples_of(plan).t_s[-1]) or 1.0)


def segment_states(plan: Plan, segment: int, end_s: float) -> list[tuple[float, float, str]]:
    """(from, to, state) of segment 1 or 2 [s]; "rigid", "melting", "soft" or "freezing"."""
    changes = [(0.0, "soft" if plan.problem.start_mode[segment - 1] else "rigid")]
    for item in plan.transitions:
        if item.segment == segment:
            changing = "melting" if item.to == "soft" else "freezing"
            changes += [(item.onset_s, changing), (item.done_s, item.to)]
    ends = [*(t for t, _ in changes[1:]), end_s]
    return [(t, end, what) for (t, what), end in zip(changes, ends, strict=True) if end > t]


def draw_timeline(ax: Axes, plan: Plan) -> Axes:
    """Draw stiffness and heaters: a lane a segment, its heater current below, motion in grey.

    Raises:
        NoPlanError: If the plan has no samples.
    """
    draw_lanes(ax, plan).legend(handles=state_handles(), **BESIDE)
    return draw_motion(ax, plan)


def draw_lanes(ax: Axes, plan: Plan) -> Axes:
    """Draw what ``draw_timeline`` does, without motion and legend.

    Raises:
        NoPlanError: If the plan has no samples.
    """
    samples = samples_of(plan)
    for segment, row in ((1, 1.0), (2, 0.0)):
        for low, high, state in segment_states(plan, segment, float(samples.t_s[-1])):
            ax.barh(row, high - low, 0.5, low, **STATES[state])
        bottom, current = row - 0.5, samples.heater_current_A[:, segment - 1]
        top = bottom + 0.2 * current / plan.robot.heater.current_max_A
        ax.fill_between(samples.t_s, bottom, top, step="post", **STATES["heater current"])
    ax.set(ylim=(-0.55, 1.3), yticks=(0, 1), yticklabels=("segment 2", "segment 1"))
    ax.tick_params(axis="y", length=0)
    return ax


def draw_motion(ax: Axes, plan: Plan) -> Axes:
    """Shade the motion phases in grey."""
    for phase in plan.phases:
        ax.axvspan(phase.start_s, phase.end_s, **MOTION)
    return ax


def name_phases(ax: Axes, plan: Plan, stretch: TimeStretch) -> Axes:
    """Write number, mode and duration of every phase above a stretched time axis."""
    for number, phase in enumerate(plan.phases):
        middle = stretch.forward(np.array(phase[1:])).mean()
        text = f"{number + 1}: {mode_name(phase.mode)}\n{phase_duration(phase)}"
        ax.text(middle, 1.0, text, transform=ax.transAxes, ha="center", va="bottom", fontsize=8.5)
    return ax


def phase_duration(phase: Phase) -> str:
    """Duration of a phase in words that fit its length."""
    seconds = phase.end_s - phase.start_s
    return f"{1000 * seconds:.0f} ms" if seconds < 0.1 else f"{seconds:.2f} s"


def state_handles() -> list[Patch]:
    """What the colours of ``draw_timeline`` mean, for a legend."""
    return [Patch(label=name, **look) for name, look in STATES.items()]


def draw_configuration(ax: Axes, plan: Plan, coordinate: Coordinate = "curvature") -> Axes:
    """Draw position, heading or the curvatures over time.

    Raises:
        NoPlanError: If the plan has no samples.
    """
    samples, (columns, names, label) = samples_of(plan), COORDINATES[coordinate]
    for values, name, colour in zip(
        samples.q[:, columns].T, names, SEGMENT_COLOURS[: len(names)], strict=True
    ):
        ax.plot(samples.t_s, values, color=colour, label=name)
    ax.set(ymargin=0.12, ylabel=label)
    return _with_legend(ax)


def draw_wheel_speeds(ax: Axes, plan: Plan) -> Axes:
    """Draw the speeds of the four wheels over time.

    Raises:
        NoPlanError: If the plan has no samples.
    """
    samples = samples_of(plan)
    for wheel, speed in enumerate(samples.wheel_rad_s.T):
        colour, dashes = SEGMENT_COLOURS[wheel // 2], ("-", "--")[wheel % 2]
        ax.step(samples.t_s, speed, dashes, c=colour, where="post", label=f"wheel {wheel + 1}")
    ax.set(ymargin=0.12, ylabel="wheel speed\n[rad/s]")
    return _with_legend(ax)


def draw_temperatures(ax: Axes, plan: Plan) -> Axes:
    """Draw expected temperatures and set-points over time, and the range in which metal melts.

    Raises:
        NoPlanError: If the plan has no samples.
    """
    samples = samples_of(plan)
    solid, liquid = plan.problem.stiffness_thresholds_C
    melting = f"{solid:g} °C" if solid == liquid else f"{solid:g} to {liquid:g} °C"
    ax.axhspan(solid, liquid, color="0.5", lw=1, ls=":", alpha=0.5, label=f"changing, {melting}")
    for j, colour in enumerate(SEGMENT_COLOURS):
        style: dict[str, Any] = {"c": colour, "lw": 1, "ls": "--", "label": f"set-point {j + 1}"}
        ax.plot(samples.t_s, samples.temperature_C[:, j], color=colour, label=f"segment {j + 1}")
        ax.step(samples.t_s, samples.heater_setpoint_C[:, j], where="post", **style)
    ax.set(ymargin=0.12, ylabel="temperature\n[°C]")
    return _with_legend(ax)


def draw_melt_fractions(ax: Axes, plan: Plan) -> Axes:
    """Draw expected melt fractions over time.

    Raises:
        NoPlanError: If the plan has no samples.
    """
    samples = samples_of(plan)
    for j, colour in enumerate(SEGMENT_COLOURS):
        liquid = samples.melt_fraction[:, j]
        ax.plot(samples.t_s, liquid, color=colour, label=f"segment {j + 1}")
        ax.fill_between(samples.t_s, liquid, color=colour, alpha=0.15, lw=0)
    ax.set(ylabel="melt\nfraction [-]")
    _with_legend(ax)
    ax.set_ylim(0.0, 1.12)
    return ax


def _with_legend(ax: Axes) -> Axes:
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
    ax.legend(**BESIDE)
    return ax
