"""A robot that shares nothing with this package but `RobotInterface`: for trying faults on.

It has arcs, heat and firmware of its own, a clock that goes on while somebody plans, and at most
one fault. What it is asked and what it does is written down for whoever judges a run.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import Problem, plan
from twosra_mpc.execution import Camera, Reading
from twosra_mpc.plans.result import Result
from twosra_mpc.robot.description import Robot

Array = NDArray[np.float64]

TICK_S = 1 / 15
PLANNING_S = 3.0  # that the clock goes on for while somebody plans
STUCK_C = 66.0  # what a thermistor that is stuck high shows
_CAMERA = Camera(rate_Hz=15.0, noise=(1e-3, 0.02, 1.0))
_MELTING_C, _SOFT_C, _RIGID_C = 61.0, 63.5, 58.5
_CURRENT_A, _RESISTANCE_OHM, _LOSS_W_PER_K, _HEAT_J_PER_K, _LATENT_J = 0.8, 6.6, 0.017, 3.3, 148.0
_LAG_S, _CAUGHT_UP_S, _HELD_C = 5.0, 30.0, 65.0
_WILD = 0.01  # of the frames
_NOISE_C, _DRIFT_K_S, _SCALE = 0.02, (0.1, 0.6), (0.1, 0.4)  # of thermistors, and of those that lie
_OUTAGE_S, _MATTERS_K = 30.0, 5.0
_SIZE = 5

# What a sensor that lies may be taken for.
_LIES = ("sensor failed", "heater failed", "heater stuck on", "too hot", "cools too slowly")

# Fault: how a run may end because of it, besides truly at the goal; an exception by its name.
FAULTS: dict[str, tuple[str, ...]] = {
    "none": (),
    "dead camera": ("camera lost", "arrived unseen"),
    "stale camera": ("camera lost", "arrived unseen"),
    "frozen camera": ("does not move", "camera lost"),
    "NaN frames": (),
    "wild frames": (),
    "thermistor -127": ("sensor failed",),
    "thermistor NaN": ("sensor failed",),
    "thermistor garbage": ("sensor failed",),
    "thermistor rare": ("sensor failed",),
    "thermistor high": ("sensor failed",),
    "thermistor stuck": ("sensor failed", "heater failed"),
    "thermistor drifts": _LIES,
    "thermistor scaled": _LIES,
    "thermistors swapped": _LIES,
    "outage": (),
    "dead heater": ("heater failed",),
    "welded relay": ("heater stuck on", "too hot"),
    "slow cooling": ("cools too slowly",),
    "runaway": ("too hot",),
    "read raises": ("BrokenError",),
    "send raises": ("BrokenError",),
    "interrupt": ("KeyboardInterrupt",),
    "planner raises": ("BrokenError",),
}
_OF_HEATERS = ("dead heater", "welded relay", "slow cooling", "runaway")
_OF_ONE = ("thermistor stuck", "thermistor drifts", "thermistor scaled")


class BrokenError(Exception):
    """What a robot's own driver may raise: nothing this package knows."""


