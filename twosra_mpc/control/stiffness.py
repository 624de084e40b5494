r"""Stiffness of a segment: observed, so that one knows when it *is* soft or rigid, and controlled.

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

The controller takes a set-point, soft or rigid, and gives a heater current. With error e = 65 C - T
of the measured temperature and time step T_s,

.. math:: u = \mathrm{sat}_{[0, u_{max}]}(K_p e + I), \qquad I \leftarrow
    \mathrm{sat}_{[0, I_{max}]}(I + K_i e T_s) \quad \text{unless u is saturated towards e}.

I_max is about what holding needs: on the melting plateau the error stays at 3 to 5 K for a minute,
and an integrator that winds up there drives the temperature past 85 C. u is the current, or, for a
segment described by its heating rate, the share of full power. The set-point rigid means no
current.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from twosra_mpc.control.thermistor import Lag, follow, temperature_sensor
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

CLEARLY_S = 2.0  # for which metal stays soft without heat that is soft clearly
RISEN_K, FALLEN_K = 0.7, 0.25  # of a reading that does not stand still as metal does that changes,
WITHIN_S = 20.0  # within which it does
_WARM_SHARE = 0.9  # of the way from the air to where a segment may begin to melt, as observed

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


def clearly(stays_liquid_s: float, solid: bool, moved_K: float) -> Stiffness | None:
    """Stiffness to whoever knows the metal; None: that is not clear yet.

    Args:
        stays_liquid_s: Time for which it stays liquid without heat.
        solid: True if it is solid.
        moved_K: Rise of its reading within `WITHIN_S`.
    """
    if stays_liquid_s >= CLEARLY_S and moved_K >= RISEN_K:
        return "soft"
    return "rigid" if solid and moved_K <= -FALLEN_K else None


def warm_setpoint_C(robot: Robot, air_C: float) -> float:
    """Temperature at which a segment is surely solid, even if its heater is a third stronger."""
    segments = range(robot.coordinates.segments)
    melts_from_C = min(stiffness_rule(robot, air_C, j).rigid_until_C for j in segments)
    return air_C + _WARM_SHARE * (melts_from_C - air_C)


Protection = Literal["none", "tripped", "fault"]

TRIP_HYSTERESIS_K = 5.0  # above the noise of sensors


@dataclass(frozen=True)
class ControllerGains:
    """Gains of the PI law; its output is a current [A] or a share of full power.

    Attributes:
        proportional_per_K: K_p, output per kelvin.
        integral_per_K_s: K_i, output per kelvin and second.
        integrator_max: I_max, output.
        drives: Whether the output is the current itself or a share of full power.
    """

    proportional_per_K: float
    integral_per_K_s: float
    integrator_max: float
    drives: Literal["current", "power"]


# Tuned on the two models with sensor lags of 2 to 8 s; tests/test_heater_loop.py holds the limits.
CURRENT_GAINS = ControllerGains(0.20, 0.004, 0.35, "current")
POWER_GAINS = ControllerGains(0.10, 0.003, 0.5, "power")


@dataclass(frozen=True)
class ControllerState:
    """State of the controller from one step to the next.

    Attributes:
        current_A: Heater current to apply until the next step.
        integrator: I, in units of the output.
        protection: "tripped" while too hot, "fault" while there is no sensor to trust.
        known: About the segment.
        recent_C: The last two temperatures.
        stuck_s: How long full current has not warmed the sensor.
        stuck_C: Temperature at the start of that time.
    """

    current_A: float
    integrator: float
    protection: Protection
    known: Knowledge
    recent_C: tuple[float, float]
    stuck_s: float
    stuck_C: float

    @property
    def stiffness(self) -> KnownStiffness:
        """Known stiffness of the segment."""
        return self.known.stiffness


@dataclass(frozen=True)
class StiffnessController:
    """Settings of the controller; its memory is a `ControllerState`.

    Start it with a reading, then call ``step`` at 5 Hz or faster and apply ``state.current_A``:

        state = controller.start(measured_C)
        state = controller.step(state, "soft", measured_C, dt_s)

    A fault (no reading, or full current that does not warm the sensor) switches the heater off
    until there is a good reading under the set-point rigid. A trip (too hot) passes by itself.

    Attributes:
        gains: Of the PI law.
        rule: For what the segment is.
        full_current_A: Largest current.
        ambient_C: Temperature of the air.
        sensor_gain: Share of the segment's excess over the air that the sensor shows.
        soft_setpoint_C: Where soft metal is held.
        trip_C: The heater trips at this.
        resume_C: And is on again below this.
        stuck_after_s: Full current that does not warm the sensor for so long is a fault.
        stuck_below_K: Less than this is not warming.
        plateau_K: So near to melting the sensor may show metal that melts, at one temperature.
    """

    gains: ControllerGains
    rule: StiffnessRule
    full_current_A: float
    ambient_C: float
    sensor_gain: float
    soft_setpoint_C: float
    trip_C: float
    resume_C: float
    stuck_after_s: float = 20.0
    stuck_below_K: float = 2.0
    plateau_K: float = 5.0

    def start(self, measured_C: float) -> ControllerState:
        """State for a segment that has rested, its heater off, at a measured temperature.

        Raises:
            InputError: If there is no reading.
        """
        if not math.isfinite(measured_C):
            raise InputError("measured_C", measured_C, "a reading: the sensor is at fault")
        here = self.segment_C(measured_C)
        known = self.rule.start(here)
        return ControllerState(0.0, 0.0, "none", known, (here, here), 0.0, here)

    def step(
        self, state: ControllerState, setpoint: Stiffness, measured_C: float, dt_s: float
    ) -> ControllerState:
        """Take one reading and decide on the current until the next.

        Args:
            state: State after the last step.
            setpoint: What the segment should be from now on.
            measured_C: The reading; NaN from a faulty sensor.
            dt_s: Time since the last step, during which its current was applied. Tested up to
                0.2 s.

        Returns:
            State with the new current.

        Raises:
            InputError: If ``dt_s`` is not positive.
        """
        if not 0 < dt_s < math.inf:
            raise InputError("dt_s", dt_s, "a positive time [s]")
        sound = math.isfinite(measured_C)
        if sound and state.protection != "fault":
            return self._regulate(state, setpoint, self.segment_C(measured_C), dt_s)
        if sound and setpoint == "rigid":
            fresh = self.start(measured_C)  # the sensor must show anew what the segment is
            return replace(fresh, known=replace(fresh.known, stiffness="changing"))
        return _faulty(state)

    def segment_C(self, measured_C: float) -> float:
        """Temperature of a segment that has long been at a reading."""
        return self.ambient_C + (measured_C - self.ambient_C) / self.sensor_gain

    def pi_law(self, integrator: float, temperature_C: float, dt_s: float) -> tuple[float, float]:
        """Output, and integrator for the next step."""
        error, gains = self.soft_setpoint_C - temperature_C, self.gains
        wanted = gains.proportional_per_K * error + integrator
        output = min(max(wanted, 0.0), self.output_max)
        if (wanted - output) * error <= 0:
            integrator += gains.integral_per_K_s * error * dt_s
        return output, min(max(integrator, 0.0), gains.integrator_max)

    def holding(self, soft_setpoint_C: float) -> StiffnessController:
        """Return the controller that holds soft metal at another temperature."""
        if soft_setpoint_C == self.soft_setpoint_C:
            return self
        return replace(self, soft_setpoint_C=soft_setpoint_C)

    @property
    def output_max(self) -> float:
        """Largest output of the PI law."""
        return self.full_current_A if self.gains.drives == "current" else 1.0

    def _current_A(self, output: float) -> float:
        """Current that an output stands for; heat goes with its square."""
        if self.gains.drives == "current":
            return output
        return self.full_current_A * math.sqrt(output)

    def _regulate(
        self, state: ControllerState, setpoint: Stiffness, raw_C: float, dt_s: float
    ) -> ControllerState:
        here_C = sorted((*state.recent_C, raw_C))[1]  # logs have single readings that are far off
        stuck_s, stuck_C = self._stuck(state, here_C, dt_s)
        if stuck_s > self.stuck_after_s:
            return _faulty(state)
        tripped = raw_C >= (self.resume_C if state.protection == "tripped" else self.trip_C)
        output, integrator = 0.0, 0.0
        if setpoint == "soft" and not tripped:
            output, integrator = self.pi_law(state.integrator, here_C, dt_s)
        return ControllerState(
            current_A=self._current_A(output),
            integrator=integrator,
            protection="tripped" if tripped else "none",
            known=self.rule.step(state.known, setpoint, here_C, state.current_A, dt_s),
            recent_C=(state.recent_C[1], raw_C),
            stuck_s=stuck_s,
            stuck_C=stuck_C,
        )

    def _stuck(self, state: ControllerState, here_C: float, dt_s: float) -> tuple[float, float]:
        """Time for which full current has not warmed the sensor, and the temperature since then."""
        solid = here_C < self.rule.solid_below_C - self.plateau_K
        heated = state.current_A == self.full_current_A and solid
        if heated and here_C < state.stuck_C + self.stuck_below_K:
            return state.stuck_s + dt_s, state.stuck_C
        return 0.0, here_C


def _faulty(state: ControllerState) -> ControllerState:
    """Fault: no current, and nothing known about the segment."""
    known = replace(state.known, stiffness="changing")
    return replace(state, current_A=0.0, integrator=0.0, protection="fault", known=known)


def stiffness_controller(robot: Robot, ambient_C: float, segment: int) -> StiffnessController:
    """Build the controller of a segment.

    Args:
        robot: The robot.
        ambient_C: Temperature of the air.
        segment: Which segment, from 0.

    Raises:
        InputError: If the robot file has no ``[segment]``.
    """
    heater, sensor = robot.heater, temperature_sensor(robot, ambient_C, segment)
    by_power = robot.thermal_segment(segment).heat_follows == "power"
    return StiffnessController(
        gains=POWER_GAINS if by_power else CURRENT_GAINS,
        rule=stiffness_rule(robot, ambient_C, segment),
        full_current_A=heater.melt_current_A,
        ambient_C=ambient_C,
        sensor_gain=sensor.gain,
        soft_setpoint_C=heater.soft_setpoint_C,
        trip_C=heater.temperature_max_C,
        resume_C=heater.temperature_max_C - TRIP_HYSTERESIS_K,
    )
