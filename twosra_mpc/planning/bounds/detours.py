"""Detours: which shapes of two segments soft phases reach, past those that are forbidden.

The plane of both W is cut into square cells. Bends of one segment lead along rows and columns of
cells, those of both along stairs: a diagonal and the one beside it. To enter a cell from a side, or
to end in it, is impossible where every such bend breaks a limit, dear where some may, and else as
dear as the bend is large. So there is no plan where cells of the goal cost infinitely much, and the
cheapest way to one tells bends that keep clear of what is forbidden, where any do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, ModeSequence


class Lines(NamedTuple):
    """The lines of cells along which a mode bends, and what that costs.

    Attributes:
        cells: Numbers of cells along each line, (lines, m); the last number is beyond the edge.
        up: What it costs to enter a cell from the one before it on its line, (lines, m).
        down: From the one after it.
        end: What it costs to end in a cell.
    """

    cells: NDArray[np.intp]
    up: Array
    down: Array
    end: Array

    def bent(self, costs: Array) -> Array:
        """Least costs of all cells after a bend that begins with these."""
        charge(Cost.CELL, self.cells.size // 1000)
        found, begins = costs.copy(), costs[self.cells]
        for enter, way in ((self.up, slice(None)), (self.down, slice(None, None, -1))):
            here, reached = np.full(len(begins), np.inf), np.empty_like(begins)
            for k in range(begins.shape[1])[way]:
                here = np.minimum(here + enter[:, k], begins[:, k])
                reached[:, k] = here
            np.minimum.at(found, self.cells, reached + self.end)
        found[-1] = np.inf
        return found

    def source(self, costs: Array, cell: int) -> int:
        """The cell in which the cheapest bend into a cell begins."""
        found = [(costs[cell], cell)]
        for line, at in zip(*np.nonzero(self.cells == cell), strict=True):
            numbers, end = self.cells[line], self.end[line, at]
            below, above = self.up[line, 1 : at + 1], self.down[line, at:-1]
            paid = [*below[::-1].cumsum()[::-1], 0.0, *above.cumsum()]
            whole = costs[numbers] + paid + end
            found.append((whole.min(), numbers[whole.argmin()]))
        return int(min(found)[1])


@dataclass(frozen=True, eq=False)
class Cells:
    """The plane of both W.

    Attributes:
        edges: W of each segment at the edges of cells, all as far apart.
        lines: By soft mode.
    """

    edges: tuple[Array, Array]
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


def cells_of(edges: tuple[Array, Array], lines: dict[Mode, tuple[Array, Array, Array]]) -> Cells:
    """Cells with these edges, from what it costs in each mode to enter them, and to end.

    Args:
        edges: As of `Cells`.
        lines: By soft mode: what it costs to enter from below, from above, and to end.
    """
    step = edges[0][1] - edges[0][0]
    rows, columns = (len(at) - 1 for at in edges)
    numbers = np.pad(
        np.arange(rows * columns).reshape(rows, columns), 1, constant_values=rows * columns
    )
    k = np.arange(-columns, rows)[:, None]
    t = np.arange(2 * max(rows, columns) + 2)
    j = t // 2 + np.maximum(0, -k)
    i = (t + 1) // 2 + np.maximum(0, -k) + k
    stairs = numbers[np.clip(i, 0, rows + 1), np.clip(j, 0, columns + 1)]
    inner = numbers[1:-1, 1:-1]
    of_mode = {(1, 0): inner.T, (0, 1): inner, (1, 1): stairs}
    made = {}
    for mode, costs in lines.items():
        up, down, end = (np.append(each, np.inf)[of_mode[mode]] for each in costs)
        by = step * (0.5 if all(mode) else 1.0)
        made[mode] = Lines(of_mode[mode], up + by, down + by, end)
    return Cells(edges, made)


@dataclass(frozen=True, eq=False)
class Detours:
    """Ways from a start to a goal, boxes of W.

    Attributes:
        cells: Asks for the plane.
        start: Least and largest W at the start, (2, 2).
        goal: The same of the goal.
    """

    cells: Callable[[], Cells]
    start: Array
    goal: Array
    _costs: dict[ModeSequence, Array] = field(default_factory=dict)

    def bends(self, sequence: ModeSequence) -> Array | None:
        """Change of W in each phase on the cheapest way; None if it is proved that there is none.

        What it comes to is near the goal, as cells are.
        """
        cells, soft = self.cells(), tuple(mode for mode in sequence if any(mode))
        ends = cells.within(*self.goal)
        costs = self._after(soft)[ends]
        if not np.isfinite(costs).any():
            return None
        cell, found = int(ends[costs.argmin()]), list[float]()
        for k in range(len(soft), 0, -1):
            source = cells.lines[soft[k - 1]].source(self._after(soft[: k - 1]), cell)
            moved = cells.middle(cell) - cells.middle(source)
            found.append(float(moved[np.array(soft[k - 1], dtype=bool)].mean()))
            cell = source
        bends = np.zeros(len(sequence))
        bends[[any(mode) for mode in sequence]] = found[::-1]
        return bends

    def _after(self, soft: ModeSequence) -> Array:
        """Least costs of all cells after these modes."""
        if soft not in self._costs:
            cells = self.cells()
            if soft:
                costs = cells.lines[soft[-1]].bent(self._after(soft[:-1]))
            else:
                costs = np.full((len(cells.edges[0]) - 1) * (len(cells.edges[1]) - 1) + 1, np.inf)
                costs[cells.within(*self.start)] = 0.0
            self._costs[soft] = costs
        return self._costs[soft]
