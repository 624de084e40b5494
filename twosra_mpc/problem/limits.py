"""Limits of shape and motion, each written once, symbolically, for whoever needs it.

The NLP's rows, the screening of guesses, the bends that bounds forbid, the verification and the
messages all ask these values. A further limit is one more value, in `SHAPE_LIMITS` or
`SPEED_LIMITS`, and its number in the robot file (``robot.limits``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.intervals import enclose
from twosra_mpc.model.kinematics import bend_levers, wheel_independence
from twosra_mpc.model.outline import FEW_POINTS, outline_points, outline_radii_m
from twosra_mpc.model.rows import by_rows
from twosra_mpc.model.self_collision import FAR_M, self_collision
from twosra_mpc.problem.problem import Alone, Problem
from twosra_mpc.problem.tolerances import (
    BODY_TOLERANCE_M,
    CERTAIN_END,
    CERTAIN_LEVER,
    CURVATURE_TOLERANCE_PER_M,
    INDEPENDENCE_TOLERANCE,
    LEVER_TOLERANCE,
    RATE_TOLERANCE,
    ROUNDING_M,
    STILL_RAD,
    STRAIGHT_RAD,
)
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.geometry import MotionLimits
from twosra_mpc.robot.modes import Mode, ModeSequence

_ANGLES = np.arange(8) * np.pi / 8
# Speed is measured along 8 axes, so that it stays linear; a 16-gon within the circle is allowed.
_WITHIN = float(np.cos(np.pi / 16))
_SPEED_AXES = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]) / _WITHIN
_SHARES = np.linspace(1.0, 0.0, 401)  # of a shape, on its way back
_STATIONS = 41  # of what a spring resists on the way of a bend
_CERTAIN_M = 1e-4  # of a gap: beyond what interpolating a shape can feign


@dataclass(frozen=True)
class Limit:
    """Something that a plan must keep; verifications have its margin under its name.

    Attributes:
        name: Its name, unit included.
        number: Key of its number in the limits of the robot, its heater or the scenario, if that
            is not its name.
    """

    name: str
    number: str = field(default="", kw_only=True)

    def asked(self, problem: Problem) -> float | None:
        """Its number; None if there is none, as of a workspace."""
        places = problem.robot.limits, problem.robot.heater, problem
        key = self.number or self.name
        return next((vars(place)[key] for place in places if key in vars(place)), None)


@dataclass(frozen=True)
class ShapeLimit(Limit):
    """A limit of the shapes that a robot may take, or drive in.

    Attributes:
        margin: (body, curvatures (n,)) -> what is left, negative where forbidden, symbolically.
        nearer: (body, shapes (m, n)) -> what is left, (m,), where ``margin`` is only a lower bound
            of it, for those where it is less than `FAR_M`.
        words: What is wrong with a forbidden shape, to complete "a shape whose ...".
        rounding: Margins that count as zero.
        scale: Unit of its rows in the NLP; None: it has rows of its own, or is a box about zero.
        driving: Whether only rigid driving is forbidden.
        steep: Body -> how much the margin changes per curvature of each segment, at most, (n,);
            for those that forbid more than driving.
    """

    margin: Callable[[Body, ca.SX], ca.SX]
    words: Callable[[MotionLimits], str]
    rounding: float
    scale: float | None
    driving: bool = False
    nearer: Callable[[Body, Array], Array] | None = None
    steep: Callable[[Body], Array] | None = None


@dataclass(frozen=True)
class SpeedLimit(Limit):
    """A limit of how fast something may travel; a robot without its number is not limited.

    Attributes:
        travel: (body, s, J s, V s) -> what an input displacement s moves, (m,); linear in s.
        words: What is wrong with a motion that is too fast, to complete "a motion in which ...".
        overstated: How many times more than what is really travelled ``travel`` may say.
    """

    travel: Callable[[Body, ca.SX, ca.SX, ca.SX], ca.SX]
    words: Callable[[MotionLimits], str]
    overstated: float = 1.0

    def most(self, robot: Robot | Body) -> float:
        """The limit itself."""
        return float(getattr(robot.body.limits, self.name))


def settled(margin: float, limit: float) -> float:
    """A margin, zero within rounding of an active limit."""
    return 0.0 if abs(margin) <= RATE_TOLERANCE * limit else margin


def _curvature(body: Body, kappa: ca.SX) -> ca.SX:
    limit = body.limits.curvature_per_m
    return ca.mmin(ca.vertcat(limit - kappa, limit + kappa))


@per_body()
def _parts_moved_m2(body: Body) -> Array:
    """Largest travel of any point of a part per curvature of each segment, (n,) [m2]."""
    return self_collision(body).reach_m * np.array(body.geometry.lengths_m)


CURVATURE = ShapeLimit(
    name="curvature_per_m",
    margin=_curvature,
    words=lambda limits: f"curvature is beyond curvature_per_m = {limits.curvature_per_m:zg} 1/m",
    rounding=CURVATURE_TOLERANCE_PER_M,
    scale=None,
    steep=lambda body: np.ones(body.geometry.segments),
)
UNIT_GAP = ShapeLimit(
    name="unit_gap_m",
    margin=lambda body, kappa: self_collision(body).units(kappa) - body.limits.unit_gap_m,
    words=lambda limits: f"units overlap or come closer than unit_gap_m = {limits.unit_gap_m:zg} m",
    rounding=ROUNDING_M,
    scale=0.1,
    steep=_parts_moved_m2,
)
BODY_GAP = ShapeLimit(
    name="body_gap_m",
    margin=lambda body, kappa: self_collision(body).bound(kappa),
    nearer=lambda body, kappa: self_collision(body).separations(kappa).min(axis=1),
    words=lambda _: "parts overlap: units, wheels, links or fibre",
    rounding=ROUNDING_M,
    scale=None,
    steep=UNIT_GAP.steep,
)
WHEEL_INDEPENDENCE = ShapeLimit(
    name="wheel_independence",
    margin=lambda body, kappa: (
        wheel_independence(body.geometry, kappa) - body.limits.wheel_independence
    ),
    words=lambda limits: (
        f"wheels lose control: wheel_independence < {limits.wheel_independence:zg}"
    ),
    rounding=INDEPENDENCE_TOLERANCE,
    scale=1.0,
    driving=True,
)
SHAPE_LIMITS = (CURVATURE, UNIT_GAP, BODY_GAP, WHEEL_INDEPENDENCE)

WHEEL_SPEED = SpeedLimit(
    name="wheel_speed_rad_s",
    travel=lambda body, s, moved, turned: turned,
    words=lambda limits: f"wheels turn faster than {limits.wheel_speed_rad_s:zg} rad/s",
)
UNIT_SPEED = SpeedLimit(
    name="unit_speed_m_s",
    travel=lambda body, s, moved, turned: s[:2],
    words=lambda limits: f"locomotion units move faster than {limits.unit_speed_m_s:zg} m/s",
)
BEND_RATE = SpeedLimit(
    name="bend_rate_rad_s",
    travel=lambda body, s, moved, turned: moved[POSE:] * ca.DM(body.geometry.lengths_m),
    words=lambda limits: f"segments bend faster than {limits.bend_rate_rad_s:zg} rad/s",
)
SPEED = SpeedLimit(
    name="speed_m_s",
    travel=lambda body, s, moved, turned: ca.DM(_SPEED_AXES) @ s[2:4],
    words=lambda limits: f"the middle link drives faster than {limits.speed_m_s:zg} m/s",
    overstated=1 / _WITHIN,
)
TURN_RATE = SpeedLimit(
    name="turn_rate_rad_s",
    travel=lambda body, s, moved, turned: s[4],
    words=lambda limits: f"the robot turns faster than {limits.turn_rate_rad_s:zg} rad/s",
)
SPEED_LIMITS = (WHEEL_SPEED, UNIT_SPEED, BEND_RATE, SPEED, TURN_RATE)

WHEEL_ACCELERATION = Limit("wheel_acceleration_rad_s2")  # with it, phases go from rest to rest
WORKSPACE = Limit("workspace_m")  # margin to the box of the scenario
CLEARANCE = Limit("clearance_m")  # margin to what is kept to obstacles
CONTACT = Limit("contact_m")  # margin to the overlap that is allowed with what is touched
SOFT_TRAVEL = Limit("soft_travel_m")  # kept where there are obstacles
BEND_LEVER = Limit("bend_lever")  # where one segment is soft, against its spring
TEMPERATURE = Limit("temperature_max_C")
CURRENT = Limit("heater_current_A", number="current_max_A")
_OTHERS = (
    WHEEL_ACCELERATION,
    WORKSPACE,
    CLEARANCE,
    CONTACT,
    SOFT_TRAVEL,
    BEND_LEVER,
    TEMPERATURE,
    CURRENT,
)
LIMITS = {limit.name: limit for limit in (*SHAPE_LIMITS, *SPEED_LIMITS, *_OTHERS)}


# Shapes.


@per_body()
def shape_function(body: Body) -> ca.Function:
    """Kappa (n,) -> margin of every shape limit, in their order."""
    kappa = ca.SX.sym("kappa", body.geometry.segments)
    margins = [limit.margin(body, kappa) for limit in SHAPE_LIMITS]
    return ca.Function("shape_margins", [kappa], [ca.vertcat(*margins)], {"cse": True})


def shape_margins(robot: Robot | Body, kappa: ArrayLike) -> dict[str, Array]:
    """Margins of shapes to what the limits forbid, by name of the limit, each (m,).

    Negative: forbidden. Margins within rounding of zero are zero. That of `BODY_GAP` is a lower
    bound where it is more than `FAR_M`.

    Args:
        robot: The robot.
        kappa: Curvatures, (m, n) or (n,) [1/m].
    """
    shapes = np.atleast_2d(np.asarray(kappa, dtype=float))
    (values,) = by_rows(shape_function(robot), shapes)
    for limit, row in zip(SHAPE_LIMITS, values.T, strict=True):
        if limit.nearer is not None and (near := row < FAR_M).any():
            row[near] = limit.nearer(robot.body, shapes[near])
    values[np.abs(values) <= [limit.rounding for limit in SHAPE_LIMITS]] = 0.0
    return {limit.name: row for limit, row in zip(SHAPE_LIMITS, values.T, strict=True)}


def broken_by_shapes(robot: Robot | Body, kappa: ArrayLike) -> ShapeLimit | None:
    """The limit that these shapes (m, n) break most, whether the robot drives in them or not."""
    margins, found, most_per_m = shape_margins(robot, kappa), None, 0.0
    for limit in SHAPE_LIMITS:
        least = float(margins[limit.name].min())
        if not limit.driving and least < 0:
            steepest = 1.0 if limit.steep is None else float(limit.steep(robot.body).max())
            if (lacking_per_m := -least / steepest) > most_per_m:
                found, most_per_m = limit, lacking_per_m
    return found


def overlap_in_words(robot: Robot | Body, kappa: ArrayLike) -> str:
    """Say which parts of the robot overlap most in a shape (n,), or come too close."""
    one, other, apart_m = self_collision(robot).nearest(np.asarray(kappa, dtype=float))
    if apart_m >= 0:
        return UNIT_GAP.words(robot.body.limits)
    return f"{one} overlaps {'itself' if one == other else other} by {-1e3 * apart_m:z.1f} mm"


def body_gaps_m(robot: Robot | Body, kappa: ArrayLike) -> Array:
    """Least gap that is left between parts of the robot in shapes (m, n), (m,) [m]."""
    margins = shape_margins(robot, kappa)
    return np.minimum(margins[UNIT_GAP.name], margins[BODY_GAP.name])


def bent_back(robot: Robot | Body, kappa: Array) -> Array:
    """The shape (n,), bent back towards the straight robot as far as the limits ask for."""
    limit = robot.body.limits.curvature_per_m
    shapes = _SHARES[:, None] * np.clip(kappa, -limit, limit)
    return shapes[int((body_gaps_m(robot, shapes) >= 0).argmax())]


def most_gaps_m(robot: Robot | Body, kappa: ArrayLike, off_per_m: ArrayLike = 0.0) -> Array:
    """Upper bounds of the gaps in shapes (m, n) that may be ``off_per_m`` (n,) off, (m,).

    Where it is negative, no plan that is verified takes such a shape, and shapes known only to a
    micrometre cannot feign it. Curvatures are left to whoever knows their bending coordinates
    exactly. Gaps of more than `FAR_M` are not told apart.
    """
    feigned_m = _CERTAIN_M + parts_moved_m(robot, off_per_m).max()
    return body_gaps_m(robot, kappa) + BODY_TOLERANCE_M + feigned_m


def parts_moved_m(robot: Robot | Body, bent_per_m: ArrayLike) -> Array:
    """Largest travel of any point of a part, as seen from another part, (m,) [m].

    Args:
        robot: The robot.
        bent_per_m: How much more or less segments bend, (m, n) or a number [1/m].
    """
    return (np.atleast_2d(bent_per_m) * _parts_moved_m2(robot)).sum(axis=1)


def may_drive_in(robot: Robot | Body, kappa: ArrayLike) -> NDArray[np.bool_]:
    """Truth for each of these shapes (m, n): the robot may drive rigidly in it."""
    margins = shape_margins(robot, kappa)
    driving = [margins[limit.name] >= 0 for limit in SHAPE_LIMITS if limit.driving]
    return np.all(driving, axis=0)


# Bends of one soft segment, which its spring straightens.


def bend_margins(robot: Robot | Body, mode: Mode, kappa: Array) -> Array:
    """Margins to `BEND_LEVER` of a bend through shapes (m, n): of its steps, and of its end, (m,).

    Wheels bend a segment that is soft alone against its spring, and hold it at the end: by a lever
    in proportion to its bend where they push, by any where they pull, and never across a shape
    without one. What straightens it may cross those. Infinite where nothing is asked.
    """
    margins = np.full(len(kappa), np.inf)
    if robot.body.limits.bend_lever is None or sum(mode) != 1:
        return margins
    length = robot.body.geometry.lengths_m[j := mode.index(1)]
    if np.ptp(kappa[:, j]) * length <= STILL_RAD:
        return margins
    begin, end = kappa[:-1].copy(), kappa[1:]
    straight = STRAIGHT_RAD / length
    side = np.where(end[:, j] < 0, -1.0, 1.0)  # no spring pulls before it is left
    begin[:, j] = side * np.maximum(side * begin[:, j], straight)
    ((one, _), left), ((other, _), left_then) = (levers_left(robot, j, k, k) for k in (begin, end))
    small, large = np.sort(np.abs([one, other]), axis=0)
    crossed = (one * other < 0) & (small > LEVER_TOLERANCE)
    against = np.abs(end[:, j]) > np.abs(begin[:, j])
    margins[:-1] = np.where(crossed, -large, np.minimum(left, left_then))
    margins[:-1][~against], margins[-1] = np.inf, left_then[-1]
    return np.where(np.abs(margins) <= LEVER_TOLERANCE, 0.0, margins)


def levers_kept(robot: Robot | Body, sequence: ModeSequence, ways: Iterable[Array]) -> bool:
    """Truth: the bend through the shapes (m, n) of each of these phases keeps `BEND_LEVER`."""
    margins = (bend_margins(robot, *of) for of in zip(sequence, ways, strict=True))
    return all(each.min() >= 0 for each in margins)


def singular_bend(
    robot: Robot | Body, mode: Mode, kappa: Array, off_per_m: Array, last: Array | None
) -> str | None:
    """What is wrong with shapes on the way of a bend that breaks `BEND_LEVER`; None: it may not.

    Args:
        robot: The robot.
        mode: Its mode.
        kappa: Shapes that it passes in this order, (m, n) [1/m].
        off_per_m: How far off they may be, (n,) [1/m].
        last: The shape in which it ends at the latest, (n,), if that is nearly the last of them.
    """
    if (limit := robot.body.limits.bend_lever) is None or sum(mode) != 1:
        return None
    j = mode.index(1)
    begin, end, length = kappa[0, j], kappa[-1, j], robot.body.geometry.lengths_m[j]
    if abs(end - begin) * length <= 2 * STILL_RAD:
        return None
    lost, side = False, math.copysign(1.0, end - begin)
    since = max(side * begin, STRAIGHT_RAD / length) + off_per_m[j]
    if side * end > since:
        passed = np.tile(kappa[-1], (_STATIONS, 1))
        passed[:, j] = side * np.linspace(since, side * end, _STATIONS)
        (low, high), left = levers_left(robot, j, passed - off_per_m, passed + off_per_m)
        crosses = low.max() > CERTAIN_LEVER and high.min() < -CERTAIN_LEVER
        lost = crosses or left.min() < -CERTAIN_LEVER
    if last is not None and not lost:
        least, most = np.sort([kappa[-1:], last[None]], axis=0)
        lost = levers_left(robot, j, least - off_per_m, most + off_per_m)[1][0] < -CERTAIN_END
    return (
        f"wheels lose hold of segment {j + 1}, soft alone: {BEND_LEVER.name} < {limit:zg}"
        if lost
        else None
    )


def levers_left(robot: Robot | Body, j: int, low: Array, high: Array) -> tuple[Array, Array]:
    """Bounds of the lever on a segment in boxes of shapes, (2, m), and the most that is left."""
    levers = bend_levers(robot.body)
    exact = (low == high).all()
    boxes = [by_rows(levers, low)[0].T] * 2 if exact else enclose(levers, low.T, high.T)
    bounds = np.array([each[j] for each in boxes])
    pushing = bounds * np.where(high[:, j] < 0, -1.0, 1.0)  # where negative, wheels pull
    bent = np.maximum(np.maximum(low[:, j], -high[:, j]), 0.0) * robot.body.geometry.lengths_m[j]
    asked = (robot.body.limits.bend_lever or 0.0) * np.maximum(bent - STRAIGHT_RAD, 0.0)
    return bounds, np.maximum(-pushing.min(axis=0), pushing.max(axis=0) - asked)


def workspace_margins(problem: Problem | Alone, q: Array) -> Array:
    """Margins of the robot to the edges of its workspace at configurations (m, 3 + n), (m,) [m].

    An arc between points a distance d apart strays from their chord by at most kappa d^2 / 8.
    """
    geometry, workspace = problem.robot.geometry, problem.workspace
    if workspace is None:
        return np.full(len(q), np.inf)
    (flat,) = by_rows(outline_points(geometry), q)
    points = flat.reshape(len(q), -1, 2)
    lengths = np.array(geometry.lengths_m) / (FEW_POINTS - 1)
    arc = np.abs(q[:, POSE:]).max(axis=1) * float(lengths.max()) ** 2 / 8
    own = FEW_POINTS * geometry.segments
    within = workspace.margin_m(points) - outline_radii_m(geometry)
    within[:, -own:] -= arc[:, None]
    margins: Array = within.min(axis=1)
    return np.where(np.abs(margins) <= ROUNDING_M, 0.0, margins)
