"""Planned missions: search = brute force, bounds below costs, and what plans of missions share."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from grasps import drawn
from once import solved
from problems import bold, faster_robot, random_problem
from scipy.optimize import linprog

from twosra_mpc import InputError, Plan, Problem, Result, Robot, load_robot, plan
from twosra_mpc.checking.plan_file import check_plan
from twosra_mpc.checking.verification import verify
from twosra_mpc.planning.bounds.schedule import with_durations
from twosra_mpc.planning.bounds.stage_bounds import Shapes, StageBounds
from twosra_mpc.planning.relaxation import stage_bounds, stage_tree
from twosra_mpc.planning.search.branch_and_bound import branch_and_bound
from twosra_mpc.planning.search.nodes import Node
from twosra_mpc.planning.search.stage_costs import Alone
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.planning.solver.sequence_solver import SequenceSolver
from twosra_mpc.planning.solver.sequence_solver import Solved as Made
from twosra_mpc.planning.stages.variants import Variant, ways_of
from twosra_mpc.plans.plan import Status
from twosra_mpc.problem.tasks import Reach
from twosra_mpc.robot.modes import (
    RIGID,
    SOFT_1,
    SOFT_2,
    SOFT_BOTH,
    Mode,
    all_modes,
    is_rigid,
    rigid_mode,
)
from twosra_mpc.timing import transition_model

ROUNDING = 1e-6
START: dict[str, Any] = {"x_m": -0.15, "y_m": -0.1, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
GRASP = {"do": "grasp", "object": "cup"}


def mission(*tasks: dict[str, Any], robot: str | Robot = "2sra-v1", **values: Any) -> Problem:
    """Tasks one after the other."""
    return Problem(**{"robot": robot, "start": START, "tasks": tasks, **values})


def reach(x: float, y: float, phi: float, kappa: Any, **values: Any) -> dict[str, Any]:
    return {"do": "reach", "x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": kappa, **values}


def cup(radius_m: float = 0.03, **values: Any) -> dict[str, Any]:
    """A disc before the robot."""
    pose = {"x_m": 0.25, "y_m": 0.1}
    return {"name": "cup", "disc": {"radius_m": radius_m}, "pose": pose, **values}


def cube() -> dict[str, Any]:
    """A cube in its place, which is caged from some sides only."""
    cup_there = cup()
    del cup_there["disc"]
    return {**cup_there, "box": {"x_m": (-0.025, 0.025), "y_m": (-0.025, 0.025)}}


def tree_of(problem: Problem) -> Tree[Made]:
    variants = ways_of(problem).variants
    assert variants is not None, "nothing ends it early"
    return stage_tree(problem, variants, SequenceSolver(variants))


def random_mission(seed: int, goals: int, robot: str = "2sra-v1", **values: Any) -> Problem:
    """Random goals one after the other."""
    found = [random_problem(seed + 1000 * k, load_robot(robot), **values) for k in range(goals)]
    tasks = [Reach(goal=each.goal) for each in found[:-1]]
    return found[-1].with_values(start=found[0].start, tasks=tasks)


# --- The search


def two_goals(exact: bool, **values: Any) -> Problem:
    """Two shapes that differ in segment 1; boxes of shapes of which one serves both."""
    tolerance: Any = "exact" if exact else {"kappa_per_m": (10.0, 10.0)}
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (10.0, -5.0)}
    tasks = (
        reach(0.2, 0.1, 0.5, (30.0, -5.0), tolerance=tolerance),
        reach(0.0, 0.2, -0.5, (15.0, -5.0), tolerance=tolerance),
    )
    return mission(*tasks, **{"robot": "2sra-v1-paper", "start": start, **values})


CASES = [
    {"exact": True, "modes": (RIGID, SOFT_1)},
    {"exact": True, "modes": (RIGID, SOFT_1), "timing": "constant"},
    {"exact": False, "modes": (RIGID, SOFT_1)},
    {"exact": False, "modes": (RIGID, SOFT_BOTH), "heaters_at_once": 2},
    {"exact": False, "modes": (RIGID, SOFT_1), "weights": {"energy_s_per_J": 0.3}},
    {"exact": True, "modes": (RIGID, SOFT_1), "robot": faster_robot(50.0)},
    {"exact": False, "modes": (RIGID, SOFT_1), "robot": faster_robot(500.0)},
]


@pytest.mark.parametrize("case", CASES)
def test_search_finds_what_trying_all_sequences_finds(case: dict[str, Any]) -> None:
    tree = tree_of(two_goals(**case))
    costs, bounds, tight, most = list[float](), list[float](), list[float](), 0

    def try_all(node: Node, above: float) -> None:
        nonlocal most
        low = max(above, tree.bound(node))
        if tree.too_deep(node):
            bounds.append(low)
            tight.append(low)
            return
        leaf = tree.leaf_bound(node)
        assert low <= leaf + ROUNDING
        if math.isfinite(leaf):
            found = [made[0] for made in tree.solve(node) if made is not None]
            assert all(leaf <= cost + ROUNDING for cost in found)
            whole = tree.whole(node)
            assert whole is not None
            most = max(most, *(sum(map(any, each)) for each in whole.sequences))
            costs.extend(found)
            bounds.append(leaf)
            tight.append(max(leaf, tree.tighter_bound(node, math.inf)))
        for child in tree.children(node):
            try_all(child, low)

    try_all(tree.root(), 0.0)
    result = branch_and_bound(
        tree, gap=0.0, out_of_time=lambda: False, on_progress=lambda cost, low: None
    )
    assert most == 2  # blocks of a stage
    assert result.cost == pytest.approx(min(costs), abs=1e-9)
    assert result.lower_bound <= min(*tight, *costs) + ROUNDING
    assert result.lower_bound >= min(*bounds, *costs) - ROUNDING


VALUES = [
    {},
    {"timing": "constant"},
    {"heaters_at_once": 1},
    {"weights": {"energy_s_per_J": 0.2, "transition_s": 5.0}},
]


@pytest.mark.parametrize("values", VALUES)
def test_bounds_never_fall_on_the_way_to_a_plan(values: dict[str, Any]) -> None:
    rng = np.random.default_rng(0)
    tree = tree_of(two_goals(exact=False, **{"robot": "2sra-v1", **values}))
    leaves = 0
    for _ in range(40):
        node, path = tree.root(), [0.0]
        while math.isfinite(path[-1]):
            leaf = tree.leaf_bound(node)
            leaves += math.isfinite(leaf)
            assert max(path) <= leaf + ROUNDING, node
            below = [child for child in tree.children(node) if not tree.too_deep(child)]
            if not below:
                break
            node = below[rng.integers(len(below))]
            path.append(tree.bound(node))
    assert leaves > 1


@pytest.mark.parametrize("values", VALUES[:3])
def test_sequences_of_a_stage_come_in_the_order_of_what_they_add(values: dict[str, Any]) -> None:
    """All of them, as enumerated, but those that add more than every longer one may."""
    tree = tree_of(two_goals(exact=False, **{"robot": "2sra-v1", **values}))
    alone, (stages,) = tree.leaves.so_far.to_go.alone, tree.variants
    seen = 0
    for stage, begins in itertools.product(stages, (RIGID, SOFT_1)):
        found = list(alone.cheapest_first(stage, begins))
        costs = [each.cost for each in found]
        assert costs == sorted(costs)
        longer = next((each.cost for each in found if each.sequence is None), math.inf)
        told = {each.sequence: each.cost for each in found}
        for sequence in stage.sequences(begins):
            cost = alone.cost(stage, begins, sequence)
            assert told.get(sequence, math.inf) == cost or cost >= longer - ROUNDING
            seen += sequence in told
    assert seen > 4


def history(rng: np.random.Generator, last: Mode) -> tuple[Mode, ...]:
    """Random modes that end in one, with no mode twice in a row."""
    modes = [RIGID, SOFT_1, SOFT_2, SOFT_BOTH]
    found = [last]
    for _ in range(rng.integers(0, 6)):
        others = [mode for mode in modes if mode != found[0]]
        found.insert(0, others[rng.integers(3)])
    return tuple(found)


@pytest.mark.parametrize(
    "values", [*VALUES[:3], {"robot": "2sr-v2"}, {"robot": "2sr-v2", "heaters_at_once": 1}]
)
def test_after_no_history_does_a_stage_add_less_than_is_counted(values: dict[str, Any]) -> None:
    rng = np.random.default_rng(1)
    problem = mission(reach(0.2, 0.1, 0.5, (10.0, 10.0)), goal={"x_m": 0.0}, **values)
    (stages,), equal = tree_of(problem).variants, 0
    for _ in range(40):
        warm = tuple(rng.uniform(25.0, 50.0, 2).tolist())
        start = problem.start.with_values(temperature_C=warm)
        timing = transition_model(problem.with_values(start=start))
        begins = [RIGID, SOFT_1, SOFT_2, SOFT_BOTH][rng.integers(4)]
        sequences = list(stages[0].sequences(begins))
        sequence = sequences[rng.integers(len(sequences))]
        lasting = rng.uniform(0.0, 40.0, len(sequence)) * rng.integers(0, 2)
        modes = (begins, *sequence, sequence[-1])
        counted = Alone(timing).from_warm(modes, tuple(lasting.tolist()))
        before = history(rng, begins)
        whole = (*before, *sequence)
        network = timing.network(whole, sequence[-1], [0.0] * len(whole))
        late_s = rng.choice([1e4, 1e6])
        begin = network.layout.origin, network.layout.end(len(before) - 1)
        late = replace(network, least={**network.least, begin: late_s})
        times = with_durations(late, [*rng.uniform(0.0, 99.0, len(before)), *lasting]).earliest
        assert times is not None
        adds = times[network.layout.finish] - late_s
        assert counted <= adds + 1e-5
        equal += adds - counted < 1.0
    assert equal > 3  # it is no more pessimistic than that


# --- Goals in a row


def one_by_one(problem: Problem) -> float:
    """Duration of plans from goal to goal, each with the temperatures that the one before left."""
    start, total = problem.start, 0.0
    goals = [task.goal for task in problem.tasks if isinstance(task, Reach)]
    for goal in (*goals, problem.goal):
        made = plan(problem.with_values(start=start, goal=goal, tasks=())).require()
        x, y, phi, *kappa = made.samples.q[-1].tolist()
        total += made.cost.total
        ends = zip(made.samples.temperature_C[-1], problem.segment_thresholds_C, strict=True)
        warm = tuple(min(float(now), solid) for now, (solid, _) in ends)
        metal = {"temperature_C": warm, "melt_fraction": (0.0,) * len(warm)}
        shape = {"kappa_per_m": tuple(kappa), **metal}
        start = start.with_values(x_m=x, y_m=y, phi_rad=phi, **shape)
    return total


def check_mission(result: Result) -> Plan:
    """A verified plan whose tasks are done in order, and a bound below its cost."""
    made = result.require()
    assert made.verification.ok
    assert result.lower_bound is not None
    assert 0.0 < result.lower_bound <= made.cost.total
    assert made.gap == pytest.approx(1 - result.lower_bound / made.cost.total)
    assert made.trajectory.done_s == tuple(sorted(made.trajectory.done_s))
    assert len(made.trajectory.done_s) == len(made.problem.tasks)
    return made


@pytest.mark.parametrize(("seed", "goals"), [(1, 3)])
def test_goals_planned_together_take_no_longer_than_one_by_one(seed: int, goals: int) -> None:
    problem = random_mission(seed, goals)
    made = check_mission(plan(problem))
    assert made.gap is not None
    assert made.gap < 0.03
    assert made.cost.total <= one_by_one(problem) + 0.05


def blocks(made: Plan) -> int:
    """Melt cycles."""
    soft = [not is_rigid(mode) for mode in made.sequence]
    return sum(now and not before for before, now in pairwise([False, *soft]))


@pytest.mark.parametrize("n", [2, 3])
def test_stages_may_end_in_shapes_if_a_linear_program_finds_some(n: int) -> None:
    rng, told, modes = np.random.default_rng(n), list[bool](), all_modes(n)
    for _ in range(80):
        ends = rng.uniform(-1.5, 1.5, (4, n, 1)) + rng.uniform(0.0, 2.0, (4, n, 1)) * [-1.0, 1.0]
        chosen = [[modes[k] for k in rng.integers(len(modes), size=rng.integers(3))] for _ in ends]
        shapes: Shapes | None = ((0.0,) * (n + 1),) * (n + 1)
        for change, sequence in zip(ends.tolist(), chosen, strict=True):
            stage = StageBounds(tuple(map(tuple, change)), None, modes, None, 3)
            shapes = shapes and stage.ends_in((rigid_mode(n), *sequence), shapes)
        bends = [(k, mode) for k, sequence in enumerate(chosen) for mode in sequence]
        rows = [[m[j] * (k <= at) for k, m in bends] or [0] for at in range(4) for j in range(n)]
        both = np.vstack([rows, np.negative(rows)]), np.append(ends[..., 1], -ends[..., 0])
        found = linprog(np.zeros(len(rows[0])), *both, bounds=(None, None)).status == 0
        assert found == (shapes is not None) if n == 2 else shapes or not found
        told.append(found)
    assert 0 < sum(told) < len(told)


BOX = {"kappa_per_m": (10.0, 10.0)}


def test_boxes_that_intersect_need_one_reshaping() -> None:
    shapes = [(30.0, 20.0), (15.0, 25.0)]
    problem = mission(*(reach(0.1 * k, 0.1, 0.5, s, tolerance=BOX) for k, s in enumerate(shapes)))
    assert blocks(check_mission(plan(problem))) == 1


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_boxes_of_shapes_need_no_more_reshapings_than_the_nearest_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = rng.uniform(-25.0, 25.0, (3, 2))
    tasks = [reach(0.1 * k, 0.1, 0.5, tuple(s), tolerance=BOX) for k, s in enumerate(shapes)]
    here, reshaped = np.zeros(2), 0
    for shape in shapes:
        nearest = np.clip(here, shape - 10.0, shape + 10.0)
        reshaped += bool(np.abs(nearest - here).max() > 0)
        here = nearest
    assert blocks(check_mission(plan(mission(*tasks)))) <= reshaped


def test_a_goal_that_may_be_met_soft_is_never_dearer() -> None:
    costs = []
    for mode in ({}, {"mode": "any"}):
        tasks = (reach(0.1, 0.1, 0.5, (30.0, -20.0), **mode), reach(0.2, 0.0, 0.1, (-10.0, 20.0)))
        costs.append(check_mission(plan(mission(*tasks))).cost.total)
    assert costs[1] < costs[0] - 30.0


def test_a_mirrored_mission_costs_the_same() -> None:
    costs = []
    for sign in (1.0, -1.0):
        start = {**START, "y_m": -0.1 * sign, "kappa_per_m": (5.0 * sign, -8.0 * sign)}
        ends = [(0.1, 0.1, 0.5, (30.0, -20.0)), (0.2, 0.0, 0.1, (-10.0, 20.0))]
        tasks = (
            reach(x, sign * y, sign * phi, tuple(sign * k for k in kappa))
            for x, y, phi, kappa in ends
        )
        made = plan(mission(*tasks, robot=bold(load_robot("2sra-v1")), start=start))
        costs.append(check_mission(made).cost.total)
    assert costs[0] == pytest.approx(costs[1], rel=0.01)  # as near as was asked of each


def test_the_order_is_chosen_where_it_is_free() -> None:
    bent = reach(0.4, 0.0, 0.0, (20.0, 20.0), name="bent", mode="any")
    straight = reach(0.1, 0.0, 0.0, (0.0, 0.0), name="straight", mode="any")
    last = {"x_m": 0.4, "y_m": 0.1, "kappa_per_m": (20.0, 20.0)}
    given, free = (
        check_mission(plan(mission(bent, straight, goal=last, order=order)))
        for order in ("given", "free")
    )
    assert [task.name for task in free.problem.tasks] == ["straight", "bent"]
    assert free.cost.total < 0.6 * given.cost.total


# --- Objects


SCENARIOS = {
    "conform-cylinder": ("conform",),
    "grasp-cube": ("grasp", "carry"),
    "pick-and-place": ("grasp", "carry", "release"),
    "three-shapes": ("reach", "reach"),
    "tidy-up": ("grasp", "carry", "release") * 2,
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_built_in_missions_are_planned_and_their_files_hold(name: str, tmp_path: Path) -> None:
    result = solved(name)
    made = check_mission(result)
    assert tuple(task.do for task in made.problem.tasks) == SCENARIOS[name]
    assert str(made) in result.message
    if name != "three-shapes":
        assert made.gap is not None
        assert made.gap <= max(0.02, made.problem.gap)
    result.save(tmp_path / "plan.json")
    check = check_plan(tmp_path / "plan.json")
    assert check.ok, check.problems
    read = check.result.require()
    assert read.trajectory.done_s == pytest.approx(made.trajectory.done_s)
    assert read.cost.total == pytest.approx(made.cost.total)


def test_what_the_built_in_missions_touch() -> None:
    held = solved("pick-and-place").require().trajectory
    closed = held.configuration(np.array([held.done_s[0]]))[0][3:]
    assert closed == pytest.approx(np.sign(closed[0]) / 0.0344 * np.ones(2), rel=0.4)
    assert np.ptp(held.configuration(np.array(held.done_s[:2]))[:, 3:], axis=0) == pytest.approx(
        0.0
    )
    laid = solved("conform-cylinder").require().trajectory
    bend = abs(laid.configuration(np.array([laid.done_s[0]]))[0][3])
    geometry, (cylinder,) = laid.problem.robot.geometry, laid.problem.objects
    assert cylinder.disc is not None
    each, length_m = 1 / (cylinder.disc.radius_m + geometry.fibre_radius_m), geometry.lengths_m[0]
    assert each - 2 * 0.001 / length_m**2 <= bend <= each


REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "too small": (GRASP, cup(0.02), "nothing closes around cup: the units would meet"),
    "not caged": (GRASP, cup(0.06), r"nothing cages cup; .* embraces \d+ degrees .* \"pushed\""),
    "too large": ({"do": "conform", "object": "cup"}, cup(0.3), "nothing conforms to cup"),
    "direction": ({**GRASP, "directions_rad": (0.1, 0.101)}, cube(), "no direction .* is left"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_cannot_be_done_is_said(why: str) -> None:
    task, thing, words = REFUSED[why]
    result = plan(mission(task, objects=[thing]))
    assert result.status is Status.INFEASIBLE
    assert result.plan is None
    assert re.search(words, result.message), result.message


def test_what_is_pushed_needs_no_cage() -> None:
    push = {**GRASP, "hold": "pushed"}
    ahead = {"do": "carry", "object": "cup", "x_m": 0.35, "y_m": 0.1}
    made = check_mission(plan(mission(push, ahead, objects=[cup(0.06, friction=0.4)])))
    assert made.sequence[-1] == RIGID


def test_segments_that_are_not_quite_alike_close_together_and_none_is_bent_alone_before() -> None:
    def closed(*kappa: float) -> Plan:
        start = {"x_m": -0.2, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": kappa}
        return check_mission(plan(mission(GRASP, start=start, objects=[cup(0.03)])))

    alike, uneven, far = closed(0.0, 0.0), closed(0.4, -0.4), closed(4.0, -4.0)
    assert uneven.sequence == alike.sequence != far.sequence
    assert uneven.duration_s == pytest.approx(alike.duration_s, rel=0.02)


def test_a_mission_goes_on_with_the_object_in_hand() -> None:
    made = solved("pick-and-place").require()
    at = np.array([made.trajectory.done_s[0]])
    x, y, phi, *kappa = made.trajectory.configuration(at)[0].tolist()
    start = {"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": kappa, "holding": "cup"}
    rest = made.problem.with_values(start=start, tasks=made.problem.tasks[1:])
    again = check_mission(plan(rest))
    assert [task.do for task in again.problem.tasks] == ["carry", "release"]
    assert again.cost.total < made.cost.total


def test_who_may_stay_near_what_it_has_let_go_of_need_not_freeze_to_drive_away() -> None:
    """Uneven bends let go of a cup by opening both at once, but come no more than 10 mm away."""
    held = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (-41.8, -34.16)}
    there = {"do": "carry", "object": "cup", "x_m": 0.2, "y_m": 0.0}
    thing = cup(0.03) | {"pose": {"x_m": 0.00935, "y_m": -0.03442}}
    let_go, start = {"do": "release", "object": "cup"}, {**held, "holding": "cup"}
    problem = mission(there, let_go, start=start, objects=[thing])
    away = problem.tasks
    near = tuple(task.kept_from(0.002) for task in away)
    assert tuple(task.kept_from(0.01) for task in near) == near
    asked = problem.with_values(modes=((0, 0), (1, 1)), clearance_m=0.02)
    plans = [plan(asked.with_values(tasks=each)).require() for each in (away, near)]
    assert [len(made.transitions) for made in plans] == [4, 2]
    assert plans[1].verification.ok


@pytest.mark.parametrize(
    ("at_m", "friction", "why"),
    [
        ((0.3, 0.2), 0.4, "it is {apart_mm:.0f} mm from touching, and no cage is proved"),
        ((0.0, 0.0345), None, "no cage is proved, and it has no friction"),
    ],
)
def test_what_is_not_held_is_not_carried(
    at_m: tuple[float, float], friction: float | None, why: str
) -> None:
    """A straight robot: the cup in the corner of a table, and the cup at its side."""
    x, y = at_m
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0), "holding": "cup"}
    task = {"do": "carry", "object": "cup", "x_m": 0.5, "y_m": 0.3}
    things = [cup(0.03, friction=friction) | {"pose": {"x_m": x, "y_m": y}}]
    body = drawn(load_robot("2sra-v1").geometry, np.zeros(5))
    why = why.format(apart_mm=1e3 * (body.distance(shapely.Point(x, y)) - 0.03))
    with pytest.raises(InputError, match=why) as caught:
        plan(mission(task, start=start, objects=things))
    assert caught.value.field == "start.holding"


def test_any_heading_at_a_disc_is_near_one_that_bounds_look_at() -> None:
    problem = mission(GRASP, objects=[cup()])
    (variant, *_) = ways_of(problem).variants
    stage = variant.members[0][0]
    assert stage.ends is not None
    middle, (x, y, phi) = np.array([0.25, 0.1]), stage.ends[0]
    for more in np.random.default_rng(3).uniform(-math.pi, math.pi, 200):
        turn = np.array([[math.cos(more), -math.sin(more)], [math.sin(more), math.cos(more)]])
        place = middle + turn @ (np.array([x, y]) - middle)
        assert np.linalg.norm(stage.ends[:, :2] - place, axis=1).min() <= stage.within_m
        low, high = stage.box(np.zeros(5))
        assert (low[:2] <= place).all()
        assert (place <= high[:2]).all()
    assert phi in stage.ends[:, 2]


def test_bounds_hold_for_all_members_of_a_variant() -> None:
    problem = mission(GRASP, objects=[cube()])
    for variant in ways_of(problem).variants:
        (all_of_them,) = stage_bounds(variant)[:1]
        for member in variant.members:
            (alone,) = stage_bounds(Variant(variant.problem, (member,), (member,)))[:1]
            assert all_of_them.distance_m <= alone.distance_m + ROUNDING


def test_a_mission_whose_ways_are_not_all_known_in_time_has_no_bound() -> None:
    goals = [reach(0.2, 0.1 * k, 0.5, (30.0, -5.0), name=f"goal {k}") for k in range(4)]
    result = plan(mission(*goals, order="free", work_limit=1e-9))
    assert result.status is Status.FAILED
    assert result.lower_bound is None
    assert "a limit was reached): raise work_limit" in result.message


@pytest.mark.parametrize("off", [(9e-7, 0.0), (0.0, 1.5e-6)])
def test_goals_of_missions_may_be_missed_by_the_tolerance_and_bounds_know(
    off: tuple[float, float],
) -> None:
    """One shape serves goals that differ by less than what both may be missed by."""

    def asked(first: float, second: float) -> Problem:
        start = {**START, "kappa_per_m": (30.0 + sum(off) / 2, -5.0)}
        goals = [
            reach(0.1 * k, 0.1, 0.0, (30.0 + by, -5.0), tolerance="exact")
            for k, by in enumerate((first, second))
        ]
        return mission(*goals, robot="2sra-v1-paper", start=start)

    midway = sum(off) / 2
    one_shape, problem = plan(asked(midway, midway)).require(), asked(*off)
    trajectory = replace(one_shape.trajectory, problem=problem)
    assert verify(trajectory).ok
    bound = plan(problem).lower_bound
    assert bound is not None
    assert bound <= one_shape.cost.total
