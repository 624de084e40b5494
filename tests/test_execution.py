"""Running plans in closed loop: as planned where nothing disturbs, at the goal where much does."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from once import planned, simulated, solution
from problems import exactly
from scipy.optimize import newton

from twosra_mpc import Goal, InputError, Problem, load_problem, plan
from twosra_mpc.execution.belief import Belief, Metal
from twosra_mpc.execution.camera_filter import CameraFilter
from twosra_mpc.execution.course import Course
from twosra_mpc.execution.driving import Pulses, predicted_curvatures, settling
from twosra_mpc.execution.executor import Executor, plan_controller
from twosra_mpc.execution.replanning import Replanning, remaining_problem
from twosra_mpc.execution.robot_interface import Camera, Reading
from twosra_mpc.execution.run import Ending, Run
from twosra_mpc.execution.settings import ExecutorSettings, Patience
from twosra_mpc.execution.simulation.disturbance import LEVELS
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.execution.simulation.simulate import simulate, spread
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.robot.accuracy import ACCEPTED, PLANNED, Accuracy
from twosra_mpc.robot.coordinates import Coordinates
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, soft_segments
from twosra_mpc.thermal.lumped import Lumped

if TYPE_CHECKING:
    from twosra_mpc.execution.following import Following

Array = NDArray[np.float64]

ARC = "2sra-v1"
ACCURACY = Accuracy()


def problem(scenario: str = "paper-2", **overrides: Any) -> Problem:
    return load_problem(scenario, robot=ARC, **overrides)


# --- as planned ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "robot"),
    [("paper-4", ARC), ("paper-1", "2sra-v1-paper")],  # and three segments: test_other_segments
)
def test_without_disturbance_what_is_executed_is_what_was_planned(
    scenario: str, robot: str
) -> None:
    made = planned(scenario, robot=robot)
    done = simulate(made.problem, plant="as-planned", disturbance="none", plan=made)
    assert done.run.ending is Ending.REACHED
    assert done.run.plans == (made,)
    assert done.run.transitions == made.cost.transitions == sum(done.run.begun)
    assert ACCURACY.of(done.truth.q[-1] - made.samples.q[-1]) <= 1.1 * Patience().finest
    for phase in made.phases:
        drives = [drive for drive in done.run.drives if drive.mode == phase.mode]
        end = np.searchsorted(done.truth.time_s, drives[-1].end_s - 1e-9)
        expected = made.samples.q[np.searchsorted(made.samples.t_s, phase.end_s - 1e-6)]
        assert ACCURACY.of(done.truth.q[end] - expected) <= 1.1 * Patience().finest
    assert done.truth.forced_s[-1] == 0.0


# --- disturbed -----------------------------------------------------------------------------------

RUNS = [  # scenario, seed, robot, level; each problem at hard: benchmarks closed-loop-hard
    ("paper-2", 2, ARC, "hard"),
    ("paper-2", 3, "2sra-v1-paper", "moderate"),
    ("three-segments", 3, "3sra", "mild"),
]


@pytest.mark.parametrize(("scenario", "seed", "robot", "level"), RUNS)
def test_a_disturbed_run_reaches_its_goal(scenario: str, seed: int, robot: str, level: str) -> None:
    done = simulated(scenario, seed, robot, level)
    found = done.metrics
    assert done.run.ending is Ending.REACHED
    assert found.reached
    assert np.hypot(*done.run.goal.error(done.truth.q[-1])[:2]) == found.position_m <= 2e-3
    assert found.heading_rad <= np.radians(1.0)
    assert found.curvature_per_m <= 1.0
    assert found.transitions <= found.allowed
    assert found.replans <= 2  # nothing goes to and fro
    assert found.forced_s == 0.0


@pytest.mark.parametrize(("scenario", "seed", "robot", "level"), RUNS)
def test_metal_is_called_soft_or_rigid_only_when_it_is(
    scenario: str, seed: int, robot: str, level: str
) -> None:
    done = simulated(scenario, seed, robot, level)
    log, truth = done.run.log, done.truth
    melted = truth.melt_fraction[np.searchsorted(truth.time_s, log.time_s - 1e-9)]
    soft, rigid = log.stiffness == 1, log.stiffness == 0
    heats = log.setpoint_C > done.run.problem.robot.heater.rigid_setpoint_C
    assert melted[soft].min() == 1.0  # until the heater of the last bend goes off before its end
    assert melted[rigid & ~heats].max() == 0.0


@pytest.mark.parametrize(("scenario", "seed", "robot", "level"), RUNS)
def test_the_books_are_right(scenario: str, seed: int, robot: str, level: str) -> None:
    done = simulated(scenario, seed, robot, level)
    run, truth, found = done.run, done.truth, done.metrics
    assert found.time_s == run.log.time_s[-1] == truth.time_s[-1]
    assert (np.diff(run.log.time_s) > 0).all()
    assert found.energy_J == truth.heat_J[-1].sum() > 250
    told = run.log.stiffness[(run.log.stiffness != 0.5).all(axis=1)]
    assert found.transitions >= np.abs(np.diff(told, axis=0)).sum() > 0
    numbers = range(1, run.problem.robot.coordinates.segments + 1)
    per_segment = [[c.to for c in run.changes if c.segment == j] for j in numbers]
    for changes in per_segment:
        assert changes == ["soft", "rigid"] * (len(changes) // 2)
    assert len(run.begun) == len(run.plans) == 1 + run.replans + run.corrections
    driven = sum(drive.end_s - drive.start_s for drive in run.drives)
    turning = run.log.wheel_rad_s.any(axis=1)
    assert driven >= np.diff(run.log.time_s)[turning[:-1]].sum() - 1e-9 > 0
    assert all(made.verification.ok for made in run.plans)
    assert run.events[0].kind == "plan"
    assert run.events[-1].kind == "end"
    moved = np.abs(np.diff(truth.q, axis=0)).max(axis=1) > 1e-3
    changing = (truth.melt_fraction > 0.2) & (truth.melt_fraction < 0.8)
    assert level == "hard" or not (moved & changing[:-1].any(axis=1)).any()


def test_a_run_is_saved_as_plain_numbers() -> None:
    document = simulated("paper-2", 2).to_dict()
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again["format"] == "twosra-run"
    assert again["ending"] == "reached"
    assert again["metrics"]["reached"] is True
    assert len(again["log"]["q"]) == len(again["log"]["time_s"])
    assert again["log"]["planned"][0] is not None


def test_a_seed_is_a_run() -> None:
    """Also while metal changes: see test_controller."""
    first = simulated("rigid-move", 1)
    second = simulate(problem("rigid-move"), seed=1, plan=planned("rigid-move", robot=ARC))
    assert (first.truth.q == second.truth.q).all()
    assert first.run.events == second.run.events
    assert first.metrics == second.metrics
    assert first.metrics != simulated("rigid-move", 2).metrics


# --- events --------------------------------------------------------------------------------------


def with_coils(robot: SimulatedRobot, resistance_ohm: float) -> SimulatedRobot:
    for segment in robot.segments:
        assert isinstance(segment.model, Lumped)
        segment.model = replace(segment.model, resistance_ohm=resistance_ohm)
    return robot


@pytest.mark.parametrize(("resistance_ohm", "late"), [(4.9, True), (9.0, False)])  # healthy
def test_a_late_melt_shifts_the_phases_and_an_early_one_too(
    resistance_ohm: float, late: bool
) -> None:
    made = planned("paper-1", robot=ARC)
    robot = with_coils(SimulatedRobot(made.problem, "as-planned"), resistance_ohm)
    run = Executor(robot).run(made)
    assert run.ending is Ending.REACHED
    assert run.replans == 0
    starts = [next(d.start_s for d in run.drives if d.mode == p.mode) for p in made.phases]
    shifts = np.array(starts) - [phase.start_s for phase in made.phases]
    assert shifts[0] == 0.0
    assert (shifts[1:] > 15.0).all() if late else (shifts[1:] < -5.0).all()
    soft = {change.segment: change.time_s for change in run.changes if change.to == "soft"}
    assert starts[1] == soft[1]
    assert starts[2] == soft[2] > starts[1]


class Pushed(SimulatedRobot):
    """A robot that something pushes once, while it is driven in a mode."""

    push = np.zeros(5)
    at_mode = (0, 0)
    pushed = False

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        super().send(wheel_rad_s, heater_setpoint_C)
        if self.mode == self.at_mode and wheel_rad_s.any() and not self.pushed:
            self._motion.q = self.q + self.push
            self.pushed = True


def pushed(made: Problem, mode: tuple[int, int], push: list[float], **settings: Any) -> Run:
    robot = Pushed(made, "as-planned")
    robot.at_mode, robot.push = mode, np.array(push)
    return Executor(robot, ExecutorSettings(**settings)).run(solution(made).require())


def test_leaving_the_corridor_plans_the_rest_again_and_reaches_the_goal() -> None:
    run = pushed(problem(), (0, 0), [0.2, 0.1, 0.3, 0.0, 0.0])
    assert run.ending is Ending.REACHED
    assert run.replans == 1
    told = [event.text for event in run.events if event.kind == "look"]
    assert any("from the plan" in text for text in told)
    assert run.transitions == 2  # the rest needs no melt more than there was
    assert run.plans[1].problem.start_mode == (0, 0)


def test_a_pose_lost_in_a_soft_phase_costs_no_melt() -> None:
    near = pushed(problem(), (1, 0), [0.02, 0.01, 0.1, 0.0, 0.0])
    far = pushed(problem(), (1, 0), [0.2, 0.1, 0.3, 0.0, 0.0])
    assert near.ending is far.ending is Ending.REACHED
    assert near.transitions == far.transitions == 2
    assert (near.replans, near.corrections) == (0, 0)  # four wheels bring it back
    assert far.replans == 1
    assert far.plans[1].problem.start_mode == (1, 0)


def test_a_shape_that_the_plan_cannot_mend_is_planned_again() -> None:
    run = pushed(problem("paper-1"), (1, 1), [0.0, 0.0, 0.0, 3.0, -3.0])
    assert run.ending is Ending.REACHED
    assert run.replans == 1
    assert any("would miss the curvatures" in event.text for event in run.events)
    assert run.transitions <= sum(run.begun)


class Springy(Pushed):
    """A robot that springs when it stands for the first time."""

    at_mode, back = (1, 1), np.zeros(5)

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        super().send(wheel_rad_s, heater_setpoint_C)
        if self.pushed and not wheel_rad_s.any():
            self._motion.q, self.back = self.q + self.back, np.zeros(5)


@pytest.mark.parametrize(
    ("push", "back"), [((12.0, -12.0), (-12.0, 12.0)), ((0.0, 0.0), (1.1, 0.2))]
)
def test_bends_that_are_apart_until_they_rest_or_right_at_once_need_no_other_plan(
    push: tuple[float, float], back: tuple[float, float]
) -> None:
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    start |= {"temperature_C": [65.0, 65.0], "melt_fraction": [1.0, 1.0]}
    task = exactly(problem(start=start, goal={"kappa_per_m": [20.0, 20.0], "mode": [1, 1]}))
    seen = replace(LEVELS["none"], camera=LEVELS["mild"].camera)
    robot = Springy(task, "as-planned", seen)
    robot.push, robot.back = np.array([0.0, 0.0, 0.0, *push]), np.array([0.0, 0.0, 0.0, *back])
    run = Executor(robot).run(solution(task).require())
    assert run.ending is Ending.REACHED
    assert len(run.plans) == 1


def test_a_pose_that_is_off_at_the_end_is_corrected_without_melting() -> None:
    run = pushed(problem("rigid-move"), (0, 0), [0.02, 0.0, 0.1, 0.0, 0.0])
    assert run.ending is Ending.REACHED
    assert run.transitions == 0


def test_a_heater_that_fails_is_reported_and_planned_around() -> None:
    """Among obstacles; in free space a run has seen at once that it can do without."""
    start = {"x_m": 0.238, "y_m": 0.276, "phi_rad": -0.24, "kappa_per_m": [-38.0, -24.0]}
    goal = {"x_m": 0.24, "y_m": 0.3, "phi_rad": -0.15, "kappa_per_m": [-38.4, -5.0]}
    far = {"disc": {"x_m": 2.0, "y_m": 2.0, "radius_m": 0.1}}
    task = exactly(problem("paper-1", start=start, goal=goal, obstacles=[far]))
    done = simulate(task, disturbance="mild", seed=1, broken_heaters=[1])
    kinds = [event.kind for event in done.run.events]
    assert "failure" in kinds
    assert done.metrics.reached
    assert done.run.transitions == 2
    assert all(mode[0] == 0 for mode in done.run.plans[-1].problem.modes)


def test_a_heater_that_fails_and_cannot_be_done_without_is_the_reason() -> None:
    made = planned("paper-2", robot=ARC)
    done = simulate(problem(), disturbance="mild", seed=1, broken_heaters=[1], plan=made)
    assert done.run.ending is Ending.HEATER_FAILED
    assert "without heater 1: proved infeasible: segment 1 must bend" in done.run.reason
    assert "allowed modes" not in done.run.reason
    assert any("segment 1: heating does not warm it" in event.text for event in done.run.events)


class Cold:
    """The least that can be driven: a robot that stands where it stands and warms, but not enough.

    Attributes:
        warms_K_s: How fast.
    """

    warms_K_s = 0.1

    def __init__(self, made: Problem) -> None:
        self.made, self.time_s, self.sent, self.warmed_s = made, 0.0, 0, 0.0
        self.heated = False

    @property
    def robot(self) -> Robot:
        return self.made.robot

    @property
    def camera(self) -> Camera:
        return Camera(rate_Hz=10.0)

    def read(self) -> Reading:
        q = self.made.start.configuration + 1e-6 * (self.sent % 2)  # its camera is alive
        return Reading(
            self.time_s,
            np.array([self.time_s]),
            q[None],
            (25.0 + self.warmed_s * self.warms_K_s, 25.0),
            ("rigid", "rigid"),
            (False, False),
        )

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        assert wheel_rad_s.shape == (4,)
        assert heater_setpoint_C.shape == (2,)
        self.heated, self.sent = heater_setpoint_C[0] > 60.0, self.sent + 1

    def wait(self, at_most_s: float) -> None:
        self.time_s += at_most_s
        self.warmed_s += at_most_s * self.heated


def test_a_melt_that_hardly_warms_has_failed_before_three_times_its_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("twosra_mpc.execution.doubt.DRIVE_M", np.inf)  # it stands, and is seen to
    robot = Cold(problem())
    run = Executor(robot).run(solution(robot.made).require())
    assert run.ending is Ending.HEATER_FAILED
    failure = next(event for event in run.events if event.kind == "failure")
    assert "segment 1" in failure.text
    assert "heating does not warm it" in failure.text
    assert failure.time_s - run.drives[-1].end_s < 3 * 62  # since it was waited for
    assert robot.sent > 100


# --- endings -------------------------------------------------------------------------------------


def test_every_ending_says_why() -> None:
    task = problem("paper-1")
    slow = pushed(task, (0, 0), [0.0] * 5, longest_s=30.0)
    stubborn = pushed(task, (1, 1), [0.0, 0.0, 0.0, 8.0, -8.0], replans=0)
    equally = {"kappa_per_m": [-30.0, -16.0]}, ((0, 0), (1, 1))  # 8 1/m more each
    bent = load_problem("paper-1", robot=ARC, goal=equally[0], modes=equally[1])
    hopeless = pushed(bent, (1, 1), [0.0, 0.0, 0.0, 3.0, -3.0])
    assert slow.ending is Ending.TIME_LIMIT
    assert "more than 30 s" in slow.reason
    assert stubborn.ending is Ending.GAVE_UP
    assert "1/m from the goal after planning again never" in stubborn.reason
    assert hopeless.ending is Ending.NO_PLAN
    assert "cannot be planned" in hopeless.reason
    for run in (slow, stubborn, hopeless):
        assert run.events[-1] == (run.duration_s, "end", run.reason)
        assert not run.reached
        assert not run.log.wheel_rad_s[-1].any()
        assert (run.log.setpoint_C[-1] == 25.0).all()


def test_a_plan_for_another_robot_is_refused_by_name() -> None:
    robot = SimulatedRobot(problem())
    with pytest.raises(InputError, match=r"plan.robot = '2sra-v1-paper'.*2sra-v1"):
        Executor(robot).run(planned("paper-2", robot="2sra-v1-paper"))


# --- greedy --------------------------------------------------------------------------------------


def test_the_greedy_rule_reaches_the_goal_without_a_plan() -> None:
    done = simulated("paper-2", 3, executor="greedy")
    assert done.run.executor == "greedy"
    assert done.run.plans == ()
    assert done.metrics.reached
    assert done.metrics.transitions == 2
    assert done.run.drives[0].mode == (1, 0)
    assert done.run.drives[-1].mode == (0, 0)
    assert done.metrics.forced_s == 0.0


def test_the_greedy_rule_goes_on_without_a_heater_or_says_so() -> None:
    robot = SimulatedRobot(problem(), "as-planned", broken_heaters=[1])
    run = Executor(robot).drive(problem())
    assert run.ending is Ending.HEATER_FAILED
    assert "heater 1 failed" in run.reason


def test_the_greedy_rule_says_that_it_knows_two_segments() -> None:
    two = problem("rigid-move").robot
    three = two.with_values(geometry=two.geometry.with_values(segments=3))
    straight = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0] * 3}
    task = Problem(robot=three, start=straight, goal={"x_m": 0.1})
    with pytest.raises(InputError, match="the greedy rule knows two segments"):
        Executor(SimulatedRobot(problem())).drive(task)


def test_the_greedy_rule_says_that_it_knows_no_tasks() -> None:
    task = problem("rigid-move").with_values(tasks=[{"do": "pass", "x_m": [0.05, 0.06]}])
    with pytest.raises(InputError, match="the greedy rule knows no tasks"):
        Executor(SimulatedRobot(problem())).drive(task)


def test_an_unknown_executor_is_refused() -> None:
    with pytest.raises(InputError, match=r"executor = 'best'.*optimal, greedy"):
        simulate(problem(), executor="best")


# --- parts ---------------------------------------------------------------------------------------

TWO = Coordinates(2)
LENGTHS_M = (0.04, 0.04)
NOISY = Camera(noise=(1e-3, 0.02, 1.0), step=(1e-3, 0.02, 1.0))


def test_at_rest_the_belief_is_the_mean_of_all_frames() -> None:
    rng = np.random.default_rng(0)
    truth = np.array([0.1, 0.2, 3.13, 12.3, -4.4])  # phi so that frames wrap around
    filtered = CameraFilter(NOISY, truth, 0.0)
    frames = truth + rng.normal(size=(300, 5)) * TWO.each(*NOISY.noise)
    frames[:, 2] = np.remainder(frames[:, 2] + np.pi, 2 * np.pi) - np.pi
    for k, frame in enumerate(frames):
        filtered.predict(k / 15, np.zeros(5), LENGTHS_M)
        filtered.correct(np.array([k / 15]), frame[None])
    off = filtered.q - truth
    off[2] = np.remainder(off[2] + np.pi, 2 * np.pi) - np.pi
    assert (np.abs(off) < 4 * filtered.deviation).all()
    assert filtered.deviation == pytest.approx(np.sqrt(NOISY.variance(TWO) / 301), rel=0.2)


def test_frames_taken_together_count_as_taken_one_by_one() -> None:
    rng = np.random.default_rng(1)
    times = np.arange(20) / 15
    frames = rng.normal(size=(20, 5)) * TWO.each(*NOISY.noise)
    one, many = (CameraFilter(NOISY, np.zeros(5), 0.0) for _ in range(2))
    for filtered in (one, many):
        filtered.predict(2.0, np.zeros(5), LENGTHS_M)
    many.correct(times, frames)
    for time, frame in zip(times, frames, strict=True):
        one.correct(np.array([time]), frame[None])
    assert many.q == pytest.approx(one.q, abs=1e-9)
    assert many.variance == pytest.approx(one.variance, rel=1e-9)


@pytest.mark.parametrize("response", [0.3, 1.0, 1.6])
@pytest.mark.parametrize("delay", [0, 2])
def test_a_robot_that_responds_less_or_more_is_believed_without_bias(
    response: float, delay: int
) -> None:
    moved = np.array([2e-3, -1e-3, 0.01, 1.5, -1.0])
    offs = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        truth, path = np.zeros(5), [np.zeros(5)]
        filtered = CameraFilter(NOISY, truth, 0.0)
        for k in range(1, 40):
            truth = truth + response * moved
            path.append(truth)
            filtered.predict(k / 15, moved, LENGTHS_M)
            if k >= delay:
                frame = path[k - delay] + rng.normal(size=5) * TWO.each(*NOISY.noise)
                filtered.correct(np.array([(k - delay) / 15]), frame[None])
        offs.append((filtered.q - truth) / filtered.deviation)
    assert (np.abs(np.mean(offs, axis=0)) < 1.0).all()
    assert (np.std(offs, axis=0) < 2.0).all()


@pytest.mark.parametrize("counted", [0.2, 0.4, 1.0])
def test_pulses_are_worth_the_command_on_average_and_wheels_turn_as_told(counted: float) -> None:
    pulses, slow = Pulses(0.2), np.array([0.05, 0.0, -0.02, 0.01])
    sent = np.array([pulses.shape(slow, counted) for _ in range(3000)])
    turned = np.where(np.abs(slow) >= counted * 0.05, slow, 0.0)
    assert sent.mean(axis=0) == pytest.approx(turned, rel=0.02, abs=1e-12)
    assert set(np.abs(sent)[:, turned != 0].min(axis=1).round(9)) == {0.0, 0.3}
    assert pulses.shape(np.array([1.0, 0.0, -0.5, 0.1])).tolist() == [1.0, 0.0, -0.5, 0.0]
    assert (Pulses(0.0).shape(slow) == slow).all()


def test_heaters_wait_for_the_phases_before_them() -> None:
    made = planned("paper-1", robot=ARC)  # [0,0] > [1,0] > [1,1]
    course = Course(Belief(made.problem, Camera(), Patience()), made)
    melt_2 = next(t for t in made.transitions if (t.segment, t.to) == (2, "soft"))
    end_s = made.samples.t_s[-1]
    off, soft, warm = 25.0, 65.0, course.warm_C

    def at(clock_s: float, done: int) -> Course:
        course.clock_s, course.done = clock_s, done
        return course

    assert at(0.0, 0).setpoint_C.tolist() == [warm, off]
    assert at(1.0, 1).setpoint_C.tolist() == [soft, off]
    assert made.phases[1].start_s > melt_2.heater_s
    assert at(made.phases[1].start_s, 1).setpoint_C.tolist() == [soft, warm]
    assert at(made.phases[1].end_s, 2).setpoint_C.tolist() == [soft, soft]
    assert at(made.phases[2].end_s, 2).setpoint_C.tolist() == [soft, soft]
    assert at(made.phases[2].end_s, 3).setpoint_C.tolist() == [off, off]
    assert [at(end_s, done).begun for done in range(4)] == [0, 1, 2, 4]
    assert course.expected_s(0, "rigid") > 200
    assert 61 - 25 > warm - 25 > 15


def test_no_melt_begins_while_other_metal_coasts_that_must_freeze_first() -> None:
    """Else both would be liquid, and their bends even out."""
    made = planned("paper-5", modes=((0, 0), (0, 1), (1, 0)))
    assert [phase.mode for phase in made.phases] == [(0, 0), (0, 1), (1, 0)]
    belief = Belief(made.problem, Camera(), Patience())
    course = Course(belief, made)
    course.done, course.clock_s = 2, made.phases[2].start_s
    for second, first_C in (("soft", course.warm_C), ("changing", 65.0), ("rigid", 65.0)):
        belief.reading = replace(belief.reading, stiffness=("rigid", second))
        assert course.setpoint_C.tolist() == [first_C, 25.0]


@pytest.mark.parametrize(("off_per_m", "expected"), [(0.0, 14), (ACCEPTED, 170), (10.0, 1)])
def test_soft_metal_is_looked_at_until_it_is_clear_whether_it_is_bent_as_the_goal_wants(
    off_per_m: float, expected: int
) -> None:
    task = problem("paper-1")
    at = task.start.kappa_per_m
    goal = Goal(kappa_per_m=(at[0] + off_per_m, at[1]))
    belief = Belief(task.with_values(goal=goal), NOISY, Patience())
    belief.reading = replace(belief.reading, stiffness=("soft", "rigid"))
    run = SimpleNamespace(belief=belief, driving=None)
    decided = Replanning(cast("Following", run))._decided
    seen = [decided()]
    for k in range(1, 600):
        belief._filter.predict(k / 15, np.zeros(5), LENGTHS_M)
        belief._filter.correct(np.array([k / 15]), task.start.configuration[None])
        seen.append(decided())
    assert seen == sorted(seen)  # it stays so
    assert seen.index(True) == pytest.approx(expected, rel=0.2, abs=2)


def test_one_heater_at_a_time_is_kept() -> None:
    made = planned("paper-1", robot=ARC, heaters_at_once=1)
    course = Course(Belief(made.problem, Camera(), Patience()), made)
    for clock_s in np.linspace(0.0, made.samples.t_s[-1], 400):
        done = sum(phase.end_s <= clock_s for phase in made.phases)
        for before in (max(done - 1, 0), done):
            course.clock_s, course.done = float(clock_s), before
            assert (course.setpoint_C > 25.0).sum() <= 1


def test_the_rest_of_a_problem_leaves_alone_what_is_near_enough() -> None:
    task = problem("paper-1")
    goal = task.goal.configuration
    near = goal + np.array([0.05, 0.0, 0.2, 0.7, -0.5])
    rest = remaining_problem(task, near, [Metal(40.0, 0.0), Metal(58.0, 0.0)])
    found = plan(rest).require()
    assert [phase.mode for phase in found.phases] == [(0, 0)]
    assert found.cost.transitions == 0
    far = goal + np.array([0.05, 0.0, 0.2, 0.7, -1.5])
    rest = remaining_problem(task, far, [Metal(60.0, 0.0), Metal(58.0, 0.0)])
    assert rest.goal.half_width[3:] == pytest.approx([0.7, PLANNED / 2], abs=1e-6)
    assert plan(rest).require().cost.transitions == 2  # type: ignore[union-attr]
    only = remaining_problem(task, far, [Metal(66.0, 1.0), Metal(30.0, 0.0)], broken={1})
    assert only.start_mode == (1, 0)
    assert set(only.modes) == {(0, 0), (1, 0)}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_rest_is_planned_from_metal_as_it_is_while_it_melts(seed: int) -> None:
    made = planned("paper-2", robot=ARC)
    robot = SimulatedRobot(made.problem, "arc", LEVELS["moderate"], seed)
    controller = plan_controller(made, robot.camera)
    while robot.segments[0].melt_fraction < 0.5:
        command = controller.step(robot.read())
        robot.send(command.wheel_rad_s, command.heater_setpoint_C)
        robot.wait(command.at_most_s)
    metal = [one for one in controller.belief.metal if one is not None]
    assert metal[0].melt_fraction == pytest.approx(0.5, abs=0.3)
    rest = remaining_problem(made.problem, robot.q, metal)
    assert rest.start_stiffness == (None, 0)
    melt = plan(rest).require().transitions[0]
    assert (melt.segment, melt.to, melt.onset_s) == (1, "soft", 0.0)


def test_accuracy_counts_distances_in_its_own_units() -> None:
    error = np.array([1.2e-3, 1.6e-3, np.radians(0.5), 0.2, -0.9])
    assert ACCURACY.of_pose(error) == pytest.approx(1.0)
    assert ACCURACY.of_shape(error) == pytest.approx(0.9)
    assert not ACCURACY.surely(error)
    assert ACCURACY.surely(0.6 * error)
    assert "2.0 mm, 0.50 degrees, +0.20 and -0.90 1/m" in ACCURACY.describe(error)


def test_a_spread_is_median_tail_and_worst() -> None:
    done = simulated("paper-2", 2)
    found = done.metrics
    runs = [found._replace(time_s=float(k)) for k in range(1, 102)]
    assert spread(runs, lambda each: each.time_s) == pytest.approx((51.0, 91.0, 101.0))


# --- what the rest of a plan would come to -------------------------------------------------------


def bent_to(robot: Robot, mode: Mode, q: Array, mean_per_m: float) -> Array:
    """Bend the soft segments by the kinematics until their mean curvature is this."""
    flow, soft = interval_flow(robot, 32), [3 + j for j in soft_segments(mode)]

    def bent(travel_m: float) -> Array:
        after: Array = flow(q, np.array([travel_m, travel_m, 0, 0, 0]), mode).full().ravel()
        return after

    travel_m = newton(lambda s: bent(s)[soft].mean() - mean_per_m, 1e-3, tol=1e-12)
    return bent(travel_m)


@pytest.mark.parametrize("deviation", [(4.0, 0.0), (0.0, 4.0), (-4.0, 0.0), (2.0, -3.0)])
@pytest.mark.parametrize("kappa", [(5.0, 5.0), (20.0, -10.0), (-30.0, 8.0)])
@pytest.mark.parametrize("name", ["2sra-v1-paper", ARC])
def test_a_deviation_ends_where_the_kinematics_takes_it(
    name: str, kappa: tuple[float, float], deviation: tuple[float, float]
) -> None:
    robot = load_problem("paper-1", robot=name).robot
    start = np.array([0.0, 0.0, 0.0, *kappa])
    end = bent_to(robot, (1, 1), start, float(np.mean(kappa)) + 12.0)
    deviated = start + np.array([0.0, 0.0, 0.0, *deviation])
    true = bent_to(robot, (1, 1), deviated, float(end[3:].mean()))
    predicted = predicted_curvatures(robot, deviated, [start, end], [(1, 1)])
    assert predicted == pytest.approx(true[3:], abs=2e-4)
    assert np.abs(predicted - end[3:]).max() > 1.0


@pytest.mark.parametrize("lengths_m", [(0.04, 0.04, 0.04), (0.03, 0.05, 0.04)])
@pytest.mark.parametrize("mode", [(1, 1, 1), (1, 0, 1), (0, 1, 1)])
def test_a_deviation_of_three_segments_ends_where_the_kinematics_takes_it(
    mode: Mode, lengths_m: tuple[float, ...]
) -> None:
    robot = load_problem("three-segments").robot
    geometry = robot.geometry.with_values(segment_length_m=lengths_m)
    robot = robot.with_values(geometry=geometry)
    start, soft = np.array([0.0, 0.0, 0.0, 5.0, -10.0, 20.0]), [3 + j for j in soft_segments(mode)]
    end = bent_to(robot, mode, start, float(start[soft].mean()) + 8.0)
    deviated = start + np.array([0.0, 0.0, 0.0, 3.0, -2.0, 1.0])
    true = bent_to(robot, mode, deviated, float(end[soft].mean()))
    predicted = predicted_curvatures(robot, deviated, [start, end], [mode])
    assert predicted == pytest.approx(true[3:], abs=1e-6)


def test_a_segment_that_bends_alone_loses_its_deviation_and_the_others_keep_theirs() -> None:
    robot, at = load_problem("paper-1", robot="2sra-v1-paper").robot, np.zeros(3)
    path = [np.array([*at, *kappa]) for kappa in ((10.0, 5.0), (20.0, 5.0), (20.0, 5.0))]
    deviated = np.array([*at, 14.0, 4.0])
    alone = predicted_curvatures(robot, deviated, path, [(1, 0), (0, 0)])
    assert alone == pytest.approx([20.0, 4.0], abs=1e-6)
    kept = predicted_curvatures(robot, deviated, [path[0]], [])
    assert kept == pytest.approx([14.0, 4.0], abs=1e-6)


@pytest.mark.parametrize("name", ["2sra-v1-paper", ARC])
def test_what_bends_again_later_may_be_missed_and_is_made_good_then(name: str) -> None:
    robot = load_problem("paper-1", robot=name).robot
    start = np.array([0.0, 0.0, 0.0, 10.0, 5.0])
    both = bent_to(robot, (1, 1), start, 20.0)
    end = bent_to(robot, (1, 0), both, 30.0)
    deviated = start + np.array([0.0, 0.0, 0.0, 4.0, -3.0])
    assert settling([(1, 1), (1, 0)]) == [1]
    assert settling([(1, 1)]) == settling([(1, 1), (0, 0), (1, 1)]) == [0, 1]
    after = predicted_curvatures(robot, deviated, [start, both, end], [(1, 1), (1, 0)])
    assert after == pytest.approx(end[3:], abs=2e-4)
    at_once = predicted_curvatures(robot, deviated, [start, both], [(1, 1)])
    assert np.abs(at_once - both[3:]).max() > 1.0
