"""Plans among obstacles: found, verified, bounded; proved impossible only where they are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from once import planned, solution, solved
from problems import at, bold, goal_tree, only_goal
from worlds import random_world

import twosra_mpc.planning.planner as planner
from benchmarks.studies.passages import decide_between
from twosra_mpc import InputError, Problem, Result, Status, load_robot, plan
from twosra_mpc.checking.clearance import check_obstacles
from twosra_mpc.checking.verification import verify
from twosra_mpc.effort import Ending
from twosra_mpc.model.flow import roll_out
from twosra_mpc.planning.solver import placer
from twosra_mpc.planning.solver.block import Sweep, block
from twosra_mpc.planning.solver.placer import Placer
from twosra_mpc.planning.solver.sequence_solver import checked
from twosra_mpc.planning.solver.stations import HIDDEN_S, Stations, chains
from twosra_mpc.planning.stages.necessity import Necessity
from twosra_mpc.problem.ends import check_shapes, check_workspace
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import blocks_of, is_rigid, soft_runs
from twosra_mpc.space.drives import Drives
from twosra_mpc.space.footprint import footprint
from twosra_mpc.space.separation import placed

ROBOT = load_robot("2sra-v1")
LEFT = {"x_m": -0.42, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
RIGHT = {**LEFT, "x_m": 0.42}
POST = {"disc": {"x_m": 0.0, "y_m": 0.0, "radius_m": 0.05}}
FAR = {"disc": {"x_m": 3.0, "y_m": 3.0, "radius_m": 0.05}}


def problem(*obstacles: dict[str, Any], **overrides: Any) -> Problem:
    base = {"robot": ROBOT, "start": LEFT, "goal": RIGHT, "obstacles": list(obstacles)}
    return Problem(**{**base, **overrides})


def random_problem(seed: int, robot: Robot = ROBOT) -> Problem:
    """Random ends in a random world, neither of them in an obstacle."""
    world, count = random_world(seed), robot.coordinates.segments
    for attempt in itertools.count():
        rng = np.random.default_rng([seed, attempt])
        ends = [
            {**dict(zip(("x_m", "y_m", "phi_rad"), pose.tolist(), strict=True)), "kappa_per_m": k}
            for pose, k in (
                (rng.uniform([-0.45, -0.45, -3], [0.45, 0.45, 3]), rng.uniform(-30, 30, count))
                for _ in range(2)
            )
        ]
        try:
            made = Problem(**{**dict(world), "robot": robot, "start": ends[0], "goal": ends[1]})
            check_shapes(made)
            check_workspace(made)
            check_obstacles(made)
        except InputError:
            continue
        return made
    raise AssertionError


def blocks(result: Result) -> int:
    return blocks_of(tuple(phase.mode for phase in result.require().phases))


@pytest.mark.parametrize("seed", range(2))
def test_random_scenes_are_planned_verified_and_bounded(seed: int) -> None:
    result = solution(random_problem(seed))
    made = result.require()
    assert result.lower_bound is not None
    assert verify(made.trajectory).ok
    assert 0 < result.lower_bound <= made.cost.total
    with_nothing = result.problem.with_values(obstacles=(), workspace=None)
    free = plan(with_nothing)
    assert free.lower_bound is not None
    assert made.cost.total >= free.lower_bound
    necessity = Necessity(result.problem)
    for step in necessity._left[:2]:
        step()
    assert necessity.impossible is None
    assert necessity.needed <= blocks(result)


def test_the_bound_among_obstacles_is_no_lower_than_without() -> None:
    result = solution(random_problem(1))
    free = plan(
        result.problem.with_values(obstacles=(), workspace=None, gap=0.0, work_limit=5000.0)
    )
    assert result.require().cost.total >= (1 - 1e-6) * (free.lower_bound or 0.0)


def test_a_mirrored_scene_has_a_mirrored_plan() -> None:
    post = {"disc": {"x_m": 0.0, "y_m": 0.06, "radius_m": 0.05}}
    ends = ({**LEFT, "phi_rad": 0.4}, {**RIGHT, "phi_rad": -0.3, "kappa_per_m": [10.0, -5.0]})

    def mirrored(end: dict[str, Any]) -> dict[str, Any]:
        bends = [-kappa for kappa in end["kappa_per_m"]]
        return {**end, "y_m": -end["y_m"], "phi_rad": -end["phi_rad"], "kappa_per_m": bends}

    other = {"disc": {**post["disc"], "y_m": -0.06}}
    robot = bold(ROBOT)  # levers tell left from right
    one = plan(problem(post, robot=robot, start=ends[0], goal=ends[1]))
    two = plan(problem(other, robot=robot, start=mirrored(ends[0]), goal=mirrored(ends[1])))
    assert one.status == two.status
    # wheels of the two units sit on opposite sides, so mirrored drives take other times
    assert two.require().cost.total == pytest.approx(one.require().cost.total, rel=0.02)


@pytest.mark.parametrize("bends", [[0.0, 0.0], [20.0, 0.0]])
def test_obstacles_that_are_not_in_the_way_cost_nothing(bends: list[float]) -> None:
    """Nor does a wall beside the robot's way, rough by 0.2 mm as scanners give them."""
    goal = {**RIGHT, "kappa_per_m": bends}
    free = solution(problem(goal=goal)).require()
    q = free.trajectory.samples.q
    passed = (placed(footprint(ROBOT.geometry, each[POSE:]).outer, each[None, :POSE]) for each in q)
    top = max(float(pieces[..., 1].max()) for pieces in passed) + 0.01
    rough = top + 2e-4 * np.random.default_rng(0).uniform(size=400)
    corners = [*np.column_stack([np.linspace(0.6, -0.6, 400), rough]).tolist()]
    wall = {"polygon_m": [[-0.6, top + 0.1], [0.6, top + 0.1], *corners]}
    found = solution(problem(FAR, wall, goal=goal))
    assert found.require().cost.total == pytest.approx(free.cost.total, rel=1e-6)
    assert found.lower_bound == pytest.approx(free.lower_bound, rel=0.01)


