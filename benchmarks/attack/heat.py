"""Melting and freezing of one segment, integrated anew: the policy of docs/guide/heat.md.

Heater on: full current up to the set-point, then what holds it there. Off: no current. A segment
knows what happened to it so far and makes its next transition at the earliest onset not before a
time that is asked for, its heater switched as late (on) or early (off) as that allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

State = tuple[float, float, float]  # level (enthalpy or core), body [C], energy spent [J]

_STEPS = 50  # per the shortest time constant
_SAME_S = 1e-10
_MOST_S = 5e4


class Item(NamedTuple):
    """A transition: times in s, of a segment counted from 0."""

    segment: int
    to: str
    heater_s: float
    onset_s: float
    done_s: float


class Heated(Protocol):
    """A segment with its past."""

    @property
    def heater_on(self) -> bool:
        """Whether its heater is on."""

    @property
    def ready_s(self) -> float:
        """From when on its heater may be switched."""

    def melted(self, wanted: float, free: float) -> tuple[Heated, Item] | None:
        """Melt from the first onset at ``wanted`` or later, the heater on at ``free`` or later."""

    def frozen(self, wanted: float) -> tuple[Heated, Item]:
        """Freeze from the first onset at ``wanted`` or later."""

    def switched_off(self, when: float) -> tuple[Heated, Item]:
        """Freeze from whatever onset follows when the heater goes off at ``when``."""

    def energy_J(self, until: float) -> float:
        """Heater energy from t = 0."""


@dataclass(frozen=True)
class Metal:
    """What a segment is made of: numbers of the problem, rates written anew.

    Attributes:
        model: Where the numbers are; nothing of it is called.
    """

    model: Any

    @cached_property
    def lumped(self) -> bool:
        """Whether all of it has one temperature, and a plateau."""
        return hasattr(self.model, "latent_J")

    @cached_property
    def thresholds(self) -> tuple[float, float]:
        """Levels up to which it is solid, and from which on liquid."""
        m = self.model
        return (0.0, m.latent_J) if self.lumped else (m.solid_level, m.liquid_level)

    @cached_property
    def step_s(self) -> float:
        """Of the integration."""
        m: Any = self.model
        if self.lumped:
            least: float = min(m.heat_solid_J_per_K, m.heat_liquid_J_per_K)
            loss: float = m.loss_W_per_K
            return least / loss / _STEPS
        rate: float = m.coupling_per_s * (1 + 1 / m.body_ratio) + m.body_loss_per_s
        return 1 / rate / _STEPS

    def level(self, temperature_C: float) -> float:
        """Level at a temperature, at the melting point that of the solid."""
        m = self.model
        if not self.lumped:
            return temperature_C
        above = temperature_C - m.melting_point_C
        solid: float = m.heat_solid_J_per_K * above
        liquid: float = m.latent_J + m.heat_liquid_J_per_K * above
        return liquid if above > 0 else solid

    def temperature(self, level: float) -> float:
        """Temperature of the metal [C]."""
        m = self.model
        if not self.lumped:
            return level
        solid: float = m.melting_point_C + level / m.heat_solid_J_per_K
        liquid: float = m.melting_point_C + max(0.0, level - m.latent_J) / m.heat_liquid_J_per_K
        return solid if level < 0 else liquid

    def rates(self, x: State, current: float) -> State:
        """Of level, body and energy at constant current."""
        m, warm = self.model, self.temperature(x[0])
        if self.lumped:
            coil = m.resistance_ohm * (1 + m.temperature_coefficient_per_K * (warm - 25.0))
            power = current**2 * coil
            return power - m.loss_W_per_K * (warm - m.ambient_C), 0.0, power
        heating = m.power_K_per_s * (current / m.full_current_A) ** 2
        flow = m.coupling_per_s * (x[0] - x[1])
        lost = m.body_loss_per_s * (x[1] - m.ambient_C)
        return heating - flow, flow / m.body_ratio - lost, heating * m.core_heat_J_per_K

    def holding(self, x: State) -> State:
        """Rates while a controller keeps the level."""
        free = self.rates(x, 0.0)
        capacity = 1.0 if self.lumped else self.model.core_heat_J_per_K
        return 0.0, free[1], max(0.0, -free[0]) * capacity

    def after(self, x: State, current: float | None, span: float) -> State:
        """State a time later; None: held."""
        left = span
        while left > 0:
            h = min(self.step_s, left)
            x, h = self._to_edge(x, current, h)
            left -= h
            if left < _SAME_S * span:
                break
        return x

    def until(self, x: State, current: float, level: float) -> tuple[float, State]:
        """Time until a level is reached, and the state there; inf if it never is."""
        spent, side = 0.0, math.copysign(1.0, level - x[0])
        if x[0] == level:
            return 0.0, x
        while spent < _MOST_S:
            after, h = self._to_edge(x, current, self.step_s, level)
            spent += h
            if (level - after[0]) * side <= 0:
                return spent, (level, *after[1:])
            if abs(after[0] - x[0]) < 1e-13 * abs(x[0] + 1):
                break
            x = after
        return math.inf, x

    def _to_edge(
        self, x: State, current: float | None, h: float, extra: float = math.inf
    ) -> tuple[State, float]:
        """A step of h, or up to the first edge of a regime if there is one on the way."""
        after = self._stepped(x, current, h)
        low, high = sorted((x[0], after[0]))
        edges = [e for e in (*self.thresholds, extra) if low < e < high]
        if not edges or current is None:
            return after, h
        edge = min(edges, key=lambda e: abs(e - x[0]))
        least, most = 0.0, h  # regula falsi, with the level's own rate as slope
        part = h * (edge - x[0]) / (after[0] - x[0])
        for _ in range(60):
            there = self._stepped(x, current, part)
            off = there[0] - edge
            if abs(off) < 1e-13 * (1 + abs(edge)):
                break
            if (off > 0) == (after[0] > x[0]):
                most = part
            else:
                least = part
            slope = self.rates(there, current)[0]
            part = part - off / slope if slope else (least + most) / 2
            if not least < part < most:
                part = (least + most) / 2
        there = self._stepped(x, current, part)
        return (edge, *there[1:]), part

    def _stepped(self, x: State, current: float | None, h: float) -> State:
        """A classical Runge-Kutta step."""

        def rate(at: State) -> State:
            return self.holding(at) if current is None else self.rates(at, current)

        def moved(by: State, share: float) -> State:
            return (x[0] + share * by[0], x[1] + share * by[1], x[2] + share * by[2])

        k1 = rate(x)
        k2 = rate(moved(k1, h / 2))
        k3 = rate(moved(k2, h / 2))
        k4 = rate(moved(k3, h))
        mean = tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        return moved(mean, h)  # type: ignore[arg-type]


class Policy(NamedTuple):
    """How a segment is heated: full current, set-point, factors of the windows, where kept warm."""

    current_A: float
    setpoint_C: float
    melt_early: float = 1.0
    melt_late: float = 1.0
    freeze_early: float = 1.0
    freeze_late: float = 1.0
    warm_C: float | None = None


@dataclass(frozen=True)
class ThermalSegment:
    """A segment whose times come from its thermal state.

    Attributes:
        number: Which one, from 0.
        metal: What it is made of.
        policy: How it is heated.
        since_s: When its heater was last switched.
        state: Its state then.
        heater_on: Whether it was switched on.
        ready_s: When its last transition was done.
    """

    number: int
    metal: Metal
    policy: Policy
    since_s: float
    state: State
    heater_on: bool
    ready_s: float = 0.0

    def at(self, when: float) -> State:
        """State at a time after the last switch."""
        metal, x, span = self.metal, self.state, when - self.since_s
        if self.heater_on:
            level = metal.level(self.policy.setpoint_C)
            needed, there = metal.until(x, self.policy.current_A if x[0] < level else 0.0, level)
            if x[0] < level and span <= needed:
                return metal.after(x, self.policy.current_A, span)
        elif self.policy.warm_C is not None:
            level = metal.level(self.policy.warm_C)
            needed, there = metal.until(x, 0.0, level) if x[0] >= level else (math.inf, x)
        else:
            needed, there = math.inf, x
        if span <= needed:
            return metal.after(x, 0.0, span)
        return metal.after(there, None, span - needed)

    def energy_J(self, until: float) -> float:
        return self.at(until)[2]

    def _switch(
        self, wanted: float, since: float, level: int, current: float, early: float
    ) -> float:
        """When to switch the heater so that the level is reached at ``wanted`` or soon after."""

        def lead(when: float) -> float:
            x, edge = self.at(when), self.metal.thresholds[level]
            if (x[0] >= edge) == (level == 0):  # there by rounding
                return 0.0
            return early * self.metal.until(x, current, edge)[0]

        if since + lead(since) >= wanted:
            return since
        low, high, when = since, wanted, wanted - lead(since)
        for _ in range(80):
            when = when if low <= when <= high else (low + high) / 2
            off = when + lead(when) - wanted
            if abs(off) < 1e-9:
                break
            low, high = (when, high) if off < 0 else (low, when)
            when -= off
        return when

    def melted(self, wanted: float, free: float) -> tuple[ThermalSegment, Item] | None:
        policy, (solid, liquid) = self.policy, self.metal.thresholds
        since = max(self.ready_s, free)
        on = self._switch(wanted, since, 0, policy.current_A, policy.melt_early)
        x = self.at(on)
        lead = 0.0 if x[0] >= solid else self.metal.until(x, policy.current_A, solid)[0]
        onset = on + policy.melt_early * lead
        done = on + policy.melt_late * self.metal.until(x, policy.current_A, liquid)[0]
        if not math.isfinite(done):
            return None
        after = replace(self, since_s=on, state=x, heater_on=True, ready_s=done)
        return after, Item(self.number, "soft", on, onset, done)

    def frozen(self, wanted: float) -> tuple[ThermalSegment, Item]:
        off = self._switch(wanted, self.ready_s, 1, 0.0, self.policy.freeze_early)
        return self.switched_off(off)

    def switched_off(self, when: float) -> tuple[ThermalSegment, Item]:
        x, (solid, liquid) = self.at(when), self.metal.thresholds
        coasting = 0.0 if x[0] <= liquid else self.metal.until(x, 0.0, liquid)[0]
        onset = when + self.policy.freeze_early * coasting
        done = when + self.policy.freeze_late * self.metal.until(x, 0.0, solid)[0]
        after = replace(self, since_s=when, state=x, heater_on=False, ready_s=done)
        return after, Item(self.number, "rigid", when, onset, done)


class Constants(NamedTuple):
    """Constant times of every segment [s], and heater powers [W]."""

    lead: float
    melting: float
    coasting: float
    freezing: float
    superheat: float
    full_W: float
    hold_W: float


@dataclass(frozen=True)
class ConstantSegment:
    """A segment that melts and freezes in constant times.

    Attributes:
        number: Which one, from 0.
        times: The constants.
        first_s: Earliest first onset, by how warm it is at t = 0.
        heater_on: Whether its heater is on.
        on_s: Since when.
        ready_s: When its last transition was done.
        energy: Spent until its heater was last off [J].
        count: Transitions it has made.
    """

    number: int
    times: Constants
    first_s: float
    heater_on: bool
    on_s: float = 0.0
    ready_s: float = 0.0
    energy: float = 0.0
    count: int = 0

    def melted(self, wanted: float, free: float) -> tuple[ConstantSegment, Item] | None:
        lead = self.times.lead if self.count else self.first_s
        on = max(self.ready_s, free, wanted - lead)
        done = on + lead + self.times.melting
        after = replace(self, heater_on=True, on_s=on, ready_s=done, count=self.count + 1)
        return after, Item(self.number, "soft", on, on + lead, done)

    def frozen(self, wanted: float) -> tuple[ConstantSegment, Item]:
        coasting, superheat = self.times.coasting, self.times.superheat
        if not self.count:
            onset = max(wanted, self.first_s)
            return self._off(max(0.0, onset - coasting), onset)
        held = max(0.0, wanted - self.ready_s) / (1 + coasting / superheat)
        return self.switched_off(self.ready_s + held if held < superheat else wanted - coasting)

    def switched_off(self, when: float) -> tuple[ConstantSegment, Item]:
        if not self.count:  # hotter than the set-point, it is held until it coasts from there
            when = max(when, self.first_s - self.times.coasting)
            return self._off(when, max(self.first_s, when + self.times.coasting))
        stored = min(1.0, (when - self.ready_s) / self.times.superheat)
        return self._off(when, when + stored * self.times.coasting)

    def _off(self, when: float, onset: float) -> tuple[ConstantSegment, Item]:
        done, spent = onset + self.times.freezing, self.energy_J(when)
        after = replace(self, heater_on=False, ready_s=done, energy=spent, count=self.count + 1)
        return after, Item(self.number, "rigid", when, onset, done)

    def energy_J(self, until: float) -> float:
        if not self.heater_on:
            return self.energy
        hot = self.ready_s + self.times.superheat if self.count else 0.0
        full = max(0.0, min(until, hot) - self.on_s)
        held = max(0.0, until - max(hot, self.on_s))
        return self.energy + self.times.full_W * full + self.times.hold_W * held
