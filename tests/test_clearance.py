"""Clearance to obstacles: against dense sampling of another drawing, and every problem in words."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from once import planned

import twosra_mpc.checking.sweep as sweep_module
from twosra_mpc import InputError, Problem, load_problem, load_robot, plan
from twosra_mpc.checking.clearance import Surroundings, _drawn, check_obstacles, touching
from twosra_mpc.checking.surroundings import closest_approach
from twosra_mpc.checking.sweep import Clearance, bending_reach_m2, least, sagitta_m, swept
from twosra_mpc.checking.verification import verify
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.plan import Verification
from twosra_mpc.plans.trajectory import Samples, Trajectory, entered_s
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.problem.tolerances import UNSEEN_M
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array
from twosra_mpc.robot.modes import ModeSequence
from twosra_mpc.space.footprint import footprint

WITHIN_M = 2e-4
ROBOTS = ["2sra-v1", "2sra-v1-paper", "2sr-v2", "3sra"]


def drawn(problem: Problem, q: Array) -> list[Any]:
    """The robot as a polygon with round fibres, drawn with many points, for each configuration."""
    radius = problem.robot.geometry.fibre_radius_m
    bodies = []
    for shape in (robot_shape(problem.robot.geometry, row, 60) for row in q):
        boxes = [shapely.Polygon(corners) for corners in (*shape.units, *shape.wheels)]
        flat = [shapely.LineString(link).buffer(radius, cap_style="flat") for link in shape.links]
        round_ = [shapely.LineString(line).buffer(radius, quad_segs=32) for line in shape.segments]
        bodies.append(shapely.union_all([*boxes, *flat, *round_]))
    return bodies


def sampled_m(trajectory: Trajectory, count: int) -> float:
    """Least distance at many times, each drawn."""
    t = np.linspace(0, trajectory.duration_s, count)
    walls = shapely.union_all([shapely.Polygon(o.corners_m) for o in trajectory.problem.obstacles])
    bodies = drawn(trajectory.problem, trajectory.configuration(t))
    return float(shapely.distance(np.array(bodies), walls).min())


def moved(robot: str, seed: int, sequence: ModeSequence) -> Trajectory:
    """A random motion, a second a phase, some of it with units that turn back on the way."""
    rng = np.random.default_rng(seed)
    made = load_robot(robot)
    n, intervals = made.coordinates.segments, 5
    start = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(-3, 3), *rng.uniform(-12, 12, n)])
    names = {"x_m": start[0], "y_m": start[1], "phi_rad": start[2]}
    end = {**names, "kappa_per_m": start[POSE:].tolist()}
    problem = Problem(robot=made, start=end, goal=end)
    inputs = rng.uniform(-1, 1, (len(sequence), intervals, INPUTS))
    inputs *= np.array([4e-3, 4e-3, 0.03, 0.03, 0.3])
    for i, mode in enumerate(sequence):
        inputs[i][:, slice(0, 2) if not any(mode) else slice(2, 5)] = 0.0
    motion = roll_out(made, start, sequence, inputs)
    rows = len(sequence) * intervals + 1
    q = np.vstack([motion.states[:, :-1].reshape(-1, len(start)), motion.states[-1, -1:]])
    v = np.vstack([inputs.reshape(-1, INPUTS) * intervals, np.zeros((1, INPUTS))])
    modes = np.vstack([np.repeat(sequence, intervals, axis=0), [sequence[-1]]])
    none = np.zeros((rows, n))
    samples = Samples(
        t_s=np.arange(rows) / intervals,
        q=q,
        v=v,
        a=np.zeros_like(v),
        mode=modes,
        wheel_rad_s=np.zeros((rows, 4)),
        temperature_C=none,
        melt_fraction=none,
        heater_setpoint_C=none,
        heater_current_A=none,
    )
    return Trajectory(problem, samples, (), ())


def among(trajectory: Trajectory, *obstacles: Obstacle, **world: Any) -> Trajectory:
    """The same motion with obstacles in its way."""
    problem = trajectory.problem.with_values(obstacles=obstacles, **world)
    return replace(trajectory, problem=problem)


def scattered(seed: int, count: int = 8) -> list[Obstacle]:
    """Boxes, discs and triangles around the origin, none in the middle."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(count):
        angle, far = rng.uniform(0, math.tau), rng.uniform(0.3, 0.45)
        x, y = far * math.cos(angle), far * math.sin(angle)
        if k % 3 == 0:
            made.append(Obstacle(disc={"x_m": x, "y_m": y, "radius_m": 0.04}))
        elif k % 3 == 1:
            made.append(Obstacle(box={"x_m": (x - 0.05, x + 0.02), "y_m": (y, y + 0.03)}))
        else:
            corners = np.array([x, y]) + rng.uniform(-0.06, 0.06, (3, 2))
            made.append(Obstacle(polygon_m=corners.tolist()))
    return made