def test_a_drive_around_a_post_is_longer_than_through_it() -> None:
    made, free = solution(problem(POST)), solution(problem()).require()
    assert blocks(made) == 0
    assert free.cost.total < made.require().cost.total < 60


def test_more_obstacles_never_make_it_proved_cheaper() -> None:
    few, many = (solution(problem(*some)) for some in ([FAR], [FAR, POST]))
    assert (many.lower_bound or 0) >= (few.lower_bound or 0) - 1e-9
    assert many.require().cost.total >= (few.lower_bound or 0)


def test_a_corridor_too_narrow_for_its_shape_takes_two_reshapings() -> None:
    made = solved("corridor", gap=0.1)
    assert blocks(made) == 2
    assert made.require().verification.ok
    necessity = Necessity(made.problem)
    sequences = [((0, 0),), ((0, 0), (1, 1), (0, 0)), ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))]
    assert all(necessity.proves_impossible(sequence) for sequence in sequences)
    assert "soft_travel_m" in necessity.words
    assert not necessity.proves_impossible(((0, 0), (1, 1), (0, 0), (1, 1), (0, 0)))


def test_a_blocked_way_is_proved_with_its_reason() -> None:
    result = solved("blocked")
    assert result.status is Status.INFEASIBLE
    assert result.plan is None
    assert "locomotion unit" in result.message
    assert "whatever the robot's shape" in result.message


ROOM = {"x_m": [-0.8, 0.8], "y_m": [-0.5, 0.5]}
NARROW = [  # a gap that the units pass, and the robot straight across it does not
    {"box": {"x_m": [-0.18, 0.18], "y_m": [0.045, 0.5]}},
    {"box": {"x_m": [-0.18, 0.18], "y_m": [-0.5, -0.045]}},
]


def test_a_drive_that_is_blocked_is_infeasible_where_nothing_may_melt() -> None:
    bent = [30.0, 30.0]
    ends = {"start": {**LEFT, "kappa_per_m": bent}, "goal": {**RIGHT, "kappa_per_m": bent}}
    result = plan(problem(*NARROW, workspace=ROOM, modes=[[0, 0]], **ends))
    assert result.status is Status.INFEASIBLE
    assert "proved" in result.message


