"""Missions are verified: for every rule a plan that keeps it, and a forged one that is refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from grasps import drawn
from jsonschema import Draft7Validator
from missions import RADIUS_M, made, pick_and_place, picked, repeated, times

from twosra_mpc import InputError, Problem, Result, Status, load_plan, load_problem, load_robot
from twosra_mpc.checking.clearance import Carrying, robot_distances_m
from twosra_mpc.checking.holds import cage_proved, pushes
from twosra_mpc.checking.plan_file import check_plan
from twosra_mpc.checking.surroundings import closest_approach
from twosra_mpc.checking.sweep import swept, touched_in, uncertain_m
from twosra_mpc.checking.verification import verify
from twosra_mpc.lab.schema import json_schema
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import carried
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Stats
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array

GEOMETRY = load_robot("2sra-v1").geometry


def told(trajectory: Trajectory) -> tuple[str, ...]:
    return verify(trajectory).problems


def with_task(trajectory: Trajectory, number: int, **changes: Any) -> Trajectory:
    """The same motion with one task changed."""
    tasks = list(trajectory.problem.tasks)
    tasks[number] = tasks[number].with_values(**changes)
    return replace(trajectory, problem=trajectory.problem.with_values(tasks=tasks))


def with_cup(trajectory: Trajectory, **pose: float) -> Trajectory:
    """The same motion with the cup elsewhere."""
    cup = trajectory.problem.objects[0].with_values(pose={"x_m": 0.0, "y_m": 0.0, **pose})
    return replace(trajectory, problem=trajectory.problem.with_values(objects=[cup]))


def done_at(trajectory: Trajectory, number: int, at_s: float) -> Trajectory:
    done_s = list(trajectory.done_s)
    done_s[number] = at_s
    return replace(trajectory, done_s=tuple(done_s))


def test_a_mission_that_keeps_every_rule_holds() -> None:
    found = verify(pick_and_place())
    assert found.ok
    assert found.limits["contact_m"] == pytest.approx(5e-4)
    assert found.goal_error == (0.0,) * 5


# --- tasks ---------------------------------------------------------------------------------------


def test_tasks_are_done_in_order_and_in_time() -> None:
    made = pick_and_place()
    assert told(done_at(made, 0, 400.0)) == ("task 2 is done too early",)
    assert told(done_at(made, 2, made.duration_s + 1)) == ("task 3 is done after the end",)
    assert told(done_at(made, 0, -1.0)) == ("task 1 is done too early",)
    assert told(done_at(made, 0, np.nan)) == ("done_s has a time that is not finite",)


def test_the_robot_rests_when_a_task_is_done() -> None:
    trajectory = pick_and_place()
    middle = (trajectory.phases[1].start_s + trajectory.phases[1].end_s) / 2
    problems = told(done_at(trajectory, 1, middle))
    assert f"task 2 (carry) at {middle:.1f} s: the robot moves" in problems


def test_the_robot_is_rigid_when_it_has_grasped() -> None:
    trajectory = pick_and_place()
    early = trajectory.phases[0].end_s
    problems = told(done_at(trajectory, 0, early))
    assert f"task 1 (grasp) at {early:.1f} s: the segments are not [0,0]" in problems
    assert any(f"is not rigid at {early:.1f} s, while cup is held" in text for text in problems)


def test_the_robot_stays_rigid_while_it_holds_something() -> None:
    trajectory = pick_and_place()
    late = (trajectory.phases[1].end_s + trajectory.phases[2].start_s) / 2
    onset = min(item.onset_s for item in trajectory.transitions if item.onset_s > late - 100)
    assert not told(done_at(trajectory, 1, onset))
    problems = told(done_at(trajectory, 1, trajectory.phases[2].end_s))
    assert any("is not rigid at" in text and "while cup is held" in text for text in problems)


def test_a_grasp_heads_where_it_may_modulo_turns() -> None:
    for pair in ((-0.1, 0.1), (6.2, 6.4)):
        assert not told(with_task(pick_and_place(), 0, directions_rad=pair))
    (problem,) = told(with_task(pick_and_place(), 0, directions_rad=(0.1, 3.0)))
    assert problem.endswith("b0 heads to 0 rad, not within 0.1 to 3 rad")


def test_what_is_grasped_is_touched() -> None:
    trajectory = pick_and_place()
    body = drawn(GEOMETRY, trajectory.configuration(np.array(trajectory.done_s[:1]))[0])
    away_mm = 1e3 * (body.distance(shapely.Point(0.0, 3e-3)) - RADIUS_M)
    problems = told(with_cup(trajectory, y_m=3e-3))
    words = f"the robot is {away_mm:.3g} mm away from cup, it does not touch it"
    assert away_mm > 1.0
    assert any(words in p for p in problems)
    problems = told(with_cup(pick_and_place(), y_m=-2e-3))
    assert any("mm within cup, it does not touch it" in p for p in problems)
    assert any(p.startswith("overlaps cup by ") for p in problems)


def test_a_cage_must_be_proved() -> None:
    problems = told(pick_and_place(closed_per_m=24.0))
    assert len(problems) == 1
    assert problems[0].endswith("it is not proved that cup cannot leave")
    assert not told(pick_and_place((0.0, 0.2, 0.0), "pushed", closed_per_m=24.0))


def test_pushing_keeps_within_the_friction_cone() -> None:
    assert not told(pick_and_place((0.0, 0.2, 0.0), "pushed"))
    (problem,) = told(pick_and_place((0.0, -0.2, 0.0), "pushed"))
    assert "cup is pushed where friction does not hold it at " in problem


def test_an_object_is_carried_to_its_pose() -> None:
    trajectory = pick_and_place()
    task: Any = trajectory.problem.tasks[1]
    aside = {"x_m": task.x_m + 3e-3}
    (problem,) = told(with_task(trajectory, 1, **aside))
    assert problem.endswith("cup is 3 mm from where it should be")
    assert not told(with_task(trajectory, 1, **aside, position_tolerance_m=3.1e-3))
    (problem,) = told(with_task(trajectory, 1, phi_rad=task.phi_rad - 0.1))
    assert problem.endswith("cup is turned by 0.1 rad from where it should be")
    assert not told(with_task(trajectory, 1, phi_rad=task.phi_rad - 0.1, heading_tolerance_rad=0.2))
    assert not told(with_task(trajectory, 1, phi_rad=None))
    assert not told(with_task(trajectory, 1, phi_rad=task.phi_rad + 2 * np.pi))


def test_a_release_restores_the_clearance() -> None:
    trajectory = pick_and_place()
    opened = trajectory.phases[2].end_s
    left = told(pick_and_place(clearance_m=0.0))
    assert not left
    wide = trajectory.problem.with_values(clearance_m=0.2)
    problems = told(replace(trajectory, problem=wide))
    assert any(
        "task 3 (release)" in p and "mm from cup (clearance_m = 200 mm)" in p for p in problems
    )
    assert told(done_at(trajectory, 2, opened)) == ()  # opening alone gives 20 mm
    at_least = with_task(replace(trajectory, problem=wide), 2, clearance_m=0.015)
    assert not any("task 3" in p for p in told(at_least))
    (problem,) = told(with_task(trajectory, 2, clearance_m=0.2))
    assert "task 3 (release)" in problem
    assert problem.endswith("mm from cup (clearance_m = 200 mm)")


def test_a_robot_that_cannot_leave_has_not_released() -> None:
    trajectory = pick_and_place(clearance_m=3e-4)
    forged = done_at(trajectory, 2, trajectory.done_s[1])
    problems = told(forged)
    assert any("the robot cannot leave: cup is within it" in text for text in problems)
    assert any("nothing was soft since it caged" in text for text in problems)


def two_legs(**changes: Any) -> Trajectory:
    """A drive, a rest and a drive; the first end is a goal on the way."""
    plan = drives()
    middle = plan.trajectory.configuration([plan.phases[0].end_s])[0]
    names = dict(zip(("x_m", "y_m", "phi_rad"), middle.tolist(), strict=False))
    task = {"do": "reach", **names, "kappa_per_m": middle[3:].tolist(), **changes}
    problem = plan.problem.with_values(tasks=[task])
    return replace(plan.trajectory, problem=problem, done_s=(plan.phases[0].end_s,))


@cache
def drives() -> Plan:
    start, still = np.array([0.0, 0, 0, 5.0, -5.0]), repeated((0, 0, 0.1, 0.05, 0.3))
    bend = repeated((0.01, 0, 0, 0, 0))
    return made(start, ((0, 0), (1, 0), (0, 0)), np.array([still, bend, 2 * still]))


def test_goals_on_the_way_are_reached() -> None:
    assert not told(two_legs())
    (problem,) = told(two_legs(x_m=0.5, tolerance="exact"))
    assert "its goal's x_m is missed by " in problem
    (problem,) = told(two_legs(mode=[1, 0]))
    assert problem.endswith("the segments are not [1,0]")
    assert not told(two_legs(mode="any"))


def test_boxes_of_missions_are_entered_in_their_stage() -> None:
    plan = drives()
    q = plan.trajectory.configuration([plan.phases[0].end_s, plan.duration_s])
    near = [
        {"do": "pass", "x_m": (x - 1e-3, x + 1e-3), "y_m": (y - 1e-3, y + 1e-3)}
        for x, y in q[:, :2].tolist()
    ]
    reach = {"do": "reach", "kappa_per_m": ["free", -5.0], "mode": "any"}
    done = (plan.phases[0].end_s, plan.phases[1].end_s, plan.duration_s)

    def ordered(*tasks: dict[str, Any]) -> tuple[str, ...]:
        problem = plan.problem.with_values(tasks=tasks)
        return told(replace(plan.trajectory, problem=problem, done_s=done))

    assert not ordered(near[0], reach, near[1])
    problems = ordered(near[1], reach, near[0])
    assert problems[0].startswith("task 1 (pass) at ")
    assert problems[0].endswith("is not done: its box is not entered")


@cache
def wrapped() -> tuple[Plan, Array]:
    """Segment 1 laid along a disc, whose centre is the second value."""
    kappa = 1 / (RADIUS_M + GEOMETRY.fibre_radius_m)
    closed = np.array([0.0, 0.0, 0.0, kappa, 0.0])
    opening = repeated((-0.05, 0, 0, 0, 0))
    begin = roll_out(load_robot("2sra-v1"), closed, ((1, 0),), opening[None]).states[-1, -1]
    plan = made(begin, ((1, 0),), -opening[None])
    a, b, c = robot_shape(GEOMETRY, plan.samples.q[-1], 3).segments[0]
    normals = np.array([b - a, c - b])
    squares = np.array([b @ b - a @ a, c @ c - b @ b]) / 2
    return plan, np.linalg.solve(normals, squares)


@pytest.mark.parametrize("kind", ["objects", "obstacles"])
def test_segments_lie_along_what_they_conform_to(kind: str) -> None:
    plan, centre = wrapped()

    def conforms(aside_m: float = 0.0, **task: Any) -> tuple[str, ...]:
        x, y = (centre + np.array([0.0, aside_m])).tolist()
        thing = {"name": "post", "disc": {"radius_m": RADIUS_M - 1e-4}}
        if kind == "objects":
            thing |= {"pose": {"x_m": x, "y_m": y}}
        else:
            thing |= {"disc": {"x_m": x, "y_m": y, "radius_m": RADIUS_M - 1e-4}}
        tasks = [{"do": "conform", "object": "post", **task}]
        values = {**dict(plan.problem), "tasks": tasks, "goal": None, kind: [thing]}
        done_s = (plan.duration_s,)
        return told(replace(plan.trajectory, problem=Problem(**values), done_s=done_s))

    assert not conforms()
    (problem,) = conforms(gap_m=5e-5)
    assert "segment 1 is up to 0.1 mm away from post, more than gap_m = 0.05 mm" in problem
    assert any("segment 2 is up to" in text for text in conforms(segments=(1, 2)))
    assert any("segment 1 overlaps post by" in text for text in conforms(-2e-3))
    assert any("b0 heads to" in text for text in conforms(directions_rad=(1.0, 2.0)))


# --- surroundings --------------------------------------------------------------------------------


def wall(x: float, y: float) -> dict[str, Any]:
    return {"name": "wall", "box": {"x_m": (x, x + 0.2), "y_m": (y, y + 0.2)}}


def pushing(**world: Any) -> Trajectory:
    """The cup pushed ahead of a nearly straight robot: it comes first."""
    return pick_and_place((0.0, 0.2, 0.0), "pushed", closed_per_m=6.0, **world)


def test_what_is_carried_keeps_clear() -> None:
    (held,) = carried(pushing())
    assert held.to_s == pushing().done_s[1]
    top = 0.2 + RADIUS_M  # of the cup where it is put
    for gap, ok in ((4e-3, True), (1e-3, False), (-1e-3, False)):
        around = {"obstacles": [wall(-0.1, top + gap)], "clearance_m": 0.002}
        found = pushing(**around)
        problems = told(found)
        assert (not problems) == ok, problems
        if ok:
            near = closest_approach(found)
            assert near is not None
            assert (near.of, near.name) == ("cup", "wall")
            assert near.least_m == pytest.approx(gap, abs=2e-4)
            assert near.proved_m <= gap
        else:
            verb = "comes within 0.998 mm of" if gap > 0 else "runs into"
            assert problems[0].startswith(f"the cup {verb} wall")


def test_what_is_carried_keeps_clear_of_other_objects() -> None:
    other = {"name": "can", "disc": {"radius_m": 0.02}, "pose": {"x_m": 0.0, "y_m": 0.2 + 0.051}}
    trajectory = pushing()
    objects = [*trajectory.problem.objects, other]
    problems = told(replace(trajectory, problem=trajectory.problem.with_values(objects=objects)))
    assert problems[0].startswith("the cup comes within 0.998 mm of can at ")


def test_what_is_carried_stays_within_the_workspace() -> None:
    top = 0.2 + RADIUS_M
    found = verify(pushing(workspace={"y_m": (-1.0, top + 1e-3)}))
    assert found.ok
    assert found.limits["workspace_m"] == pytest.approx(1e-3, abs=2e-4)
    (problem,) = told(pushing(workspace={"y_m": (-1.0, top - 1e-3)}))
    assert problem.startswith("the cup leaves the workspace by 1 mm at ")


def test_what_was_lain_along_may_be_touched_until_the_next_task_is_done() -> None:
    problem = load_problem("conform-cylinder")
    tasks = [*problem.tasks, *({"do": "reach", "x_m": x_m} for x_m in (0.1, 0.2))]
    touched = [touched_in(problem.with_values(tasks=tasks), stage) for stage in range(3)]
    assert touched == [{"cylinder"}, {"cylinder"}, set()]


def test_only_what_is_grasped_may_be_touched() -> None:
    trajectory = pick_and_place()
    tasks = trajectory.problem.tasks[1:]
    standing = trajectory.problem.with_values(tasks=(), goal=drives().problem.goal)
    problems = told(replace(trajectory, problem=standing, done_s=()))
    assert any("of cup at " in text or "runs into cup" in text for text in problems)
    assert len(tasks) == 2


def test_an_object_held_at_the_start_is_carried_from_there() -> None:
    closed = np.array([0.0, -0.0345, 0.0, 36.0, 36.0])
    away, back = repeated((-0.15, -0.15, 0, 0, 0)), repeated((0, 0, 0, -0.03, 0))
    plan = made(
        closed, ((0, 0), (1, 1), (0, 0)), np.array([repeated((0, 0, 0.1, 0, 0)), away, back])
    )
    cup = {"name": "cup", "disc": {"radius_m": RADIUS_M}, "pose": {"x_m": 0.0, "y_m": 0.0}}
    tasks = [{"do": "carry", "object": "cup", "x_m": 0.1, "y_m": 0.0}]
    tasks.append({"do": "release", "object": "cup"})
    start = plan.problem.start.with_values(holding="cup")
    values = {"start": start, "objects": [cup], "tasks": tasks, "goal": None}
    problem = Problem(**{**dict(plan.problem), **values})
    done_s = (plan.phases[0].end_s, plan.duration_s)
    assert not told(replace(plan.trajectory, problem=problem, done_s=done_s))
    for friction, y_m, wrong in (
        (None, 0.05, "mm within|overlaps it by"),
        (0.3, -0.2, "131 mm from touching, and no cage is proved"),
        (None, -0.0687, "no cage is proved, and it has no friction"),
        (0.3, -0.0687, "pushed where friction does not hold it"),
    ):
        moved = {"pose": {"x_m": 0.0, "y_m": y_m}, "friction": friction}
        apart = problem.with_values(objects=[{**cup, **moved}])
        found = told(replace(plan.trajectory, problem=apart, done_s=done_s))
        assert any(re.search(wrong, text) for text in found), found
    let_go = {"objects": [{**cup, "pose": {"x_m": 0.0, "y_m": -0.2}}], "tasks": tasks[1:]}
    freed = replace(plan.trajectory, problem=problem.with_values(**let_go), done_s=done_s[1:])
    assert not any("start.holding" in text for text in told(freed))


def test_tasks_may_be_done_at_the_same_time() -> None:
    trajectory = pick_and_place()
    grasp, *rest = trajectory.problem.tasks
    here = {"do": "carry", "object": "cup", "x_m": 0.0, "y_m": 0.0}
    problem = trajectory.problem.with_values(tasks=[grasp, here, *rest])
    done_s = (trajectory.done_s[0], *trajectory.done_s)
    assert not told(replace(trajectory, problem=problem, done_s=done_s))


def test_no_point_of_what_is_carried_travels_more_than_the_bound() -> None:
    trajectory = pick_and_place()
    sweep = swept(trajectory.problem, trajectory.samples)
    assert sweep is not None
    held = Carrying(trajectory.problem.objects[0], carried(trajectory)[0].pose_in_b0)
    assert held.radius_m == pytest.approx(0.0345 + RADIUS_M, rel=1e-3)
    first, last = sweep.over(*trajectory.done_s[:2])
    steps = np.diff(held.corners_m(sweep.q[first : last + 1]), axis=0)
    travelled = np.linalg.norm(steps, axis=2).max(axis=1)
    bound = np.diff(sweep.carried_m(held.radius_m)[first : last + 1])
    assert (travelled <= bound + 1e-12).all()
    assert travelled.sum() > 0.5 * bound.sum() > 0


# --- what holds ----------------------------------------------------------------------------------


def in_a_hole(q: Array, centre: Array, radius: float) -> bool:
    """Whether a disc's centre is within a ring of what it cannot overlap; an exact drawing."""
    shape = robot_shape(GEOMETRY, q, 200)
    boxes = [shapely.Polygon(corners) for corners in (*shape.units, *shape.wheels)]
    lines = [*map(shapely.LineString, shape.segments), *map(shapely.LineString, shape.links)]
    fibre = [line.buffer(GEOMETRY.fibre_radius_m, quad_segs=64) for line in lines]
    around = shapely.union_all([*boxes, *fibre]).buffer(radius, quad_segs=128)
    parts = [around] if around.geom_type == "Polygon" else list(around.geoms)
    rings = [shapely.Polygon(ring) for part in parts for ring in part.interiors]
    return any(ring.contains(shapely.Point(centre)) for ring in rings)


