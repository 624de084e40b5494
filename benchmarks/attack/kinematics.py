r"""The kinematics written anew, in complex numbers: nothing here is of ``twosra_mpc.model``.

A point of the plane is z = x + iy, a frame (z, theta). A segment of length l that bends by alpha
leads from its end towards LU1 to the other one: z + e^{i theta} l E(alpha), with
E(alpha) = (e^{i alpha} - 1) / (i alpha), and theta + alpha. Everything else is derivatives of that.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from benchmarks.attack.body import apart_m
from twosra_mpc import Robot
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode

_SPARE_M = 1e-3  # of parts: outlines that planners keep apart are a little wider than they are
_SPARE_LEVER = 0.02
_SMALL = 0.4  # rad: below, E is a series
_TERMS = 14
_COEFFICIENTS = [1j**k / math.factorial(k + 1) for k in range(_TERMS)]


def arc(alpha: float) -> tuple[complex, complex]:
    """E(alpha) and its derivative."""
    if abs(alpha) > _SMALL:
        turned = cmath.exp(1j * alpha)
        mean = (turned - 1) / (1j * alpha)
        return mean, (turned - mean) / alpha
    value = slope = 0j
    for k in range(_TERMS - 1, -1, -1):
        slope = slope * alpha + value
        value = value * alpha + _COEFFICIENTS[k]
    return value, slope


class Frame(NamedTuple):
    """A frame and its derivative: place [m], angle [rad]."""

    z: complex
    theta: float
    dz: complex
    dtheta: float

    def along(
        self, step: complex, dstep: complex = 0j, turn: float = 0.0, dturn: float = 0.0
    ) -> Frame:
        """The frame a step on, given in this frame, and turned."""
        heading = cmath.exp(1j * self.theta)
        dz = self.dz + heading * (dstep + 1j * self.dtheta * step)
        return Frame(self.z + heading * step, self.theta + turn, dz, self.dtheta + dturn)

    @property
    def velocity(self) -> complex:
        """Derivative of the place, in the frame itself."""
        return self.dz * cmath.exp(-1j * self.theta)


_FIXED = Frame(0j, 0.0, 0j, 0.0)


@dataclass(frozen=True)
class Reference:
    """Rates of a robot's configuration and wheels.

    Attributes:
        robot: The description, of which only the numbers are used.
    """

    robot: Robot

    @cached_property
    def lengths(self) -> tuple[float, ...]:
        """Of the segments [m]."""
        return self.robot.geometry.lengths_m

    @cached_property
    def wheels(self) -> list[tuple[complex, complex]]:
        """Place and drive direction of each wheel in the frame of its fibre end."""
        placed = self.robot.geometry.wheel_placement
        return [(complex(x, y), cmath.exp(1j * angle)) for x, y, angle in placed]

    @cached_property
    def paper_wheels(self) -> bool:
        """Whether only side wheels turn in soft modes, as far as their units go."""
        return self.robot.path.model != "arc"

    def chain(self, kappa: Array, bending: Array, outward: int) -> tuple[Frame, Frame]:
        """(b0, fibre end) from the fibre end of the other unit, while segments bend.

        Args:
            kappa: Curvatures [1/m].
            bending: Derivatives of the bending angles.
            outward: 1 towards LU2, -1 towards LU1.
        """
        here = at_b0 = _FIXED
        geometry, count = self.robot.geometry, len(self.lengths)
        link, middle = geometry.middle_link_m, count // 2  # b0 is before segment ``middle``
        for number in range(count):
            j = number if outward > 0 else count - 1 - number
            if number:
                here = here.along(outward * link)
            length, da = self.lengths[j], float(bending[j])
            value, slope = arc(outward * float(kappa[j]) * length)
            turn = outward * float(kappa[j]) * length
            step, dstep = outward * length * value, length * slope * da
            here = here.along(step, dstep, turn, outward * da)
            if j == (middle - 1 if outward > 0 else middle):
                at_b0 = here.along(outward * link / 2 if count > 1 else 0.0)
        return at_b0, here

    def ends(self, kappa: Array) -> tuple[Frame, Frame]:
        """Fibre ends of LU1 and LU2 in b0."""
        still = np.zeros(len(self.lengths))
        b0, end = self.chain(kappa, still, 1)
        back = Frame(-b0.z * cmath.exp(-1j * b0.theta), -b0.theta, 0j, 0.0)
        return back, back.along(end.z, turn=end.theta)

    def soft(self, q: Array, mode: Mode, unit: int) -> tuple[Array, Array]:
        """(dq, wheel angles) per travel of a unit (0 or 1) in a soft mode [1/m]."""
        rates = self._arcs if self.robot.path.model == "arc" else self._curves
        moved, turn, bent, wheels = rates(q[POSE:], mode, unit)
        moved *= cmath.exp(1j * float(q[2]))
        return np.array([moved.real, moved.imag, turn, *bent]), wheels

    def _arcs(
        self, kappa: Array, mode: Mode, unit: int
    ) -> tuple[complex, float, list[float], Array]:
        outward, path = (-1, 1)[unit], self.robot.path
        per_w = [s * length / self.lengths[0] for s, length in zip(mode, self.lengths, strict=True)]
        b0, end = self.chain(kappa, np.array(per_w), outward)
        rolled = [self._rolled(end, wheel) for wheel in (2 * unit, 2 * unit + 1)]
        if path.speed_reference == "side_wheel":
            speed = math.copysign(1.0, self._rolled_straight(unit)) * rolled[0]
        else:
            speed = abs(end.dz)
        wheels = np.zeros(4)
        wheels[2 * unit : 2 * unit + 2] = np.array(rolled) / speed / self._radius_m
        bent = [rate / length / speed for rate, length in zip(per_w, self.lengths, strict=True)]
        return b0.velocity / speed, b0.dtheta / speed, bent, wheels

    @property
    def _radius_m(self) -> float:
        return self.robot.geometry.wheel_radius_m

    def _rolled(self, end: Frame, wheel: int) -> float:
        place, drive = self.wheels[wheel]
        return float(((end.velocity + 1j * end.dtheta * place) * drive.conjugate()).real)

    def _rolled_straight(self, unit: int) -> float:
        """What the side wheel rolls while the straight segment next to its unit bends to +y."""
        outward, length = (-1, 1)[unit], self.lengths[0]
        value, slope = arc(0.0)
        end = _FIXED.along(outward * length * value, length * slope, 0.0, outward)
        return self._rolled(end, 2 * unit)

    def _curves(
        self, kappa: Array, mode: Mode, unit: int
    ) -> tuple[complex, float, list[float], Array]:
        """Fitted curves of two equal segments: I next to the moving unit, II far from it, III."""
        alpha = [float(k) * length for k, length in zip(kappa, self.lengths, strict=True)]
        far, bent = 1 - unit, [0.0, 0.0]
        rate, displaced = self._fitted
        if all(mode):
            bent = [rate(2, a) for a in alpha]
        elif mode[unit]:
            bent[unit] = rate(0, alpha[unit])
        else:
            bent[far] = rate(1, alpha[far])
        side, at = (-1, 1)[unit], displaced(alpha[far])
        arm = complex(side * at.real, self.robot.geometry.middle_link_m / 2 + at.imag)
        wheels = np.zeros(4)
        wheels[2 * unit] = (1, -1)[unit] / self._radius_m
        return arm * bent[far], side * bent[far], [b / self.lengths[0] for b in bent], wheels

    @cached_property
    def _fitted(self) -> tuple[Callable[[int, float], float], Callable[[float], complex]]:
        """(case, alpha) -> bending angle per travel; alpha -> displacement of b0 per angle."""
        path, length = self.robot.path, self.lengths[0]
        if path.model == "cardioid":
            share, size = path.phi_per_alpha, path.radius_m

            def rate(k: int, alpha: float) -> float:
                return 1 / (share[k] * 2 * size[k] * (1 + math.cos(share[k] * alpha)))

            def displaced(alpha: float) -> complex:
                arm = 4 * share[0] * size[0] * math.cos(share[0] * alpha / 2)
                return arm * 1j * cmath.exp(-1j * (alpha - 1.5 * share[0] * alpha))

            return rate, displaced
        scale, growth, ratio, eps = path.scale, path.growth, path.angle_ratio, path.smoothing_rad
        phases = [math.pi, math.pi, 0.0 if path.model == "log_spiral_corrected" else math.pi]

        def radius(k: int, alpha: float) -> float:
            size = math.hypot(alpha, eps) - eps
            return scale[k] * length * math.exp(-growth[k] * (size / ratio[k] + phases[k]))

        def displaced(alpha: float) -> complex:
            return radius(0, alpha) / ratio[0] * 1j * cmath.exp(-1j * alpha * (1 - 1 / ratio[0]))

        return (lambda k, alpha: ratio[k] / radius(k, alpha)), displaced

    def rigid(self, kappa: Array) -> Array:
        """Wheel angles per twist (u, v, r) of b0, (4, 3) [1/m, 1/m, 1]."""
        rows = []
        for number, (place, drive) in enumerate(self.wheels):
            end = self.ends(kappa)[number // 2]
            heading = cmath.exp(1j * end.theta)
            at, way = end.z + heading * place, heading * drive
            rows.append([way.real, way.imag, (1j * at * way.conjugate()).real])
        return np.array(rows) / self._radius_m

    def room_m(self, kappa: Array) -> float:
        """Least distance between the units' frames along any of their sides; negative: overlap."""
        geometry, half = self.robot.geometry, self.robot.geometry.unit_frame_m / 2
        corners, sides = [], []
        for side, end in zip((-1, 1), self.ends(kappa), strict=True):
            heading = cmath.exp(1j * end.theta)
            middle = side * (geometry.end_link_m + geometry.unit_side_m / 2)
            outward = complex(middle, geometry.unit_offset_m)
            around = [complex(x, y) * half for x in (-1, 1) for y in (-1, 1)]
            corners.append(np.array([end.z + heading * (outward + c) for c in around]))
            sides += [heading, 1j * heading]
        gaps = []
        for side in sides:
            one, two = ((c * np.conj(side)).real for c in corners)
            gaps.append(max(one.min() - two.max(), two.min() - one.max()))
        return max(gaps)

    def clear(self, kappa: Array) -> bool:
        """Whether units keep the robot's gap, and no parts meet, with a little to spare."""
        apart = self.room_m(kappa) >= self.robot.limits.unit_gap_m + 1e-4
        return apart and apart_m(self.robot.geometry, kappa) >= _SPARE_M

    def steady(self, kappa: Array) -> bool:
        """Whether the robot may drive in a shape (the limit ``wheel_independence``)."""
        rolled = self.rigid(kappa) * self._radius_m / np.array([1.0, 1.0, 0.1])
        gram = rolled.T @ rolled
        least = 2 * math.sqrt(max(0.0, float(np.linalg.det(gram)))) / float(np.trace(gram))
        return least >= self.robot.limits.wheel_independence

    def holds(self, path: Array, mode: Mode) -> bool:
        """Whether wheels bend a segment that is soft alone along shapes (m, n), and hold it then.

        A little more than the limit ``bend_lever`` asks for.
        """
        least, j = self.robot.limits.bend_lever, mode.index(1)
        if least is None or sum(mode) > 1:
            return True
        levers = np.array([self.lever(kappa, j) for kappa in path])
        bent = path[:, j] * self.lengths[j]
        away = np.append(np.diff(np.abs(bent)) > 0, True)
        pushing = levers * np.where(bent < 0, -1.0, 1.0)
        kept = np.maximum(-pushing, pushing - least * np.abs(bent)) >= _SPARE_LEVER
        same = np.append((levers[1:] > 0) == (levers[:-1] > 0), True)
        return bool((kept[away].all()) and same[away].all())

    def lever(self, kappa: Array, j: int) -> float:
        """How far the points come together about which units turn, per angle, in lengths of j."""
        _, end = self.chain(kappa, np.eye(len(kappa))[j], 1)
        one, two = (_meeting(*self.wheels[first : first + 2]) for first in (0, 2))
        far = end.along(two)
        apart = far.z - one
        return -float((far.dz * apart.conjugate()).real) / abs(apart) / self.lengths[j]


def _meeting(one: tuple[complex, complex], other: tuple[complex, complex]) -> complex:
    """Where the lines through two wheels along their drive directions meet."""
    across = ((other[0] - one[0]) * other[1].conjugate()).imag
    return one[0] + one[1] * across / (one[1] * other[1].conjugate()).imag
