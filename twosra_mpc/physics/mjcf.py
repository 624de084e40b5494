"""MJCF, the format of MuJoCo, of a robot and of what is around it; written without MuJoCo.

The middle link b0 is the root: it slides in the plane, turns about the vertical, and sinks until
all wheels carry weight; nothing tilts. From it the fibre runs to either unit, a segment as a chain
of hinges of equal angles. Wheels are omni-wheels whose free rollers alone touch the ground. Without
MuJoCo's pass against slip, contacts with friction creep, by half a millimetre in 15 s of rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.problem.objects import Object
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.physics import Physics
from twosra_mpc.space.convex import convex_parts

HINGES = 8  # of a segment
WALL = "obstacle "  # before the name of an obstacle: its body
STEP_S = 0.0015
ROLLERS = 12  # of a wheel
SERVO_N_M_PER_RAD, SERVO_N_M_S = 0.5, 0.01  # of a wheel behind its command: of angle, of speed
_ROLLER_SHARE = 0.4  # radius of a roller over that of its wheel
_ROLLER_KG = 0.0005
_WHEEL_KG = 0.02  # without rollers
_ROUNDING = 1e-6  # rad
_HEIGHT_M = 0.02  # of units, obstacles and objects
_CONTACT_S = 0.006  # time constant of rollers on the ground: they sink in by 0.06 mm
_MOTOR_KG_M2 = 5e-5  # inertia of a geared motor at the wheel
_HINGE_KG_M2, _ROLLER_KG_M2 = 1e-6, 1e-8  # added inertia: keeps small masses solvable
_GROUND, _WALL, _UNIT, _LINK, _OBJECT = 1, 2, (4, 8), 16, 32  # bits: what touches what
_SEGMENT = (64, 128, 256, 512)
_NO_SLIP = 5  # iterations
_SLIPPERY = "0.3 0.005 0.0001"  # of objects on the ground, and of the robot along walls
_GREY, _GREEN = "0.5 0.5 0.5 1", "0.2 0.6 0.3 1"


class Springs(NamedTuple):
    """Springs of the hinges of a segment.

    Attributes:
        stiffness_N_m_per_rad: Of each hinge.
        rest_rad: Angle at which it pulls nowhere.
    """

    stiffness_N_m_per_rad: float
    rest_rad: Array | float


def springs(physics: Physics, solid: float, rest_rad: Array | float, piece_m: float) -> Springs:
    """Rubber, straight at rest, beside the solid share of the metal, at rest as it froze.

    Metal that is partly solid is stiff by a power of that share: `Physics.setting_exponent`.

    Args:
        physics: Stiffness.
        solid: Solid share of the metal.
        rest_rad: Angles of the hinges at which the metal froze.
        piece_m: Length of the fibre for each hinge.
    """
    rubber = physics.soft_stiffness_N_m2 / piece_m
    metal = (physics.solid_stiffness_N_m2 - physics.soft_stiffness_N_m2) / piece_m
    metal *= solid**physics.setting_exponent
    return Springs(rubber + metal, metal / (rubber + metal) * rest_rad)


@public
def mjcf(
    robot: Robot,
    physics: Physics | None = None,
    *,
    problem: Problem | None = None,
    hinges: int = HINGES,
    step_s: float = STEP_S,
) -> str:
    """Return the MJCF of a robot, straight and cold at the origin, or of a problem.

    Joints ``x``, ``y``, ``phi`` are the pose of b0, ``bendJ_K`` hinge K of segment J (its
    curvature is the sum of the angles over its length), ``wheelI`` the wheels. Actuator ``wheelI``
    is a velocity servo [rad/s] that holds its angle at rest. Stiffness and damping of a
    segment are in class ``segmentJ``: those of its metal as it is at the start. Bodies have the
    names of objects, and of obstacles, after ``obstacle``. Key frame ``start`` is the start's
    configuration.

    Args:
        robot: The robot.
        physics: Masses, stiffness and friction; default: the robot's own.
        problem: Start, obstacles, and objects, which are free bodies.
        hinges: Of each segment.
        step_s: Time step.

    Raises:
        InputError: If its wheels cannot carry it.
    """
    check_carried(robot.geometry)
    return _Writer(robot, physics or robot.true_physics, hinges, step_s).text(problem)


def check_carried(geometry: Geometry) -> None:
    """Check that the straight robot stands on its wheels.

    Raises:
        InputError: If the fibre touches the ground, or the units' weight is not between the wheels.
    """
    if geometry.wheel_radius_m <= geometry.fibre_radius_m:
        allowed = f"more than fibre_radius_m ({geometry.fibre_radius_m:zg} m): else the fibre drags"
        raise InputError("geometry.wheel_radius_m", geometry.wheel_radius_m, allowed)
    length_m = sum(geometry.lengths_m) + geometry.middle_link_m * (geometry.segments - 1)
    placed = np.array(geometry.wheel_placement)[:, :2] + np.repeat([[0, 0], [length_m, 0]], 2, 0)
    middle = np.array([length_m / 2, geometry.unit_middle_m[1]])
    from_middle = np.sort(np.arctan2(*(placed - middle).T[::-1]))
    gaps = np.diff([*from_middle, from_middle[0] + math.tau])
    if gaps.max() > math.pi + _ROUNDING:
        places = "; ".join(f"{x:zg}, {y:zg}" for x, y, _ in geometry.wheel_placement)
        allowed = "wheels with the robot's weight between them: it tips over"
        raise InputError("geometry.wheels", places, allowed)


class _Writer:
    """The tree of one model while it is built."""

    def __init__(self, robot: Robot, physics: Physics, hinges: int, step_s: float) -> None:
        self._geometry, self._physics, self._hinges = robot.geometry, physics, hinges
        self._root = Element("mujoco", model=robot.name)
        _add(self._root, "compiler", angle="radian", autolimits="true")
        _add(self._root, "option", timestep=step_s, cone="elliptic", impratio=10,
             noslip_iterations=_NO_SLIP)  # fmt: skip
        self._default = _add(self._root, "default")
        self._assets = _add(self._root, "asset")
        self._world = _add(self._root, "worldbody")
        self._actuators = _add(self._root, "actuator")

    def text(self, problem: Problem | None) -> str:
        """The model as text."""
        q, melted = np.zeros(POSE + self._geometry.segments), [0.0] * self._geometry.segments
        if problem is not None:
            q, melted = problem.start.configuration, [*problem.melt_fractions]
        self._segments(q, melted)
        _add(self._world, "light", pos="0 0 2", dir="0 0 -1")
        _add(
            self._world, "geom", name="ground", type="plane", size="2 2 0.1", contype=0,
            conaffinity=_GROUND, rgba="0.9 0.9 0.9 1", friction=_SLIPPERY, priority=1,
        )  # fmt: skip
        touches = sum(_UNIT) | _LINK | sum(_SEGMENT) | _OBJECT
        if problem is not None:
            for name, obstacle in zip(problem.world.names, problem.obstacles, strict=True):
                body = _add(self._world, "body", name=f"{WALL}{name}")
                self._prisms(
                    body, obstacle, _GREY, contype=_WALL, conaffinity=touches, friction=_SLIPPERY
                )
            for item in problem.objects:
                self._object(item)
        self._robot()
        bends = {f"bend{j}": bend for j, bend in enumerate(self._hinge_rad(q), start=1)}
        angles = {**dict(zip(("x", "y", "phi"), q[:POSE].tolist(), strict=True)), **bends}
        joints = [joint.get("name", "").partition("_")[0] for joint in self._world.iter("joint")]
        place = [angles.get(joint, 0.0) for joint in joints]
        _add(_add(self._root, "keyframe"), "key", name="start", qpos=_vector(*place))
        indent(self._root)
        return tostring(self._root, encoding="unicode") + "\n"

    def _hinge_rad(self, q: Array) -> list[float]:
        """Angle of each hinge of each segment."""
        bent: list[float] = (q[POSE:] * self._geometry.lengths_m / self._hinges).tolist()
        return bent

    def _segments(self, q: Array, melted: Sequence[float]) -> None:
        """A class for the hinges of each segment."""
        each = zip(self._geometry.lengths_m, self._hinge_rad(q), melted, strict=True)
        for number, (length_m, bend_rad, liquid) in enumerate(each, start=1):
            spring = springs(self._physics, 1.0 - liquid, bend_rad, length_m / self._hinges)
            stiffness = spring.stiffness_N_m_per_rad
            found = _add(self._default, "default", **{"class": f"segment{number}"})
            _add(
                found, "joint", stiffness=stiffness, springref=float(spring.rest_rad),
                damping=stiffness * self._physics.relaxation_s, armature=_HINGE_KG_M2,
            )  # fmt: skip

    def _robot(self) -> None:
        geometry = self._geometry
        first = geometry.inner_link_of_b0
        root = _add(self._world, "body", name="b0", pos=_vector(0, 0, geometry.wheel_radius_m))
        _planar(root, "", 0.0)
        if first == 0:
            self._unit(root, 0)
        else:
            self._link(root, -geometry.half_link_m, geometry.half_link_m, _LINK)
            self._side(root, range(first - 1, -1, -1), -1)
        self._side(root, range(first, geometry.segments), 1)

    def _side(self, body: Element, segments: Sequence[int], side: int) -> None:
        """The fibre from b0 to one unit, and the unit."""
        at_m = side * self._geometry.half_link_m
        for number in segments:
            half_m = side * self._geometry.lengths_m[number] / self._hinges / 2
            self._link(body, at_m, at_m + half_m, _SEGMENT[number])
            for k in range(self._hinges):
                body = _add(body, "body", pos=_vector(at_m + half_m, 0, 0))
                kind = {"class": f"segment{number + 1}", "axis": _vector(0, 0, side)}
                _add(body, "joint", name=f"bend{number + 1}_{k + 1}", **kind)
                long_m = half_m if k == self._hinges - 1 else 2 * half_m
                self._link(body, 0.0, long_m, _SEGMENT[number])
                at_m = half_m
            if number == segments[-1]:
                self._unit(_add(body, "body", pos=_vector(at_m, 0, 0)), (1 + side) // 2)
            else:
                link_m = side * self._geometry.middle_link_m
                self._link(body, at_m, at_m + link_m, _LINK)
                at_m += link_m

    def _link(self, body: Element, from_m: float, to_m: float, bit: int) -> None:
        """A straight piece of the fibre; those of other segments touch it, those of its own not."""
        if from_m == to_m:
            return
        others = sum(_SEGMENT) - bit if bit in _SEGMENT else 0
        _add(
            body, "geom", type="capsule", size=self._geometry.fibre_radius_m,
            fromto=_vector(from_m, 0, 0, to_m, 0, 0), rgba="0.85 0.45 0.2 1",
            mass=abs(to_m - from_m) * self._physics.fibre_kg_per_m,
            contype=bit, conaffinity=_WALL | sum(_UNIT) | _OBJECT | others, friction=_SLIPPERY,
        )  # fmt: skip

    def _unit(self, body: Element, unit: int) -> None:
        """A locomotion unit with its end link and two wheels, at its fibre end."""
        geometry, outward = self._geometry, (-1, 1)[unit]
        self._link(body, 0.0, outward * geometry.end_link_m, _LINK)
        out_m, aside_m = geometry.unit_middle_m
        half_m, high_m = geometry.unit_frame_m / 2, 0.8 * geometry.wheel_radius_m
        mass = self._physics.unit_mass_kg - 2 * (_WHEEL_KG + ROLLERS * _ROLLER_KG)
        _add(
            body, "geom", type="box", size=_vector(half_m, half_m, high_m), mass=max(mass, 0.01),
            pos=_vector(outward * out_m, aside_m, 0),
            rgba="0.25 0.35 0.45 1", **_unit_touches(unit),
        )  # fmt: skip
        for number in (2 * unit, 2 * unit + 1):
            self._wheel(body, number)

    def _wheel(self, body: Element, number: int) -> None:
        """An omni-wheel: rollers round a hub, the axle across the drive direction."""
        geometry, name = self._geometry, f"wheel{number + 1}"
        x_m, y_m, angle = geometry.wheel_placement[number]
        place = {"pos": _vector(x_m, y_m, 0), "euler": _vector(0, 0, angle)}
        wheel = _add(body, "body", name=name, **place)
        _add(wheel, "joint", name=name, axis="0 1 0", armature=_MOTOR_KG_M2)
        size = _vector(0.95 * geometry.wheel_radius_m, geometry.wheel_thickness_m / 2)
        _add(
            wheel, "geom", type="cylinder", size=size, euler=_vector(math.pi / 2, 0, 0),
            mass=_WHEEL_KG, rgba="0.1 0.1 0.1 1", **_unit_touches(number // 2),
        )  # fmt: skip
        for k in range(ROLLERS):
            self._roller(wheel, k * math.tau / ROLLERS)
        most = self._physics.wheel_torque_N_m
        _add(
            self._actuators, "intvelocity", name=name, joint=name, kp=SERVO_N_M_PER_RAD,
            kv=SERVO_N_M_S, forcerange=_vector(-most, most), actrange="-1e9 1e9",
        )  # fmt: skip

    def _roller(self, wheel: Element, angle: float) -> None:
        """An ellipsoid that turns about the tangent; with its neighbours it is as round as a wheel.

        Its curvature along the tangent is that of the wheel: a^2 / b = R.
        """
        radius_m = self._geometry.wheel_radius_m
        thick_m = _ROLLER_SHARE * radius_m
        long_m, out_m = math.sqrt(radius_m * thick_m), radius_m - thick_m
        at = _vector(out_m * math.sin(angle), 0, out_m * math.cos(angle))
        body = _add(wheel, "body", pos=at, euler=_vector(0, angle, 0))
        damping = self._physics.roller_damping_N_m_s
        _add(body, "joint", axis="1 0 0", damping=damping, armature=_ROLLER_KG_M2)
        _add(
            body, "geom", type="ellipsoid", size=_vector(long_m, thick_m, thick_m), priority=2,
            mass=_ROLLER_KG, friction=_vector(self._physics.wheel_friction, 0.005, 1e-4),
            contype=_GROUND, conaffinity=0, solref=_vector(_CONTACT_S, 1), rgba="0.3 0.3 0.3 1",
        )  # fmt: skip

    def _object(self, item: Object) -> None:
        """A free body that stays upright."""
        x, y, phi = item.pose.pose.tolist()
        place = {"pos": _vector(x, y, 0), "euler": _vector(0, 0, phi)}
        body = _add(self._world, "body", name=item.name, **place)
        _planar(body, f"{item.name}.", phi)
        touches = {"contype": _OBJECT | _GROUND, "conaffinity": _OBJECT | _WALL | sum(_UNIT)}
        friction = _vector(0.5 if item.friction is None else item.friction, 0.005, 1e-4)
        self._prisms(
            body, item.own, _GREEN, mass=self._physics.object_mass_kg, friction=friction, **touches
        )

    def _prisms(
        self, body: Element, shape: Obstacle, colour: str, mass: float = 0.0, **more: str | float
    ) -> None:
        """Convex parts of a polygon, standing on the ground."""
        parts = convex_parts(shape.corners_m)
        for part in parts:
            name = f"prism{len(self._assets) + 1}"
            points = [
                value for z in (0, _HEIGHT_M) for x, y in part.tolist() for value in (x, y, z)
            ]
            _add(self._assets, "mesh", name=name, vertex=_vector(*points))
            weight = {"mass": mass / len(parts)} if mass else {}
            _add(body, "geom", type="mesh", mesh=name, rgba=colour, **more, **weight)


def _add(parent: Element, tag: str, **attributes: str | float) -> Element:
    """Add an element; numbers are written to nine digits."""
    written = {
        name: value if isinstance(value, str) else f"{value:z.9g}"
        for name, value in attributes.items()
    }
    return SubElement(parent, tag, written)


def _vector(*values: float) -> str:
    return " ".join(f"{value:z.9g}" for value in values)


def _planar(body: Element, prefix: str, phi: float) -> None:
    """Let a body slide along x, y, z of the plane and turn; it stands turned by ``phi``."""
    c, s = math.cos(phi), math.sin(phi)  # axes are given in the body's own frame
    for name, axis in (("x", (c, -s, 0)), ("y", (s, c, 0)), ("z", (0, 0, 1))):
        _add(body, "joint", name=f"{prefix}{name}", type="slide", axis=_vector(*axis))
    _add(body, "joint", name=f"{prefix}phi", type="hinge", axis="0 0 1")


def _unit_touches(unit: int) -> dict[str, str]:
    """Contacts of a unit, not with itself, and friction: where two touch, the rougher counts."""
    touches = _WALL | _UNIT[1 - unit] | _LINK | sum(_SEGMENT) | _OBJECT
    return {"contype": f"{_UNIT[unit]}", "conaffinity": f"{touches}", "friction": _SLIPPERY}