def test_cages_of_discs_are_those_of_an_exact_drawing() -> None:
    outcomes = []
    for radius in (0.025, 0.035, 0.045):
        thing = Object(name="disc", disc={"radius_m": radius}, pose={"x_m": 0, "y_m": 0})
        for kappa in np.arange(20.0, 44.0, 4.0):
            q = np.array([0.1, 0.0, 1.0, kappa, kappa])
            up = np.array([-np.sin(1.0), np.cos(1.0)])
            pose = np.array([*(q[:2] + (radius + 0.0045) * up), 0.0])
            if robot_distances_m(GEOMETRY, q, pose[:2]) < radius:
                continue
            outcome = cage_proved(GEOMETRY, thing, pose, q, 0.0, finest_m=2e-3)
            outcomes.append(outcome)
            if outcome:
                assert in_a_hole(q, pose[:2], radius)
            else:
                assert not in_a_hole(q, pose[:2], radius - 2e-3)
    assert set(outcomes) == {True, False}


@pytest.mark.parametrize(("kappa", "caged"), [(29.0, False), (42.0, True)])
@pytest.mark.parametrize("turned", [0.0, 0.5])
def test_cages_of_cubes(kappa: float, caged: bool, turned: float) -> None:
    thing = Object(
        name="cube", box={"x_m": (-0.02, 0.02), "y_m": (-0.02, 0.02)}, pose={"x_m": 0, "y_m": 0}
    )
    q, pose = np.array([0.0, 0, 0, kappa, kappa]), np.array([0.0, 0.034, turned])
    assert cage_proved(GEOMETRY, thing, pose, q, 0.0, finest_m=1e-3) == caged
    if caged:  # so is the disc within it; of what is not, the one around it is not
        assert in_a_hole(q, pose[:2], 0.02)
    else:
        assert not in_a_hole(q, pose[:2], 0.02)


