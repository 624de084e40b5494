"""Stations: the places where blocks begin and end, chosen by a lazy search for the shortest chain.

Blocks are carried out at stations, with drives from the start to the first one, between them, and
from the last one to the goal. Of many candidates the chain of least time is found with drives taken
to be direct; the drives and sweeps of the chain found are then looked at, what is not clear is
struck out, what takes longer gets its true time, and the search is repeated until no chain promises
to be better than the best one, or a few are known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge, out_of_effort
from twosra_mpc.model.flow import twists
from twosra_mpc.robot.coordinates import Array, wrapped

# Fractional parts of its multiples fill the unit cube evenly: powers of the root of x^4 = x + 1.
_EVENLY = 1 / 1.2207440846057596 ** np.arange(1, 4)

_FEW = 10_000  # coordinates of legs whose times are found at once: 2 MiB on the way
_AT_ONCE = 1000  # legs that are compared in about the time that a chain takes
HIDDEN_S = 1e-4  # less costs nothing; of chains that cost the same the shortest is taken
_TIE = 1e-7  # of the time of drives, added to what they cost: less than `HIDDEN_S` in all
_SAME = 1e-9  # m or rad
_DETOUR_S = 1.0  # longer than direct: others are estimated by roads then


class Stations(NamedTuple):
    """Candidates for one block: poses of b0 as it begins and as it ends, both (m, 3)."""

    begin: Array
    end: Array


class Chain(NamedTuple):
    """Stations that were chosen: pose as each block begins, and via poses of each drive, (m, 3).

    ``cost_s`` is how much longer the plan is for its drives.
    """

    begins: tuple[Array, ...]
    routes: tuple[Array, ...]
    cost_s: float


class Driver(Protocol):
    """Drives in one shape, as `space.drives.Drives`."""

    def leg_times_s(self, start: Array, end: Array) -> Array:
        """Times of legs between poses (..., 3) from rest to rest, (...,) [s]."""

    def time_s(self, poses: Array) -> float:
        """Time of a drive through poses (m, 3) [s]."""

    def best(self, start: Array, goal: Array) -> Array | None:
        """A drive that is clear through poses (m, 3), both ends included; None: none found."""

    def estimates_s(self, pose: Array, others: Array) -> Array:
        """About how long drives from a pose (3,) to others (m, 3) take, by roads, (m,) [s]."""

    def apart(self, start: Array, goal: Array) -> NDArray[np.bool_]:
        """Which of poses (a, 3) and (b, 3) it does not know how to join, (a, b)."""


def around(pose: Array, count: int, reach_m: float) -> Array:
    """Poses about a pose, itself the first, denser near it, (count, 3)."""
    share = np.mod(np.arange(count)[:, None] * _EVENLY, 1.0)
    radius, angle = reach_m * share[:, 0] ** 2, 2 * np.pi * share[:, 1]
    turn = 2 * share[:, 2] - 1
    turn[0] = 0.0
    by = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.pi * turn * abs(turn)])
    by[0] = 0.0
    return pose + by


def between(goal: Array, end: Array, count: int) -> Array:
    """Poses about the way from a goal to an end that is known, itself the last, (count + 1, 3)."""
    by = end - goal
    by[2] = wrapped(by[2])
    share = np.mod((np.arange(count)[:, None] + 1) * _EVENLY, 1.0)
    off = np.column_stack([share[:, 0], share[:, 1] - 0.5, share[:, 2] - 0.5])
    size = np.hypot(by[0], by[1])
    wide = np.array([size, size, abs(by[2])]) / 2
    along = goal + off[:, :1] * by
    spread = np.column_stack([off[:, 1], off[:, 2], np.roll(off[:, 1], 1)]) * wide
    return np.vstack([along + spread, end])


def chains(
    start: Array,
    goals: Callable[[Array], Array],
    layers: Sequence[Stations],
    clear: Callable[[int, Array], bool],
    drivers: Sequence[Driver | None],
    hidden_s: Sequence[float],
    most_looks: int,
    most_chains: int,
) -> Iterator[Chain]:
    """Yield a chain through one station of every layer, then shorter ones, until time is up.

    Args:
        start: Pose at the start, (3,).
        goals: Poses (m, 3) after the last block -> poses to end in, (m, 3).
        layers: Candidates for each block.
        clear: (block, pose as it begins) -> whether its sweep is clear.
        drivers: Drives before, between and after the blocks; None: there is no drive.
        hidden_s: Time that each drive may take without making the plan longer.
        most_looks: Drives and sweeps to look at before giving up.
        most_chains: Chains to compare.
    """
    if not all(len(layer.begin) for layer in layers):
        return
    legs = _Legs(start, goals, layers, drivers, np.asarray(hidden_s))
    looked: set[tuple[int, int]] = set()
    least, count = math.inf, 0
    for _ in range(most_looks):
        path = None if out_of_effort() else legs.shortest()
        if path is None or count == most_chains or legs.cost_s(path) >= least - HIDDEN_S:
            return
        unseen = next(((b, i) for b, i in enumerate(path) if (b, i) not in looked), None)
        if unseen is not None:
            b, i = unseen
            looked.add(unseen)
            if not clear(b, layers[b].begin[i]):
                legs.strike(b, i)
        elif legs.look(path):
            count += 1
            begins = tuple(layers[b].begin[i] for b, i in enumerate(path))
            found = Chain(begins, legs.routes(path), legs.cost_s(path))
            if found.cost_s < least:
                least = found.cost_s
                yield found


def _direct_s(driver: Driver | None, here: Array, there: Array, hidden_s: float) -> Array:
    """Cost added by direct drives between poses (..., 3) [s]; without a driver none may."""
    if driver is None:
        return np.where(np.abs(twists(here, there)).max(axis=-1) < _SAME, 0.0, np.inf)
    return _cost_s(driver.leg_times_s(here, there), hidden_s)


def _cost_s(drive_s: Array, hidden_s: float) -> Array:
    """Cost of drives of which some is hidden; those that cost nothing by how long they are."""
    return np.maximum(0.0, drive_s - hidden_s) + _TIE * drive_s


class _Legs:
    """Times of the drives between stations, direct until they are looked at."""

    def __init__(
        self,
        start: Array,
        goals: Callable[[Array], Array],
        layers: Sequence[Stations],
        drivers: Sequence[Driver | None],
        hidden_s: Array,
    ) -> None:
        self._drivers, self._hidden = drivers, hidden_s
        final = layers[-1].end if layers else start[None]
        self._leave = [start[None], *(layer.end for layer in layers)]
        self._arrive = [*(layer.begin for layer in layers), goals(final)]
        self._cost: list[Array] = []
        for k, driver in enumerate(drivers):
            here, there = self._leave[k], self._arrive[k]
            if k == len(layers):  # every station has a goal of its own
                self._cost.append(_direct_s(driver, here, there, hidden_s[k]))
            else:  # few at a time: what is computed on the way weighs 20 times as much
                parts = np.array_split(here[:, None], 1 + here.size * len(there) // _FEW)
                costs = [_direct_s(driver, few, there, hidden_s[k]) for few in parts]
                self._cost.append(np.concatenate(costs))
        self._found: dict[tuple[int, int, int], Array] = {}
        self._parted: set[int] = set()
        self._surveyed: set[int] = set()

    def shortest(self) -> list[int] | None:
        """Station of each layer on the shortest chain, by dynamic programming from the goal."""
        charge(Cost.CHAIN, 1 + sum(cost.size for cost in self._cost) // _AT_ONCE)
        to_go, choices = self._cost[-1], []
        for cost in reversed(self._cost[:-1]):
            through = cost + to_go[None]
            choices.append(through.argmin(axis=1))
            to_go = through.min(axis=1)
        if not np.isfinite(to_go[0]):
            return None
        path, at = [], 0
        for choice in reversed(choices):
            at = int(choice[at])
            path.append(at)
        return path

    def strike(self, layer: int, station: int) -> None:
        """Never use a station again."""
        self._cost[layer][:, station] = np.inf

    def look(self, path: Sequence[int]) -> bool:
        """Find the drives of a chain; False if one is not found."""
        ends = self._ends(path)
        for k, (i, j) in enumerate(ends):
            driver = self._drivers[k]
            if driver is None or (k, i, j) in self._found:
                continue
            route = driver.best(self._leave[k][i], self._arrive[k][j])
            if route is None:
                self._cost[k][self._place(k, i, j)] = np.inf
                self._strike_apart(k, driver)
                return False
            self._found[k, i, j] = route
            place = self._place(k, i, j)
            true = float(_cost_s(np.array(driver.time_s(route)), float(self._hidden[k])))
            about, self._cost[k][place] = self._cost[k][place], true
            if true - about > _DETOUR_S:
                self._survey(k, driver, j)
        return True

    def _survey(self, drive: int, driver: Driver, goal: int) -> None:
        """Estimate drives from the start, or to goals, along roads, as one makes a detour.

        To all goals by roads to that one's: from theirs to it is no farther than straight on.
        """
        first, last = drive == 0, drive == len(self._cost) - 1
        if drive in self._surveyed or first == last:
            return
        self._surveyed.add(drive)
        here, there = self._leave[drive], self._arrive[drive]
        one, own, others = (here[0], here, there) if first else (there[goal], there, here)
        about_s = driver.estimates_s(one, others) - driver.leg_times_s(own, one)
        cost = self._cost[drive]
        self._cost[drive] = np.maximum(cost, _cost_s(about_s, float(self._hidden[drive])))
        for known in (self._place(*found) for found in self._found if found[0] == drive):
            self._cost[drive][known] = cost[known]

    def _strike_apart(self, drive: int, driver: Driver) -> None:
        """Never again ask for a drive between what is known to be apart."""
        if drive not in self._parted:
            self._parted.add(drive)
            apart = driver.apart(self._leave[drive], self._arrive[drive])
            self._cost[drive][np.diag(apart) if drive == len(self._cost) - 1 else apart] = np.inf

    def _place(self, drive: int, i: int, j: int) -> tuple[int, ...]:
        return (j,) if drive == len(self._cost) - 1 else (i, j)

    def cost_s(self, path: Sequence[int]) -> float:
        """Cost that the drives of a chain add to the plan."""
        ends = self._ends(path)
        return sum(float(self._cost[k][self._place(k, i, j)]) for k, (i, j) in enumerate(ends))

    def routes(self, path: Sequence[int]) -> tuple[Array, ...]:
        """Via poses of every drive of a chain that has been looked at."""
        nothing = np.zeros((0, 3))
        return tuple(
            self._found.get((k, *ends), nothing) for k, ends in enumerate(self._ends(path))
        )

    def _ends(self, path: Sequence[int]) -> list[tuple[int, int]]:
        """Where each drive of a chain leaves from and arrives, by station."""
        return [(0 if k == 0 else path[k - 1], j) for k, j in enumerate([*path, (path or [0])[-1]])]
