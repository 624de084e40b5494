"""Identify the two-node model of a robot's segments from a log of heating and cooling.

The sensor's gain cannot be told from such a log and is the robot's. The firmware's law while
heating is fitted with the segment, but belongs to the log, not to the robot file. See
`log_response` for what the model makes of a log, `heating_log` for what a log is.

How sure is it? Standard errors cover noise and what the model lacks while heating and cooling, not
errors of the core found in holds, nor when between two samples the heater was switched. The fits
that leave a cycle out show how much it matters which cycles were seen. Neither shows how logs
differ, so ranges are never narrower than `LOGS_DIFFER` on either side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twosra_mpc import InputError, Robot
from twosra_mpc.arguments import public
from twosra_mpc.lab.identification import log_fit
from twosra_mpc.lab.identification.heating_log import EvenLog, HeatingLog, resample
from twosra_mpc.lab.identification.log_fit import Bounded, Family, Residuals
from twosra_mpc.lab.identification.log_response import (
    HeaterLaw,
    Response,
    SensorLag,
    TwoNodePlant,
    respond,
)
from twosra_mpc.robot.segment import TwoNodeSegment
from twosra_mpc.thermal.two_node import TwoNode
from twosra_mpc.thermal.uncertainty import NORMAL_95

OnProgress = Callable[[int, int], None]

# Ranges are at least this wide on either side: fits to two logs of one segment, from one day, and
# to parts of them spread from 0.0030 to 0.0038 1/s in loss, and from 2.6 to 3.2 s in lag.
LOGS_DIFFER = 0.3

_SIGNIFICANT = 5  # digits of what goes into a robot file

_LAW = (Bounded(0.04, 1e-4, 2.0), Bounded(0.4, -5.0, 5.0, positive=False))
SEGMENT_PARAMETERS = {
    "power_K_per_s": Bounded(1.4, 0.05, 50.0),
    "coupling_per_s": Bounded(0.018, 1e-4, 1.0),
    "body_ratio": Bounded(3.5, 0.05, 100.0),
    "body_loss_per_s": Bounded(0.0035, 1e-5, 0.1),
    "sensor_lag_s": Bounded(3.0, 0.2, 30.0),
}
_TWO_NODES = (*SEGMENT_PARAMETERS.values(), *_LAW)
# Further fields of a ``TwoNode``: full current is 1 A, the air has 0 C, and the rest is not asked.
UNIT = (1.0, 1.0, 0.0, 1.0, 0.0)


class Parameters(NamedTuple):
    """Identified parameters: the first five as in ``TwoNodeSegment``, then the firmware's law.

    Attributes:
        power_K_per_s: Full heater power per heat capacity of the core.
        coupling_per_s: Conductance from core to body per heat capacity of the core.
        body_ratio: Heat capacity of the body over that of the core.
        body_loss_per_s: Conductance from body to air per heat capacity of the body.
        sensor_lag_s: Each of the sensor's two lags.
        law_gain_per_K: Duty per K of raw reading while heating.
        law_duty_at_54C: Duty at a raw reading of 54 C while heating.
    """

    power_K_per_s: float
    coupling_per_s: float
    body_ratio: float
    body_loss_per_s: float
    sensor_lag_s: float
    law_gain_per_K: float
    law_duty_at_54C: float

    @property
    def law(self) -> HeaterLaw:
        """The firmware's law."""
        return HeaterLaw(self.law_gain_per_K, self.law_duty_at_54C)


SEGMENT_FIELDS = tuple(SEGMENT_PARAMETERS)


class HeldOut(NamedTuple):
    """A fit to all cycles but one.

    Attributes:
        cycle: The cycle left out, from 0.
        parameters: What the others say.
        residuals: Of the cycle left out.
    """

    cycle: int
    parameters: Parameters
    residuals: Residuals


