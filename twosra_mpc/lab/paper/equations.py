"""The paper's equations held against geometry: what each one says, and what the same geometry says.

Everything here is computed from the robot's lengths alone; no log is needed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twosra_mpc import kinematics, load_problem, load_robot, plan, robot_shape
from twosra_mpc.control.thermistor import NtcDivider
from twosra_mpc.lab.bench.singular_shapes import condition_number, singular_shapes
from twosra_mpc.lab.paper.section import Data, Tell
from twosra_mpc.lab.reproduction.published_model import published_jacobian
from twosra_mpc.lab.reproduction.published_runs import SIMULATIONS, Simulation
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.rolling import rolled
from twosra_mpc.plans.trajectory import wheel_speeds
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import MODES, RIGID, is_rigid, soft_segments

_ROBOT, _PAPER_ROBOT = "2sra-v1", "2sra-v1-paper"
_LEAST_BEND_RAD = 0.2  # less is no bend to take a share of
_PAPER_C, _PAPER_V = (0.0, 85.0), (1.1, 3.3)  # ends of the paper's straight line of its sensor


def compute(_folder: Path, tell: Tell) -> Data:
    """Numbers by the equations and by geometry."""
    tell("holding the equations against geometry")
    robot = load_robot(_ROBOT)
    shapes = singular_shapes(robot)
    shares = [share for name in SIMULATIONS for share in _shares_of_bend(f"paper-{name}")]
    straight, unit_1 = np.zeros(POSE + 2), np.array([[[1e-3, 0.0, 0.0, 0.0, 0.0]]])
    bent = roll_out(robot, straight, ((0, 1),), unit_1).states[0][-1]
    printed = float(published_jacobian(straight, straight, (1, 1))[POSE, 0])
    (segment_m, _), link_m = robot.geometry.lengths_m, robot.geometry.middle_link_m
    exact = 1.0 / (segment_m * (2 * segment_m + link_m))  # the fibre's end moves across the fibre
    return {
        "condition_straight": condition_number(robot, (0.0, 0.0)),
        "singular_shapes": len(shapes),
        "singular_apart": sum(shape.unit_gap_m > 0 for shape in shapes),
        "least_share_of_bend": 100 * min(shares),
        "largest_share_of_bend": 100 * max(shares),
        "turn_per_bend": float(bent[2] / (bent[4] * segment_m)),
        "rate_of_spiral_3": printed / exact,
        **_inputs(),
        **_units_alone(),
        "start_for_now_mm": 1e3 * max(map(_off_by_start, SIMULATIONS.values())),
        **_divider(),
    }


def _inputs() -> Data:
    """Errors of inputs from wheel speeds, and what moves with a held unit."""
    robot, lost, dragged = load_robot(_ROBOT), [], []
    known, units = kinematics(robot), np.eye(5)[:2]
    for simulation in SIMULATIONS.values():
        for mode in MODES:
            used = [2, 3, 4] if is_rigid(mode) else [0, 1]
            v = np.zeros((1, 5))
            v[0, used] = (0.01, -0.02, 0.3)[: len(used)]
            q, modes = simulation.start, np.array([mode])
            turned = wheel_speeds(robot, q[None], v, modes)[0]
            lost.append(np.abs(known.inputs(q, mode, turned) - v[0]).max())
            if sum(mode) == 1:  # unit 1 has the first two wheels
                rows = np.tile(q, (2, 1)), units, np.tile(modes, (2, 1))
                first, second = np.abs(wheel_speeds(robot, *rows))
                dragged += [first[2:].max() / first.max(), second[:2].max() / second.max()]
    moved = roll_out(robot, np.zeros(POSE + 2), ((1, 1),) * 2, 1e-6 * units[:, None]).states
    bends = np.diff(moved[:, [0, -1], POSE:], axis=1)[:, 0]
    return {
        "inputs_lost": float(max(lost)),
        "held_wheels": float(max(dragged)),
        "independent_bends": int(np.linalg.matrix_rank(bends, tol=1e-6 * np.abs(bends).max())),
    }


def _units_alone() -> Data:
    """Signs with which the wheels of a unit turn it on the spot, and drive it along its diagonal.

    The middle of a unit is where the lines through its wheels meet, across their drive directions.
    """
    wheels = robot_shape(load_robot(_ROBOT).geometry, np.zeros(POSE + 2)).wheels
    turning, driving = [], []
    for own in (wheels[:2], wheels[2:]):
        at, along = own.mean(axis=1), own[:, 1] - own[:, 0]
        along /= np.linalg.norm(along, axis=1)[:, None]
        out = at - np.linalg.solve(along, (along * at).sum(axis=1))
        turning.append(np.prod(out[:, 0] * along[:, 1] - out[:, 1] * along[:, 0]) > 0)
        diagonal = (out / np.linalg.norm(out, axis=1)[:, None]).sum(axis=0)
        driving.append(np.prod(along @ diagonal) < 0)
    return {"turning_alike": float(np.mean(turning)), "driving_opposed": float(np.mean(driving))}


def _shares_of_bend(task: str) -> list[float]:
    """Share of each planned bend that exact arcs reach with the paper's wheel speeds."""
    made = plan(load_problem(task, robot=_PAPER_ROBOT)).require()
    exact, shares = load_robot(_ROBOT), []
    for phase in made.phases:
        if is_rigid(phase.mode):
            continue
        times = np.linspace(phase.start_s, phase.end_s, 200)
        q = made.trajectory.configuration(times[[0, -1]])
        turned = np.diff(made.trajectory.wheel_travel_rad(times), axis=0)
        reached = rolled(exact.body, phase.mode, q[0], turned)[-1]
        soft = [POSE + segment for segment in soft_segments(phase.mode)]
        lengths = np.array(exact.geometry.lengths_m)[list(soft_segments(phase.mode))]
        planned, bent = (float((end - q[0])[soft] @ lengths) for end in (q[1], reached))
        if abs(planned) >= _LEAST_BEND_RAD:
            shares.append(bent / planned)
    return shares


def _off_by_start(simulation: Simulation) -> float:
    """Shift of a simulation's end if displacements were taken at q instead of q_0 [m]."""
    run, shift = simulation.run(), np.zeros(2)
    for before, after, mode in zip(run.q[:-1], run.q[1:], run.mode[1:].tolist(), strict=True):
        if tuple(mode) != RIGID:
            printed, now = (
                published_jacobian(before, start, tuple(mode))[:, :2]
                for start in (simulation.start, before)
            )
            inputs: Array = np.linalg.lstsq(printed, after - before, rcond=None)[0]
            shift += ((now - printed) @ inputs)[:2]
    return float(np.hypot(*shift))


def _divider() -> Data:
    """Supply of a divider with the paper's voltages at both ends, and errors of a straight line."""
    part_, (cold, hot), (low, high) = NtcDivider(ntc_to_ground=False), _PAPER_C, _PAPER_V
    r_cold, r_hot = part_.resistance_ohm(cold), part_.resistance_ohm(hot)
    fixed_ohm = (low * r_cold - high * r_hot) / (high - low)
    supply_V = low * (r_cold + fixed_ohm) / fixed_ohm
    divider = NtcDivider(fixed_ohm=fixed_ohm, supply_V=supply_V, ntc_to_ground=False)
    degrees = np.linspace(cold, hot, 171).tolist()
    by_line_C = np.interp([divider.voltage_V(each) for each in degrees], (low, high), (cold, hot))
    errors = by_line_C - degrees
    return {"supply_V": supply_V, "straight_line_off_C": float(np.abs(errors).max())}
