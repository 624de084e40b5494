"""The plan over time: lanes and curves by their places on a stretched time axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Interval, Samples, stiffness_intervals, stretches
from twosra_mpc.plotting import TimeStretch
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import mode_name, soft_segments

_DIGIT, _WIDE_DIGIT = 0.009, 0.028  # width of a tick label's digit on a wide and a narrow screen


class Span(NamedTuple):
    """Part of a lane: from place to place, how it looks, what it says, and how high it is."""

    left: float
    width: float
    look: str
    label: str
    title: str
    level: float = 1.0


class Lane(NamedTuple):
    """One row of the timeline."""

    name: str
    spans: tuple[Span, ...]


class Tick(NamedTuple):
    """A time worth a label; on narrow screens only some of them are shown."""

    place: float
    label: str
    on_narrow: bool


class Thermometer(NamedTuple):
    """Scale of temperatures that holds everything the plan does [C]."""

    low_C: float
    high_C: float
    solid_C: float
    liquid_C: float

    @classmethod
    def of(cls, plan: Plan) -> Thermometer:
        """Choose the scale: in tens of degrees, with room above and below."""
        solid, liquid = plan.problem.stiffness_thresholds_C
        shown = [*plan.trajectory.samples.temperature_C.ravel().tolist(), solid, liquid]
        low, high = 10 * np.floor(min(shown) / 10 - 0.2), 10 * np.ceil(max(shown) / 10 + 0.2)
        return cls(float(low), float(high), solid, liquid)

    def level(self, temperature_C: float) -> float:
        """Place of a temperature on the scale, 0 to 100 from below."""
        return 100 * (temperature_C - self.low_C) / (self.high_C - self.low_C)

    @property
    def marks(self) -> list[float]:
        """Round temperatures worth a mark [C]."""
        step = 10.0 if self.high_C - self.low_C <= 60 else 20.0
        return np.arange(self.low_C, self.high_C + 1, step).tolist()

    @property
    def melting_words(self) -> str:
        """Name of the threshold."""
        if self.solid_C == self.liquid_C:
            return f"melts at {self.solid_C:zg} °C"
        return f"changes from {self.solid_C:zg} to {self.liquid_C:zg} °C"


def lanes(plan: Plan, stretch: TimeStretch) -> list[Lane]:
    """Return task, motion, stiffness and heater lanes from top to bottom."""
    each = tuple(_tasks(plan, stretch))
    made = [Lane("task", each)] if each else []
    made.append(Lane("motion", tuple(_motion(plan, stretch))))
    for segment, intervals in enumerate(stiffness_intervals(plan.trajectory), start=1):
        made.append(Lane(f"segment {segment}", tuple(_stiffness(intervals, segment, stretch))))
        heater = _heater(plan.trajectory.samples, segment, stretch)
        made.append(Lane(f"heater {segment}", tuple(heater)))
    return made


def _tasks(plan: Plan, stretch: TimeStretch) -> Iterator[Span]:
    for number, stage in enumerate(stretches(plan.trajectory), start=1):
        title = f"{number}: {stage.words}, {_during(stage.from_s, stage.to_s)}"
        span = _span(stretch, stage.from_s, stage.to_s, "done", f"{number} {stage.words}", title)
        fits = len(span.label) + 1 < span.width  # else the number alone
        yield span if fits else span._replace(label=str(number))


def _motion(plan: Plan, stretch: TimeStretch) -> Iterator[Span]:
    for phase in plan.phases:
        soft = [f"segment {j + 1}" for j in soft_segments(phase.mode)]
        what = f"bending {' and '.join(soft)}" if soft else "driving rigidly"
        title = f"{mode_name(phase.mode)} {what}, {_during(phase.start_s, phase.end_s)}"
        look = "bending" if soft else "driving"
        yield _span(stretch, phase.start_s, phase.end_s, look, mode_name(phase.mode), title)


def _stiffness(intervals: Sequence[Interval], segment: int, stretch: TimeStretch) -> Iterator[Span]:
    for low, high, state in intervals:
        if high > low:
            title = f"segment {segment} {state}, {_during(low, high)}"
            yield _span(stretch, low, high, state, state, title)


def _heater(samples: Samples, segment: int, stretch: TimeStretch) -> Iterator[Span]:
    """Spans in which the heater is on, each as high as its current."""
    current, most = samples.heater_current_A[:, segment - 1], float(samples.heater_current_A.max())
    changes = [0, *(np.flatnonzero(np.diff(current)) + 1).tolist(), len(current) - 1]
    for first, last in pairwise(changes):
        if current[first] > 0 and first < last:
            low, high = float(samples.t_s[first]), float(samples.t_s[last])
            title = f"heater {segment} at {current[first]:z.3g} A, {_during(low, high)}"
            label = f"{current[first]:z.2g} A"
            span = _span(stretch, low, high, "heating", label, title)
            yield span._replace(level=round(float(current[first]) / most, 3))


def _span(stretch: TimeStretch, low: float, high: float, look: str, label: str, title: str) -> Span:
    left, right = (100 * stretch.forward(np.array([low, high]))).tolist()
    return Span(round(left, 3), round(right - left, 3), look, label, title)


def _during(low: float, high: float) -> str:
    return f"{low:z.2f} s to {high:z.2f} s"


def ticks(stretch: TimeStretch) -> list[Tick]:
    """Return the times worth a label, in order."""
    few = set(stretch.ticks(_WIDE_DIGIT))
    return [
        Tick(round(100 * float(stretch.forward(np.array(t))), 3), label, t in few)
        for t, label in sorted(stretch.ticks(_DIGIT).items())
    ]


def curve(t_s: Array, levels: Sequence[float], stretch: TimeStretch) -> str:
    """Levels, 0 to 100 from below, as an SVG ``points`` attribute in a box of 1000 by 100."""
    places = 1000 * stretch.forward(t_s)
    return " ".join(f"{x:z.2f},{100 - y:z.2f}" for x, y in zip(places, levels, strict=True))