class Segment:
    """Metal of one enthalpy, a thermistor that lags, and the firmware's opinion."""

    def __init__(self, air_C: float, strength: float, rng: np.random.Generator) -> None:
        """Begin as cold as the air, with a heater of this strength."""
        self._rng, self.other, self.held_C, self.ails_s = rng, self, math.nan, 0.0
        self._drift_K_s = float(rng.choice([-1, 1]) * rng.uniform(*_DRIFT_K_S))
        self._scale = 1.0 + float(rng.choice([-1, 1]) * rng.uniform(*_SCALE))
        self.noise_C = 0.0
        self.air_C, self.strength, self.enthalpy_J = air_C, strength, 0.0
        self.enthalpy_J = (air_C - _MELTING_C) * _HEAT_J_PER_K
        self.read_C, self.off_s, self.told, self.on, self.was_on = (
            air_C,
            math.inf,
            "rigid",
            0,
            False,
        )
        self.fault, self.wrong = "", False

    @property
    def metal_C(self) -> float:
        """Of the metal."""
        return _MELTING_C + (min(self.enthalpy_J, 0) + max(self.enthalpy_J - _LATENT_J, 0)) / 3.3

    @property
    def soft(self) -> bool:
        """Whether all of it is liquid."""
        return self.enthalpy_J >= _LATENT_J

    def advance(self, asked: bool, dt_s: float) -> None:
        """Let time pass, asked to be soft or not."""
        self.was_on |= asked
        wanted = asked and self.shown_C < _HELD_C
        self.on = int(wanted or (asked and self.fault == "runaway"))
        if self.fault == "dead heater":
            self.on = 0
        if self.fault == "welded relay" and self.was_on:
            self.on = 1
        self.off_s = 0.0 if asked else self.off_s + dt_s
        lost = _LOSS_W_PER_K * (self.metal_C - self.air_C)
        if self.fault == "slow cooling" and self.was_on and not self.on:
            lost /= 8
            self.wrong = True
        self.wrong |= self.on != wanted
        gained = self.strength * self.on * _CURRENT_A**2 * _RESISTANCE_OHM
        self.enthalpy_J += (gained - lost) * dt_s
        self.read_C += (self.metal_C - self.read_C) * -math.expm1(-dt_s / _LAG_S)
        self.noise_C = _NOISE_C * float(self._rng.standard_normal())
        self.ails_s = self.ails_s + dt_s if self.fault else 0.0
        if not self.fault:
            self.held_C = self.read_C + self.noise_C
        self._judge(asked)

    @property
    def shown_C(self) -> float:
        """What the firmware makes of the thermistor."""
        match self.fault:
            case "thermistor high" if self.was_on:
                return STUCK_C
            case "thermistor stuck":
                return self.held_C
            case "thermistors swapped":
                return self.other.read_C + self.noise_C
            case "thermistor drifts":
                return self.read_C + self.noise_C + self._drift_K_s * self.ails_s
            case "thermistor scaled":
                return self.air_C + self._scale * (self.read_C + self.noise_C - self.air_C)
        return self.read_C + self.noise_C

    def _judge(self, asked: bool) -> None:
        here_C = self.shown_C
        if asked:
            evident = here_C > _SOFT_C
            self.told = "soft" if evident else self.told
            if self.told == "rigid" and here_C > _MELTING_C - 8:
                self.told = "changing"
        elif here_C < _RIGID_C and self.off_s > _CAUGHT_UP_S:
            self.told = "rigid"
        elif self.told == "soft" and here_C < _MELTING_C + 1:
            self.told = "changing"


