"""How long plans move at least, whatever their mode sequence; and what that says of sequences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from problems import at, faster_robot, goal_tree, network_of, random_problem
from test_pose_bound import problem_between, random_motion

from twosra_mpc import Goal, Robot, load_robot
from twosra_mpc.planning.bounds import motion_bound
from twosra_mpc.planning.bounds.motion_bound import least_motion_s
from twosra_mpc.planning.bounds.pose_bound import PoseConstraint, PoseProgram
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.robot.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence
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


class _Told(PoseProgram):
    """A program that keeps what was read of it."""

    last: PoseProgram
    read_of: list[tuple[np.ndarray, float, float]]

    def read(self, x: np.ndarray) -> tuple[PoseConstraint, bool]:
        found, violated = super().read(x)
        type(self).last = self
        self.read_of.append((x, found.need, float(found.rates[0])))
        return found, violated


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("robot", [V1, load_robot("2sr-v2")], ids=["2sra-v1", "2sr-v2"])
def test_a_finer_look_at_the_shapes_finds_no_quicker_growth(
    robot: Robot, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bound is what S gains by its growth: on boxes that are smaller by far, too."""
    motion = random_motion(robot, np.random.default_rng(seed))
    assert motion is not None
    _Told.read_of = []
    monkeypatch.setattr(motion_bound, "PoseProgram", _Told)
    problem = problem_between(robot, motion.states[0, 0], motion.end)
    task = bending_task(problem)
    assert task.pose is not None
    least_s = least_motion_s(task, problem.modes)
    x, need, _ = max(_Told.read_of, key=lambda read: read[1] / read[2] if read[2] else 0.0)
    boxes, empty = motion_bound._pieces(task)
    p, slopes = x[:2] * _Told.last.given, _Told.last.slopes(x, 0)
    surely = 0.0
    for mode in problem.modes:
        smaller = boxes
        for halving in range(4):
            phase = motion_bound._motions(task.pose, mode, task, smaller, empty)
            assert phase is not None
            growth, loose = _Told.last.growth(phase, p, *slopes)
            surely = max(surely, float((growth.max(axis=2) - loose).max()))
            if not any(mode) or halving == 3:
                break
            each = (growth.max(axis=2) + loose).max(axis=1).reshape(-1, smaller.low.shape[1])
            smaller = smaller.some(each.max(axis=0) >= np.quantile(each.max(axis=0), 0.95)).halved()
    assert least_s * surely <= need * (1 + 1e-9)


@pytest.mark.parametrize("share", [0.1, 0.9, 1.1, 3.0])
def test_growth_known_of_other_modes_is_never_forgotten(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mode by mode it only grows: less of it would prove too long a motion."""
    motion = random_motion(V1, np.random.default_rng(0))
    assert motion is not None
    _Told.read_of = []
    monkeypatch.setattr(motion_bound, "PoseProgram", _Told)
    task = bending_task(problem_between(V1, motion.states[0, 0], motion.end))
    least_motion_s(task, tuple(MODES))
    x, need, rate = max(_Told.read_of, key=lambda read: read[1] / read[2] if read[2] else 0.0)
    for mode in MODES:
        assert motion_bound._growth(_Told.last, x, mode, task, share * rate) >= share * rate
    assert need > 0


@pytest.mark.parametrize("loosely", [False, True])
def test_growth_is_proved_at_all_headings_of_a_panel_and_for_all_motions_of_a_box(
    loosely: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Headings within panels, and motions anywhere in their boxes, let nothing grow faster."""
    _Told.read_of = []
    monkeypatch.setattr(motion_bound, "PoseProgram", _Told)
    robot, rng = load_robot("2sr-v2"), np.random.default_rng(0)
    start = np.array([0.1, -0.1, 0.4, 5.0, -8.0])
    end = start + np.array([0.2, 0.1, 0.5, 3.0, 4.0])
    task = bending_task(problem_between(robot, start, end))
    assert task.pose is not None
    least_motion_s(task, robot_modes := (RIGID, SOFT_1, SOFT_2, SOFT_BOTH))
    program, most_used = _Told.last, 0.0
    for mode in robot_modes:
        phase = motion_bound._motions(task.pose, mode, task, *motion_bound._pieces(task))
        assert phase is not None
        phase = phase if loosely else phase._replace(slack=0 * phase.slack)
        for _ in range(30):
            slopes, steep = rng.normal(size=program.panels), rng.normal(size=len(phase.bends))
            n, panel = rng.integers(len(phase.motions)), rng.integers(program.panels, size=50)
            signs = rng.choice([-1.0, 1.0], size=4) * np.array([0.7, 0.7, 1.0, 1.0])
            u, v, r, bending = phase.motions[n] + signs * phase.slack[n]
            share = rng.uniform(0.3, 0.7, 50)
            heading = task.pose.heading + program.edges[panel] + share * program.widths[panel]
            c, s = np.cos(heading), np.sin(heading)
            moved = np.array([c * u - s * v, s * u + c * v])
            p = 10 * moved[:, 0]  # along which one of them drives
            growth, loose = program.growth(phase, p, slopes, steep)
            most = growth[n].max(axis=1) + loose[n]
            grows = p @ moved + slopes[panel] * r + bending * steep[phase.piece[n]].sum()
            assert (grows <= most[panel] + 1e-9).all()
            most_used = max(most_used, float((grows - growth[n].max(axis=1)[panel]).max()))
    assert (most_used > 0) == loosely  # what is added for the size of boxes is needed
