r"""Configuration from markers: least squares of the poses that a tracker gives, and calibration.

A tracker (ArUco, OptiTrack, ``/tf``) tells where each marker is and how it is turned. Marker i is
fixed at :math:`m_i` in the frame of its link, :math:`l_i(q)`, so that it is seen at

.. math:: p_i = f \circ q_{0} \circ l_i(q) \circ m_i,

with :math:`q_0` the pose of b0 and f that of the frame of the plan in the tracker's. Two markers
have six numbers, and a robot of two segments five: the one that is left over seldom tells that a
marker has moved, for another shape explains it; three markers do. `configuration_by_markers` solves
for q, `calibrated_markers` for m and f.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.arguments import check_size, public
from twosra_mpc.errors import InputError
from twosra_mpc.files import read_document, reading
from twosra_mpc.model import chain
from twosra_mpc.model.cache import per_body
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse, wrapped
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.validation import ArrayValue, Metres, PlanePose, Positive, Radians, Several, Value

_BENDS = 3  # curvatures of each segment from which a first fit begins
_AS_LIKELY = 9.0  # more of the sum of squares: three deviations less likely
_OTHER = 8  # bends apart by this part of the largest are two shapes
_UNSURE = 30.0  # times its noise: an offset less well known than that is not known

Link = Literal["unit 1", "unit 2", "middle link"]


class Marker(Value):
    """Marker: the link it is fixed to, and its pose in the frame of that link.

    Attributes:
        link: unit 1 and unit 2 have the frames b1 and b2 at the ends of the fibre, the middle
            link b0; all have their x axes along the fibre, towards unit 2.
        x_m: Along that axis.
        y_m: To its left.
        phi_rad: Heading of the marker in that frame.
    """

    link: Link
    x_m: Metres = 0.0
    y_m: Metres = 0.0
    phi_rad: Radians = 0.0


class Markers(Value):
    """Markers of a robot as a file has them, in the order in which a tracker tells their poses.

    Attributes:
        marker: Two or three of them.
        frame: Pose of the plan's frame in the tracker's (x, y, phi) [m, m, rad].
        noise_m: Standard deviation of a marker's place; default: rounding of the authors' camera.
        noise_rad: Of its heading; default: the same.
    """

    marker: Several[Marker]
    frame: PlanePose = (0.0, 0.0, 0.0)
    noise_m: Positive = 1e-3
    noise_rad: Positive = 0.02


@public
@dataclass(frozen=True, eq=False)
class Sighting(ArrayValue):
    """Configuration by markers.

    Attributes:
        q: Configuration that fits best, (3 + n,) [m, m, rad, 1/m ...].
        covariance: Of q, (3 + n, 3 + n), same units.
        residual_m: Largest distance of a marker from where that configuration has it.
        residual_rad: Largest turn of one from how that configuration has it.
    """

    q: Array
    covariance: Array
    residual_m: float
    residual_rad: float


@public
@dataclass(frozen=True, eq=False)
class Calibration(ArrayValue):
    """Markers by a drive, and how well the drive tells them.

    Attributes:
        markers: Where they are.
        deviation: Standard deviations of their places [m, m] and headings [rad], (markers, 3).
        residual: Root mean square of what is left, in units of the noise; about 1 if all is well.
    """

    markers: Markers
    deviation: Array
    residual: float


@public
def load_markers(path: str | Path) -> Markers:
    """Read markers from a TOML file: ``[[marker]]`` tables, ``frame`` and noise.

    Raises:
        InputError: If it cannot be read or is no such file.
    """
    with reading(str(path), "markers"):
        return Markers(**read_document(Path(path), str(path)))


@public
def marker_poses(robot: Robot, markers: Markers, q: ArrayLike) -> Array:
    """Return where a tracker sees the markers of a robot at q (3 + n,), (markers, 3) [m, m, rad].

    Raises:
        InputError: If q has another size.
    """
    at = np.array(check_size("q", q, robot.coordinates.size), float)
    return _expected(robot, markers)(at, *_fixed(markers))[0].full().T


@public
def configuration_by_markers(
    robot: Robot, markers: Markers, poses: Array, near: ArrayLike | None = None
) -> Sighting:
    """Return the configuration that fits poses of markers best.

    Args:
        robot: The robot.
        markers: Its markers.
        poses: As the tracker tells them, (markers, 3) [m, m, rad]; NaN for one that is not seen.
        near: Configuration to begin from, (3 + n,); default: several bends, of which the best.

    Raises:
        InputError: If what is seen does not tell the configuration, or fits several.
    """
    size, count = robot.coordinates.size, len(markers.marker)
    told = _poses(poses, (count, POSE))
    seen = np.isfinite(told).all(axis=1)
    function, fixed, scale = _expected(robot, markers), _fixed(markers), _scale(markers)[seen]

    def off(q: Array) -> Array:
        return _apart(function(q, *fixed)[0].full().T, told)[seen]

    def share(q: Array) -> Array:
        return np.asarray(off(q) / scale).ravel()

    def slopes(q: Array) -> Array:
        found = function(q, *fixed)[1].full().reshape(count, POSE, size)[seen] / scale[..., None]
        return np.asarray(found).reshape(-1, size)

    if near is None:
        starts = _starts(robot, function, fixed, told[seen][:1], int(np.argmax(seen)))
    else:
        starts = np.array([check_size("near", near, size)], float)
    if POSE * np.count_nonzero(seen) < size or np.linalg.matrix_rank(slopes(starts[0])) < size:
        names = [markers.marker[i].link for i in np.flatnonzero(seen).tolist()]
        allowed = f"markers on links enough to tell {size} numbers"
        raise InputError("poses", f"seen on: {', '.join(names) or 'none'}", allowed)
    found = np.array([_least_squares(share, slopes, q) for q in starts])
    costs = np.array([np.square(share(q)).sum() for q in found])
    q = found[np.argmin(costs)]
    left, by = off(q), slopes(q)
    others, most_per_m = found[:, POSE:], robot.limits.curvature_per_m
    possible = (costs < costs.min() + _AS_LIKELY) & (np.abs(others).max(axis=1) < 1.1 * most_per_m)
    if (np.abs(others[possible] - q[POSE:]) > most_per_m / _OTHER).any():
        raise InputError("poses", "they fit several shapes", "a third marker, or one shape as near")
    return Sighting(
        q=q,
        covariance=np.asarray(np.linalg.inv(by.T @ by), float),
        residual_m=float(np.hypot(*left[:, :2].T).max()),
        residual_rad=float(np.abs(left[:, 2]).max()),
    )


@public
def calibrated_markers(robot: Robot, markers: Markers, q: ArrayLike, poses: Array) -> Calibration:
    """Return where markers are, and the frame of the plan, from a drive.

    Drive rigidly and slowly, round by half a turn and then along. Wheels that slip make q wrong:
    5 % of slip moves a marker by 3 mm and 0.04 rad, and the residual is 3 then, not 1.

    Args:
        robot: The robot.
        markers: Which link each is on, and about where.
        q: Where the robot was, by its plan or its wheels, (times, 3 + n).
        poses: What the tracker told then, (times, markers, 3) [m, m, rad]; NaN where not seen.

    Raises:
        InputError: If the drive does not tell a marker's place: it must turn, and go along.
    """
    count = len(markers.marker)
    driven = np.asarray(q, float)
    if driven.ndim != 2 or driven.shape[1] != robot.coordinates.size:
        allowed = f"(times, {robot.coordinates.size}): a configuration for each time"
        raise InputError("q", f"an array {driven.shape}", allowed)
    told = _poses(poses, (len(driven), count, POSE))
    function, scale = _expected(robot, markers), _scale(markers)
    seen = np.isfinite(told).all(axis=2)

    def split(values: Array) -> tuple[Array, Array]:
        return values[:-POSE].reshape(count, POSE).T, values[-POSE:]

    def off(values: Array) -> Array:
        expected = [function(each, *split(values))[0].full().T for each in driven]
        return np.asarray((_apart(np.array(expected), told) / scale)[seen]).ravel()

    def slopes(values: Array) -> Array:
        found = [function(each, *split(values))[2].full() for each in driven]
        return np.asarray(
            (np.array(found).reshape(*told.shape, -1) / scale[..., None])[seen]
        ).reshape(-1, len(values))

    fixed, frame = _fixed(markers)[0], np.array(markers.frame)
    values = _least_squares(off, slopes, np.append(fixed.T.ravel(), frame))
    by = slopes(values)
    unknown = np.linalg.matrix_rank(by) < len(values)
    deviation = np.inf if unknown else np.sqrt(np.diag(np.linalg.inv(by.T @ by))[:-POSE])
    known = np.broadcast_to(deviation, count * POSE).reshape(count, POSE)
    if (known > _UNSURE * scale).any():
        worst = markers.marker[int(np.argmax((known / scale).max(axis=1)))].link
        allowed = "a drive that turns by half a turn, and goes along, with all markers in sight"
        raise InputError("q", f"marker on {worst} not told by it", allowed)
    offsets, frame = split(values)
    placed = tuple(
        Marker(link=each.link, x_m=x, y_m=y, phi_rad=phi)
        for each, (x, y, phi) in zip(markers.marker, offsets.T.tolist(), strict=True)
    )
    x, y, phi = frame.tolist()
    return Calibration(
        markers=markers.with_values(marker=placed, frame=(x, y, float(wrapped(np.array(phi))))),
        deviation=known,
        residual=math.sqrt(float(np.square(off(values)).mean())),
    )


def _poses(poses: Array, shape: tuple[int, ...]) -> Array:
    """Check the shape of what a tracker told."""
    told = np.asarray(poses, float)
    if told.shape != shape:
        raise InputError("poses", f"an array {told.shape}", f"{shape}: x, y, phi of each marker")
    return told


def _apart(expected: Array, told: Array) -> Array:
    """Differences of poses (..., 3), headings within half a turn."""
    off = expected - told
    return np.concatenate([off[..., :2], wrapped(off[..., 2:])], axis=-1)


def _fixed(markers: Markers) -> tuple[Array, Array]:
    """Offsets of the markers, (3, markers), and the frame of the plan, (3,)."""
    offsets = [(each.x_m, each.y_m, each.phi_rad) for each in markers.marker]
    return np.array(offsets).T, np.array(markers.frame)


def _scale(markers: Markers) -> Array:
    """Noise of each coordinate, (markers, 3)."""
    return np.tile([markers.noise_m, markers.noise_m, markers.noise_rad], (len(markers.marker), 1))


def _starts(
    robot: Robot, function: ca.Function, fixed: tuple[Array, Array], told: Array, first: int
) -> Array:
    """Bends over the robot's range, each placed so that one marker is where it was told."""
    count, most = robot.coordinates.segments, robot.limits.curvature_per_m
    each = np.linspace(-most / 2, most / 2, _BENDS)
    bends = np.array(np.meshgrid(*[each] * count)).reshape(count, -1).T
    straight = np.hstack([np.zeros((len(bends), POSE)), bends])
    offsets, frame = fixed
    places = np.array([function(q, offsets, np.zeros(POSE))[0].full()[:, first] for q in straight])
    b0 = composed(inverse(frame), composed(told, inverse(places)))
    return np.hstack([b0, bends])


