"""Two segments whose thermistors may lie, melted and frozen in turns under the watch of the host.

Metal, sensors and firmware are written anew and share nothing with the simulator: explicit steps of
the enthalpy, its constants drawn evenly over the robot file's ranges. One firmware switches its
heater at the set-point and tells no current, the other regulates and does.

A lie matters from when its reading is 5 K off. Of metal that cools it may show too much for longer:
until it is 5 K above the slowest healthy metal, too, it is what that one would show, and costs no
more time.
"""

from __future__ import annotations

import math
from collections import deque
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from twosra_mpc.execution.segment_watch import SegmentError, SegmentWatch
from twosra_mpc.execution.settings import Patience
from twosra_mpc.robot.description import Robot, segment_model

TICK_S, READS = 0.1, 10  # a reading a second
_LONGEST_S, _WARM_C, _SET_C, _OFF_C = 1500.0, 45.0, 65.0, 25.0
_SOFT_C, _RIGID_C, _SETTLED_S, _KEPT_S = 63.5, 58.5, 30.0, 60.0
_NOISE_C, _PARTS = 0.02, 0.01  # of thermistors; tolerance of their and their resistors' values
_MATTERS_K = 5.0  # as far off, a reading that lies matters

LIES = (
    *("stuck", "stuck, noise", "stuck, melting", "noisy", "creeps", "approaches", "drifts"),
    *("late", "sluggish", "scaled", "offset", "swapped", "averaged"),
)


class Metal:
    """A segment by its enthalpy above solid metal at the melting point [J]."""

    def __init__(self, robot: Robot, air_C: float, rng: np.random.Generator, warm: bool) -> None:
        """Draw its constants, and begin at rest."""
        ranges = robot.thermal_segment(0).ranges
        model: Any = segment_model(robot, air_C, 0)

        def even(name: str) -> float:
            return float(rng.uniform(*ranges[name]))

        self.solid_J_K, self.latent_J = even("heat_solid_J_per_K"), even("latent_J")
        self.liquid_J_K = self.solid_J_K * model.heat_liquid_J_per_K / model.heat_solid_J_per_K
        self.loss_W_K, self.ohm = even("loss_W_per_K"), even("resistance_ohm")
        self.melting_C, self.air_C = even("melting_point_C"), air_C
        self.heat_J = ((_WARM_C if warm else air_C) - self.melting_C) * self.solid_J_K
        self.hottest_C = self.temperature_C
        self._slowest = (
            ranges["heat_solid_J_per_K"][1],
            ranges["latent_J"][1],
            ranges["loss_W_per_K"][0],
        )

    def slowest(self) -> Metal:
        """The slowest healthy one that cools from here: as warm, as much of it molten."""
        slow, above_K = copy(self), self.temperature_C - self.melting_C
        slow.solid_J_K, slow.latent_J, slow.loss_W_K = self._slowest
        slow.liquid_J_K *= slow.solid_J_K / self.solid_J_K
        molten = min(max(self.heat_J / self.latent_J, 0.0), 1.0)
        each_J_K = slow.liquid_J_K if above_K > 0 else slow.solid_J_K
        slow.heat_J = molten * slow.latent_J + above_K * each_J_K
        return slow

    @property
    def temperature_C(self) -> float:
        """Of the metal."""
        solid_K, molten_J = self.heat_J / self.solid_J_K, self.heat_J - self.latent_J
        return self.melting_C + min(0.0, solid_K) + max(0.0, float(molten_J / self.liquid_J_K))

    def advance(self, current_A: float) -> None:
        """Let a tick pass."""
        here_C = self.temperature_C
        copper = 1 + 0.00393 * (here_C - 25.0)
        gained = current_A**2 * self.ohm * copper - self.loss_W_K * (here_C - self.air_C)
        self.heat_J += gained * TICK_S
        self.hottest_C = max(self.hottest_C, self.temperature_C)