def sequence_of(robot: str) -> ModeSequence:
    return ((0, 0, 0), (1, 0, 1), (1, 1, 1)) if robot == "3sra" else ((1, 0), (0, 0), (1, 1))


@pytest.mark.parametrize(("seed", "robot"), list(enumerate(ROBOTS)))
def test_least_clearance_is_that_of_dense_sampling(robot: str, seed: int) -> None:
    trajectory = among(moved(robot, seed, sequence_of(robot)), *scattered(seed))
    found = closest_approach(trajectory)
    assert found is not None
    dense = sampled_m(trajectory, 601)
    assert found.proved_m <= dense + 1e-6
    assert found.least_m - WITHIN_M <= found.proved_m
    assert found.least_m == pytest.approx(max(dense, 0.0), abs=WITHIN_M) or found.least_m < 0
    assert (found.least_m <= 0) == (dense == 0)
    gap = float(np.linalg.norm(np.diff(found.points_m, axis=0)))
    assert gap == pytest.approx(max(found.least_m, 0.0), abs=WITHIN_M)
    assert found.configuration == pytest.approx(trajectory.configuration(found.at_s)[0], abs=1e-6)


@pytest.mark.parametrize("robot", ROBOTS)
def test_no_point_travels_more_than_the_bound(robot: str) -> None:
    trajectory = moved(robot, 7, sequence_of(robot))
    sweep = swept(trajectory.problem, trajectory.samples)
    assert sweep is not None
    shape = robot_shape(trajectory.problem.robot.geometry, sweep.q)
    parts = (shape.units, shape.wheels, shape.segments, shape.links)
    points = np.concatenate([part.reshape(len(sweep.q), -1, 2) for part in parts], axis=1)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    bound = np.diff(sweep.travelled_m)
    assert (steps <= bound + 1e-12).all()
    assert steps.sum() > 0.1 * bound.sum()  # and it is no idle one


@pytest.mark.parametrize("robot", ROBOTS)
def test_bending_moves_no_point_farther_than_the_reach(robot: str) -> None:
    geometry, rng = load_robot(robot).geometry, np.random.default_rng(0)
    n, step = geometry.segments, 1e-5
    q = np.zeros((300, POSE + n))
    q[:, POSE:] = rng.uniform(-1, 1, (300, n)) * load_robot(robot).limits.curvature_per_m

    def points(q: Array) -> Array:
        shape = robot_shape(geometry, q)
        parts = (shape.units, shape.wheels, shape.segments)
        return np.concatenate([part.reshape(len(q), -1, 2) for part in parts], axis=1)

    for j, reach in enumerate(bending_reach_m2(geometry)):
        there = q + step * np.eye(POSE + n)[POSE + j]
        apart = np.linalg.norm(points(there) - points(q), axis=2).max() / step
        assert 0.5 * reach < apart <= reach * (1 + 1e-6)


def test_the_search_finds_the_least_of_any_lipschitz_function() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        travel = np.append(0.0, np.cumsum(rng.uniform(0, 2e-4, 4000)))
        slopes = np.repeat(rng.uniform(-1, 1, 40), 100)
        d = 0.2 + np.append(0.0, np.cumsum(slopes * np.diff(travel)))
        asked: list[int] = []

        def distances(at: Array, d: Array = d, asked: list[int] = asked) -> Array:
            asked.extend(at.tolist())
            return d[at]

        found = least(distances, travel, 0, 4000)
        assert d.min() <= found.distance_m <= d.min() + WITHIN_M
        assert found.distance_m - WITHIN_M <= found.proved_m <= d.min()
        assert len(asked) < 2000


def found_in(trajectory: Trajectory) -> tuple[Verification, Clearance]:
    nearest = closest_approach(trajectory)
    assert nearest is not None
    return verify(trajectory), nearest


