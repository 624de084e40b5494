"""From rest to rest: profiles against closed forms, limits at every instant, bounds with ramps."""

from __future__ import annotations

import math
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from once import planned, solved
from problems import ROBOT, at_once, exactly, guessed, network_of, random_problem

import twosra_mpc.planning.planner as planner_module
from twosra_mpc import Goal, Plan, Problem, Robot, Start, Status, load_problem, load_robot, plan
from twosra_mpc.effort import Ending
from twosra_mpc.model.bending import bending, from_rest_to_rest
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.relaxation import rigid_time
from twosra_mpc.planning.solver.fixed_sequence import INTERVALS, feasible_schedule, scheduled
from twosra_mpc.planning.solver.gentle import gentle
from twosra_mpc.planning.solver.guess import guess_motion
from twosra_mpc.plans.speed_profile import SpeedProfile, fastest
from twosra_mpc.problem.speeds import interval_durations, rigid_rows
from twosra_mpc.problem.tolerances import forgiven
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode

ARC = load_robot("2sra-v1")
LIMITS = ARC.limits
MOST = LIMITS.wheel_acceleration_rad_s2 or 0.0
EAGER = ARC.with_values(limits=LIMITS.with_values(control_period_s=None))


def drive(robot: Robot, twist: tuple[float, float, float]) -> Motion:
    """A rigid screw motion from a bent shape."""
    inputs = np.zeros((1, 4, 5))
    inputs[0, :, 2:] = np.array(twist) / 4
    return roll_out(robot, np.array([0.1, 0.0, 0.4, 20.0, -10.0]), (RIGID,), inputs)


def bend(robot: Robot, mode: Mode, kappa: tuple[float, float], change: float) -> Motion:
    """Both units bend a segment's W by so much, from a shape."""
    start = np.array([0.0, 0.0, 0.3, *kappa])
    goal = load_problem("paper-1", robot=robot).goal
    return guess_motion(robot, start, goal, (mode,), np.array([change]), INTERVALS)


twists = st.tuples(*(st.floats(-0.3, 0.3),) * 3).filter(lambda t: max(map(abs, t)) > 1e-3)
shapes = st.tuples(st.floats(-50, 50), st.floats(-50, 50))


@given(twist=twists)
def test_a_screw_motion_is_a_trapezoid(twist: tuple[float, float, float]) -> None:
    motion = drive(EAGER, twist)
    profile = fastest(motion)[0]
    at_speed = float(interval_durations(motion).sum())
    turns = kinematics(EAGER).wheel_matrix(motion.states[0, 0], RIGID).full()[:, 2:] @ twist
    ramp = np.abs(turns).max() / at_speed / MOST  # to the speed that some limit allows
    assert profile.duration_s == pytest.approx(from_rest_to_rest(at_speed, ramp), rel=1e-6)


@given(at_speed=st.floats(0.0, 100.0), ramp=st.floats(1e-3, 10.0))
def test_from_rest_to_rest_is_the_integral_of_the_speed(at_speed: float, ramp: float) -> None:
    total = from_rest_to_rest(at_speed, ramp)
    knots = np.array(sorted({0.0, min(ramp, total / 2), max(total - ramp, total / 2), total}))
    speed = np.minimum(1, np.minimum(knots / ramp, (total - knots) / ramp))
    assert np.trapezoid(speed, knots) == pytest.approx(at_speed, rel=1e-9, abs=1e-12)


@given(kappa=shapes, mode=st.sampled_from([SOFT_1, SOFT_2, SOFT_BOTH]), change=st.floats(-1, 1))
def test_a_bend_takes_its_bound_and_little_more(
    kappa: tuple[float, float], mode: Mode, change: float
) -> None:
    facts = bending(EAGER)
    profile = fastest(bend(EAGER, mode, kappa, change))[0]
    origin = [(w, w) for w in facts.coordinates(kappa)]
    least = facts.least_time(mode, origin, change)
    assert least <= profile.duration_s + 1e-6  # less than a micrometre rests
    if abs(change) > 0.05:
        assert profile.duration_s <= 1.02 * least + 0.6  # ramps up to the bending rate are free
    wide = [(w - 0.05, w + 0.05) for w, _ in origin]  # not known where it begins: no sharper
    assert facts.least_time(mode, wide, change) <= least + 1e-9


