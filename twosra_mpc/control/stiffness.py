"""When a segment *is* soft, and when it *is* rigid.

Soft: under the set-point soft, the sensor has risen clearly above the melting point. Rigid: after
the heater has been off for several of the sensor's lags, it has fallen clearly below. Waiting for
the rigid set-point of 25 C instead would never end, because that is about the air. In between the
segment is changing: neither to be bent nor to be relied on.

The other way round the sensor would tell too late, so the estimate of the observer ends both
states, and ends them early: before the first metal melts, and before the first metal freezes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from twosra_mpc.control.observer import Estimate, MeltObserver
from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.model import thresholds_C

KnownStiffness = Stiffness | Literal["changing"]

# Distances from the melting point. It is uncertain by 1 K; a thermistor with parts of 1 % by 1 K.
CLEARLY_LIQUID_K = 2.2
CLEARLY_SOLID_K = 2.5
SURELY_LIQUID_K = 1.0  # of the estimate: the melting point may be higher
SURELY_SOLID_K = 8.0  # of the estimate: coils heat up to a third faster than the observer knows


@dataclass(frozen=True)
class Knowledge:
    """What is known about a segment from one step to the next.

    Attributes:
        stiffness: What the segment is.
        estimate: Of the melt observer.
        lowest_C: Lowest temperature since the set-point became soft.
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
            lowest_C, prompt = measured_C, True
            evident = measured_C < self.solid_below_C and off_s >= self.caught_up_s
        evident_s = known.evident_s + dt_s if evident else 0.0
        estimate = self.observer.predict(known.estimate, current_A, dt_s)
        estimate = self.observer.correct(estimate, measured_C, dt_s)
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

    Raises:
        InputError: If the robot file has no ``[segment]``, or nothing would freeze in this air.
    """
    model = segment_model(robot, ambient_C, segment)
    _, lags_s = robot.thermal_segment(segment).sensor_gain_and_lags_s
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
        observer = MeltObserver(model, lags_s, None)
        rule = StiffnessRule(observer, liquid_C, solid_C, liquid_C, solid_C)
    if not ambient_C < rule.solid_below_C:
        allowed = f"less than {rule.solid_below_C:g} C, below which the segment is rigid"
        raise InputError("ambient_C", ambient_C, allowed)
    return rule
