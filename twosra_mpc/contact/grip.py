r"""Objects held by contact: cages that they cannot leave, and motions in which friction keeps them.

A cage is proved with the roles swapped: the robot keeps its shape, and the object has no way out.

Sliding on the floor, slowly, an object whose limit surface is an ellipsoid resists a twist (v, w)
about its centroid with a force and torque along :math:`(v, c^2 w)` (Lynch and Mason, 1996, after
Howe and Cutkosky). Contact moves it with the robot if forces within friction cones at its contacts
can be that load; such twists are a polyhedral cone. For a pressure spread evenly :math:`c \approx
0.6 \sqrt{A / \pi}`, A its area.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.problem.speeds import drive_rows
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array, inverse, rotation
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.contour import Contour, contacts
from twosra_mpc.space.footprint import footprint
from twosra_mpc.space.possible import Enclosure, disc_enclosed, polygon_enclosed

_SAGITTA_M = 1e-4  # by which chords may miss the arc they stand for


def caged(geometry: Geometry, kappa: ArrayLike, thing: Object, pose_in_b0: ArrayLike) -> Enclosure:
    """Cage of an object by a robot in one shape, as far as it is proved: its centroid enclosed.

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
    turn = rotation(phi)
    middle = Contour.of(outline).centroid
    at = middle @ turn + [x, y]
    if outline.disc is not None:
        found = disc_enclosed(around, outline.disc.radius_m, at)
    else:
        found = polygon_enclosed(around, (outline.corners_m - middle) @ turn, at)
    if found is None:
        allowed = "a pose at which robot and object do not overlap"
        raise InputError("pose_in_b0", (x, y, phi), allowed)
    return found


_FLAT = 1e-9  # rounding of unit normals
_OFF = 1e-7  # of a load, out of the cone and still held
_LEVEL = 0.05  # of normals along a front that counts as flat: 0.05 rad
_STILL_M = 1e-12  # of an object in an interval
SURELY = 0.7  # of an object's friction: at its limit it slips


@dataclass(frozen=True, eq=False)
class PushingCone:
    """Body twists of b0 that an object follows.

    Attributes:
        contacts: Where they touch, in b0, (k, 2) [m].
        facets: Twists t with facets @ t <= 0 are held, (f, 3).
        room_m: How far it may slide along a flat front until its centroid is beyond contact.
    """

    contacts: Array
    facets: Array
    room_m: float

    def holds(self, twists: ArrayLike) -> NDArray[np.bool_]:
        """True for body twists (s_u, s_v, s_r) of b0 (..., 3) that keep the object, (...,)."""
        given = np.asarray(twists, dtype=float)
        size = np.linalg.norm(given, axis=-1, keepdims=True)
        return (given @ self.facets.T <= _OFF * size).all(axis=-1)

    def bends(self, ahead: Array, at: Array) -> tuple[float, float] | None:
        """Curvatures [1/m] of paths along which an object is held, from the one to the other.

        Args:
            ahead: Direction in b0 in which a point of it moves, (2,).
            at: The point in b0, (2,) [m].

        Returns:
            The least, to the right, and the largest; None where friction never holds it.
        """
        x, y = at.tolist()
        still, turning = self.facets[:, :2] @ ahead, self.facets @ np.array([y, -x, 1.0])
        fixed = np.abs(turning) < _FLAT
        ends = -still[~fixed] / turning[~fixed]
        low = float(ends[turning[~fixed] < 0].max(initial=-np.inf))
        high = float(ends[turning[~fixed] > 0].min(initial=np.inf))
        return None if low > high or (still[fixed] > _OFF).any() else (low, high)


def pushing_cone(
    geometry: Geometry, kappa: ArrayLike, thing: Object, pose_in_b0: ArrayLike, friction: float
) -> PushingCone:
    """Motions of a robot in one shape that an object it touches follows.

    Args:
        geometry: Lengths of the robot.
        kappa: Its curvatures, (n,) [1/m].
        thing: The object.
        pose_in_b0: Where it is in the frame of b0, (3,).
        friction: Coefficient between robot and object.
    """
    contour, pose = Contour.of(thing.own), np.asarray(pose_in_b0, dtype=float)
    q = np.concatenate([inverse(pose), np.asarray(kappa, dtype=float)])
    points, into = contacts(geometry, contour, q)
    turn = rotation(pose[2])
    middle, load = _load(contour, pose)
    points, into = points @ turn + pose[:2], into @ turn
    across = friction * np.column_stack([-into[:, 1], into[:, 0]])
    forces = np.concatenate([into + across, into - across])
    arms = np.tile(points - middle, (2, 1))
    torque = (arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]) / load[2, 2]
    facets = _facets(np.column_stack([forces, torque])) @ load
    return PushingCone(points, facets, _room_m(points - middle, into))


