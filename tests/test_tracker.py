"""The tracker: its program, where it drives the robot, and what it never does."""

from __future__ import annotations

import dataclasses
import gc
import math
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from grasps import cube
from numpy.typing import NDArray
from once import planned
from problems import ROBOT
from scipy.optimize import nnls

from twosra_mpc import (
    Goal,
    InputError,
    Plan,
    Problem,
    Robot,
    Start,
    load_robot,
    plan,
    with_path_model,
)
from twosra_mpc.contact.grip import pushing_cone
from twosra_mpc.execution.tracking.linearisation import tracking_program
from twosra_mpc.execution.tracking.setup import (
    Setup,
    SolverSettings,
    TrackerLimits,
    TrackerWeights,
    outputs_of,
)
from twosra_mpc.execution.tracking.solver import QuadraticProgram
from twosra_mpc.execution.tracking.tracker import (
    Command,
    CommandStatus,
    Measurement,
    PhaseReference,
    Tracker,
)
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot.coordinates import WHEELS
from twosra_mpc.robot.description import PATH_MODELS
from twosra_mpc.robot.modes import (
    MODES,
    RIGID,
    SOFT_1,
    SOFT_2,
    SOFT_BOTH,
    Mode,
    all_modes,
    soft_segments,
)

Array = NDArray[np.float64]

PHASES = {  # a phase of each mode: scenario, index
    RIGID: ("paper-2", 0),
    SOFT_1: ("paper-2", 1),
    SOFT_2: ("paper-4", 1),
    SOFT_BOTH: ("paper-1", 2),
}
DEVIATION = np.array([0.004, -0.003, 0.03, 1.0, -0.5])  # m, m, rad, 1/m, 1/m
OUT_OF_BOUNDS = 1e-9  # rounding


def configuration(of: Plan, time_s: float) -> Array:
    """Configuration of the plan at one of its sample times."""
    at = int(np.searchsorted(of.samples.t_s, time_s - 1e-6))
    q: Array = of.samples.q[at].copy()
    return q


def moved(tracker: Tracker, mode: Mode, q: Array, v: Array) -> Array:
    """Where the exact flow of the model takes the robot in one period."""
    flow = interval_flow(tracker.robot, 16)
    after: Array = flow(q, v * tracker.period_s, mode).full().ravel()
    return after


def drive(tracker: Tracker, of: Plan, phase: int, q: Array, rest_s: float = 3.0) -> Array:
    """Follow a phase from ``q``, and rest at its end."""
    path = of.phases[phase]
    steps = math.ceil((path.end_s - path.start_s + rest_s) / tracker.period_s)
    for k in range(steps):
        command = tracker.step(Measurement(path.start_s + k * tracker.period_s, phase, q))
        assert command.status is CommandStatus.SOLVED
        q = moved(tracker, path.mode, q, command.v)
    return q


def stepped(mode: Mode, **settings: Any) -> tuple[Tracker, QuadraticProgram]:
    """A tracker after a few steps from a disturbed start, and its last program."""
    scenario, phase = PHASES[mode]
    of = planned(scenario, robot="2sra-v1-paper")  # which drives at its limits
    tracker = Tracker(of.robot, **settings)
    tracker.reset(of)
    start_s = of.phases[phase].start_s
    q = configuration(of, start_s) + DEVIATION
    for k in range(4):
        command = tracker.step(Measurement(start_s + k * tracker.period_s, phase, q))
        q = moved(tracker, mode, q, command.v)
    program = tracker.quadratic_program()
    assert program is not None
    return tracker, program


def dense_solution(program: QuadraticProgram) -> Array:
    """Solve the program as a least distance problem with non-negative least squares.

    Lawson and Hanson, Solving Least Squares Problems, chapter 23: exact, dense, no ADMM.
    """
    hessian = program.hessian.toarray()
    hessian[-1, -1] += 1e-2 * (hessian[-1, -1] == 0)  # any cost of the slack, which is zero here
    root = np.linalg.cholesky(hessian).T
    inverse = np.linalg.inv(root)
    centre = -inverse @ inverse.T @ program.cost
    rows = program.constraints.toarray()
    above, below = program.lower > -1e20, program.upper < 1e20
    g = np.vstack([rows[above], -rows[below]])
    h = np.concatenate([program.lower[above], -program.upper[below]]) - g @ centre
    stacked = np.vstack([(g @ inverse).T, h])
    target = np.zeros(len(stacked))
    target[-1] = 1.0
    weights, _ = nnls(stacked, target, maxiter=10_000)
    residual = stacked @ weights - target
    x: Array = centre - inverse @ residual[:-1] / residual[-1]
    return x


