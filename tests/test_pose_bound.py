"""The bound from the change of pose: no plan of a sequence is faster, however it was found."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from problems import at_once, faster_robot, network_of

from twosra_mpc import Goal, Problem, Robot, Start, load_robot
from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.bounds import sequence_bound as bounds
from twosra_mpc.planning.bounds.bends import least_durations
from twosra_mpc.planning.bounds.pose_bound import PoseProgram
from twosra_mpc.planning.bounds.rigid_motion import twist_vertices
from twosra_mpc.planning.bounds.schedule import cost_coefficients, schedule
from twosra_mpc.planning.bounds.sequence_bound import pose_bound
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.problem.goals import Tolerance
from twosra_mpc.problem.speeds import interval_durations
from twosra_mpc.robot.description import with_path_model
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode, ModeSequence

Array = NDArray[np.float64]

V1 = load_robot("2sra-v1-paper")
ROBOTS = {
    "log_spiral_corrected": with_path_model(V1, "log_spiral_corrected"),
    "cardioid": with_path_model(V1, "cardioid"),
    "side_wheel": at_once(load_robot("2sra-v1")),
    "2sr-v2": at_once(load_robot("2sr-v2")),
}
FROM_REST = {name: load_robot(name) for name in ("2sra-v1", "2sr-v2")}
SOFT_MODES = (SOFT_1, SOFT_2, SOFT_BOTH)

each_robot = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS.keys())


def fast(robot: Robot, factor: float = 500.0) -> Robot:
    """The robot with the melting and freezing times of ``faster_robot``."""
    return robot.with_values(timing=faster_robot(factor).timing)


def unit_speed(robot: Robot) -> float:
    limits = robot.limits
    by_wheel = limits.wheel_speed_rad_s * robot.geometry.wheel_radius_m
    return (
        limits.unit_speed_m_s if robot.path.model == "arc" else min(limits.unit_speed_m_s, by_wheel)
    )


def problem_between(
    robot: Robot,
    start: Array,
    end: Array,
    modes: tuple[Mode, Mode] = (RIGID, RIGID),
    half_width: Array | None = None,
) -> Problem:
    """From q ``start`` to a box about q ``end``, with these stiffnesses at start and end."""
    warm = tuple(80.0 if soft else 25.0 for soft in modes[0])
    x, y, phi, *kappa = end.tolist()
    return Problem(
        robot=robot,
        start=Start(
            x_m=start[0], y_m=start[1], phi_rad=start[2], kappa_per_m=start[3:], temperature_C=warm
        ),
        goal=Goal(
            **{"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": kappa, "mode": modes[1]},
            tolerance="exact" if half_width is None else Tolerance.of(half_width),
        ),
    )


FREE = (("phi_rad",), ("x_m",), ("y_m",), ("x_m", "y_m"))


def with_free(problem: Problem, free: tuple[str, ...]) -> Problem:
    return problem.with_values(goal=problem.goal.with_values(**dict.fromkeys(free)))


def proved(problem: Problem, sequence: ModeSequence) -> float:
    task = bending_task(problem)
    durations = least_durations(sequence, task)
    network = network_of(problem, sequence, problem.goal.mode)
    return pose_bound(bounds.Events(network, problem.cost_weights, durations), task, math.inf)


# --- what the phases can do -----------------------------------------------------------------


@each_robot
@pytest.mark.parametrize("mode", SOFT_MODES)
def test_what_each_unit_does_to_the_robot_is_enclosed(robot: Robot, mode: Mode) -> None:
    facts, rng = bending(robot), np.random.default_rng(1)
    limit = robot.limits.curvature_per_m
    for _ in range(4):
        kappa = rng.uniform(-0.5 * limit, 0.5 * limit, 2)
        origin = facts.coordinates(kappa.tolist())
        reach = 0.3 * facts.coordinate(limit)
        along = np.linspace(-reach, reach, 13)
        w = np.array(origin)[:, None] + np.outer(mode, along)
        low, high = facts.motions_between(mode, w[:, :-1], w[:, 1:])
        for box, share in enumerate(rng.uniform(size=12)):
            change = along[box] + share * (along[box + 1] - along[box])
            shape = np.array(facts.curvatures(np.array(origin) + np.array(mode) * change))
            j, step = mode.index(1), 1e-3
            steep = facts.coordinate(shape[j] + step) - facts.coordinate(shape[j] - step)
            moved = kinematics(robot).jacobian([0, 0, 0, *shape], mode).full()[:, :2]
            bent = moved[3 + j] * steep / (2 * step)
            motion = unit_speed(robot) * np.vstack([moved[:3], bent, moved[3:]])
            assert (low[:, :, box] - 1e-7 <= motion.T).all()
            assert (high[:, :, box] + 1e-7 >= motion.T).all()


@each_robot
def test_the_shape_between_bends_is_known_exactly(robot: Robot) -> None:
    limit, facts = robot.limits.curvature_per_m, bending(robot)
    kappa = np.random.default_rng(2).uniform(-limit, limit, 200)
    found = facts.curvature(np.array([facts.coordinate(k) for k in kappa.tolist()]))
    assert np.abs(found - kappa).max() * robot.geometry.lengths_m[0] < 1e-9


# --- random plans ---------------------------------------------------------------------------


def random_motion(robot: Robot, rng: np.random.Generator) -> Motion | None:
    """One or two bends between rigid phases, some left out; fast, slow, or to and fro.

    None if it leaves the curvature range.
    """
    soft = [SOFT_MODES[k] for k in rng.permutation(3)[: rng.integers(1, 3)]]
    phases = [mode for bend in soft for mode in (RIGID, bend)] + [RIGID]
    sequence = tuple(mode for mode in phases if any(mode) or rng.random() < 0.7)
    limit, intervals = robot.limits.curvature_per_m, 3
    start = np.array([0.1, -0.1, *rng.uniform(-1, 1, 3) * [3.5, 0.7 * limit, 0.7 * limit]])
    inputs = np.zeros((len(sequence), intervals, 5))
    motion = roll_out(robot, start, sequence[:1], inputs[:1])
    style = rng.integers(3)  # any speeds; limits of speed, to and fro; limits of speed, one way
    for i, mode in enumerate(sequence):
        time = rng.exponential(0.5) / intervals
        speed = rng.uniform(0.0, 1.0, (intervals, 1)) if style == 0 else 1.0
        if any(mode):
            corner = rng.choice([-1.0, 1.0], (intervals, 2))
            inputs[i, :, :2] = unit_speed(robot) * time * speed * corner
        else:
            matrix = kinematics(robot).wheel_matrix(motion.end, RIGID).full()[:, 2:]
            vertices = twist_vertices(matrix / robot.limits.wheel_speed_rad_s)
            assert vertices is not None
            corner = vertices[rng.integers(len(vertices), size=intervals)]
            inputs[i, :, 2:] = time * speed * corner
        if style == 2:
            inputs[i] = inputs[i, 0]
        motion = roll_out(robot, start, sequence[: i + 1], inputs[: i + 1])
        if np.abs(motion.states[:, :, 3:]).max() > limit:
            return None
    return motion


@pytest.mark.parametrize(
    "robot", [*ROBOTS.values(), *FROM_REST.values()], ids=[*ROBOTS, *(f"{n}*" for n in FROM_REST)]
)
def test_no_random_plan_costs_less_than_its_bound(robot: Robot) -> None:
    robot = fast(robot, 5000.0)
    judged = 0
    for seed in range(5):
        motion = random_motion(robot, np.random.default_rng(seed))
        if motion is None:
            continue
        sequence, start = motion.sequence, motion.states[0, 0]
        modes = sequence[0], sequence[-1]
        problem = problem_between(robot, start, motion.end, modes)
        if not np.isfinite(least_durations(sequence, bending_task(problem))).all():
            continue  # the units overlap on the way
        network = network_of(problem, sequence, sequence[-1])
        durations = np.array([profile.duration_s for profile in fastest(motion)])
        times = schedule(network, durations, problem.cost_weights)
        assert times is not None
        coefficients, constant = cost_coefficients(network, problem.cost_weights)
        cost = float(coefficients @ times) + constant
        assert proved(problem, sequence) <= cost + 1e-9, seed
        share = (1.0, 5.0, 0.1)[seed % 3]  # of a box that holds the end of the motion somewhere
        box = share * np.array([2e-3, 2e-3, 0.02, 1.0, 1.0])
        off = np.random.default_rng(seed).uniform(-1, 1, 5) * box
        boxed = problem_between(robot, start, motion.end + off, modes, box)
        if not (np.abs(boxed.goal.configuration[3:]) > robot.limits.curvature_per_m).any():
            assert proved(boxed, sequence) <= cost + 1e-9, (seed, share)
        free = FREE[seed % len(FREE)]
        assert proved(with_free(problem, free), sequence) <= cost + 1e-9, (seed, free)
        judged += 1
        if judged == 2:
            return
    pytest.fail("too few motions of these robots to judge by")


@pytest.mark.parametrize("free", FREE, ids=" ".join)
def test_goals_with_free_coordinates_are_bounded_by_what_they_give(free: tuple[str, ...]) -> None:
    # The robot looks north: what is free in the world is not what is free in its own frame.
    problem = turned(1.0, phi=math.pi / 2)
    sequence = (RIGID, SOFT_1, RIGID)
    far = {name: getattr(problem.goal, name) + 1.0 for name in free}
    elsewhere = problem.with_values(goal=problem.goal.with_values(**far))
    bounds_s = [proved(p, sequence) for p in (with_free(problem, free), problem, elsewhere)]
    assert 0.5 < bounds_s[0] <= min(bounds_s) * (1 + 1e-4)
    tight = dict.fromkeys(free, 1e5 if free != ("phi_rad",) else math.pi)
    boxed = problem.with_values(goal=problem.goal.with_values(tolerance=tight))
    assert proved(boxed, sequence) == pytest.approx(bounds_s[0], rel=1e-2)


@each_robot
def test_small_boxes_are_bounded_about_as_well_as_points(robot: Robot) -> None:
    robot, judged = fast(robot, 5000.0), 0
    for seed in range(8):
        motion = random_motion(robot, np.random.default_rng(seed))
        if motion is None or len(motion.sequence) == 1:
            continue
        sequence, start = motion.sequence, motion.states[0, 0]
        box = np.array([1e-5, 1e-5, 1e-4, 1e-3, 1e-3])
        exact, boxed = (
            proved(
                problem_between(robot, start, motion.end, (sequence[0], sequence[-1]), b), sequence
            )
            for b in (None, box)
        )
        if np.isfinite(exact) and exact > 0.1:
            assert boxed >= 0.98 * exact - 1e-2, (seed, exact, boxed)
            judged += 1
        if judged == 1:
            return
    pytest.fail("too few motions of these robots to judge by")


def test_units_that_move_against_each_other_are_not_faster_than_the_bound() -> None:
    # Segment 2 alone is soft, LU1 forwards and LU2 backwards: little bend, much change of pose.
    robot = fast(ROBOTS["2sr-v2"])
    start, inputs = np.array([0.0, 0.0, 0.0, -5.0, 7.0]), np.zeros((1, 4, 5))
    inputs[0, :, :2] = 0.0016, -0.0016
    motion = roll_out(robot, start, (SOFT_2,), inputs)
    problem = problem_between(robot, start, motion.end, (SOFT_2, SOFT_2))
    least = float(interval_durations(motion).sum())
    assert 0.9 * least < proved(problem, (SOFT_2,)) <= least


# --- awkward tasks --------------------------------------------------------------------------


def turned(turn: float, phi: float = 0.0) -> Problem:
    start = np.array([0.0, 0.0, phi, 10.0, -20.0])
    return problem_between(fast(V1), start, np.array([0.2, 0.1, phi + turn, 30.0, -20.0]))


@pytest.mark.parametrize("turn", [0.0, math.pi / 16])
def test_a_goal_heading_next_to_the_edge_of_a_panel_is_like_any_other(turn: float) -> None:
    sequence = (RIGID, SOFT_1, RIGID)
    reference = proved(turned(turn), sequence)
    assert reference > 0
    for off in (-1e-5, 1e-16):
        assert proved(turned(turn + off), sequence) == pytest.approx(reference, rel=1e-2)
    assert proved(turned(turn + math.tau), sequence) == pytest.approx(reference, rel=1e-2)


def test_a_soft_phase_without_room_to_bend_is_bounded_too() -> None:
    limit = 40.0  # at its own the robot's wheels meet its fibre
    stiff = V1.with_values(limits=V1.limits.with_values(curvature_per_m=limit))
    start = np.array([0.0, 0.0, 0.0, limit, -limit])
    problem = problem_between(fast(stiff), start, start + np.array([0.1, 0.1, 1, 0, 0]))
    sequence = (RIGID, SOFT_BOTH, RIGID)
    assert 0 < proved(problem, sequence) < math.inf


def test_shapes_in_which_a_unit_can_bend_without_limit_prove_nothing() -> None:
    arc = fast(ROBOTS["side_wheel"])
    geometry = arc.geometry.with_values(middle_link_m=0.2)
    robot = arc.with_values(geometry=geometry)
    start, end = np.array([0.0, 0.0, 0.0, 30.0, 30.0]), np.array([0.1, 0.1, 1.0, -20.0, -20.0])
    assert proved(problem_between(robot, start, end), (RIGID, SOFT_BOTH, RIGID)) == -math.inf


def test_where_the_solver_gives_up_nothing_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    def give_up(*_: object) -> None:
        raise ArithmeticError("linear program without optimum")

    monkeypatch.setattr(bounds, "proved_minimum", give_up)
    assert proved(turned(1.0), (RIGID, SOFT_1, RIGID)) == -math.inf
    monkeypatch.undo()
    monkeypatch.setattr("twosra_mpc.planning.bounds.pose_bound.Program.optimum", give_up)
    assert proved(turned(1.0), (RIGID, SOFT_1, RIGID)) == -math.inf


@pytest.mark.parametrize("seed", range(20))
def test_the_least_of_a_function_of_the_heading_is_at_one_of_those_named(seed: int) -> None:
    """Of any function linear between headings: as found on a grid of ten thousand in the goal."""
    rng = np.random.default_rng(seed)
    edges = np.sort([0.0, *rng.uniform(0.0, math.tau, rng.integers(2, 12)), math.tau])
    turn, reach = rng.uniform(-7, 7), rng.choice([0.0, rng.uniform(0, 0.5), rng.uniform(0, 3.1)])
    shape: Any = SimpleNamespace(edges=edges, widths=np.diff(edges), panels=len(edges) - 1)
    task: Any = SimpleNamespace(turn=turn, turn_reach=reach)
    named = PoseProgram._goal_headings(shape, task)
    for _ in range(5):
        levels = rng.normal(size=len(edges) - 1)
        at = np.remainder(np.linspace(turn - reach, turn + reach, 10_001), math.tau)
        values = np.interp(at, edges, [*levels, levels[0]])
        steepest = np.abs(np.diff([*levels, levels[0]]) / np.diff(edges)).max()
        found = float((named @ levels).min())
        assert found <= values.min() + 1e-9
        assert found >= values.min() - steepest * reach / 5_000 - 1e-9
