"""One segment of a simulated robot with all that belongs to it: heater, thermistor, controller."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.control.stiffness_controller import Event, StiffnessController
from twosra_mpc.control.thermistor import TemperatureSensor
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.model import SegmentModel

LONGEST_STEP_S = 0.2  # the controller must be called at least so often


@dataclass(eq=False)
class HeatedSegment:
    """A segment as it is, its sensor as it is, and the controller with the robot as it knows it.

    Attributes:
        model: Its true thermal behaviour.
        sensor: Its true sensor.
        controller: Its controller.
        start_C: Temperature at which metal and sensor rest at first.
        rng: For the sensor's noise.
        rigid_setpoint_C: Set-points up to this switch the heater off.
        broken_heater: Whether the heater's wire is broken: no current ever flows.
        memory: State of the controller.
        news: Events that it told in its last step.
    """

    model: SegmentModel
    sensor: TemperatureSensor
    controller: StiffnessController
    start_C: float
    rng: np.random.Generator
    rigid_setpoint_C: float
    broken_heater: bool = False

    def __post_init__(self) -> None:
        self.state, self.heat_J = self.model.initial(self.start_C), 0.0
        self._lag = self.sensor.settled(self.start_C)
        self._reading_C = self.sensor.read_C(self._lag)
        self.memory, self.news = self.controller.start(self._reading_C), tuple[Event, ...]()
        self._let_A2_s, self._untold_s = 0.0, 0.0

    @property
    def soft(self) -> bool:
        """True if all the metal is in truth liquid."""
        return self.model.level(self.state) >= self.model.liquid_level

    @property
    def temperature_C(self) -> float:
        """True temperature of the metal."""
        return self.model.temperature_C(self.state)

    @property
    def melt_fraction(self) -> float:
        """True share of the metal that is liquid."""
        return self.model.melt_fraction(self.state)

    @property
    def current_A(self) -> float:
        """Current in the heater."""
        return 0.0 if self.broken_heater else self.memory.current_A

    def told_A(self) -> float:
        """Root mean square of the current its controller asked for since this was last told."""
        let_A2_s, untold_s = self._let_A2_s, self._untold_s
        self._let_A2_s = self._untold_s = 0.0
        return math.sqrt(let_A2_s / untold_s) if untold_s else self.memory.current_A

    @property
    def measured_C(self) -> float:
        """Temperature of the segment as its controller understands the sensor."""
        return self.controller.segment_C(self._reading_C)

    @property
    def stiffness(self) -> KnownStiffness:
        """What the controller reports."""
        return self.memory.stiffness

    @property
    def faulty(self) -> bool:
        """True if the controller reports a fault."""
        return self.memory.protection == "fault"

    def advance(self, setpoint_C: float, duration_s: float) -> None:
        """Let time pass under a set-point."""
        steps = max(1, math.ceil(duration_s / LONGEST_STEP_S - 1e-9))
        for _ in range(steps):
            self._step(setpoint_C, duration_s / steps)

    def _step(self, setpoint_C: float, dt_s: float) -> None:
        model, current = self.model, self.current_A
        self._let_A2_s += self.memory.current_A**2 * dt_s
        self._untold_s += dt_s
        if current > 0:
            self.heat_J += model.energy_J(self.state, current, dt_s)
        before, self.state = self.state, model.propagate(self.state, current, dt_s)
        here, then = model.temperature_C(before), model.temperature_C(self.state)
        self._lag = self.sensor.follow(self._lag, here, then, dt_s)
        error_C = self.sensor.noise_C * self.rng.standard_normal()
        self._reading_C = self.sensor.read_C(self._lag, error_C)
        wanted: Stiffness = "soft" if self._heats(setpoint_C) else "rigid"
        held_C = max(setpoint_C, self.controller.soft_setpoint_C)
        controller = self.controller.holding(held_C)
        self.memory, self.news = controller.step(self.memory, wanted, self._reading_C, dt_s)

    def _heats(self, setpoint_C: float) -> bool:
        """Melt, or keep warm by the observer's estimate: it does not lag as the sensor does."""
        if setpoint_C >= self.controller.soft_setpoint_C:
            return True
        if setpoint_C <= self.rigid_setpoint_C:
            return False
        observed = self.controller.rule.observer.model
        return observed.temperature_C(self.memory.known.estimate.state) < setpoint_C
