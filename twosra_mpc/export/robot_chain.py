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

from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry

PIECES = 8  # a segment
BASE = "b0"  # in the middle link, x from locomotion unit 1 to unit 2
_UNIT_HEIGHT_M = 0.078  # of the authors' locomotion units
_AXIS_HEIGHT_M = 0.03  # of the fibre, for the picture: not published


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
            outer = f"b{unit + 1}" if segment == order[-1] else f"{name}_link"
            last_m = side * (
                geometry.end_link_m if segment == order[-1] else geometry.middle_link_m
            )
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
    """URDF of a robot: hinges of the segments and axles of the wheels, boxes to look at.

    Units hang rigidly on the fibre ends ``b1`` and ``b2``. URDF knows no curved links, so what is
    drawn is the chain; stiffness and heat are not in it.
    """
    geometry = robot.geometry
    document = ElementTree.Element("robot", name=robot.name)
    _box(_link(document, BASE), 2 * geometry.half_link_m, 0.0)
    for joint in joints(geometry):
        link = _link(document, joint.child)
        if joint.wheel is not None:
            _visual(link, (0, 0, geometry.wheel_radius_m), (math.pi / 2, 0, 0), cylinder=geometry)
        elif joint.child in ("b1", "b2"):
            _box(link, abs(joint.long_m), joint.long_m / 2)
            _unit(link, geometry, math.copysign(1.0, joint.long_m))
        else:
            _box(link, abs(joint.long_m), joint.long_m / 2)
        _joint(document, joint)
    if geometry.segments == 1:  # b0 is the fibre end of unit 1
        base = document.find(f"link[@name='{BASE}']")
        assert base is not None
        _unit(base, geometry, -1.0)
    ElementTree.indent(document)
    return ElementTree.tostring(document, encoding="unicode")


def _link(document: ElementTree.Element, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(document, "link", name=name)


def _joint(document: ElementTree.Element, joint: Joint) -> None:
    wheel = joint.wheel is not None
    kind = "continuous" if wheel else "revolute"
    element = ElementTree.SubElement(document, "joint", name=joint.name, type=kind)
    x, y, angle = joint.at
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    ElementTree.SubElement(
        element, "origin", xyz=f"{x:z.12g} {y:z.12g} 0", rpy=f"0 0 {angle:z.12g}"
    )
    # A wheel that turns about +y rolls to +x, its drive direction.
    ElementTree.SubElement(element, "axis", xyz="0 1 0" if wheel else "0 0 1")
    if not wheel:
        lower, upper = f"{-math.pi:z.12g}", f"{math.pi:z.12g}"
        ElementTree.SubElement(element, "limit", effort="0", velocity="0", lower=lower, upper=upper)


def _box(link: ElementTree.Element, long_m: float, x_m: float) -> None:
    thick_m = 0.008
    if long_m > 0:
        _visual(link, (x_m, 0.0, _AXIS_HEIGHT_M), (0, 0, 0), box=(long_m, thick_m, thick_m))


def _unit(link: ElementTree.Element, geometry: Geometry, side: float) -> None:
    """A locomotion unit beyond the end link, on the side of unit 1 (-1) or 2 (+1)."""
    square, (out_m, aside_m) = geometry.unit_frame_m, geometry.unit_middle_m
    middle_m = side * out_m, aside_m, _UNIT_HEIGHT_M / 2
    _visual(link, middle_m, (0, 0, 0), box=(square, square, _UNIT_HEIGHT_M))


def _visual(
    link: ElementTree.Element,
    xyz: tuple[float, float, float],
    rpy: tuple[float, float, float],
    box: tuple[float, float, float] | None = None,
    cylinder: Geometry | None = None,
) -> None:
    visual = ElementTree.SubElement(link, "visual")
    placed = {"xyz": _numbers(xyz), "rpy": _numbers(rpy)}
    ElementTree.SubElement(visual, "origin", placed)
    shape = ElementTree.SubElement(visual, "geometry")
    if box is not None:
        ElementTree.SubElement(shape, "box", size=_numbers(box))
    if cylinder is not None:
        radius, length = f"{cylinder.wheel_radius_m:z.12g}", f"{cylinder.wheel_thickness_m:z.12g}"
        ElementTree.SubElement(shape, "cylinder", radius=radius, length=length)


def _numbers(values: tuple[float, float, float]) -> str:
    return " ".join(f"{value:z.12g}" for value in values)
