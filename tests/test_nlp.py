"""Guess, multiple shooting and terminal correction of a fixed sequence."""

from __future__ import annotations

import gc
import math
import weakref
from typing import Any

import casadi as ca
import numpy as np
import pytest
from problems import ROBOT, bound_of, guessed, network_of, random_problem
from scipy.integrate import solve_ivp

from twosra_mpc import Problem, load_problem
from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.solver import fixed_sequence
from twosra_mpc.planning.solver.fixed_sequence import (
    IPOPT_STATUS,
    Candidate,
    SolveStatus,
    scheduled,
    solve,
    solve_status,
    verified,
)
from twosra_mpc.planning.solver.guess import TERMINAL_TOLERANCE, bent, correct_end, guess_motion
from twosra_mpc.planning.solver.multiple_shooting import MOST_ADDED, ipopt, transcribe
from twosra_mpc.problem.speeds import interval_durations
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence
from twosra_mpc.timing import TemporalNetwork

SEQUENCE = (RIGID, SOFT_1, SOFT_BOTH, RIGID)


def set_up(problem: Problem, sequence: ModeSequence) -> tuple[TemporalNetwork, Motion, float]:
    """Network, guess and lower bound of a sequence."""
    network, bound = network_of(problem, sequence), bound_of(problem, sequence)
    assert bound is not None
    return network, guessed(problem, sequence), bound.cost


def cost_of(problem: Problem, candidate: Candidate, network: TemporalNetwork) -> float:
    """What executing a candidate costs; it is a plan."""
    done = verified(problem, candidate, network)
    assert done.verification.ok, done.verification.problems
    return done.cost.total


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 6])
def test_the_guess_reaches_the_goal_pose_exactly_and_the_shape_nearly(seed: int) -> None:
    problem = random_problem(seed)
    _, guess, _ = set_up(problem, (RIGID, SOFT_1, SOFT_2, RIGID))
    error = problem.goal.error(guess.end.copy())
    assert np.abs(error[:3]).max() < 1e-9
    assert np.abs(error[3:]).max() < 1e-2


@pytest.mark.parametrize("shares", [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.3, 1.0)])
@pytest.mark.parametrize("bend", [-0.05, -1e-6, 1e-6, 0.03])
def test_bending_travel_changes_the_coordinate_by_what_was_asked(
    bend: float, shares: tuple[float, float]
) -> None:
    coordinate = bending(ROBOT).coordinate
    q = np.array([0.1, 0.2, 0.3, 20.0, -30.0])
    for mode in (SOFT_1, SOFT_2, SOFT_BOTH):
        nodes, travel = bent(ROBOT, q, mode, bend, 1, shares)
        reached, segment = nodes[-1], mode.index(1)
        pieces = np.tile([[[*travel[0] / 40, 0, 0, 0]]], (1, 40, 1))
        end = roll_out(ROBOT, q, (mode,), pieces).end
        change = coordinate(end[3 + segment]) - coordinate(q[3 + segment])
        assert change == pytest.approx(bend, abs=1e-7)
        assert reached == pytest.approx(end, abs=1e-7)


def test_the_roll_out_agrees_with_an_adaptive_integrator() -> None:
    problem = random_problem(12)
    _, guess, _ = set_up(problem, SEQUENCE)
    jacobian = kinematics(ROBOT).jacobian
    q = problem.start.configuration
    for mode, steps in zip(SEQUENCE, guess.inputs, strict=True):
        for step in steps:
            q = solve_ivp(
                lambda _, at, mode=mode, step=step: jacobian(at, mode).full() @ step,
                (0.0, 1.0),
                q,
                method="DOP853",
                rtol=1e-11,
                atol=1e-12,
            ).y[:, -1]
    assert np.abs(q - guess.end).max() < 1e-8


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 6])
def test_terminal_correction_closes_a_disturbed_motion_and_changes_it_little(seed: int) -> None:
    problem = random_problem(seed)
    _, guess, _ = set_up(problem, (RIGID, SOFT_1, SOFT_2, RIGID))
    rng = np.random.default_rng(seed)
    disturbed = guess.inputs * (1 + 1e-3 * rng.standard_normal(guess.inputs.shape))
    motion = roll_out(ROBOT, problem.start.configuration, guess.sequence, disturbed)
    assert np.abs(problem.goal.error(motion.end.copy())).max() > 1e-5
    corrected = correct_end(motion, problem.goal)
    assert corrected is not None
    assert np.abs(problem.goal.error(corrected.end.copy())).max() <= TERMINAL_TOLERANCE
    assert np.abs(corrected.inputs - disturbed).max() < 1e-2 * np.abs(disturbed).max()
    soft = np.array([any(mode) for mode in guess.sequence])
    assert not corrected.inputs[soft][:, :, 2:].any()
    assert not corrected.inputs[~soft][:, :, :2].any()


def test_terminal_correction_gives_up_on_a_goal_its_modes_cannot_reach() -> None:
    problem = load_problem("paper-1", robot=ROBOT)
    still = roll_out(ROBOT, problem.start.configuration, (RIGID,), np.full((1, 4, 5), 1e-3))
    assert correct_end(still, problem.goal) is None


