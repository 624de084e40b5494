"""The simulated robot: undisturbed it is the model, disturbed it is what its level says."""

from __future__ import annotations

import itertools
import math
from dataclasses import fields

import numpy as np
import pytest
from once import planned

from twosra_mpc import InputError, Problem, load_problem, load_robot
from twosra_mpc.control.heated_segment import HeatedSegment
from twosra_mpc.control.stiffness import stiffness_controller, warm_setpoint_C
from twosra_mpc.control.thermistor import temperature_sensor
from twosra_mpc.execution.robot_interface import Camera
from twosra_mpc.execution.simulation.disturbance import LEVELS, Disturbance
from twosra_mpc.execution.simulation.plant import PLANTS, SimulatedRobot, plant_robot
from twosra_mpc.model.flow import drive, interval_flow
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.rolling import NO_DRIFT, Drift, rolling
from twosra_mpc.robot.coordinates import Coordinates
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH
from twosra_mpc.thermal.lumped import Lumped

ARC = "2sra-v1"
COLD = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [10.0, -5.0]}
HOT = {
    "x_m": 0.0,
    "y_m": 0.0,
    "phi_rad": 0.3,
    "kappa_per_m": [20.0, -10.0],
    "temperature_C": [66.0, 66.0],
}
SOFT_C, WARM_C, OFF_C = 65.0, 44.0, 25.0


def problem(**overrides: object) -> Problem:
    return load_problem("paper-1", robot=ARC, **overrides)


def undisturbed(**overrides: object) -> SimulatedRobot:
    return SimulatedRobot(problem(**overrides), "as-planned")


def set_point(first_C: float, second_C: float | None = None) -> np.ndarray:
    return np.array([first_C, first_C if second_C is None else second_C])


# --- motion --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [ARC, "2sra-v1-paper", "2sr-v2"])
@pytest.mark.parametrize("mode", [RIGID, SOFT_1, SOFT_2, SOFT_BOTH])
def test_wheels_that_agree_move_the_robot_as_the_model_says(
    name: str, mode: tuple[int, int]
) -> None:
    robot = load_problem("paper-1", robot=name, goal={"x_m": 0.0}, start=COLD).robot
    q = np.array([0.1, -0.2, 0.4, 12.0, -7.0])
    v = (
        np.array([0.0, 0.0, 0.05, -0.03, 0.4])
        if mode == RIGID
        else np.array([0.02, -0.01, 0, 0, 0])
    )
    pieces = 200
    believed, rolled = q, q
    flow = interval_flow(robot, 4)
    for _ in range(pieces):
        half = flow(believed, v / pieces / 2 * 0.5, mode).full().ravel()
        turned = kinematics(robot).wheel_matrix(half, mode).full() @ v / pieces * 0.5
        believed = flow(believed, v / pieces * 0.5, mode).full().ravel()
        rolled = rolling(robot, mode)(rolled, turned, NO_DRIFT).full().ravel()
    assert np.abs(rolled - q).max() > 1e-3
    assert rolled == pytest.approx(believed, abs=2e-6)


def test_a_plan_replayed_by_its_wheels_ends_where_it_should() -> None:
    made = planned("paper-1", robot=ARC)
    samples, robot = made.trajectory.held(), made.robot
    flow, q, pieces = interval_flow(robot, 8), samples.q[0], 8
    for i in np.flatnonzero(samples.v[:-1].any(axis=1)):
        mode = tuple(samples.mode[i].tolist())
        travel = samples.v[i] * (samples.t_s[i + 1] - samples.t_s[i]) / pieces
        for _ in range(pieces):
            half = flow(q, travel / 2, mode).full().ravel()
            turned = kinematics(robot).wheel_matrix(half, mode).full() @ travel
            q = rolling(robot, mode)(q, turned, NO_DRIFT).full().ravel()
    assert q == pytest.approx(samples.q[-1], abs=1e-4)


