"""Runs on a robot that shares nothing with this package, each with one fault.

The large version: ``python -m benchmarks faults --set count=100``.
"""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from once import planned

from benchmarks.foreign import FAULTS, BrokenError, ForeignRobot, rolled, wheels_at
from benchmarks.studies.faults import attacked
from twosra_mpc import Problem, Status, plan
from twosra_mpc.execution import Executor, ExecutorSettings, Reading, RobotError
from twosra_mpc.execution.camera_filter import AGAIN, CameraFilter, usable
from twosra_mpc.execution.doubt import DRIVE_M, Doubt, DoubtError
from twosra_mpc.execution.robot_interface import Camera
from twosra_mpc.execution.run import Ending
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.rolling import held
from twosra_mpc.plans.result import Result
from twosra_mpc.robot.description import load_robot

Array = NDArray[np.float64]
ARC = "2sra-v1"
MELTS = "paper-2"  # segment 1 melts for its second phase

ENDS = [  # executor, fault, scenario, when it begins [s], and how the run ends then
    ("optimal", "dead camera", "rigid-move", 2.0, "right cause"),
    ("optimal", "stale camera", "rigid-move", 2.0, "right cause"),
    ("optimal", "frozen camera", "rigid-move", 2.0, "right cause"),
    ("optimal", "NaN frames", "rigid-move", 0.0, "reached"),
    ("optimal", "wild frames", "rigid-move", 0.0, "reached"),
    ("optimal", "thermistor -127", MELTS, 40.0, "right cause"),
    ("optimal", "thermistor NaN", MELTS, 40.0, "right cause"),
    ("optimal", "thermistor garbage", MELTS, 40.0, "right cause"),
    ("optimal", "thermistor rare", MELTS, 40.0, "right cause"),
    ("optimal", "thermistor high", MELTS, 0.0, "right cause"),
    ("optimal", "thermistor high", MELTS, 98.0, "right cause"),
    ("optimal", "thermistor stuck", MELTS, 75.0, "reached"),  # of the segment that stays solid
    ("optimal", "thermistor drifts", MELTS, 60.0, "right cause"),
    ("optimal", "thermistor scaled", MELTS, 60.0, "reached"),
    ("optimal", "thermistors swapped", MELTS, 60.0, "right cause"),
    ("optimal", "outage", MELTS, 60.0, "reached"),
    ("optimal", "dead heater", MELTS, 80.0, "right cause"),
    ("optimal", "dead heater", MELTS, 0.0, "right cause"),
    ("optimal", "welded relay", MELTS, 0.0, "right cause"),
    ("optimal", "slow cooling", MELTS, 0.0, "right cause"),
    ("optimal", "read raises", "rigid-move", 2.0, "right cause"),
    ("optimal", "send raises", "rigid-move", 2.0, "right cause"),
    ("optimal", "interrupt", "rigid-move", 2.0, "right cause"),
    ("greedy", "dead camera", "rigid-move", 2.0, "right cause"),
    ("greedy", "frozen camera", "rigid-move", 2.0, "right cause"),
    ("greedy", "thermistor -127", MELTS, 1.0, "right cause"),
    ("greedy", "dead heater", MELTS, 0.0, "right cause"),
    ("greedy", "dead heater", "paper-1", 0.0, "right cause"),  # both at once
    ("greedy", "read raises", "rigid-move", 2.0, "right cause"),
    ("greedy", "interrupt", "rigid-move", 2.0, "right cause"),
]


@pytest.mark.parametrize(("executor", "fault", "scenario", "begins_s", "came_to"), ENDS)
def test_every_ending_is_true_and_leaves_the_robot_off(
    executor: str, fault: str, scenario: str, begins_s: float, came_to: str
) -> None:
    found = attacked(planned(scenario, robot=ARC), executor, fault, 1, begins_s)
    assert found["came_to"] == came_to, found
    assert found["off"]
    assert found["blind_m"] < 0.1
    assert found["forced_m"] < 0.03
    if fault.startswith("thermistor"):
        assert found["hottest_C"] < 85.0
        assert found["mattered_s"] < 60.0 or fault in ("thermistor drifts", "thermistor scaled")
    assert found["hottest_C"] < 100.0


def test_every_fault_is_known_to_end_somehow() -> None:
    assert {fault for _, fault, *_ in ENDS} >= FAULTS.keys() - {"none", "runaway", "planner raises"}


