r"""Configurations that touch an outline: closed around it, or laid along it.

For a grasp the link of b0 is laid on the outline, tangent to it. Then segments close, those next to
it first, until something of what they move touches: the first touch, by steps and halving. A robot
whose links have no length touches a disc of radius R all along, at :math:`\kappa = 1 / (R + r_f)`,
:math:`r_f` the radius of the fibre. A segment that is laid along an outline touches it in its
middle and closes about that.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.problem.limits import BODY_GAP, CURVATURE, SHAPE_LIMITS, UNIT_GAP, shape_margins
from twosra_mpc.problem.world import Object, Obstacle
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.contour import Contour, apart_m, farthest_m, parts, wraps_rad
from twosra_mpc.space.footprint import reach_per_curvature_m2

Rows = NDArray[np.intp]
Place = Callable[[Array, Rows], Array]  # curvatures (k,), rows (k,) -> configurations (k, 3 + n)
Rooms = Callable[[Array, Rows], Array]  # the same -> room of parts, (2 segments, k) [m]

TOUCHES_M = 5e-6  # what chords miss: as near counts as touching, as deep as not overlapping
_STEP_PER_M, _OPENING_PER_M = 0.5, 2.0  # of curvatures: 0.4 mm and 1.6 mm of 40 mm
_STEPS, _ROOM_M = 64, 2e-7  # at most, until so little room is left


class Closed(NamedTuple):
    """Closing angles of configurations.

    Attributes:
        curvature: Towards the thing, (m,) [1/m].
        touches: Whether something touches there, (m,).
        fits: Whether nothing overlaps there, (m,).
    """

    curvature: Array
    touches: NDArray[np.bool_]
    fits: NDArray[np.bool_]


class _Bracket(NamedTuple):
    """Curvatures (m,) at which parts are apart and overlap, NaN if not known, and room there.

    They are narrowed in place.
    """

    low: Array
    high: Array
    above: Array
    below: Array

    def narrow(self, rows: Rows, at: Array, room: Array) -> None:
        """Take in the room at further curvatures."""
        met = room < 0
        self.high[rows[met]], self.below[rows[met]] = at[met], room[met]
        self.low[rows[~met]], self.above[rows[~met]] = at[~met], room[~met]


def close(
    robot: Robot,
    contour: Contour,
    place: Place,
    start: Array,
    segments: tuple[int, ...],
    gap_m: float,
) -> Closed:
    """Close until the parts that segments move are nearer to a contour than a gap.

    Where they overlap at once they open first, until nothing does.

    Args:
        robot: The robot.
        contour: What they close on.
        place: Configurations of common curvatures.
        start: Curvatures to start from, (m,) [1/m].
        segments: Segments that move, from 0.
        gap_m: What is left between them and the contour.
    """
    most, reach = robot.limits.curvature_per_m, _reach_m2(robot.geometry, segments)

    def rooms(curvature: Array, rows: Rows) -> Array:
        return _rooms_m(robot, contour, place(curvature, rows), segments, gap_m)

    above = rooms(start, np.arange(len(start))).min(axis=0)
    found = _Bracket(np.array(start), np.full(len(start), np.nan), above, above.copy())
    _open(rooms, found, most)
    fits = found.low >= -most
    _approach(rooms, found, reach, most)
    touches = np.isfinite(found.high)
    _halve(rooms, found, touches & fits)
    return Closed(found.low, touches, fits)


def _open(rooms: Rooms, found: _Bracket, most: float) -> None:
    """Open what overlaps, by steps, until it does no more or is bent the other way by ``most``."""
    low, high, above, below = found
    opening = np.flatnonzero(above < 0)
    while len(opening):
        high[opening], below[opening] = low[opening], above[opening]
        low[opening] -= _OPENING_PER_M
        opening = opening[low[opening] >= -most]
        above[opening] = rooms(low[opening], opening).min(axis=0)
        opening = opening[above[opening] < 0]


def _approach(rooms: Rooms, found: _Bracket, reach: Array, most: float) -> None:
    """Close what has not overlapped yet by steps in which it cannot, or small ones."""
    closing = np.flatnonzero(np.isnan(found.high))
    left = rooms(found.low[closing], closing)
    while len(closing):
        step = np.maximum((left / reach).min(axis=0), _STEP_PER_M)
        ahead = np.minimum(found.low[closing] + step, most)
        left = rooms(ahead, closing)
        least = left.min(axis=0)
        found.narrow(closing, ahead, least)
        further = (least >= 0) & (ahead < most)
        closing, left = closing[further], left[:, further]


def _halve(rooms: Rooms, found: _Bracket, some: NDArray[np.bool_]) -> None:
    """Narrow brackets until little room is left, where the secant of their ends is zero.

    An end that stays counts for half as much each time (Illinois); every fourth step halves.
    """
    between = np.flatnonzero(some & (found.above > _ROOM_M))
    before, weight = np.full(len(some), 2), np.ones((2, len(some)))
    for step in range(_STEPS):
        if not len(between):
            break
        low, high, above, below = (each[between] for each in found)
        ends = np.array([above - _ROOM_M / 2, _ROOM_M / 2 - below]) * weight[:, between]
        share = np.full(len(between), 0.5) if step % 4 == 3 else ends[0] / ends.sum(axis=0)
        at = low + share * (high - low)
        room = rooms(at, between).min(axis=0)
        found.narrow(between, at, room)
        met = room < 0
        again = np.where(met == before[between], 0.5, 1.0)
        weight[:, between] = np.where([met, ~met], weight[:, between] * again, 1.0)
        before[between] = met
        between = between[found.above[between] > _ROOM_M]


def _rooms_m(
    robot: Robot, contour: Contour, q: Array, segments: tuple[int | None, ...], gap_m: float
) -> Array:
    """Distance beyond a gap of what is rigid and of the arc of each segment, (2 segments, m) [m].

    Of the parts of configurations (m, 3 + n) that segments move; None: those that b0 is on.
    """
    if not len(q):
        return np.zeros((2 * len(segments), 0))
    geometry = robot.geometry
    each = [apart_m(geometry, contour, parts(geometry, q, j)) for j in segments]
    return np.concatenate(each) - gap_m + TOUCHES_M


def _reach_m2(geometry: Geometry, segments: tuple[int, ...]) -> Array:
    """Most that segments, outwards, move parts of ``_rooms_m`` per 1/m, (2 segments, 1) [m2]."""
    whole = float(reach_per_curvature_m2(geometry)[list(segments)].sum())
    found, moved, along = list[float](), 0.0, 0.0
    for length in (geometry.lengths_m[j] for j in segments):
        moved += along * (geometry.middle_link_m + length) + length**2 / 2
        along += length  # that turns what is further out
        found += [whole, moved]
    return np.array(found)[:, None]


OVERLAPS = "overlaps the object"
NOTHING = "nothing to wrap"
IN_THE_WAY = "a unit, wheel or link touches first"
LEAVES = "leaves the outline by more than gap_m"
BEYOND = f"a segment would bend beyond {CURVATURE.name}"
_WORDS = {
    UNIT_GAP.name: "the units would meet",
    BODY_GAP.name: "other parts of the robot would meet",
    CURVATURE.name: BEYOND,
}

_FREE = 9  # curvatures tried for a segment that is left free


@dataclass(frozen=True, eq=False)
class Touch:
    """A configuration that touches a thing.

    Attributes:
        configuration: Of the robot where the thing is at the origin of its own frame, (3 + n,);
            NaN for curvatures that are left free.
        slack_per_m: By how much less segments may close, b0 where it is, (n,) [1/m].
        wrap_rad: How far the normals of contacts turn from one end of the robot to the other.
        side: 1 with the thing on +y of b0, -1 on -y.
    """

    configuration: Array
    slack_per_m: Array
    wrap_rad: float
    side: int

    @property
    def kappa(self) -> Array:
        """Curvatures, (n,) [1/m]."""
        return self.configuration[POSE:]

    @property
    def pose_in_b0(self) -> Array:
        """Pose of the thing's frame in b0, (3,)."""
        return inverse(self.configuration[:POSE])


