"""Nothing near a threshold jumps: rounding in an input changes no verdict and no cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from problems import random_problem
from thermal_problems import V2, thermal_problem

from twosra_mpc import Goal, InputError, Problem, load_problem, plan
from twosra_mpc.lab.worlds.occupancy_map import read_map
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.limits import (
    body_gaps_m,
    broken_by_shapes,
    may_drive_in,
    shape_margins,
    workspace_margins,
)
from twosra_mpc.problem.tolerances import ROUNDING_M, UNSEEN_M, kept_from_m
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import RIGID, Mode, all_modes
from twosra_mpc.timing import transition_model

ROBOT = load_problem("paper-1").robot
LIMITED = ROBOT.with_values(limits=ROBOT.limits.with_values(curvature_per_m=40.0))
AT_REST = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
CURLED = np.array([-0.65, -0.76])  # units meet if it bends far enough like this
AT_GOAL = np.array([0.2, 0.0, 0.0, 0.0, 0.0])
SAME_S = 0.01  # the way to the edge of a goal instead of to its middle


def nearly(x: float) -> list[float]:
    """A number, and what rounding makes of it."""
    return [x, math.nextafter(x, math.inf), x - 1e-12, x + 1e-9]


def touching() -> float:
    """How far the robot must curl up for its parts to touch, between both edges of rounding."""
    edges = []
    for free in (np.greater, np.greater_equal):
        low, high = 0.0, 100.0
        for _ in range(80):
            middle = (low + high) / 2
            apart = free(body_gaps_m(ROBOT, [CURLED * middle])[0], 0.0)
            low, high = (middle, high) if apart else (low, middle)
        edges.append(low)
    return sum(edges) / 2


def past_a_wall(y_m: float, clearance_m: float) -> Problem:
    """A drive of 0.3 m along a wall."""
    wall = {"polygon_m": [[0.1, y_m], [0.6, y_m], [0.6, 0.2], [0.1, 0.2]]}
    goal = {**AT_REST, "x_m": 0.3}
    given = {"obstacles": [wall], "clearance_m": clearance_m, "gap": 0.05}
    return Problem(robot=ROBOT, start=AT_REST, goal=goal, **given)


def bent(kappa: tuple[float, ...], half_width_per_m: float = 0.0) -> Problem:
    """A change of shape alone."""
    tolerance = {"kappa_per_m": (half_width_per_m,) * 2}
    goal = {"kappa_per_m": kappa, "tolerance": tolerance}
    return Problem(robot=ROBOT, start=AT_REST, goal=goal)


def driven(kappa: tuple[float, ...]) -> Problem:
    """A drive in a shape."""
    start = {**AT_REST, "kappa_per_m": kappa}
    return Problem(robot=ROBOT, start=start, goal={"x_m": 0.1, "y_m": 0.0}, gap=0.1)


def limited(start: float, goal: float) -> Problem:
    """A change of shape of a robot that bends little."""
    here = {**AT_REST, "kappa_per_m": (start, 0.0)}
    there = {"kappa_per_m": (goal, 0.0), "tolerance": "exact"}
    return Problem(robot=LIMITED, start=here, goal=there)


def steered(least: float) -> Problem:
    """A drive in a bent shape, with wheels that must be so independent."""
    problem = driven((30.0, 20.0))
    limits = ROBOT.limits.with_values(wheel_independence=least)
    return problem.with_values(robot=ROBOT.with_values(limits=limits))


def molten(share: float, warm_C: float | None = None) -> Problem:
    """A change of shape with one heater, of metal that is molten so far, or so warm."""
    metal = {"melt_fraction": (share, 0.0)} if warm_C is None else {"temperature_C": (warm_C, 23.0)}
    given = {"goal": {"kappa_per_m": (10.0, -15.0)}, "heaters_at_once": 1, "work_limit": 1000}
    return Problem(robot=V2, start={**AT_REST, **metal}, **given)


def through(width_m: float, clearance_m: float = 0.002) -> Problem:
    """A drive of 0.5 m straight through a doorway."""
    walls = [
        {"box": {"x_m": (0.2, 0.3), "y_m": (width_m / 2, 0.5)}},
        {"box": {"x_m": (0.2, 0.3), "y_m": (-0.5, -width_m / 2)}},
    ]
    goal = {**AT_REST, "x_m": 0.5}
    given = {"obstacles": walls, "clearance_m": clearance_m, "gap": 0.05}
    return Problem(robot=ROBOT, start=AT_REST, goal=goal, **given)


def up_to(edge_m: float) -> Problem:
    """A drive to a goal beside the right edge of a workspace."""
    workspace = {"x_m": (-1.0, edge_m), "y_m": (-1.0, 1.0)}
    goal = {**AT_REST, "x_m": 0.2}
    return Problem(robot=ROBOT, start=AT_REST, goal=goal, workspace=workspace, gap=0.1)


def touched_m(q: Array) -> float:
    """Where the right edge of a workspace touches a configuration (5,)."""
    return 1.0 - float(workspace_margins(up_to(1.0), q[None])[0])


TOUCHING, MOST = touching(), LIMITED.limits.curvature_per_m
INDEPENDENT = float(shape_margins(steered(0.0).robot, (30.0, 20.0))["wheel_independence"][0])
THRESHOLDS: dict[str, tuple[float, Callable[[float], Problem]]] = {
    "wall": (0.021 + 0.015 + 0.002, lambda x: past_a_wall(x, 0.002)),
    "clearance": (0.002, lambda x: past_a_wall(0.038, x)),
    "goal that touches": (TOUCHING, lambda x: bent(tuple(CURLED * x))),
    "goal whose corner touches": (0.5, lambda x: bent(tuple(CURLED * TOUCHING - 0.5), x)),
    "start that touches": (TOUCHING, lambda x: driven(tuple(CURLED * x))),
    "goal at the limit": (MOST, lambda x: limited(0.0, x)),
    "start at the limit": (MOST, lambda x: limited(x, 0.0)),
    "wheels as independent as must be": (INDEPENDENT, steered),
    "all but liquid": (1.0, lambda x: molten(min(x, 2.0 - x))),
    "as warm as liquid metal": (molten(1.0).stiffness_thresholds_C[1], lambda x: molten(0.0, x)),
    "as warm as may be": (V2.heater.temperature_max_C, lambda x: molten(0.0, x)),
    "doorway as wide as the robot": (2 * (0.021 + 0.015 + 0.002), through),
    "clearance in a doorway": (0.002, lambda x: through(2 * (0.021 + 0.015 + 0.002), x)),
}


def outcome(problem: Callable[[], Problem]) -> tuple[str, float]:
    """The verdict, and the cost if there is a plan."""
    try:
        made = plan(problem())
    except InputError as error:
        return str(error), 0.0
    return made.status.value, made.plan.cost.total if made.plan else 0.0


def alike(problems: Iterable[Callable[[], Problem]]) -> set[str]:
    """Verdicts of problems, which cost the same."""
    verdicts, costs = zip(*map(outcome, problems), strict=True)
    assert np.ptp(costs) <= SAME_S
    return set(verdicts)


@pytest.mark.parametrize("name", THRESHOLDS)
def test_rounding_changes_neither_verdict_nor_cost(name: str) -> None:
    at, problem = THRESHOLDS[name]
    assert alike(partial(problem, x) for x in nearly(at)) in ({"optimal"}, {"feasible"})


def reaching(problem: Problem, half_width: float, **ends: object) -> Problem:
    """The problem with other ends of its goal, and these half-widths of curvatures."""
    widths = {"kappa_per_m": (half_width, half_width)}
    goal = {"x_m": None, "y_m": None, "phi_rad": None, "tolerance": widths, **ends}
    return problem.with_values(goal=Goal(**goal))


def bent_a_little(problem: Problem, x: float) -> Problem:
    first, second = problem.start.kappa_per_m
    return reaching(problem, 0.0, kappa_per_m=(first - math.copysign(x, first), second))


def test_a_doorway_closes_where_the_robot_is_wider_and_nowhere_else() -> None:
    """The one jump there is: beyond rounding the way on no longer is straight, so it has stops."""
    width_m = 2 * (0.021 + 0.015 + 0.002)
    widths = [width_m + by * ROUNDING_M for by in (-2.5, -1.9, 0.0, 1000.0)]
    status, costs = zip(*(outcome(lambda w=w: through(w)) for w in widths), strict=True)
    assert set(status) <= {"optimal", "feasible"}
    assert costs[0] > costs[1] + 0.1
    assert np.ptp(costs[1:]) <= SAME_S


@pytest.mark.parametrize("out_m", [1e-12, 1e-9, 1e-6, 1e-4, 3e-4])
def test_a_goal_whose_middle_is_out_is_met_where_it_is_not(out_m: float) -> None:
    """The last drive is shorter by as much, and no slower: no other way is taken."""
    at = touched_m(AT_GOAL)
    (_, beside), (_, to_middle) = (outcome(lambda by=by: up_to(at - by)) for by in (out_m, 0.0))
    slowest_m_s = 0.04
    assert 0.0 <= to_middle - beside <= out_m / slowest_m_s + 1e-9


def touching_with_its_fibre(seed: int) -> Array:
    """A configuration (5,) in which only a segment reaches that far to the right."""
    rng = np.random.default_rng(seed)
    while True:
        q = np.array([0.5, 0.0, rng.uniform(-np.pi, np.pi), *rng.uniform(-62.0, 62.0, 2)])
        rigid = robot_shape(ROBOT.geometry, q, 2)
        allowed = broken_by_shapes(ROBOT, q[POSE:]) is None and may_drive_in(ROBOT, q[POSE:]).all()
        parts = [rigid.units, rigid.wheels, rigid.links + ROBOT.geometry.fibre_radius_m]
        if allowed and touched_m(q) > max(part[..., 0].max() for part in parts) + 1e-4:
            return q


def beside(at_m: float, q: Array, what: str, *, leaves: bool) -> Problem:
    """A drive to or from a configuration at an edge, or at the clearance from a wall."""
    x, y, phi, *kappa = q.tolist()
    here = {"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": kappa}
    there = {**here, "x_m": 0.25, "phi_rad": phi + 1.0}
    start, goal = (here, there) if leaves else (there, {**here, "tolerance": "exact"})
    wall = {"box": {"x_m": (at_m + 0.002, at_m + 0.1), "y_m": (-0.5, 0.5)}}
    post = {"box": {"x_m": (0.2, 0.4), "y_m": (0.4, 0.5)}}
    given = {"robot": ROBOT, "start": start, "goal": goal, "gap": 0.3, "work_limit": 2000.0}
    if what == "wall":
        return Problem(**given, obstacles=[wall], clearance_m=0.002)
    edges = {"x_m": (-1.0, at_m), "y_m": (-1.0, 1.0)}
    return Problem(**given, workspace=edges, obstacles=[post] if what == "edge" else [])


@given(st.integers(0, 10_000), st.sampled_from(["edge alone", "edge", "wall"]), st.booleans())
@settings(max_examples=6)
def test_an_end_that_touches_with_its_fibre_is_driven_to_and_from(
    seed: int, what: str, leaves: bool
) -> None:
    """Chords hold more than the fibre: what an end lacks of the clearance for it is lent."""
    q = touching_with_its_fibre(seed)
    places = [*nearly(touched_m(q)), touched_m(q) + 1e-7]
    problems = (partial(beside, x, q, what, leaves=leaves) for x in places)
    assert alike(problems) <= {"optimal", "feasible"}


OF_RANDOM: dict[str, tuple[float, Callable[[Problem, float], Problem]]] = {
    "width of the goal": (1e-3, lambda p, x: reaching(p, x, kappa_per_m=p.goal.kappa_per_m)),
    "edge of the goal": (2.0, lambda p, x: reaching(bent_a_little(p, x), 2.0)),
    "little to bend": (2e-6, bent_a_little),
}


@pytest.mark.parametrize("name", OF_RANDOM)
@given(st.integers(0, 10_000))
@settings(max_examples=2)
def test_rounding_changes_no_random_problem(name: str, seed: int) -> None:
    at, problem = OF_RANDOM[name]
    assert len(alike(partial(problem, random_problem(seed), x) for x in nearly(at))) == 1


ENDS = st.sampled_from([(0.0, 1e-7), (1.0, 1 - 1e-7)])  # of a melt fraction, and beside them
TIMINGS = st.sampled_from(["nominal", "constant", "paper"])


def at_its_melting_point(problem: Problem, shares: Iterable[float]) -> Problem:
    """The problem with so much of each segment molten, as warm as metal is that changes."""
    each = list(zip(problem.segment_thresholds_C, shares, strict=True))
    temperatures = [solid + share * (liquid - solid) for (solid, liquid), share in each]
    molten = {"temperature_C": temperatures, "melt_fraction": [share for _, share in each]}
    return problem.with_values(start=problem.start.with_values(**molten))


@given(st.integers(0, 10_000), TIMINGS, st.sampled_from([1, 2]), st.tuples(ENDS, ENDS))
@settings(max_examples=6)
def test_metal_that_all_but_changes_costs_as_much_as_metal_that_does(
    seed: int, timing: str, heaters: int, shares: tuple[tuple[float, float], ...]
) -> None:
    """Solid or liquid at the melting point, or molten by a little less or more."""
    problem = random_problem(seed, timing=timing, heaters_at_once=heaters, gap=0.01)
    exact, beside = (
        plan(at_its_melting_point(problem, some)).require() for some in zip(*shares, strict=True)
    )
    assert exact.status == beside.status
    assert exact.cost.total == pytest.approx(beside.cost.total, rel=2 * problem.gap)
    assert exact.lower_bound == pytest.approx(beside.lower_bound, rel=2 * problem.gap)


@given(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)), st.sampled_from(all_modes(2)))
def test_a_fixed_wait_changes_steadily_with_what_is_molten(
    shares: tuple[float, float], mode: Mode
) -> None:
    """No faster than all waits of the authors' practice together, from any state to any mode."""
    problem = random_problem(0, timing="paper")
    least = []
    for some in (shares, tuple(abs(share - 1e-6) for share in shares)):
        timing = transition_model(at_its_melting_point(problem, some))
        times = timing.network((mode,), mode, [0.0]).earliest
        assert times is not None
        least.append(max(times))
    assert abs(least[1] - least[0]) <= 1e-6 * 2000.0