def test_robots_that_differ_in_their_heat_alone_share_compiled_programs() -> None:
    of = planned("paper-2")
    heater, limits = of.robot.heater, of.robot.limits
    warmer = heater.with_values(soft_setpoint_C=heater.soft_setpoint_C + 1.0)
    slower = limits.with_values(wheel_speed_rad_s=limits.wheel_speed_rad_s / 2)

    def compiled_for(robot: Robot) -> int:
        """How many programs are compiled when a tracker of this robot is given the plan."""
        before = tracking_program.cache_info().misses
        problem = of.problem.with_values(robot=robot)
        trajectory = dataclasses.replace(of.trajectory, problem=problem)
        Tracker(robot).reset(dataclasses.replace(of, trajectory=trajectory))
        return tracking_program.cache_info().misses - before

    tracking_program.cache_clear()
    modes = len({phase.mode for phase in of.phases})
    assert compiled_for(of.robot) == modes
    assert compiled_for(of.robot.with_values(name="another", heater=warmer)) == 0
    assert compiled_for(of.robot.with_values(limits=slower)) == modes


@pytest.mark.parametrize("mode", MODES)
def test_the_program_is_solved(mode: Mode) -> None:
    tight = SolverSettings(tolerance=1e-10, max_iterations=100_000)
    _, program = stepped(mode, solver=tight)
    assert np.abs(program.y).max() > 1e-3  # limits are active
    np.testing.assert_allclose(program.x, dense_solution(program), atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_residuals_are_within_the_tolerance(mode: Mode) -> None:
    tracker, program = stepped(mode)
    residuals = program.residuals()
    assert max(residuals.primal, residuals.dual) <= tracker.solver.tolerance
    worse = dataclasses.replace(program, x=program.x + 1.0, y=program.y + 1.0).residuals()
    assert worse.primal > 0.1
    assert worse.dual > 0.1


@pytest.mark.parametrize("mode", MODES)
def test_the_tolerance_bounds_the_error_of_the_first_speeds(mode: Mode) -> None:
    tracker, program = stepped(mode)
    rows = slice(
        0, outputs_of(tracker.robot.body, mode).count
    )  # the first limits of the first stage
    error = program.constraints @ (program.x - dense_solution(program))
    assert np.abs(error[rows]).max() < 10 * tracker.solver.tolerance


def speeds(setup: Setup, kappa: Array, bending: Array, y: Array, y_next: Array) -> Array:
    """Limited speeds over their limits by the midpoint rule, from the numerical kinematics.

    ``kappa`` are the curvatures for the outputs half way at the linearisation point (its further
    entries); ``bending`` how they change with the outputs. By the inputs that turn and bend alike,
    and, where the wheels determine the pose too, by the exact map of the whole motion.
    """
    compiled, outputs, limits = kinematics(setup.body), setup.outputs, setup.body.limits
    middle, step, count = (y + y_next) / 2, y_next - y, len(outputs.pose)
    q = np.concatenate([np.zeros(3), kappa[:2] + bending @ (middle - kappa[2:])])
    q[list(outputs.pose)] = middle[:count]
    inputs = list(INPUTS_OF[setup.mode == RIGID])
    jacobian = compiled.jacobian(q, setup.mode).full()[:, inputs]
    needed = outputs.selection[-len(inputs) :]
    u = np.linalg.solve(needed @ jacobian, step[-len(inputs) :]) / setup.period_s
    if outputs.count == WHEELS:
        c, s = math.cos(q[2]), math.sin(q[2])
        twist = [c * step[0] + s * step[1], c * step[1] - s * step[0], step[2]]
        motion = np.concatenate([twist, bending @ step])
        wheels = compiled.wheel_map(q[3:]).full() @ motion / setup.period_s
    else:
        wheels = compiled.wheel_matrix(q, setup.mode).full()[:, inputs] @ u
    wheels = wheels / limits.wheel_speed_rad_s
    if setup.mode == RIGID:
        return np.asarray(wheels)
    return np.concatenate([u / limits.unit_speed_m_s, wheels])


INPUTS_OF = (0, 1), (2, 3, 4)  # of a soft mode, of the rigid one


def bends(setup: Setup, kappa: Array) -> Array:
    """How both curvatures change with the outputs, (2, m)."""
    q, change = np.concatenate([np.zeros(3), kappa]), np.zeros((2, setup.outputs.count))
    if setup.mode != RIGID:
        jacobian = kinematics(setup.body).jacobian(q, setup.mode).full()[:, :2]
        change[:, -2:] = jacobian[3:] @ np.linalg.inv(setup.outputs.selection[-2:] @ jacobian)
    return change


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["2sra-v1-paper", "2sra-v1"])
def test_limits_are_linearised_exactly(mode: Mode, name: str) -> None:
    limits = TrackerLimits(wheel_rate_rad_s2=20.0)
    setup = Setup(load_robot(name).body, mode, 4, 1 / 15, TrackerWeights(), limits)
    program, outputs, n = tracking_program(setup), setup.outputs, setup.horizon
    rng = np.random.default_rng(7)
    m = outputs.count
    q = np.array([0.1, -0.2, 0.4, 12.0, -8.0])
    drift = outputs.selection @ [0.004, 0.003, 0.03, *(0.8 * np.array(mode))]
    reference = outputs.selection @ q + 0.3 * setup.scale + np.arange(n + 1)[:, None] * drift
    previous = rng.normal(size=setup.variables)
    wheels = rng.normal(size=4)
    values, lower, upper, _, expected = (
        item.full().ravel() for item in program.linearise(q, reference.T, previous, wheels, [])
    )
    matrix = program.constraints.copy()
    matrix.data = values
    guess = expected[m:]
    y = reference + setup.scale * expected[: m * (n + 1)].reshape(n + 1, m)
    np.testing.assert_allclose(y[0], outputs.selection @ q, atol=1e-12)

    def limited(y: Array, at: list[tuple[Array, Array]]) -> Array:
        stages = [speeds(setup, *at[k], y[k], y[k + 1]) for k in range(n)]
        turns = np.any(drives, axis=1)
        turning = turns if mode == RIGID else np.concatenate([[True, True], turns])
        last = wheels / setup.body.limits.wheel_speed_rad_s
        before = [last, *(stage[-4:] for stage in stages)]
        most = setup.wheel_change / setup.body.limits.wheel_speed_rad_s
        rates = [(stages[k][-4:] - before[k])[turns] / most for k in range(3)]
        kept = turning.copy()
        if mode != RIGID and name == "2sra-v1-paper":
            kept[2:] = False  # what the units' speeds bound already
        return np.concatenate([*(stage[kept] for stage in stages), *rates])

    drives = kinematics(setup.body).wheel_matrix(q, mode).full()[:, list(INPUTS_OF[mode == RIGID])]
    kappa, at = q[3:], []
    change = bends(setup, kappa)
    for k in range(n):
        half = kappa + change @ (y[k + 1] - y[k]) / 2
        change = bends(setup, half)
        at.append((np.concatenate([half, (y[k] + y[k + 1]) / 2]), change))
        kappa = kappa + change @ (y[k + 1] - y[k])

    two_sided = (lower > -1e20) & (upper < 1e20)
    half_width = ((upper - lower) / 2)[two_sided]
    middle = ((upper + lower) / 2)[two_sided] / half_width
    slopes = matrix.toarray()[two_sided] / half_width[:, None]
    np.testing.assert_allclose(slopes @ guess - middle, limited(y, at), atol=1e-9)
    for variable in range(m * n):
        k, output = divmod(variable, m)
        change_y = np.zeros_like(y)
        change_y[k + 1, output] = 1e-4 * setup.scale[output]
        difference = (limited(y + change_y, at) - limited(y - change_y, at)) / 2e-4
        np.testing.assert_allclose(slopes[:, variable], difference, atol=1e-6)


