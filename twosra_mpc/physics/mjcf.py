"""MJCF, the format of MuJoCo, of a robot and of what is around it; written without MuJoCo.

The middle link b0 is the root: it slides in the plane, turns about the vertical, and sinks until
all wheels carry weight; nothing tilts. From it the fibre runs to either unit, a segment as a chain
of hinges of equal angles. Wheels are omni-wheels whose free rollers alone touch the ground. Without
MuJoCo's pass against slip, contacts with friction creep, by half a millimetre in 15 s of rest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree.ElementTree import SubElement, fromstring, indent, tostring

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.files import environment
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import Object, Obstacle
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.physics import SLIDING, Physics
from twosra_mpc.space.convex import convex_parts

HINGES = 8  # of a segment
WALL = "obstacle "  # before the name of an obstacle: its body
STEP_S = 0.0015
SERVO_N_M_PER_RAD, SERVO_N_M_S = 0.5, 0.01  # of a wheel behind its command: of angle, of speed
_ROUNDING = 1e-6  # rad
_HEIGHT_M = 0.02  # of obstacles and objects


class Springs(NamedTuple):
    """Springs of the hinges of a segment.

    Attributes:
        stiffness_N_m_per_rad: Of each hinge.
        rest_rad: Angle at which it pulls nowhere.
    """

    stiffness_N_m_per_rad: float
    rest_rad: Array | float


def springs(physics: Physics, solid: float, frozen_rad: Array | float, piece_m: float) -> Springs:
    """Rubber, straight at rest, beside the solid share of the metal, at rest as it froze.

    Metal that is partly solid is stiff by a power of that share, ``setting_exponent``.

    Args:
        physics: Stiffness.
        solid: Solid share of the metal.
        frozen_rad: Angles of the hinges at which the metal froze.
        piece_m: Length of the fibre for each hinge.
    """
    rubber = physics.soft_stiffness_N_m2 / piece_m
    metal = (physics.solid_stiffness_N_m2 - physics.soft_stiffness_N_m2) / piece_m
    metal *= solid**physics.setting_exponent
    return Springs(rubber + metal, metal / (rubber + metal) * frozen_rad)


@public
def mjcf(
    robot: Robot,
    physics: Physics | None = None,
    *,
    problem: Problem | None = None,
    hinges: int = HINGES,
    step_s: float = STEP_S,
) -> str:
    """Return the MJCF of a robot, straight and cold at the origin, or of a problem's start.

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
    geometry, first = robot.geometry, robot.geometry.inner_link_of_b0
    q, solid, names = np.zeros(POSE + geometry.segments), [1.0] * geometry.segments, list[str]()
    standing, things = list[Obstacle](), list[Object]()
    if problem is not None:
        q, solid = problem.start.configuration, [1 - each for each in problem.melt_fractions]
        standing, things = [*problem.obstacles], [*problem.objects]
        names = [WALL + name for name in problem.world.names]
    shapes = (*standing, *(item.own for item in things))
    solids = [[_prism(part) for part in convex_parts(shape.corners_m)] for shape in shapes]
    ends = itertools.accumulate(map(len, solids), initial=1)
    numbers = [range(begin, end) for begin, end in itertools.pairwise(ends)]
    own, pieces_m = physics or robot.true_physics, np.array(geometry.lengths_m) / hinges
    bends_rad = (q[POSE:] * pieces_m).tolist()
    each = zip(solid, bends_rad, pieces_m.tolist(), strict=True)
    templates = environment("physics")
    templates.filters["n"] = lambda value: f"{value:z.9g}"
    text = templates.get_template("mjcf.xml").render(
        name=robot.name,
        geometry=geometry,
        physics=own,
        springs=[springs(own, *one) for one in each],
        step_s=step_s,
        prisms=[*itertools.chain.from_iterable(solids)],
        walls=[*zip(names, numbers[: len(standing)], strict=True)],
        objects=[*zip(things, numbers[len(standing) :], strict=True)],
        left=_hinges(geometry, range(first - 1, -1, -1), -1, hinges),
        right=_hinges(geometry, range(first, geometry.segments), 1, hinges),
        servo=(SERVO_N_M_PER_RAD, SERVO_N_M_S),
        sliding=SLIDING,
        math=math,
    )
    root = fromstring(text)
    bent = {f"bend{j}": bend_rad for j, bend_rad in enumerate(bends_rad, start=1)}
    angles = bent | dict(zip(("x", "y", "phi"), q[:POSE].tolist(), strict=True))
    joints = [one.get("name", "").partition("_")[0] for one in root.iterfind("worldbody//joint")]
    place = " ".join(f"{angles.get(joint, 0.0):z.9g}" for joint in joints)
    SubElement(SubElement(root, "keyframe"), "key", name="start", qpos=place)
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


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


class _Hinge(NamedTuple):
    """A hinge of the fibre, in the body of the one before it; places along x [m].

    Attributes:
        segment: Number of its segment, from 1.
        number: Its number in that segment, from 1.
        before_m: Straight pieces that belong to the body before it; the last one is of its segment.
        at_m: Place of the hinge.
        out_m: End of the piece beyond it, from there.
        end_m: End of the segment, from there, if it is its last.
    """

    segment: int
    number: int
    before_m: tuple[tuple[float, float], ...]
    at_m: float
    out_m: float
    end_m: float


def _hinges(geometry: Geometry, segments: Sequence[int], side: int, count: int) -> list[_Hinge]:
    """Hinges from b0 to one unit: so many a segment, amid equal pieces of it."""
    found, at_m = list[_Hinge](), side * geometry.half_link_m
    for segment in segments:
        half_m = side * geometry.lengths_m[segment] / count / 2
        link_m = side * geometry.middle_link_m
        before = [(at_m, at_m + half_m)]
        if found:
            before = [(at_m, at_m + link_m), (at_m + link_m, at_m + link_m + half_m)]
            at_m += link_m
        for k in range(count):
            out_m = half_m if k == count - 1 else 2 * half_m
            hinge = _Hinge(segment + 1, k + 1, tuple(before), at_m + half_m, out_m, half_m)
            found.append(hinge)
            before, at_m = [], half_m
    return found


def _prism(part: Array) -> list[float]:
    """Corners of a convex polygon (k, 2) standing on the ground."""
    return [v for z in (0, _HEIGHT_M) for x, y in part.tolist() for v in (x, y, z)]
