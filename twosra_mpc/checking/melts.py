"""What melts and freezes take at least, in intervals: section 3 of ``docs/certificate.md``.

A second account of ``thermal`` and ``timing`` for ``checking.certificate``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from flint import arb

from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.heater import Heater
from twosra_mpc.robot.timing import OverlappedTiming
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.two_node import TwoNode
from twosra_mpc.thermal.uncertainty import EXACT, Windows, windows


class Heat(NamedTuple):
    """What no heating of a segment can undercut; times in s.

    Attributes:
        lead: From t = 0 to the onset of the first transition.
        first: From its onset to its end.
        total: From t = 0 to its end.
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

    lead: arb
    first: arb
    total: arb
    again: arb
    melt: arb
    coast: Callable[[int], arb]
    freeze: Callable[[int, arb], arb]
    first_J: arb
    melt_J: arb
    hold_W: arb
    warm: arb
    longest: arb


def heat(problem: Problem, j: int) -> Heat:
    """Work out the least times of segment j (from 0)."""
    times, heater = problem.transition_times, problem.robot.heater
    soft, now = bool(problem.start_mode[j]), problem.temperatures[j]
    if type(times) is OverlappedTiming:
        full_W = arb(heater.melt_current_A) ** 2 * heater.resistance_ohm
        hold_W = arb(heater.hold_current_A) ** 2 * heater.resistance_ohm
        melting_C, melt_lead = (
            arb(heater.melting_point_C),
            arb(times.melt_s) - times.melt_changing_s,
        )
        coast = arb(times.freeze_s) - times.freeze_changing_s
        if soft:
            lead = coast * (now - melting_C) / (heater.soft_setpoint_C - melting_C)
        else:
            lead = melt_lead * (melting_C - now) / (melting_C - problem.ambient)
        melt, freeze = arb(times.melt_changing_s), arb(times.freeze_changing_s)
        share = times.superheat_s / (times.superheat_s + coast)
        return Heat(
            *(lead, freeze if soft else melt, arb(0), melt_lead, melt),
            *(lambda _: arb(0), lambda _k, _held: freeze),
            *((lead + melt) * full_W, (melt_lead + melt) * full_W, hold_W.min(share * full_W)),
            *(lead, coast),
        )
    model, window = segment_model(problem.robot, problem.ambient, j), EXACT
    if problem.transition_quantile is not None:
        ranges = tuple(problem.robot.thermal_segment(j).ranges.items())
        current, setpoint = heater.melt_current_A, heater.soft_setpoint_C
        window = windows(model, ranges, current, setpoint, problem.transition_quantile)
    if type(model) is Lumped:
        return _lumped(model, heater, now, window, soft=soft)
    if type(model) is TwoNode:
        return _two_node(model, heater.soft_setpoint_C, now, window, soft=soft)
    raise InputError("robot.segment.model", type(model).__name__, "lumped or two_node")


def _lumped(model: Lumped, heater: Heater, now: float, window: Windows, *, soft: bool) -> Heat:
    """One temperature: what is warmer stays warmer, and full current heats fastest."""
    air, melting, loss = arb(model.ambient_C), arb(model.melting_point_C), arb(model.loss_W_per_K)
    ohm = arb(heater.melt_current_A) ** 2 * model.resistance_ohm
    alpha, setpoint = model.temperature_coefficient_per_K, arb(heater.soft_setpoint_C)

    def rate(at: arb, on: bool) -> arb:
        return (ohm * (1 + alpha * (at - 25)) if on else 0) - loss * (at - air)

    def course(heat_J_per_K: float, since: arb, until: arb, on: bool) -> tuple[arb, arb]:
        """Time between two temperatures beside the plateau, and the heat given meanwhile."""
        slope, gained = (alpha * ohm if on else 0) - loss, heat_J_per_K * (until - since)
        first, last = rate(since, on), rate(until, on)
        if slope > 0 or slope < 0:
            time = heat_J_per_K / slope * (last / first).log()
            return time, gained + loss * (gained - rate(air, on) * time) / slope
        return gained / first.max(last), gained

    power = ohm * (1 + alpha * (melting - 25))
    frozen, molten = model.latent_J / (loss * (melting - air)), arb(model.latent_J)
    molten = molten / (power - loss * (melting - air))
    capacity = model.heat_liquid_J_per_K if soft else model.heat_solid_J_per_K
    lead, _ = course(capacity, arb(now), melting, not soft)
    warmest = arb(now).max(air).min(melting)
    warm, given = course(model.heat_solid_J_per_K, warmest, melting, on=True)
    late, early = window.melt_late, window.melt_early
    freeze = window.freeze_late * frozen
    if soft:
        lead, first = window.freeze_early * lead, freeze
        total = lead / window.freeze_early + freeze
    else:
        first, lead = late * molten + (late - early) * warm, early * lead
        total = lead + first

    def coasting(made: int) -> arb:
        """Cooling of metal that was heated on until the window of its melt ended."""
        liquid, heated = (
            model.heat_liquid_J_per_K,
            (late - 1) * (molten + (0 if made > 1 else warm)),
        )
        slope = alpha * ohm - loss
        if made == 0 or not heated > 0 or slope.contains(0):
            return arb(0)
        peak = melting + rate(melting, True) / slope * ((slope * heated / liquid).exp() - 1)
        return course(liquid, peak.min(setpoint), melting, on=False)[0]

    def freezing(made: int, _held: arb) -> arb:
        return freeze + (window.freeze_late - window.freeze_early) * coasting(made)

    hold_W = loss * (melting - air) if window == EXACT else arb(0)
    hottest = setpoint.max(arb(now))
    return Heat(
        *(lead, first, total, arb(0), late * molten),
        *(lambda made: window.freeze_early * coasting(made), freezing),
        *(given + power * molten, power * molten, hold_W),
        *(early * warm, course(model.heat_liquid_J_per_K, hottest, melting, on=False)[0]),
    )