@dataclass(frozen=True, eq=False)
class TouchSet:
    """The configurations found that touch a thing, those that embrace most first.

    Attributes:
        touches: At most one for each place around the outline and each side of the robot.
        refused: Why other places have none -> how many.
    """

    touches: tuple[Touch, ...]
    refused: Mapping[str, int] = field(default_factory=dict)

    @property
    def best_wrap_rad(self) -> float:
        """Most that a touch embraces, 0 if there is none."""
        return max((touch.wrap_rad for touch in self.touches), default=0.0)


def grasp_touches(robot: Robot, thing: Object, gap_m: float = 0.0) -> TouchSet:
    """Configurations closed around an object, from 72 places around it (a disc: one).

    Args:
        robot: The robot.
        thing: What it closes around; at the origin of its own frame.
        gap_m: What is left between robot and object.
    """
    contour, geometry = Contour.of(thing.own), robot.geometry
    side, poses = _on_both_sides(contour.stations(geometry.fibre_radius_m + gap_m))
    q = np.pad(poses, ((0, 0), (0, geometry.segments)))
    reasons = np.full(len(q), "", dtype=object)
    reasons[_rooms_m(robot, contour, q, (None,), gap_m).min(axis=0) < 0] = OVERLAPS
    for chain in _chains(geometry):
        _close_chain(robot, contour, q, chain, side, gap_m, reasons)
    _name_limits(robot, q, reasons)
    wraps = wraps_rad(geometry, contour, q, side, gap_m + 4 * TOUCHES_M)
    reasons[(reasons == "") & (wraps <= 0)] = NOTHING
    return _in_order(side, q, reasons, np.zeros((len(q), geometry.segments)), wraps)