def test_a_disc_is_pushed_by_what_is_behind_it() -> None:
    """Straight, the robot touches a disc at one point: friction decides how far aside it goes."""
    q, mu = np.zeros(5), 0.3
    thing = Object(name="disc", disc={"radius_m": 0.03}, friction=mu, pose={"x_m": 0, "y_m": 0})
    seen = np.array([0.0, 0.034, 0.0])
    slopes = np.array([0.0, 0.1, 0.5, 2.0])
    twists = np.array([[s, 1.0, 0.0] for s in slopes] + [[0.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    kept = pushes(GEOMETRY, thing, seen, q, twists)
    assert kept.tolist() == [True, True, False, False, False, True]
    without = thing.with_values(friction=0.0)
    assert pushes(GEOMETRY, without, seen, q, twists[:1]).tolist() == [True]


# --- plan files ----------------------------------------------------------------------------------


def result() -> Result:
    trajectory = pick_and_place()
    plan = replace(picked((0.2, 0.1, 0.5)), trajectory=trajectory, verification=verify(trajectory))
    stats = Stats(0.0, 0, 0, 0)
    return Result(trajectory.problem, "optimal", Status.FEASIBLE, "", None, None, stats, plan)


def test_plan_files_of_missions_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    result().save(path)
    document = json.loads(path.read_text())
    assert document["version"] == 3
    assert [item["do"] for item in document["tasks"]] == ["grasp", "carry", "release"]
    (held,) = document["carried"]
    assert held["object"] == "cup"
    assert held["pose_in_b0"] == pytest.approx([0.0, 0.0345, 0.0], abs=1e-6)
    Draft7Validator(json_schema("plan")).validate(document)
    read = load_plan(path).require()
    assert read.trajectory.done_s == times(picked((0.2, 0.1, 0.5)))
    assert read.problem == result().problem
    assert read.to_dict() == result().require().to_dict()
    checked = check_plan(path)
    assert checked.ok, checked.problems
    assert {"tasks", "carried", "tasks in order"} <= {check.name for check in checked.checks}


@pytest.mark.parametrize(
    ("where", "key", "value"),
    [
        *(("tasks", "configuration", [0.0] * 5), ("tasks", "object", "can")),
        *(("tasks", "do", "reach"), ("tasks", "name", "first")),
        ("carried", "pose_in_b0", [0.0, 0.0345 + 1e-6, 0.0]),
    ],
)
def test_what_a_file_says_of_its_tasks_and_what_is_carried_is_not_believed(
    where: str, key: str, value: object, tmp_path: Path
) -> None:
    document = json.loads(json.dumps(result().to_dict()))
    document[where][0][key] = value
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document))
    assert check_plan(path).problems == (f"{where}: not what follows from the samples",)
    del document["tasks"][0]
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="a time for each of 3 tasks"):
        load_plan(path)


def test_uncertain_curvatures_need_more_room_on_every_leg() -> None:
    """A post that the robot is near to while it carries, and far from at its start."""
    post = [{"disc": {"x_m": 0.33, "y_m": 0.0, "radius_m": 0.02}}]
    nearest = closest_approach(pick_and_place(obstacles=post))
    assert nearest is not None
    assert nearest.at_s > pick_and_place().done_s[0] + 1.0
    assert nearest.least_m > 5e-3
    per_m = uncertain_m(pick_and_place(obstacles=post, curvature_uncertainty_per_m=1.0).problem)
    world = {"obstacles": post, "clearance_m": nearest.least_m - 2e-3}
    for uncertain_by_m, ok in ((1e-3, True), (4e-3, False)):
        unsure = pick_and_place(**world, curvature_uncertainty_per_m=uncertain_by_m / per_m)
        found = [text for text in told(unsure) if "curvature_uncertainty_per_m" in text]
        assert bool(found) != ok, found