@pytest.mark.parametrize("mode", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_its_arcs_are_those_of_the_model(mode: tuple[int, int]) -> None:
    robot, rng = load_robot(ARC), np.random.default_rng(1)
    soft = [j for j in range(2) if mode[j]]
    q, v = np.array([0.1, 0.2, 0.3, *rng.uniform(-20, 20, 2)]), np.zeros(5)
    v[slice(0, 2) if soft else slice(2, 5)] = rng.uniform(-0.02, 0.02, 2 if soft else 3)
    wheels = kinematics(robot).wheel_matrix(q, mode).full() @ v
    known = kinematics(robot).jacobian(q, mode).full() @ v
    assert rolled(robot, q, wheels, soft) == pytest.approx(known, abs=1e-3)


class Hooked(ForeignRobot):
    """Something happens at a time."""

    at_s, hook = 2.0, staticmethod(lambda: None)

    def wait(self, at_most_s: float) -> None:
        super().wait(at_most_s)
        if self.time_s >= self.at_s:
            self.at_s = np.inf
            self.hook()


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGUSR1", "SIGALRM"])
def test_a_signal_that_ends_the_program_stops_the_robot_first(name: str) -> None:
    made, number = planned("rigid-move", robot=ARC), getattr(signal, name)
    robot, before = Hooked(made.problem), signal.getsignal(number)
    robot.hook = partial(os.kill, os.getpid(), number)
    with pytest.raises(KeyboardInterrupt):
        Executor(robot).run(made)
    assert robot.off
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("swallowed", [True, False])
def test_an_interrupt_that_a_library_swallows_stops_the_robot_all_the_same(swallowed: bool) -> None:
    """CasADi makes other errors of it, or none."""
    made = planned("rigid-move", robot=ARC)
    robot = Hooked(made.problem)

    def swallow() -> None:
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            if not swallowed:
                raise AttributeError("no attribute 'full'") from None

    robot.hook = swallow  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        Executor(robot).run(made)
    assert robot.off
    assert robot.time_s < robot.camera.period_s + 2.5


class Deaf(ForeignRobot):
    """A robot whose line fails once the wheels have turned."""

    error: BaseException

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        if self.wheels.any() and self.time_s > 1.0 and (error := vars(self).pop("error", None)):
            raise error
        super().send(wheel_rad_s, heater_setpoint_C)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(1), MemoryError()])
def test_a_line_that_raises_what_ends_programs_is_told_to_stop_all_the_same(error: Any) -> None:
    made = planned("rigid-move", robot=ARC)
    robot = Deaf(made.problem)
    robot.error = error
    with pytest.raises(type(error)):
        Executor(robot).run(made)
    assert robot.off