def test_intervals_run_at_the_limit_of_a_wheel_or_a_unit() -> None:
    _, guess, _ = set_up(random_problem(12), SEQUENCE)
    durations = interval_durations(guess)
    function = kinematics(ROBOT).wheel_matrix
    for i, mode in enumerate(SEQUENCE):
        for k in range(10):
            if durations[i, k] == 0.0:
                assert not guess.inputs[i, k].any()
                continue
            v = guess.inputs[i, k] / durations[i, k]
            wheels = function(guess.states[i, k], mode).full() @ v
            use = max(
                np.abs(wheels).max() / ROBOT.limits.wheel_speed_rad_s,
                np.abs(v[:2]).max() / ROBOT.limits.unit_speed_m_s,
            )
            assert use == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["paper-1", "paper-3", "paper-5"])
def test_multiple_shooting_confirms_that_the_guess_is_locally_optimal(name: str) -> None:
    problem = load_problem(name, robot=ROBOT)
    sequence = SEQUENCE if name != "paper-5" else (RIGID, SOFT_2, SOFT_BOTH, RIGID)
    network, guess, bound = set_up(problem, sequence)
    first, polished = scheduled(guess, network, problem, 0), solve(guess, network, problem)
    assert first is not None
    assert polished is not None
    assert polished.iterations > 0
    costs = [cost_of(problem, candidate, network) for candidate in (polished, first)]
    assert bound <= costs[0] <= costs[1] + 1e-3
    assert np.abs(problem.goal.error(polished.motion.end.copy())).max() <= TERMINAL_TOLERANCE


def test_multiple_shooting_improves_a_motion_that_is_not_optimal() -> None:
    problem = load_problem("rigid-move", robot=ROBOT)
    network, guess, _ = set_up(problem, (RIGID,))
    first, polished = scheduled(guess, network, problem, 0), solve(guess, network, problem)
    assert first is not None
    assert polished is not None
    assert cost_of(problem, polished, network) < 0.95 * cost_of(problem, first, network)


def test_a_goal_out_of_reach_of_the_modes_is_reported_as_no_motion() -> None:
    problem = load_problem("paper-1", robot=ROBOT)
    network = network_of(problem, (RIGID,))
    guess = roll_out(ROBOT, problem.start.configuration, (RIGID,), np.full((1, 10, 5), 1e-3))
    assert solve(guess, network, problem) is None


def test_the_decision_vector_packs_and_unpacks() -> None:
    program = transcribe(ROBOT, None, phases=3, intervals=4, steps=2)
    rng = np.random.default_rng(0)
    states, inputs = rng.standard_normal((3, 5, 5)), rng.standard_normal((3, 4, 5))
    times = rng.uniform(0, 500, program.layout.count)
    x = program.pack(states, inputs, times)
    assert x.shape == (program.nlp["x"].numel(),)
    for before, after in zip((states, inputs, times), program.unpack(x), strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-14)
    assert max(rows.stop for rows in program.rows.values()) == program.nlp["g"].numel()


def test_few_programs_are_kept_however_many_are_built() -> None:
    """What they share is kept with the robot, a few MiB of each."""
    built = [weakref.ref(ipopt(ROBOT, None, phases, 2, 1, 1)[0]) for phases in range(1, 7)]
    gc.collect()
    assert 1 <= sum(program() is not None for program in built) <= 4


@pytest.mark.parametrize("raw", [*IPOPT_STATUS, "Invalid_Number_Detected", "something new"])
def test_every_solver_status_has_a_meaning(raw: str) -> None:
    status = solve_status(raw)
    expected = {
        "Solve_Succeeded": SolveStatus.SOLVED,
        "Solved_To_Acceptable_Level": SolveStatus.ACCEPTABLE,
        "Feasible_Point_Found": SolveStatus.ACCEPTABLE,
        "Search_Direction_Becomes_Too_Small": SolveStatus.ACCEPTABLE,
        "Infeasible_Problem_Detected": SolveStatus.LOCALLY_INFEASIBLE,
        "Maximum_Iterations_Exceeded": SolveStatus.LIMIT,
        "Maximum_CpuTime_Exceeded": SolveStatus.LIMIT,
        "Maximum_WallTime_Exceeded": SolveStatus.LIMIT,
        "User_Requested_Stop": SolveStatus.LIMIT,
    }
    assert status is expected.get(raw, SolveStatus.FAILED)


def test_a_screw_motion_covers_any_rigid_pose_change() -> None:
    for seed in range(5):
        problem = random_problem(seed)
        goal = problem.goal.with_values(kappa_per_m=None)
        free = Problem(
            robot=ROBOT, start=problem.start, goal=goal.model_validate(goal.model_dump())
        )
        _, guess, _ = set_up(free, (RIGID,))
        assert np.abs(free.goal.error(guess.end.copy())).max() < 1e-9
        assert abs(guess.inputs[0, :, 4].sum()) <= math.pi + 1e-9


def test_a_hopeless_program_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """From far off no more is added to its Hessian than iterations are counted for."""
    problem, sequence, used = random_problem(6), (SOFT_BOTH, SOFT_2), list[ca.Function]()

    def noted(*args: Any) -> Any:
        made = ipopt(*args)
        used.append(made[1])
        return made

    monkeypatch.setattr(fixed_sequence, "ipopt", noted)
    start, network = problem.start.configuration, network_of(problem, sequence)
    far = guess_motion(problem.robot, start, problem.goal, sequence, np.array([0.04, 0.34]), 10)
    solve(far, network, problem)
    added = used[0].stats()["iterations"]["regularization_size"]
    assert 1.0 < max(added) <= MOST_ADDED * (1 + 1e-9)