def test_the_pattern_never_changes() -> None:
    tracker, first = stepped(SOFT_1)
    scenario, phase = PHASES[SOFT_1]
    tracker.step(Measurement(planned(scenario).phases[phase].start_s, phase, np.full(5, 0.1)))
    second = tracker.quadratic_program()
    assert second is not None
    np.testing.assert_array_equal(first.constraints.indices, second.constraints.indices)
    np.testing.assert_array_equal(first.hessian.data, second.hessian.data)
    assert (first.constraints.data != second.constraints.data).any()


@pytest.mark.parametrize(
    ("scenario", "given"),
    [
        *((name, {}) for name in ("paper-1", "paper-2", "paper-4", "move-and-shape")),
        *(("paper-2", {"robot": with_path_model(ROBOT, model)}) for model in PATH_MODELS[1:]),
    ],
)
def test_every_phase_ends_where_the_plan_does(scenario: str, given: dict[str, Any]) -> None:
    of = planned(scenario, **given)
    tracker = Tracker(of.robot, **({"horizon": 6} if given else {}))
    tracker.reset(of)
    q = of.problem.start.configuration.copy()
    for i, phase in enumerate(of.phases):
        q = drive(tracker, of, i, q, rest_s=8.0 if given else 3.0)
        np.testing.assert_allclose(q, configuration(of, phase.end_s), atol=1e-4)


