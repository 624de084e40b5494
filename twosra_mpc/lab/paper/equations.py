"""The paper's equations held against geometry: what each one says, and what the same geometry says.

Everything here is computed from the robot's lengths alone; no log is needed.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from twosra_mpc.analysis.singular_shapes import condition_number, singular_shapes
from twosra_mpc.control.thermistor import NtcDivider
from twosra_mpc.lab.bench.heater_loop import LinearMap
from twosra_mpc.lab.paper.claims import Claim, Reading, equal, every
from twosra_mpc.lab.paper.kept import Data, Part, Tell
from twosra_mpc.lab.paper.section import Section
from twosra_mpc.lab.reproduction.published_model import published_jacobian
from twosra_mpc.lab.reproduction.simulations import SIMULATIONS, Simulation
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.model.rolling import rolled
from twosra_mpc.planning.planner import plan
from twosra_mpc.plans.trajectory import wheel_speeds
from twosra_mpc.problem.problem import load_problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import load_robot
from twosra_mpc.robot.modes import MODES, RIGID, is_rigid, soft_segments

_ROBOT, _PAPER_ROBOT = "2sra-v1", "2sra-v1-paper"
_LEAST_BEND_RAD = 0.2  # less is no bend to take a share of
_WHERE = "section Kinematics; section Unified Jacobian Matrix"


def part() -> Part:
    """Return what the equations say and what geometry says."""
    return Part("equations", {"robots": [_ROBOT, _PAPER_ROBOT]}, _compute)


def _compute(_folder: Path, tell: Tell) -> Data:
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
        "share_of_bend": [min(shares), max(shares)],
        "turn_per_bend": float(bent[2] / (bent[4] * segment_m)),
        "rate_of_spiral_3": printed / exact,
        **_inputs(),
        **_units_alone(),
        "start_for_now_m": [_off_by_start(each) for each in SIMULATIONS.values()],
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
                first, second = np.abs(
                    wheel_speeds(robot, np.tile(q, (2, 1)), units, np.tile(modes, (2, 1)))
                )
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
    line, part_ = LinearMap(), NtcDivider(ntc_to_ground=False)
    (cold, hot), (low, high) = line.range_C, line.range_V
    r_cold, r_hot = part_.resistance_ohm(cold), part_.resistance_ohm(hot)
    fixed_ohm = (low * r_cold - high * r_hot) / (high - low)
    supply_V = low * (r_cold + fixed_ohm) / fixed_ohm
    divider = NtcDivider(fixed_ohm=fixed_ohm, supply_V=supply_V, ntc_to_ground=False)
    degrees = np.linspace(cold, hot, 171).tolist()
    errors = [line.temperature_C(divider.voltage_V(each)) - each for each in degrees]
    return {"supply_V": supply_V, "straight_line_off_C": max(map(abs, errors))}


def section(data: Data) -> Section:
    """Compare the equations with the geometry they describe."""
    return Section(
        name="equations",
        title="Equations",
        words=(
            "Each equation is held against the geometry of the robot's lengths: a fibre of circular"
            " arcs, whose held unit stands still and whose wheels roll without slip.",
        ),
        claims=(
            _omnidirectional(data),
            _wheels(data),
            _heading(data),
            _start(data),
            _third_spiral(data),
            _sensor(data),
            _inverse(data),
            _independent(data),
            _unit_wheels(data),
        ),
    )


def _omnidirectional(data: Data) -> Claim:
    return Claim(
        "The robot is omnidirectional at any configuration",
        "section Kinematics of the Rigid Agent",
        (
            equal("shapes in which the wheels lose a motion", 0, data["singular_shapes"], caveat=0),
            equal("such shapes with units that are apart", 0, data["singular_apart"], caveat=0),
        ),
        "Where the units do not overlap, the wheels keep control; straight, the wheel matrix has"
        f" the condition number {data['condition_straight']:z.2f}.",
    )


def _wheels(data: Data) -> Claim:
    least, most = (100 * share for share in data["share_of_bend"])
    return Claim(
        "Wheel speeds follow from the speed of a unit on its path",
        "eq. wheel_drive",
        (
            equal(
                "least share of a planned bend that is reached", 100, least, "%", holds=5, caveat=25
            ),
            equal("largest such share", 100, most, "%", holds=5, caveat=25),
        ),
        "Reached by exact arcs with the paper's wheel speeds. The side wheel sits 82.5 mm beyond"
        " the fibre's end, whose speed the equation gives it; the moving unit's other wheel has to"
        " roll, too.",
    )


def _heading(data: Data) -> Claim:
    words = "turn of the middle link per bend of segment 2, unit 1 moving"
    return Claim(
        "The heading's row of the soft Jacobian",
        _WHERE,
        (equal(words, 1.0, data["turn_per_bend"], "rad/rad", holds=1e-6, caveat=0.05),),
        "As printed, the robot turns the wrong way in mode [0, 1]; the authors' program has the"
        " right sign.",
    )


def _start(data: Data) -> Claim:
    worst = 1e3 * max(data["start_for_now_m"])
    words = "largest shift of a simulation's end with the present configuration instead"
    return Claim(
        "Displacements are those of the configuration q_0 at the start of the plan",
        "Algorithm 1",
        (Reading(words, 0.0, worst, "mm", 1.0, 10.0, "at most"),),
        "Wrong as soon as the held unit has turned; the authors' robot was run with the present"
        " configuration.",
    )


def _third_spiral(data: Data) -> Claim:
    words = "curvature rate of two soft segments, straight: printed by exact"
    return Claim(
        "Spiral III of Table I gives the rate at which two soft segments bend",
        "eq. kappa; Table I",
        (equal(words, 1.0, data["rate_of_spiral_3"], holds=0.05, caveat=0.2),),
        "The table's a belongs to an angle counted from the straight fibre, the equation counts"
        f" from pi: the radius is {math.exp(-0.2229 * math.pi):z.3f} of what was fitted.",
    )


def _sensor(data: Data) -> Claim:
    return Claim(
        "0 to 85 C are mapped to 1.1 to 3.3 V",
        "section Stiffness Control",
        (
            equal("supply of such a divider", 3.3, data["supply_V"], "V", holds=0.05, caveat=0.3),
            Reading(
                words="a straight line between these ends is off by",
                published=0.0,
                ours=data["straight_line_off_C"],
                unit="C",
                holds=1.0,
                caveat=5.0,
                sense="at most",
            ),
        ),
        "For a 10 k thermistor (B 3950 K) in series with a resistor; a straight line is our reading"
        " of the sentence.",
    )


def _inverse(data: Data) -> Claim:
    words = "largest difference of V+ V v from v, in all modes [m/s, rad/s]"
    return Claim(
        "The Moore-Penrose inverse of the configuration matrix gives the inputs of wheel speeds",
        "section Unified Jacobian Matrix",
        (Reading(words, 0.0, data["inputs_lost"], "", 1e-9, 1e-6, "at most"),),
        "With the exact wheel map, by Kinematics.inputs.",
    )


def _independent(data: Data) -> Claim:
    return Claim(
        "The motion of the units in the soft state is independent of each other",
        "section Kinematics",
        (
            Reading(
                "speed of the held unit's wheels by that of the moving unit's, one segment soft",
                0.0,
                data["held_wheels"],
                "",
                1e-9,
                0.1,
                "at most",
            ),
            equal("bends that two units choose, both soft", 2, data["independent_bends"], caveat=0),
        ),
        "With two soft segments both curvatures follow from the sum of the units' speeds.",
    )


def _unit_wheels(data: Data) -> Claim:
    return Claim(
        "Wheels of a unit that turn alike turn it, and opposed they drive it along its diagonal",
        "section Design",
        (
            every("units that turn on the spot with both wheels alike", data["turning_alike"]),
            every("units driven along the diagonal, wheels opposed", data["driving_opposed"]),
        ),
    )