def conform_touches(
    robot: Robot, outline: Obstacle, segments: Sequence[int], gap_m: float
) -> TouchSet:
    """Configurations with segments laid along an outline; the curvatures of others are left free.

    Args:
        robot: The robot.
        outline: What they are laid along, in a frame of its own.
        segments: Which segments, from 1: the next to b0 on a side, or on both sides.
        gap_m: How far from the outline a segment may be anywhere along it.

    Raises:
        InputError: If a segment between b0 and the ones asked for is left out.
    """
    contour, geometry = Contour.of(outline), robot.geometry
    asked = {j - 1 for j in segments}
    wholes = _chains(geometry)
    chains = [tuple(j for j in chain if j in asked) for chain in wholes]
    if any(c != whole[: len(c)] for c, whole in zip(chains, wholes, strict=True)):
        raise InputError("segments", segments, "segments that begin next to b0")
    chains = [chain for chain in chains if chain]
    own, lengths = sorted(asked), np.array(geometry.lengths_m)[sorted(asked)]
    side, stations = _on_both_sides(contour.stations(geometry.fibre_radius_m))
    reasons = np.full(len(stations), "", dtype=object)
    if len(chains) == 1:
        q = _laid(robot, contour, stations, chains[0][0], side, reasons)
        rest = [chains[0][1:]] if chains[0][1:] else []
    else:
        q, rest = np.pad(stations, ((0, 0), (0, geometry.segments))), chains
    overlap = _rooms_m(robot, contour, q, (None,), 0.0).min(axis=0) < 0
    reasons[overlap & (reasons == "")] = OVERLAPS
    for chain in rest:
        _close_chain(robot, contour, q, chain, side, 0.0, reasons)
    gaps = np.array([farthest_m(geometry, contour, q, j) for j in own])
    for i in np.flatnonzero((reasons == "") & (gaps.max(axis=0) > gap_m + TOUCHES_M)):
        solids = [apart_m(geometry, contour, parts(geometry, q[i : i + 1], j))[0][0] for j in own]
        reasons[i] = IN_THE_WAY if min(solids) < 4 * TOUCHES_M else LEAVES
    q[:, [POSE + j for j in range(geometry.segments) if j not in asked]] = np.nan
    _name_limits(robot, q, reasons)
    slack = np.zeros((len(q), geometry.segments))
    slack[:, own] = 2 * np.clip(gap_m - gaps.T, 0.0, gap_m) / lengths**2
    return _in_order(side, q, reasons, slack, np.abs(q[:, [POSE + j for j in own]] @ lengths))


