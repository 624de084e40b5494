r"""A proved lower bound on the time of a rigid motion within wheel speed limits.

A rigid body moves with body twists xi = (u, v, r) in the polytope P = {|M xi| <= 1}. Let
S(x, y, phi) = p . (x, y) + C(phi). If, for every heading phi that can occur and every vertex
(w, r) of P, with w = (u, v),

.. math:: p \cdot R(\phi) w + C'(\phi)\, r \le 1,

then S grows by at most 1 per second along any admissible motion, so S(goal) - S(start) bounds its
duration from below. Since x and y do not enter the limits, S is a complete integral of the
Hamilton-Jacobi equation of the minimum-time problem: the best p makes the bound tight for motions
that turn one way. With C' constant on panels of headings the best bound is a linear program. On a
panel of half-width h about phi_m the arc R(phi) w lies in the triangle of its ends and
R(phi_m) w / cos h, so testing these three points proves the inequality on the whole panel.

Only headings that a motion faster than a known one can visit need to be covered.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from twosra_mpc.planning.bounds.linear_program import minimise
from twosra_mpc.robot.coordinates import Array

_PANEL_RAD = 0.06
FAR_RAD = 3 * math.tau  # turns in a drive from which on headings are covered once, not once a turn
_ROUNDING = 1e-9  # relative allowance for rounding in the vertices and the linear program


def least_time(
    speed_rows: Array,
    shift: Array,
    shift_box: Array,
    turns: tuple[float, float],
    modulo: bool,
    known_s: float,
) -> float:
    """Lower bound on the duration of any rigid motion with this change of pose [s].

    Args:
        speed_rows: M, (m, 3), per body twist [s/m, s/m, s].
        shift: Change of (x, y) in the start frame of heading [m]; NaN where free.
        shift_box: Half-width of the goal box in the same frame's axes [m], (2,).
        turns: (low, high) of the change of heading [rad]; infinite where free.
        modulo: Whether headings that differ by full turns are equal.
        known_s: Duration of a known motion; the bound never exceeds it.
    """
    vertices = twist_vertices(speed_rows)
    if vertices is None:
        return 0.0
    fastest_turn = float(vertices[:, 2].max())
    reach = fastest_turn * known_s
    if reach > FAR_RAD:
        free = not all(map(math.isfinite, turns))
        around = ((-math.pi, math.pi), True) if free else (turns, modulo)
        found = _bound_around(vertices, shift, shift_box, *around)
        return min(found, known_s) * (1 - _ROUNDING)
    best = known_s
    for goal in goal_headings(turns, modulo, reach):
        best = min(best, _bound_to(vertices, shift, shift_box, goal, reach))
    return best * (1 - _ROUNDING)


def goal_headings(
    turns: tuple[float, float], modulo: bool, reach: float
) -> list[tuple[float, float]]:
    """Intervals of goal headings, relative to the start's, that can be turned to by ``reach``."""
    low, high = turns
    if not (math.isfinite(low) and math.isfinite(high)):
        return [(-reach, reach)]
    first = math.ceil((-reach - high) / math.tau) if modulo else 0
    last = math.floor((reach - low) / math.tau) if modulo else 0
    return [(low + k * math.tau, high + k * math.tau) for k in range(first, last + 1)]


def twist_vertices(speed_rows: Array) -> Array | None:
    """Vertices (u, v, r) of the polytope of body twists, (n, 3); None if it is unbounded."""
    if len(speed_rows) < 3 or np.linalg.matrix_rank(speed_rows) < 3:
        return None
    squares = speed_rows[[*itertools.combinations(range(len(speed_rows)), 3)]]
    regular = np.abs(np.linalg.det(squares)) >= 1e-9 * np.abs(squares).max(axis=(1, 2)) ** 3
    signs = np.array([*itertools.product((-1.0, 1.0), repeat=3)])
    twists = np.linalg.solve(squares[regular, None], signs[None, ..., None]).reshape(-1, 3)
    return twists[np.abs(twists @ speed_rows.T).max(axis=1) <= 1 + 1e-9]