class Score(NamedTuple):
    """Misfit of a given segment to a log.

    Attributes:
        residuals: On the log.
        law: The firmware's law that was used.
    """

    residuals: Residuals
    law: HeaterLaw


@public
@dataclass(frozen=True)
class ThermalFit:
    """Fit of a robot's segments to a log.

    Attributes:
        source: Name of the log.
        robot: Name of the robot.
        segment: Its segment with the identified parameters, and ranges from the 5 % to the 95 %
            value, widened to hold every fit that leaves a cycle out, and what logs differ by.
        parameters: Best fit to all cycles.
        standard_errors: Of these, allowing for correlated residuals; infinite if unknown.
        smallest: Over the fits that leave a cycle out; those of the fit without any.
        largest: The same.
        residuals: Of the best fit.
        own_residuals: Of the robot's segment as it is, with the firmware's law fitted.
        held_out: Cross-validation by cycles; empty if the log has too few.
        log: The log as it was fitted.
        response: What the fitted model makes of it.
    """

    source: str
    robot: str
    segment: TwoNodeSegment
    parameters: Parameters
    standard_errors: Parameters
    smallest: Parameters
    largest: Parameters
    residuals: Residuals
    own_residuals: Residuals
    held_out: tuple[HeldOut, ...]
    log: EvenLog
    response: Response

    @property
    def held_out_rms_C(self) -> float:
        """Root mean square over all cycles, each left out of the fit in turn; NaN if not known."""
        return log_fit.pooled_rms_C([part.residuals for part in self.held_out])

    @property
    def fitted(self) -> tuple[str, ...]:
        """Fields of the segment that were fitted."""
        return SEGMENT_FIELDS

    @property
    def summary(self) -> str:
        """Source of the fit, for the robot file."""
        log, rms = Path(self.source).name, self.residuals.rms_C
        return f"{log}: residual {rms:z.2g} C (RMS) at the sensor"


@public
def identify(
    log: HeatingLog,
    robot: Robot,
    on_progress: OnProgress = lambda done, of: None,
    segment: int = 0,
) -> ThermalFit:
    """Fit the two-node model to a log, and cross-validate it.

    Args:
        log: The log.
        robot: Whose segment it is; its sensor gain counts.
        on_progress: Called with the number of fits done and to do.
        segment: Which segment of the robot it is, from 0.

    Raises:
        InputError: If the segment is not described by two nodes, or the log or what is fitted to
            it is not plausible (see `log_fit`).
    """
    own = two_node_segment(robot, segment)
    even = _plausible(log)
    family, cycles = two_nodes(own.sensor_gain), _separable_cycles(even)
    best = log_fit.fit(family, even)
    on_progress(1, 1 + len(cycles))
    response = family.respond(best.values, even)
    off = log_fit.residuals(even, response)
    searched = dict(zip(Parameters._fields, _TWO_NODES, strict=True))
    log_fit.check_fit(searched, best, off, log.source)
    held_out = []
    for number, cycle in enumerate(cycles, start=2):
        here = even.cycle == cycle
        part = Parameters(*log_fit.fit(family, even.scoring(~here), best.values).values)
        on_progress(number, 1 + len(cycles))
        unseen = log_fit.residuals(even.scoring(here), family.respond(part, even))
        held_out.append(HeldOut(cycle, part, unseen))
    found, errors = Parameters(*best.values), Parameters(*best.standard_errors)
    each = [found, *(part.parameters for part in held_out)]
    smallest, largest = (Parameters(*map(pick, zip(*each, strict=True))) for pick in (min, max))
    by_name = (of._asdict() for of in (errors, smallest, largest))
    fitted = {name: getattr(found, name) for name in SEGMENT_FIELDS}
    return ThermalFit(
        source=log.source,
        robot=robot.name,
        segment=described(own, fitted, *by_name),
        parameters=found,
        standard_errors=errors,
        smallest=smallest,
        largest=largest,
        residuals=off,
        own_residuals=score(log, own).residuals,
        held_out=tuple(held_out),
        log=even,
        response=response,
    )