@pytest.mark.parametrize(
    ("name", "motion"),
    [("paper-1", "fastest"), ("move-and-shape", "gentle"), ("three-segments", "fastest")],
)
def test_limits_hold_and_no_wheel_jumps_at_any_instant(name: str, motion: str) -> None:
    made = planned(name, motion=motion)
    assert made.status is Status.OPTIMAL
    for phase in made.phases:
        t = np.linspace(phase.start_s, phase.end_s, 801)
        dt = t[1] - t[0]
        seen = made.trajectory.at(t)
        assert np.abs(seen.wheel_rad_s[[0, -1]]).max() <= MOST * dt
        assert np.abs(np.diff(seen.wheel_rad_s, axis=0)).max() <= 1.001 * MOST * dt
        assert np.abs(seen.wheel_rad_s).max() <= LIMITS.wheel_speed_rad_s * 1.001
        bent = np.diff(seen.q[:, 3:], axis=0) / dt * np.array(made.robot.geometry.lengths_m)
        assert np.abs(bent).max() <= 0.5 * 1.001
        moved = np.diff(seen.q[:, :3], axis=0) / dt
        if phase.mode == made.robot.rigid:
            assert np.hypot(*moved[:, :2].T).max() <= 0.05 * 1.001
            assert np.abs(moved[:, 2]).max() <= 0.3 * 1.001
        assert phase.end_s - phase.start_s >= 3 * (LIMITS.control_period_s or 0.0) - 1e-9


def test_where_the_path_turns_the_robot_stops() -> None:
    inputs = np.zeros((1, 2, 5))
    inputs[0, 0, 2] = inputs[0, 1, 3] = 0.05  # ahead, then sideways
    motion = roll_out(EAGER, np.zeros(5), (RIGID,), inputs)
    profile = fastest(motion)[0]
    corner = float(np.interp(1.0, profile.x, profile.time_s))
    parts = [drive_of(motion, k).duration_s for k in (0, 1)]
    assert [corner, profile.duration_s - corner] == pytest.approx(parts)
    assert profile.speed[np.searchsorted(profile.x, 1.0)] == 0.0


def drive_of(motion: Motion, interval: int) -> SpeedProfile:
    """Profile of one interval by itself."""
    inputs = motion.inputs[:, interval : interval + 1]
    return fastest(roll_out(motion.robot, motion.states[0, interval], (RIGID,), inputs))[0]


def test_a_phase_lasts_three_control_periods_unless_it_rests() -> None:
    tiny, still = (drive(ARC, (length, 0.0, 0.0)) for length in (1e-6, 0.0))
    assert fastest(tiny)[0].duration_s == pytest.approx(3 * (LIMITS.control_period_s or 0.0))
    assert fastest(still)[0].duration_s == 0.0


@settings(max_examples=20)
@given(seconds=st.floats(5.0, 500.0))
def test_a_slower_profile_goes_the_same_way_with_less_effort(seconds: float) -> None:
    profile = fastest(drive(ARC, (0.1, 0.05, -0.2)))[0]
    slower, factor = profile.lasting(seconds), seconds / profile.duration_s
    assert slower.duration_s == pytest.approx(seconds)
    assert slower.effort_s * factor == pytest.approx(profile.effort_s)
    assert slower.peak_rad_s * factor == pytest.approx(profile.peak_rad_s)
    dt = np.diff(slower.time_s)
    assert np.diff(slower.x) == pytest.approx(slower.speed * dt + slower.acceleration * dt**2 / 2)