@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_a_mode_tracks_what_its_wheels_determine_whatever_the_number_of_segments(
    segments: int,
) -> None:
    robot = load_robot("2sra-v1")
    body = robot.with_values(geometry=robot.geometry.with_values(segments=segments)).body
    for mode in all_modes(segments):
        outputs = outputs_of(body, mode)
        assert outputs.count == 3 + any(mode)
        assert outputs.selection.shape == (outputs.count, 3 + segments)
        assert outputs.selection.sum(axis=1) == pytest.approx(1.0)  # coordinates, or a mean
        bending = np.flatnonzero(outputs.selection[-1, 3:])
        assert tuple(bending) == soft_segments(mode)
        assert outputs.selection[outputs.heading, 2] == 1.0
        assert np.linalg.matrix_rank(outputs.selection) == outputs.count


def test_each_mode_is_among_the_phases_above() -> None:
    scenarios = ("paper-1", "paper-2", "paper-4")
    assert {phase.mode for name in scenarios for phase in planned(name).phases} == set(MODES)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_rigid_phase_recovers_from_a_push(sign: int) -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    push = sign * np.array([0.005, -0.005, math.radians(3), 0.0, 0.0])
    q = drive(tracker, of, 0, configuration(of, 0.0) + push)
    np.testing.assert_allclose(q, configuration(of, of.phases[0].end_s), atol=1e-6)


def test_what_is_pushed_is_set_right_without_a_step_aside() -> None:
    """All twists stay in the cone, where without it the first leaves it, and the path is met."""
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    tasks: Any = [{"do": "follow", "path": [[0.0, 0.0], [0.0, 0.5]], "heading": 0.0}]
    made = plan(Problem(robot=ROBOT, start=start, tasks=tasks, gap=0.3)).require()  # type: ignore[arg-type]
    cone = pushing_cone(ROBOT.geometry, [0.0, 0.0], cube(0.06), [0.0, 0.0345, 0.0], 0.02)
    tracker, phase = Tracker(made.robot), made.phases[0]
    aside = made.trajectory.configuration([1.0])[0] + [0.008, 0.0, 0.0, 0.0, 0.0]

    def run(facets: Array) -> tuple[Array, Array]:
        tracker.reset(made)
        q, twists, time_s = aside, [], 1.0
        while time_s < phase.end_s:
            v = tracker.step(Measurement(time_s, 0, q, 1.0, facets)).v
            q, time_s = moved(tracker, phase.mode, q, v), time_s + tracker.period_s
            twists.append(v[2:])
        return q, np.array(twists)

    _, free = run(np.zeros((0, 3)))
    assert (cone.facets @ free[0]).max() > 0.001  # m/s aside
    end, held = run(cone.facets)
    assert (held @ cone.facets.T).max() < 2e-4
    assert abs(end[0]) < 5e-4


def test_small_deviations_decay_with_the_response_time() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    end = configuration(of, of.phases[0].end_s)
    q = end + np.array([1e-3, -5e-4, 0.01, 0.0, 0.0])
    before = (q - end)[:3]
    setup = Setup(of.robot.body, RIGID, 20, tracker.period_s, tracker.weights, tracker.limits)
    for _ in range(10):
        q = moved(tracker, RIGID, q, tracker.step(Measurement(100.0, 0, q)).v)
        np.testing.assert_allclose((q - end)[:3], setup.decay * before, rtol=1e-4)
        before = (q - end)[:3]
    assert setup.decay == pytest.approx(
        math.exp(-tracker.period_s / tracker.weights.response_s), rel=0.05
    )


@pytest.mark.parametrize("mode", MODES)
def test_without_active_limits_the_response_is_known_beforehand(mode: Mode) -> None:
    scenario, phase = PHASES[mode]
    of = planned(scenario)
    tracker = Tracker(of.robot, solver=SolverSettings(tolerance=1e-9))
    tracker.reset(of)
    setup = Setup(of.robot.body, mode, 20, tracker.period_s, tracker.weights, tracker.limits)
    m, n = setup.outputs.count, setup.horizon
    q = configuration(of, of.phases[phase].end_s) + 0.01 * DEVIATION
    for _ in range(2):
        command = tracker.step(Measurement(300.0, phase, q))
        program = tracker.quadratic_program()
        assert program is not None
        assert program.iterations == 5  # as few as can be: the linearisation point is the solution
        e = program.x[: m * n].reshape(n, m)
        np.testing.assert_allclose(e[1:], setup.decay * e[:-1], atol=1e-6)
        assert np.abs(e[0]).max() > 1e-3
        q = moved(tracker, mode, q, command.v)