def test_rigid_wheels_roll_a_screw_whatever_the_step() -> None:
    robot, q = problem().robot, np.array([0.1, 0.0, 0.2, 10.0, -5.0])
    s = np.array([0.02, -0.01, 0.15])
    turned = kinematics(robot).wheel_matrix(q, RIGID).full()[:, 2:] @ s
    rolled = rolling(robot, RIGID)(q, turned, NO_DRIFT).full().ravel()
    assert rolled == pytest.approx(drive(q, s[None])[0], abs=1e-7)


def test_wheels_that_disagree_move_the_robot_less_than_either_wants() -> None:
    robot, q = problem().robot, np.array([0.0, 0.0, 0.0, 5.0, 5.0])
    along = kinematics(robot).wheel_matrix(q, RIGID).full()[:, 2]
    blocked = along.copy()
    blocked[int(np.abs(along).argmax())] = 0.0
    free = rolling(robot, RIGID)(q, 0.1 * along, NO_DRIFT).full().ravel()
    held = rolling(robot, RIGID)(q, 0.1 * blocked, NO_DRIFT).full().ravel()
    assert 0.0 < np.hypot(*(held - q)[:2]) < np.hypot(*(free - q)[:2])


def test_what_the_model_does_not_know_is_turn_and_shift_per_bend() -> None:
    robot, q = problem().robot, np.array([0.0, 0.0, 0.3, 20.0, -10.0])
    turned = kinematics(robot).wheel_matrix(q, SOFT_2).full() @ [2e-3, 0.0, 0.0, 0.0, 0.0]
    still = rolling(robot, SOFT_2)(q, turned, NO_DRIFT).full().ravel()
    drifted = rolling(robot, SOFT_2)(q, turned, Drift(0.2, 0.01, 0.0)).full().ravel()
    bend = robot.geometry.lengths_m[1] * (drifted[4] - q[4])
    assert abs(bend) > 0.01
    assert drifted[2] - still[2] == pytest.approx(0.2 * bend, rel=1e-3)
    across = [-math.sin(0.3), math.cos(0.3)]
    assert (drifted - still)[:2] @ across == pytest.approx(0.01 * bend, rel=0.02)


def test_four_wheels_correct_the_pose_while_the_fibre_bends() -> None:
    """By the exact map, and as far as they do not slip."""
    robot, q = load_robot("2sra-v1"), np.array([0.1, 0.0, 0.3, 10.0, -12.0])
    moves = np.array([2e-3, -1e-3, 0.02, 0.5])  # of b0 in its own frame, of segment 2
    turned = kinematics(robot).wheel_map(q[3:]).full()[:, [0, 1, 2, 4]] @ moves
    after = rolling(robot, SOFT_2)(q, turned, NO_DRIFT).full().ravel() - q
    c, s = math.cos(0.3), math.sin(0.3)
    expected = [c * 2e-3 + s * 1e-3, s * 2e-3 - c * 1e-3, 0.02, 0.0, 0.5]
    assert after == pytest.approx(expected, rel=0.05, abs=1e-4)


def test_unequal_bending_keeps_the_mean() -> None:
    robot, q = problem().robot, np.array([0.0, 0.0, 0.0, 20.0, -10.0])
    turned = np.array([0.2, 0.0, -0.1, 0.0])
    equal = rolling(robot, SOFT_BOTH)(q, turned, NO_DRIFT).full().ravel() - q
    split = rolling(robot, SOFT_BOTH)(q, turned, Drift(0.0, 0.0, 0.1)).full().ravel() - q
    assert equal[3] == pytest.approx(equal[4])
    assert split[3] / split[4] == pytest.approx(1.1 / 0.9, rel=1e-6)


def test_the_dead_zone_swallows_slow_commands() -> None:
    robot = SimulatedRobot(problem(), "as-planned", Disturbance(dead_zone_rad_s=0.2))
    before = robot.q
    robot.send(np.full(4, 0.19), set_point(OFF_C))
    robot.wait(1.0)
    assert (robot.q == before).all()
    robot.send(np.full(4, 0.21), set_point(OFF_C))
    robot.wait(0.05)
    assert (robot.q != before).any()


