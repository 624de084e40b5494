"""Observer of the stiffness: when a segment *is* soft, and when it *is* rigid.

Soft: under the set-point soft, the sensor has risen clearly above the melting point. Rigid: after
the heater has been off for several of the sensor's lags, it has fallen clearly below. Waiting for
the rigid set-point of 25 C instead would never end, because that is about the air. In between the
segment is changing: neither to be bent nor to be relied on.

The other way round the sensor would tell too late, so the estimate of an observer ends both states,
and ends them early: before the first metal melts, and before the first metal freezes.

On the melting plateau the temperature says nothing about the melt fraction, so the observer
propagates a model of the segment with the heater's known current, and a model of its sensor with
it. Two corrections keep it honest. Where heat warms the metal, the gap between real and predicted
reading pulls the temperature. And metal with a plateau is all liquid only if a reading clearly
above it says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from twosra_mpc.control.thermistor import Lag, follow
from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.model import SegmentModel, State, thresholds_C

KnownStiffness = Stiffness | Literal["changing"]
"""What is known of a segment: "soft", "rigid", or "changing": not to be bent, nor relied on."""

# Distances from the melting point. It is uncertain by 1 K; a thermistor with parts of 1 % by 1 K.
CLEARLY_LIQUID_K = 2.2
CLEARLY_SOLID_K = 2.5
SURELY_LIQUID_K = 1.0  # of the estimate: the melting point may be higher
SURELY_SOLID_K = 8.0  # of the estimate: coils heat up to a third faster than the observer knows

CLEARLY_S = 12.0  # for which metal surely stays soft without heat that is soft clearly
MOVED_K, WITHIN_S = 1.0, 20.0  # of a reading that does not stand still as metal does that changes
_WARM_SHARE = 0.7  # of the way from the air to where a segment may begin to melt, as observed

_CORRECTION_PER_S = 0.05  # a tenth of where it turns unstable, with lags of 4 s and 4 s


class Estimate(NamedTuple):
    """State of the segment's model, and of its sensor's two lags [C]."""

    state: State
    lag: Lag


@dataclass(frozen=True)
class MeltObserver:
    """Estimates the state of a segment.

    Attributes:
        model: The segment.
        lags_s: Time constants of its sensor.
        about_plateau_C: Readings from the one to the other do not tell solid from liquid metal;
            None for a segment whose temperature always tells.
    """

    model: SegmentModel
    lags_s: tuple[float, float]
    about_plateau_C: tuple[float, float] | None

    def start(self, measured_C: float) -> Estimate:
        """Estimate of a segment that has rested at this temperature; half molten on a plateau."""
        state = self.model.initial(measured_C)
        if self.about_plateau_C is not None:
            low, high = self.about_plateau_C
            if low <= measured_C <= high:
                middle = (self.model.solid_level + self.model.liquid_level) / 2
                state = self.model.at_level(state, middle)
        return Estimate(state, (measured_C, measured_C))

    def step(self, before: Estimate, current_A: float, measured_C: float, dt_s: float) -> Estimate:
        """Propagate segment and sensor, and pull the segment towards the reading."""
        model = self.model
        state = model.propagate(before.state, current_A, dt_s)
        here_C, there_C = model.temperature_C(before.state), model.temperature_C(state)
        lag = follow(before.lag, self.lags_s, here_C, there_C, dt_s)
        state = model.warmed(state, _CORRECTION_PER_S * dt_s * (measured_C - lag[1]))
        if self.about_plateau_C is not None and measured_C <= self.about_plateau_C[1]:
            state = self._at_most(state, model.liquid_level)
        return Estimate(state, lag)

    def found(self, stiffness: Stiffness, estimate: Estimate) -> Estimate:
        """Estimate once the segment is known to be all liquid, or all solid."""
        state, liquid_level = estimate.state, self.model.liquid_level
        if stiffness == "rigid":
            state = self._at_most(state, self.model.solid_level)
        elif self.model.level(state) < liquid_level:
            state = self.model.at_level(state, liquid_level)
        return Estimate(state, estimate.lag)

    def _at_most(self, state: State, level: float) -> State:
        return state if self.model.level(state) <= level else self.model.at_level(state, level)


@dataclass(frozen=True)
class Knowledge:
    """Knowledge about a segment from one step to the next.

    Attributes:
        stiffness: What the segment is.
        estimate: Of the melt observer.
        lowest_C: Lowest temperature since the set-point became soft, pauses left out.
        off_s: How long there has been no current.
        evident_s: For how long the sensor has shown the segment as the set-point wants it.
    """

    stiffness: KnownStiffness
    estimate: Estimate
    lowest_C: float
    off_s: float = 0.0
    evident_s: float = 0.0


@dataclass(frozen=True)
class StiffnessRule:
    """Decides what a segment is, from its sensor and the heater's current.

    Attributes:
        observer: Of the melt fraction.
        liquid_above_C: A reading above this is that of liquid metal,
        solid_below_C: and one below this that of solid metal, if the sensor has caught up.
        soft_until_C: With the set-point rigid, the segment stays soft down to this estimate;
        rigid_until_C: with the set-point soft, it stays rigid up to this estimate.
        confirmed_s: How long the sensor must show a new stiffness.
        risen_K: A rise by this much is not that of a lagging sensor on a segment that cools.
        caught_up_s: Time after which the sensor shows the segment's temperature: for solid, with
            the heater off; for liquid, if the reading has not risen.
    """

    observer: MeltObserver
    liquid_above_C: float
    solid_below_C: float
    soft_until_C: float
    rigid_until_C: float
    confirmed_s: float = 1.0
    risen_K: float = 0.5
    caught_up_s: float = 30.0

    def start(self, measured_C: float) -> Knowledge:
        """Knowledge about a segment that has rested, its heater off, at this temperature."""
        stiffness: KnownStiffness = "changing"
        if measured_C < self.solid_below_C:
            stiffness = "rigid"
        elif measured_C > self.liquid_above_C:
            stiffness = "soft"
        return Knowledge(stiffness, self.observer.start(measured_C), measured_C)

    def step(
        self,
        known: Knowledge,
        setpoint: Stiffness,
        measured_C: float,
        current_A: float,
        dt_s: float,
    ) -> Knowledge:
        """Take in one reading.

        Args:
            known: Knowledge before.
            setpoint: What the segment should be.
            measured_C: Temperature of the segment by its sensor.
            current_A: Heater current since the last step.
            dt_s: Time since the last step.
        """
        off_s = 0.0 if current_A > 0 else known.off_s + dt_s
        if setpoint == "soft":
            lowest_C = min(measured_C, known.lowest_C)
            evident = measured_C > self.liquid_above_C
            prompt = measured_C > lowest_C + self.risen_K
        else:
            melts = known.stiffness == "changing" and known.lowest_C < self.solid_below_C
            paused = melts and off_s < self.caught_up_s
            lowest_C = min(measured_C, known.lowest_C) if paused else measured_C
            prompt = True
            evident = measured_C < self.solid_below_C and off_s >= self.caught_up_s
        evident_s = known.evident_s + dt_s if evident else 0.0
        estimate = self.observer.step(known.estimate, current_A, measured_C, dt_s)
        if evident_s >= (self.confirmed_s if prompt else self.caught_up_s):
            found = self.observer.found(setpoint, estimate)
            return Knowledge(setpoint, found, lowest_C, off_s, evident_s)
        stiffness = self._still(known.stiffness, setpoint, estimate)
        return Knowledge(stiffness, estimate, lowest_C, off_s, evident_s)

    def _still(
        self, before: KnownStiffness, setpoint: Stiffness, estimate: Estimate
    ) -> KnownStiffness:
        """Stiffness without news from the sensor."""
        model = self.observer.model
        level, here_C = model.level(estimate.state), model.temperature_C(estimate.state)
        if before == "soft":
            cool = setpoint == "rigid" and here_C < self.soft_until_C
            return "changing" if cool or level < model.liquid_level else "soft"
        if before == "rigid":
            warm = setpoint == "soft" and here_C > self.rigid_until_C
            return "changing" if warm or level > model.solid_level else "rigid"
        return "changing"


def stiffness_rule(robot: Robot, ambient_C: float, segment: int) -> StiffnessRule:
    """Build the rule for a segment (from 0): about its melting plateau, or between its thresholds.

    Thresholds are of readings, which lag; when a plan counts on liquid metal, the sensor shows it.

    Raises:
        InputError: If the robot file has no ``[segment]``, or nothing would freeze in this air.
    """
    model = segment_model(robot, ambient_C, segment)
    described = robot.thermal_segment(segment)
    _, lags_s = described.sensor_gain_and_lags_s
    solid_C, liquid_C = thresholds_C(model)
    if solid_C == liquid_C:  # a plateau: its temperature is known only so well, and tells nothing
        about_C = (solid_C - CLEARLY_LIQUID_K, solid_C + CLEARLY_LIQUID_K)
        rule = StiffnessRule(
            observer=MeltObserver(model, lags_s, about_C),
            liquid_above_C=solid_C + CLEARLY_LIQUID_K,
            solid_below_C=solid_C - CLEARLY_SOLID_K,
            soft_until_C=solid_C + SURELY_LIQUID_K,
            rigid_until_C=solid_C - SURELY_SOLID_K,
        )
    else:
        solid_C, read_C = described.thresholds_C or (solid_C, liquid_C)
        observer = MeltObserver(replace(model, liquid_level=model.level_at(read_C)), lags_s, None)
        rule = StiffnessRule(observer, read_C, solid_C, liquid_C, solid_C)
    if not ambient_C < rule.solid_below_C:
        allowed = f"less than {rule.solid_below_C:zg} C, below which the segment is rigid"
        raise InputError("ambient_C", ambient_C, allowed)
    return rule


def clearly_soft(stays_liquid_s: float, moved_K: float) -> bool:
    """True of metal that is liquid for as long without heat, if its reading moved by so much."""
    return stays_liquid_s >= CLEARLY_S and moved_K >= MOVED_K


def clearly_rigid(solid: bool, moved_K: float) -> bool:
    """True of metal that is solid for sure, or not, if its reading moved by so much."""
    return solid and moved_K <= -MOVED_K


def warm_setpoint_C(robot: Robot, air_C: float) -> float:
    """Temperature at which a segment is surely solid, even if its heater is a third stronger."""
    segments = range(robot.coordinates.segments)
    melts_from_C = min(stiffness_rule(robot, air_C, j).rigid_until_C for j in segments)
    return air_C + _WARM_SHARE * (melts_from_C - air_C)