@pytest.mark.parametrize("shares", [(1.0, 0.5), (0.5, 1.0), (1.0, 0.0)])
def test_of_two_segments_that_freeze_at_first_the_slower_one_counts(
    shares: tuple[float, float],
) -> None:
    def frozen_s(*molten: float) -> float:
        problem = at_its_melting_point(thermal_problem(V2), molten)
        times = transition_model(problem).network((RIGID,), RIGID, [0.0]).earliest
        assert times is not None
        return max(times)

    assert frozen_s(*shares) == max(frozen_s(shares[0], 0.0), frozen_s(0.0, shares[1])) > 60.0


def test_what_a_start_keeps_grows_steadily_with_what_it_has() -> None:
    """As much as it has, less what is not seen, up to the clearance: nowhere faster than it has."""
    own_m = np.linspace(-0.001, 0.006, 3001)
    kept_m = kept_from_m(own_m, 0.002)
    assert (np.diff(kept_m) >= 0).all()
    assert (np.diff(kept_m) <= np.diff(own_m) * (1 + 1e-9)).all()
    assert kept_m[0] == 0.0
    assert kept_m[-1] == 0.002
    assert (kept_m >= np.clip(own_m - UNSEEN_M, 0.0, 0.002)).all()


@pytest.mark.parametrize("level", [50, 127, 166, 205])
@pytest.mark.parametrize("name", ["occupied_thresh", "free_thresh"])
def test_a_threshold_of_a_map_that_is_a_level_of_grey_is_it(
    level: int, name: str, tmp_path: Path
) -> None:
    """Neither occupied nor free is what is exactly as dark, whatever rounding makes of it."""
    greys = np.delete(np.arange(256, dtype=np.uint8), 205)  # which map_saver writes for unknown
    Image.fromarray(greys[None]).save(tmp_path / "map.png")
    others = {"occupied_thresh": 1.0, "free_thresh": 0.0}
    seen = set()
    for threshold in nearly(level / 255):
        said = others | {name: threshold}
        lines = "\n".join(f"{key}: {value!r}" for key, value in said.items())
        text = f"image: map.png\nresolution: 0.05\norigin: [0, 0, 0]\n{lines}\n"
        (tmp_path / "map.yaml").write_text(text)
        known = ~read_map(tmp_path / "map.yaml").unknown
        seen.add(tuple(known[0].tolist()))
    dark = 255 - greys.astype(int)
    assert seen == {tuple((dark > level if name == "occupied_thresh" else dark < level).tolist())}