def _least_squares(
    off: Callable[[Array], Array], slopes: Callable[[Array], Array], start: Array
) -> Array:
    from scipy.optimize import least_squares  # a quarter of a second

    return least_squares(off, start, slopes, method="lm", x_scale="jac").x


def _expected(robot: Robot, markers: Markers) -> ca.Function:
    return _compiled(robot, tuple(each.link for each in markers.marker))


@per_body(4)
def _compiled(body: Body, links: tuple[Link, ...]) -> ca.Function:
    """(q, offsets, frame) -> poses, 3 x markers; derivatives by q, and by offsets and frame."""
    q = ca.SX.sym("q", POSE + body.geometry.segments)
    offsets, frame = ca.SX.sym("offsets", POSE, len(links)), ca.SX.sym("frame", POSE)
    in_b0 = {
        "unit 1": chain.fibre_end_pose(body.geometry, q, 0),
        "unit 2": chain.fibre_end_pose(body.geometry, q, 1),
        "middle link": ca.SX.zeros(POSE),
    }
    placed = [chain.composed(in_b0[link], offsets[:, i]) for i, link in enumerate(links)]
    poses = chain.composed(chain.composed(frame, q[:POSE]), ca.horzcat(*placed))
    fixed = ca.veccat(offsets, frame)
    slopes = [ca.densify(ca.jacobian(ca.vec(poses), by)) for by in (q, fixed)]
    return ca.Function("markers", [q, offsets, frame], [poses, *slopes])
