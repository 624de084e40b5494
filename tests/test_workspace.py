"""A box that no point of the robot leaves: planned, checked between samples, told and drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from matplotlib.patches import Rectangle
from once import planned
from problems import ROBOT

from twosra_mpc import InputError, Plan, Problem, Status, load_plan, load_problem, load_robot, plan
from twosra_mpc.checking.verification import verify
from twosra_mpc.execution.belief import Metal
from twosra_mpc.execution.replanning import remaining_problem
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.planning.solver.multiple_shooting import transcribe
from twosra_mpc.plotting import plot_plan
from twosra_mpc.problem.world import Workspace
from twosra_mpc.robot.coordinates import Array

ROOM_M = 3e-3  # around start and goal


def points(made: Plan, q: Array) -> Array:
    """Outermost points of the robot, by the drawing's own shapes, (rows, points, 2)."""
    shape, thick = robot_shape(made.robot.geometry, q), made.robot.geometry.fibre_radius_m
    around = thick * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    fibre = [part.reshape(len(q), -1, 1, 2) + around for part in (shape.segments, shape.links)]
    parts = (*fibre, shape.units, shape.wheels)
    return np.concatenate([part.reshape(len(q), -1, 2) for part in parts], axis=1)


def visited(made: Plan) -> Array:
    """The outline at many times of every motion."""
    times = [np.linspace(phase.start_s, phase.end_s, 700) for phase in made.phases]
    return points(made, made.trajectory.configuration(np.concatenate(times)))


def cut(name: str, side: int, axis: int) -> Workspace:
    """A half-plane that start and goal are in, and the quickest motion is not."""
    ends = points(planned(name), planned(name).samples.q[[0, -1]]).reshape(-1, 2)
    edge = (ends.min(axis=0) - ROOM_M, ends.max(axis=0) + ROOM_M)[side][axis]
    pair = (float(edge), 9.0) if side == 0 else (-9.0, float(edge))
    return Workspace(**{("x_m", "y_m")[axis]: pair})


CUTS = [("paper-2", 0, 1), ("shape-change", 0, 1), ("paper-4", 1, 0)]


@pytest.mark.parametrize(("name", "side", "axis"), CUTS[:2])  # the third takes ten seconds
def test_a_plan_that_leaves_is_made_anew_inside(name: str, side: int, axis: int) -> None:
    box = cut(name, side, axis)
    assert box.margin_m(visited(planned(name))).min() < -0.01
    problem = planned(name).problem.with_values(workspace=box, gap=0.02, work_limit=300_000.0)
    made = plan(problem).require()
    assert made.verification.ok
    inside = float(box.margin_m(visited(made)).min())
    assert inside >= 0
    assert inside - 1e-4 <= made.verification.limits["workspace_m"] <= inside + 1e-7
    assert made.lower_bound == planned(name).lower_bound  # a box only takes plans away
    assert made.cost.total >= (made.lower_bound or 0.0)


def test_a_drive_bends_away_from_the_edge() -> None:
    """The screw from one heading to the other leads through a half-plane that is forbidden."""
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    goal = {"x_m": 0.0, "y_m": 0.5, "phi_rad": np.pi, "kappa_per_m": [0.0, 0.0]}
    base = Problem(
        robot=load_robot("2sra-v1"), start=start, goal=goal, modes=[[0, 0]], gap=0.5, max_phases=1
    )
    screw = plan(base).require()
    seen = visited(screw)
    ends = seen[[0, -1]].reshape(-1, 2)
    outward = int(seen[..., 0].max() > ends[:, 0].max() + 0.07)
    edge = (ends[:, 0].min() - 0.02, ends[:, 0].max() + 0.02)[outward]
    box = Workspace(x_m=(float(edge), 9.0) if outward == 0 else (-9.0, float(edge)))
    assert box.margin_m(seen).min() < -0.05
    made = plan(base.with_values(workspace=box)).require()
    assert made.verification.ok
    assert box.margin_m(visited(made)).min() >= 0


@pytest.mark.parametrize(("name", "side", "axis"), CUTS)
def test_verification_catches_a_plan_that_leaves(name: str, side: int, axis: int) -> None:
    box, made = cut(name, side, axis), planned(name)
    problem = made.problem.with_values(workspace=box)
    found = verify(replace(made.trajectory, problem=problem))
    outside = -1e3 * float(box.margin_m(visited(made)).min())
    assert not found.ok
    assert found.limits["workspace_m"] * 1e3 == pytest.approx(-outside, abs=0.1)
    (told,) = found.problems
    by = f"{-1e3 * found.limits['workspace_m']:.3g} mm"
    assert told.startswith(f"the robot leaves the workspace by {by} at ")


@pytest.mark.parametrize("name", ["paper-1", "three-segments"])
def test_what_lies_between_samples_counts(name: str) -> None:
    """The margin stated is never more than that of any place on the way, and little less."""
    made = planned(name)
    seen = visited(made)
    for axis, side in ((0, 0), (0, 1), (1, 0), (1, 1)):
        edge = float((seen.min(axis=(0, 1)) - 0.01, seen.max(axis=(0, 1)) + 0.01)[side][axis])
        pair = (edge, 9.0) if side == 0 else (-9.0, edge)
        box = Workspace(**{("x_m", "y_m")[axis]: pair})
        problem = made.problem.with_values(workspace=box)
        margin = verify(replace(made.trajectory, problem=problem)).limits["workspace_m"]
        least = float(box.margin_m(seen).min())
        assert least - 1e-4 <= margin <= least + 1e-7


