"""The robot as a chain of rigid links for URDF, each segment a few short pieces between hinges.

A piece is a chord of the arc: hinges turn by equal angles, the first and the last one by half of
it. With eight pieces a segment bent into a half circle is drawn within 1 % of its length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from twosra_mpc.files import environment
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry

PIECES = 8  # a segment
BASE = "b0"  # in the middle link, x from locomotion unit 1 to unit 2


class Joint(NamedTuple):
    """A joint of the chain and the link that it carries.

    Attributes:
        name: Of the joint; the link it carries is ``child``.
        parent: Link it sits on.
        child: Link it carries.
        at: Pose in the parent at angle zero [m, m, rad].
        segment: Segment (from 0) that turns a hinge; None for wheels.
        share: Angle of the hinge per segment's angle kappa l; 0 for wheels.
        wheel: Wheel (from 0) that turns; None for hinges.
        long_m: Extent of the link along x, signed; 0 for wheels.
    """

    name: str
    parent: str
    child: str
    at: tuple[float, float, float]
    segment: int | None = None
    share: float = 0.0
    wheel: int | None = None
    long_m: float = 0.0


@lru_cache(maxsize=16)
def joints(geometry: Geometry) -> tuple[Joint, ...]:
    """All joints, parents before children: both sides of the fibre outward from b0, then wheels."""
    return tuple(_joints(geometry))


def _joints(geometry: Geometry) -> Iterator[Joint]:
    first, count = geometry.inner_link_of_b0, geometry.segments
    ends = [BASE, BASE]
    for unit, side, order in ((0, -1, range(first - 1, -1, -1)), (1, 1, range(first, count))):
        parent, out_m = BASE, side * geometry.half_link_m
        for segment in order:
            name, piece_m = f"segment{segment + 1}", side * geometry.lengths_m[segment] / PIECES
            last = segment == order[-1]
            outer = f"b{unit + 1}" if last else f"{name}_link"
            last_m = side * (geometry.end_link_m if last else geometry.middle_link_m)
            pieces = [(f"{name}_piece{k + 1}", piece_m) for k in range(PIECES)]
            for k, (child, long_m) in enumerate([*pieces, (outer, last_m)]):
                share = side / PIECES * (0.5 if k in (0, PIECES) else 1.0)
                hinge, at = f"{name}_hinge{k + 1}", (out_m, 0.0, 0.0)
                yield Joint(hinge, parent, child, at, segment, share, long_m=long_m)
                parent, out_m = child, long_m
        ends[unit] = parent
    for wheel, at in enumerate(geometry.wheel_placement):
        name = f"wheel{wheel + 1}"
        yield Joint(f"{name}_axle", ends[wheel // 2], name, at, wheel=wheel)


def angles(geometry: Geometry, q: Array, wheel_rad: Array) -> Array:
    """Angles of the ``joints`` [rad], (joints,), at a configuration and these wheel angles."""
    bent = q[POSE:] * np.array(geometry.lengths_m)
    return np.array(
        [
            wheel_rad[joint.wheel] if joint.segment is None else joint.share * bent[joint.segment]
            for joint in joints(geometry)
        ]
    )


def urdf(robot: Robot) -> str:
    """URDF of a robot: hinges of the segments and axles of the wheels, boxes to look at."""
    templates, chain = environment("lab/export"), joints(robot.geometry)
    templates.filters["n"] = lambda value: f"{value:z.12g}"
    known = {"name": robot.name, "geometry": robot.geometry, "base": BASE, "pi": math.pi}
    text = templates.get_template("robot.urdf").render(**known, joints=chain)
    ElementTree.indent(root := ElementTree.fromstring(text))
    return ElementTree.tostring(root, encoding="unicode")