def test_effort_and_peak_are_those_of_the_wheels() -> None:
    made = plan(exactly(load_problem("paper-2", motion="fastest"))).require()
    motion = guessed(made.problem, tuple(phase.mode for phase in made.phases), intervals=INTERVALS)
    for phase, profile in zip(made.phases, fastest(motion), strict=False):
        t = np.linspace(phase.start_s, phase.end_s, 1001)
        share = made.trajectory.at(t).wheel_rad_s / LIMITS.wheel_speed_rad_s
        assert profile.effort_s == pytest.approx(np.trapezoid((share**2).sum(axis=1), t), rel=1e-3)
        assert profile.peak_rad_s == pytest.approx(10 * np.abs(share).max(), rel=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_drive_turns_on_the_way_and_is_near_its_bound(seed: int) -> None:
    """It stops nowhere, keeps every limit, and leads to the goal as do its set-points."""
    problem = random_problem(seed, robot=ARC)
    goal = problem.goal.with_values(kappa_per_m=problem.start.kappa_per_m, tolerance="exact")
    problem = problem.with_values(goal=goal, motion="fastest")
    at_speed = rigid_time(problem.with_values(robot=at_once(ARC)))
    made = plan(problem).require()
    assert at_speed < rigid_time(problem) <= rigid_time(problem, math.inf) <= made.cost.total
    assert made.gap is not None
    assert made.gap < 0.08
    assert made.lower_bound >= forgiven(rigid_time(problem))
    t = np.linspace(0.0, made.duration_s, 2001)
    seen = made.trajectory.at(t)
    gained = np.abs(np.diff(seen.wheel_rad_s, axis=0)) / t[1]
    assert gained.max() <= MOST * (1 + 1e-6)
    assert np.abs(seen.wheel_rad_s[100:-100]).max(axis=1).min() > 0.5
    rows = rigid_rows(ARC, problem.start.kappa_per_m)
    assert np.abs(seen.v[:, 2:] @ rows.T).max() <= 1 + 1e-6
    middle = made.trajectory.at((t[1:] + t[:-1]) / 2)
    held = made.trajectory.held(15.0)
    for pose, twists, dt in (
        (seen.q[0, :3], middle.v[:, 2:], np.diff(t)),
        (held.q[0, :3], held.v[:-1, 2:], np.diff(held.t_s)),
    ):
        for (u, v, r), lasting in zip(twists, dt, strict=True):
            along = lasting * np.sinc(r * lasting / math.tau)
            ahead = pose[2] + r * lasting / 2
            c, s = math.cos(ahead), math.sin(ahead)
            way = np.array([(c * u - s * v) * along, (s * u + c * v) * along, r * lasting])
            pose = pose + way
        assert problem.goal.error(np.append(pose, goal.kappa_per_m)) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_random_problems_are_planned_within_the_gap(seed: int) -> None:
    problem = random_problem(seed, robot=ARC)
    made, quick = (plan(problem.with_values(motion=how)).require() for how in ("gentle", "fastest"))
    for each in (made, quick):
        assert each.status is Status.OPTIMAL
        assert each.gap is not None
        assert each.gap <= problem.gap
    assert quick.gap is not None
    assert quick.gap <= 3e-3
    assert quick.cost.total <= made.cost.total + 1e-9
    unlimited = plan(problem.with_values(robot=at_once(ARC))).require()
    assert unlimited.lower_bound is not None
    assert unlimited.lower_bound <= quick.cost.total


@pytest.mark.parametrize("width", [0.2, 1.0])
def test_a_shape_that_may_be_missed_by_a_little_is_bounded_as_well(width: float) -> None:
    base = exactly(load_problem("paper-1", motion="fastest"))
    tolerance = base.goal.tolerance.with_values(kappa_per_m=(width, width))
    problem = base.with_values(goal=base.goal.with_values(tolerance=tolerance), gap=1e-3)
    loose, exact = plan(problem).require(), plan(base).require()
    assert loose.gap is not None
    assert loose.gap <= 2e-3
    assert loose.lower_bound is not None
    assert exact.lower_bound is not None
    assert loose.lower_bound <= exact.lower_bound + 1e-9


# Gentle motion.


@pytest.mark.parametrize("name", ["paper-1", "paper-4", "shape-change"])
def test_gentle_motion_takes_less_effort_for_no_more_than_the_gap(name: str) -> None:
    problem = load_problem(name)
    quick, soft = (plan(problem.with_values(motion=how)).require() for how in ("fastest", "gentle"))
    assert [phase.mode for phase in soft.phases] == [phase.mode for phase in quick.phases]
    assert soft.lower_bound == quick.lower_bound
    assert soft.cost.total <= (soft.lower_bound or 0.0) / (1 - problem.gap) + 1e-9
    assert effort(soft) < 0.6 * effort(quick)
    for phase in soft.phases:
        seen = soft.trajectory.at(np.linspace(phase.start_s, phase.end_s, 200))
        assert np.abs(seen.wheel_rad_s).max() >= 0.95 * LIMITS.wheel_speed_min_rad_s


def effort(made: Plan) -> float:
    """Integral of the squared wheel speeds, trapezoidal."""
    samples = made.samples
    return float(np.trapezoid((samples.wheel_rad_s**2).sum(axis=1), samples.t_s))


@pytest.mark.parametrize("seed", range(3))
def test_no_other_durations_within_the_cost_take_less_effort(seed: int) -> None:
    """Random durations near the ones found: whatever the schedule allows is not better.

    The first drive must not last longer than found: it leaves a part of its time to spare.
    """
    problem = load_problem("paper-2")
    sequence = (RIGID, SOFT_1)
    network, motion = network_of(problem, sequence), guessed(problem, sequence, intervals=INTERVALS)
    candidate = scheduled(motion, network, problem, 0)
    assert candidate is not None
    most = 1.005 * float(candidate.times[network.layout.finish])
    found = gentle(problem, candidate, network, most)
    assert found is not None
    quickest = candidate.profiles
    best = sum(profile.effort_s for profile in found.profiles)
    rng = np.random.default_rng(seed)
    tried = 0
    for _ in range(60):
        factors = rng.uniform(0.8, 1.3, len(quickest))
        durations = np.array([p.duration_s for p in found.profiles]) * factors
        slower = [p.lasting(d) for p, d in zip(quickest, durations, strict=True)]
        if any(p.duration_s < q.duration_s for p, q in zip(slower, quickest, strict=True)):
            continue
        if durations[0] > found.profiles[0].duration_s:
            continue
        if any(p.peak_rad_s < LIMITS.wheel_speed_min_rad_s for p in slower):
            continue
        schedule = feasible_schedule(network, durations, problem)
        if schedule is None or schedule[0][network.layout.finish] > most:
            continue
        tried += 1
        assert sum(p.effort_s for p in slower) >= best * (1 - 1e-3)
    assert tried >= 3


def test_nothing_can_be_gained_where_no_time_is_left_and_wheels_crawl() -> None:
    limits = LIMITS.with_values(wheel_speed_min_rad_s=10.0)  # every phase is in the dead zone
    problem = load_problem("paper-2", robot=ARC.with_values(limits=limits))
    network, sequence = network_of(problem, (RIGID, SOFT_1)), (RIGID, SOFT_1)
    candidate = scheduled(guessed(problem, sequence, intervals=INTERVALS), network, problem, 0)
    assert candidate is not None
    assert gentle(problem, candidate, network, math.inf) is None


def test_a_robot_without_these_limits_plans_as_ever() -> None:
    problem = load_problem("paper-1", robot=ROBOT)
    soft, quick = (plan(problem.with_values(motion=how)).require() for how in ("gentle", "fastest"))
    assert soft.cost == quick.cost
    assert not soft.samples.a.any()


def test_a_long_sequence_of_short_phases_is_driven_gently_as_well() -> None:
    """Three short phases in nine minutes: what is minimised is scaled to the phases."""
    problem = load_problem("paper-1", heaters_at_once=1)
    quick, soft = (plan(problem.with_values(motion=how)).require() for how in ("fastest", "gentle"))
    assert effort(soft) < 0.6 * effort(quick)


def test_ctrl_c_while_a_plan_is_made_gentle_keeps_the_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = solved("paper-2", motion="fastest")
    monkeypatch.setattr(planner_module, "gentle", Mock(side_effect=KeyboardInterrupt))
    kept = planner_module.plan_until_interrupted(load_problem("paper-2"))
    assert kept.ending is Ending.INTERRUPTED
    assert kept.require().cost == quick.require().cost
    assert kept.lower_bound == quick.lower_bound


def test_the_time_that_planning_took_includes_making_it_gentle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 0.0

    def long_work(*_: object) -> None:
        nonlocal now
        now += 100.0

    monkeypatch.setattr(planner_module, "time", SimpleNamespace(perf_counter=lambda: now))
    monkeypatch.setattr(planner_module, "gentle", long_work)
    assert plan(load_problem("paper-2")).stats.wall_s >= 100.0


def test_a_problem_says_how_it_moves() -> None:
    assert Problem.model_fields["motion"].default == "gentle"
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    goal = {"kappa_per_m": [20.0, 0.0]}
    with pytest.raises(ValueError, match=r"motion = 'slow'.*'gentle' or 'fastest'"):
        Problem(robot=ARC, start=start, goal=goal, motion="slow")  # type: ignore[arg-type]


def test_only_robots_that_ramp_need_three_periods_for_a_phase() -> None:
    """A robot whose wheels may jump moves for as short as it likes, and the bounds know it."""
    limits = at_once(ARC).limits.with_values(control_period_s=0.5)
    robot = at_once(ARC).with_values(limits=limits)
    start, goal = ({"kappa_per_m": (k, k)} for k in (0.0, 2.0))
    problem = Problem(
        robot=robot,
        start=Start(x_m=0.0, y_m=0.0, phi_rad=0.0, **start),
        goal=Goal(**goal, tolerance="exact"),
        timing="constant",
    )
    made = plan(problem).require()
    assert made.lower_bound is not None
    assert made.lower_bound <= made.cost.total
    assert limits.phase_s == 0.0
    assert LIMITS.phase_s == pytest.approx(3 * (LIMITS.control_period_s or 0.0))