def test_a_goal_box_too_wide_to_prove_anything_is_no_trouble() -> None:
    """Nothing is left of the robot once it is shrunk by all that its box of shapes leaves open."""
    bent, wide = [18.0, 18.0], {"kappa_per_m": [2.9, 2.9]}
    ends = {"start": {**LEFT, "kappa_per_m": bent}}
    goal = {**RIGHT, "kappa_per_m": bent, "tolerance": wide}
    made = problem(*NARROW, robot="2sr-v2", workspace=ROOM, goal=goal, **ends)
    necessity = Necessity(made)
    assert not necessity.proves_impossible(((0, 0), (1, 1), (0, 0)))
    assert necessity.needed <= 1


def test_what_is_not_proved_failed_with_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    """A superset that decides nothing: the same scene, and it is never called infeasible."""
    monkeypatch.setattr(Necessity, "proves_impossible", lambda self, sequence: False)
    bent = [30.0, 30.0]
    ends = {"start": {**LEFT, "kappa_per_m": bent}, "goal": {**RIGHT, "kappa_per_m": bent}}
    result = plan(problem(*NARROW, workspace=ROOM, modes=[[0, 0]], **ends))
    assert result.status is Status.FAILED
    assert "among the obstacles" in result.message
    assert "allow more modes" in result.message


FREE_GOALS: list[dict[str, Any]] = [
    {key: value for key, value in RIGHT.items() if key != "phi_rad"},
    {key: value for key, value in RIGHT.items() if key != "x_m"} | {"y_m": 0.3},
    {"x_m": 0.42, "kappa_per_m": [15.0, 0.0]},
    {"kappa_per_m": [20.0, -10.0]},
    {"x_m": 0.42, "y_m": 0.0},
    {**RIGHT, "kappa_per_m": [20.0, 0.0], "mode": [1, 0]},
    {**RIGHT, "kappa_per_m": [10.0, 10.0], "tolerance": {"x_m": 0.02, "kappa_per_m": [2.0, 2.0]}},
    {**RIGHT, "phi_rad": 2 * math.pi},
]


@pytest.mark.parametrize("goal", FREE_GOALS, ids=str)
def test_goals_that_leave_something_free_are_reached(goal: dict[str, Any]) -> None:
    result = plan(problem(POST, goal=goal, gap=0.3))
    made = result.require()
    assert np.abs(result.problem.goal.error(made.trajectory.samples.q[-1])).max() < 1e-6
    assert verify(made.trajectory).ok


def test_a_soft_start_is_reshaped_where_it_is() -> None:
    start = {**LEFT, "temperature_C": [70.0, 70.0]}
    assert problem(start=start).start_mode == (1, 1)
    soft = problem(POST, start=start, goal={**RIGHT, "kappa_per_m": [20.0, 5.0]}, gap=0.05)
    made = plan(soft).require()
    assert made.verification.ok


def test_soft_travel_is_respected() -> None:
    made = solution(random_problem(1)).require()
    q, phases = made.trajectory, made.phases
    runs = soft_runs(tuple(phase.mode for phase in phases))
    assert runs
    for run in runs:
        begin = q.configuration(np.array([phases[run[0]].start_s]))[0]
        end = q.configuration(np.array([phases[run[-1]].end_s]))[0]
        assert np.hypot(*(end - begin)[:2]) <= ROBOT.limits.soft_travel_m + 1e-9


SHARES = [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)]


@pytest.mark.parametrize("shares", SHARES)
@pytest.mark.parametrize("name", ["2sra-v1", "2sr-v2", "3sra"])
def test_a_block_is_where_its_inputs_lead(name: str, shares: tuple[float, float]) -> None:
    robot = load_robot(name)
    count = robot.coordinates.segments
    shape = np.linspace(-5.0, 8.0, count)
    modes = ((1,) + (0,) * (count - 1), (1,) * count)
    bends = [0.3, -0.2]
    made = block(robot, shape, modes, bends, shares)
    begin = np.array([0.2, -0.1, 0.7, *shape])
    states = roll_out(robot, begin, modes, made.inputs).states
    end = states.reshape(-1, POSE + count)[-1]
    c, s = math.cos(0.7), math.sin(0.7)
    x, y, turn = made.displacement
    assert end[:POSE] == pytest.approx([0.2 + c * x - s * y, -0.1 + s * x + c * y, 0.7 + turn])
    assert end[POSE:] == pytest.approx(made.shape)


