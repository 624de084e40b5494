"""The same problem with metal that freezes or melts more slowly, and what was changed for that.

Constant times are multiplied. With a thermal timing one physical cause is made weaker until the
reference transition takes as much longer: the flow of heat out of the metal for a freeze from the
soft set-point, the heater's power for a melt from the temperature of the air. The other transitions
then follow from the model, and change as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal, TypeVar

from scipy.optimize import brentq

from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.segment import LumpedSegment, TwoNodeSegment
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming
from twosra_mpc.thermal.model import segment_model
from twosra_mpc.validation import Value

Kind = Literal["freeze", "melt"]
Record = TypeVar("Record", bound=Value)

_WEAKEST = 0.05  # share of heat loss or power below which no cause is looked for


def slowed(problem: Problem, kind: Kind, factor: float) -> tuple[Problem, str]:
    """Make every freeze (or melt) of ``problem`` ``factor`` times slower; say what was changed.

    Raises:
        InputError: If the metal would no longer melt or freeze, or the robot is no longer valid.
    """
    match problem.transition_times:
        case OverlappedTiming() as times:
            keys = [f"{kind}_s", f"{kind}_changing_s"]
            return _constant(problem, {key: factor * getattr(times, key) for key in keys})
        case SequentialTiming() as times:
            return _constant(problem, _slower_sleeps(times, kind, factor))
        case ThermalTiming():
            return _weakened(problem, kind, factor)


def reference_s(robot: Robot, ambient_C: float, kind: Kind) -> float:
    """A freeze from the soft set-point, or a melt from the air's temperature [s]; inf if never."""
    model, heater = segment_model(robot, ambient_C), robot.heater
    cold = model.initial(ambient_C)
    if kind == "melt":
        return model.time_until(cold, heater.melt_current_A, model.liquid_level)
    level = model.level_at(heater.soft_setpoint_C)
    heating = model.time_until(cold, heater.melt_current_A, level)
    if heating == math.inf:
        return math.inf
    hot = model.propagate(cold, heater.melt_current_A, heating)
    return model.time_until(hot, 0.0, model.solid_level)


def _slower_sleeps(times: SequentialTiming, kind: Kind, factor: float) -> dict[str, float]:
    cool, heat = times.reconfigure_cool_s, times.reconfigure_s - times.reconfigure_cool_s
    if kind == "freeze":
        return {
            "freeze_s": factor * times.freeze_s,
            "reconfigure_cool_s": factor * cool,
            "reconfigure_s": factor * cool + heat,
        }
    return {"heat_s": factor * times.heat_s, "reconfigure_s": cool + factor * heat}


def _constant(problem: Problem, values: dict[str, float]) -> tuple[Problem, str]:
    times = problem.transition_times
    timing = {**problem.robot.timing, problem.timing: _with(times, values)}
    words = [f"{key} {getattr(times, key):g} -> {value:g} s" for key, value in values.items()]
    return problem.with_robot(_with(problem.robot, {"timing": timing})), ", ".join(words)


def _weakened(problem: Problem, kind: Kind, factor: float) -> tuple[Problem, str]:
    robot, air = problem.robot, problem.ambient
    weaker = _less_loss if kind == "freeze" else _less_power
    now = reference_s(robot, air, kind)
    share = _share(lambda s: reference_s(weaker(robot, s), air, kind) / now - factor)
    if share is None:
        raise InputError("factor", factor, f"one with which the segments of {robot.name} {kind}")
    other: Kind = "melt" if kind == "freeze" else "freeze"
    made = weaker(robot, share)
    cause = "heat flow out of the metal" if kind == "freeze" else "heater power"
    effects = []
    for one in (kind, other):
        before, after = (reference_s(each, air, one) for each in (robot, made))
        still = math.isclose(before, after, rel_tol=1e-3)
        takes = f"still takes {after:.4g} s" if still else f"takes {after:.4g} s, not {before:.4g}"
        effects.append(f"a {one} {takes}")
    return problem.with_robot(made), f"{cause} x {share:.3g}: {'; '.join(effects)}"


def _share(excess: Callable[[float], float]) -> float | None:
    """The share at which ``excess``, which falls to below zero at 1, is zero; None if nowhere."""
    if excess(_WEAKEST) < 0:
        return None
    return float(brentq(lambda share: min(excess(share), 1.0), _WEAKEST, 1.0, xtol=1e-12))


def _less_loss(robot: Robot, share: float) -> Robot:
    segment = robot.segment
    assert segment is not None, "a thermal timing has a segment"
    if isinstance(segment, LumpedSegment):
        keys = ["convection_W_per_m2_K", "end_loss_W_per_K"]
        parameters = ["loss_W_per_K"]
    else:  # to the body and on to the air: both, or the body alone would do the cooling
        keys = parameters = ["coupling_per_s", "body_loss_per_s"]
    values = {key: share * getattr(segment, key) for key in keys}
    ranges = _ranges(segment, parameters, share)
    return _with(robot, {"segment": _with(segment, {**values, "ranges": ranges})})


def _less_power(robot: Robot, share: float) -> Robot:
    segment, heater = robot.segment, robot.heater
    if isinstance(segment, TwoNodeSegment):  # full power is at the melt current, whatever that is
        power = share * segment.power_K_per_s
        ranges = _ranges(segment, ["power_K_per_s"], share)
        return _with(robot, {"segment": _with(segment, {"power_K_per_s": power, "ranges": ranges})})
    current = math.sqrt(share) * heater.melt_current_A
    hold = min(heater.hold_current_A, current)
    return _with(
        robot,
        {"heater": _with(heater, {"melt_current_A": current, "hold_current_A": hold})},
    )


def _ranges(
    segment: LumpedSegment | TwoNodeSegment, parameters: list[str], share: float
) -> dict[str, tuple[float, float]]:
    """The ranges of the segment's parameters, those of the changed ones scaled."""
    return {
        name: (share * low, share * high) if name in parameters else (low, high)
        for name, (low, high) in segment.ranges.items()
    }


def _with(record: Record, values: dict[str, Any]) -> Record:
    """Return the record with these values, validated anew."""
    return type(record)(**{**dict(record), **values})
