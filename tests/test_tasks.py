"""Objects and tasks as values: what they mean, round trips, and every mistake by its place."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft7Validator
from once import cases, planned

from twosra_mpc import InputError, Problem, check_plan, load_problem, plan
from twosra_mpc.checking.verification import verify
from twosra_mpc.execution import Ending
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.lab.schema import json_schema
from twosra_mpc.plotting import plot_plan
from twosra_mpc.problem.goals import Anywhere, Goal, GoalSet, Tolerance
from twosra_mpc.problem.tasks import Carry, Conform, Grasp, Pass, Reach, Release, Stage, Task
from twosra_mpc.problem.world import Object, area_m2, read_outline
from twosra_mpc.robot.coordinates import composed, inverse, wrapped
from twosra_mpc.robot.modes import Mode, rigid_mode

START = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
GOAL = {"x_m": 0.3, "y_m": 0.0}
CUP = {"name": "cup", "disc": {"radius_m": 0.03}, "pose": {"x_m": 0.3, "y_m": 0.1}}
BOX = {"name": "box", "box": {"x_m": [-0.02, 0.02], "y_m": [-0.01, 0.01]}}
BOX |= {"pose": {"x_m": -0.3, "y_m": 0.1, "phi_rad": 0.5}}
WALL = {"name": "wall", "box": {"x_m": [0.5, 0.6], "y_m": [0.0, 1.0]}}
PICK = [
    {"do": "grasp", "object": "cup"},
    {"do": "carry", "object": "cup", "x_m": -0.3, "y_m": 0.2},
    {"do": "release", "object": "cup"},
]
VALIDATOR = Draft7Validator(json_schema("scenario"))


def document(*tasks: dict[str, Any], **changes: Any) -> dict[str, Any]:
    found = {"robot": "2sra-v1", "start": START, "objects": [CUP, BOX], "obstacles": [WALL]}
    return copy.deepcopy({**found, "tasks": list(tasks), **changes})


def mission(*tasks: dict[str, Any], **changes: Any) -> Problem:
    return Problem.parse(document(*tasks, **changes), "test")


def refused(*tasks: dict[str, Any], **changes: Any) -> str:
    with pytest.raises(InputError) as caught:
        mission(*tasks, **changes)
    return str(caught.value).removeprefix("test: ")


# --- tasks ---------------------------------------------------------------------------------------


def test_tasks_are_values_of_their_kind() -> None:
    problem = mission(
        {"do": "conform", "object": "wall", "segments": [1, 2]},
        {"do": "pass", "x_m": [0.0, 0.1]},
        {"do": "reach", "kappa_per_m": [3.0, "free"]},
        *PICK,
    )
    kinds = [type(task) for task in problem.tasks]
    assert kinds == [Conform, Pass, Reach, Grasp, Carry, Release]
    assert [task.do for task in problem.passes] == ["pass"]
    assert isinstance(problem.tasks[3], Grasp)
    assert problem.tasks[3].hold == "caged"


def test_a_last_reach_is_the_goal() -> None:
    told = mission({"do": "reach", **GOAL}, objects=[], obstacles=[])
    assert told == mission(goal=GOAL, objects=[], obstacles=[])
    assert told.tasks == ()
    assert not told.ends_anywhere


@pytest.mark.parametrize("last", [PICK[2], {"do": "reach", **GOAL, "mode": "any"}])
def test_a_mission_may_end_where_its_last_task_does(last: dict[str, Any]) -> None:
    before = PICK[:2] if last["do"] == "release" else PICK
    problem = mission(*before, last)
    assert problem.ends_anywhere
    assert problem.tasks[-1].do == last["do"]
    q = np.array([1.0, -2.0, 3.0, 40.0, -50.0])
    assert not problem.goal.error(q).any()
    assert np.isnan(problem.goal.configuration).all()
    low, high = problem.goal.box(q)
    assert (low == -np.inf).all()
    assert (high == np.inf).all()
    assert problem.goal.mode == (0, 0)


def test_a_box_to_pass_at_the_end_needs_a_goal() -> None:
    assert refused({"do": "pass", "x_m": [0.0, 0.1]}).startswith("goal is missing")
    assert VALIDATOR.is_valid(document({"do": "pass", "x_m": [0.0, 0.1]}, goal=GOAL))


def test_goals_on_the_way_have_the_keys_of_a_goal() -> None:
    flat = mission({"do": "reach", **GOAL, "mode": [1, 0]}, *PICK).tasks[0]
    table = mission({"do": "reach", "goal": {**GOAL, "mode": [1, 0]}}, *PICK).tasks[0]
    assert flat == table
    assert isinstance(flat, Reach)
    assert flat.mode is None
    assert flat.goal.mode == (1, 0)
    assert flat.goal.half_width[0] > 0  # filled in for the robot
    soft = mission({"do": "reach", **GOAL, "mode": "any"}, *PICK).tasks[0]
    assert isinstance(soft, Reach)
    assert (soft.mode, soft.goal.mode) == ("any", (0, 0))
    assert Reach(goal=Goal(x_m=1.0)).goal.configuration[0] == 1.0


def test_scenarios_of_missions_survive_a_round_trip() -> None:
    tasks = [
        {"do": "reach", **GOAL, "mode": "any"},
        {"do": "conform", "object": "wall"},
        {"do": "pass", "name": "door", "y_m": [0.0, 0.2]},
        *PICK,
    ]
    for changes in ({}, {"goal": GOAL}, {"order": "free"}):
        problem = mission(*tasks, **changes)
        said = json.loads(json.dumps(problem.scenario()))
        VALIDATOR.validate(said)
        assert Problem.parse(said, "again") == problem
    held = {**START, "holding": "cup"}
    problem = mission(*PICK[1:], start=held)
    assert Problem.parse(problem.scenario(), "again") == problem


def test_what_only_missions_have_is_not_said_of_others() -> None:
    said = load_problem("rigid-move").scenario()
    assert not {"objects", "order"} & said.keys()
    assert "holding" not in said["start"]


WITHOUT_X = "a pose without x", [PICK[0], {**PICK[1], "x_m": None}], "tasks.1.x_m", "number"


@pytest.mark.parametrize(
    ("mistake", "tasks", "field", "allowed"), [*cases("tasks")["mistakes"], WITHOUT_X]
)
def test_a_mistake_in_tasks_is_named(
    mistake: str, tasks: list[dict[str, Any]], field: str, allowed: str
) -> None:
    words = refused(*tasks, goal=GOAL)
    assert field in words.split(" = ")[0], mistake
    assert allowed in words


def test_without_objects_there_is_nothing_to_grasp() -> None:
    words = refused(PICK[0], objects=[])
    assert "an object; there are none" in words
    assert "start.holding" in refused(goal=GOAL, start={**START, "holding": "can"})
    without = refused(goal=GOAL, start={**START, "holding": "cup"}, objects=[])
    assert "an object; there are none" in without


def test_what_is_held_at_the_start_is_in_the_hand() -> None:
    held = {**START, "holding": "cup"}
    assert mission(*PICK[1:], start=held).tasks[0].do == "carry"
    assert "release cup first" in refused(PICK[0], start=held)


# --- objects -------------------------------------------------------------------------------------

OBJECT_MISTAKES: dict[str, tuple[dict[str, Any], str, str]] = {
    "no name": ({"name": ""}, "objects.0.name", "a name: tasks call it by that"),
    "no shape": ({"disc": None}, "objects.0", "one of disc, box, polygon_m, outline"),
    "two shapes": (
        {"box": {"x_m": [0.0, 1.0], "y_m": [0.0, 1.0]}},
        "objects.0",
        "one of disc, box, polygon_m, outline",
    ),
    "a disc of nothing": ({"disc": {"radius_m": 0.0}}, "objects.0.disc.radius_m", "greater than 0"),
    "a polygon of two points": (
        {"disc": None, "polygon_m": [[0.0, 0.0], [1.0, 0.0]]},
        "objects.0.polygon_m",
        "at least three corners",
    ),
    "a polygon that crosses itself": (
        {"disc": None, "polygon_m": [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]},
        "objects.0.polygon_m",
        "does not cross or touch itself",
    ),
    "an outline and a polygon": (
        {"disc": None, "polygon_m": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], "outline": "a.csv"},
        "objects.0.outline",
        "either an outline or polygon_m",
    ),
    "an outline that is not there": (
        {"disc": None, "outline": "nowhere.csv"},
        "objects.0",
        "a file that exists",
    ),
    "a negative friction": ({"friction": -0.1}, "objects.0.friction", "greater than or equal to 0"),
    "the name of another": ({"name": "box"}, "objects.1.name", "a name that nothing else has"),
    "the name of an obstacle": ({"name": "wall"}, "objects.0.name", "nothing else has"),
    "no pose": ({"pose": None}, "objects.0.pose", "a table of keys"),
}


@pytest.mark.parametrize("mistake", OBJECT_MISTAKES)
def test_a_mistake_in_an_object_is_named(mistake: str) -> None:
    changes, field, allowed = OBJECT_MISTAKES[mistake]
    words = refused(goal=GOAL, objects=[{**CUP, **changes}, BOX])
    assert field in words
    assert allowed in words


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 2, st.floats(-7.0, 7.0)))
def test_an_object_is_where_its_pose_puts_its_frame(pose: tuple[float, float, float]) -> None:
    shape = Object(name="l", polygon_m=[(0, 0), (0.2, 0), (0.2, 0.1)], pose={"x_m": 0, "y_m": 0})
    seen = shape.at(np.array(pose)).corners_m
    corners = np.column_stack([shape.own.corners_m, np.zeros(3)])
    assert seen == pytest.approx(composed(np.array(pose), corners)[:, :2])
    assert area_m2(seen) == pytest.approx(0.01)
    disc = Object(name="d", disc={"radius_m": 0.1}, pose={"x_m": 0, "y_m": 0}).at(np.array(pose))
    assert disc.disc is not None
    assert (disc.disc.x_m, disc.disc.y_m, disc.disc.radius_m) == (*pose[:2], 0.1)


def test_objects_are_in_the_way_until_told_otherwise() -> None:
    problem = mission(*PICK)
    assert [item.name for item in problem.world.obstacles] == ["wall"]
    poses = [each.pose.pose for each in problem.objects]
    assert [item.name for item in problem.world_with(poses).obstacles] == ["wall", "cup", "box"]
    moved = problem.world_with([None, np.array([1.0, 2.0, 0.0])])
    assert [item.name for item in moved.obstacles] == ["wall", "box"]
    assert moved.obstacles[1].corners_m.mean(axis=0) == pytest.approx([1.0, 2.0])


SQUARE = ((0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1))


@pytest.mark.parametrize(
    "text",
    [
        "0,0\n0.1,0\n0.1,0.1\n0,0.1\n",
        "x_m,y_m\n0,0\n0.1,0\n\n0.1,0.1\n0,0.1\n",
        "0, 0\n0.1, 0\n0.1, 0.1\n0, 0.1\n0, 0\n",
    ],
)
def test_outlines_are_read_with_and_without_a_head_and_the_first_point_again(
    text: str, tmp_path: Path
) -> None:
    path = tmp_path / "shape.csv"
    path.write_text(text)
    assert read_outline(path) == SQUARE
    read = Object(name="l", outline=str(path), pose={"x_m": 0, "y_m": 0})  # type: ignore[call-arg]
    assert read.polygon_m == SQUARE
    assert Object(**dict(read)) == read


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0,0\n0.1\n", "line 2 = '0.1' is not acceptable; allowed: two numbers, x and y in m"),
        ("x,y\n0,0\nleft,right\n", "line 3 = 'left,right'"),
        ("0,0\n0,nan\n", "line 2 = '0,nan' is not acceptable; allowed: finite numbers"),
        ("0,0,0\n0,1\n", "corners"),
    ],
)
def test_a_mistake_in_an_outline_is_named_by_its_line(
    text: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "shape.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        Object(name="l", outline=str(path), pose={"x_m": 0, "y_m": 0})  # type: ignore[call-arg]
    assert words in str(caught.value)


# --- poses ---------------------------------------------------------------------------------------


@given(st.integers(0, 1000))
def test_poses_are_a_group(seed: int) -> None:
    a, b, c = np.random.default_rng(seed).uniform(-3, 3, (3, 3))
    assert composed(composed(a, b), c) == pytest.approx(composed(a, composed(b, c)))
    assert composed(a, inverse(a)) == pytest.approx(np.zeros(3))
    assert composed(inverse(a), a) == pytest.approx(np.zeros(3))


@given(st.floats(-50.0, 50.0))
def test_angles_are_brought_within_half_a_turn(angle: float) -> None:
    found = float(wrapped(np.array(angle)))
    assert -math.pi <= found <= math.pi
    assert math.cos(found) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(found) == pytest.approx(math.sin(angle), abs=1e-9)


# --- schema --------------------------------------------------------------------------------------


def test_missions_fit_the_schema_of_scenarios() -> None:
    VALIDATOR.validate(document(*PICK))
    VALIDATOR.validate(document({"do": "reach", **GOAL, "mode": "any"}))
    VALIDATOR.validate(document({"do": "reach", "goal": GOAL}, *PICK))
    VALIDATOR.validate(document(goal=GOAL, objects=[{**CUP, "disc": None, "outline": "a.csv"}]))
    for task in ({"do": "throw"}, {"object": "cup"}, {**PICK[0], "hold": "tied"}):
        assert not VALIDATOR.is_valid(document(task))
    assert not VALIDATOR.is_valid({k: v for k, v in document().items() if k != "tasks"})


def test_a_task_of_ones_own_is_planned_checked_and_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A new kind of task is this class: from the scenario to the run nothing else knows of it."""
    monkeypatch.setattr(Task, "kinds", dict(Task.kinds))

    class Straighten(Task):
        """Come to rest straight and frozen, wherever."""

        asks_shape: ClassVar[bool] = True

        do: Literal["straighten"] = "straighten"

        @property
        def ends_in(self) -> GoalSet:
            return Goal(kappa_per_m=(0.0, 0.0), tolerance=Tolerance(kappa_per_m=(0.5, 0.5)))

        def stage(self, modes: Sequence[Mode]) -> Stage:
            return Stage(modes, self.ends_in.mode, self.ends_in)

    bent = load_problem("paper-1")
    problem = bent.with_values(tasks=({"do": "straighten"},))
    assert problem.tasks == (Straighten(),)
    found = plan(problem)
    made = found.require()
    assert made.verification.ok
    assert made.cost.total > planned("paper-1").cost.total
    (done_s,) = made.trajectory.done_s
    (q,) = made.trajectory.configuration([done_s])
    assert np.abs(q[3:]).max() <= 0.5 + 1e-6
    assert made.trajectory.at([done_s]).mode.tolist() == [[0, 0]]
    found.save(tmp_path / "plan.json")
    assert check_plan(tmp_path / "plan.json").ok
    early = replace(made.trajectory, done_s=(0.0,))
    assert any("straighten" in text for text in verify(early).problems)
    run = simulate(problem, plan=made, disturbance="mild").run
    assert run.ending is Ending.REACHED, run.reason
    assert len(run.done_s) == 1


