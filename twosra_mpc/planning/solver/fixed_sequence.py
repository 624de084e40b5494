"""Solve one mode sequence: guess, multiple shooting if that is not enough, terminal correction."""

from __future__ import annotations

import enum
import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twosra_mpc.checking.verification import cost_of, verify
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.planning.bounds.schedule import cost_coefficients, feasible_schedule, schedule
from twosra_mpc.planning.solver.guess import available_inputs, correct_end, spared_corners
from twosra_mpc.planning.solver.multiple_shooting import TIME_SCALE, Transcription, ipopt
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.speed_profile import SpeedProfile, fastest, sample
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Samples, Trajectory, entered_s
from twosra_mpc.problem.ends import may_drive
from twosra_mpc.problem.limits import BODY_GAP, shape_margins
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.speeds import interval_durations, shapes_allowed
from twosra_mpc.problem.tolerances import GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array
from twosra_mpc.robot.modes import is_rigid
from twosra_mpc.timing import TemporalNetwork, transition_model

INTERVALS = 10
_STEPS = 2
_THIN = 2  # intervals in one of the program where a phase's inputs are alike
_STILL = 1e-9  # m or rad an interval; the correction may leave a resting phase with as little
_MOST_TURN_RAD = 0.35  # in an interval, inside a workspace; half a turn fits into ten
_MAX_ITERATIONS = 150
_STARTS = (1.0, 0.999)  # of the guess's inputs: where numbers fail, a little aside they do not
_SPARED_M = 2e-4  # by which parts are apart at nodes, for what is between them
ALONE = threading.Lock()  # MUMPS, which IPOPT factorises with, fails in two threads at a time
_REGULARISATION = 1e-4  # s per squared scaled displacement; not part of the cost reported


class SolveStatus(enum.Enum):
    """Status of a nonlinear program as the backend said it: advice."""

    SOLVED = "a local optimum"
    ACCEPTABLE = "a point that meets looser tolerances; verify before use"
    LIMIT = "stopped by a limit; raise the limit or give a better guess"
    LOCALLY_INFEASIBLE = "no feasible point near the guess; try another guess or sequence"
    FAILED = "the solver gave up for numerical reasons; try another guess"


IPOPT_STATUS = {
    "Solve_Succeeded": SolveStatus.SOLVED,
    "Solved_To_Acceptable_Level": SolveStatus.ACCEPTABLE,
    "Feasible_Point_Found": SolveStatus.ACCEPTABLE,
    "Search_Direction_Becomes_Too_Small": SolveStatus.ACCEPTABLE,
    "Maximum_Iterations_Exceeded": SolveStatus.LIMIT,
    "Maximum_CpuTime_Exceeded": SolveStatus.LIMIT,
    "Maximum_WallTime_Exceeded": SolveStatus.LIMIT,
    "User_Requested_Stop": SolveStatus.LIMIT,
    "Infeasible_Problem_Detected": SolveStatus.LOCALLY_INFEASIBLE,
}