def test_warm_starts_save_iterations() -> None:
    of = planned("paper-2", robot="2sra-v1-paper")
    warm, cold = Tracker(of.robot), Tracker(of.robot)
    warm.reset(of)
    q, spent = configuration(of, 0.0) + DEVIATION, {warm: 0, cold: 0}
    rng = np.random.default_rng(0)
    for k in range(25):
        measurement = Measurement(k * warm.period_s, 0, q + 0.1 * DEVIATION * rng.normal(size=5))
        cold.reset(of)
        command = warm.step(measurement)
        cold.step(measurement)
        for tracker in spent:
            program = tracker.quadratic_program()
            assert program is not None
            spent[tracker] += program.iterations
        q = moved(warm, RIGID, q, command.v)
    assert spent[warm] < 0.65 * spent[cold]


@pytest.mark.parametrize("mode", MODES)
def test_the_reference_is_the_path_of_the_plan(mode: Mode) -> None:
    scenario, index = PHASES[mode]
    of = planned(scenario)
    phase, samples, period_s, horizon = of.phases[index], of.samples, 1 / 15, 4
    selection = outputs_of(of.robot.body, mode).selection
    path = PhaseReference(of.trajectory, phase, selection, horizon, period_s)
    flow = interval_flow(of.robot, 16)
    found = np.zeros((horizon + 1, len(selection)))
    tolerance = selection @ np.array([1e-5, 1e-5, 1e-4, 5e-3, 5e-3])
    last_part_s = phase.end_s - period_s / 8  # here the reference rounds the stop off
    for time_s in np.random.default_rng(0).uniform(phase.start_s - 0.5, phase.end_s + 0.5, 40):
        path.write(time_s, found)
        for k in range(horizon + 1):
            t = min(max(time_s + k * period_s, phase.start_s), phase.end_s)
            if last_part_s < t < phase.end_s:
                continue
            at = int(np.searchsorted(samples.t_s, t + 1e-6, side="right")) - 1
            elapsed = max(t - samples.t_s[at], 0.0)
            travel = samples.v[at] * elapsed + samples.a[at] * elapsed**2 / 2
            q = flow(samples.q[at], travel, mode).full().ravel()
            assert (np.abs(found[k] - selection @ q) <= tolerance).all()
    path.write(-1e300, found)
    np.testing.assert_allclose(found, [selection @ configuration(of, phase.start_s)] * 5)
    path.write(1e300, found)
    np.testing.assert_allclose(found, [selection @ configuration(of, phase.end_s)] * 5, atol=1e-7)


def test_headings_count_modulo_full_turns() -> None:
    of = planned("paper-2")
    commands = []
    for turns in (0, 1, -3):
        tracker = Tracker(of.robot)
        tracker.reset(of)
        q = configuration(of, 0.0) + DEVIATION + np.array([0, 0, turns * math.tau, 0, 0])
        commands.append(tracker.step(Measurement(0.5, 0, q)).wheel_rad_s)
    np.testing.assert_allclose(commands[1:], [commands[0]] * 2, atol=1e-9)


def test_a_far_robot_drives_at_its_limit_and_arrives() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    end = configuration(of, of.phases[0].end_s)
    q, fastest = end + np.array([0.3, -0.2, 2.5, 0.0, 0.0]), 0.0
    for _ in range(400):
        command = tracker.step(Measurement(100.0, 0, q))
        fastest = max(fastest, np.abs(command.wheel_rad_s).max())
        q = moved(tracker, RIGID, q, command.v)
    np.testing.assert_allclose(q, end, atol=1e-5)
    assert fastest > 0.99 * of.robot.limits.wheel_speed_rad_s


def test_the_robots_own_wheel_acceleration_is_kept() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    q, most = configuration(of, 0.0) + 3 * DEVIATION, of.robot.limits.wheel_acceleration_rad_s2
    assert most is not None
    changes = []
    for _ in range(20):
        before = tracker.last_command.wheel_rad_s
        command = tracker.step(Measurement(0.0, 0, q))
        changes.append(np.abs(command.wheel_rad_s - before).max())
        q = moved(tracker, RIGID, q, command.v)
    assert max(changes) == pytest.approx(most * tracker.period_s, rel=1e-2)
    assert max(changes) <= most * tracker.period_s + OUT_OF_BOUNDS