class Moved(Hooked):
    """A robot that somebody moves."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.hook = self.push  # type: ignore[assignment]

    def push(self) -> None:
        self.q = self.q + np.array([0.15, 0.1, 0.2, 0.0, 0.0])


def test_a_robot_that_was_moved_is_found_again_and_stands_while_somebody_plans() -> None:
    made = planned("rigid-move", robot=ARC)
    robot = Moved(made.problem)
    run = Executor(robot, think=robot.think).run(made)
    assert run.ending is Ending.REACHED
    assert made.robot.ends_within.of(made.problem.judged_goal.error(robot.q.copy())) <= 1.0
    assert run.corrections + run.replans >= 1
    assert robot.planning_m == 0.0


def test_a_planner_that_raises_leaves_the_robot_off() -> None:
    made = planned("rigid-move", robot=ARC)
    robot = Moved(made.problem)

    def think(problem: Problem) -> Result:
        raise BrokenError("the planner is gone")

    with pytest.raises(BrokenError):
        Executor(robot, think=think).run(made)
    assert robot.off


def test_a_planner_that_never_answers_is_waited_for_as_long_as_a_run_may_take() -> None:
    made = planned("rigid-move", robot=ARC)
    robot = Moved(made.problem)
    run = Executor(robot, ExecutorSettings(longest_s=60.0), think=lambda problem: None).run(made)
    assert run.ending is Ending.TIME_LIMIT
    assert run.duration_s < 63.0
    assert robot.off


def test_a_plan_that_does_not_verify_is_not_adopted() -> None:
    made = planned("rigid-move", robot=ARC)
    robot = Moved(made.problem)

    def think(problem: Problem) -> Result:
        return replace(plan(problem), status=Status.FAILED)

    run = Executor(robot, think=think).run(made)
    assert run.ending is Ending.NO_PLAN
    assert len(run.plans) == 1
    assert robot.off


def test_a_goal_that_was_reached_unseen_is_not_called_reached() -> None:
    """The camera dies while the robot looks where it has come to."""
    made = planned("rigid-move", robot=ARC, gap=0.06)
    robot = ForeignRobot(made.problem, 0, "dead camera", made.duration_s + 1.0)
    run = Executor(robot).run(made)
    assert run.ending is Ending.UNSEEN
    assert "arrived by dead reckoning, not seen for" in run.reason
    assert not run.reached


# --- frames --------------------------------------------------------------------------------------

Q = np.array([0.1, 0.2, 0.3, 5.0, -5.0])
CAMERA = Camera(noise=(1e-3, 0.02, 1.0))


def read(time_s: float, *taken: tuple[float, Array]) -> Reading:
    known = (25.0, 25.0), ("rigid", "rigid"), (False, False)
    times, frames = [time_s for time_s, _ in taken], [frame for _, frame in taken]
    return Reading(time_s, np.array(times), np.array(frames).reshape(-1, 5), *known)


def test_only_new_finite_frames_of_now_are_of_use() -> None:
    nan = Q * [1, 1, 1, np.nan, 1]
    reading = read(
        10.0, (9.0, Q), (9.5, Q), (9.5, Q), (9.6, nan), (np.nan, Q), (7.0, Q), (12.0, Q), (9.9, Q)
    )
    assert usable(reading, 9.0).taken_s.tolist() == [9.5, 9.9]
    assert usable(reading, 10.0).taken_s.tolist() == []
    with pytest.raises(RobotError, match="clock"):
        usable(read(np.nan), 0.0)


def test_a_wild_frame_is_not_believed_and_many_that_agree_are() -> None:
    belief = CameraFilter(CAMERA, Q, 0.0)
    wild = Q + np.array([0.5, -0.3, 1.0, 30.0, 0.0])
    there = Q + np.array([0.2, 0.0, 0.0, 0.0, 0.0])
    assert belief.correct(np.zeros(3), np.array([Q, wild, Q])).tolist() == [True, False, True]
    assert belief.q == pytest.approx(Q)
    for k in range(AGAIN):
        assert belief.q == pytest.approx(Q)
        believed = belief.correct(np.zeros(1), there[None] + 1e-3 * k)
        assert believed[0] == (k == AGAIN - 1)
    assert belief.q == pytest.approx(there, abs=5e-3)


def test_a_picture_that_stays_although_the_robot_was_driven_is_no_news() -> None:
    moved, belief = np.array([1e-3, 0.0, 0.0, 0.0, 0.0]), CameraFilter(CAMERA, Q, 0.0)
    seen = []
    for k in range(1, 40):
        drives = moved if k < 20 else 0 * moved  # it stands, but nobody has seen where
        belief.predict(k / 15, drives, (0.04, 0.04))
        seen += belief.correct(np.array([k / 15]), Q[None]).tolist()
    assert seen == [k <= 10 for k in range(1, 40)]  # mm
    assert belief.frozen
    belief.predict(41 / 15, 0 * moved, (0.04, 0.04))
    assert belief.correct(np.array([41 / 15]), Q[None] + 1e-4).tolist() == [True]
    assert not belief.frozen
    assert belief.q[0] == pytest.approx(Q[0], abs=5e-3)


# --- motion --------------------------------------------------------------------------------------

LENGTHS_M = (0.04, 0.04)


def moved(share: float, bends: bool, slides_m: float = 0.0, holds: float = 1.0) -> None:
    """Drive for long, of which a share is seen to happen."""
    doubt, period = Doubt(LENGTHS_M), np.array([1e-3, 0.0, 0.0, 0.0, 0.0])
    if bends:
        period = np.array([0.0, 0.0, 0.0, 0.2, 0.0])
    for k in range(200):
        seen = share * period + [slides_m, 0.0, 0.0, 0.0, 0.0]
        if doubt.take(k / 15, (1, 0) if bends else (0, 0), period, seen, held=holds):
            doubt.look(0 * seen)
            doubt.judge(k / 15, "segment 1 soft at 66.0 C")


def test_motion_that_does_not_happen_is_doubted_and_a_tenth_of_it_is_not() -> None:
    for share in (0.1, 0.3, 1.0):
        moved(share, bends=True)
        moved(0.6 * share, bends=False)
    for share in (0.0, 0.02, 0.04):
        with pytest.raises(DoubtError, match=f"{1e3 * DRIVE_M:.0f} mm are commanded, "):
            moved(share, bends=False)
    with pytest.raises(DoubtError, match=r"does not bend: .* are seen on 15 mm") as caught:
        moved(0.01, bends=True, slides_m=1e-3)
    assert caught.value.bends
    with pytest.raises(DoubtError, match="is its camera alive") as caught:
        moved(0.01, bends=True)
    assert not caught.value.bends


@pytest.mark.parametrize(("bends", "stiff"), [((1.44, 0.56), ()), ((1.0, 0.0), (1,))])
def test_one_of_two_soft_segments_that_alone_is_stiff_is_found_before_it_is_pushed_far(
    bends: tuple[float, float], stiff: tuple[int, ...]
) -> None:
    doubt, found, looks = Doubt(LENGTHS_M), (), 0
    period = np.array([0.0, 0.0, 0.0, 0.2, 0.2])
    for k in range(20):
        if doubt.take(k / 15, (1, 1), period, period * [1.0, 1.0, 1.0, *bends]):
            looks += 1
            try:
                doubt.look(0 * period)
                doubt.judge(k / 15, "both soft")
            except DoubtError as error:
                found = error.segments
                break
    assert (found, looks) == (stiff, 1)


def test_a_bend_that_wheels_do_not_hold_is_no_evidence_against_a_sensor() -> None:
    """The hold is compared with how little a motion turns wheels, by their places."""
    robot, soft = load_robot(ARC), (0, 1)
    for kappa, singular in (((28.0, -16.17), True), ((28.0, 10.0), False)):
        q = np.array([0.0, 0.0, 0.3, *kappa])
        rows = np.array([wheels_turned(q, each) for each in np.eye(5)[[0, 1, 2, 4]]])
        least = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None])[1][-1]
        holds = held(robot.body, soft, q)
        assert holds == pytest.approx(least**2 / (least**2 + 0.03**2), rel=0.05, abs=1e-3)
        assert (holds < 0.01) == singular
        with pytest.raises(DoubtError) as caught:
            moved(0.0, bends=True, slides_m=1e-3, holds=holds)
        assert caught.value.stalled == singular
        assert caught.value.bends != singular
        assert caught.value.segments == (() if singular else (0,))


def wheels_turned(q: Array, change: Array) -> Array:
    """How wheels roll as q changes, by their places."""
    step = 1e-6
    directions, places = wheels_at(load_robot(ARC), np.vstack([q, q + step * change]))
    rolled: Array = ((places[1] - places[0]) * directions[0]).sum(axis=1) / step
    return rolled


def test_the_belief_follows_bends_that_rigid_drives_flex() -> None:
    """Solid metal flexes by 0.6 1/m in a drive of four seconds; the belief covers it afterwards."""
    rng, missed = np.random.default_rng(0), []
    for _ in range(20):
        belief, period = CameraFilter(CAMERA, Q, 0.0), np.array([1e-3, 0.0, 0.0, 0.0, 0.0])
        there = Q.copy()
        for k in range(60):
            there = there + period + [0.0, 0.0, 0.0, 0.01, 0.01]
            belief.predict((k + 1) / 15, period, LENGTHS_M)
            noise = CAMERA.noise * rng.normal(size=3)
            frame = there + noise[[0, 0, 1, 2, 2]]
            belief.correct(np.array([(k + 1) / 15]), frame[None])
        missed.append((belief.q - there)[3:] / belief.deviation[3:])
    assert np.sqrt(np.mean(np.square(missed))) < 1.6


SHORT_PER_M, LONG_PER_M = 0.43, 0.2  # noise of a look at `hard`: between two averages of 45, 180


def doubted(rng: np.random.Generator, share: float, split: float, slide_m: float) -> bool:
    """Bend by 15 1/m with both segments; looks are as noisy as at `hard`."""
    doubt, period = Doubt(LENGTHS_M), np.array([0.0, 0.0, 0.0, 0.2, 0.2])
    noise = np.zeros(5)
    bends = share * np.array([1 + split, 1 - split])
    for k in range(75):
        slides = [slide_m * 0.04 * 0.2 * (share or 1.0), 0.0, 0.0, *(0.2 * bends)]
        if doubt.take(k / 15, (1, 1), period, np.array(slides)):
            looked = np.array([0.0, 0.0, 0.0, *rng.normal(0.0, SHORT_PER_M, 2)])
            clear = doubt.look(looked - noise)
            noise = looked
            if not clear:
                looked = np.array([0.0, 0.0, 0.0, *rng.normal(0.0, LONG_PER_M, 2)])
                doubt.look_again(looked - noise)
                noise = looked
            try:
                doubt.judge(k / 15, "both soft")
            except DoubtError:
                return True
    return False


def test_metal_that_bends_little_while_the_robot_slides_far_is_told_from_solid_metal() -> None:
    """Pivots and slides of b0 at `hard` come to 0.1 to 0.3 m a radian of bend, rarely 0.45."""
    rng = np.random.default_rng(0)
    soft = [
        doubted(rng, rng.uniform(0.15, 1.0), rng.uniform(-0.44, 0.44), rng.uniform(0.0, 0.30))
        for _ in range(300)
    ]
    solid = [doubted(rng, 0.0, 0.0, rng.uniform(0.2, 0.6)) for _ in range(300)]
    assert np.mean(soft) < 0.02
    assert np.mean(solid) > 0.99
