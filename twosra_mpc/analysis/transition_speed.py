"""The same problem with metal that freezes or melts more slowly, and what was changed for that.

Constant times are multiplied. Where times come from the segments, one physical cause is made weaker
until the reference transition takes as much longer: the flow of heat out of the metal for a freeze
from the soft set-point, the heater's power for a melt from the temperature of the air. The other
transitions then follow from the model, and change as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from scipy.optimize import brentq

from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.timing import Kind
from twosra_mpc.thermal.model import reference_times

_WEAKEST = 0.05  # share of heat loss or power below which no cause is looked for


def slowed(problem: Problem, kind: Kind, factor: float) -> tuple[Problem, str]:
    """Make every freeze (or melt) of ``problem`` ``factor`` times slower; say what was changed.

    Raises:
        InputError: If the metal would no longer melt or freeze, or the robot is no longer valid.
    """
    before = problem.transition_times
    if before.needs_segment:
        return _weakened(problem, kind, factor)
    after = before.slowed(kind, factor)
    timing = {**problem.robot.timing, problem.timing: after}
    words = [
        f"{key} {old:zg} -> {new:zg} s"
        for (key, old), (_, new) in zip(before, after, strict=True)
        if new != old
    ]
    robot = problem.robot.with_values(timing=timing)
    return problem.with_values(robot=robot), ", ".join(words)


def reference_s(robot: Robot, ambient_C: float, kind: Kind) -> float:
    """A freeze from the soft set-point, or a melt from the air's temperature [s]; inf if never.

    Of the segment that takes longest.
    """
    heater = robot.heater
    times = (
        reference_times(
            segment_model(robot, ambient_C, j), heater.melt_current_A, heater.soft_setpoint_C
        )
        for j in range(robot.coordinates.segments)
    )
    return max(one.melt_s if kind == "melt" else one.freeze_s for one in times)


def _weakened(problem: Problem, kind: Kind, factor: float) -> tuple[Problem, str]:
    robot, air = problem.robot, problem.ambient
    now = reference_s(robot, air, kind)

    def weaker(share: float) -> Robot:
        return robot.weakened("loss" if kind == "freeze" else "power", share)

    share = _share(lambda share: reference_s(weaker(share), air, kind) / now - factor)
    if share is None:
        raise InputError("factor", factor, f"one with which the segments of {robot.name} {kind}")
    other: Kind = "melt" if kind == "freeze" else "freeze"
    made = weaker(share)
    cause = "heat flow out of the metal" if kind == "freeze" else "heater power"
    effects = []
    for one in (kind, other):
        before, after = (reference_s(each, air, one) for each in (robot, made))
        still = math.isclose(before, after, rel_tol=1e-3)
        takes = (
            f"still takes {after:z.4g} s" if still else f"takes {after:z.4g} s, not {before:z.4g}"
        )
        effects.append(f"a {one} {takes}")
    return problem.with_values(robot=made), f"{cause} x {share:z.3g}: {'; '.join(effects)}"


def _share(excess: Callable[[float], float]) -> float | None:
    """The share at which ``excess``, which falls to below zero at 1, is zero; None if nowhere."""
    if excess(_WEAKEST) < 0:
        return None
    return float(brentq(lambda share: min(excess(share), 1.0), _WEAKEST, 1.0, xtol=1e-12))