def test_slip_makes_ways_shorter() -> None:
    slipping = SimulatedRobot(problem(), "as-planned", Disturbance(slip=0.1))
    firm = undisturbed()
    travelled = []
    for robot in (firm, slipping):
        before = robot.q
        wheels = kinematics(robot.robot).wheel_matrix(before, RIGID).full()[:, 2] * 0.02
        robot.send(wheels, set_point(OFF_C))
        for _ in range(10):
            robot.wait(0.05)
        travelled.append(np.hypot(*(robot.q - before)[:2]))
    assert travelled[1] / travelled[0] == pytest.approx(0.9, abs=1e-6)


def test_metal_that_is_changing_does_not_bend_and_is_noticed() -> None:
    robot = undisturbed()
    robot.send(np.zeros(4), set_point(SOFT_C))
    while not 0.2 < robot.segments[0].melt_fraction < 0.8:
        robot.wait(1.0)
    before = robot.q
    robot.send(np.array([3.0, 0.0, -3.0, 0.0]), set_point(SOFT_C))
    for _ in range(5):
        robot.wait(0.05)
    assert robot.q[3:] == pytest.approx(before[3:], abs=1e-12)
    assert robot.truth().forced_s[-1] == pytest.approx(5 / 15)


# --- heat ----------------------------------------------------------------------------------------


def test_the_heat_of_the_coil_is_stored_or_lost() -> None:
    robot = SimulatedRobot(problem(), "arc", LEVELS["moderate"], seed=3)
    for setpoint_C, seconds in ((SOFT_C, 120), (OFF_C, 200)):
        robot.send(np.zeros(4), set_point(setpoint_C))
        for _ in range(5 * seconds):
            robot.wait(0.2)
    truth = robot.truth()
    for j, segment in enumerate(robot.segments):
        model = segment.model
        assert isinstance(model, Lumped)
        stored = segment.state[0] - model.level_at(25.0)
        lost = model.loss_W_per_K * np.trapezoid(truth.temperature_C[:, j] - 25.0, truth.time_s)
        assert truth.heat_J[-1, j] == pytest.approx(stored + lost, rel=2e-3)
        assert truth.heat_J[-1, j] > 200


def test_long_waits_are_many_short_ones() -> None:
    robots = [undisturbed(), undisturbed()]
    for robot, step_s in zip(robots, (0.2, 5.0), strict=True):
        robot.send(np.zeros(4), set_point(SOFT_C))
        while robot.time_s < 10.0 - 1e-9:
            robot.wait(step_s)
    one, other = (robot.truth() for robot in robots)
    assert one.temperature_C[-1] == pytest.approx(other.temperature_C[-1], abs=1e-9)
    assert one.heat_J[-1] == pytest.approx(other.heat_J[-1], abs=1e-9)


def test_a_wait_ends_when_a_segment_has_changed() -> None:
    robot = undisturbed()
    robot.send(np.zeros(4), set_point(SOFT_C, OFF_C))
    told = []
    while robot.read().stiffness[0] != "soft":
        robot.wait(1000.0)
        told.append(robot.read().stiffness[0])
        assert robot.time_s < 200
    assert told == ["changing", "soft"]
    assert robot.segments[0].soft
    assert robot.mode == SOFT_1


@pytest.mark.parametrize("seed", range(4))
def test_a_segment_that_is_kept_warm_never_melts(seed: int) -> None:
    robot = SimulatedRobot(problem(), "arc", LEVELS["moderate"], seed)
    robot.send(np.zeros(4), set_point(warm_setpoint_C(problem().robot, problem().ambient)))
    robot.wait(240.0)
    truth = robot.truth()
    assert not truth.melt_fraction.any()
    assert truth.temperature_C[-1].min() > 35.0
    assert robot.read().stiffness == ("rigid", "rigid")