def _bound_to(
    vertices: Array, shift: Array, shift_box: Array, goal: tuple[float, float], reach: float
) -> float:
    """Best bound of the form above for one interval of goal headings, relative to the start's."""
    near = min(max(0.0, goal[0]), goal[1])  # what must be turned in any case
    low, high = headings_visited(goal, reach)
    marks = {low, min(0.0, near), max(0.0, near), high, *np.clip(goal, low, high).tolist()}
    edges = _panels(sorted(marks))
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    between = (middle > min(0.0, near)) & (middle < max(0.0, near))
    uncertain = (middle > goal[0]) & (middle < goal[1])

    count = len(middle)
    blocks = []
    for angle, stretch in ((middle - half, None), (middle + half, None), (middle, np.cos(half))):
        c, s = np.cos(angle), np.sin(angle)
        size = 1.0 if stretch is None else 1.0 / stretch
        for u, v, r in vertices:
            turned = np.column_stack([(c * u - s * v) * size, (s * u + c * v) * size])
            blocks.append(np.hstack([turned, -turned, np.eye(count) * r]))
    asked = np.isfinite(shift)
    along = np.where(asked, shift, 0.0)
    # p = plus - minus, both >= 0, so that the goal box costs box . (plus + minus).
    box = np.where(asked, shift_box, 0.0)
    gain = np.concatenate([along - box, -along - box, np.sign(near) * 2 * half * between])
    ends = np.tile([-np.inf, np.inf], (len(gain), 1))
    ends[:4, 0], ends[:4][~np.tile(asked, 2), 1] = 0.0, 0.0
    ends[4:][uncertain] = 0.0
    rows = np.vstack(blocks)
    optimum = minimise(-gain, rows, np.ones(len(rows)), [(a, b) for a, b in ends.tolist()])
    if optimum is None:
        return 0.0
    s = np.clip(optimum[1], *ends.T)
    return float(gain @ s) / float((rows @ s).max(initial=1.0))  # S, made to grow as it may


def _bound_around(
    vertices: Array, shift: Array, shift_box: Array, turns: tuple[float, float], modulo: bool
) -> float:
    """Best bound with C(phi) = a phi + what has a period of 2 pi; a = 0 if full turns are equal.

    The goal's headings lie in panels in which the periodic part does not change.
    """
    low, high = turns
    here, wide = low % math.tau, min(high - low, math.tau)
    marks = {0.0, here, (here + wide) % math.tau, math.tau}
    edges = _panels(sorted(marks))
    middle, half, count = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2, len(edges) - 1
    level = np.eye(count)  # C where panels begin
    slopes = (np.roll(level, -1, axis=0) - level) / (2 * half)[:, None]
    flat = slopes[(middle - here) % math.tau < wide]
    blocks = []
    for angle, size in (
        (edges[:-1], np.ones(count)),
        (edges[1:], np.ones(count)),
        (middle, 1 / np.cos(half)),
    ):
        c, s = np.cos(angle) * size, np.sin(angle) * size
        for u, v, r in vertices:
            drive = np.column_stack([c * u - s * v, s * u + c * v])
            turn = np.full((count, 1), r)
            blocks.append(np.hstack([drive, -drive, turn, -turn, slopes * r]))
    asked = np.isfinite(shift)
    along, box = np.where(asked, shift, 0.0), np.where(asked, shift_box, 0.0)
    reached = level[int(np.argmin(np.abs(edges[:-1] - here)))]
    gain = np.concatenate([along - box, -along - box, [low, -high], reached - level[0]])
    ends = np.tile([-np.inf, np.inf], (len(gain), 1))
    ends[:6, 0], ends[:4][~np.tile(asked, 2), 1] = 0.0, 0.0
    ends[4:6, 1] = 0.0 if modulo else np.inf
    ends[6] = 0.0  # C at the start's heading
    growth = np.vstack(blocks)
    level_rows = np.pad(np.vstack([flat, -flat]), ((0, 0), (6, 0)))
    limits = np.concatenate([np.ones(len(growth)), np.zeros(len(level_rows))])
    rows = np.vstack([growth, level_rows])
    optimum = minimise(-gain, rows, limits, [(a, b) for a, b in ends.tolist()])
    if optimum is None:
        return 0.0
    s = np.clip(optimum[1], *ends.T)
    fall = float(np.abs(flat @ s[6:]).sum()) * 2 * float(half.max())  # within the goal's headings
    return max(0.0, float(gain @ s) - fall) / float((growth @ s).max(initial=1.0))


def headings_visited(goal: tuple[float, float], reach: float) -> tuple[float, float]:
    """Least and largest heading of all motions from 0 into ``goal`` that turn by at most ``reach``.

    One that turns up to h and ends at g turns by h + (h - g) at least, so h <= (reach + g) / 2.
    """
    low = min(0.0, (max(goal[0], -reach) - reach) / 2)
    return low, max(0.0, (min(goal[1], reach) + reach) / 2)


def _panels(marks: list[float]) -> Array:
    """Panel edges no further apart than 0.06 rad that include every mark."""
    pieces = [np.array(marks[:1])]
    for low, high in itertools.pairwise(marks):
        if high > low:
            pieces.append(np.linspace(low, high, math.ceil((high - low) / _PANEL_RAD) + 1)[1:])
    return np.concatenate(pieces)