def _in_order(side: Array, q: Array, reasons: Array, slack: Array, wraps: Array) -> TouchSet:
    """Touches of configurations (m, 3 + n), those that embrace most first."""
    kept = np.flatnonzero(reasons == "")
    touches = [Touch(q[i], slack[i], float(wraps[i]), int(side[i])) for i in kept]
    ordered = sorted(touches, key=lambda touch: -round(touch.wrap_rad, 6))
    return TouchSet(tuple(ordered), dict(Counter(reasons[reasons != ""].tolist())))


def _chains(geometry: Geometry) -> list[tuple[int, ...]]:
    """Segments on either side of b0, from there outwards."""
    inner = geometry.inner_link_of_b0
    both = [tuple(range(inner))[::-1], tuple(range(inner, geometry.segments))]
    return [chain for chain in both if chain]


def _on_both_sides(poses: Array) -> tuple[Array, Array]:
    """Sides (2 m,), and poses (m, 3), then those turned round for -y to be on the outline."""
    turned = poses + np.array([0.0, 0.0, np.pi])
    return np.repeat([1.0, -1.0], len(poses)), np.concatenate([poses, turned])


def _close_chain(
    robot: Robot,
    contour: Contour,
    q: Array,
    chain: tuple[int, ...],
    side: Array,
    gap_m: float,
    reasons: Array,
) -> None:
    """Close segments of configurations (m, 3 + n) in place: all alike, then those further out.

    ``side`` is 1 or -1 for each of them, (m,).
    """
    start = np.zeros(len(q))
    for k in range(len(chain)):
        moving = chain[k:]
        rows = np.flatnonzero(reasons == "")
        if not len(rows):
            return

        def place(
            curvature: Array, at: Rows, rows: Rows = rows, moving: tuple[int, ...] = moving
        ) -> Array:
            placed = q[rows[at]]
            placed[:, [POSE + j for j in moving]] = (side[rows[at]] * curvature)[:, None]
            return placed

        done = close(robot, contour, place, start[rows], moving, gap_m)
        q[rows] = place(done.curvature, np.arange(len(rows)))
        start[rows] = done.curvature
        reasons[rows[~done.touches]] = BEYOND
        reasons[rows[~done.fits]] = OVERLAPS


def _laid(
    robot: Robot, contour: Contour, stations: Array, segment: int, side: Array, reasons: Array
) -> Array:
    """Configurations (m, 3 + n) with the middle of a segment next to b0 at stations, closed."""
    geometry = robot.geometry
    sign = 1 if segment >= geometry.inner_link_of_b0 else -1
    run = sign * geometry.lengths_m[segment] / 2

    def place(curvature: Array, at: Rows) -> Array:
        bend = side[at] * curvature * run
        half = np.sinc(bend / 2 / np.pi)
        chord = run * half
        x = sign * geometry.half_link_m + chord * np.cos(bend / 2)
        middle = np.column_stack([x, chord * np.sin(bend / 2), bend])
        q = np.zeros((len(at), POSE + geometry.segments))
        q[:, :POSE] = composed(stations[at], inverse(middle))
        q[:, POSE + segment] = side[at] * curvature
        return q

    rows = np.arange(len(stations))
    done = close(robot, contour, place, np.zeros(len(rows)), (segment,), 0.0)
    reasons[~done.touches] = BEYOND
    reasons[~done.fits] = IN_THE_WAY
    return place(done.curvature, rows)


def _name_limits(robot: Robot, q: Array, reasons: Array) -> None:
    """Give the limit that configurations (m, 3 + n) break as the reason against them.

    Where curvatures are left free, some must be allowed.
    """
    most, n = robot.limits.curvature_per_m, robot.geometry.segments
    for i in np.flatnonzero(reasons == ""):
        kappa = q[i, POSE:]
        choices = [[k] if np.isfinite(k) else np.linspace(-most, most, _FREE) for k in kappa]
        margins = shape_margins(robot, np.array([*itertools.product(*choices)]).reshape(-1, n))
        allowed = np.ones(len(margins[CURVATURE.name]), dtype=bool)
        for limit in SHAPE_LIMITS:
            allowed &= margins[limit.name] >= 0
            if not allowed.any():
                reasons[i] = _WORDS.get(limit.name, limit.name)
                break