@dataclass(eq=False)
class Lie:
    """How a sensor lies from a time on; its sizes are drawn once.

    Attributes:
        kind: One of `LIES`.
        begins_s: When.
        rng: For its sizes and its noise.
    """

    kind: str
    begins_s: float
    rng: np.random.Generator

    def __post_init__(self) -> None:
        rng, sign = self.rng, float(self.rng.choice([-1, 1]))
        self.noise_C = {"stuck, noise": 0.1, "stuck, melting": 0.1}.get(self.kind, 0.0)
        if self.kind == "noisy":
            self.noise_C = float(rng.uniform(1.0, 6.0))
        self.rate_K_s = sign * float(rng.uniform(0.05, 0.6))
        self.late = int(rng.uniform(10.0, 40.0) / TICK_S)
        self.lag_s = float(rng.uniform(15.0, 60.0))
        self.scale = 1 + sign * float(rng.uniform(0.1, 0.4))
        self.offset_C = sign * float(rng.uniform(6.0, 20.0))
        self._past: deque[float] = deque(maxlen=self.late)
        self._held_C = self._slow_C = math.nan

    def shown_C(self, time_s: float, true_C: float, other_C: float, air_C: float) -> float:
        """Reading in place of the true one."""
        self._past.append(true_C)
        if time_s < self.begins_s:
            return true_C
        if math.isnan(self._held_C):
            self._held_C = self._slow_C = true_C
        held_C, near_C = self._held_C, _SET_C - 0.1
        self._slow_C += (true_C - self._slow_C) * TICK_S / self.lag_s
        lies = {
            "stuck": held_C,
            "stuck, noise": held_C,
            "stuck, melting": true_C if max(self._past) < 61.7 else 61.7,
            "noisy": true_C,
            "creeps": min(held_C + 0.5 * (true_C - held_C), max(near_C, held_C)),
            "approaches": min(true_C, max(near_C, held_C)),
            "drifts": true_C + self.rate_K_s * (time_s - self.begins_s),
            "late": self._past[0],
            "sluggish": self._slow_C,
            "scaled": air_C + self.scale * (true_C - air_C),
            "offset": true_C + self.offset_C,
            "swapped": other_C,
            "averaged": (true_C + other_C) / 2,
        }
        return lies[self.kind] + self.noise_C * float(self.rng.standard_normal())


class Segment:
    """Metal, thermistor and firmware."""

    def __init__(self, robot: Robot, air_C: float, rng: np.random.Generator, warm: bool) -> None:
        """Draw them, and begin at rest, the heater off."""
        self.metal, self._rng = Metal(robot, air_C, rng, warm), rng
        self.slowest = self.metal.slowest()
        lag_s, one = float(rng.uniform(2.0, 8.0)), float(rng.uniform(0.5, 1.0))
        self._lags_s, self._full_A = (one * lag_s, (1 - one) * lag_s), robot.heater.melt_current_A
        self._lagging = [self.metal.temperature_C] * 2
        self._parts = _PARTS * np.clip(rng.standard_normal(3), -1.0, 1.0)
        self._tells = bool(rng.random() < 0.5)
        self.current_A, self._integral, self._off_s, self._above_s = 0.0, 0.0, 1e3, 0.0
        self._let_A2: list[float] = []
        self.true_C = self.shown_C = self.metal.temperature_C
        self.told = "rigid"

    def told_A(self) -> float | None:
        """Root mean square of the current since this was last told, from firmware that does."""
        let_A2, self._let_A2 = self._let_A2, []
        return math.sqrt(sum(let_A2) / len(let_A2)) if self._tells else None

    def advance(self) -> None:
        """Let a tick pass."""
        if self.current_A:
            self.slowest = self.metal.slowest()
        self.metal.advance(self.current_A)
        self.slowest.advance(self.current_A)
        self._let_A2.append(self.current_A**2)
        touched_C = self.metal.temperature_C
        for k, lag_s in enumerate(self._lags_s):
            left = math.exp(-TICK_S / lag_s) if lag_s > 0 else 0.0
            self._lagging[k] = touched_C = touched_C + (self._lagging[k] - touched_C) * left
        resistance, beta, fixed = self._parts
        kelvin = touched_C + 273.15  # of a divider: each of its parts a little off
        off = (math.log1p(resistance) - math.log1p(fixed)) / 3950 + beta * (1 / kelvin - 1 / 298.15)
        self.true_C = 1 / (1 / kelvin + off) - 273.15 + _NOISE_C * self._rng.standard_normal()

    @property
    def matters(self) -> bool:
        """True if what is shown is too far off."""
        high_C = max(self.true_C, self.slowest.temperature_C)
        return not self.true_C - _MATTERS_K < self.shown_C < high_C + _MATTERS_K

    def decide(self, setpoint_C: float) -> None:
        """Decide on the current by what the sensor shows, and on what the segment is."""
        here_C, asked = self.shown_C, setpoint_C >= _SET_C
        if not asked:
            self.current_A, self._integral = 0.0, 0.0
        elif self._tells:
            error_K = setpoint_C - here_C
            wanted = 0.2 * error_K + self._integral
            self.current_A = min(max(wanted, 0.0), self._full_A)
            if wanted < self._full_A or error_K < 0:
                self._integral = min(max(self._integral + 4e-3 * error_K * TICK_S, 0.0), 0.35)
        else:
            self.current_A = self._full_A * (here_C < setpoint_C)
        self._off_s = 0.0 if asked else self._off_s + TICK_S
        self._above_s = self._above_s + TICK_S if here_C > _SOFT_C else 0.0
        if asked and self._above_s > 1.0:
            self.told = "soft"
        elif not asked and here_C < _RIGID_C and self._off_s > _SETTLED_S:
            self.told = "rigid"
        elif self.told == "soft" if not asked and here_C < 62.0 else here_C > 53.0 and asked:
            self.told = "changing"


