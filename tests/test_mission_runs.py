"""Missions in closed loop: carried objects arrive, lost ones are noticed, what is left is asked."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from once import solved
from test_mission_figures import drawn_objects

from twosra_mpc import Plan, Problem, Result, load_problem, plan
from twosra_mpc.execution import Ending, Executor, Patience, Reading, Run, SimulatedRobot
from twosra_mpc.execution.guard import Guard, ObjectsSeen
from twosra_mpc.execution.simulation import plant as simulated
from twosra_mpc.execution.simulation.disturbance import LEVELS
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.plotting import plot_run, world_figures
from twosra_mpc.plotting.run_figures import run_playback
from twosra_mpc.problem.goals import Anywhere
from twosra_mpc.problem.world import ACCURACY
from twosra_mpc.robot.coordinates import POSE, composed, inverse
from twosra_mpc.space.convex import convex_parts

Array = NDArray[np.float64]

CAGE = (39.0, 39.0)
IN_B0 = np.array([0.0, 0.0342, 0.0])
DISC = {"radius_m": 0.03}


def carry(to: Any = (0.2, -0.1, 0.5), **more: Any) -> Problem:
    """A robot at the origin that is curled round a cup and carries it."""
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": CAGE, "holding": "cup"}
    x, y, phi = composed(np.array(to, dtype=float), IN_B0)
    cup = {"name": "cup", "disc": DISC, "pose": {"x_m": IN_B0[0], "y_m": IN_B0[1]}}
    task = {"do": "carry", "object": "cup", "x_m": x, "y_m": y, "phi_rad": phi}
    given = {"start": start, "goal": Anywhere(), "objects": [cup], "tasks": [task], **more}
    return load_problem("rigid-move", gap=0.06, motion="fastest").with_values(**given)


def driven(problem: Problem) -> Result:
    """A plan that carries what is held straight to where it is to be, made by hand."""
    goal, held = problem.tasks[-1], problem.objects[0].pose.pose
    in_b0 = composed(inverse(problem.start.configuration[:POSE]), held)
    there = composed(np.array([goal.x_m, goal.y_m, goal.phi_rad or 0.0]), inverse(in_b0))  # type: ignore[attr-defined]
    where = dict(zip(("x_m", "y_m", "phi_rad"), there.tolist(), strict=True))
    drive = problem.with_values(
        start=problem.start.with_values(holding=None),
        goal={**where, "kappa_per_m": problem.start.kappa_per_m},
        objects=(),
        tasks=(),
    )
    found = plan(drive)
    made = found.require()
    done_s = (made.trajectory.duration_s,) * len(problem.tasks)
    trajectory = replace(made.trajectory, problem=problem, done_s=done_s)
    return replace(found, problem=problem, plan=replace(made, trajectory=trajectory))


@pytest.fixture(scope="module")
def carried() -> Plan:
    return driven(carry()).require()


class Planner:
    """Writes down what it is asked to plan."""

    def __init__(self, answer: Callable[[Problem], Result]) -> None:
        self.asked: list[Problem] = []
        self._answer = answer

    def __call__(self, problem: Problem) -> Result:
        self.asked.append(problem)
        return self._answer(problem)


def nothing(problem: Problem) -> Result:
    """No plan."""
    found = solved("paper-1", work_limit=1e-9, max_phases=1)
    return replace(found, problem=problem, plan=None, words="there is no way")


@pytest.fixture
def planner(monkeypatch: pytest.MonkeyPatch) -> Planner:
    made = Planner(driven)
    monkeypatch.setattr(simulated, "plan_again", made)
    return made


class Slipping(SimulatedRobot):
    """A robot whose object is moved by somebody, once, as seen from b0."""

    def __init__(self, problem: Problem, at_s: float, to_b0: Any) -> None:
        super().__init__(problem, "as-planned", LEVELS["mild"])
        self._at_s, self._to_b0 = at_s, np.array(to_b0)

    def wait(self, at_most_s: float) -> None:
        super().wait(at_most_s)
        if self.objects is not None and self.time_s >= self._at_s:
            self._at_s = np.inf
            self.objects.poses[0] = composed(self.q[:POSE], self._to_b0)


def found_lost(run: Run) -> float:
    """When the run noticed that something was lost."""
    return next(event.time_s for event in run.events if event.kind == "failure")


def test_a_caged_cup_arrives_and_its_file_says_where_it_was(
    carried: Plan, planner: Planner
) -> None:
    found = simulate(carried.problem, plan=carried, disturbance="moderate", seed=1)
    assert found.metrics.reached
    assert found.run.reason == "all tasks are done"
    assert found.metrics.tasks_done == 1
    assert found.metrics.object_m is not None
    assert found.metrics.object_m <= ACCURACY[0]
    assert found.metrics.lost == 0
    moved = found.truth.objects[-1, 0, :2] - found.truth.objects[0, 0, :2]
    assert np.hypot(*moved) > 0.15
    assert len(found.truth.objects) == len(found.truth.time_s)
    data = json.loads(json.dumps(found.to_dict()))
    np.testing.assert_allclose(data["truth"]["objects"], found.truth.objects)
    assert data["done_s"] == list(found.run.done_s)
    assert len(data["done_s"]) == 1
    without = simulate(load_problem("rigid-move"), disturbance="none").to_dict()
    assert "objects" not in without["truth"]
    assert without["metrics"]["object_m"] is None

    shown = drawn_objects(plot_run(found.run, found.truth).axes[0])
    ends = [world_figures.outlines_m(carried.problem, at)[0] for at in found.truth.objects[[0, -1]]]
    np.testing.assert_allclose(shown, ends)
    assert len(drawn_objects(plot_run(found.run).axes[0])) == 1  # a log does not know the other
    filmed = run_playback(found.run, found.truth).objects
    np.testing.assert_allclose(filmed[[0, -1]], found.truth.objects[[0, -1]], atol=1e-3)


@pytest.mark.parametrize("at_s", [6.5, 11.5])
def test_a_cup_that_slides_is_brought_back(carried: Plan, planner: Planner, at_s: float) -> None:
    open_cage = carry(objects=[{**dict(carry().objects[0]), "disc": {"radius_m": 0.0275}}])
    made = replace(carried, trajectory=replace(carried.trajectory, problem=open_cage))
    slid = composed(IN_B0, np.array([0.004, 0.004, 0.0]))
    robot = Slipping(open_cage, at_s, slid)
    run = Executor(robot, think=planner).run(made)
    assert run.reached
    assert not run.corrections
    assert not planner.asked
    goal = open_cage.tasks[0]
    off = robot.truth().objects[-1, 0, :2] - [goal.x_m, goal.y_m]  # type: ignore[attr-defined]
    assert np.hypot(*off) <= ACCURACY[0]


def test_a_lost_cup_is_noticed_within_two_seconds_and_grasped_again(
    carried: Plan, planner: Planner
) -> None:
    planner._answer = nothing
    robot = Slipping(carried.problem, 3.0, [0.0, 0.15, 0.0])
    run = Executor(robot, think=planner).run(carried)
    assert run.ending is Ending.OBJECT_LOST
    assert "mm from where it was held" in run.reason
    assert "there is no way" in run.reason
    assert run.lost == 1
    assert 3.0 <= found_lost(run) <= 5.0
    stands = run.log.wheel_rad_s[run.log.time_s > found_lost(run) + 0.5]
    assert not stands.any()
    asked = planner.asked[-1]
    assert [task.do for task in asked.tasks] == ["grasp", "carry"]
    assert asked.start.holding is None
    truly = robot.truth().objects[-1, 0, :2]
    assert np.hypot(*(asked.objects[0].pose.pose[:2] - truly)) < 1e-3


def test_a_cup_lost_on_its_path_is_led_along_the_rest_alone(planner: Planner) -> None:
    begin, end = IN_B0[:2], np.add(IN_B0[:2], [0.4, 0.0])
    path = {"path": [begin.tolist(), end.tolist()], "position_tolerance_m": 0.02}
    cup = {**dict(carry().objects[0]), "disc": {"radius_m": 0.0275}}
    led = carry(objects=[cup], tasks=[{"do": "follow", "object": "cup", **path}])
    planner._answer = nothing
    robot = Slipping(led, 4.0, [0.0, 0.15, 0.0])
    run = Executor(robot, think=planner).run(plan(led).require())
    assert run.ending is Ending.OBJECT_LOST
    grasp, follow = planner.asked[-1].tasks[0], planner.asked[-1].tasks[-1]
    assert (grasp.do, follow.do) == ("grasp", "follow")
    truth = robot.truth()
    before = truth.objects[truth.time_s < 4.0, 0, 0].max() - begin[0]
    assert follow.from_m == pytest.approx(before, abs=0.02)  # type: ignore[attr-defined]
    assert 0.03 < before < 0.35


def test_a_cup_lost_too_often_ends_the_run(carried: Plan, planner: Planner) -> None:
    class Always(Slipping):
        def wait(self, at_most_s: float) -> None:
            if self._told_rad_s.any() and self._at_s == np.inf:
                self._at_s, self._to_b0 = 0.0, self._to_b0 + np.array([0.0, 0.05, 0.0])
            super().wait(at_most_s)

    regrasped = Planner(lambda problem: driven_again(problem, carried))
    planner._answer = regrasped
    run = Executor(Always(carried.problem, 1.0, [0.0, 0.15, 0.0]), think=planner).run(carried)
    assert run.ending is Ending.OBJECT_LOST
    assert "lost 4 times" in run.reason
    assert len(regrasped.asked) == 3


def driven_again(problem: Problem, made: Plan) -> Result:
    """A plan that takes the cup to be held at once."""
    still = problem.with_values(
        start=problem.start.with_values(holding="cup"), tasks=made.problem.tasks
    )
    found = driven(still)
    drive = found.require()
    done_s = (0.0, drive.trajectory.duration_s)
    trajectory = replace(drive.trajectory, problem=problem, done_s=done_s)
    return replace(found, problem=problem, plan=replace(drive, trajectory=trajectory))


class Blind(SimulatedRobot):
    """A robot whose camera sees no objects."""

    def read(self) -> Reading:
        return replace(super().read(), objects=None)


def test_a_robot_whose_camera_sees_no_objects_carries_on_trust(
    carried: Plan, planner: Planner
) -> None:
    robot = Blind(carried.problem, "as-planned", LEVELS["moderate"])
    run = Executor(robot, think=planner).run(carried)
    assert run.reached
    goal = carried.problem.tasks[0]
    off = robot.truth().objects[-1, 0, :2] - [goal.x_m, goal.y_m]  # type: ignore[attr-defined]
    assert np.hypot(*off) <= 2 * ACCURACY[0]


def test_what_is_carried_is_guarded_as_a_part_of_the_robot() -> None:
    post = {"name": "post", "box": {"x_m": [-0.002, 0.002], "y_m": [0.067, 0.07]}}  # near the cup
    problem = carry(obstacles=[post])
    pieces = convex_parts(problem.objects[0].at(IN_B0).corners_m)
    q, still = problem.start.configuration, np.zeros(5)
    nearer = q + np.array([0.0, 0.0015, 0.0, 0.0, 0.0])
    alone, both = Guard(problem, Patience()), Guard(problem, Patience(), None, pieces)
    for guard, forbids in ((alone, False), (both, True)):
        guard.begin(q)
        assert not guard.forbids((0, 0), q[None], still)
        assert guard.forbids((0, 0), nearer[None], still) is forbids


def test_objects_are_means_of_frames_that_follow_what_moves() -> None:
    problem, rng = carry(), np.random.default_rng(1)
    seen = ObjectsSeen(problem)
    frames = np.tile([0.1, 0.0, 3.1, *CAGE], (200, 1))
    pose = np.array([0.3, 0.1, 3.14])
    noisy = pose + rng.normal(0, [1e-3, 1e-3, 0.02], (200, 1, 3))
    noisy[..., 2] = np.remainder(noisy[..., 2] + np.pi, 2 * np.pi) - np.pi
    seen.take(frames, np.where(np.arange(600).reshape(200, 1, 3) % 9 > 2, noisy, np.nan))
    assert np.hypot(*(seen.poses[0] - pose)[:2]) < 1e-3
    assert abs(np.remainder(seen.poses[0, 2] - pose[2] + np.pi, 2 * np.pi) - np.pi) < 0.02
    expected = composed(inverse(frames[0, :POSE]), pose)
    assert np.hypot(*(seen.in_b0[0] - expected)[:2]) < 1e-3
    seen.take(frames[:30], noisy[:30] + np.array([0.1, 0.0, 0.0]))  # two seconds later
    assert abs(seen.poses[0, 0] - pose[0] - 0.1) < 5e-3