def _two_node(model: TwoNode, setpoint: float, now: float, window: Windows, *, soft: bool) -> Heat:
    """A core and a body: of two states the one that is nowhere colder stays so."""
    a, beta, b = arb(model.coupling_per_s), arb(model.body_ratio), arb(model.body_loss_per_s)
    air, p, solid, liquid = (
        arb(value)
        for value in (model.ambient_C, model.power_K_per_s, model.solid_level, model.liquid_level)
    )
    middle = -(a + a / beta + b) / 2
    root = (middle**2 - a * b).sqrt()
    fast, slow, leave = middle - root, middle + root, a / beta

    def course(core: arb, body: arb, on: bool, t: Any) -> tuple[arb, arb, arb]:
        """Core, body and the rate of the core after a time at full power, or without."""
        body_end = air + (p / (beta * b) if on else 0)
        core_end = body_end + (p / a if on else 0)
        c, rate = core - core_end, (p if on else 0) - a * (core - body)
        c_fast, c_slow = (rate - slow * c) / (fast - slow), (fast * c - rate) / (fast - slow)
        f, s = c_fast * (fast * t).exp(), c_slow * (slow * t).exp()
        body_t = body_end + f * (1 + fast / a) + s * (1 + slow / a)
        return core_end + f + s, body_t, fast * f + slow * s

    def passed(core: arb, body: arb, on: bool, level: arb) -> arb:
        """A time before which the core does not pass a level: its rate changes sign but once."""
        sign, before, after = 1 if on else -1, 0.0, 1.0
        while after < 1e5 and sign * (level - course(core, body, on, after)[0]) > 0:
            before, after = after, 2 * after
        for _ in range(60):
            half = (before + after) / 2
            short = sign * (level - course(core, body, on, half)[0]) > 0
            before, after = (half, after) if short else (before, half)
        return arb(before if sign * course(core, body, on, before)[2] >= 0 else 0.0)

    def settled(core: arb) -> arb:
        return (leave * core + b * air) / (leave + b)

    start, cold, warm = arb(now), arb(now).min(air), arb(now).max(air).min(solid)
    hottest = start.max(settled(arb(setpoint).max(start).max(liquid)))
    body = hottest.min(solid)
    late, early = window.melt_late, window.melt_early
    lead, slowest = passed(warm, warm, True, solid), passed(cold, cold, True, solid) + 1e-6
    ends = [course(warm, warm, True, t)[1] for t in (lead, slowest)]
    sure = course(cold, cold, True, slowest)[0] >= solid
    first = passed(solid, ends[0].max(ends[1]).min(solid) if sure else solid, True, liquid)
    melt = passed(solid, body, True, liquid)
    shortest = passed(warm, warm, True, liquid), melt

    def coasting(made: int) -> arb:
        """Cooling of a core that was heated on until the window of its melt ended."""
        if made == 0 or late == 1:
            return arb(0)
        there = course(cold, cold, True, shortest[made > 1])[1].min(liquid)
        heated = ((late - 1) * shortest[made > 1]).min(passed(liquid, there, True, arb(setpoint)))
        core, there, _ = course(liquid, there, True, heated)
        return passed(core, there, False, liquid)

    def freeze(made: int, held: arb) -> arb:
        there, rest = course(cold, cold, True, shortest[made > 1])[1], settled(liquid)
        there = (rest + (there - rest) * (-(leave + b) * held).exp()).min(rest)
        window_s = (window.freeze_late - window.freeze_early) * coasting(made)
        return window.freeze_late * passed(liquid, there, False, solid) + window_s

    top, longest = arb(setpoint).max(start), arb(1e-3)  # by when the hottest surely is at liquid
    while not course(top, hottest, False, longest)[0] < liquid and longest < 1e6:
        longest = longest * 1.02

    full_W, hold_W = model.core_heat_J_per_K * p, model.core_heat_J_per_K * a * (liquid - hottest)
    given = (
        full_W * (lead + first),
        full_W * melt,
        hold_W.max(arb(0)) if window == EXACT else arb(0),
    )
    if soft:
        plateau = passed(liquid, start.min(settled(liquid)), False, solid)
        total = passed(start, start, False, solid) + (window.freeze_late - 1) * plateau
        lead = window.freeze_early * passed(start, start, False, liquid)
        first = window.freeze_late * plateau
    else:
        first = late * first + (late - early) * lead
        lead = early * passed(start, start, True, solid)
        total = passed(start, start, True, liquid)
    return Heat(
        *(lead, first, total, arb(0), late * melt),
        *(lambda made: window.freeze_early * coasting(made), freeze, *given),
        *(early * passed(warm, warm, True, solid), longest),
    )