class ForeignRobot:
    """The robot; ``fault`` is one of `FAULTS`, or none, and begins at ``fault_s``.

    Attributes:
        q: Where it truly is, (5,).
        forced_m: How far it drove while solid metal was reported as soft.
        blind_m: How far it drove while its camera was dead.
        planning_m: How far it drove while somebody planned.
        mattered_s: Since when a thermistor is off by `_MATTERS_K`, a heater does what it should
            not, or wheels turn with another fault; NaN before.
        hottest_C: Of its metal.
    """

    def __init__(
        self, problem: Problem, seed: int = 0, fault: str = "", fault_s: float = 0
    ) -> None:
        """Stand where the problem starts; all that is drawn is from the seed."""
        self.problem, self.fault, self.fault_s = problem, fault, fault_s
        rng = self._rng = np.random.default_rng([seed, 17])
        self.q = problem.start.configuration.copy()
        self.time_s, self._read, self._frames = 0.0, 0, list[tuple[float, Array]]()
        air_C = problem.ambient
        lies = np.random.default_rng([seed, 18])
        self.segments = [Segment(air_C, float(rng.uniform(0.85, 1.2)), lies) for _ in range(2)]
        self.segments[0].other, self.segments[1].other = self.segments[1], self.segments[0]
        self._lying, self._silent_s = int(lies.integers(2)), math.nan
        self._grip = rng.uniform(0.85, 0.95, 4)
        self.wheels, self.setpoint_C = np.zeros(4), np.full(2, 25.0)
        self.forced_m, self.hottest_C, self.blind_m, self.planning_m = 0.0, 0.0, 0.0, 0.0
        self._thought: tuple[Result, float, Array] | None = None
        self._last: tuple[float, Array] = (0.0, self.q)
        self.mattered_s = math.nan
        self._photograph()

    @property
    def robot(self) -> Robot:
        """As described."""
        return self.problem.robot

    @property
    def camera(self) -> Camera:
        """As described."""
        return _CAMERA

    @property
    def ails(self) -> bool:
        """Whether its fault has begun."""
        return bool(self.fault) and self.time_s >= self.fault_s

    def read(self) -> Reading:
        """Return what is known."""
        if self.ails and self.fault == "read raises":
            raise BrokenError("no answer")
        frames, self._frames = self._frames, []
        if self._silent:
            unknown, never = (math.nan, math.nan), (None, None)
            none = np.empty(0), np.empty((0, _SIZE))
            return Reading(self.time_s, *none, unknown, never, (False, False))
        told = [segment.told for segment in self.segments]
        shown_C = [self._shown_C(j) for j in range(2)]
        return Reading(
            self.time_s,
            np.array([time_s for time_s, _ in frames]),
            np.array([frame for _, frame in frames]).reshape(-1, _SIZE),
            tuple(shown_C),
            tuple(told),  # type: ignore[arg-type]
            (False, False),
        )

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        """Take a command."""
        if self.fault == "send raises" and self.ails and wheel_rad_s.any():
            raise BrokenError("the bus is off")
        self.wheels, self.setpoint_C = wheel_rad_s.copy(), heater_setpoint_C.copy()

    def wait(self, at_most_s: float) -> None:
        """Let time pass, until a segment reports another stiffness."""
        if self.ails and self.fault == "interrupt" and self.wheels.any():
            raise KeyboardInterrupt
        before = [segment.told for segment in self.segments]
        for _ in range(max(1, round(at_most_s / TICK_S))):
            self._tick()
            if before != [segment.told for segment in self.segments]:
                return

    def think(self, problem: Problem) -> Result | None:
        """Plan at once; None while the clock goes on."""
        if self.fault == "planner raises":
            raise BrokenError("the planner is gone")
        if self._thought is None:
            self._thought = plan(problem), self.time_s + PLANNING_S, self.q.copy()
        result, end_s, before = self._thought
        if self.time_s < end_s:
            return None
        self._thought = None
        self.planning_m += float(np.hypot(*(self.q - before)[:2]))
        return result

    @property
    def off(self) -> bool:
        """Whether its last command was to stand, heaters off."""
        return not self.wheels.any() and bool((self.setpoint_C <= 25.0).all())

    @property
    def _silent(self) -> bool:
        """Whether nothing comes from it: once, from when it stands on."""
        if self.fault == "outage" and self.ails and math.isnan(self._silent_s):
            self._silent_s = math.nan if self.wheels.any() else self.time_s
        return self.time_s - self._silent_s < _OUTAGE_S

    @property
    def _matters(self) -> bool:
        if self.fault in _OF_HEATERS:
            return any(segment.wrong for segment in self.segments)
        if self.fault.startswith("thermistor"):
            off_K = [abs(self._shown_C(j) - self.segments[j].read_C) for j in range(2)]
            return not all(each < _MATTERS_K for each in off_K)
        return bool(self.wheels.any())

    def _tick(self) -> None:
        for j, setpoint_C in enumerate(self.setpoint_C):
            segment, one = self.segments[j], self.fault in _OF_ONE
            segment.fault = self.fault if self.ails and (j == self._lying or not one) else ""
            segment.advance(bool(setpoint_C >= 65.0), TICK_S)
            self.hottest_C = max(self.hottest_C, segment.metal_C)
        if math.isnan(self.mattered_s) and self.ails and self._matters:
            self.mattered_s = self.time_s
        if self.wheels.any():
            self._roll()
        self.time_s += TICK_S
        self._photograph()

    def _roll(self) -> None:
        """Move as the wheels roll: what is solid keeps its shape."""
        soft = [j for j in range(2) if self.segments[j].soft]
        before = self.q.copy()
        rate = rolled(self.robot, self.q, self._grip * self.wheels, soft)
        middle = self.q + rate * TICK_S / 2
        self.q = self.q + TICK_S * rolled(self.robot, middle, self._grip * self.wheels, soft)
        moved_m = float(np.hypot(*(self.q - before)[:2]))
        if any(s.told == "soft" and not s.soft for s in self.segments):
            self.forced_m += moved_m
        if self.ails and "camera" in self.fault:
            self.blind_m += moved_m

    def _shown_C(self, segment: int) -> float:
        shown_C = self.segments[segment].shown_C
        if not self.ails:
            return shown_C
        rare = self.time_s % 7.0 >= TICK_S
        odd = {"thermistor -127": -127.0, "thermistor NaN": math.nan, "thermistor garbage": 1e9}
        if self.fault == "thermistor rare" and rare:
            return math.nan
        return odd.get(self.fault, shown_C)

    def _photograph(self) -> None:
        noise = np.array([1e-3, 1e-3, 0.02, 1.0, 1.0])
        frame = self.q + noise * self._rng.standard_normal(_SIZE)
        lot, wild = self._rng.random(), self._rng.uniform(-1, 1, _SIZE)
        if self.ails:
            match self.fault:
                case "dead camera":
                    return
                case "stale camera":
                    self._frames.append(self._last)
                    return
                case "frozen camera":
                    frame = self._last[1]
                case "NaN frames" if lot < 10 * _WILD:
                    frame = frame * math.nan
                case "wild frames" if lot < _WILD:
                    frame = wild * [1.0, 1.0, math.pi, 60.0, 60.0]
        self._last = self.time_s, frame
        self._frames.append(self._last)


