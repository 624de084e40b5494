"""Whether an object can leave the shape that a robot is in, roles swapped: the object moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.errors import InputError
from twosra_mpc.problem.objects import Object
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.contour import Contour
from twosra_mpc.space.enclosure import disc_enclosed, polygon_enclosed
from twosra_mpc.space.footprint import footprint

_SAGITTA_M = 1e-4


@dataclass(frozen=True)
class Cage:
    """Whether an object cannot leave.

    Attributes:
        proved: It cannot.
        headings: Slices of headings that decided; 0 for a disc, 1 where it leaves without turning.
        room_m: How far its centroid may get from where it is, at most; infinite where not proved.
    """

    proved: bool
    headings: int
    room_m: float

    @property
    def words(self) -> str:
        """What to say of it."""
        return "caged: proved, it cannot leave" if self.proved else "not proved to be caged"


def caged(geometry: Geometry, kappa: ArrayLike, thing: Object, pose_in_b0: ArrayLike) -> Cage:
    """Whether an object cannot leave a robot in one shape, proved.

    Args:
        geometry: Lengths of the robot.
        kappa: Its curvatures, (n,) [1/m].
        thing: The object.
        pose_in_b0: Where it is in the frame of b0, (3,).

    Raises:
        InputError: If robot and object overlap there by more than 0.2 mm.
    """
    around, outline = footprint(geometry, kappa, _SAGITTA_M).inner, thing.own
    x, y, phi = np.asarray(pose_in_b0, dtype=float).tolist()
    turn = np.array([[np.cos(phi), np.sin(phi)], [-np.sin(phi), np.cos(phi)]])  # for row vectors
    middle = Contour.of(outline).centroid
    at = middle @ turn + [x, y]
    if outline.disc is not None:
        found = disc_enclosed(around, outline.disc.radius_m, at)
    else:
        found = polygon_enclosed(around, (outline.corners_m - middle) @ turn, at)
    if found is None:
        allowed = "a pose at which robot and object do not overlap"
        raise InputError("pose_in_b0", (x, y, phi), allowed)
    return Cage(*found)
