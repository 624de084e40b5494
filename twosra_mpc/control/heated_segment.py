"""Segment with its heater, thermistor and controller, and when its changes are confirmed.

A run takes a segment for soft or rigid when its controller says so by its sensor (`stiffness`), or,
as it knows the metal, too, when metal that is surely liquid, or solid, has left the plateau. So it
knows later than the metal changes. A melt is not begun before the robot is done with what it must
be rigid for, only warmed up; and metal is no hotter than it must be to stay soft for as long as it
shall bend, and surely so, so that it has a little heat to lose yet when that is done.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from twosra_mpc.control.stiffness import (
    WITHIN_S,
    KnownStiffness,
    StiffnessController,
    clearly,
    stiffness_controller,
    warm_setpoint_C,
)
from twosra_mpc.control.thermistor import TemperatureSensor, temperature_sensor
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.robot.segment import Heater
from twosra_mpc.thermal.model import SegmentModel, reference_times
from twosra_mpc.thermal.uncertainty import Windows

LONGEST_STEP_S = 0.2  # the controller must be called at least so often
_LONGEST_S = 3600.0  # of a change that is waited for
_COASTS_S = 7.0  # after a bend, until metal freezes: least of runs of the published problems


@dataclass(eq=False)
class HeatedSegment:
    """A segment as it is, its sensor as it is, and the controller with the robot as it knows it.

    Attributes:
        model: Its true thermal behaviour.
        sensor: Its true sensor.
        controller: Its controller.
        start_C: Temperature at which metal and sensor rest at first.
        noise: Draws of the standard normal distribution, for the sensor's noise.
        rigid_setpoint_C: Set-points up to this switch the heater off.
        broken_heater: Whether the heater's wire is broken: no current ever flows.
        memory: State of the controller.
    """

    model: SegmentModel
    sensor: TemperatureSensor
    controller: StiffnessController
    start_C: float
    noise: Callable[[], float]
    rigid_setpoint_C: float
    broken_heater: bool = False

    def __post_init__(self) -> None:
        self.state, self.heat_J = self.model.initial(self.start_C), 0.0
        self._lag = self.sensor.settled(self.start_C)
        self._reading_C = self.sensor.read_C(self._lag)
        self.memory = self.controller.start(self._reading_C)
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
        """Stiffness as the controller reports it."""
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
        error_C = self.sensor.noise_C * self.noise()
        self._reading_C = self.sensor.read_C(self._lag, error_C)
        wanted: Stiffness = "soft" if self._heats(setpoint_C) else "rigid"
        held_C = max(setpoint_C, self.controller.soft_setpoint_C)
        controller = self.controller.holding(held_C)
        self.memory = controller.step(self.memory, wanted, self._reading_C, dt_s)

    def _heats(self, setpoint_C: float) -> bool:
        """Melt, or keep warm by the observer's estimate: it does not lag as the sensor does."""
        if setpoint_C >= self.controller.soft_setpoint_C:
            return True
        if setpoint_C <= self.rigid_setpoint_C:
            return False
        observed = self.controller.rule.observer.model
        return observed.temperature_C(self.memory.known.estimate.state) < setpoint_C


def confirming_windows(robot: Robot, air_C: float, segment: int) -> Windows:
    """Windows of transitions as they are confirmed: when none may begin yet, and has been told.

    As those of `thermal.uncertainty`, relative to the times of the segment (from 0) as described.

    Raises:
        InputError: If the robot file has no ``[segment]``, or nothing would freeze in this air.
    """
    return _windows(
        segment_model(robot, air_C, segment),
        temperature_sensor(robot, air_C, segment),
        stiffness_controller(robot, air_C, segment),
        robot.heater,
        warm_setpoint_C(robot, air_C),
    )


@lru_cache(maxsize=16)  # segments that are alike share it
def _windows(
    model: SegmentModel,
    sensor: TemperatureSensor,
    controller: StiffnessController,
    heater: Heater,
    warm_C: float,
) -> Windows:
    """Windows of a segment exactly as described, or of the model if it never melts or freezes.

    It is driven through the rules: a melt, and the freeze after it.
    """
    full_A, cold = heater.melt_current_A, model.initial(model.ambient_C)
    lead_s, melts_s, _, freezes_s = reference_times(model, full_A, heater.soft_setpoint_C)
    off_C, air_C = heater.rigid_setpoint_C, model.ambient_C
    segment = HeatedSegment(model, sensor, controller, air_C, lambda: 0.0, off_C)
    shown = deque([segment.measured_C], maxlen=1 + round(WITHIN_S / LONGEST_STEP_S))

    def passed_s(setpoint_C: float, to: Stiffness) -> float:
        passed_s = 0.0
        while passed_s < _LONGEST_S:
            segment.advance(setpoint_C, LONGEST_STEP_S)
            passed_s += LONGEST_STEP_S
            shown.append(segment.measured_C)
            if _clearly(segment, shown[-1] - shown[0]) == to or segment.stiffness == to:
                break
        return passed_s

    melted_s = passed_s(heater.soft_setpoint_C, "soft")
    while _stays_s(segment) > _COASTS_S:
        segment.advance(off_C, LONGEST_STEP_S)
    frozen_s = passed_s(off_C, "rigid")
    hot = model.propagate(cold, full_A, melted_s)  # as a plan has it
    if model.level(hot) < model.level_at(heater.soft_setpoint_C):
        freezes_s = model.time_until(hot, 0.0, model.solid_level)
    warmed_s = model.time_until(cold, full_A, model.level_at(warm_C))
    return Windows(
        melt_early=min(1.0, warmed_s / lead_s),
        melt_late=max(1.0, melted_s / melts_s),
        freeze_early=0.0,
        freeze_late=max(1.0, frozen_s / freezes_s),
    )


def _clearly(segment: HeatedSegment, moved_K: float) -> Stiffness | None:
    """Stiffness of a segment to whoever knows its metal; None: that is not clear yet."""
    solid = segment.model.level(segment.state) <= segment.model.solid_level
    return clearly(_stays_s(segment), solid, moved_K)


def _stays_s(segment: HeatedSegment) -> float:
    """Time for which the metal stays liquid without heat."""
    liquid_level = segment.model.liquid_level
    if segment.model.level(segment.state) <= liquid_level:
        return 0.0
    return segment.model.time_until(segment.state, 0.0, liquid_level)