@cache
def lowest_m() -> float:
    """Least y of the planned motion's sweep."""
    made = planned("move-and-shape")
    t = np.concatenate([np.linspace(phase.start_s, phase.end_s, 300) for phase in made.phases])
    return min(body.bounds[1] for body in drawn(made.problem, made.trajectory.configuration(t)))


def beside(gap_m: float, **world: Any) -> Trajectory:
    """A planned motion with a wall that its sweep comes within ``gap_m`` of, or runs into."""
    made, low = planned("move-and-shape"), lowest_m()
    box = {"x_m": (-2.0, 2.0), "y_m": (low - gap_m - 0.5, low - gap_m)}
    return among(made.trajectory, Obstacle(name="wall", box=box), **world)


def test_a_plan_far_from_obstacles_holds() -> None:
    verified, nearest = found_in(beside(0.02, clearance_m=0.01))
    assert verified.ok
    assert verified.limits["clearance_m"] == pytest.approx(0.01, abs=WITHIN_M)
    assert nearest.least_m == pytest.approx(0.02, abs=WITHIN_M)
    assert (nearest.name, nearest.obstacle) == ("wall", 0)
    left = verified.limits["soft_travel_m"]
    assert 0 < left < planned("move-and-shape").robot.limits.soft_travel_m


def test_coming_too_near_is_told() -> None:
    verified, nearest = found_in(beside(0.0012, clearance_m=0.002))
    assert not verified.ok
    (told,) = verified.problems
    when = f"{1e3 * nearest.least_m:.3g} mm of wall at {nearest.at_s:.1f} s"
    assert told == f"comes within {when} (clearance_m = 2 mm)"
    assert verified.limits["clearance_m"] == pytest.approx(-0.0008, abs=WITHIN_M)


def test_running_into_something_is_told() -> None:
    verified, nearest = found_in(beside(-0.012))
    (told,) = verified.problems
    assert told.startswith(f"runs into wall by {-1e3 * nearest.least_m:.3g} mm at ")
    assert nearest.least_m == pytest.approx(-0.012, abs=1e-3)
    assert nearest.proved_m == 0.0
    assert verified.limits["clearance_m"] == pytest.approx(nearest.least_m - 0.002)


def test_a_touched_clearance_is_kept_within_rounding() -> None:
    nearest = closest_approach(beside(0.01))
    assert nearest is not None
    assert verify(beside(0.01, clearance_m=nearest.least_m)).ok
    assert not verify(beside(0.01, clearance_m=nearest.least_m + 1e-5)).ok


def test_uncertain_curvatures_need_more_room() -> None:
    reach = bending_reach_m2(planned("move-and-shape").robot.geometry)
    assert reach.max() == pytest.approx(
        0.04 * (0.02 + np.hypot(0.09, 0.01))
    )  # the side wheel is farthest
    needed = 0.002 + 1.5 * float(reach.max())
    world = {"clearance_m": 0.002, "curvature_uncertainty_per_m": 1.5}
    assert verify(beside(needed + 3e-4, **world)).ok
    (told,) = verify(beside(needed - 3e-4, **world)).problems
    assert "mm for curvature_uncertainty_per_m)" in told


def test_a_start_nearer_than_the_clearance_keeps_its_own() -> None:
    made = planned("move-and-shape")
    start = drawn(made.problem, made.samples.q[:1])[0]
    _, low, right, high = start.bounds
    leaves = made.phases[0].end_s
    ahead = drawn(made.problem, made.trajectory.configuration(np.linspace(0, leaves, 100)))
    sides = {  # a wall left, right, below or above of the start, 1 mm from it
        "x_m": [(start.bounds[0] - 0.5, start.bounds[0] - 1e-3), (right + 1e-3, right + 0.5)],
        "y_m": [(low - 0.5, low - 1e-3), (high + 1e-3, high + 0.5)],
    }
    outcomes = []
    for axis, pairs in sides.items():
        for pair in pairs:
            box = {"x_m": (-2.0, 2.0), "y_m": (-2.0, 2.0), axis: pair}
            trajectory = among(made.trajectory, Obstacle(name="wall", box=box), clearance_m=0.004)
            wall = shapely.box(box["x_m"][0], box["y_m"][0], box["x_m"][1], box["y_m"][1])
            gaps = shapely.distance(np.array(ahead), wall)
            verified = verify(trajectory)
            first_away = int((gaps >= 0.004).argmax()) or len(gaps)
            leaves_well = gaps[:first_away].min() >= gaps[0] - 1e-6
            stays_away = sampled_m(trajectory, 200) > 0 and gaps[-1] >= 0.004
            outcomes.append(leaves_well and stays_away)
            assert verified.ok == (leaves_well and stays_away), verified.problems
            if not leaves_well and gaps.min() > 0:
                assert "nearer than at its start (1 mm)" in verified.problems[0]
    assert set(outcomes) == {True, False}