@dataclass(frozen=True)
class Outcome:
    """How a run under watch went.

    Attributes:
        cause: Of its end by a detector; "" if there was none.
        words: The same in words.
        ended_s: When it ended.
        hottest_C: Of all metal.
        mattered_s: From when the lie mattered to the end; NaN if it never did.
        melts: Melts that were believed.
        slowest_s: The longest of them.
    """

    cause: str
    words: str
    ended_s: float
    hottest_C: float
    mattered_s: float
    melts: int
    slowest_s: float


class _Host:
    """What is asked of a segment: melt, stay soft for a while, freeze, rest, and again."""

    def __init__(self, watch: SegmentWatch, rng: np.random.Generator, begins_s: float) -> None:
        self.watch, self._rng, self.asked_C = watch, rng, _OFF_C
        self._next_s, self.since_s = begins_s, math.inf
        self.melts, self.slowest_s = 0, 0.0

    def decide(self, now_s: float, told: str) -> None:
        """Ask for the next state once this one is believed and has lasted."""
        soft = self.asked_C >= _SET_C
        done = self.watch.may_be_soft and told == "soft" if soft else told == "rigid"
        if not done or (now_s < self.since_s and not math.isinf(self.since_s)):
            return
        if math.isinf(self._next_s):
            self._next_s = now_s + float(self._rng.exponential(_KEPT_S))
            if soft:
                self.melts, self.slowest_s = (
                    self.melts + 1,
                    max(self.slowest_s, now_s - self.since_s),
                )
        if now_s >= self._next_s:
            self.asked_C, self._next_s, self.since_s = _OFF_C if soft else _SET_C, math.inf, now_s


def watched(robot: Robot, seed: int, lie: str = "", lasts_s: float = _LONGEST_S) -> Outcome:
    """Melt and freeze two drawn segments until something is wrong, or time is up.

    Args:
        robot: As described; of segments with a melting plateau.
        seed: Of all that is drawn.
        lie: One of `LIES`, of the first sensor, of both where they are mixed up; "": none.
        lasts_s: Longest run.
    """
    rng = np.random.default_rng([seed, 21])
    air_C, warm = robot.heater.ambient_C, bool(rng.random() < 0.25)
    segments = [Segment(robot, air_C, rng, warm) for _ in range(2)]
    hosts = [
        _Host(
            SegmentWatch(
                robot, air_C, j, Patience(), reports=True, start_C=_WARM_C if warm else None
            ),
            rng,
            float(rng.uniform(0.0, 60.0)),
        )
        for j in range(2)
    ]
    begins_s = float(rng.uniform(0.0, 0.6 * lasts_s))
    lies = [Lie(lie, begins_s, np.random.default_rng([seed, k])) for k in range(2)] if lie else []
    lies = lies[: 2 if lie in ("swapped", "averaged") else 1]
    mattered_s, cause, words, now_s, tick = math.nan, "", "", 0.0, 0
    while now_s < lasts_s and not cause:
        sent_C = [host.watch.allowed_C(host.asked_C) for host in hosts]
        for _ in range(READS):
            tick += 1
            now_s = tick * TICK_S
            for segment in segments:
                segment.advance()
            for j, (segment, other) in enumerate(zip(segments, reversed(segments), strict=True)):
                segment.shown_C = true_C = segment.true_C
                if j < len(lies):
                    segment.shown_C = lies[j].shown_C(now_s, true_C, other.true_C, air_C)
                    matters = now_s >= begins_s and segment.matters
                    mattered_s = now_s if matters and math.isnan(mattered_s) else mattered_s
            for segment, setpoint_C in zip(segments, sent_C, strict=True):
                segment.decide(setpoint_C)
        for segment, host in zip(segments, hosts, strict=True):
            told: Any = segment.told
            try:
                host.watch.take(now_s, host.asked_C, segment.shown_C, told, False, segment.told_A())
            except SegmentError as error:
                cause, words = error.cause, str(error)
            host.decide(now_s, told)
    hottest_C = max(segment.metal.hottest_C for segment in segments)
    counted = sum(host.melts for host in hosts), max(host.slowest_s for host in hosts)
    return Outcome(cause, words, now_s, hottest_C, now_s - mattered_s, *counted)
