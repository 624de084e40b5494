"""Closed loop of one heater: segment, sensor and stiffness controller, for a profile of set-points.

The plant is any segment model, propagated exactly between the controller's steps; it need not be
the model that the controller was built for.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.control.stiffness_controller import Event, StiffnessController
from twosra_mpc.control.thermistor import TemperatureSensor
from twosra_mpc.errors import InputError
from twosra_mpc.execution.simulation.heated_segment import LONGEST_STEP_S, HeatedSegment
from twosra_mpc.files import write_text
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.model import SegmentModel

Profile = Sequence[tuple[float, Stiffness]]

SETTLED_K = 2.0  # settled: this close to the set-point from then on
MOST_STEPS = 1_000_000


@dataclass(frozen=True)
class LinearMap:
    """The paper's idealised sensor: voltage rises in a straight line with temperature.

    No divider has it: one that spans these voltages, read by a straight line, is 0.9 C low at 65 C
    and 7.6 C low at 25 C.
    Its upper end is the supply, so from there on it reads as a fault.
    """

    range_C: tuple[float, float] = (0.0, 85.0)
    range_V: tuple[float, float] = (1.1, 3.3)

    @property
    def supply_V(self) -> float:
        """Upper end of the line."""
        return self.range_V[1]

    def voltage_V(self, temperature_C: float) -> float:
        """Voltage on the line, or its extension."""
        (cold, hot), (low, high) = self.range_C, self.range_V
        return low + (high - low) * (temperature_C - cold) / (hot - cold)

    def temperature_C(self, voltage_V: float) -> float:
        """Temperature on the line, or its extension."""
        (cold, hot), (low, high) = self.range_C, self.range_V
        return cold + (hot - cold) * (voltage_V - low) / (high - low)


@dataclass(frozen=True, eq=False)
class HeaterRun:
    """Record of a run, sample by sample; arrays of one length, read-only.

    A sample is taken right after the controller has decided: its current holds until the next.

    Attributes:
        time_s: Times of the controller's steps, from 0.
        temperature_C: True temperature of the metal.
        melt_fraction: True share of the metal that is liquid.
        measured_C: Temperature of the segment as the controller understands its sensor; NaN at
            a fault.
        estimated_melt_fraction: The controller's estimate.
        current_A: Heater current.
        soft_setpoint: Whether the set-point is soft.
        integrator: Integrator of the PI law, in units of its output.
        heat_J: Heat given off by the coil since the start.
        stiffness: "soft", "rigid" or "changing", as the controller sees it.
        events: What the controller told.
    """

    time_s: Array
    temperature_C: Array
    melt_fraction: Array
    measured_C: Array
    estimated_melt_fraction: Array
    current_A: Array
    soft_setpoint: NDArray[np.bool_]
    integrator: Array
    heat_J: Array
    stiffness: NDArray[np.str_]
    events: tuple[Event, ...]

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


@dataclass(frozen=True)
class Stretch:
    """One set-point of a run, from the command to the next or to the end.

    Attributes:
        setpoint: The command.
        start_s: When it was given.
        end_s: When it ended.
        changed_s: From the command until the metal was all liquid or all solid; NaN if never.
        told_s: From the command until the controller said so; 0 if it had before, NaN if never.
        settled_s: From the command until the temperature stayed within `SETTLED_K` of the soft
            set-point; NaN if it did not, or for a rigid stretch.
        peak_C: Highest true temperature.
        heat_J: Heat of the coil.
    """

    setpoint: Stiffness
    start_s: float
    end_s: float
    changed_s: float
    told_s: float
    settled_s: float
    peak_C: float
    heat_J: float


def simulate_heater(
    plant: SegmentModel,
    sensor: TemperatureSensor,
    controller: StiffnessController,
    profile: Profile,
    duration_s: float,
    *,
    start_temperature_C: float | None = None,
    step_s: float = 0.1,
    seed: int = 0,
) -> HeaterRun:
    """Run the closed loop.

    Args:
        plant: The segment as it is.
        sensor: Its sensor as it is.
        controller: The controller, with the segment as it knows it.
        profile: (time [s], "soft" or "rigid"), times increasing from 0.
        duration_s: End of the run.
        start_temperature_C: Of segment and sensor; default: that of the air.
        step_s: Time between the controller's steps, at most 0.2 s.
        seed: Of the sensor's noise.

    Raises:
        InputError: On an empty profile, times that do not increase from 0, a step that is too
            long, more than a million steps, or a start outside the sensor's range.
    """
    check_profile(profile, duration_s)
    if not 0 < step_s <= LONGEST_STEP_S:
        raise InputError("step_s", step_s, f"more than 0, at most {LONGEST_STEP_S} s")
    if not duration_s <= MOST_STEPS * step_s:
        raise InputError("duration_s", duration_s, f"at most {MOST_STEPS * step_s:zg} s")
    start_C = plant.ambient_C if start_temperature_C is None else start_temperature_C
    coldest, hottest = sensor.assumed.range_C
    if not coldest <= start_C <= hottest:
        allowed = f"from {coldest:zg} to {hottest:zg} C, the sensor's range"
        raise InputError("start_temperature_C", start_C, allowed)
    steps = math.ceil(round(duration_s / step_s, 9))
    times = np.arange(steps + 1, dtype=np.float64) * np.float64(step_s)
    since, asked = zip(*profile, strict=True)
    setpoints = [asked[i] for i in np.searchsorted(since, times + 1e-9, side="right") - 1]
    rng = np.random.default_rng(seed)
    segment = HeatedSegment(plant, sensor, controller, start_C, rng, rigid_setpoint_C=-math.inf)
    rows, events = [_sample(segment)], list[Event]()
    for setpoint in setpoints[1:]:
        asked_C = controller.soft_setpoint_C if setpoint == "soft" else -math.inf
        segment.advance(asked_C, step_s)
        rows.append(_sample(segment))
        events.extend(segment.news)
    sampled = zip(_SAMPLED, zip(*rows, strict=True), strict=True)
    columns = {name: np.array(column) for name, column in sampled}
    soft = np.array(setpoints) == "soft"
    return HeaterRun(time_s=times, soft_setpoint=soft, events=tuple(events), **columns)


_SAMPLED = (
    *("temperature_C", "melt_fraction", "measured_C", "estimated_melt_fraction"),
    *("current_A", "integrator", "heat_J", "stiffness"),
)


def _sample(segment: HeatedSegment) -> tuple[object, ...]:
    """Values of a sample, in the order of `_SAMPLED`."""
    memory, estimated = segment.memory, segment.controller.melt_fraction(segment.memory)
    true = segment.temperature_C, segment.melt_fraction, segment.measured_C, estimated
    return *true, memory.current_A, memory.integrator, segment.heat_J, memory.stiffness


def save_run(run: HeaterRun, path: str | Path) -> None:
    """Write a run as CSV, a row a sample; ``event`` names what the controller told then.

    Raises:
        InputError: If the folder cannot be written.
    """
    told: dict[float, str] = {}
    for event in run.events:
        time = round(event.time_s, 6)
        told[time] = f"{told[time]} {event.kind}" if time in told else event.kind
    times = [round(time, 6) for time in run.time_s.tolist()]
    columns: dict[str, Sequence[object]] = {
        "time_s": times,
        "setpoint": ["soft" if soft else "rigid" for soft in run.soft_setpoint],
        **{name: getattr(run, name).tolist() for name in _SAMPLED},
        "event": [told.get(time, "") for time in times],
    }
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    write_text(path, text.getvalue())


def check_profile(profile: Profile, duration_s: float) -> None:
    """Refuse a profile that does not start at 0, or is not in order, or outlasts the run.

    Raises:
        InputError: Naming the entry.
    """
    if not profile or profile[0][0] != 0.0:
        first = profile[0][0] if profile else None
        raise InputError("profile.0", first, "a set-point at 0 s")
    for entry, ((here, _), (then, _)) in enumerate(pairwise((*profile, (duration_s, "")))):
        if not here < then < math.inf:
            raise InputError(f"profile.{entry + 1}", then, f"a time after {here:zg} s")


def stretches(run: HeaterRun, soft_setpoint_C: float) -> tuple[Stretch, ...]:
    """Sum up a run, set-point by set-point."""
    changes = (np.flatnonzero(np.diff(run.soft_setpoint)) + 1).tolist()
    ends = [0, *changes, len(run.time_s) - 1]
    return tuple(_stretch(run, low, high, soft_setpoint_C) for low, high in pairwise(ends))


def _stretch(run: HeaterRun, low: int, high: int, soft_setpoint_C: float) -> Stretch:
    """Sum up the samples from ``low`` to ``high``, which is the first of the next stretch."""
    inside = slice(low, high + 1)
    since = run.time_s[inside] - run.time_s[low]
    soft = bool(run.soft_setpoint[low])
    setpoint: Stiffness = "soft" if soft else "rigid"
    melted, off = run.melt_fraction[inside], run.temperature_C[inside] - soft_setpoint_C
    return Stretch(
        setpoint=setpoint,
        start_s=float(run.time_s[low]),
        end_s=float(run.time_s[high]),
        changed_s=_first(since, melted >= 1.0 if soft else melted <= 0.0),
        told_s=_first(since, run.stiffness[inside] == setpoint),
        settled_s=_for_good(since, np.abs(off) <= SETTLED_K) if soft else math.nan,
        peak_C=float(run.temperature_C[inside].max()),
        heat_J=float(run.heat_J[high] - run.heat_J[low]),
    )


def _first(since: Array, fulfilled: NDArray[np.bool_]) -> float:
    """First time at which something holds, NaN if there is none."""
    return float(since[fulfilled.argmax()]) if fulfilled.any() else math.nan


def _for_good(since: Array, fulfilled: NDArray[np.bool_]) -> float:
    """First time from which on something holds to the end, NaN if it does not at the end."""
    last = np.flatnonzero(~fulfilled)
    return _first(since, np.arange(len(since)) > (last[-1] if len(last) else -1))