def test_a_soft_phase_gives_way_to_a_heading_far_off() -> None:
    """A heading that a rigid drive can correct does not use up the speed there is for bending."""
    of = planned("paper-2")
    end = configuration(of, of.phases[1].end_s)
    bent = []
    for turned in (0.0, 1.5):
        tracker, q = Tracker(of.robot), end + np.array([0.0, 0.0, turned, -8.0, 0.0])
        tracker.reset(of)
        for _ in range(30):
            q = moved(tracker, SOFT_1, q, tracker.step(Measurement(200.0, 1, q)).v)
        bent.append(q[3] - end[3] + 8.0)
    assert bent[1] > 0.5 * bent[0] > 0.0


def test_wheels_turn_as_the_input_asks() -> None:
    of = planned("paper-4")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    for i, phase in enumerate(of.phases):
        q = configuration(of, phase.start_s)
        tracker.step(Measurement(phase.start_s, None, q))
        for k in range(8):
            command = tracker.step(Measurement(phase.start_s + k * tracker.period_s, i, q))
            middle = (q + moved(tracker, phase.mode, q, command.v)) / 2
            wheels = kinematics(of.robot).wheel_matrix(middle, phase.mode).full() @ command.v
            np.testing.assert_allclose(command.wheel_rad_s, wheels, atol=0.02)
            q = moved(tracker, phase.mode, q, command.v)


@pytest.mark.parametrize(("segment", "side"), [(0, -1), (1, 1)])
def test_curvature_limits_are_kept_where_they_can_be_and_bent_where_not(
    segment: int, side: int
) -> None:
    """Of a segment that meets nothing there; the other is bent the other way."""
    shape, bent = np.full(2, -side * 10.0), 3 + segment
    begin, curled = (np.where([segment == 0, segment == 1], side * k, shape) for k in (45.0, 60.0))
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=tuple(begin))
    goal = Goal(kappa_per_m=tuple(curled))
    given = {"wheel_acceleration_rad_s2": None, "curvature_per_m": 60.0}
    robot = ROBOT.with_values(limits=ROBOT.limits.with_values(**given))  # the tracker's rate counts
    of = plan(Problem(robot=robot, start=start, goal=goal)).require()
    index, phase, limit = len(of.phases) - 1, of.phases[-1], of.robot.limits.curvature_per_m
    tracker = Tracker(of.robot)
    tracker.reset(of)
    q = configuration(of, phase.start_s)
    q[bent] += side * 2.0
    for k in range(30):
        time_s = phase.start_s + k * tracker.period_s
        command = tracker.step(Measurement(time_s, index, q))
        assert command.status is CommandStatus.SOLVED
        program = tracker.quadratic_program()
        assert program is not None
        assert abs(program.x[-1]) < 0.01  # the slack
        q = moved(tracker, phase.mode, q, command.v)
        assert abs(q[bent]) < limit + 0.01
    q[bent] = side * (limit + 3.0)
    for rate, slow in ((100.0, False), (2.0, True)):  # back within the limit at once, or not
        patient = SolverSettings(max_iterations=2_000)
        limits = TrackerLimits(wheel_rate_rad_s2=rate)
        tracker = Tracker(of.robot, limits=limits, solver=patient)
        tracker.reset(of)
        q[bent] = side * (limit + 3.0)
        for k in range(30):
            command = tracker.step(Measurement(100.0, index, q))
            assert command.status is CommandStatus.SOLVED
            program = tracker.quadratic_program()
            assert program is not None
            if k == 0 or k >= 10:  # in between it comes back
                assert (program.x[-1] > 0.1) == (slow and k == 0)
            q = moved(tracker, phase.mode, q, command.v)
        assert abs(q[bent]) < limit + 0.01


@pytest.mark.parametrize("mode", [SOFT_1, SOFT_2, SOFT_BOTH])
@pytest.mark.parametrize("kappa", [-1e300, -1e4, -100.0, 100.0, 1e4, 1e300])
def test_a_curvature_out_of_all_bounds_is_still_bent_back(mode: Mode, kappa: float) -> None:
    scenario, phase = PHASES[mode]
    of = planned(scenario)
    tracker = Tracker(of.robot)
    tracker.reset(of)
    q = configuration(of, of.phases[phase].end_s)
    moving = list(outputs_of(of.robot.body, mode).bending)
    q[moving] = kappa
    command = tracker.step(Measurement(300.0, phase, q))
    assert command.status is CommandStatus.SOLVED
    assert np.sign(command.v[:2].sum()) == -np.sign(kappa)


ABSURD = (1e-300, 1.0, 50.0, 1e4, 1e12, 1e300, 1.7e308)


