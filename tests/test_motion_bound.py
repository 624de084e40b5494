"""How long plans move at least, whatever their mode sequence; and what that says of sequences."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from problems import at, faster_robot, goal_tree, network_of, random_problem
from test_pose_bound import problem_between, random_motion, unit_speed

from twosra_mpc import Goal, Robot, load_robot
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.bounds.motion_bound import _Program, least_motion_s
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.problem.limits import shape_margins
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode, ModeSequence
from twosra_mpc.timing import resting_s

V1 = load_robot("2sra-v1")
FAST = V1.with_values(timing=faster_robot(50.0).timing)


@pytest.mark.parametrize("robot", [V1, load_robot("2sr-v2")], ids=["2sra-v1", "2sr-v2"])
def test_no_random_plan_moves_for_less_time(robot: Robot) -> None:
    shares = []
    for seed in range(3):
        motion = random_motion(robot, np.random.default_rng(seed))
        if motion is None:
            continue
        problem = problem_between(robot, motion.states[0, 0], motion.end)
        least_s = least_motion_s(bending_task(problem), problem.modes)
        moves_s = sum(profile.duration_s for profile in fastest(motion))
        assert least_s <= moves_s + 1e-9, seed
        shares.append(least_s / moves_s)
    assert max(shares) > 0.2


def test_where_some_shape_drives_without_limit_nothing_is_known() -> None:
    problem = random_problem(0)
    assert least_motion_s(bending_task(problem), problem.modes) == 0.0
    shape = problem.with_values(robot=V1, goal=Goal(kappa_per_m=(1.0, 2.0)))
    assert least_motion_s(bending_task(shape), shape.modes) == 0.0


def test_a_long_drive_takes_as_long_as_the_fastest_mode_needs() -> None:
    start = np.array([0.0, 0.0, 1.0, 10.0, -10.0])
    problem = problem_between(V1, start, start + np.array([10.0, 0.0, 0.0, 0.0, 0.0]))
    speed = V1.limits.speed_m_s
    assert speed is not None
    assert 0.9 * 10.0 / speed < least_motion_s(bending_task(problem), problem.modes) <= 10.0 / speed


def test_sequences_with_a_choice_of_bends_are_bounded_by_motion_and_rest_together() -> None:
    problem = random_problem(0, robot=FAST)
    tree = goal_tree(problem)
    known, modes = at((RIGID, SOFT_1, SOFT_2)), (RIGID, SOFT_2, SOFT_1, SOFT_BOTH)
    choice = at(modes)
    before = tree.bound(choice)
    tree.leaf_bound(known)
    tree.tighter_bound(known, 100.0)
    least_s = least_motion_s(bending_task(problem), problem.modes)
    network = network_of(problem, (*modes, RIGID))
    assert tree.bound(choice) == pytest.approx(least_s + resting_s(network))
    assert tree.bound(choice) > before + 1.0
    # Two melts one after the other, a third, then both freeze together.
    plateaus = 37.0 + 235.0 + 37.0 + 235.0
    assert resting_s(network) == pytest.approx(plateaus / 50.0)


def test_rest_never_lasts_longer_than_the_plan_nor_less_with_more_phases() -> None:
    problem = random_problem(0, robot=FAST)
    heads: list[ModeSequence] = [(RIGID,)]
    for _ in range(3):
        heads = [(*head, mode) for head in heads for mode in problem.modes if mode != head[-1]]
        for head in heads:
            network = network_of(problem, head)
            times = network.earliest
            assert times is not None
            assert resting_s(network) <= times[network.layout.finish] + 1e-9 < math.inf
            assert resting_s(network_of(problem, head[:-1])) <= resting_s(network) + 1e-9


def solved(robot: Robot, seed: int) -> tuple[_Program, np.ndarray]:
    """A program, and the S it finds for a random change of pose and shape."""
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-1.0, 1.0, (2, 5)) * [0.3, 0.3, 3.0, 20.0, 20.0]
    problem = problem_between(robot, start, end)
    task = bending_task(problem)
    assert task.pose is not None
    program = _Program(task, task.pose, problem.modes)
    assert program.limited
    x = program._solved()
    assert x is not None
    return program, x


def value(program: _Program, x: np.ndarray, q: np.ndarray) -> np.ndarray:
    """S (m,) at q (5, m), as written: a sum over waves of the heading and powers of curvatures."""
    (k1, k2), phi = q[3:] / program.most_per_m[:, None], q[2] - program.pose.heading
    waves = [1.0 + 0 * phi, np.cos(phi), np.cos(2 * phi), np.sin(phi), np.sin(2 * phi)]
    powers = [k1**i * k2**j for i in range(4) for j in range(4 - i)]
    terms = np.array([wave * power for wave in waves for power in powers])
    return np.asarray((x[:2] - x[2:4]) @ q[:2] + x[5:] @ terms)


def rates_of(robot: Robot, q: np.ndarray, mode: Mode) -> np.ndarray:
    """Columns of q' by inputs at the corners of what wheels, units and bends are limited to."""
    limits, signs = robot.limits, np.array([*itertools.product((-1.0, 1.0), repeat=3)])
    known = kinematics(robot)
    jacobian = known.jacobian(q, mode).full()
    if not any(mode):
        wheels = known.wheel_matrix(q, mode).full()[:, 2:]
        inputs = np.array(
            [np.linalg.solve(wheels[[*rows]], s) for rows in itertools.combinations(range(4), 3)
             for s in signs]
        ).T  # fmt: skip
        inputs /= np.abs(wheels @ inputs).max(axis=0) / limits.wheel_speed_rad_s
        inputs *= np.minimum(1.0, (limits.speed_m_s or np.inf) / np.hypot(*inputs[:2]))
        inputs *= np.minimum(1.0, (limits.turn_rate_rad_s or np.inf) / np.abs(inputs[2]))
        return jacobian[:, 2:] @ inputs
    shares = np.linspace(-1.0, 1.0, 9)
    sides = [*((1.0, share) for share in shares), *((share, 1.0) for share in shares)]
    rates = unit_speed(robot) * jacobian[:, :2] @ np.array(sides).T
    turning = np.abs(rates[3:] * np.array(robot.geometry.lengths_m)[:, None]).max(axis=0)
    within = turning <= (limits.bend_rate_rad_s or np.inf)
    return rates[:, within]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("robot", [V1, load_robot("2sr-v2")], ids=["2sra-v1", "2sr-v2"])