def test_a_task_that_waits_is_planned_checked_drawn_and_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A stage lasts as long as its task says; what comes next melts and bends after that."""
    monkeypatch.setattr(Task, "kinds", dict(Task.kinds))

    class Wait(Task):
        """Rest, with everything frozen, for so long."""

        do: Literal["wait"] = "wait"
        least_s: float

        def stage(self, modes: Sequence[Mode]) -> Stage:
            rigid = rigid_mode(len(modes[0]))
            return Stage((rigid,), rigid, Anywhere(mode=rigid), least_s=self.least_s)

    there = load_problem("paper-4")
    half = {"do": "reach", "x_m": 0.1}
    problem = there.with_values(tasks=(half, {"do": "wait", "least_s": 60.0, "name": "here"}))
    assert [stage.words for stage in problem.stages][1:] == ["wait here", "reach the goal"]
    found = plan(problem)
    made = found.require()
    before_s, done_s = made.trajectory.done_s
    assert done_s - before_s >= 60.0
    assert made.lower_bound is not None
    assert made.lower_bound > 60.0 + planned("paper-4").cost.total / 2
    waiting = made.trajectory.at(np.linspace(before_s, done_s, 50))
    assert not waiting.mode.any()
    assert np.ptp(waiting.q[1:], axis=0) == pytest.approx(0.0)
    found.save(tmp_path / "plan.json")
    assert check_plan(tmp_path / "plan.json").ok
    early = replace(made.trajectory, done_s=(before_s, before_s + 10.0))
    assert any("it lasts 10 s, not 60 s" in text for text in verify(early).problems)
    assert "2 wait here" in {text.get_text() for ax in plot_plan(made).axes for text in ax.texts}
    run = simulate(problem, plan=made, disturbance="mild").run
    assert run.ending is Ending.REACHED, run.reason