def check(command: Command, before: Command, tracker: Tracker) -> None:
    """No command is beyond a limit of the robot or of its drives, or not a number."""
    limits = tracker.robot.limits
    for array in (command.wheel_rad_s, command.v, command.heater_setpoint_C):
        assert np.isfinite(array).all()
        assert not array.flags.writeable
    wheels = command.wheel_rad_s
    assert np.abs(wheels).max() <= limits.wheel_speed_rad_s + OUT_OF_BOUNDS
    assert np.abs(command.v[:2]).max() <= limits.unit_speed_m_s + OUT_OF_BOUNDS
    if command.status is CommandStatus.SOLVED:
        change = np.abs(wheels - before.wheel_rad_s).max()
        most = tracker.limits.wheel_rate_rad_s2 * tracker.period_s
        assert change <= most + OUT_OF_BOUNDS
    else:
        assert not wheels.any()


def resident_bytes() -> int:
    """Memory of the process, C++ included; zero where the system does not tell."""
    status = Path("/proc/self/statm")
    return int(status.read_text().split()[1]) * 4096 if status.exists() else 0


def test_many_steps_whatever_is_measured() -> None:
    of = planned("paper-1")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    rng = np.random.default_rng(3)
    phases = [None, *range(len(of.phases))]
    statuses = set()

    def run(steps: int) -> None:
        for k in range(steps):
            if k % 50 == 0:
                phase = phases[rng.integers(len(phases))]
            q = of.samples.q[rng.integers(len(of.samples))] + rng.normal(size=5) * DEVIATION
            if rng.random() < 0.3:
                q = rng.uniform(-1, 1, 5) * rng.choice(ABSURD, 5)
            time_s = float(rng.choice([rng.uniform(0, 110), -1e300, 1e18, 1.7e308]))
            before = tracker.last_command
            command = tracker.step(Measurement(time_s, phase, q))
            check(command, before, tracker)
            assert tracker.last_command is command
            statuses.add(command.status)

    run(200)
    gc.collect()
    resident = resident_bytes()
    run(500)
    assert resident_bytes() - resident < 1_200_000
    tracemalloc.start()
    run(50)
    gc.collect()
    traced, _ = tracemalloc.get_traced_memory()
    run(150)
    gc.collect()
    assert tracemalloc.get_traced_memory()[0] - traced < 9_000
    tracemalloc.stop()
    assert CommandStatus.SOLVED in statuses
    assert CommandStatus.HELD in statuses


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("q", {"q": [0.0, 0.0, math.nan, 0.0, 0.0]}),
        ("q", {"q": [0.0, 0.0, 0.0, -math.inf, 0.0]}),
        ("q", {"q": np.zeros(4)}),
        ("q", {"q": np.zeros((1, 5))}),
        ("q", {"q": None}),
        ("q", {"q": ["x"] * 5}),
        ("time_s", {"time_s": math.nan}),
        ("time_s", {"time_s": "soon"}),
        ("phase", {"phase": 0.5}),
    ],
)
def test_bad_measurements_are_refused_by_name(field: str, values: dict[str, Any]) -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    command = tracker.step(Measurement(0.5, 0, configuration(of, 0.0)))
    with pytest.raises(InputError) as caught:
        tracker.step(Measurement(**{"time_s": 0.5, "phase": 0, "q": np.zeros(5), **values}))
    assert caught.value.field.removeprefix("measurement.") == field
    assert tracker.last_command is command
    assert command.wheel_rad_s.any()