def _room_m(points: Array, into: Array) -> float:
    """Room of a centroid at zero between contacts (k, 2) in a line, with normals; 0: in none."""
    spread = points - points.mean(axis=0) if len(points) else np.zeros((1, 2))
    along = np.linalg.eigh(spread.T @ spread)[1][:, -1]
    if not len(points) or np.abs(into @ along).max() > _LEVEL:
        return 0.0
    places = points @ along
    return float(max(min(places.max(), -places.min()), 0.0))


def _load(contour: Contour, pose: Array) -> tuple[Array, Array]:
    """Centroid in b0 (2,), and the load of a twist of b0, (3, 3): its torque over c."""
    x, y = middle = contour.centroid @ rotation(pose[2]) + pose[:2]
    wide = 0.6 * np.sqrt(contour.area_m2 / np.pi)
    return middle, np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, wide]])


@dataclass(frozen=True, eq=False)
class Pulls:
    """Most that one wheel has to pull while an object is moved, over the object's friction.

    A wheel pulls along its rim alone: forces and torques that wheels of equal pull can give are a
    zonotope, whose facets lie along two wheels each. What drags least is moved where they pull on
    all four.

    Attributes:
        pose_in_b0: Where the object is in the frame of b0, (3,).
        facets: Normals of the zonotope's facets, one long at a pull of one, (f, 3).
        load: Load of a twist of b0, (3, 3): its torque over c.
    """

    pose_in_b0: Array
    facets: Array
    load: Array

    @classmethod
    def of(cls, robot: Robot, kappa: Array, thing: Object, pose_in_b0: Array) -> Pulls:
        """Those of a robot in a shape (n,) with an object at a pose in the frame of b0, (3,)."""
        wheels = drive_rows(robot, kappa)[1] * robot.geometry.wheel_radius_m
        facets = np.array([np.cross(*two) for two in itertools.combinations(wheels, 2)])
        facets = facets[np.linalg.norm(facets, axis=1) > _FLAT]
        facets /= np.abs(facets @ wheels.T).sum(axis=1, keepdims=True)
        return cls(pose_in_b0, facets, _load(Contour.of(thing.own), pose_in_b0)[1])

    def __call__(self, twists: Array) -> Array:
        """The pull at each of body twists of b0 (..., 3), (...,)."""
        loads = twists @ self.load.T
        sizes = np.maximum(np.linalg.norm(loads, axis=-1, keepdims=True), _STILL_M)
        most: Array = np.abs(loads / sizes @ self.load @ self.facets.T).max(axis=-1)
        return most


def _facets(generators: Array) -> Array:
    """Normals n of a cone's facets: loads x are in it if n . x <= 0 for all, (f, 3)."""
    if not len(generators):
        return np.concatenate([np.eye(3), -np.eye(3)])
    rays = generators / np.linalg.norm(generators, axis=1, keepdims=True)
    squares, axes = np.linalg.eigh(rays.T @ rays)
    rank, axes = int((squares > 1e-12).sum()), axes.T[::-1]
    flat = np.concatenate([axes[rank:], -axes[rank:]])
    own = rays @ axes[:rank].T
    if rank == 3:
        from scipy.spatial import ConvexHull  # only then anyone waits for it

        hull = ConvexHull(np.concatenate([np.zeros((1, 3)), own]))
        across = hull.equations[np.abs(hull.equations[:, 3]) <= _FLAT, :3]
    else:
        across = own if rank == 1 else np.column_stack([-own[:, 1], own[:, 0]])
    sides = np.concatenate([across, -across])
    sides = sides[(sides @ own.T <= _FLAT).all(axis=1)]
    sides = sides[np.unique(np.round(sides, 9), axis=0, return_index=True)[1]]
    return np.concatenate([flat, sides @ axes[:rank]])
