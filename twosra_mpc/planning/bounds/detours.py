"""Detours: which shapes of two segments soft phases reach, past those that are forbidden.

The plane of both W is cut into square cells. Bends of one segment lead along rows and columns of
cells, those of both along stairs: a diagonal and the one beside it. To enter a cell from a side, or
to end in it, is impossible where every such bend breaks a limit, dear where some may, and else as
dear as the bend is large. So there is no plan where cells of the goal cost infinitely much, and the
cheapest way to one tells bends that keep clear of what is forbidden, where any do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge, once
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, ModeSequence

COARSE, FINE = 1, 4  # how finely the plane is cut
_KEPT = 256  # costs of all coarse cells, 50 MiB, or of as many fine ones
IMPOSSIBLE, UNCLEAR = 1e9, 1e2  # costs of a cell, far more than all that bends cost


class Lines(NamedTuple):
    """The lines of cells along which a mode bends, and what that costs.

    Attributes:
        cells: Numbers of cells along each line, (lines, m); the last number is beyond the edge.
        up: Sum of what it costs to enter cells up to each from the one before, (lines, m).
        down: Of those behind it, from the one after.
        end: What it costs to end in each cell, by number.
        places: Where each cell is in the flat lines, by number: twice, or both times the same.
    """

    cells: NDArray[np.int32]
    up: Array
    down: Array
    end: Array
    places: NDArray[np.int32]

    def bent(self, costs: Array) -> Array:
        """Least costs of all cells after a bend that begins with these."""
        charge(Cost.CELL, self.cells.size // 1000)
        up = costs[self.cells]  # in place: it is much
        down = (up - self.down)[:, ::-1]
        up -= self.up
        for each in (up, down):
            np.minimum.accumulate(each, axis=1, out=each)
        up += self.up
        np.minimum(up, self.down + down[:, ::-1], out=up)
        return np.minimum(costs, up.ravel()[self.places].min(axis=0) + self.end)

    def source(self, costs: Array, cell: int) -> int:
        """The cell in which the cheapest bend into a cell begins."""
        found = [(costs[cell], cell)]
        for line, at in zip(*divmod(self.places[:, cell], self.cells.shape[1]), strict=True):
            up, down, numbers = self.up[line], self.down[line], self.cells[line]
            paid = [*(up[at] - up[: at + 1]), *(down[at] - down[at + 1 :])]
            whole = costs[numbers] + paid + self.end[cell]
            found.append((whole.min(), numbers[whole.argmin()]))
        return int(min(found)[1])


@dataclass(frozen=True, eq=False)
class Cells:
    """The plane of both W.

    Attributes:
        edges: W of each segment at the edges of cells, all as far apart.
        lines: By soft mode.
    """

    edges: tuple[Array, ...]
    lines: dict[Mode, Lines]

    def within(self, low: Array, high: Array) -> NDArray[np.intp]:
        """Numbers of the cells that a box touches."""
        one, other = (
            (at[:-1] <= top) & (at[1:] >= least)
            for at, least, top in zip(self.edges, low, high, strict=True)
        )
        return np.flatnonzero(np.logical_and.outer(one, other))

    def middle(self, cell: int) -> Array:
        """W in the middle of a cell."""
        where = divmod(cell, len(self.edges[1]) - 1)
        return np.array([at[i : i + 2].mean() for at, i in zip(self.edges, where, strict=True)])


def joined(edges: tuple[Array, ...], lines: Mapping[Mode, Sequence[Array]]) -> Cells:
    """Cells with these edges, from what it costs in each mode to enter them, and to end.

    Args:
        edges: As of `Cells`.
        lines: By soft mode: what it costs to enter from below, from above, and to end.
    """
    step = edges[0][1] - edges[0][0]
    rows, columns = (len(at) - 1 for at in edges)
    each = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    numbers = np.pad(each, 1, constant_values=rows * columns)
    k = np.arange(-columns, rows, dtype=np.int32)[:, None]
    t = np.arange(2 * max(rows, columns) + 2, dtype=np.int32)
    j = t // 2 + np.maximum(0, -k)
    i = (t + 1) // 2 + np.maximum(0, -k) + k
    stairs = numbers[np.clip(i, 0, rows + 1), np.clip(j, 0, columns + 1)]
    inner = numbers[1:-1, 1:-1]
    of_mode: dict[Mode, NDArray[np.int32]] = {(1, 0): inner.T, (0, 1): inner, (1, 1): stairs}
    made = dict[Mode, Lines]()
    for mode, costs in lines.items():
        cells, by = of_mode[mode], step * (0.5 if all(mode) else 1.0)
        up, down = (np.append(each + by, IMPOSSIBLE + by)[cells] for each in costs[:2])
        behind = down[:, ::-1]
        for each in (up, behind):
            np.cumsum(each, axis=1, out=each)
        flat = np.arange(cells.size, dtype=np.int32).reshape(cells.shape)
        places = np.zeros((2, rows * columns + 1), dtype=np.int32)
        places[:, cells] = flat
        for half in range(2):  # in each of which a cell of a stair is but once
            places[half, cells[:, half::2]] = flat[:, half::2]
        made[mode] = Lines(cells, up, down, np.append(costs[2], np.inf), places)
    return Cells(edges, made)


@dataclass(frozen=True, eq=False)
class Detours:
    """Ways from a start to a goal, as they are looked for in one search.

    Attributes:
        plane: Fineness -> the plane, cut so many times finer.
        start: Least and largest W at the start, (2, 2).
        goal: The same of the goal.
    """

    plane: Callable[[int], Cells]
    start: Array
    goal: Array
    _costs: dict[int, dict[ModeSequence, Array]] = field(default_factory=dict)
    _none: set[ModeSequence] = field(default_factory=set)

    def none(self, sequence: ModeSequence) -> bool:
        """True if it is proved that there is none, by coarse cells or by what was asked before."""
        modes = tuple(mode for mode in sequence if any(mode))
        if modes not in self._none and self._nearest(COARSE, modes)[1] >= IMPOSSIBLE:
            self._none.add(modes)
        return modes in self._none

    def bends(self, sequence: ModeSequence, fineness: int) -> Array | None:
        """Change of W in each phase on the cheapest way; None if it is proved that there is none.

        It comes as near to the goal as cells are large.
        """
        modes = tuple(mode for mode in sequence if any(mode))
        cell, cost = self._nearest(fineness, modes)
        if cost >= IMPOSSIBLE:
            self._none.add(modes)
            return None
        cells, found = self._cells(fineness), list[float]()
        for k in reversed(range(len(modes))):
            source = cells.lines[modes[k]].source(self._after(fineness, modes[:k]), cell)
            moved = cells.middle(cell) - cells.middle(source)
            found.append(float(moved[np.array(modes[k], dtype=bool)].mean()))
            cell = source
        bends = np.zeros(len(sequence))
        bends[np.array(sequence, dtype=bool).any(axis=1)] = found[::-1]
        return bends

    @once
    def _cells(self, fineness: int) -> Cells:
        return self.plane(fineness)

    def _nearest(self, fineness: int, modes: ModeSequence) -> tuple[int, float]:
        """The cell of the goal that is cheapest to come to, and what that costs."""
        ends = self._cells(fineness).within(*self.goal)
        costs = self._after(fineness, modes)[ends]
        return int(ends[costs.argmin()]), float(costs.min())

    def _after(self, fineness: int, modes: ModeSequence) -> Array:
        """Least costs of all cells after bends in these modes."""
        known = self._costs.setdefault(fineness, {})
        if modes in known:
            return known[modes]
        cells = self._cells(fineness)
        if modes:
            costs = cells.lines[modes[-1]].bent(self._after(fineness, modes[:-1]))
        else:
            costs = np.full(math.prod(len(at) - 1 for at in cells.edges) + 1, np.inf)
            costs[cells.within(*self.start)] = 0.0
        if len(known) >= _KEPT // fineness**2:
            known.popitem()  # the first ones are asked for again and again
        known[modes] = costs
        return costs