def test_a_broken_heater_stays_cold_and_is_reported() -> None:
    robot = SimulatedRobot(problem(), "arc", LEVELS["mild"], broken_heaters=[2])
    robot.send(np.zeros(4), set_point(SOFT_C))
    while robot.time_s < 40.0:
        robot.wait(5.0)
    assert robot.read().faulty == (False, True)
    assert robot.segments[1].temperature_C == pytest.approx(25.0, abs=0.1)
    assert robot.truth().heat_J[-1, 1] == 0.0


def test_a_range_of_no_width_is_the_nominal_model() -> None:
    robot = problem().robot
    nominal = segment_model(robot, robot.heater.ambient_C, 0)
    assert [segment.model for segment in undisturbed().segments] == [nominal, nominal]
    drawn = SimulatedRobot(problem(), "arc", LEVELS["moderate"], 1).segments
    assert drawn[0].model != drawn[1].model != nominal


# --- camera --------------------------------------------------------------------------------------


def test_an_undisturbed_camera_tells_the_truth_at_once() -> None:
    robot = undisturbed()
    robot.read()
    robot.send(np.full(4, 2.0), set_point(OFF_C))
    robot.wait(0.01)
    reading = robot.read()
    assert reading.taken_s.tolist() == [reading.time_s]
    assert (reading.frames[0] == robot.q).all()


def test_frames_are_late_noisy_and_rounded() -> None:
    camera = Camera(noise=(1e-3, 0.02, 1.0), step=(1e-3, 0.02, 1.0))
    robot = SimulatedRobot(problem(), "arc", Disturbance(camera=camera, delay_frames=(2, 2)), 5)
    assert not len(robot.read().frames)
    robot.wait(400.0)
    reading = robot.read()
    assert reading.time_s - reading.taken_s[-1] == pytest.approx(2 / 15)
    assert np.diff(reading.taken_s) == pytest.approx(1 / 15)
    two = Coordinates(2)
    steps = reading.frames / two.each(*camera.step)
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    count = len(reading.frames)
    assert count == 400 * 15 + 1 - 2
    spread = reading.frames.std(axis=0)
    assert spread == pytest.approx(np.sqrt(camera.variance(two)), rel=0.05)
    mean = reading.frames.mean(axis=0) - robot.q
    assert (np.abs(mean) < 4 * np.sqrt(camera.variance(two) / count)).all()


# --- drawing -------------------------------------------------------------------------------------


def run_a_little(seed: int) -> SimulatedRobot:
    robot = SimulatedRobot(problem(), "arc", LEVELS["hard"], seed)
    robot.send(np.array([3.0, -2.0, 1.0, 2.0]), set_point(SOFT_C))
    for _ in range(20):
        robot.wait(0.05)
    return robot


def test_a_seed_is_a_robot() -> None:
    one, same, other = run_a_little(1), run_a_little(1), run_a_little(2)
    assert (one.truth().q == same.truth().q).all()
    assert (one.read().frames == same.read().frames).all()
    assert (one.truth().temperature_C == same.truth().temperature_C).all()
    assert (one.q != other.q).any()


def test_levels_grow() -> None:
    not_sizes = ("camera", "delay_frames", "bend_share")
    sizes = [item.name for item in fields(Disturbance) if item.name not in not_sizes]
    levels = list(LEVELS.values())
    assert list(LEVELS) == ["none", "mild", "moderate", "hard"]
    assert levels[0] == Disturbance()
    for milder, harder in itertools.pairwise(levels):
        assert all(getattr(milder, name) <= getattr(harder, name) for name in sizes)
        assert milder.bend_share[0] >= harder.bend_share[0]
        assert milder != harder


def test_motors_follow_with_a_lag_and_lose_no_travel() -> None:
    def reached(lag_s: float, waits: int) -> np.ndarray:
        robot = SimulatedRobot(problem(), "arc", Disturbance(motor_lag_s=lag_s))
        turning = kinematics(robot.robot).wheel_matrix(robot.q, RIGID).full()[:, 2] * 0.02
        robot.send(turning, set_point(OFF_C))
        robot.wait(3 / robot.camera.rate_Hz)
        robot.send(np.zeros(4), set_point(OFF_C))
        for _ in range(waits):
            robot.wait(1 / robot.camera.rate_Hz)
        return robot.q - problem().start.configuration

    at_once, late = reached(0.0, 1), reached(0.1, 1)
    assert np.hypot(*late[:2]) < 0.9 * np.hypot(*at_once[:2])
    assert reached(0.1, 15) == pytest.approx(at_once, abs=2e-5)


