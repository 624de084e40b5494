r"""Stiffness controller of one segment: set-point soft or rigid in, heater current out.

With error e = 65 C - T of the measured temperature and time step T_s,

.. math:: u = \mathrm{sat}_{[0, u_{max}]}(K_p e + I), \qquad I \leftarrow
    \mathrm{sat}_{[0, I_{max}]}(I + K_i e T_s) \quad \text{unless u is saturated towards e}.

I_max is about what holding needs: on the melting plateau the error stays at 3 to 5 K for a minute,
and an integrator that winds up there drives the temperature past 85 C. u is the current, or, for a
segment described by its heating rate, the share of full power. The set-point rigid means no
current. `stiffness` says when the segment has become soft or rigid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from twosra_mpc.control.stiffness import Knowledge, KnownStiffness, StiffnessRule, stiffness_rule
from twosra_mpc.control.thermistor import temperature_sensor
from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Stiffness

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