def test_soft_travel_is_limited_where_there_are_obstacles() -> None:
    far = beside(0.02)
    left = verify(far).limits["soft_travel_m"]
    robot = far.problem.robot
    most = robot.limits.soft_travel_m - left  # what it travels

    def told(limit: float) -> tuple[str, ...]:
        limits = robot.limits.with_values(soft_travel_m=limit)
        problem = far.problem.with_values(robot=robot.with_values(limits=limits))
        return verify(replace(far, problem=problem)).problems

    assert told(most) == ()
    (problem,) = told(0.9 * most)
    assert problem.startswith(f"soft, the middle link moves {most:.3g} m from ")
    without = far.problem.with_values(obstacles=())
    assert "soft_travel_m" not in verify(replace(far, problem=without)).limits


def test_boxes_are_entered_in_order() -> None:
    made = planned("move-and-shape")
    q = made.trajectory.configuration(np.array([0.0, made.phases[0].end_s, made.duration_s]))
    here = [
        Pass(name=name, x_m=(x - 1e-3, x + 1e-3), y_m=(y - 1e-3, y + 1e-3))
        for name, (x, y) in zip(("start", "door", "end"), q[:, :2], strict=True)
    ]

    def told(*tasks: Pass) -> tuple[str, ...]:
        problem, done_s = made.problem.with_values(tasks=tasks), [0.0] * len(tasks)
        trajectory = replace(made.trajectory, problem=problem, done_s=tuple(done_s))
        for i, task in enumerate(tasks):
            done_s[i] = entered_s(trajectory, task, done_s[max(i - 1, 0)])
        return verify(replace(trajectory, done_s=tuple(done_s))).problems

    assert told(*here) == ()
    assert told(*here[::2]) == ()
    (late,) = told(here[1], here[0])
    assert late.startswith("task 2 (pass start) at ")
    assert late.endswith("s: is not done: its box is not entered")
    aside = Pass(y_m=(float(q[:, 1].max()) + 1.0, 9.0))
    (never,) = told(here[0], aside, here[2])
    assert never.startswith("task 2 (pass) at 0.0 s: is not done")
    edge = Pass(x_m=(-9.0, float(q[0, 0]) - 5e-10), y_m=here[0].y_m)
    assert told(edge) == ()  # missed by rounding alone


def test_ends_that_overlap_are_named() -> None:
    problem = planned("move-and-shape").problem
    (x, y), (u, v) = problem.start.configuration[:2], problem.goal.configuration[:2]
    at_start = Obstacle(name="post", disc={"x_m": x, "y_m": y, "radius_m": 0.01})
    at_goal = Obstacle(box={"x_m": (u - 0.01, u + 0.01), "y_m": (v - 0.01, v + 0.01)})
    far = Obstacle(disc={"x_m": 5.0, "y_m": 5.0, "radius_m": 0.1})
    check_obstacles(problem.with_values(obstacles=[far]))
    check_obstacles(problem)
    with pytest.raises(InputError, match=r"start = .*overlaps post by \d+\.\d mm") as caught:
        check_obstacles(problem.with_values(obstacles=[far, at_start, at_goal]))
    assert "goal" in str(caught.value)
    assert "obstacle 3 by" in str(caught.value)
    with pytest.raises(InputError, match=r"^goal = "):
        check_obstacles(problem.with_values(obstacles=[at_goal]))


@pytest.mark.parametrize(("deep_m", "refused"), [(-1e-4, False), (4e-4, False), (2e-3, True)])
def test_a_start_may_overlap_what_its_task_takes_as_much_as_a_plan_may(
    deep_m: float, refused: bool
) -> None:
    """Along a cylinder that is drawn as finely as verification does, not as obstacles are."""
    made = planned("conform-cylinder")
    rest = made.rest_at(0.95 * made.duration_s)
    q, (cylinder,) = rest.start.configuration, rest.objects
    middle = cylinder.pose.pose[:2]
    _, _, (met, _) = touching(rest, cylinder.at(cylinder.pose.pose)).nearest(q)
    x_m, y_m = middle + deep_m * (met - middle) / np.linalg.norm(met - middle)
    moved = cylinder.with_values(pose={"x_m": x_m, "y_m": y_m})
    with pytest.raises(InputError, match="overlaps cylinder") if refused else nullcontext():
        check_obstacles(rest.with_values(objects=[moved]))


