"""Random motions within the limits of a robot, as quick as they go: no planner, no optimisation.

A soft phase travels its units in a constant direction, or in two with a stop in between; a rigid
one drives with a constant twist of b0. Each is travelled as fast as the limits let the path be
travelled, from rest to rest where the wheels' acceleration is limited.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.attack.kinematics import Reference, arc
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, is_rigid

_CELLS = 64  # of a path, on which speeds are worked out
_LEAST_M = 1e-4  # shorter soft paths are not travelled at all
_DIRECTIONS = [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (1.0, -1.0), (1.0, 0.5), (0.5, 1.0)]


@dataclass(frozen=True)
class Phase:
    """What happens in a phase.

    Attributes:
        mode: Its mode.
        end: Configuration at its end, (3 + n,).
        duration_s: How long it takes.
        effort_s: Integral of the sum of (wheel speed / largest wheel speed)^2.
        moves: Input displacements (5,) of its pieces, one after the other.
    """

    mode: Mode
    end: Array
    duration_s: float = 0.0
    effort_s: float = 0.0
    moves: tuple[Array, ...] = ()

    def slower(self, factor: float) -> Phase:
        """The same path, travelled more slowly."""
        duration_s, effort_s = factor * self.duration_s, self.effort_s / factor
        return replace(self, duration_s=duration_s, effort_s=effort_s)

    def then(self, other: Phase) -> Phase:
        """This and then another one, in one phase with a stop in between."""
        duration_s, effort_s = self.duration_s + other.duration_s, self.effort_s + other.effort_s
        return Phase(self.mode, other.end, duration_s, effort_s, self.moves + other.moves)


def random_phase(
    reference: Reference, q: Array, mode: Mode, rng: np.random.Generator, far: float
) -> Phase:
    """A phase from q (3 + n,) on; ``far`` scales how far it goes."""
    pieces = 1 if rng.random() < 0.8 else 2
    made = Phase(mode, q)
    for _ in range(pieces):
        one = (_driven if is_rigid(mode) else _bent)(reference, made.end, mode, rng, far)
        made = made.then(one)
    least = reference.robot.limits.phase_s
    return made.slower(least / made.duration_s) if 0 < made.duration_s < least else made


def _bent(
    reference: Reference, q: Array, mode: Mode, rng: np.random.Generator, far: float
) -> Phase:
    length = far * 0.2 * 10 ** rng.uniform(-1.5, 0.0)
    some = rng.random() < 0.7
    direction = np.array(
        _DIRECTIONS[rng.integers(len(_DIRECTIONS))] if some else rng.normal(size=2)
    )
    direction *= rng.choice([-1.0, 1.0]) / np.abs(direction).max()
    while length > _LEAST_M:
        found = _travelled(reference, q, mode, direction, length)
        if found is not None:
            return found
        length *= 0.6
    return Phase(mode, q)


def _travelled(
    reference: Reference, q: Array, mode: Mode, direction: Array, length: float
) -> Phase | None:
    """Follow a direction of (v1, v2) over a length; None where a shape is forbidden."""
    limits = reference.robot.limits

    def rates(at: Array) -> tuple[Array, Array]:
        units = [unit for unit in (0, 1) if direction[unit]]
        moved, turned = zip(*(reference.soft(at, mode, unit) for unit in units), strict=True)
        shares = direction[units]
        return shares @ np.array(moved), shares @ np.array(turned)

    grid = np.linspace(0.0, length, 2 * _CELLS + 1)  # ends and middles of the cells
    done = solve_ivp(
        lambda _, at: rates(at)[0], (0, length), q, "DOP853", grid, rtol=1e-12, atol=1e-12
    )
    if not done.success:
        return None
    path = done.y.T
    if np.abs(path[:, POSE:]).max() > limits.curvature_per_m:
        return None
    if not all(reference.clear(kappa) for kappa in path[::4, POSE:]):
        return None
    if not reference.holds(path[:, POSE:], mode):
        return None
    bent, turned = (np.array(part) for part in zip(*map(rates, path), strict=True))
    shares = [np.abs(turned) / limits.wheel_speed_rad_s]
    shares.append(np.full((len(path), 1), np.abs(direction).max() / limits.unit_speed_m_s))
    if limits.bend_rate_rad_s is not None:
        shares.append(np.abs(bent[:, POSE:]) * reference.lengths / limits.bend_rate_rad_s)
    if not np.isfinite(bent).all():
        return None
    duration, effort = _fastest(reference, grid, np.hstack(shares).max(axis=1), turned)
    return Phase(mode, path[-1], duration, effort, (np.array([*length * direction, 0, 0, 0]),))


def _driven(
    reference: Reference, q: Array, mode: Mode, rng: np.random.Generator, far: float
) -> Phase:
    """Drive with a twist of b0 for as long as a random share of 20 s at full speed takes."""
    limits = reference.robot.limits
    if not reference.steady(q[POSE:]):
        return Phase(mode, q)
    twist = rng.normal(size=3) * [1.0, 1.0, 10.0]
    if rng.random() < 0.3:
        twist[2] = 0.0
    turned = reference.rigid(q[POSE:]) @ twist
    shares = [float(np.abs(turned).max()) / limits.wheel_speed_rad_s]
    if limits.speed_m_s is not None:
        shares.append(math.hypot(*twist[:2]) / limits.speed_m_s)
    if limits.turn_rate_rad_s is not None:
        shares.append(abs(twist[2]) / limits.turn_rate_rad_s)
    full = max(shares)  # least time per parameter of the path
    length = far * 20.0 * 10 ** rng.uniform(-2.5, 0.0) / full
    grid = np.linspace(0.0, length, 2 * _CELLS + 1)
    duration, effort = _fastest(
        reference, grid, np.full(len(grid), full), np.tile(turned, (len(grid), 1))
    )
    turn = float(twist[2]) * length
    moved = complex(*twist[:2]) * length * arc(turn)[0]
    moved *= np.exp(1j * q[2])
    end = q.copy()
    end[:POSE] += [moved.real, moved.imag, turn]
    return Phase(mode, end, duration, effort, (np.array([0, 0, *length * twist]),))


def _fastest(reference: Reference, grid: Array, r: Array, w: Array) -> tuple[float, float]:
    """(duration, effort) of a path travelled as fast as its limits allow.

    Args:
        reference: The robot.
        grid: Ends and middles of cells of the path parameter l, (2 cells + 1,).
        r: Least time per l, (2 cells + 1,).
        w: Turn of each wheel per l, (2 cells + 1, 4).
    """
    limits = reference.robot.limits
    squares = (w**2).sum(axis=1) / limits.wheel_speed_rad_s**2
    cell = 2 * (grid[1] - grid[0])
    weights = np.array([1.0, 4.0, 1.0]) * cell / 6
    cells = np.arange(0, len(grid) - 1, 2)[:, None] + np.arange(3)
    most = limits.wheel_acceleration_rad_s2
    if most is None:
        return float((r[cells] @ weights).sum()), float(((squares / r)[cells] @ weights).sum())
    b = _squared_speeds(grid, r, w, most)  # at the ends of the cells
    speed = np.sqrt(b)
    times = 2 * cell / (speed[1:] + speed[:-1])
    slope = np.diff(b) / cell
    change = np.gradient(w, grid, axis=0)
    worst = 0.0
    for at, value in ((slice(0, -1, 2), b[:-1]), (slice(1, None, 2), (b[1:] + b[:-1]) / 2)):
        used = change[at] * value[:, None] + w[at] * slope[:, None] / 2
        worst = max(worst, float(np.abs(used).max()) / most)
        worst = max(worst, float((r[at] ** 2 * value).max()))
    ends = change[2::2] * b[1:, None] + w[2::2] * slope[:, None] / 2
    worst = max(worst, float(np.abs(ends).max()) / most)
    slower = math.sqrt(max(1.0, worst))
    at_ends = np.array([1.0, 4.0, 1.0]) / 6  # speed is linear in time, squares nearly constant
    middle = squares[cells] @ at_ends
    mean = (b[1:] + np.sqrt(b[1:] * b[:-1]) + b[:-1]) / 3
    return slower * float(times.sum()), float((middle * mean * times).sum()) / slower


def _squared_speeds(grid: Array, r: Array, w: Array, most: float) -> Array:
    """Squares of dl/dt at the ends of the cells, from 0 to 0, raised as far as wheels speed up."""
    ends, turned = grid[::2], w[::2]
    change = np.abs(np.gradient(w, grid, axis=0)[::2])
    with np.errstate(divide="ignore"):
        cap = np.minimum(1 / r[::2] ** 2, (most / np.maximum(change, 1e-12)).min(axis=1))
    cap = np.minimum(cap, np.concatenate([1 / r[1::2] ** 2, [np.inf]]))
    cap[1:] = np.minimum(cap[1:], 1 / r[1::2] ** 2)
    cap[0] = cap[-1] = 0.0
    b = cap.tolist()
    size, step = np.maximum(np.abs(turned), 1e-12), float(ends[1])
    for order in (range(1, len(b)), range(len(b) - 2, -1, -1)):
        back = -order.step
        for i in order:
            here = max(0.0, float(np.min((most - change[i] * b[i + back]) / size[i])))
            there = max(0.0, float(np.min((most - change[i] * b[i + back]) / size[i + back])))
            b[i] = min(b[i], b[i + back] + 2 * min(here, there) * step)
    return np.array(b)