def test_a_sweep_that_is_clear_is_clear_at_every_shape() -> None:
    world = random_world(4)
    made = block(ROBOT, np.zeros(2), [(1, 0), (1, 1)], [0.6, 0.4], (1.0, 1.0))
    sweep = Sweep(made, ROBOT, world)
    rng = np.random.default_rng(0)
    at = rng.uniform([-0.6, -0.6, -3], [0.6, 0.6, 3], (200, 3))
    may = sweep.may_be_clear(at)
    clear = np.array([sweep.clear(pose) for pose in at])
    assert clear.any()
    assert not (clear & ~may).any()
    for pose in at[clear][:20]:
        corners = placed(sweep._pieces, np.tile(pose, (len(sweep._pieces), 1)))
        assert (sweep._around.distances(corners) >= sweep._around.kept_m).all()


class Line:
    """Drives along straight lines, some of them blocked, some longer than they seem."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._key = int(rng.integers(1 << 30))

    def _share(self, start: Array, goal: Array) -> float:
        where = np.abs(np.concatenate([start, goal]) * 1e6).astype(int).tolist()
        return float(np.random.default_rng([self._key, *where]).random())

    def leg_times_s(self, start: Array, end: Array) -> Array:
        found: Array = np.linalg.norm(end - start, axis=-1)
        return found

    def best(self, start: Array, goal: Array) -> Array | None:
        share = self._share(start, goal)
        if share < 0.3:
            return None
        if share < 0.6:
            return np.array([start, (start + goal) / 2 + [0, 4 * share, 0], goal])
        return np.array([start, goal])

    def time_s(self, poses: Array) -> float:
        return float(self.leg_times_s(poses[:-1], poses[1:]).sum())

    def estimates_s(self, pose: Array, others: Array) -> Array:
        return self.leg_times_s(np.broadcast_to(pose, others.shape), others)

    def apart(self, start: Array, goal: Array) -> Any:
        return np.zeros((len(start), len(goal)), dtype=bool)


class Straight(Line):
    """Drives of which none is blocked or longer than it seems."""

    def best(self, start: Array, goal: Array) -> Array | None:
        return np.array([start, goal])


def cheapest(
    start: Array, goals: Any, layers: list[Stations], clear: Any, drivers: Any, hidden: Any
) -> float:
    """Least cost over every combination of stations."""
    best = math.inf
    for path in itertools.product(*(range(len(layer.begin)) for layer in layers)):
        if not all(clear(k, layers[k].begin[i]) for k, i in enumerate(path)):
            continue
        leave = [start, *(layers[k].end[i] for k, i in enumerate(path))]
        arrive = [*(layers[k].begin[i] for k, i in enumerate(path)), goals(leave[-1])]
        cost = 0.0
        for driver, here, there, free in zip(drivers, leave, arrive, hidden, strict=True):
            route = driver.best(here, there)
            cost += math.inf if route is None else max(0.0, driver.time_s(route) - free)
        best = min(best, cost)
    return best


@pytest.mark.parametrize("seed", range(6))
def test_the_lazy_search_finds_the_best_of_all_combinations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = 1 + seed % 3
    layers = [Stations(rng.normal(size=(5, 3)), rng.normal(size=(5, 3))) for _ in range(depth)]
    dirty = {(k, i) for k in range(depth) for i in range(5) if rng.random() < 0.3}
    drivers, hidden = [Line(rng) for _ in range(depth + 1)], [0.4 * (seed % 2)] * (depth + 1)
    start, goal = rng.normal(size=3), rng.normal(size=3)

    def clear(k: int, pose: Array) -> bool:
        return (k, int(np.abs(layers[k].begin - pose).sum(axis=1).argmin())) not in dirty

    def goals(ends: Array) -> Array:
        """Of each end its own, as in a box; on the way to one roads tell of others."""
        return goal + np.sin(3 * ends)

    least = cheapest(start, goals, layers, clear, drivers, hidden)
    shorter = list(chains(start, goals, layers, clear, drivers, hidden, 5000, 500))
    costs = [chain.cost_s for chain in shorter]
    assert costs == sorted(costs, reverse=True)
    assert (not shorter) == math.isinf(least)
    for found in shorter[-1:]:
        assert len(found.begins) == depth
        assert len(found.routes) == depth + 1
        longer = sum(
            max(0.0, driver.time_s(route) - free)
            for driver, route, free in zip(drivers, found.routes, hidden, strict=True)
        )
        assert found.cost_s == pytest.approx(longer, abs=HIDDEN_S)
        assert found.cost_s == pytest.approx(least, abs=HIDDEN_S)


@pytest.mark.parametrize("seed", range(6))
def test_of_chains_that_cost_nothing_the_shortest_is_taken(seed: int) -> None:
    """While metal melts, all of these drives cost nothing: no detour is driven all the same."""
    rng = np.random.default_rng(seed)
    layers = [Stations(ends := rng.normal(size=(8, 3)), ends) for _ in range(1 + seed % 2)]
    drivers, hidden = [Straight(rng)] * (len(layers) + 1), [1e3] * (len(layers) + 1)
    start, goal = rng.normal(size=(2, 3))

    def length_s(stations: Sequence[Array]) -> float:
        places = np.array([start, *stations, goal])
        return float(drivers[0].leg_times_s(places[:-1], places[1:]).sum())

    *_, found = chains(
        start,
        lambda ends: np.tile(goal, (len(ends), 1)),
        layers,
        lambda k, pose: True,
        drivers,
        hidden,
        5000,
        500,
    )
    ways = itertools.product(*(layer.begin for layer in layers))
    assert found.cost_s < HIDDEN_S
    assert length_s(found.begins) == pytest.approx(min(map(length_s, ways)))


def test_a_robot_that_conforms_drives_there_straight_on() -> None:
    """Its segment melts for longer than any way there takes; it went to and fro."""
    made = planned("conform-cylinder")
    drive = made.phases[0]
    assert is_rigid(drive.mode)
    q = made.trajectory.at(np.linspace(drive.start_s, drive.end_s, 400)).q
    length_m = float(np.hypot(*np.diff(q[:, :2], axis=0).T).sum())
    assert length_m < 1.1 * float(np.hypot(*(q[-1] - q[0])[:2]))


def test_an_interrupt_returns_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the first plan that is found."""
    seen: list[tuple[float, Any]] = []

    def interrupted(*args: Any) -> Any:
        if seen:
            raise KeyboardInterrupt
        made = checked(*args)
        if made is not None:
            seen.append(made)
        return made

    monkeypatch.setattr(placer, "checked", interrupted)
    goal = {**RIGHT, "kappa_per_m": [20.0, -10.0]}
    result = planner.plan_until_interrupted(problem(POST, goal=goal, gap=0.0))
    assert result.ending is Ending.INTERRUPTED
    assert result.require().cost.total == seen[0][0]