def solve_status(raw: str) -> SolveStatus:
    """Translate IPOPT's return status."""
    return IPOPT_STATUS.get(raw, SolveStatus.FAILED)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A motion of a sequence with its schedule: a feasible plan, hence an upper bound.

    Attributes:
        motion: The corrected motion.
        profiles: How fast each phase is travelled.
        times: Event times of the temporal network [s].
        settled: The network that they fulfil, with what the metal needs at these times.
        iterations: Iterations of the nonlinear program spent on it.
        stage_ends: Number of phases up to the end of each stage, where there are several.
    """

    motion: Motion
    profiles: tuple[SpeedProfile, ...]
    times: Array
    settled: TemporalNetwork
    iterations: int
    stage_ends: tuple[int, ...] = ()

    @property
    def effort_s(self) -> float:
        """Effort of all phases [s]."""
        return sum(profile.effort_s for profile in self.profiles)


def scheduled(
    motion: Motion, network: TemporalNetwork, problem: Problem, iterations: int
) -> Candidate | None:
    """Correct a motion's end, run it as fast as the limits allow and schedule its transitions.

    Returns None if it cannot be corrected or takes a shape that the limits forbid.
    """
    corrected = correct_end(motion, problem.goal)
    return None if corrected is None else timed(corrected, network, problem, iterations)


def timed(
    motion: Motion,
    network: TemporalNetwork,
    problem: Problem,
    iterations: int,
    stage_ends: tuple[int, ...] = (),
) -> Candidate | None:
    """Run a motion as fast as the limits allow, or as told, and schedule its transitions.

    Returns None if it takes a shape that the limits forbid.
    """
    if not shapes_allowed(motion, _STILL):
        return None
    profiles = fastest(motion)
    durations = np.array([profile.duration_s for profile in profiles])
    found = feasible_schedule(network, durations, problem)
    return None if found is None else Candidate(motion, profiles, *found, iterations, stage_ends)


def solve(guess: Motion, network: TemporalNetwork, problem: Problem) -> Candidate | None:
    """Solve the multiple-shooting program of the sequence from ``guess`` and correct its end.

    Most motions never come near to touching themselves: those that do are solved again, with rows
    for the separations of the robot's parts.
    """
    motion, iterations = _solved(guess, network, problem, apart=False)
    if motion is not None and _overlaps(motion):
        motion, more = _solved(motion, network, problem, apart=True)
        iterations += more
    return None if motion is None else scheduled(motion, network, problem, iterations)


def _overlaps(motion: Motion) -> bool:
    shapes = motion.states[:, :, POSE:].reshape(-1, motion.robot.geometry.segments)
    return bool((shape_margins(motion.robot, shapes)[BODY_GAP.name] < 0).any())


def _solved(
    guess: Motion, network: TemporalNetwork, problem: Problem, *, apart: bool
) -> tuple[Motion | None, int]:
    """The motion that the program finds, if any, and its iterations."""
    robot, phases, intervals = guess.robot, network.layout.phases, guess.inputs.shape[1]
    curved = None if problem.goal.is_box else problem.goal
    inside = problem.workspace is not None
    smooth = robot.limits.wheel_acceleration_rad_s2 is not None and not (inside or apart)
    thin = math.gcd(intervals, _THIN) if smooth else 1
    states, inputs = guess.states[:, ::thin], guess.inputs.reshape(phases, -1, thin, INPUTS)
    shape = phases, intervals // thin, _STEPS, _MAX_ITERATIONS
    program, solver, _ = ipopt(robot, curved, *shape, inside, apart, smooth)
    durations = interval_durations(guess).max(axis=1) * intervals
    times = schedule(network, durations, problem.cost_weights)
    if times is None:
        return None, 0
    cost, _ = cost_coefficients(network, problem.cost_weights)
    lower, upper = _decision_bounds(program, network, problem, guess)
    g_lower, g_upper = _constraint_bounds(program, network, problem)
    iterations = 0
    for share in _STARTS:
        with ALONE:
            solution = solver(
                x0=program.pack(states, share * inputs.sum(axis=2), times),
                p=program.parameters(
                    np.array(network.sequence, dtype=float), cost, _REGULARISATION
                ),
                lbx=lower,
                ubx=upper,
                lbg=g_lower,
                ubg=g_upper,
            )
            stats = solver.stats()
        status, iterations = solve_status(stats["return_status"]), iterations + stats["iter_count"]
        if status is not SolveStatus.FAILED:
            break
    if status not in (SolveStatus.SOLVED, SolveStatus.ACCEPTABLE):
        return None, int(iterations)
    _, inputs, _ = program.unpack(ca.DM(solution["x"]).full().ravel())
    inputs = (inputs / thin).repeat(thin, axis=1)
    return roll_out(robot, guess.states[0, 0], guess.sequence, inputs), int(iterations)


def _decision_bounds(
    program: Transcription, network: TemporalNetwork, problem: Problem, guess: Motion
) -> tuple[Array, Array]:
    """Bounds on the decision vector: start, goal box, curvature range, inputs of each mode."""
    n, m = program.phases, program.intervals
    states = np.full((n, m + 1, len(program.scale)), np.inf)
    states[:, :, POSE:] = problem.robot.limits.curvature_per_m
    low, high = -states, states.copy()
    low[0, 0] = high[0, 0] = problem.start.configuration
    goal_low, goal_high = problem.goal.box(guess.end)
    low[-1, -1] = np.maximum(low[-1, -1], goal_low)
    high[-1, -1] = np.minimum(high[-1, -1], goal_high)
    here = low[0, 0]
    rests = np.append(np.zeros(POSE, bool), ~np.array(network.sequence, bool).any(axis=0))
    rests &= np.abs(problem.goal.error(here.copy())) <= GOAL_TOLERANCE  # is there, or as good as
    low[-1, -1, rests] = np.minimum(low[-1, -1], here)[rests]
    high[-1, -1, rests] = np.maximum(high[-1, -1], here)[rests]
    inputs = np.zeros((n, m, INPUTS))
    inputs[available_inputs(network.sequence, m).reshape(n, m, INPUTS) > 0] = np.inf
    if problem.workspace is not None:  # what is between the places that are looked at
        inputs[..., -1] = np.minimum(inputs[..., -1], _MOST_TURN_RAD)
    inputs[~np.array(may_drive(problem, network.sequence))] = 0.0
    drives = guess.inputs[..., 2:].any(axis=(1, 2))
    if program.inputs == 1 and drives.any():  # each drive more takes its time to speed up
        inputs[~drives, :, 2:] = 0.0
    used = np.zeros(program.layout.count)
    for u, v in network.least:
        used[[u, v]] = np.inf
    used[program.layout.origin] = 0.0
    return program.pack(low, -inputs, np.zeros_like(used)), program.pack(high, inputs, used)


def _constraint_bounds(
    program: Transcription, network: TemporalNetwork, problem: Problem
) -> tuple[Array, Array]:
    """Bounds on the constraints: defects and linkages zero, limits one-sided, network active."""
    size = program.nlp["g"].numel()
    lower, upper = np.full(size, -np.inf), np.zeros(size)
    for name in ("defects", "linkage", "terminal"):
        lower[program.rows[name]] = 0.0
    shapes, driving = program.rows["shape"], program.rows["driving"]
    upper[shapes] = upper[driving] = np.inf
    lower[shapes] = 0.0
    middle = [
        0.0 if is_rigid(mode) and 0 < i < program.phases - 1 else -np.inf
        for i, mode in enumerate(network.sequence)
    ]
    lower[driving] = np.repeat(middle, (driving.stop - driving.start) // program.phases)
    rows = program.rows["network"]
    upper[rows] = np.inf
    lower[rows] = [network.least.get(pair, -np.inf) / TIME_SCALE for pair in program.layout.pairs()]
    if (spared := program.rows.get("apart")) is not None:  # the ends are given
        upper[spared], lower[spared] = np.inf, _SPARED_M / program.scale[0]
        lower[[spared.start, spared.stop - 1]] = -np.inf
    if problem.workspace is not None:
        rows = program.rows["inside"]
        shape = (2 * program.phases * program.intervals + program.phases, -1, 2)
        low, high = (
            np.broadcast_to(end / program.scale[:2], lower[rows].reshape(shape).shape).copy()
            for end in spared_corners(problem, problem.workspace)
        )
        low[0], high[0] = -np.inf, np.inf  # the start is given
        lower[rows], upper[rows] = low.ravel(), high.ravel()
    return lower, upper


def verified(
    problem: Problem,
    candidate: Candidate,
    network: TemporalNetwork,
    planner: str = "optimal",
    fastest_cost: float = math.inf,
) -> Plan:
    """Sample a candidate, derive its transitions and set-points, and verify the result.

    Nothing is known of other plans here: the lower bound is left to the search, and what the plan
    cost before it was made gentle [s] is told.
    """
    layout, times = network.layout, [float(t) for t in candidate.times]
    sequence, profiles = network.sequence, candidate.profiles
    transitions = tuple(transition_model(problem).transitions(network, times))
    starts = [times[layout.start(i)] for i in range(layout.phases)]
    phases = tuple(
        Phase(mode, start, start + profile.duration_s)
        for before, mode, start, profile in zip(
            (problem.start_mode, *sequence), sequence, starts, profiles, strict=False
        )
        if profile.duration_s > SAME_TIME_S or sum(mode) == 1 < sum(before)  # of a joint bend
    )
    finish = times[layout.finish]
    samples = sample(problem, candidate.motion, profiles, starts, finish, transitions)
    ends = candidate.stage_ends or (layout.phases,)
    ends_s = [starts[end - 1] + profiles[end - 1].duration_s for end in ends]
    done_s = _done_s(problem, ends_s, samples) if problem.tasks else ()
    trajectory = Trajectory(problem, samples, phases, transitions, done_s)
    cost = cost_of(trajectory)
    fastest_cost = min(fastest_cost, cost.total)
    return Plan(planner, trajectory, cost, verify(trajectory), None, fastest_cost)


def _done_s(problem: Problem, ends_s: Sequence[float], samples: Samples) -> tuple[float, ...]:
    """Times when tasks are done: at the end of their stages; boxes when entered."""
    moved = Trajectory(problem, samples, (), (), (0.0,) * len(problem.tasks))
    done, ends = [0.0], iter(ends_s)
    for stage in problem.stages[: len(problem.tasks)]:
        if stage.through is not None:
            done.append(entered_s(moved, stage.through, done[-1]))
        else:
            done.append(max(next(ends), done[-1] + stage.least_s))
    return tuple(done[1:])


def cost_s(problem: Problem, candidate: Candidate, network: TemporalNetwork) -> float:
    """Cost of the plan that a candidate makes, by its schedule [s]."""
    model, seconds = transition_model(problem), float(candidate.times[network.layout.finish])
    transitions = model.transitions(network, candidate.times.tolist())
    weights, energy = problem.cost_weights, 0.0
    if weights.energy_s_per_J:  # else nobody asks
        energy = sum(item.energy_J(seconds) for item in model.heating(transitions))
    total = seconds + weights.energy_s_per_J * energy + weights.transition_s * len(transitions)
    return total + weights.effort * candidate.effort_s
