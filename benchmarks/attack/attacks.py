"""Random problems of which a plan is known, because the plan was made first."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from benchmarks.attack.heat import Constants, ConstantSegment, Heated, Metal, Policy, ThermalSegment
from benchmarks.attack.kinematics import Reference
from benchmarks.attack.motion import Phase, random_phase
from benchmarks.attack.schedule import Timeline, canonical, overlapping, waited_through
from benchmarks.thermal_scale import thermally_faster
from twosra_mpc import Goal, InputError, Problem, Robot, Start, load_robot
from twosra_mpc.problem.goals import Tolerance
from twosra_mpc.problem.tolerances import GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import Mode, ModeSequence
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming, Timing
from twosra_mpc.thermal.uncertainty import windows

TIMES = ("thermal", "constant", "paper")
_MISSED = "within the tolerance"  # of verification
_WARM_BELOW_K = 3.0  # a segment is kept warm as far below its threshold
_LIMITS_OF_PAPER = ("wheel_speed_rad_s", "unit_speed_m_s", "curvature_per_m", "unit_gap_m")


@dataclass(frozen=True)
class Attack:
    """A problem, and a plan of it that the planner did not make.

    Attributes:
        problem: The plan ends in its goal.
        phases: What happens, rigid phases of no length included that the search wants.
        timeline: When it happens.
        cost: What it costs [s].
        rounding: How much less it might cost but for rounding [s].
        features: What is special about it, in words.
    """

    problem: Problem
    phases: tuple[Phase, ...]
    timeline: Timeline
    cost: float
    rounding: float
    features: tuple[str, ...]

    @property
    def sequence(self) -> ModeSequence:
        """Mode of each phase."""
        return tuple(phase.mode for phase in self.phases)

    def slack(self, bound: float) -> float:
        """How far a bound is below what it costs, relative."""
        return (self.cost - bound) / max(self.cost, 1e-3)

    def bears(self, bound: float) -> bool:
        """Whether it does not contradict that no plan costs less."""
        return bound <= self.cost + self.rounding


def attack(seed: int, only: str | None = None, **also: Any) -> Attack:
    """The attack with this number, the same every time.

    Args:
        seed: The number.
        only: Its kind of times; any, unless told.
        also: Keys of its problem that are not left to chance.
    """
    rng = np.random.default_rng(seed)
    while True:
        try:
            found = _drawn(rng, only, also)
        except InputError:  # a problem that the package does not accept
            continue
        if found is not None:
            return found


def _drawn(rng: np.random.Generator, only: str | None, also: dict[str, Any]) -> Attack | None:
    drawn = TIMES[rng.choice(len(TIMES), p=[0.5, 0.3, 0.2])]
    times = only or drawn
    name = rng.choice(list(bodies()))
    robot, features = _heated(bodies()[name], times, rng)
    given = _asked(robot, times, rng) | also
    here = _start(robot, rng)
    first = Problem(**given, start=here, goal=Goal(x_m=0.0)).start_mode
    modes, sequence, last = _sequence(first, given, rng)
    reference = Reference(robot)
    phases, q = list[Phase](), here.configuration
    far = 10 ** rng.uniform(-2.0, 0.3)
    for mode in canonical(first, sequence, last, modes):
        rests = rng.random() < (0.1 if any(mode) else 0.4)
        phases.append(Phase(mode, q) if rests else random_phase(reference, q, mode, rng, far))
        q = phases[-1].end
    if "weights" in given and given["weights"]["effort"]:
        phases = [phase.slower(10 ** rng.uniform(0, 1)) for phase in phases]
    missed = rng.random() < 0.08
    if missed and rng.random() < 0.5:  # nothing moves
        phases, q = [Phase(phase.mode, here.configuration) for phase in phases], here.configuration
    goal, more = _goal(robot, q, last, missed, rng)
    length = len(phases) + int(rng.choice([0, 1, 3, -1], p=[0.4, 0.3, 0.2, 0.1]))
    given |= {"modes": modes, "max_phases": min(12, max(1, length))}
    problem = Problem(**given, start=here, goal=goal)
    if None in problem.start_stiffness:
        return None  # this account of heat begins with metal that is not changing
    kind = (times, str(name), *features, *_told(problem), *more)
    return attack_of(problem, tuple(phases), rng, kind)


def attack_of(
    problem: Problem, phases: tuple[Phase, ...], rng: np.random.Generator, features: tuple[str, ...]
) -> Attack | None:
    """The plan of these phases, each as soon as heaters and metal allow; None if they do not."""
    timeline = _timed(problem, phases, rng)
    if timeline is None:
        return None
    weights, effort = problem.cost_weights, sum(phase.effort_s for phase in phases)
    cost = timeline.finish_s + weights.energy_s_per_J * timeline.energy_J
    cost += weights.transition_s * len(timeline.items) + weights.effort * effort
    moving = sum(phase.duration_s for phase in phases)
    missed = 1e-4 * (1 + weights.effort) if _MISSED in features else 0.0  # less to drive
    rounding = 1e-9 + 1e-6 * cost + 2e-5 * moving + 1e-4 * weights.effort * effort + missed
    return Attack(problem, phases, timeline, cost, rounding, features)


@cache
def bodies() -> dict[str, Robot]:
    """Robots by what is special about their motion."""
    arc, paper, v2, three = map(load_robot, ("2sra-v1", "2sra-v1-paper", "2sr-v2", "3sra"))
    by_end = arc.path.with_values(speed_reference="fibre_end")
    corrected = paper.path.with_values(model="log_spiral_corrected")
    unequal = {"segments": 3, "segment_length_m": (0.03, 0.04, 0.05)}
    return {
        "arc": arc,
        "arc at once": _at_once(arc),
        "arc by fibre end": arc.with_values(path=by_end),
        "spiral": paper,
        "spiral corrected": paper.with_values(path=corrected),
        "cardioid": v2,
        "cardioid at once": _at_once(v2),
        "3 segments": three,
        "3 unequal at once": _at_once(
            three.with_values(geometry=three.geometry.with_values(**unequal))
        ),
        "1 segment": arc.with_values(geometry=arc.geometry.with_values(segments=1)),
    }


def _at_once(robot: Robot) -> Robot:
    """The robot without limits on acceleration, bending, driving and turning rates."""
    kept = {name: getattr(robot.limits, name) for name in _LIMITS_OF_PAPER}
    return robot.with_values(limits=type(robot.limits)(**kept))


def _heated(body: Robot, times: str, rng: np.random.Generator) -> tuple[Robot, tuple[str, ...]]:
    """The robot with melting and freezing times of its own."""
    faster = float(rng.choice([1.0, 10 ** rng.uniform(0, 2.7)]))
    features = (f"metal {'>100' if faster > 100 else '>10' if faster > 10 else '1 to 10'} x",)
    made: Timing
    if times == "thermal":
        source = load_robot(rng.choice(["2sra-v1", "2sr-v2"]))
        two_node = source.name == "2sr-v2"
        if two_node:
            share = rng.choice([1.0, rng.uniform(0.4, 0.9), rng.uniform(1.0, 2.0)])
            source = _faster_two_node(source, faster, float(share))
        elif faster > 1:
            source = thermally_faster(source, faster)
        kind = ("two-node",) if two_node else ("lumped",)
        made = ThermalTiming(overlap="thermal")
        heater = source.heater
        if rng.random() < 0.35:
            setpoint, current = rng.uniform(heater.soft_setpoint_C, 84.0), rng.uniform(0.6, 0.9)
            heater = heater.with_values(soft_setpoint_C=setpoint, melt_current_A=current)
        own = {"segment": source.segment, "heater": heater, "segments": ()}
        return body.with_values(**own, timing={"nominal": made}), (*kind, *features)
    if times == "constant":
        melting, freezing = 37.0, 235.0
        lead, coasting, superheat = 26.0, 18.0, 3.0
        if rng.random() < 0.6:
            lead, melting, coasting, freezing, superheat = 10 ** rng.uniform(0.5, 2.4, 5)
        made = OverlappedTiming(
            overlap="full",
            melt_s=(lead + melting) / faster,
            melt_changing_s=melting / faster,
            freeze_s=(coasting + freezing) / faster,
            freeze_changing_s=freezing / faster,
            superheat_s=superheat / faster,
        )
        return body.with_values(timing={"nominal": made}), features
    heat, freeze, reconfigure, cool = 100.0, 300.0, 502.0, 400.0
    if rng.random() < 0.6:
        heat, freeze, reconfigure = 10 ** rng.uniform(0.5, 2.7, 3)
        cool = reconfigure * rng.uniform(0.05, 0.95)
    made = SequentialTiming(
        overlap="none",
        heat_s=heat / faster,
        freeze_s=freeze / faster,
        reconfigure_s=reconfigure / faster,
        reconfigure_cool_s=cool / faster,
    )
    return body.with_values(timing={"nominal": made}), features


def _faster_two_node(robot: Robot, factor: float, power: float) -> Robot:
    segment = robot.segment
    names = ("power_K_per_s", "coupling_per_s", "body_loss_per_s")
    factors = dict.fromkeys(names, factor) | {"power_K_per_s": factor * power}
    values = {name: factors[name] * getattr(segment, name) for name in names}
    values["sensor_lag_s"] = segment.sensor_lag_s / factor
    ranges = {
        n: (factors[n] * a, factors[n] * b) for n, (a, b) in segment.ranges.items() if n in names
    }
    ranges["body_ratio"] = segment.ranges["body_ratio"]
    return robot.with_values(segment=segment.with_values(**values, ranges=ranges))


def _asked(robot: Robot, times: str, rng: np.random.Generator) -> dict[str, Any]:
    """Weights, air and heating policy."""
    count = robot.coordinates.segments
    asked: dict[str, Any] = {"robot": robot, "motion": "fastest"}
    if rng.random() < 0.5:
        some = rng.random(3) < 0.5
        energy, fixed, effort = (
            10 ** rng.uniform(-2, 1),
            rng.uniform(0, 100),
            10 ** rng.uniform(-1, 2),
        )
        asked["weights"] = {
            "energy_s_per_J": energy * some[0],
            "transition_s": fixed * some[1],
            "effort": effort * some[2],
        }
    if count > 1 and rng.random() < 0.3:
        asked["heaters_at_once"] = 1
    if rng.random() < 0.5:
        asked["ambient_C"] = rng.uniform(5.0, 40.0)
    asked["heating"] = rng.choice(["fastest", "least_energy"], p=[0.85, 0.15])
    if times == "thermal":
        if robot.segment is not None and robot.segment.ranges and rng.random() < 0.35:
            asked["transition_quantile"] = rng.uniform(0.5, 0.95)
        if rng.random() < 0.15:
            asked["heating"] = "keep_warm"
    return asked


def _start(robot: Robot, rng: np.random.Generator) -> Start:
    count, most = robot.coordinates.segments, robot.limits.curvature_per_m
    while True:
        kappa = rng.uniform(-0.7, 0.7, count) * most
        if rng.random() < 0.25:
            kappa = np.full(count, rng.choice([0.0, kappa[0]]))
        if Reference(robot).clear(kappa):
            break
    x, y, phi = rng.uniform([-0.2, -0.2, -3.0], [0.2, 0.2, 3.0])
    given: dict[str, Any] = {"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": tuple(kappa)}
    if rng.random() < 0.5:
        low, high = (5.0, 53.0) if rng.random() < 0.5 else (15.0, robot.heater.temperature_max_C)
        given["temperature_C"] = tuple(rng.uniform(low, high, count))
    return Start(**given)


def _sequence(
    first: Mode, given: dict[str, Any], rng: np.random.Generator
) -> tuple[tuple[Mode, ...], ModeSequence, Mode]:
    """(modes that may be used, modes of the phases, stiffness at the end)."""
    count = len(first)
    every = list(itertools.product((0, 1), repeat=count))
    some = [mode for mode in every if rng.random() < 0.6] if rng.random() < 0.35 else every
    modes = tuple(some or every)
    sequence: list[Mode] = []
    for _ in range(int(rng.choice([1, 2, 3, 4, 5], p=[0.2, 0.3, 0.25, 0.15, 0.1]))):
        rigid_again = not sequence and not any(first)
        left = [m for m in modes if m != (sequence[-1] if sequence else None)]
        left = [m for m in left if any(m) or not rigid_again] or left
        if left:
            sequence.append(left[rng.integers(len(left))])
    last = (0,) * count
    if rng.random() < 0.25:
        last = sequence[-1] if rng.random() < 0.8 else every[rng.integers(len(every))]
    return modes, tuple(sequence), last


def _goal(
    robot: Robot, q: Array, last: Mode, missed: bool, rng: np.random.Generator
) -> tuple[Goal, tuple[str, ...]]:
    """A goal that q (3 + n,) meets: exact, boxes about it, or free; or as good as met."""
    widths, features = np.zeros_like(q), list[str]()
    if missed:
        q = q + 0.9 * GOAL_TOLERANCE * rng.uniform(-1, 1, len(q))
    middle: list[float | None] = q.tolist()
    if rng.random() < 0.4:
        scale = robot.coordinates.each(0.05, 0.3, 5.0) * 10 ** rng.uniform(-2, 0)
        widths = scale * rng.random(len(q)) * (rng.random(len(q)) < 0.6)
        moved = q + 0.98 * widths * rng.uniform(-1, 1, len(q))
        most = robot.limits.curvature_per_m
        moved[POSE:] = np.clip(moved[POSE:], -most, most)
        middle, features = moved.tolist(), ["box"]
    if rng.random() < 0.35:
        free = rng.random(len(q)) < 0.4
        if free.any() and not free.all():
            middle = [None if left else value for left, value in zip(free, middle, strict=True)]
            features.append("free coordinates")
    if rng.random() < 0.3 and middle[2] is not None:
        middle[2] += 2 * np.pi * int(rng.integers(-1, 2)) if rng.random() < 0.5 else 0.0
    turned = middle[2] is not None and abs(middle[2] - q[2]) > np.pi
    x, y, phi, *kappa = middle
    goal = Goal(
        x_m=x,
        y_m=y,
        phi_rad=phi,
        kappa_per_m=tuple(kappa),
        tolerance=Tolerance.of(widths),
        mode=last,
        phi_modulo=bool(turned or rng.random() < 0.7),
    )
    kinds = {_MISSED: missed, "whole turns count": not goal.phi_modulo}
    return goal, (*(features or ["exact"]), *(name for name, holds in kinds.items() if holds))


def _timed(
    problem: Problem, phases: tuple[Phase, ...], rng: np.random.Generator
) -> Timeline | None:
    first = problem.start_mode
    modes = (first, *(phase.mode for phase in phases), problem.goal.mode)
    durations = [phase.duration_s for phase in phases]
    one_heater = problem.heaters_at_once == 1 and len(first) > 1
    times = problem.transition_times
    if isinstance(times, SequentialTiming):
        if one_heater and max(map(sum, modes)) > 1:
            return None
        return waited_through(times, _constants(problem), modes, durations)
    segments = [_segment(problem, j, rng) for j in range(len(first))]
    return overlapping(segments, modes, durations, one_heater, rng)


def _constants(problem: Problem) -> Constants:
    heater, times = problem.robot.heater, problem.transition_times
    powers = [i**2 * heater.resistance_ohm for i in (heater.melt_current_A, heater.hold_current_A)]
    if isinstance(times, OverlappedTiming):
        melting, freezing = times.melt_changing_s, times.freeze_changing_s
        leads = times.melt_s - melting, melting, times.freeze_s - freezing, freezing
        return Constants(*leads, times.superheat_s, *powers)
    return Constants(0.0, 0.0, 0.0, 0.0, 0.0, *powers)


def _segment(problem: Problem, j: int, rng: np.random.Generator) -> Heated:
    heater, air = problem.robot.heater, problem.ambient
    now, soft = problem.temperatures[j], bool(problem.start_mode[j])
    if isinstance(problem.transition_times, OverlappedTiming):
        times, melting = _constants(problem), heater.melting_point_C
        first = times.lead * (melting - now) / (melting - air)
        if soft:
            first = times.coasting * (now - melting) / (heater.soft_setpoint_C - melting)
        return ConstantSegment(j, times, first, soft)
    model = segment_model(problem.robot, air, j)
    metal = Metal(model)
    ranges = tuple(problem.robot.thermal_segment(j).ranges.items())
    current, setpoint = heater.melt_current_A, heater.soft_setpoint_C
    factors = windows(model, ranges, current, setpoint, problem.transition_quantile)
    warm = None
    if problem.heating == "keep_warm" and problem.heaters_at_once == len(problem.start_mode):
        warm = metal.temperature(metal.thresholds[0]) - _WARM_BELOW_K
        warm = warm if rng.random() < 0.7 else None
    state = (metal.level(now), now, 0.0)
    return ThermalSegment(j, metal, Policy(current, setpoint, *factors, warm), 0.0, state, soft)


def _told(problem: Problem) -> Iterator[str]:
    """What is special about a problem."""
    weights = problem.cost_weights
    yield from (name for name, value in weights if value)
    if problem.heaters_at_once == 1 and len(problem.start_mode) > 1:
        yield "one heater"
    if problem.transition_quantile is not None:
        yield "windows"
    if problem.heating == "keep_warm":
        yield "keep warm"
    if any(problem.start_mode):
        yield "soft at the start"
    elif any(abs(now - problem.ambient) > 1 for now in problem.temperatures):
        yield "warm or cold at the start"
    if any(problem.goal.mode):
        yield "soft at the end"
    if len(problem.modes) < 2 ** len(problem.start_mode):
        yield "some modes only"