def test_a_soft_phase_reaches_its_share_of_the_bend() -> None:
    def bent(share: float) -> float:
        robot = SimulatedRobot(problem(start=HOT), "arc", Disturbance(bend_share=(share, share)))
        before = robot.q.copy()
        robot.send(np.array([0.5, 0.0, -0.5, 0.0]), set_point(SOFT_C))
        robot.wait(1 / robot.camera.rate_Hz)
        return float((robot.q - before)[3])

    assert bent(0.3) == pytest.approx(0.3 * bent(1.0), rel=1e-2)


def test_lengths_are_drawn_about_the_robots() -> None:
    robot = SimulatedRobot(problem(), "arc", Disturbance(lengths=0.01), 2)
    wheels = kinematics(robot.robot).wheel_matrix(robot.q, RIGID).full()[:, 2] * 0.02
    exact = undisturbed()
    for each in (robot, exact):
        each.send(wheels, set_point(OFF_C))
        each.wait(0.05)
    off = np.hypot(*(robot.q - exact.q)[:2]) / np.hypot(
        *(exact.q - problem().start.configuration)[:2]
    )
    assert 1e-4 < off < 0.06


# --- bad input -----------------------------------------------------------------------------------


def test_a_robot_without_a_description_of_its_segments_is_refused() -> None:
    whole = problem(timing="constant")
    timing = {"constant": whole.robot.timing["constant"]}
    bare = whole.robot.with_values(segment=None, timing=timing)
    with pytest.raises(InputError, match="segment"):
        SimulatedRobot(whole.with_values(robot=bare))


@pytest.mark.parametrize("plant", PLANTS)
def test_every_plant_is_the_same_robot_with_other_paths(plant: str) -> None:
    robot = problem().robot
    true = plant_robot(robot, plant)
    assert true.geometry == robot.geometry
    assert true.path.model == ("arc" if plant == "as-planned" else plant)


def test_a_start_above_the_melting_point_is_soft() -> None:
    robot = undisturbed(start=HOT)
    assert robot.mode == SOFT_BOTH
    assert robot.read().stiffness == ("soft", "soft")
    assert math.isclose(robot.segments[0].measured_C, 66.0, abs_tol=0.1)


# --- the plan's heating is the controllers' ------------------------------------------------------


@pytest.mark.parametrize("name", ["paper-1", "paper-2", "paper-5"])
def test_set_points_played_at_plan_times_melt_and_freeze_what_the_plan_says(name: str) -> None:
    made, step_s = planned(name), 0.1
    at_s = np.arange(0.0, made.duration_s + step_s, step_s)
    setpoint_C = made.trajectory.heater_setpoint_C(at_s)
    for j in range(2):
        segment = HeatedSegment(
            model=segment_model(made.robot, made.problem.ambient, j),
            sensor=temperature_sensor(made.robot, made.problem.ambient, j),
            controller=stiffness_controller(made.robot, made.problem.ambient, j),
            start_C=made.problem.temperatures[j],
            noise=np.random.default_rng(0).standard_normal,
            rigid_setpoint_C=made.robot.heater.rigid_setpoint_C,
        )
        molten = []
        for each_C in setpoint_C[:, j].tolist():
            molten.append(segment.melt_fraction)
            segment.advance(each_C, step_s)
        for phase in made.phases:
            during = np.array(molten)[(at_s > phase.start_s) & (at_s < phase.end_s)]
            assert (during > 0.99 if phase.mode[j] else during < 0.01).all()
        assert molten[-1] < 0.01  # every segment is rigid at the end
