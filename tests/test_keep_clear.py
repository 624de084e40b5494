"""Runs keep clear of what is around the robot: stopped before a touch, planned again, or ended."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from twosra_mpc import Plan, Problem, Result, load_problem, load_robot, plan
from twosra_mpc.execution import Ending, Executor, ExecutorSettings, Patience, Run, SimulatedRobot
from twosra_mpc.execution.guard import Guard
from twosra_mpc.execution.mission import tasks_left
from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.execution.simulation.simulate import closest_approach, simulate
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.space.separation import EDGE, Proximity

Array = NDArray[np.float64]

ROBOT = load_robot("2sra-v1")
STRAIGHT = {"phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
WALL = {"name": "wall", "box": {"x_m": [-0.4, 0.8], "y_m": [0.06, 0.1]}}  # 24 mm beside the drive
ASIDE = np.array([0.0, 4e-3, 0.0])  # more in a period than the tracker makes good
AT_ONCE = ExecutorSettings(stops=0)


def drive(**around: Any) -> Problem:
    """A straight robot to be driven along its own axis."""
    start, goal = {"x_m": 0.0, "y_m": 0.0, **STRAIGHT}, {"x_m": 0.3, "y_m": 0.0, **STRAIGHT}
    return load_problem("rigid-move", start=start, goal=goal, gap=0.06).with_values(**around)


@pytest.fixture(scope="module")
def straight() -> Plan:
    return plan(drive()).require()


def among(made: Plan, **around: Any) -> Plan:
    """The same plan of a problem with something around."""
    problem = made.problem.with_values(**around)
    return replace(made, trajectory=replace(made.trajectory, problem=problem))


class Dragged(SimulatedRobot):
    """A robot that something drags aside whenever it drives."""

    def wait(self, at_most_s: float) -> None:
        if self._told_rad_s.any():
            self.push(ASIDE)
        super().wait(at_most_s)


def dragged(made: Plan) -> tuple[Run, Truth]:
    robot = Dragged(made.problem, "as-planned")
    return Executor(robot, AT_ONCE).run(made), robot.truth()


def in_words(run: Run, name: str) -> float:
    """Millimetres at which a run says it was stopped."""
    assert run.ending is Ending.TOO_NEAR
    words = run.reason.split()
    assert words[0] == "stopped"
    assert name in run.reason.split(";")[0]
    assert run.events[-1].kind == "end"
    return float(words[1])


def assert_left_safe(run: Run) -> None:
    assert not run.log.wheel_rad_s[-2:].any()
    assert (run.log.setpoint_C[-1] == run.problem.robot.heater.rigid_setpoint_C).all()


def test_a_robot_that_is_dragged_towards_a_wall_is_stopped_before_it(straight: Plan) -> None:
    run, truth = dragged(among(straight, obstacles=[WALL]))
    stopped_mm = in_words(run, "wall")
    near = closest_approach(run.problem.world, ROBOT.geometry, truth)
    assert near is not None
    assert not near.touched
    assert near.name == "wall"
    assert 0.0 < near.clearance_m <= 1e-3 * stopped_mm + 1e-3 < 0.02
    assert_left_safe(run)


def test_without_the_wall_the_same_drag_goes_on(straight: Plan) -> None:
    robot = Dragged(straight.problem, "as-planned")
    run = Executor(robot, replace(AT_ONCE, corrections=0, replans=0)).run(straight)
    assert run.ending is not Ending.TOO_NEAR
    assert robot.truth().q[:, 1].max() > 0.03


def test_a_robot_is_stopped_at_the_edge_of_its_workspace(straight: Plan) -> None:
    run, truth = dragged(among(straight, workspace={"y_m": [-0.2, 0.06]}))
    in_words(run, EDGE)  # it did not know of the last drag
    shape = robot_shape(ROBOT.geometry, truth.q)
    assert max(shape.units[..., 1].max(), shape.wheels[..., 1].max()) < 0.06 + 2 * ASIDE[1]
    assert_left_safe(run)


@pytest.mark.parametrize(
    ("around", "name"),
    [
        ({"obstacles": [{"name": "wall", "box": {"x_m": [0.3, 0.4], "y_m": [-0.1, 0.1]}}]}, "wall"),
        ({"workspace": {"x_m": [-0.3, 0.3]}}, EDGE),
    ],
)
def test_the_greedy_rule_is_stopped_too(around: dict[str, Any], name: str) -> None:
    done = simulate(drive(**around), disturbance="mild", seed=1, executor="greedy")
    in_words(done.run, name)
    assert not done.metrics.reached
    assert not done.metrics.touched
    assert_left_safe(done.run)


@pytest.mark.parametrize(("most_m", "asked"), [(0.02, 2), (0.0, 8)])
def test_a_run_asks_for_the_clearance_it_needs_and_then_for_less(
    straight: Plan, most_m: float, asked: int
) -> None:
    """Where none is planned, it follows the plan that it was given."""
    made, told, found = among(straight, obstacles=[WALL]), list[float](), list[Result]()

    def think(problem: Problem) -> Result:
        told.append(problem.clearance_m)
        if not found:
            found.append(plan(problem.with_values(clearance_m=0.002)))
        return found[0] if told[-1] <= most_m else replace(found[0], plan=None)

    robot = SimulatedRobot(made.problem, "as-planned")
    run = Executor(robot, ExecutorSettings(clearance_m=0.025), think=think).run(made)
    assert run.reached
    assert told == pytest.approx(0.025 * 0.7 ** np.arange(asked))
    missed = [event for event in run.events if "no plan is found that keeps" in event.text]
    assert len(missed) == asked - (most_m > 0.0)
    assert len(run.plans) == 1 + (most_m > 0.0)


def test_a_rigid_drive_that_leaves_its_narrow_corridor_is_planned_again(straight: Plan) -> None:
    class Pushed(SimulatedRobot):
        pushed = False

        def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
            super().send(wheel_rad_s, heater_setpoint_C)
            if wheel_rad_s.any() and not self.pushed:
                self.pushed = True
                self.push(-7.5 * ASIDE)

    far = {"name": "far", "disc": {"x_m": 0.0, "y_m": 2.0, "radius_m": 0.1}}
    for made, corrections in ((straight, 0), (among(straight, obstacles=[far]), 1)):
        run = Executor(Pushed(made.problem, "as-planned")).run(made)
        assert run.ending is Ending.REACHED
        assert run.corrections == corrections


def test_a_robot_that_was_stopped_may_drive_away_but_no_nearer() -> None:
    guard = Guard(drive(obstacles=[WALL]), Patience())
    sure, near = np.zeros(5), np.array([0.0, 0.022, 0.0, 0.0, 0.0])
    unsure, aside = np.array([3e-3, 3e-3, 0.0, 0.0, 0.0]), np.array([0.0, 1e-3, 0.0, 0.0, 0.0])
    guard.begin(near)
    assert guard.pace(near[None] - 40 * aside, sure) == 1.0
    assert guard.pace(near[None], unsure) == 0.125  # it is seen better then
    assert not guard.forbids((0, 0), np.array([near, near - aside]), sure)
    assert not guard.forbids((0, 0), np.array([near - aside]), unsure)
    assert guard.forbids((0, 0), np.array([near, near + aside]), sure)
    assert guard.forbids(
        (1, 0), np.array([near - aside]), unsure
    )  # it may go anywhere while it bends
    guard.begin(near - 20 * aside)
    assert guard.forbids((0, 0), np.array([near - aside]), unsure)


def test_distances_hold_whatever_the_shape() -> None:
    rng = np.random.default_rng(5)
    world = World(
        obstacles=[WALL, {"disc": {"x_m": 0.1, "y_m": -0.25, "radius_m": 0.05}}],
        workspace={"x_m": [-0.4, 0.4], "y_m": [-0.4, 0.4]},
    )
    around = Proximity(world, ROBOT.geometry)
    q = rng.uniform([-0.3, -0.3, -3.0, -60, -60], [0.3, 0.3, 3.0, 60, 60], (200, 5))
    found = around.distances(q)
    shape = robot_shape(ROBOT.geometry, q)
    points = np.concatenate([p.reshape(len(q), -1, 2) for p in (shape.units, shape.wheels)], axis=1)
    wall = np.linalg.norm(points - np.clip(points, [-0.4, 0.06], [0.8, 0.1]), axis=-1).min(axis=1)
    inside = (0.4 - np.abs(points)).min(axis=(1, 2))
    assert (found[:, 0] <= wall + 1e-9).all()
    assert (found[:, 2] <= np.minimum(inside, 0.25) + 1e-9).all()
    nearest = around.nearest(q[0])
    assert nearest.distance_m == found[0].min()
    assert nearest.name == ("wall", "obstacle 2", EDGE)[int(found[0].argmin())]


def truth_along(places: Array) -> Truth:
    rows = len(places)
    metal = np.zeros((rows, 2))
    return Truth(np.arange(float(rows)), places, metal, metal, metal, metal, np.zeros(rows))


def test_a_touch_between_two_rows_is_found_and_counts_as_failed() -> None:
    post = Obstacle(name="post", box={"x_m": [0.2, 0.205], "y_m": [-0.01, 0.01]})
    places, tip = np.zeros((4, 5)), 0.145  # outer edge of the wheels
    places[1:, :2] = [(0.0, -0.4), (0.5, -0.4), (0.5, 0.4)]
    passed = closest_approach(World(obstacles=[post]), ROBOT.geometry, truth_along(places))
    assert passed is not None
    assert not passed.touched
    assert 0.2 - tip - 5.001e-3 <= passed.clearance_m <= 0.2 - tip + 1e-9  # at the start
    places[3, 0] = 0.0  # across the post, on the way from row 2 to row 3
    hit = closest_approach(World(obstacles=[post]), ROBOT.geometry, truth_along(places))
    assert hit is not None
    assert hit.touched
    assert hit.name == "post"
    assert 2.0 < hit.time_s < 3.0
    assert closest_approach(World(), ROBOT.geometry, truth_along(places)) is None


def test_a_touch_is_told_in_the_metrics(straight: Plan) -> None:
    at_start = {"name": "post", "box": {"x_m": [0.25, 0.27], "y_m": [-0.01, 0.01]}}
    done = simulate(straight.problem, disturbance="none", plan=straight)
    near = closest_approach(World(obstacles=[at_start]), ROBOT.geometry, done.truth)
    metrics = replace(done, approach=near).metrics
    assert done.metrics.reached
    assert not metrics.reached
    assert metrics.touched.startswith("touched post at ")


def test_tasks_that_are_done_are_not_asked_for_again() -> None:
    first, second = Pass(x_m=[0.1, 0.2]), Pass(x_m=[-0.2, -0.1])
    path = np.zeros((5, 5))
    path[:, 0] = [0.0, -0.15, 0.0, 0.15, 0.1]
    assert tasks_left((first, second), path) == (second,)
    assert tasks_left((second, first), path) == ()
    assert tasks_left((first, second), path[:2]) == (first, second)


def test_a_robot_goes_on_where_it_is_surely_clear_and_only_there() -> None:
    """Drawn where it may be: one in a thousand is beyond three deviations of a distance."""
    rng, problem = np.random.default_rng(0), drive(obstacles=[WALL])
    guard, around = Guard(problem, Patience()), Proximity(problem.world, ROBOT.geometry)
    beside, along = np.array([[0.0, 0.02, 0.0, 0.0, 0.0]]), np.array([9e-3, 0.0, 0.0, 0.0, 0.0])
    assert not guard.forbids((1, 0), beside, along)  # nor by doubt along the wall
    went, met = 0, []
    for _ in range(60):
        turned, *bent = rng.uniform(-1.0, 1.0, 3) * [0.3, 20.0, 20.0]
        q = np.array([0.2, rng.uniform(-0.04, 0.02), turned, *bent])
        deviation = rng.uniform(0.0, 1.0, 5) * [2e-3, 2e-3, 0.01, 1.0, 1.0]
        if not guard.forbids((1, 1), q[None], deviation):
            went += 1
            may_be = q + deviation * rng.standard_normal((40, 5))
            met.append(around.distances(may_be)[:, 0] < 0)
    assert 10 < went < 50
    assert np.mean(met) < 2e-3