def test_room_enough_changes_nothing() -> None:
    problem = load_problem("paper-1", workspace={"x_m": [-2, 2], "y_m": [-2, 2]})
    made = plan(problem).require()
    assert made.cost == planned("paper-1").cost
    assert (made.samples.q == planned("paper-1").samples.q).all()
    assert 1.0 < made.verification.limits["workspace_m"] < 2.0
    assert "workspace_m" not in planned("paper-1").verification.limits


def test_only_problems_with_a_workspace_have_its_rows() -> None:
    without = transcribe(ROBOT.body, None, 2, 3, 1)
    with_it = transcribe(ROBOT.body, None, 2, 3, 1, inside=True)
    assert "inside" not in without.rows
    assert with_it.nlp["x"].shape == without.nlp["x"].shape
    assert with_it.rows["inside"].start == without.nlp["g"].numel()


def test_no_plan_inside_is_no_proof_that_there_is_none() -> None:
    base = planned("paper-4")
    ends = points(base, base.samples.q[[0, -1]]).reshape(-1, 2)
    low, high = ends.min(axis=0) - 1e-4, ends.max(axis=0) + 1e-4
    box = {"x_m": (float(low[0]), float(high[0])), "y_m": (float(low[1]), float(high[1]))}
    result = plan(base.problem.with_values(workspace=box, work_limit=100.0))
    assert result.status is Status.FAILED
    assert result.message.startswith("no plan found within the workspace")


def test_ends_outside_are_named() -> None:
    q = load_problem("paper-1").start.configuration
    shape = points(planned("paper-1"), q[None]).reshape(-1, 2)
    wrong: dict[str, Any] = {"x_m": [float(shape[:, 0].min()) + 0.012, 9.0]}
    with pytest.raises(InputError, match=r"start = .*12\.0 mm outside"):
        plan(load_problem("paper-1", workspace=wrong))
    goal = points(planned("paper-1"), planned("paper-1").problem.goal.configuration[None])
    ends = [float(shape[:, 1].max()), float(goal[..., 1].max())]  # the start lies lower
    wrong = {"y_m": [-9.0, ends[1] - 0.02]}
    assert ends[0] < ends[1] - 0.02
    with pytest.raises(InputError, match=r"goal = .*20\.0 mm outside"):
        plan(load_problem("paper-1", workspace=wrong))
    free = {"kappa_per_m": [20.0, "free"]}  # of which some lies inside, for all that is known
    assert plan(load_problem("paper-1", workspace=wrong, goal=free, work_limit=20.0))


def test_a_wide_goal_is_left_to_the_search() -> None:
    base = load_problem("rigid-move", workspace={"x_m": [-0.3, 0.3]})
    goal = {"x_m": 0.5, "tolerance": {"x_m": 1.0}}  # its middle and its corners are outside
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    found = plan(Problem(**{**dict(base), "start": start, "goal": goal})).require()
    assert found.verification.ok


@pytest.mark.parametrize("pair", [[0.4, 0.1], [0.2, 0.2], [0.1], ["a", "b"]])
def test_a_box_has_its_lower_edge_first(pair: list[Any]) -> None:
    with pytest.raises(InputError, match=r"workspace\.y_m"):
        load_problem("paper-1", workspace={"x_m": [0.0, 1.0], "y_m": pair})


def test_people_see_it(run: Run, tmp_path: Path) -> None:
    text = 'robot = "2sra-v1"\nworkspace = { y_m = [-0.1, 0.5] }\n'
    text += "start = { x_m = 0, y_m = 0, phi_rad = 0, kappa_per_m = [0, 0] }\n"
    (tmp_path / "mine.toml").write_text(text + "goal = { x_m = 0.1 }\n")
    assert run("plan", "mine.toml", "--out", "plan.json").code == 0
    checked = run("verify", "plan.json")
    assert checked.code == 0
    assert "limit workspace_m" in checked.out
    figure = plot_plan(load_plan("plan.json").require())
    patches = [patch for ax in figure.axes for patch in ax.patches]
    drawn = [p for p in patches if isinstance(p, Rectangle) and p.get_y() == -0.1]
    assert drawn
    assert all(box.get_height() == pytest.approx(0.6) for box in drawn)


def test_a_run_that_has_left_gets_the_room_it_needs() -> None:
    problem = planned("paper-2").problem
    q, cold = problem.goal.configuration, [Metal(here_C, 0.0) for here_C in problem.temperatures]
    edge = float(points(planned("paper-2"), q[None])[..., 1].min()) - ROOM_M
    problem = problem.with_values(workspace=Workspace(y_m=(edge, 9.0)))
    assert remaining_problem(problem, q, cold).workspace == problem.workspace
    strayed = q - [0.0, 0.02, 0.0, 0.0, 0.0]
    rest = remaining_problem(problem, strayed, cold)
    least = points(planned("paper-2"), strayed[None])[..., 1].min()
    assert rest.workspace is not None
    assert rest.workspace.y_m is not None
    assert rest.workspace.y_m[0] == pytest.approx(least - 1e-3, abs=1e-5)
    assert rest.workspace.x_m is None
    assert plan(rest).require().verification.ok
