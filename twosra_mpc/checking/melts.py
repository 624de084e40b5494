"""Least times of melts and freezes, in intervals: section 3 of ``docs/certificate.md``.

A second account of ``thermal`` and ``timing`` for ``checking.certificate``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from flint import arb

from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.segment import Heater
from twosra_mpc.robot.timing import OverlappedTiming
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.two_node import TwoNode
from twosra_mpc.thermal.uncertainty import EXACT, Windows

_LONGEST_S, _HALVINGS = 1e5, 60  # looked for a level, and steps to find it


class First(NamedTuple):
    """Of the first transition: from t = 0 to its onset, from there to its end, and both [s]."""

    lead: arb
    plateau: arb
    total: arb


class Heat(NamedTuple):
    """Lower bounds over all heatings of a segment; times in s.

    Attributes:
        first: Stiffness that it leads to, 1 soft or 0 rigid -> the first transition.
        again: From the end of a freeze to the onset of the next melt.
        melt: From onset to end of a melt after that.
        coast: Transitions made before -> end of a melt to the onset of the freeze after it.
        freeze: (transitions made before, least time since the melt) -> onset to end of a freeze.
        first_J: Heater energy of a first melt.
        melt_J: Of any other.
        hold_W: Mean heater power from the end of a melt to the onset of the freeze after it.
        warm: Heater on to the onset of a first melt, whenever that is.
        longest: Heater off to the onset of a freeze, at most.
    """

    first: Callable[[int], First]
    again: arb
    melt: arb
    coast: Callable[[int], arb]
    freeze: Callable[[int, arb], arb]
    first_J: arb
    melt_J: arb
    hold_W: arb
    warm: arb
    longest: arb

    def change(self, soft: int, made: int, held: arb) -> tuple[arb, arb, arb]:
        """Lead, plateau and energy of a transition after others, so long since the last melt."""
        if not made:
            first = self.first(soft)
            return first.lead, first.plateau, self.first_J
        if soft:
            return self.again, self.melt, self.melt_J
        return self.coast(made), self.freeze(made, held), self.melt_J


def heat(problem: Problem, j: int) -> Heat:
    """Work out the least times of segment j (from 0)."""
    heater, now = problem.robot.heater, arb(problem.temperatures[j])
    molten = arb(problem.melt_fractions[j])
    if type(problem.transition_times) is OverlappedTiming:
        return _constant(problem.transition_times, heater, now, molten, problem.ambient)
    model, window = problem.segment_models[j], problem.windows[j]
    if type(model) is Lumped:
        return _OneNode(model, heater, now, molten, window).heat()
    if type(model) is TwoNode:
        bodies = problem.start.body_temperature_C
        body = now if bodies is None else arb(bodies[j])
        return _TwoNodes(model, heater, now, body, window).heat()
    raise InputError("robot.segment.model", type(model).__name__, "lumped or two_node")


def _constant(
    times: OverlappedTiming, heater: Heater, now: arb, molten: arb, ambient_C: float
) -> Heat:
    """Constant times; the first lead is shorter by as much as the metal is warm."""
    full_W = arb(heater.melt_current_A) ** 2 * heater.resistance_ohm
    hold_W = arb(heater.hold_current_A) ** 2 * heater.resistance_ohm
    melting_C = arb(heater.melting_point_C)
    melt_lead = arb(times.melt_s) - times.melt_changing_s
    coast = arb(times.freeze_s) - times.freeze_changing_s
    warm = melt_lead * (melting_C - now) / (melting_C - ambient_C)
    melt, freeze = arb(times.melt_changing_s), arb(times.freeze_changing_s)
    share = times.superheat_s / (times.superheat_s + coast)

    def first(to: int) -> First:
        if to:
            return First(warm, (1 - molten) * melt, arb(0))
        lead = coast * (now - melting_C) / (heater.soft_setpoint_C - melting_C)
        return First(lead, molten * freeze, arb(0))

    return Heat(
        first=first,
        again=melt_lead * (molten if 0 < molten < 1 else 1),
        melt=melt,
        coast=lambda _: arb(0),
        freeze=lambda _made, _held: freeze,
        first_J=(warm + (1 - molten) * melt) * full_W,
        melt_J=(melt_lead + melt) * full_W,
        hold_W=hold_W.min(share * full_W),
        warm=warm,
        longest=coast,
    )


class _OneNode:
    """One temperature: what is warmer stays warmer, and full current heats fastest."""

    def __init__(
        self, model: Lumped, heater: Heater, now: arb, share: arb, window: Windows
    ) -> None:
        self.now, self.share, self.window, self.model = now, share, window, model
        self.air, self.melting = arb(model.ambient_C), arb(model.melting_point_C)
        self.loss, self.setpoint = arb(model.loss_W_per_K), arb(heater.soft_setpoint_C)
        self.ohm = arb(heater.melt_current_A) ** 2 * model.resistance_ohm
        self.alpha = model.temperature_coefficient_per_K
        self.power = self.ohm * (1 + self.alpha * (self.melting - 25))
        self.hold = self.loss * (self.melting - self.air)
        self.frozen = model.latent_J / self.hold
        self.molten = arb(model.latent_J) / (self.power - self.hold)
        warmest = now.max(self.air).min(self.melting)
        self.warm, self.warm_J = self.course(
            model.heat_solid_J_per_K, warmest, self.melting, on=True
        )

    def rate(self, at: arb, *, on: bool) -> arb:
        """Power that warms the segment at a temperature [W]."""
        given = self.ohm * (1 + self.alpha * (at - 25)) if on else 0
        return given - self.loss * (at - self.air)

    def course(self, heat_J_per_K: float, since: arb, until: arb, *, on: bool) -> tuple[arb, arb]:
        """Time between two temperatures beside the plateau, and the heat given meanwhile."""
        slope = (self.alpha * self.ohm if on else 0) - self.loss
        gained = heat_J_per_K * (until - since)
        first, last = self.rate(since, on=on), self.rate(until, on=on)
        if slope > 0 or slope < 0:
            time = heat_J_per_K / slope * (last / first).log()
            lost = gained - self.rate(self.air, on=on) * time
            return time, gained + self.loss * lost / slope
        return gained / first.max(last), gained

    def coasting(self, made: int) -> arb:
        """Cooling of metal that was heated on until the window of its melt ended."""
        late, liquid = self.window.melt_late, self.model.heat_liquid_J_per_K
        first = self.warm + (1 - self.share) * self.molten
        heated = (late - 1) * (self.molten if made > 1 else first)
        slope = self.alpha * self.ohm - self.loss
        if made == 0 or not heated > 0 or slope.contains(0):
            return arb(0)
        gained = self.rate(self.melting, on=True) / slope * ((slope * heated / liquid).exp() - 1)
        peak = (self.melting + gained).min(self.setpoint)
        return self.course(liquid, peak, self.melting, on=False)[0]

    def freeze(self, made: int, _held: arb) -> arb:
        """Onset to end of a freeze."""
        window = self.window
        spread = (window.freeze_late - window.freeze_early) * self.coasting(made)
        return window.freeze_late * self.frozen + spread

    def first(self, to: int) -> First:
        """The first transition: what is left of the plateau."""
        model, window, (early, late) = self.model, self.window, self.window[:2]
        if to:
            lead, _ = self.course(model.heat_solid_J_per_K, self.now, self.melting, on=True)
            plateau = late * (1 - self.share) * self.molten + (late - early) * self.warm
            return First(early * lead, plateau, early * lead + plateau)
        lead, _ = self.course(model.heat_liquid_J_per_K, self.now, self.melting, on=False)
        plateau = window.freeze_late * self.share * self.frozen
        return First(window.freeze_early * lead, plateau, lead + plateau)

    def heat(self) -> Heat:
        """All of it."""
        model, window = self.model, self.window
        early, late = window.melt_early, window.melt_late
        hottest = self.setpoint.max(self.now)
        return Heat(
            first=self.first,
            again=arb(0),
            melt=late * self.molten,
            coast=lambda made: window.freeze_early * self.coasting(made),
            freeze=self.freeze,
            first_J=self.warm_J + self.power * (1 - self.share) * self.molten,
            melt_J=self.power * self.molten,
            hold_W=self.hold if window == EXACT else arb(0),
            warm=early * self.warm,
            longest=self.course(model.heat_liquid_J_per_K, hottest, self.melting, on=False)[0],
        )


class _TwoNodes:
    """A core and a body: of two states the one that is nowhere colder stays so."""

    def __init__(
        self, model: TwoNode, heater: Heater, core: arb, body: arb, window: Windows
    ) -> None:
        self.model, self.window, self.core, self.body = model, window, core, body
        self.air, self.p = arb(model.ambient_C), arb(model.power_K_per_s)
        self.solid, self.liquid = arb(model.solid_level), arb(model.liquid_level)
        self.a, self.b = arb(model.coupling_per_s), arb(model.body_loss_per_s)
        self.leave = self.a / arb(model.body_ratio)
        middle = -(self.a + self.leave + self.b) / 2
        root = (middle**2 - self.a * self.b).sqrt()
        self.fast, self.slow = middle - root, middle + root
        self.setpoint = arb(heater.soft_setpoint_C)
        changing = bool(self.solid < core) and bool(core < self.liquid)
        self.begun = core if changing else self.solid  # where the plateau of a first melt begins
        self.cold = core.min(body).min(self.air)
        self.warm = core.max(body).max(self.air).min(self.begun)
        self.hottest = body.max(self.settled(self.setpoint.max(core).max(self.liquid)))
        self.lead = self.passed(self.warm, self.warm, self.solid, on=True)
        self.melt = self.passed(self.solid, self.hottest.min(self.solid), self.liquid, on=True)
        self.shortest = self.passed(self.warm, self.warm, self.liquid, on=True), self.melt

    def course(self, core: arb, body: arb, t: Any, *, on: bool) -> tuple[arb, arb, arb]:
        """Core, body and the rate of the core after a time at full power, or without."""
        a, fast, slow, p = self.a, self.fast, self.slow, self.p if on else arb(0)
        body_end = self.air + p * self.leave / (a * self.b)
        core_end = body_end + p / a
        c, rate = core - core_end, p - a * (core - body)
        c_fast, c_slow = (rate - slow * c) / (fast - slow), (fast * c - rate) / (fast - slow)
        f, s = c_fast * (fast * t).exp(), c_slow * (slow * t).exp()
        body_t = body_end + f * (1 + fast / a) + s * (1 + slow / a)
        return core_end + f + s, body_t, fast * f + slow * s

    def passed(self, core: arb, body: arb, level: arb, *, on: bool) -> arb:
        """A time before which the core does not pass a level: its rate changes sign but once."""
        sign, before, after = 1 if on else -1, 0.0, 1.0
        while after < _LONGEST_S and self._short(core, body, level, after, on=on):
            before, after = after, 2 * after
        for _ in range(_HALVINGS):
            half = (before + after) / 2
            short = self._short(core, body, level, half, on=on)
            before, after = (half, after) if short else (before, half)
        return arb(before if sign * self.course(core, body, before, on=on)[2] >= 0 else 0.0)

    def _short(self, core: arb, body: arb, level: arb, t: float, *, on: bool) -> bool:
        """True if the core surely is on this side of a level."""
        left = level - self.course(core, body, t, on=on)[0]
        return bool(left > 0 if on else left < 0)

    def settled(self, core: arb) -> arb:
        """The body beside a core that is held."""
        return (self.leave * core + self.b * self.air) / (self.leave + self.b)

    def first_melt(self) -> arb:
        """Least time through the plateau of a first melt."""
        slowest = self.passed(self.cold, self.cold, self.solid, on=True) + 1e-6
        if not self.course(self.cold, self.cold, slowest, on=True)[0] >= self.solid:
            return self.passed(self.begun, self.begun, self.liquid, on=True)
        ends = [self.course(self.warm, self.warm, t, on=True)[1] for t in (self.lead, slowest)]
        return self.passed(self.begun, ends[0].max(ends[1]).min(self.begun), self.liquid, on=True)

    def coasting(self, made: int) -> arb:
        """Cooling of a core that was heated on until the window of its melt ended."""
        late, liquid = self.window.melt_late, self.liquid
        if made == 0 or late == 1:
            return arb(0)
        melted = self.shortest[made > 1]
        there = self.course(self.cold, self.cold, melted, on=True)[1].min(liquid)
        to_setpoint = self.passed(liquid, there, self.setpoint, on=True)
        core, there, _ = self.course(liquid, there, ((late - 1) * melted).min(to_setpoint), on=True)
        return self.passed(core, there, liquid, on=False)

    def freeze(self, made: int, held: arb) -> arb:
        """Onset to end of a freeze: the body is no warmer than the shortest melt leaves it."""
        window, rest = self.window, self.settled(self.liquid)
        there = self.course(self.cold, self.cold, self.shortest[made > 1], on=True)[1]
        there = (rest + (there - rest) * (-(self.leave + self.b) * held).exp()).min(rest)
        spread = (window.freeze_late - window.freeze_early) * self.coasting(made)
        return window.freeze_late * self.passed(self.liquid, there, self.solid, on=False) + spread

    def longest_coasting(self) -> arb:
        """By when the hottest core surely has cooled to the plateau."""
        top, longest = self.setpoint.max(self.core), arb(1e-3)
        while longest < 10 * _LONGEST_S:
            if self.course(top, self.hottest, longest, on=False)[0] < self.liquid:
                break
            longest = longest * 1.02
        return longest

    def first(self, to: int) -> First:
        """The first transition: what is left of the plateau."""
        window, core, body = self.window, self.core, self.body
        if to:
            early, late = window.melt_early, window.melt_late
            plateau = late * self.first_melt() + (late - early) * self.lead
            lead = early * self.passed(core, body, self.solid, on=True)
            return First(lead, plateau, self.passed(core, body, self.liquid, on=True))
        onset = self.liquid.min(core)
        plateau = self.passed(onset, body.min(self.settled(onset)), self.solid, on=False)
        total = self.passed(core, body, self.solid, on=False) + (window.freeze_late - 1) * plateau
        lead = window.freeze_early * self.passed(core, body, self.liquid, on=False)
        return First(lead, window.freeze_late * plateau, total)

    def heat(self) -> Heat:
        """All of it."""
        window, early, late = self.window, self.window.melt_early, self.window.melt_late
        full_W = self.model.core_heat_J_per_K * self.p
        hold_W = self.model.core_heat_J_per_K * self.a * (self.liquid - self.hottest)
        return Heat(
            first=self.first,
            again=arb(0),
            melt=late * self.melt,
            coast=lambda made: window.freeze_early * self.coasting(made),
            freeze=self.freeze,
            first_J=full_W * (self.lead + self.first_melt()),
            melt_J=full_W * self.melt,
            hold_W=hold_W.max(arb(0)) if window == EXACT else arb(0),
            warm=early * self.lead,
            longest=self.longest_coasting(),
        )
