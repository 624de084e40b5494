"""Why a plan among obstacles reshapes: blame, room, ways round, and what of it is printed."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import shapely
from conftest import Run
from test_explanation import alternative
from worlds import corridor, random_world

from twosra_mpc import Problem, Status, load_problem, plan
from twosra_mpc.analysis.alternatives import FARTHER_M
from twosra_mpc.analysis.explanation import Explanation, explain
from twosra_mpc.analysis.reshaping import Reshaping, reshaping
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.problem.world import World
from twosra_mpc.robot.modes import RIGID, SOFT_1
from twosra_mpc.space.drives import Drives
from twosra_mpc.space.gaps import gaps_through

PEBBLE = {"name": "pebble", "disc": {"x_m": -0.45, "y_m": 0.2, "radius_m": 0.01}}


def reasons(problem: Problem) -> Reshaping:
    """What is said of a problem for which no plan was made."""
    none = Result(problem, "optimal", Status.FAILED, "", None, None, Stats(0.0, 0, 0, 0), None)
    return reshaping(none)


def walled(*obstacles: Any, **changes: Any) -> Problem:
    base = load_problem("corridor")
    return base.with_values(obstacles=(*base.obstacles, *obstacles), **changes)


# --- what is to blame ----------------------------------------------------------------------------


def test_the_walls_of_the_corridor_are_to_blame_and_nothing_else() -> None:
    (blocked,) = reasons(walled(PEBBLE)).blocked
    assert blocked.words == "no drive in this shape"
    assert blocked.obstacles == ("upper wall", "lower wall")
    assert str(blocked).startswith("no drive in this shape: proved blocked at upper wall and lower")


@pytest.mark.parametrize("removed", [0, 1])
def test_without_one_that_is_to_blame_there_is_a_drive(removed: int) -> None:
    base = load_problem("corridor")
    left = base.with_values(obstacles=base.obstacles[1 - removed : 2 - removed])
    drives = Drives(left.robot, left.world, left.start.kappa_per_m)
    start, goal = left.start.configuration, left.goal.configuration
    assert drives.decide(start[:3], goal[:3]).verdict == "certified"


def test_several_together_are_to_blame_where_none_is_alone() -> None:
    twice = [item.model_copy(update={"name": f"{item.name}, again"}) for item in walled().obstacles]
    (blocked,) = reasons(walled(*twice)).blocked
    assert blocked.obstacles == ()
    assert "several obstacles together" in str(blocked)


def test_nothing_is_proved_of_a_wide_corridor() -> None:
    wide = dict(corridor(0.3))
    assert reasons(load_problem("corridor").with_values(**wide)).blocked == ()


def test_only_the_shape_that_does_not_pass_is_blocked() -> None:
    """A straight robot passes the doorway, a bent one does not: whichever way it goes."""
    there = load_problem("doorway")
    start, goal = there.start, there.goal.configuration
    back = there.with_values(
        start=dict(zip(("x_m", "y_m", "phi_rad"), goal[:3].tolist(), strict=True))
        | {"kappa_per_m": goal[3:].tolist()},
        goal={"x_m": start.x_m, "y_m": start.y_m, "phi_rad": start.phi_rad}
        | {"kappa_per_m": start.kappa_per_m},
    )
    (gone,), (come,) = reasons(there).blocked, reasons(back).blocked
    assert gone.words.startswith("the start's shape")
    assert come.words.startswith("the goal's shape")
    assert gone.obstacles == come.obstacles == ("upper wall", "lower wall")


def test_a_way_that_is_blocked_in_every_shape_is_explained(run: Run) -> None:
    code, out, err = run("explain", "blocked", "--json")
    told = json.loads(out)
    assert (code, err) == (3, "")
    assert told["alternatives"] == []
    (blocked,) = told["reshaping"]["blocked"]
    assert blocked["obstacles"] == ["upper wall", "lower wall"]
    assert blocked["words"] in told["reshaping"]["why"][0]
    assert told["reshaping"]["places"] == []


# --- gaps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_a_gap_is_what_its_two_obstacles_are_apart_and_is_closed_by_one_more(seed: int) -> None:
    world = random_world(seed)
    path = np.array([[-0.6, -0.55], [0.6, 0.55]])
    shapes = {
        name: shapely.Polygon(item.corners_m)
        for name, item in zip(world.names, world.obstacles, strict=True)
    }
    edge = shapely.box(*world.workspace.corners_m.ravel()).exterior if world.workspace else None
    found = gaps_through(world, path)
    assert found
    assert [gap.width_m for gap in found] == sorted(gap.width_m for gap in found)
    for gap in found:
        first, second = (shapes.get(name, edge) for name in gap.between)
        assert gap.width_m >= first.distance(second) - 1e-12
        if second is not edge:
            assert gap.width_m == pytest.approx(first.distance(second))
        filled = shapely.Polygon(gap.closed.corners_m)
        assert filled.intersects(shapely.LineString(path))
        assert max(filled.distance(first), filled.distance(second)) < 1e-9


def test_a_path_past_everything_goes_through_no_gap() -> None:
    world = World(obstacles=random_world(0).obstacles)
    assert gaps_through(world, np.array([[-3.0, -2.0], [3.0, -2.0]])) == []


# --- all of it -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def between_pillars() -> Explanation:
    """A straight robot drives between two pillars, or round them."""
    ends = {"x_m": 0.3, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    problem = load_problem(
        "rigid-move",
        robot="2sra-v1",
        start=ends | {"x_m": -0.3},
        goal=ends,
        obstacles=[
            {"name": "left", "disc": {"x_m": 0.0, "y_m": 0.12, "radius_m": 0.04}},
            {"name": "right", "disc": {"x_m": 0.0, "y_m": -0.12, "radius_m": 0.04}},
        ],
        modes=[RIGID, SOFT_1],
        work_limit=10000.0,
    )
    return explain(problem)


def test_the_next_best_way_round_keeps_out_of_the_gap(between_pillars: Explanation) -> None:
    (change,) = [one.change for one in between_pillars.alternatives if "way round" in one.change]
    assert "mm between left and right closed" in change
    other = alternative(between_pillars, change)
    assert other.plan is not None
    assert other.difference_s is not None
    assert other.difference_s > 0
    assert len(other.plan.problem.obstacles) == 3
    through = gaps_through(between_pillars.result.problem.world, other.plan.samples.q[:, :2])
    assert ("left", "right") not in [gap.between for gap in through]


def test_more_clearance_is_planned_anew(between_pillars: Explanation) -> None:
    other = alternative(between_pillars, "with 5 mm more clearance")
    asked = between_pillars.result.problem.clearance_m + FARTHER_M
    assert other.plan is not None
    assert other.plan.problem.clearance_m == pytest.approx(asked)


def test_a_drive_in_one_shape_says_nothing_of_reshaping(between_pillars: Explanation) -> None:
    assert between_pillars.reshaping is not None
    assert (between_pillars.reshaping.why, between_pillars.reshaping.places) == ((), ())


def test_room_is_there_where_obstacles_are_far_and_none_where_they_are_near() -> None:
    goal = {"kappa_per_m": (15.0, 0.0)}
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    base = load_problem("shape-change", robot="2sra-v1", start=start, goal=goal)
    shares = []
    for y_m in (0.8, 0.15):
        wall = {"name": "wall", "box": {"x_m": (-0.5, 0.5), "y_m": (y_m, y_m + 0.1)}}
        result = plan(base.with_values(obstacles=[wall]))
        told = reshaping(result)
        (place,) = told.places
        made = result.require()
        assert place.modes == (SOFT_1,)
        soft = next(phase for phase in made.phases if phase.mode == SOFT_1)
        assert place.begin == pytest.approx(made.trajectory.at(soft.start_s).q[0, :3], abs=1e-9)
        assert place.end == pytest.approx(made.trajectory.at(soft.end_s).q[0, :3], abs=1e-9)
        assert len(told.why) == 1
        assert told.why[0].startswith("the goal asks for another shape; no obstacle is proved")
        shares.append(place.room)
    assert shares[0] == 1.0
    assert 0.3 < shares[1] < 0.9  # the wall takes less than half of the disc of places


def test_without_obstacles_nothing_is_added(run: Run) -> None:
    code, out, _ = run("explain", "rigid-move", "--time-limit", "1", "--json")
    assert code == 0
    assert json.loads(out)["reshaping"] is None