def test_how_deep_is_the_deepest_point() -> None:
    problem = load_problem("rigid-move")
    end = problem.start.configuration
    right = drawn(problem, end[None])[0].bounds[2]
    for deep in (0.5e-3, 3e-3):
        box = {"x_m": (right - deep, right + 1.0), "y_m": (-3.0, 3.0)}
        with pytest.raises(InputError, match=rf"overlaps obstacle 1 by {1e3 * deep:.1f} mm"):
            check_obstacles(problem.with_values(obstacles=[Obstacle(box=box)]))


def test_no_obstacle_is_lost_among_others_that_nearly_line_up() -> None:
    """Unions in floating point lose a unit of these pieces of a nearly straight robot."""
    robot = load_robot("2sr-v2")
    pieces = footprint(robot.geometry, (0.6266225773907194, -0.9738745176843646)).outer
    obstacles = tuple(Obstacle(polygon_m=piece.tolist()) for piece in pieces)
    around = Surroundings(World(obstacles=obstacles), robot.geometry)
    q = np.zeros((60, 5))
    q[:, :2] = 0.35 * np.column_stack([np.cos(angle := np.arange(60) / 9), np.sin(angle)])
    each = [Surroundings(World(obstacles=(one,)), robot.geometry) for one in obstacles]
    expected = np.min([one.distances_m(q) for one in each], axis=0)
    assert around.distances_m(q) == pytest.approx(expected, abs=1e-8)
    assert expected.min() < 0.05


@pytest.mark.parametrize("robot", ["2sra-v1", "2sr-v2", "3sra"])
def test_what_the_planner_takes_for_the_robot_holds_what_is_checked(robot: str) -> None:
    """So plans that keep clear by the planner's pieces do by the check's drawing, too."""
    made, rng = load_robot(robot), np.random.default_rng(2)
    n = made.geometry.segments
    for _ in range(20):
        kappa = rng.uniform(-1, 1, n) * made.limits.curvature_per_m
        pieces = [shapely.Polygon(piece) for piece in footprint(made.geometry, kappa).outer]
        held = shapely.union_all(pieces, grid_size=1e-9).buffer(1e-8)
        q = np.concatenate([np.zeros(POSE), kappa])
        solid, fibre = _drawn(made.geometry, q[None])
        thick = shapely.buffer(fibre[0], made.geometry.fibre_radius_m, quad_segs=32)
        assert held.covers(thick)
        assert shapely.covers(held, shapely.get_parts(solid)).all()


def test_a_first_leg_that_starts_a_hair_away_may_not_touch() -> None:
    """The start's own distance, less what the sweep is accurate to, is never less than nothing."""
    free = load_problem("rigid-move", motion="fastest")
    made = plan(free).require().trajectory
    outline = robot_shape(free.robot.geometry, made.samples.q, 2)
    points = np.concatenate(
        [
            outline.units.reshape(len(made.samples), -1, 2),
            outline.wheels.reshape(len(made.samples), -1, 2),
        ],
        axis=1,
    )
    top = points[0, :, 1].max()
    assert points[..., 1].max() > top + 1e-3  # it goes up
    wall = {"box": {"x_m": [-9.0, 9.0], "y_m": [float(top + 1e-4), 9.0]}}
    found = verify(replace(made, problem=free.with_values(obstacles=[wall])))
    assert any("runs into" in words for words in found.problems)


def test_proofs_allow_for_what_the_check_may_not_see() -> None:
    """Distances are proved to _ACCURACY_M of a drawing whose chords stray from its arcs."""
    for name in ("2sra-v1", "2sr-v2", "3sra"):
        robot = load_robot(name)
        limit = robot.limits.curvature_per_m
        most = np.array([[0.0] * POSE + [limit] * robot.coordinates.segments])
        assert sweep_module._ACCURACY_M + sagitta_m(robot.geometry, most) <= UNSEEN_M
