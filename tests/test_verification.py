"""The independent check: planner's plans pass it, and every way to spoil a plan is found."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from once import planned
from problems import at_once
from scipy.integrate import solve_ivp

from twosra_mpc import Plan, Problem, Robot, load_problem, load_robot, plan
from twosra_mpc.checking.reintegration import between, paths, reintegrate
from twosra_mpc.checking.verification import verify
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.plans.plan import Verification
from twosra_mpc.plans.trajectory import Phase, Samples, Trajectory
from twosra_mpc.problem.limits import shape_margins
from twosra_mpc.robot.coordinates import Coordinates
from twosra_mpc.robot.modes import MODES, Mode, mode_name
from twosra_mpc.robot.timing import SequentialTiming
from twosra_mpc.timing import Transition

COORDINATES = Coordinates(2).names
Array = NDArray[np.float64]
TIMINGS = ["nominal", "constant", "paper"]


@dataclass(frozen=True)
class Case:
    """Everything the check looks at."""

    problem: Problem
    samples: Samples
    phases: tuple[Phase, ...]
    transitions: tuple[Transition, ...]

    def check(self) -> Verification:
        return verify(Trajectory(self.problem, self.samples, self.phases, self.transitions))

    def first_moving(self, *, soft: bool) -> int:
        """Row of the first sample that moves in a soft mode, or rigidly."""
        moving = self.samples.v.any(axis=1) & (self.samples.mode.any(axis=1) == soft)
        return int(np.flatnonzero(moving)[0])

    def set(self, name: str, row: int, column: int, value: float) -> Case:
        """The same with one number of the samples changed."""
        array = getattr(self.samples, name).copy()
        array[row, column] = value
        return replace(self, samples=replace(self.samples, **{name: array}))

    def scaled(self, name: str, factor: float) -> Case:
        """The same with a list of samples scaled."""
        array = getattr(self.samples, name) * factor
        return replace(self, samples=replace(self.samples, **{name: array}))

    def find(self, segment: int, to: str) -> int:
        """Number of the first transition of a segment to a stiffness."""
        return next(
            i for i, item in enumerate(self.transitions) if (item.segment, item.to) == (segment, to)
        )

    def move(self, segment: int, to: str, **by_s: float) -> Case:
        """The same with times of the first such transition shifted."""
        i = self.find(segment, to)
        item = self.transitions[i]
        changed = item._replace(**{name: getattr(item, name) + s for name, s in by_s.items()})
        return self.with_transitions([*self.transitions[:i], changed, *self.transitions[i + 1 :]])

    def without(self, segment: int, to: str) -> Case:
        """The same without the first such transition."""
        i = self.find(segment, to)
        return self.with_transitions([*self.transitions[:i], *self.transitions[i + 1 :]])

    def with_transitions(self, transitions: Sequence[Transition]) -> Case:
        return replace(self, transitions=tuple(transitions))

    def with_robot(self, **update: Any) -> Case:
        """The same checked against another robot, be the problem possible for it or not."""
        robot = self.problem.robot.model_copy(update=update)
        return replace(self, problem=self.problem.model_copy(update={"robot": robot}))


def case_of(some: Plan) -> Case:
    """What the check looks at, of a plan."""
    return Case(some.problem, some.samples, some.phases, some.transitions)


@pytest.fixture(scope="module")
def case(request: pytest.FixtureRequest) -> Case:
    """Optimal plan of paper-1, met exactly; its timing is the parameter."""
    return case_of(planned("paper-1", exact=True, timing=request.param))


all_timings = pytest.mark.parametrize("case", TIMINGS, indirect=True)
nominal_only = pytest.mark.parametrize("case", ["nominal"], indirect=True)
constant_only = pytest.mark.parametrize("case", ["constant"], indirect=True)
paper_only = pytest.mark.parametrize("case", ["paper"], indirect=True)


def assert_found(spoilt: Case, *patterns: str) -> None:
    """The check fails and says these things (patterns, in any order)."""
    result = spoilt.check()
    assert not result.ok
    for pattern in patterns:
        assert any(re.search(pattern, problem) for problem in result.problems), (
            pattern,
            result.problems,
        )


# --- plans that hold -----------------------------------------------------------------------------


def test_plans_of_both_planners_hold_with_all_timings(any_plan: Plan) -> None:
    result = case_of(any_plan).check()
    assert result.ok
    assert result.problems == ()
    assert result.max_defect <= 1e-6
    assert np.abs(result.goal_error).max() <= 1e-6
    assert all(margin >= 0.0 for margin in result.limits.values())
    assert result == any_plan.verification


def test_reintegration_agrees_with_scipy(any_plan: Plan) -> None:
    """Also where a spiral passes its kink, at kappa = 0."""
    samples, q = any_plan.samples, any_plan.problem.start.configuration
    reached = reintegrate(any_plan.problem, samples)
    jacobian = kinematics(any_plan.robot).jacobian
    for first, last, way, lengths in paths(samples):
        if way.any():
            q = solve_ivp(
                lambda s, at, mode, way: jacobian(at, mode).full() @ (way[0] + s * way[1]),
                (0.0, float(lengths.sum())),
                q,
                method="DOP853",
                rtol=1e-12,
                atol=1e-14,
                args=(samples.mode[first], way),
            ).y[:, -1]
        assert reached[last] == pytest.approx(q, abs=5e-9)


def test_many_samples_within_a_step_are_where_few_are(any_plan: Plan) -> None:
    problem, samples = any_plan.problem, any_plan.samples
    dt = np.diff(samples.t_s)[:, None]
    moved = np.abs((samples.v[:-1] + samples.a[:-1] * dt / 2) * dt).max(axis=1)
    for least in (0, 1):
        fine, at = between(samples, 1e-4, least)
        assert (np.bincount(at)[:-1] >= np.maximum(moved / 1e-4 + least, 1)).all()
    first = np.searchsorted(at, np.arange(len(samples)))
    reached = reintegrate(problem, samples)
    assert reintegrate(problem, fine)[first] == pytest.approx(reached, abs=1e-9)


def test_margins_are_the_distance_to_each_limit(any_plan: Plan) -> None:
    samples, robot = any_plan.samples, any_plan.robot
    margins = any_plan.verification.limits
    jacobian = kinematics(robot).jacobian
    bending = [
        (jacobian(q, mode) @ v).full().ravel()[3:] * robot.geometry.segment_length_m
        for q, v, mode in zip(samples.q, samples.v, samples.mode, strict=True)
    ]
    expected = {
        "wheel_speed_rad_s": robot.limits.wheel_speed_rad_s - np.abs(samples.wheel_rad_s).max(),
        "unit_speed_m_s": robot.limits.unit_speed_m_s - np.abs(samples.v[:, :2]).max(),
        "bend_rate_rad_s": robot.limits.bend_rate_rad_s - np.abs(bending).max(),
        "turn_rate_rad_s": robot.limits.turn_rate_rad_s - np.abs(samples.v[:, 4]).max(),
        "curvature_per_m": robot.limits.curvature_per_m - np.abs(samples.q[:, 3:]).max(),
        "temperature_max_C": robot.heater.temperature_max_C - samples.temperature_C.max(),
        "heater_current_A": robot.heater.current_max_A - samples.heater_current_A.max(),
    }
    assert {name: margins[name] for name in expected} == pytest.approx(expected, abs=2e-6)
    assert set(margins) - set(expected) == {
        "body_gap_m",
        *(
            "bend_lever",
            "unit_gap_m",
            "wheel_independence",
            "speed_m_s",
            "wheel_acceleration_rad_s2",
        ),
    }
    driven = float(np.hypot(samples.v[:, 2], samples.v[:, 3]).max())
    counted = robot.limits.speed_m_s - margins["speed_m_s"]  # along eight axes
    assert driven - 1e-9 <= counted <= driven / np.cos(np.pi / 16) + 1e-9
    shapes = shape_margins(robot, samples.q[:, 3:])
    for name in ("unit_gap_m", "body_gap_m"):
        assert margins[name] <= shapes[name].min()
    driving = samples.v[:, 2:].any(axis=1)
    assert margins["wheel_independence"] == shapes["wheel_independence"][driving].min()


@all_timings
def test_rounding_at_an_active_limit_is_no_violation(case: Case) -> None:
    fastest = np.abs(case.samples.wheel_rad_s).max()
    row, column = np.argwhere(np.abs(case.samples.wheel_rad_s) == fastest)[0]
    at_limit = case.set("wheel_rad_s", row, column, 10.0 * (1 + 5e-8)).check()
    assert at_limit.limits["wheel_speed_rad_s"] == 0.0
    assert "exceeded" not in " ".join(at_limit.problems)


# --- the motion ----------------------------------------------------------------------------------


@all_timings
@pytest.mark.parametrize("coordinate", range(5))
@pytest.mark.parametrize("by", [2e-6, -1e-3])
def test_a_shifted_configuration_is_found(case: Case, coordinate: int, by: float) -> None:
    row = len(case.samples) // 2
    before = case.samples.q[row, coordinate]
    spoilt = case.set("q", row, coordinate, before + by)
    assert_found(spoilt, "re-integration departs from the samples")
    assert spoilt.check().max_defect == pytest.approx(abs(by), abs=1e-6)


@all_timings
def test_scaled_inputs_are_found(case: Case) -> None:
    slower = case.scaled("v", 0.99)
    departs = "re-integration departs from the samples"
    assert_found(slower, departs, *(f"goal.{name} is missed by" for name in COORDINATES))


@all_timings
def test_an_input_that_the_mode_does_not_have_is_found(case: Case) -> None:
    words = "an input acts that the mode does not have"
    rigid, soft = case.first_moving(soft=False), case.first_moving(soft=True)
    for column in (0, 1):
        assert_found(case.set("v", rigid, column, 1e-3), words)
    for column in (2, 3, 4):
        assert_found(case.set("v", soft, column, 1e-3), words)


@all_timings
def test_a_last_sample_that_moves_is_found(case: Case) -> None:
    for column in range(5):
        assert_found(case.set("v", -1, column, 1e-3), "the last sample still moves")


@all_timings
@pytest.mark.parametrize(
    ("name", "unit"),
    list(zip(COORDINATES, ("m", "m", "rad", "1/m", "1/m"), strict=True)),
    ids=COORDINATES,
)
def test_a_goal_missed_in_any_coordinate_is_found(case: Case, name: str, unit: str) -> None:
    key, _, entry = name.partition(".")
    goal = case.problem.goal
    value = getattr(goal, key)
    if entry:
        moved: object = tuple(k - 0.01 * (i == int(entry)) for i, k in enumerate(value))
    else:
        moved = value - 0.01
    asked = goal.model_dump() | {key: moved}
    problem = case.problem.with_values(goal=asked)
    assert_found(
        replace(case, problem=problem), f"^{re.escape(f'goal.{name} is missed by 0.01 {unit}')}$"
    )


@all_timings
def test_a_goal_box_forgives_what_lies_inside(case: Case) -> None:
    goal = case.problem.goal.model_dump() | {"x_m": 0.245, "tolerance": {"x_m": 0.006}}
    inside = case.problem.with_values(goal=goal)
    assert replace(case, problem=inside).check().ok
    goal["tolerance"] = {"x_m": 0.004}
    outside = case.problem.with_values(goal=goal)
    assert_found(replace(case, problem=outside), "goal.x_m is missed by -0.001 m")


# --- steady speeds -------------------------------------------------------------------------------


TURNS = "^at {} s the input changes its direction on the way$"


def middle_of(case: Case, phase: int) -> int:
    """The row in the middle of those that move in a phase."""
    start, end = case.phases[phase].start_s, case.phases[phase].end_s
    inside = (case.samples.t_s >= start - 1e-6) & (case.samples.t_s < end - 1e-6)
    rows = np.flatnonzero(inside)
    return int(rows[len(rows) // 2])


def faster_for_a_moment(case: Case, row: int, factor: float) -> Case:
    """As far as before from this row to the next, but not at the speeds of the rows around."""
    v, a, t = case.samples.v[row], case.samples.a[row], case.samples.t_s
    for column in range(5):
        change = (factor - 1) * v[column]
        held = a[column] - 2 * change / (t[row + 1] - t[row])
        case = case.set("v", row, column, v[column] + change).set("a", row, column, held)
    wheels = case.samples.wheel_rad_s.copy()
    wheels[row] *= factor
    return replace(case, samples=replace(case.samples, wheel_rad_s=wheels))


@nominal_only
@pytest.mark.parametrize("phase", [0, 1, 2])
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_speed_that_jumps_is_found(case: Case, phase: int, factor: float) -> None:
    row = middle_of(case, phase)
    spoilt = faster_for_a_moment(case, row, factor)
    result = spoilt.check()
    assert result.max_defect <= 1e-6  # the path is the same: only the speed is another
    said = [text for text in result.problems if "speed jumps" in text]
    when = [f"at {t:.3f} s a wheel's speed jumps by" for t in case.samples.t_s[row : row + 2]]
    assert any(text.startswith(begin) for text in said for begin in when), result.problems


@nominal_only
def test_a_plan_whose_input_holds_from_row_to_row_does_not_pass_for_one(case: Case) -> None:
    held = Trajectory(case.problem, case.samples, case.phases, case.transitions).held()
    result = replace(case, samples=held).check()
    assert result.max_defect <= 1e-6  # the same way, in steps
    assert any("a wheel's speed jumps by" in text for text in result.problems), result.problems


@nominal_only
def test_a_phase_too_short_for_its_controller_is_found(case: Case) -> None:
    robot = case.problem.robot
    limits = robot.limits.with_values(control_period_s=0.5)
    slow = case.problem.with_values(robot=robot.with_values(limits=limits))
    short = min(case.phases, key=lambda phase: phase.end_s - phase.start_s)
    assert short.end_s - short.start_s < 1.5
    words = (
        f"^the phase at {short.start_s:.3f} s lasts .* less than three control periods, 1.500 s$"
    )
    assert_found(replace(case, problem=slow), words)


@nominal_only
def test_a_plan_that_begins_in_motion_is_found(case: Case) -> None:
    spoilt = case  # as far, at the mean of the speeds at the ends
    for column in range(5):
        held = case.samples.v[1, column] / 2
        spoilt = spoilt.set("v", 0, column, held).set("a", 0, column, 0.0)
    for wheel in range(4):
        spoilt = spoilt.set("wheel_rad_s", 0, wheel, case.samples.wheel_rad_s[1, wheel] / 2)
    assert spoilt.check().max_defect <= 1e-6
    assert_found(
        spoilt, "^the phase at 0.000 s does not go from rest to rest$", "a wheel's speed jumps by"
    )


@all_timings
@pytest.mark.parametrize("phase", [0, 1, 2])
def test_a_rate_of_change_that_is_another_is_found(case: Case, phase: int) -> None:
    row = middle_of(case, phase)
    column = int(np.argmax(np.abs(case.samples.v[row])))
    dt = float(np.diff(case.samples.t_s)[row])
    by = 0.05 * case.samples.v[row, column] / dt
    spoilt = case.set("a", row, column, case.samples.a[row, column] + by)
    assert_found(spoilt, "re-integration departs", "a wheel's speed jumps by")


@nominal_only
def test_an_input_that_bends_and_turns_on_the_way_is_found(case: Case) -> None:
    row = middle_of(case, 1)
    when = f"{case.samples.t_s[row]:.3f}"
    v = case.samples.v[row]
    aside = case
    for column, change in ((0, -v[1]), (1, v[0])):  # at a right angle to the way
        aside = aside.set("a", row, column, case.samples.a[row, column] + change)
    assert_found(aside, TURNS.format(when))
    back = case
    for column in range(5):
        back = back.set("a", row, column, -2 * v[column] / float(np.diff(case.samples.t_s)[row]))
    assert_found(back, TURNS.format(when))


@nominal_only
def test_a_wheel_that_speeds_up_too_fast_is_found(case: Case) -> None:
    limits = case.problem.robot.limits
    assert limits.wheel_acceleration_rad_s2 == 5.0
    used = 5.0 - case.check().limits["wheel_acceleration_rad_s2"]
    assert used == pytest.approx(5.0, abs=0.1)  # the plan uses almost all of it
    weaker = case.with_robot(limits=limits.with_values(wheel_acceleration_rad_s2=used - 1.0))
    assert_found(weaker, "^limit wheel_acceleration_rad_s2 exceeded by 1$")
    first = case.phases[0]
    quick = quicker(case, first, 0.1)  # the plan takes its time: 4.8 s instead of 0.8 s
    result = quick.check()
    assert result.max_defect <= 1e-6
    assert any("wheel_acceleration_rad_s2 exceeded by" in text for text in result.problems)


def quicker(case: Case, phase: Phase, factor: float) -> Case:
    """The first phase in less time: speeds go as before from rest to rest, but rise faster."""
    samples = case.samples
    inside = samples.t_s < phase.end_s - 1e-6
    t, v, a, wheels = (
        np.array(getattr(samples, name)) for name in ("t_s", "v", "a", "wheel_rad_s")
    )
    t[inside] *= factor
    v[inside] /= factor
    a[inside] /= factor**2
    wheels[inside] /= factor
    last = int(np.flatnonzero(inside)[-1]) + 1
    t[last] *= factor
    arrays = {"t_s": t, "v": v, "a": a, "wheel_rad_s": wheels}
    ended = phase._replace(end_s=phase.end_s * factor)
    return replace(case, samples=replace(samples, **arrays), phases=(ended, *case.phases[1:]))


@nominal_only
def test_a_robot_without_such_a_limit_may_start_and_stop_at_once(case: Case) -> None:
    held = Trajectory(case.problem, case.samples, case.phases, case.transitions).held()
    free = replace(case, samples=held).with_robot(limits=at_once(case.problem.robot).limits)
    said = " ".join(free.check().problems)
    assert "jumps" not in said
    assert "limit" not in said


# --- limits --------------------------------------------------------------------------------------

LIMITS = {
    "wheel_speed_rad_s": ("wheel_rad_s", 10.0),
    "unit_speed_m_s": ("v", 0.03),
    "curvature_per_m": ("q", 78.5),
    "temperature_max_C": ("temperature_C", 85.0),
    "heater_current_A": ("heater_current_A", 0.9),
}


@all_timings
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("limit", LIMITS)
def test_a_sample_beyond_a_limit_is_found(case: Case, limit: str, sign: float) -> None:
    name, most = LIMITS[limit]
    if name in ("temperature_C", "heater_current_A"):
        sign = 1.0
    row = case.first_moving(soft=True)
    column = 4 if name == "q" else 1
    beyond = case.set(name, row, column, sign * most * 1.1)
    if name == "v":
        beyond = beyond.set("a", row, column, 0.0)
    result = beyond.check()
    assert result.limits[limit] == pytest.approx(-0.1 * most)
    words = f"limit {limit} exceeded by {0.1 * most:.3g}"
    assert words in result.problems


@all_timings
@pytest.mark.parametrize("limit", ["wheel_speed_rad_s", "unit_speed_m_s", "curvature_per_m"])
def test_a_robot_with_a_lower_limit_does_not_accept_the_plan(case: Case, limit: str) -> None:
    used = LIMITS[limit][1] - case.check().limits[limit]
    limits = case.problem.robot.limits.with_values(**{limit: 0.9 * used})
    assert_found(case.with_robot(limits=limits), f"^limit {limit} exceeded by {0.1 * used:.3g}$")


@all_timings
@pytest.mark.parametrize("limit", ["temperature_max_C", "heater_current_A"])
def test_a_weaker_heater_does_not_accept_the_plan(case: Case, limit: str) -> None:
    key = {"heater_current_A": "current_max_A"}.get(limit, limit)
    used = LIMITS[limit][1] - case.check().limits[limit]
    heater = case.problem.robot.heater.model_copy(update={key: 0.9 * used})
    assert_found(case.with_robot(heater=heater), f"^limit {limit} exceeded by {0.1 * used:.3g}$")


@all_timings
@pytest.mark.parametrize("limit", ["unit_gap_m", "wheel_independence"])
def test_shapes_too_close_to_what_the_limits_forbid_are_found(case: Case, limit: str) -> None:
    before = getattr(case.problem.robot.limits, limit)
    least = before + case.check().limits[limit] + 0.01
    limits = case.problem.robot.limits.with_values(**{limit: least})
    assert_found(case.with_robot(limits=limits), f"^limit {limit} exceeded by 0.01$")


# --- stiffness -----------------------------------------------------------------------------------


@all_timings
def test_the_moment_of_the_clash_is_named(case: Case) -> None:
    phase = next(each for each in case.phases if each.mode[0])
    assert_found(
        case.move(1, "soft", done_s=0.5),
        rf"^the robot moves at {phase.start_s:.3f} s while segment 1 is changing$",
        rf"^at {phase.start_s:.3f} s the mode is \[1,.\] but segment 1 is not so yet$",
    )
    early = case.move(1, "rigid", onset_s=-0.01)
    assert_found(early, "^the robot moves at .* s while segment 1 is changing$")


@all_timings
def test_bending_a_segment_that_never_melted_is_found(case: Case) -> None:
    spoilt = case.without(2, "soft").without(2, "rigid")
    assert_found(spoilt, r"^at .* s the mode is \[[01],1\] but segment 2 is not so yet$")


@all_timings
@pytest.mark.parametrize("soft", [True, False])
@pytest.mark.parametrize("mode", MODES, ids=mode_name)
def test_a_mode_the_metal_does_not_have_is_found(case: Case, soft: bool, mode: Mode) -> None:
    row = case.first_moving(soft=soft)
    before = case.samples.mode[row].tolist()
    spoilt = case.set("mode", row, 0, mode[0]).set("mode", row, 1, mode[1])
    problems = spoilt.check().problems
    said = [text for text in problems if "is not so yet" in text]
    when = f"at {case.samples.t_s[row]:.3f} s the mode is {mode_name(mode)}"
    wrong = [j for j in (0, 1) if mode[j] != before[j]]
    assert said == [f"{when} but segment {j + 1} is not so yet" for j in wrong]


@all_timings
@pytest.mark.parametrize("segment", [1, 2])
def test_a_segment_that_does_not_end_as_asked_is_found(case: Case, segment: int) -> None:
    unfrozen = case
    while any(item[:2] == (segment, "rigid") for item in unfrozen.transitions):
        unfrozen = unfrozen.without(segment, "rigid")
    assert f"segment {segment} does not end rigid" in unfrozen.check().problems
    goal = case.problem.goal.with_values(mode=(int(segment == 1), int(segment == 2)))
    problem = case.problem.with_values(goal=goal)
    assert_found(replace(case, problem=problem), f"^segment {segment} does not end soft$")


# --- transitions ---------------------------------------------------------------------------------


@all_timings
@pytest.mark.parametrize("segment", [1, 2])
def test_a_transition_to_what_is_already_is_found(case: Case, segment: int) -> None:
    for gone, left in (("soft", "rigid"), ("rigid", "soft")):
        if gone == "rigid" and not any(
            item[:2] == (segment, "soft")
            for item in case.transitions[case.find(segment, "rigid") :]
        ):
            continue
        words = rf"^segment {segment} to {left} at .* s: it is {left} already$"
        problems = case.without(segment, gone).check().problems
        assert any(re.search(words, problem) for problem in problems), problems


@all_timings
def test_a_transition_before_the_one_before_it_is_done_is_found(case: Case) -> None:
    done = case.transitions[case.find(1, "soft")].done_s
    freeze = case.transitions[case.find(1, "rigid")]
    early = case.move(1, "rigid", heater_s=done - 1.0 - freeze.heater_s)
    problems = early.check().problems
    words = f"segment 1 to rigid at {done - 1.0:.3f} s: before the transition before it is done"
    assert words in problems


@all_timings
def test_a_heater_on_before_the_start_is_found(case: Case) -> None:
    first = case.transitions[0]
    early = case.move(first.segment, first.to, heater_s=-1.0 - first.heater_s)
    problems = early.check().problems
    assert f"segment {first.segment} to soft at -1.000 s: before the transition before it" in (
        " ".join(problems)
    )


@all_timings
@pytest.mark.parametrize("to", ["soft", "rigid"])
@pytest.mark.parametrize("name", ["onset_s", "done_s"])
def test_times_out_of_order_are_found(case: Case, to: str, name: str) -> None:
    item = case.transitions[case.find(2, to)]
    before = {"onset_s": item.heater_s, "done_s": item.onset_s}[name] - 1.0
    spoilt = case.move(2, to, **{name: before - getattr(item, name)})
    words = f"segment 2 to {to} at {item.heater_s:.3f} s: heater, onset and done are out of order"
    assert words in spoilt.check().problems


@constant_only
@pytest.mark.parametrize(("to", "plateau"), [("soft", 37), ("rigid", 235)])
def test_a_plateau_that_is_too_short_is_found(case: Case, to: str, plateau: int) -> None:
    item = case.transitions[case.find(2, to)]
    assert_found(
        case.move(2, to, done_s=-1.0),
        f"^segment 2 to {to} at {item.heater_s:.3f} s: on the plateau for {plateau - 1}.000 s "
        f"instead of {plateau} s$",
    )


@constant_only
def test_a_melt_that_is_heated_too_short_is_found(case: Case) -> None:
    on = case.transitions[case.find(2, "soft")].heater_s + 1.0
    assert_found(
        case.move(2, "soft", heater_s=1.0),
        f"^segment 2 to soft at {on:.3f} s: heated for 25.000 s before melting instead of 26.000 s",
    )


@constant_only
@pytest.mark.parametrize(("start_C", "least_s"), [(43.0, 13.0), (7.0, 39.0), (25.0, 26.0)])
def test_the_first_melt_takes_longer_from_colder_metal(
    case: Case, start_C: float, least_s: float
) -> None:
    start = case.problem.start.with_values(temperature_C=(start_C, 25.0))
    problem = case.problem.with_values(start=start)
    item = case.transitions[case.find(1, "soft")]
    onset = item.onset_s
    for lead, holds in ((least_s, True), (least_s - 0.01, False)):
        shift = onset - lead - item.heater_s
        result = replace(case.move(1, "soft", heater_s=shift), problem=problem).check()
        complaints = [text for text in result.problems if "heated for" in text]
        assert (not complaints) == holds
        assert holds or f"instead of {least_s:.3f} s" in complaints[0]


@constant_only
def test_metal_that_stays_liquid_too_long_without_heater_is_found(case: Case) -> None:
    item = case.transitions[case.find(1, "rigid")]
    lead = item.onset_s - item.heater_s
    assert lead == pytest.approx(18.0)
    assert_found(
        case.move(1, "rigid", heater_s=-1.0),
        f"^segment 1 to rigid at {item.heater_s - 1:.3f} s: liquid for 19.000 s after its heater "
        "is off: it would freeze earlier$",
    )


@constant_only
def test_metal_heated_only_briefly_after_melting_stays_liquid_only_briefly(case: Case) -> None:
    molten = case.transitions[case.find(2, "soft")].done_s
    freeze = case.transitions[case.find(2, "rigid")]
    liquid = freeze.onset_s - molten
    for share, holds in ((3 / 21 + 1e-4, True), (3 / 21 - 1e-3, False)):  # 3 s of heat last 18 s
        off = molten + share * liquid
        problems = case.move(2, "rigid", heater_s=off - freeze.heater_s).check().problems
        said = f"liquid for {freeze.onset_s - off:.3f} s after its heater is off"
        assert any(said in problem for problem in problems) != holds


@paper_only
@pytest.mark.parametrize(("to", "sleep"), [("soft", 100), ("rigid", 300)])
def test_a_sleep_that_is_too_short_is_found(case: Case, to: str, sleep: int) -> None:
    item = case.transitions[case.find(2, to)]
    spoilt = case.move(2, to, done_s=item.heater_s + sleep - 1.0 - item.done_s)
    assert_found(
        spoilt,
        f"^segment 2 to {to} at {item.heater_s:.3f} s: changes in {sleep - 1}.000 s instead of "
        f"{sleep} s$",
    )


@all_timings
def test_phases_that_overlap_are_found(case: Case) -> None:
    first, second, *rest = case.phases
    moved = second._replace(start_s=first.end_s - 0.01)
    assert_found(
        replace(case, phases=(first, moved, *rest)),
        f"^the phase at {moved.start_s:.3f} s starts before the one before it has ended$",
    )


def test_reconfigurations_are_slept_through() -> None:
    greedy = case_of(planned("paper-1", planner="greedy", timing="paper"))
    cooled = [item for item in greedy.transitions if item.done_s - item.heater_s > 300.5]
    assert cooled  # 400 s of cooling, then 102 s of heating
    assert greedy.check().ok


# --- spoiling at random --------------------------------------------------------------------------


@given(
    row=st.floats(0.0, 0.999),
    column=st.integers(0, 4),
    name=st.sampled_from(["q", "v"]),
    by=st.floats(1e-3, 0.5),
    sign=st.sampled_from([-1.0, 1.0]),
)
def test_no_change_of_motion_goes_unnoticed(
    row: float, column: int, name: str, by: float, sign: float
) -> None:
    case = case_of(planned("paper-1"))
    i = int(row * (len(case.samples) - (name == "v")))
    before = getattr(case.samples, name)[i, column]
    assert not case.set(name, i, column, before + sign * by).check().ok


@pytest.mark.parametrize(("timing", "least_s"), [("nominal", 0.5), ("constant", 0.01)])
@given(
    i=st.integers(0, 3),
    name=st.sampled_from(["heater_s", "onset_s", "done_s"]),
    by=st.floats(0.0, 300.0),
    sign=st.sampled_from([-1.0, 1.0]),
)
def test_a_transition_moved_alone_is_found(
    timing: str, least_s: float, i: int, name: str, by: float, sign: float
) -> None:
    case = case_of(planned("paper-1", timing=timing))
    item = case.transitions[i]
    moved = item._replace(**{name: getattr(item, name) + sign * (least_s + by)})
    transitions = (*case.transitions[:i], moved, *case.transitions[i + 1 :])
    assert not replace(case, transitions=transitions).check().ok


# --- what the robot would be sent ----------------------------------------------------------------


def ended_early(case: Case) -> Case:
    """The samples stop right after the motion, before the metal is frozen."""
    rows = int(np.flatnonzero(case.samples.moves)[-1]) + 2
    arrays = {name: array[:rows] for name, array in vars(case.samples).items()}
    return replace(case, samples=replace(case.samples, **arrays))


def later_phase(case: Case) -> Case:
    first, second, *rest = case.phases
    shifted = second._replace(start_s=second.start_s + 5.0, end_s=second.end_s + 5.0)
    return replace(case, phases=(first, shifted, *rest))


def other_mode(case: Case) -> Case:
    first, *rest = case.phases
    return replace(case, phases=(first._replace(mode=(1, 1)), *rest))


def at_time(change: Callable[[Array, int], float]) -> Callable[[Case], Case]:
    """Change the time of a sample in the middle of a hold."""

    def spoil(case: Case) -> Case:
        row = int(np.flatnonzero(~case.samples.moves)[1])
        t = case.samples.t_s.copy()
        t[row] = change(t, row)
        return replace(case, samples=replace(case.samples, t_s=t))

    return spoil


def not_a_number(name: str) -> Callable[[Case], Case]:
    def spoil(case: Case) -> Case:
        return case.set(name, 1, 0, np.nan)

    return spoil


def longest(case: Case, rows: NDArray[np.bool_]) -> int:
    """The sample of these that lasts longest: short ones do little to the metal."""
    lasting = np.append(np.diff(case.samples.t_s), 0.0)
    return int(np.argmax(np.where(rows, lasting, -1.0)))


def while_heated(name: str, value: float) -> Callable[[Case], Case]:
    """Change a command of heater 1 in a sample while it is on."""

    def spoil(case: Case) -> Case:
        return case.set(name, longest(case, case.samples.heater_current_A[:, 0] > 0), 0, value)

    return spoil


def heated_early(case: Case) -> Case:
    """Heater 2 is on in a sample before its melt."""
    early = case.samples.t_s < case.transitions[case.find(2, "soft")].heater_s - 1e-3
    return case.set("heater_current_A", longest(case, early), 1, 0.8)


NOT_FINITE = "^samples.{} has a value that is not finite$"
HEATER = "^at .* s heater {} does not do what the transitions say$"
GIVES = "^at .* s heater {} gives .* A, not the .* A of the heating policy$"
OUTSIDE = "^at .* s the samples move outside of a phase, or rest in one$"
SPOILT: dict[str, tuple[Callable[[Case], Case], list[str]]] = {
    "wheels slower than v says": (
        lambda case: case.scaled("wheel_rad_s", 0.5),
        ["^at .* s the wheels do not turn as v asks$"],
    ),
    "wheels that turn during a hold": (
        lambda case: case.set("wheel_rad_s", -2, 3, 0.01),
        ["^at .* s the wheels do not turn as v asks$"],
    ),
    "samples that end before the metal is frozen": (
        ended_early,
        ["^the samples end at .* s, before the plan does at .* s$"],
    ),
    "heaters without current": (
        lambda case: case.scaled("heater_current_A", 0.0),
        [GIVES.format(1), GIVES.format(2)],
    ),
    "set-points of zero": (
        lambda case: case.scaled("heater_setpoint_C", 0.0),
        [HEATER.format(1), HEATER.format(2)],
    ),
    "a heater that pauses": (while_heated("heater_current_A", 0.0), [GIVES.format(1)]),
    "a set-point that is too low": (while_heated("heater_setpoint_C", 64.0), [HEATER.format(1)]),
    "a heater that is on too early": (heated_early, [GIVES.format(2)]),
    "motion outside of any phase": (lambda case: replace(case, phases=()), [OUTSIDE]),
    "a phase that is not where the samples move": (later_phase, [OUTSIDE]),
    "a phase in another mode": (
        other_mode,
        ["^the samples have another mode than the phase at 0.000 s$"],
    ),
    "time that runs backwards": (
        at_time(lambda t, row: t[row + 1] + 1.0),
        ["^the time of the samples does not grow$"],
    ),
    "time that stands still": (
        at_time(lambda t, row: t[row + 1]),
        ["^the time of the samples does not grow$"],
    ),
    **{
        f"a {name} that is no number": (not_a_number(name), [NOT_FINITE.format(name)])
        for name in (
            "q",
            "v",
            "wheel_rad_s",
            "temperature_C",
            "heater_current_A",
            "heater_setpoint_C",
        )
    },
    "a curvature that runs away": (
        lambda case: case.scaled("v", 1e3),
        [
            "re-integration departs",
            "limit unit_speed_m_s",
            "the wheels do not",
            "^goal.* is missed",
        ],
    ),
}


CURRENT = "^segment {}: its currents make it .* C warmer or colder at .* s$"
SPOILT_CURRENTS = {
    "heaters without current": [CURRENT.format(1), CURRENT.format(2)],
    "a heater that pauses": [CURRENT.format(1)],
    "a heater that is on too early": [CURRENT.format(2)],
}  # by the thermal model: told by what the currents do to the metal


@all_timings
@pytest.mark.parametrize("how", SPOILT)
def test_what_would_not_work_on_the_robot_is_found(case: Case, how: str) -> None:
    spoil, words = SPOILT[how]
    if case.problem.timing == "nominal":
        words = SPOILT_CURRENTS.get(how, words)
    assert_found(spoil(case), *words)


@all_timings
def test_heaters_left_on_at_the_end_are_found(case: Case) -> None:
    hot = case.set("heater_setpoint_C", -1, 0, 65.0).set("heater_current_A", -1, 0, 0.3)
    assert_found(hot, HEATER.format(1))


def test_hot_metal_does_not_freeze_before_it_has_cooled() -> None:
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    problem = load_problem(
        "shape-change",
        start={**start, "temperature_C": (85.0, 25.0)},
        goal={"kappa_per_m": (10.0, 0.0)},
        timing="constant",
    )
    case = case_of(plan(problem).require())
    freeze = case.transitions[case.find(1, "rigid")]
    assert freeze.onset_s >= 108.0 - 1e-5  # 24 C above the melting point, 4 C take 18 s
    assert case.check().ok
    by = 50.0 - freeze.onset_s
    early = case.move(1, "rigid", heater_s=by, onset_s=by, done_s=by)
    words = "freezes at 50.000 s, but is still too hot until 108.000 s"
    assert any(words in problem for problem in early.check().problems)


def test_a_reconfiguration_lasts_as_long_as_the_robot_says() -> None:
    robot = at_once(load_robot("2sra-v1"))
    short = SequentialTiming(
        overlap="none", heat_s=100.0, freeze_s=300.0, reconfigure_s=380.0, reconfigure_cool_s=300.0
    )
    found = planned_with(robot, short)
    heating = [item.done_s - item.heater_s for item in found.transitions if item.to == "soft"]
    assert min(heating) == pytest.approx(80.0)  # 380 s of which 300 s cool
    assert found.verification.problems == ()
    case = case_of(found)
    first = case.transitions[case.find(1, "soft")]
    assert first.heater_s < 1e-6  # a melt from the cold: no cooling before it
    quicker = case.move(1, "soft", done_s=-10.0).check().problems
    assert any("changes in 90.000 s instead of 100 s" in problem for problem in quicker)


def test_a_melt_is_never_excused_by_a_short_cooling() -> None:
    robot = at_once(load_robot("2sra-v1"))
    quick = SequentialTiming(
        overlap="none", heat_s=100.0, freeze_s=300.0, reconfigure_s=502.0, reconfigure_cool_s=10.0
    )
    case = case_of(planned_with(robot, quick))
    item = case.transitions[case.find(1, "soft")]
    assert item.done_s - item.heater_s == pytest.approx(100.0)
    short = case.move(1, "soft", heater_s=80.0, onset_s=80.0)
    words = "changes in 20.000 s instead of 100 s"
    assert any(words in problem for problem in short.check().problems)


def planned_with(robot: Robot, times: SequentialTiming) -> Plan:
    """A greedy plan (melts one segment after the other) with other transition times."""
    changed = robot.with_values(timing={"nominal": times})
    goal = {"x_m": 0.1, "y_m": 0.0, "phi_rad": 0.2, "kappa_per_m": (20.0, -15.0)}
    return planned("shape-change", robot=changed, goal=goal, planner="greedy")