# --- bounds of leaves, before the search cuts them at the incumbent ------------------------------


@pytest.mark.parametrize(("walls", "far_m"), [("wall", 0.45), ("post", 2.0), ("task", 3.5)])
def test_no_leaf_is_bounded_above_its_own_plan(walls: str, far_m: float) -> None:
    """Also beyond the box at which slices end where there is no workspace."""
    goal = {"x_m": far_m, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [20.0, 0.0]}
    given: dict[str, Any] = {
        "post": {"obstacles": [{"disc": {"x_m": -0.42, "y_m": 0.4, "radius_m": 0.03}}]},
        "wall": {"obstacles": [{"box": {"x_m": [0.0, 0.05], "y_m": [-0.3, 0.3]}}]},
        "task": {"tasks": [{"do": "pass", "x_m": [0.0, 0.1]}]},
    }[walls]
    base = Problem(robot=ROBOT, start=LEFT, goal=goal, motion="fastest", gap=0.05, **given)
    made = plan(base).require()
    placer = Placer([only_goal(base)])
    tree = goal_tree(base, placer, placer.in_the_way)
    modes = [phase.mode for phase in made.phases]
    node = at(tuple(modes[:-1] if modes[-1] == (0, 0) else modes))
    assert tree.leaf_bound(node) <= made.cost.total
    assert tree.tighter_bound(node, math.inf) <= made.cost.total
    ((necessity,),) = placer.in_the_way
    assert isinstance(necessity, Necessity)
    assert blocks_of(tuple(modes)) >= necessity.needed