def test_what_does_not_fit_together_is_refused_by_name() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    measurement = Measurement(0.0, 0, np.zeros(5))
    with pytest.raises(InputError, match="plan = None"):
        tracker.step(measurement)
    with pytest.raises(InputError, match=r"plan\.robot"):
        Tracker(with_path_model(of.robot, "log_spiral_corrected")).reset(of)
    spoilt = of.samples.q.copy()
    spoilt[3, 1] = np.nan
    samples = dataclasses.replace(of.samples, q=spoilt)
    spoilt_one = dataclasses.replace(of.trajectory, samples=samples)
    with pytest.raises(InputError, match=r"plan\.samples\.q"):
        tracker.reset(dataclasses.replace(of, trajectory=spoilt_one))
    tracker.reset(of)
    for phase in (-1, len(of.phases)):
        with pytest.raises(InputError, match=r"measurement\.phase"):
            tracker.step(dataclasses.replace(measurement, phase=phase))
    assert not tracker.last_command.wheel_rad_s.any()


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("horizon", {"horizon": 1}),
        ("horizon", {"horizon": 7.5}),
        ("rate_Hz", {"rate_Hz": 0.0}),
        ("rate_Hz", {"rate_Hz": math.nan}),
    ],
)
def test_bad_settings_are_refused_by_name(field: str, values: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        Tracker(ROBOT, **values)
    assert caught.value.field == field


def test_without_a_solution_the_wheels_stop_and_the_heaters_hold() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot, solver=SolverSettings(max_iterations=1))
    tracker.reset(of)
    start = configuration(of, 0.0)
    end = configuration(of, of.phases[0].end_s)
    driving = tracker.step(Measurement(30.0, 0, end + np.array([1e-3, 0.0, 0.0, 0.0, 0.0])))
    assert driving.status is CommandStatus.SOLVED
    assert driving.wheel_rad_s.any()
    off = of.phases[1].end_s  # by now the plan has switched the heater off
    failed = tracker.step(Measurement(off, 0, start + np.array([0.5, -0.5, 1.0, 0.0, 0.0])))
    assert failed.status is CommandStatus.FAILED
    assert not failed.wheel_rad_s.any()
    assert not failed.v.any()
    np.testing.assert_array_equal(failed.heater_setpoint_C, driving.heater_setpoint_C)
    assert "iterations" in failed.message
    held = tracker.step(Measurement(off, None, start))
    assert (held.heater_setpoint_C != failed.heater_setpoint_C).any()
    assert held.status is CommandStatus.HELD
    assert not held.wheel_rad_s.any()


def test_a_failure_is_overcome_by_iterating_on() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot, solver=SolverSettings(max_iterations=10))
    tracker.reset(of)
    q = configuration(of, 0.0) + np.array([0.5, -0.5, 1.0, 0.0, 0.0])
    statuses = [tracker.step(Measurement(100.0, 0, q)).status for _ in range(60)]
    assert statuses[0] is CommandStatus.FAILED
    assert statuses[-1] is CommandStatus.SOLVED


def test_heaters_follow_the_plan() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    samples = of.samples
    for time_s in (-1.0, 0.0, 30.0, *samples.t_s, 1e6):
        at = max(int(np.searchsorted(samples.t_s, time_s, side="right")) - 1, 0)
        command = tracker.step(Measurement(time_s, None, np.zeros(5)))
        np.testing.assert_array_equal(command.heater_setpoint_C, samples.heater_setpoint_C[at])


def test_two_trackers_do_not_disturb_each_other() -> None:
    of = planned("paper-2")

    def commands(trackers: list[Tracker]) -> list[Array]:
        for tracker in trackers:
            tracker.reset(of)
        q, found = configuration(of, 0.0) + DEVIATION, []
        for k in range(10):
            for i, tracker in enumerate(trackers):
                at = q + i * np.array([0.01, 0.0, 0.0, 0.0, 0.0])
                command = tracker.step(Measurement(k * tracker.period_s, 0, at))
                if i == 0:
                    found.append(command.wheel_rad_s)
        return found

    alone = commands([Tracker(of.robot)])
    together = commands([Tracker(of.robot), Tracker(of.robot)])
    np.testing.assert_array_equal(alone, together)


def test_fast_wheels_are_stopped_between_phases() -> None:
    of = planned("paper-2")
    tracker = Tracker(of.robot)
    tracker.reset(of)
    later_s = of.phases[1].end_s  # by now the plan has switched the heater off
    q = configuration(of, of.phases[1].start_s)
    fast = [tracker.step(Measurement(0.5, 0, q)) for _ in range(3)][-1]
    most = of.robot.limits.wheel_acceleration_rad_s2
    assert most is not None
    assert np.abs(fast.wheel_rad_s).max() > most * tracker.period_s
    stopped = tracker.step(Measurement(later_s, 1, q))
    assert stopped.status is CommandStatus.HELD
    assert not stopped.wheel_rad_s.any()
    assert (stopped.heater_setpoint_C != fast.heater_setpoint_C).any()
    moving = tracker.step(Measurement(later_s, 1, q))
    assert moving.status is CommandStatus.SOLVED
    assert moving.wheel_rad_s.any()


def test_a_phase_begins_without_memory_of_another_run() -> None:
    of = planned("paper-2")
    fresh, used = Tracker(of.robot), Tracker(of.robot)
    fresh.reset(of)
    used.reset(of)
    q = configuration(of, 0.0)
    for k in range(5):
        used.step(Measurement(1.0 + k * used.period_s, 0, q - 3 * DEVIATION))
    used.step(Measurement(0.0, None, q))
    commands = [
        tracker.step(Measurement(0.5, 0, q + DEVIATION)).wheel_rad_s for tracker in (fresh, used)
    ]
    np.testing.assert_array_equal(*commands)
