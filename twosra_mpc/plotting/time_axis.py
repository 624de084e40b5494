"""Time axes: motion phases last about a second, the holds between them minutes."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twosra_mpc.plans.trajectory import Phase

Array = NDArray[np.float64]


class TimeStretch(NamedTuple):
    """Piecewise linear map from time to place on the axis; phases get a least width.

    Attributes:
        knots_s: Ends of phases and holds [s], increasing.
        places: Where they are on the axis, from 0 to 1.
    """

    knots_s: tuple[float, ...]
    places: tuple[float, ...]

    @classmethod
    def of(cls, phases: Sequence[Phase], end_s: float, least: float = 0.15) -> TimeStretch:
        """Give each phase at least ``least`` of the length of an unstretched axis."""
        edges = {round(t, 9) for phase in phases for t in phase[1:]}
        knots = (0.0, *sorted(t for t in edges if 0.0 < t < round(end_s, 9)), end_s)
        moving = [any(p[1] <= (a + b) / 2 <= p[2] for p in phases) for a, b in pairwise(knots)]
        widths = np.maximum(np.diff(knots), least * end_s * np.array(moving))
        return cls(knots, (0.0, *(np.cumsum(widths) / widths.sum()).tolist()))

    @property
    def even(self) -> bool:
        """Whether nothing is stretched."""
        return np.allclose(self.places, np.divide(self.knots_s, self.knots_s[-1]))

    def forward(self, t: Array) -> Array:
        """Place of times [s] on the axis."""
        return np.interp(t, self.knots_s, self.places)

    def inverse(self, place: Array) -> Array:
        """Times [s] of places on the axis."""
        return np.interp(place, self.places, self.knots_s)

    def seconds_per_length(self, time_s: float) -> float:
        """How many seconds the whole axis would show at the scale it has at a time."""
        part = min(bisect_right(self.knots_s, time_s + 1e-9), len(self.knots_s) - 1) - 1
        shown = self.places[part + 1] - self.places[part]
        return (self.knots_s[part + 1] - self.knots_s[part]) / shown

    def ticks(self, digit: float = 0.0085) -> dict[float, str]:
        """Times worth a tick [s] and labels that fit; ``digit`` is the width of one on the axis."""
        end_s, chosen = self.knots_s[-1], dict[float, str]()
        rounded = np.asarray(MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(0.0, end_s))
        for t in (0.0, end_s, *self.knots_s[1:-1], *rounded[rounded < end_s].tolist()):
            text = f"{t:.2f}".rstrip("0").rstrip(".")
            apart = np.abs(self.forward(np.array(list(chosen))) - self.forward(np.array(t)))
            widths = [digit * (1 + (len(text) + len(label)) / 2) for label in chosen.values()]
            if np.all(apart > widths):
                chosen[t] = text
        return chosen

    def apply(self, ax: Axes, digit: float = 0.0085) -> Axes:
        """Make this the time axis of ``ax``, with its ticks; see ``ticks``."""
        ticks = self.ticks(digit)
        ax.set_xscale("function", functions=(self.forward, self.inverse))
        ax.set(xlim=(0.0, self.knots_s[-1]))
        ax.set_xticks(list(ticks), list(ticks.values()))
        return ax
