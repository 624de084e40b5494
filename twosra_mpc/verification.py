"""Independent check of a plan: SciPy re-integrates it, and every rule is tested on the outcome.

Nothing here uses the transcription, the roll-out or the schedule: only the samples and transitions
as they will be written to the file, the kinematics, and the robot description.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from twosra_mpc.model.kinematics import JacobianInPlace
from twosra_mpc.modes import mode_name
from twosra_mpc.plan import Phase, Samples, Verification
from twosra_mpc.problem import COORDINATE_UNITS, COORDINATES, Problem
from twosra_mpc.robot import OverlappedTiming, SequentialTiming
from twosra_mpc.shape import shape_margins
from twosra_mpc.timing import Transition

Array = NDArray[np.float64]

GOAL_TOLERANCE = 1e-6  # m, rad, 1/m
DEFECT_TOLERANCE = 1e-6  # m, rad, 1/m
TIME_TOLERANCE_S = 1e-5
RELATIVE_TOLERANCE = 1e-7  # of a limit
_RTOL, _ATOL = 1e-10, 1e-12


def verify(
    problem: Problem,
    samples: Samples,
    phases: Sequence[Phase],
    transitions: Sequence[Transition],
) -> Verification:
    """Re-integrate a plan and check limits, transitions and goal."""
    reached = reintegrate(problem, samples)
    defect = float(np.abs(reached - samples.q).max())
    goal_error = problem.goal.error(reached[-1].copy())
    limits = _margins(problem, samples)
    problems = [
        *_motion_problems(defect, goal_error),
        *(f"limit {name} exceeded by {-m:.3g}" for name, m in limits.items() if m < 0),
        *_stiffness_problems(problem, samples, transitions),
        *_timing_problems(problem, phases, transitions),
    ]
    if not problems and not np.isfinite(samples.q).all():
        problems.append("a sample is not finite")
    return Verification(
        max_defect=defect,
        goal_error=tuple(float(error) for error in goal_error),
        limits=limits,
        ok=not problems,
        problems=tuple(problems),
    )


def reintegrate(problem: Problem, samples: Samples) -> Array:
    """Integrate q' = J(q, mode) v over the samples from the start configuration, (n, 5).

    Adaptive Dormand-Prince 8(5,3), relative tolerance 1e-10, restarted where the input changes.
    """
    jacobian = JacobianInPlace(problem.robot)
    q = problem.start.configuration.copy()
    reached = [q]
    for i in range(len(samples) - 1):
        velocity = samples.v[i]
        if velocity.any():
            jacobian.sigma[:] = samples.mode[i]

            def rate(_t: float, at: Array, velocity: Array = velocity) -> Array:
                jacobian.q[:] = at
                jacobian.evaluate()
                return velocity @ jacobian.columns

            span = (0.0, float(samples.t_s[i + 1] - samples.t_s[i]))
            end = solve_ivp(rate, span, q, method="DOP853", rtol=_RTOL, atol=_ATOL)
            q = end.y[:, -1]
        reached.append(q)
    return np.array(reached)


def _motion_problems(defect: float, goal_error: Array) -> Iterator[str]:
    if not defect <= DEFECT_TOLERANCE:
        yield f"re-integration departs from the samples by {defect:.3g} (m, rad or 1/m)"
    for name, unit, error in zip(COORDINATES, COORDINATE_UNITS, goal_error, strict=True):
        if not abs(error) <= GOAL_TOLERANCE:
            yield f"goal.{name} is missed by {error:.3g} {unit}"


def _margins(problem: Problem, samples: Samples) -> dict[str, float]:
    """Distance to each limit; rounding at an active limit counts as zero."""
    limits, heater = problem.robot.limits, problem.robot.heater
    used = {
        "wheel_speed_rad_s": (np.abs(samples.wheel_rad_s).max(), limits.wheel_speed_rad_s),
        "unit_speed_m_s": (np.abs(samples.v[:, :2]).max(), limits.unit_speed_m_s),
        "curvature_per_m": (np.abs(samples.q[:, 3:]).max(), limits.curvature_per_m),
        "temperature_max_C": (samples.temperature_C.max(), heater.temperature_max_C),
        "heater_current_A": (samples.heater_current_A.max(), heater.current_max_A),
    }
    margins = {}
    for name, (value, limit) in used.items():
        margin = float(limit - value)
        margins[name] = 0.0 if abs(margin) <= RELATIVE_TOLERANCE * limit else margin
    between = (samples.q[1:, 3:] + samples.q[:-1, 3:]) / 2
    shapes = shape_margins(problem.robot, np.concatenate([samples.q[:, 3:], between]))
    margins["unit_gap_m"] = float(shapes.unit_gap_m.min())
    driving = (np.abs(samples.v[:, 2:]).max(axis=1) > 0).nonzero()
    independence = shapes.wheel_independence[: len(samples)][driving]
    margins["wheel_independence"] = float(independence.min(initial=np.inf))
    return {name: margin for name, margin in margins.items() if np.isfinite(margin)}


def _stiffness_problems(
    problem: Problem, samples: Samples, transitions: Sequence[Transition]
) -> Iterator[str]:
    """Moving needs every segment to be what the mode says, and none to be changing."""
    moving = np.flatnonzero(np.abs(samples.v).max(axis=1) > 0)
    if len(moving) and moving[-1] == len(samples) - 1:
        yield "the last sample still moves"
        return
    begin, end = samples.t_s[moving], samples.t_s[moving + 1]
    for j in (0, 1):
        soft = np.full(len(moving), problem.start_mode[j])
        for item in (item for item in transitions if item.segment == j + 1):
            soft[begin >= item.done_s - TIME_TOLERANCE_S] = item.to == "soft"
            clash = (begin < item.done_s - TIME_TOLERANCE_S) & (
                end > item.onset_s + TIME_TOLERANCE_S
            )
            if clash.any():
                yield (
                    f"the robot moves at {begin[clash][0]:.3f} s while segment {j + 1} is changing"
                )
        wrong = soft != samples.mode[moving, j]
        if wrong.any():
            row = moving[np.flatnonzero(wrong)[0]]
            mode = mode_name((int(samples.mode[row, 0]), int(samples.mode[row, 1])))
            when = f"at {samples.t_s[row]:.3f} s"
            yield f"{when} the mode is {mode} but segment {j + 1} is not so yet"
    rigid = samples.mode[moving].max(axis=1, initial=0) == 0
    if samples.v[moving][rigid][:, :2].any() or samples.v[moving][~rigid][:, 2:].any():
        yield "an input acts that the mode does not have"


def _timing_problems(
    problem: Problem, phases: Sequence[Phase], transitions: Sequence[Transition]
) -> Iterator[str]:
    """Order and duration of the transitions of each segment, and the stiffness at the end."""
    for before, after in itertools.pairwise(phases):
        if after.start_s < before.end_s - TIME_TOLERANCE_S:
            yield f"the phase at {after.start_s:.3f} s starts before the one before it has ended"
    for j in (0, 1):
        stiffness, free = problem.start_mode[j], 0.0
        for item in (item for item in transitions if item.segment == j + 1):
            name = f"segment {j + 1} to {item.to} at {item.heater_s:.3f} s"
            if (item.to == "soft") == bool(stiffness):
                yield f"{name}: it is {item.to} already"
            if item.heater_s < free - TIME_TOLERANCE_S:
                yield f"{name}: before the transition before it is done"
            if not item.heater_s - TIME_TOLERANCE_S <= item.onset_s <= item.done_s:
                yield f"{name}: heater, onset and done are out of order"
            found = _duration_problems(problem, item, None if free == 0 else free)
            yield from (f"{name}: {text}" for text in found)
            stiffness, free = int(item.to == "soft"), item.done_s
        if stiffness != problem.goal.mode[j]:
            wanted = "soft" if problem.goal.mode[j] else "rigid"
            yield f"segment {j + 1} does not end {wanted}"


def _duration_problems(
    problem: Problem, item: Transition, previous_s: float | None
) -> Iterator[str]:
    """``previous_s`` is when the transition before it was done, None for a segment's first one."""
    times, heater = problem.transition_times, problem.robot.heater
    lead, changing = item.onset_s - item.heater_s, item.done_s - item.onset_s
    match times:
        case OverlappedTiming():
            soft = item.to == "soft"
            plateau = times.melt_changing_s if soft else times.freeze_changing_s
            if changing < plateau - TIME_TOLERANCE_S:
                yield f"on the plateau for {changing:.3f} s instead of {plateau:g} s"
            if soft:
                least = times.melt_s - times.melt_changing_s
                if previous_s is None:
                    now = problem.temperatures[item.segment - 1]
                    span = heater.melting_point_C - heater.ambient_C
                    least *= (heater.melting_point_C - now) / span
                if lead < least - TIME_TOLERANCE_S:
                    yield f"heated for {lead:.3f} s before melting instead of {least:.3f} s"
                return
            stored = 1.0
            if previous_s is not None:
                stored = min(1.0, (item.heater_s - previous_s) / times.superheat_s)
            if lead > stored * (times.freeze_s - times.freeze_changing_s) + TIME_TOLERANCE_S:
                yield f"liquid for {lead:.3f} s after its heater is off: it would freeze earlier"
        case SequentialTiming():
            least = times.heat_s if item.to == "soft" else times.freeze_s
            if lead + changing < min(least, times.reconfigure_cool_s) - TIME_TOLERANCE_S:
                yield f"changes in {lead + changing:.3f} s instead of {least:g} s"