def test_a_start_that_is_too_near_gets_away_and_keeps_out() -> None:
    wall = {"box": {"x_m": [-0.6, -0.2], "y_m": [0.012, 0.05]}}
    ends = {**LEFT, "y_m": -0.032}
    near = problem(wall, start=ends, goal={**ends, "y_m": -0.2}, clearance_m=0.01, modes=[[0, 0]])
    made = plan(near).require()
    assert made.verification.limits["clearance_m"] >= 0
    boxes = [(end, end) for end in (near.start.configuration[:POSE], np.array([-0.42, -0.2, 0.0]))]
    drives = Drives(ROBOT, near.world, near.start.configuration[POSE:])
    assert decide_between(drives, *boxes) != "blocked"


def shelf_above_goal(gap_m: float, **goal: Any) -> Problem:
    top = float(footprint(ROBOT.geometry, [0.0, 0.0]).outer[..., 1].max())
    shelf = {"name": "shelf", "box": {"x_m": [0.2, 0.7], "y_m": [top + gap_m, 0.3]}}
    return problem(shelf, goal={**RIGHT, **goal}, clearance_m=0.002)


def test_a_goal_that_is_too_near_is_refused_at_once_and_one_with_a_clear_member_is_met() -> None:
    with pytest.raises(InputError, match=r"shelf is 1\.91 mm away, 0\.09 mm too near"):
        plan(shelf_above_goal(1.91e-3, tolerance="exact"))
    made = plan(shelf_above_goal(1.91e-3)).require()  # members up to 1 mm farther
    assert made.verification.ok
    assert made.samples.q[-1, 1] < 0.0


@pytest.mark.parametrize("gap_m", [0.003, 0.012])
def test_a_start_near_one_obstacle_keeps_the_clearance_from_the_others(gap_m: float) -> None:
    """A wall is 1 mm behind the start, a post above the straight way to the goal."""
    outer = footprint(ROBOT.geometry, [0.0, 0.0]).outer
    left, top = float(outer[..., 0].min()) + LEFT["x_m"], float(outer[..., 1].max())
    wall = {"name": "wall", "box": {"x_m": [left - 0.1, left - 1e-3], "y_m": [-0.5, 0.5]}}
    post = {"name": "post", "box": {"x_m": [-0.1, 0.1], "y_m": [top + gap_m, 0.5]}}
    goal = {**RIGHT, "tolerance": "exact"}
    tight = problem(wall, post, goal=goal, modes=[[0, 0]], clearance_m=0.01, gap=0.3)
    straight = plan(tight.with_values(clearance_m=0.0009)).require()
    told = verify(replace(straight.trajectory, problem=tight)).problems
    drives = Drives(ROBOT, tight.world, np.zeros(2))
    ends = np.array([tight.start.configuration[:POSE], tight.goal.configuration[:POSE]])
    assert drives.proof(ends[0], ends[-1])(ends[:-1], ends[1:]).all() == (gap_m > 0.01)
    if gap_m > 0.01:
        assert told == ()
    else:
        assert told[0].startswith("comes within 3 mm of post")
        made = plan(tight)
        assert made.plan is None or made.plan.verification.ok


def test_three_blocks_are_placed_as_well() -> None:
    """Of one sequence, asked for by itself: no scene here needs three."""
    between = problem(POST, start={**LEFT, "y_m": 0.2}, goal={**RIGHT, "kappa_per_m": [20.0, 15.0]})
    sequence = ((0, 0), (1, 0), (0, 0), (0, 1), (0, 0), (1, 0), (0, 0))
    placer = Placer([only_goal(between)])
    tree = goal_tree(between, placer, placer.in_the_way)
    node = at(sequence[:-1])
    bound = tree.leaf_bound(node)
    made = next(found for found in tree.solve(node) if found is not None)
    cost, solution = made
    assert solution.plan.sequence[:6] == sequence[:6]
    assert blocks_of(solution.plan.sequence) == 3
    assert solution.plan.verification.ok
    assert bound <= cost
