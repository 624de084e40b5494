"""Flow of the kinematics over intervals of constant input, and motions: paths of mode sequences.

The kinematics is driftless, so an interval is described by its input displacement s = v h alone
([s1, s2, su, sv, sr] in m, m, m, m, rad): q+ depends on s, not on how fast it is travelled.

So a motion has no clock. ``problem.speeds.interval_durations`` gives the fastest way to travel it,
and the temporal network decides when.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.kinematics import InPlace, kinematics
from twosra_mpc.model.path_models import path_model
from twosra_mpc.model.rows import by_modes, in_mode
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array, wrapped
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid

FINE_STEPS = 64  # most parts of an interval
_STEP_ERROR = 1e-11  # m, rad, 1/m: of a step by order 5, as by order 6
# Verner's pair of orders 6 and 5 (SIAM J. Numer. Anal. 15, 1978, table 5), a row for each stage.
_STAGES = (
    (),
    (1 / 6,),
    (4 / 75, 16 / 75),
    (5 / 6, -8 / 3, 5 / 2),
    (-165 / 64, 55 / 6, -425 / 64, 85 / 96),
    (12 / 5, -8, 4015 / 612, -11 / 36, 88 / 255),
    (-8263 / 15000, 124 / 75, -643 / 680, -81 / 250, 2484 / 10625, 0),
    (3501 / 1720, -300 / 43, 297275 / 52632, -319 / 2322, 24068 / 84065, 0, 3850 / 26703),
)
_SIXTH = (3 / 40, 0, 875 / 2244, 23 / 72, 264 / 1955, 0, 125 / 11592, 43 / 616)
_GAUSS = (np.polynomial.legendre.leggauss(12) + np.array([[1.0], [0.0]])) / 2  # on [0, 1]
_ALONG = 1e-15  # m2 or m rad: a change across the input by no more moves nothing
_FIFTH = (13 / 160, 0, 2375 / 5984, 5 / 16, 12 / 85, 3 / 44, 0, 0)  # for the error alone


def runge_kutta(rate: Callable[[ca.SX], ca.SX], start: ca.SX) -> ca.SX:
    """State after a classical Runge-Kutta 4 step of length 1."""
    k1 = rate(start)
    k2 = rate(start + k1 / 2)
    k3 = rate(start + k2 / 2)
    k4 = rate(start + k3)
    return start + (k1 + 2 * k2 + 2 * k3 + k4) / 6


def verner(rate: Callable[[ca.SX], ca.SX], start: ca.SX) -> list[ca.SX]:
    """State after a step of length 1 by order 6, and how far off order 5 is at most."""
    slopes: list[ca.SX] = []
    for stage in _STAGES:
        slopes.append(rate(start + weighted(stage, slopes)))
    apart = weighted([a - b for a, b in zip(_SIXTH, _FIFTH, strict=True)], slopes)
    return [start + weighted(_SIXTH, slopes), ca.mmax(ca.fabs(apart))]


def weighted(weights: Sequence[float], slopes: list[ca.SX]) -> ca.SX:
    """Sum of slopes with these weights."""
    terms = (w * k for w, k in zip(weights, slopes, strict=True) if w)
    return sum(terms, start=ca.SX(0))


@per_body(2)
def interval_flow(body: Body, steps: int) -> ca.Function:
    """(q, s, sigma) -> q at the end of the interval, with ``steps`` Runge-Kutta 4 steps."""
    jacobian = kinematics(body).jacobian
    q, s, sigma = _arguments(ca.SX, body)

    after = runge_kutta(lambda at: jacobian(at, sigma) @ s / steps, q)
    step = ca.Function("step", [q, s, sigma], [after])
    if steps == 1:
        return step
    sym_q, sym_s, sym_sigma = _arguments(ca.MX, body)
    chain = step.fold(steps)
    end = chain(sym_q, ca.repmat(sym_s, 1, steps), ca.repmat(sym_sigma, 1, steps))
    return ca.Function("interval_flow", [sym_q, sym_s, sym_sigma], [end])


def _arguments(symbol: Any, body: Body) -> tuple[Any, Any, Any]:
    """Symbols of a kind: q (3 + n,), s (5,), sigma (n,)."""
    segments = body.geometry.segments
    return symbol.sym("q", POSE + segments), symbol.sym("s", INPUTS), symbol.sym("sigma", segments)


@per_body()
def interval_step(body: Body) -> ca.Function:
    """(q, s, sigma) -> (q after the displacement s in one step, its error)."""
    jacobian, (q, s, sigma) = kinematics(body).jacobian, _arguments(ca.SX, body)
    end = verner(lambda at: jacobian(at, sigma) @ s, q)
    return ca.Function("interval_step", [q, s, sigma], end)


@per_body()
def bending_step(body: Body) -> ca.Function:
    """(q and travel, dW, shares, sigma) -> (q and travel, error) after W is bent by dW in one step.

    In all soft segments. Locomotion unit j travels ``shares[j]`` times the travel [m]; equally far
    is the fastest way to bend. In W itself, so that no travel has to be searched for.
    """
    jacobian, path, lengths = kinematics(body).jacobian, path_model(body), body.geometry.lengths_m
    q, _, sigma = _arguments(ca.SX, body)
    bend, stiffness, size = ca.SX.sym("dW"), ca.vertsplit(sigma), q.numel()
    shares = ca.SX.sym("shares", 2)
    travelled = ca.vertcat(q, ca.SX.sym("travelled"))

    matrix = jacobian(q, sigma)
    first, second = path.bends(q[POSE:] * ca.DM(lengths), stiffness)
    moved = ca.vertcat(matrix[:, :2] @ shares, 1)
    moved *= bend / (shares[0] * first.pace + shares[1] * second.pace)
    rate = ca.Function("rate", [q, bend, shares, sigma], [moved], {"cse": True})
    after = verner(lambda at: rate(at[:size], bend, shares, sigma), travelled)
    return ca.Function("bending_step", [travelled, bend, shares, sigma], after)


def passed(step: ca.Function, start: Array, changes: Array, *given: Array) -> Array:
    """States (m + 1, k) from ``start`` (k,) on, by one change (m, c) after the other.

    Each in steps so short that their errors are small; ``given`` are further arguments of a step.
    """
    at, change, after = start.astype(float), np.empty(changes.shape[1]), np.empty(len(start))
    error, reached = np.empty(1), np.empty((len(changes) + 1, len(start)))
    moved = InPlace(step, [at, change, *given], [after, error])
    reached[0] = start
    for k, whole in enumerate(changes):
        left = share = 1.0
        while left > 0:
            np.multiply(whole, share, out=change)
            moved.evaluate()
            if error[0] > _STEP_ERROR and share > 1 / FINE_STEPS:
                share /= 2
                continue
            at[:] = after
            left -= share
            share = min(share if error[0] > _STEP_ERROR / 64 else 2 * share, left)
        reached[k + 1] = at
    return reached


def flown(
    robot: Robot | Body, q: Array, s: Array, mode: NDArray[np.int64], parts: int = 1
) -> Array:
    """Configurations after soft input displacements (m, 5) from q (m, 3 + n), in modes (m, n).

    Rows whose error in one step would be too large are cut in half; ``parts`` says how often.
    """
    after, error = by_modes(interval_step(robot), q, s, mode)
    far = np.flatnonzero(error > _STEP_ERROR)
    if len(far) and parts < FINE_STEPS:
        half = s[far] / 2, mode[far], 2 * parts
        after[far] = flown(robot, flown(robot, q[far], *half), *half)
    return after


def drive(q: Array, s: Array, changes: Array | None = None) -> Array:
    """Rigid motions by input displacements and changes (m, 3): q (3 + n,) -> (m, 3 + n)."""
    headings = q[2] + np.cumsum(s[:, 2]) - s[:, 2]
    reached = np.tile(q, (len(s), 1)).astype(float)
    reached[:, :POSE] += np.cumsum(rigid_moves(headings, s, changes), axis=0)
    return reached


def rigid_moves(headings: Array, s: Array, changes: Array | None = None) -> Array:
    """Changes of pose by rigid input displacements (..., 3) from these headings, (..., 3).

    A screw; or the input changes evenly, s + c (w - 1/2) a share w of the way, and the heading is
    quadratic in w. Where c is across s that is integrated by Gauss, to 1e-12 over a full turn.

    Args:
        headings: Where they begin [rad].
        s: Input displacements [m, m, rad].
        changes: c, (m, 3).
    """
    turn = s[..., 2]
    angle, moved = headings + turn / 2, s.copy()
    c, sine = np.cos(angle), np.sin(angle)
    moved[..., 0] = c * s[..., 0] - sine * s[..., 1]
    moved[..., 1] = sine * s[..., 0] + c * s[..., 1]
    moved[..., :2] *= np.sinc(turn / (2 * np.pi))[..., None]
    if changes is None:
        return moved
    across = s[:, :, None] * changes[:, None]
    rows = np.abs(across - across.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0) > _ALONG
    if rows.any():
        way, change, share = s[rows, :, None], changes[rows, :, None], _GAUSS[0]
        u, v, _ = np.moveaxis(way + change * (share - 1 / 2), 1, 0)
        angle = headings[rows, None] + way[:, 2] * share + change[:, 2] * share * (share - 1) / 2
        moved[rows, 0] = (np.cos(angle) * u - np.sin(angle) * v) @ _GAUSS[1]
        moved[rows, 1] = (np.sin(angle) * u + np.cos(angle) * v) @ _GAUSS[1]
    return moved


def twists(start: Array, end: Array, turns_rad: Array | None = None) -> Array:
    """Displacement (s_u, s_v, s_r) of b0 in its own frame by a constant twist, (..., 3) [m, rad].

    Args:
        start: Poses, (..., 3) [m, m, rad].
        end: Poses, (..., 3).
        turns_rad: By how much it turns; left out, by the least of what ends at that heading.
    """
    turn = wrapped(end[..., 2] - start[..., 2]) if turns_rad is None else turns_rad
    shift = end[..., :2] - start[..., :2]
    heading = start[..., 2] + turn / 2  # the chord is at half the turn
    c, s = np.cos(heading), np.sin(heading)
    stretched = 1 / np.sinc(turn / (2 * np.pi))
    along = stretched * (c * shift[..., 0] + s * shift[..., 1])
    across = stretched * (c * shift[..., 1] - s * shift[..., 0])
    return np.stack([along, across, turn], axis=-1)


@dataclass(frozen=True, eq=False)
class Motion:
    """The path of a mode sequence, rolled out with fine steps; arrays are read-only.

    Attributes:
        robot: The robot that moves.
        sequence: Mode of each phase.
        inputs: Input displacements s = v h per interval [m, m, m, m, rad], (phases, intervals, 5).
        states: q at the nodes, (phases, intervals + 1, 3 + n).
        changes: Changes of the input within an interval times h, of drives that turn on the way,
            (phases, intervals, 5): a share w of it v h is s + changes (w - 1/2). Zero elsewhere.
        lasting_s: How long these intervals last, (phases, intervals) [s]. Zero elsewhere: as short
            as the limits allow.
    """

    robot: Robot
    sequence: ModeSequence
    inputs: Array
    states: Array
    changes: Array = field(default_factory=lambda: np.zeros(1))
    lasting_s: Array = field(default_factory=lambda: np.zeros(1))

    def __post_init__(self) -> None:
        object.__setattr__(self, "changes", np.broadcast_to(self.changes, self.inputs.shape))
        lasting_s = np.broadcast_to(self.lasting_s, self.inputs.shape[:2])
        object.__setattr__(self, "lasting_s", lasting_s)
        self.inputs.setflags(write=False)
        self.states.setflags(write=False)

    @property
    def end(self) -> Array:
        """Q after the last phase, shape (3 + n,)."""
        return self.states[-1, -1]


def roll_out(robot: Robot, start: Array, sequence: ModeSequence, inputs: Array) -> Motion:
    """Follow input displacements (phases, intervals, 5) from ``start`` with fine steps."""
    here, states = np.asarray(start, dtype=float), []
    for mode, s in zip(sequence, inputs, strict=True):
        charge(Cost.INTERVAL, len(s))
        states.append(followed(robot, here, s, mode))
        here = states[-1][-1]
    return Motion(robot, sequence, inputs.copy(), np.array(states))


def joined(motions: Sequence[Motion]) -> Motion:
    """One motion after the other; each begins where the one before ends."""
    most = max(motion.inputs.shape[1] for motion in motions)
    told = list[tuple[Array, ...]]()
    for motion in motions:
        resting = ((0, 0), (0, most - motion.inputs.shape[1]), (0, 0))
        inputs, changes = np.pad(motion.inputs, resting), np.pad(motion.changes, resting)
        states = np.pad(motion.states, resting, mode="edge")
        told.append((inputs, states, changes, np.pad(motion.lasting_s, resting[:2])))
    sequence = tuple(itertools.chain.from_iterable(motion.sequence for motion in motions))
    return Motion(motions[0].robot, sequence, *map(np.concatenate, zip(*told, strict=True)))


def followed(robot: Robot, q: Array, s: Array, mode: Mode) -> Array:
    """Configurations (m + 1, 3 + n) from q on, by one displacement (m, 5) after the other."""
    if not s.any():
        return np.tile(q, (len(s) + 1, 1))
    if is_rigid(mode):
        return np.vstack([q, drive(q, s[:, 2:])])
    return passed(in_mode(interval_step(robot), mode), q, s)