def rolled(robot: Robot, q: Array, wheel_rad_s: Array, soft: list[int]) -> Array:
    """Rate of q, (5,), with which the wheels slip least; two soft segments bend alike."""
    free, step = [0, 1, 2, *(3 + j for j in soft)], 1e-6
    directions, places = wheels_at(robot, np.vstack([q, q + step * np.eye(_SIZE)[free]]))
    rows = ((places[1:] - places[0]) * directions[0]).sum(axis=2).T / step
    wanted = wheel_rad_s * robot.geometry.wheel_radius_m
    if len(soft) == 2:
        rows, wanted = np.vstack([rows, [0, 0, 0, 1e-2, -1e-2]]), np.append(wanted, 0.0)
    rate = np.zeros(_SIZE)
    rate[free] = np.linalg.lstsq(rows, wanted, rcond=1e-6)[0]
    return rate


def wheels_at(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Where the wheels drive to, and where they are [m], each (m, 4, 2), for each of q (m, 5)."""
    geometry, (x_m, y_m, phi) = robot.geometry, q[:, :3].T
    directions, places = [], []
    for unit, sense in ((0, -1.0), (1, 1.0)):
        half_m, length_m = sense * geometry.half_link_m, sense * geometry.lengths_m[unit]
        turn = q[:, 3 + unit] * length_m
        chord_m = length_m * np.sinc(turn / (2 * math.pi))
        end_x_m = x_m + half_m * np.cos(phi) + chord_m * np.cos(phi + turn / 2)
        end_y_m = y_m + half_m * np.sin(phi) + chord_m * np.sin(phi + turn / 2)
        c, s = np.cos(phi + turn), np.sin(phi + turn)
        for at_x, at_y, angle in geometry.wheel_placement[2 * unit : 2 * unit + 2]:
            places.append((end_x_m + c * at_x - s * at_y, end_y_m + s * at_x + c * at_y))
            directions.append((np.cos(phi + turn + angle), np.sin(phi + turn + angle)))
    return np.array(directions).transpose(2, 0, 1), np.array(places).transpose(2, 0, 1)