def test_nothing_grows_faster_than_it_is_proved_to(robot: Robot, seed: int) -> None:
    """S as it is written, along the robot's own Jacobian, by differences, in allowed shapes."""
    program, x = solved(robot, seed)
    rng, most = np.random.default_rng(seed), robot.limits.curvature_per_m
    kappa = rng.uniform(-most, most, (60, 2))
    kappa = kappa[np.all([margin >= 0 for margin in shape_margins(robot, kappa).values()], axis=0)]
    for mode in program.modes:
        proved, found = program._grows(x, mode), 0.0
        for shape, heading in zip(kappa, rng.uniform(-4, 4, len(kappa)), strict=True):
            q = np.array([0.3, -0.2, heading, *shape])
            rates = rates_of(robot, q, mode)
            step = 1e-5 / np.abs(rates).max(axis=0)
            ends = (value(program, x, q[:, None] + side * step * rates) for side in (-1, 1))
            found = max(found, float((np.abs(np.subtract(*ends)) / (2 * step)).max()))
        assert found <= proved * (1 + 1e-6)
        assert found > 0.5 * proved


def test_growth_in_a_box_is_no_less_than_in_its_parts() -> None:
    """Halved again and again, a box grows by no more; and at a point by what sampling finds."""
    program, x = solved(V1, 3)
    for mode in program.modes:
        boxes = program.shapes._replace(middles=program.shapes.middles[::9])
        whole = program.growth(x, mode, boxes)
        parts = program.growth(x, mode, boxes.halved()).reshape(4, -1)
        assert (parts.max(axis=0) <= whole * (1 + 1e-9)).all()


def test_the_gain_is_that_of_the_worst_goal() -> None:
    program, x = solved(V1, 1)
    problem = problem_between(
        V1, np.zeros(5), np.array([0.2, 0.1, 1.0, 20.0, -9.0]), half_width=np.full(5, 0.05)
    )
    task = bending_task(problem)
    assert task.pose is not None
    program, rng = _Program(task, task.pose, problem.modes), np.random.default_rng(0)
    x = rng.normal(size=len(x)) * (np.arange(len(x)) != 5)
    x[4] = 0.0
    gain, (low, high) = program.gain(x), problem.goal.box_met(np.zeros(5))
    ends = value(program, x, rng.uniform(low, high, (500, 5)).T)
    reach_loss = 0.05 * np.abs(x[2:4] + x[:2] - np.abs(x[:2] - x[2:4])).sum()
    found = float(ends.min() - value(program, x, np.zeros((5, 1)))[0])
    assert gain <= found
    assert found - gain < 1.0 + reach_loss


def test_fewer_modes_never_move_quicker_than_more_are_known_to() -> None:
    """What is known of more modes counts for fewer of them."""
    problem = random_problem(0, robot=FAST)
    leaves = goal_tree(problem).leaves
    everything = frozenset(problem.modes)
    leaves.motion_s |= {everything: 3.0, frozenset((RIGID, SOFT_1, SOFT_BOTH)): 5.0}
    assert leaves.moves_s(everything) == leaves.moves_s(frozenset((RIGID, SOFT_2))) == 3.0
    assert leaves.moves_s(frozenset((RIGID, SOFT_1))) == 5.0
