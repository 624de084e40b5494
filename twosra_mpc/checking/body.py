"""Parts of a robot that meet, in intervals: section 2 of ``docs/certificate.md``.

A second account of ``model.self_collision`` for ``checking.fibre``, which shares no code with it.
Parts that are joined are left out: to ignore what meets is to prove less.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from flint import arb

from twosra_mpc.problem.tolerances import BODY_TOLERANCE_M
from twosra_mpc.robot.description import Robot

_OVERLAP_M = BODY_TOLERANCE_M + 1e-6  # by which parts overlap in no plan that is verified


class Rectangle(NamedTuple):
    """A part of the robot, or one of its chords; numbers are intervals, or arrays.

    Attributes:
        place: Along the fibre: 0 is LU1, then segments (odd) and links between them, in turn.
        unit: Whether it is the frame of a locomotion unit.
        numbers: Middle (x, y), unit vector (c, s) along it and half lengths [m].
    """

    place: int
    unit: bool
    numbers: tuple[Any, ...]


class Nearest(NamedTuple):
    """The shape in which parts are nearest: its number, how far about, and whether they meet.

    ``meet`` is true only if they surely are nearer than in any plan that is verified.
    """

    number: int
    apart_m: float
    meet: bool


def nearest(robot: Robot, shapes: Sequence[Sequence[arb]]) -> Nearest:
    """Find in floats which parts are nearest in which shape, and prove there that they meet."""
    about = np.array([[float(k.mid()) for k in kappa] for kappa in shapes]).T
    parts = list(_rectangles(robot, list(about)))
    pairs = [
        (i, k)
        for i, k in itertools.combinations(range(len(parts)), 2)
        if (joints := parts[k].place - parts[i].place) > 2
        or (joints == 2 and not parts[i].place % 2)
    ]
    gaps_m = [robot.limits.unit_gap_m * (parts[i].unit and parts[k].unit) for i, k in pairs]
    numbers = np.array([np.broadcast_arrays(*about, *part.numbers)[len(about) :] for part in parts])
    ends = (tuple(np.moveaxis(numbers[list(which)], 1, 0)) for which in zip(*pairs, strict=True))
    apart_m = np.max(_separations(*ends), axis=0) - np.array(gaps_m)[:, None]
    pair, number = np.unravel_index(apart_m.argmin(), apart_m.shape)
    least_m, meet = float(apart_m[pair, number]), False
    if least_m < -_OVERLAP_M:
        surely = list(_rectangles(robot, shapes[number]))
        one, other = (surely[at].numbers for at in pairs[pair])
        meet = all(gap < gaps_m[pair] - _OVERLAP_M for gap in _separations(one, other))
    return Nearest(int(number), least_m, meet)


def outermost_m(robot: Robot) -> float:
    """Largest distance of a point of the robot from b0, in any shape [m]."""
    geometry, inner = robot.geometry, robot.geometry.inner_link_of_b0
    parts = itertools.chain(*(_unit(robot, (0.0, 0.0, 0.0), unit) for unit in (0, 1)))
    hung_m = max(
        abs(complex(x, y) + complex(c, s) * complex(length * along, width * across))
        for x, y, c, s, length, width in (part.numbers for part in parts)
        for along, across in itertools.product((-1, 1), repeat=2)
    )
    sides = geometry.lengths_m[:inner], geometry.lengths_m[inner:]
    along_m = max(sum(side) + max(len(side) - 1, 0) * geometry.middle_link_m for side in sides)
    return geometry.half_link_m + along_m + max(hung_m, geometry.fibre_radius_m)


def _separations(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Separations of two rectangles along the sides of both; the largest one counts."""
    found, (x, y) = list[Any](), (b[0] - a[0], b[1] - a[1])
    c, s = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])
    for (_, _, along, across, length, width), other in ((a, b), (b, a)):
        on, beside = abs(along * x + across * y), abs(along * y - across * x)
        found += [on - length - c * other[4] - s * other[5]]
        found += [beside - width - s * other[4] - c * other[5]]
    return found


def _rectangles(robot: Robot, kappa: Sequence[Any]) -> Iterator[Rectangle]:
    """The parts from LU1 to LU2, in the frame of LU1's fibre end."""
    geometry, at = robot.geometry, (0.0, 0.0, 0.0 * kappa[0])
    thin = geometry.fibre_radius_m
    yield from _unit(robot, at, 0)
    for j, length in enumerate(geometry.lengths_m):
        if j and geometry.middle_link_m:
            half = geometry.middle_link_m / 2
            yield Rectangle(2 * j, False, _placed(at, (half, 0.0), (half, thin)))
            at = _along(at, 2 * half, 0.0 * kappa[j])
        run = length / robot.body.chords(j)
        inward, grown = kappa[j] * run**2 / 16, abs(kappa[j])
        half_m = (run / 2 * (1 + grown * thin), thin + grown * run**2 / 16)
        for _ in range(robot.body.chords(j)):
            middle = _along(at, run / 2, kappa[j])
            yield Rectangle(2 * j + 1, False, _placed(middle, (0.0, inward), half_m))
            at = _along(at, run, kappa[j])
    yield from _unit(robot, at, 1)


def _unit(robot: Robot, at: tuple[Any, Any, Any], unit: int) -> Iterator[Rectangle]:
    """A locomotion unit, its end link and its wheels."""
    geometry, side, place = robot.geometry, (-1, 1)[unit], 2 * unit * robot.geometry.segments
    half, out = geometry.unit_frame_m / 2, geometry.end_link_m / 2
    centre = side * (2 * out + geometry.unit_side_m / 2), geometry.unit_offset_m
    yield Rectangle(place, True, _placed(at, centre, (half, half)))
    yield Rectangle(place, False, _placed(at, (side * out, 0.0), (out, geometry.fibre_radius_m)))
    tread = geometry.wheel_radius_m, geometry.wheel_thickness_m / 2
    for x, y, turn in geometry.wheel_placement[2 * unit : 2 * unit + 2]:
        yield Rectangle(place, False, _placed(at, (x, y), tread, turn))


def _placed(
    at: tuple[Any, Any, Any], middle: tuple[Any, Any], half_m: tuple[Any, Any], turn: float = 0.0
) -> tuple[Any, ...]:
    c, s, _ = _waves(at[2])
    x, y = at[0] + c * middle[0] - s * middle[1], at[1] + s * middle[0] + c * middle[1]
    return (x, y, *_waves(at[2] + turn)[:2], *half_m)


def _along(at: tuple[Any, Any, Any], run: float, kappa: Any) -> tuple[Any, Any, Any]:
    """The pose at the end of an arc that begins at another."""
    (c, s, _), a = _waves(at[2]), kappa * run
    half, whole = _waves(a / 2)[2], _waves(a)[2]
    x, y = run * whole, run * a * half * half / 2
    return at[0] + c * x - s * y, at[1] + s * x + c * y, at[2] + a


def _waves(angle: Any) -> tuple[Any, Any, Any]:
    """Cosine, sine and sin(a) / a."""
    if isinstance(angle, arb):
        return angle.cos(), angle.sin(), angle.sinc()
    return np.cos(angle), np.sin(angle), np.sinc(angle / math.pi)