def score(log: HeatingLog, segment: TwoNodeSegment, law: HeaterLaw | None = None) -> Score:
    """Score a segment's parameters on a log, without changing them.

    Args:
        log: The log.
        segment: The parameters.
        law: The firmware's law while heating, e.g. of a fit to another log; without it, its two
            parameters alone are fitted to this log, since no robot file has them.
    """
    even = _plausible(log)
    fixed = tuple(getattr(segment, name) for name in SEGMENT_FIELDS)
    whole = two_nodes(segment.sensor_gain)
    if law is None:
        part = Family(_LAW, lambda values, log: whole.respond((*fixed, *values), log))
        law = HeaterLaw(*log_fit.fit(part, even).values)
    return Score(log_fit.residuals(even, whole.respond((*fixed, *law), even)), law)


def _plausible(log: HeatingLog) -> EvenLog:
    """Log on an even grid, if it can be one of a segment at all."""
    log_fit.check_log(log)
    even = resample(log)
    log_fit.check_scored(even, log.source)
    return even


def two_node_segment(robot: Robot, segment: int = 0) -> TwoNodeSegment:
    """Segment (from 0) of a robot that is described by two nodes.

    Raises:
        InputError: If there is none, or it is described otherwise, or not at all.
    """
    if not 0 <= segment < (count := robot.geometry.segments):
        raise InputError("segment", segment + 1, f"1 to {count}, those of {robot.name}")
    own = robot.thermal_segment(segment) if robot.describes_heat else None
    if not isinstance(own, TwoNodeSegment):
        given = own.model if own else "missing"
        raise InputError("segment.model", given, "two_node, the model that is fitted", robot.name)
    return own


def two_nodes(sensor_gain: float) -> Family:
    """Two nodes behind a sensor of this gain, with the fields of `Parameters`."""

    def answer(values: Sequence[float], log: EvenLog) -> Response:
        found = Parameters(*values)
        plant = TwoNodePlant(TwoNode(*found[:4], *UNIT), log.step_s)
        lag = max(found.sensor_lag_s, 1e-3)  # a robot file may have none
        return respond(log, plant, SensorLag(sensor_gain, lag, log.step_s), found.law)

    return Family(_TWO_NODES, answer, ({0: 2.0, 1: 2.0}, {0: 0.5, 1: 0.5}))


def _separable_cycles(log: EvenLog) -> list[int]:
    """Cycles that can be left out: the others both heat and cool."""
    heated = set(log.cycle[log.scored & log.heating].tolist())
    cooled = set(log.cycle[log.scored & ~log.heating].tolist())
    return [k for k in sorted(heated | cooled) if heated - {k} and cooled - {k}]


def described(
    own: TwoNodeSegment,
    found: Mapping[str, float],
    errors: Mapping[str, float],
    low: Mapping[str, float],
    high: Mapping[str, float],
) -> TwoNodeSegment:
    """The robot's segment with what was found, rounded as a file has it, and its ranges.

    Args:
        own: The robot's segment.
        found: Values of some of its parameters.
        errors: Their standard errors.
        low: Smallest over fits that leave a part out.
        high: Largest.
    """
    ranges: dict[str, tuple[float, float]] = dict(own.ranges)
    for name, value in found.items():
        spread = max(NORMAL_95 * errors[name], LOGS_DIFFER * value)
        spread = min(spread, 0.9 * value)  # of what the log does not tell
        ends = min(low[name], value - spread), max(high[name], value + spread)
        ranges[name] = (_rounded(ends[0]), _rounded(ends[1]))
    values = {name: _rounded(value) for name, value in found.items()}
    return own.with_values(**values, ranges=ranges)


def _rounded(value: float) -> float:
    return float(np.format_float_scientific(value, _SIGNIFICANT - 1))
