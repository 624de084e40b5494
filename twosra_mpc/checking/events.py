"""The events of a mode sequence and what they cost, in intervals: section 4 of the certificate.

A second account of ``timing`` for ``checking.certificate``.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

from flint import arb

from twosra_mpc.checking.fibre import low
from twosra_mpc.checking.melts import Heat, heat
from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming

Event = tuple[str, int, int, int]
Edge = tuple[Event, Event, arb]
ORIGIN: Event = ("origin", 0, 0, 0)


class Network(NamedTuple):
    """Events of a sequence, and what they cost.

    Attributes:
        edges: (u, v, w): t[v] - t[u] >= w [s]; what leads to an event before what leads from it.
        holds: (u, v, price): a heater holds from u to v, at a price for every second.
        cost: Of transitions and melts.
        finish: The end of the plan.
        refused: Whether one heater cannot do it.
    """

    edges: list[Edge]
    holds: list[Edge]
    cost: arb
    finish: Event
    refused: bool = False


class Stop(NamedTuple):
    """A moment after the phases of a sequence.

    Attributes:
        mode: Stiffness then; None: any.
        melted: Segments that are soft at some time since the moment before.
        after_s: Least time since then [s].
    """

    mode: Mode | None
    melted: frozenset[int] = frozenset()
    after_s: float = 0.0


class Dwell(NamedTuple):
    """A soft period of a segment: the gaps in which it melts and freezes, and their events.

    ``lead`` and ``heating`` are from heater on to onset and end of its melt, at least.
    """

    segment: int
    since: int
    until: int
    melt: tuple[Event, Event] | None
    freeze: Event | None
    lead: arb
    heating: arb


class Events:
    """The events of mode sequences of a problem."""

    def __init__(self, problem: Problem) -> None:
        kinds = (ThermalTiming, OverlappedTiming, SequentialTiming)
        if type(problem.transition_times) not in kinds:
            raise InputError("timing", problem.timing, "one that is thermal, full or none")
        self.problem, self.weights = problem, problem.cost_weights
        self.first = problem.start_stiffness
        waits, segments = type(problem.transition_times) is SequentialTiming, range(len(self.first))
        self.heats: list[Heat] = [] if waits else [heat(problem, j) for j in segments]

    def network(
        self, sequence: ModeSequence, least: Sequence[arb], stops: Sequence[Stop]
    ) -> Network:
        """Events of every plan that begins with these phases, and then passes these moments."""
        if not self.heats:
            return self._waits(sequence, least, stops)
        edges, holds, cost = list[Edge](), list[Edge](), arb(0)
        stiff, made, done = list(self.first), [0] * len(self.first), [ORIGIN] * len(self.first)
        before, begin, held = ORIGIN, ORIGIN, [arb(0)] * len(self.first)
        over = len(sequence)  # of the phases; moments to come are phases of no length
        never = over + len(stops)
        open_at_start = Dwell(0, -1, never, None, None, arb(0), arb(0))
        liquid = [now == 1 for now in self.first]
        dwells = [[open_at_start._replace(segment=j)] * now for j, now in enumerate(liquid)]
        passed = [*(Stop(mode) for mode in sequence), *stops]
        for gap, (mode, melted, after_s) in enumerate(passed):
            begin = ("start", gap, 0, 0)
            edges.append((before, begin, arb(after_s)))
            for j, own in enumerate(self.heats):
                after = stiff[j] if mode is None else mode[j]
                to = [] if after is None or after == stiff[j] else [after]
                if j in melted and not stiff[j]:
                    to = [1] if after or mode is None else [1, 0]
                if stiff[j] is None and not sequence:  # it may melt or freeze
                    to = []
                for soft in to:
                    onset, end = ("onset", gap, j, made[j]), ("done", gap, j, made[j])
                    cost += self.weights.transition_s
                    if gap <= over:
                        lead, plateau, energy = own.change(soft, made[j], held[j])
                    else:  # it may have changed for nothing before
                        might = (own.change(soft, k, arb(0)) for k in (made[j], 1, 2))
                        lead, plateau, energy = functools.reduce(_least, might)
                    if made[j] == 0 and gap <= over:
                        edges.append((ORIGIN, end, own.first(soft).total))
                    elif made[j] and not soft and (gap <= over or len(to) > 1):
                        holds.append((done[j], onset, self.weights.energy_s_per_J * own.hold_W))
                    if soft:
                        held[j] = arb(0)
                        cost += self.weights.energy_s_per_J * energy
                        warm = own.again if made[j] else own.warm
                        warm = warm if gap <= over else warm.min(own.again)
                        one = Dwell(j, gap, never, (onset, end), None, warm, warm + plateau)
                        dwells[j].append(one)
                    elif dwells[j]:
                        dwells[j][-1] = dwells[j][-1]._replace(until=gap, freeze=onset)
                    edges += [(before, onset, arb(0)), (done[j], onset, lead)]
                    edges += [(onset, end, plateau), (end, begin, arb(0))]
                    made[j], done[j], stiff[j] = made[j] + 1, end, soft
            before = begin
            if gap < over:
                before = ("end", gap, 0, 0)
                edges.append((begin, before, least[gap]))
                held = [one + least[gap] for one in held]
        refused = self.problem.heaters_at_once == 1 and self._one_heater(dwells, over, edges)
        return Network(edges, holds, cost, begin, refused)

    def _one_heater(self, dwells: list[list[Dwell]], end: int, edges: list[Edge]) -> bool:
        """Add edges between dwells that follow each other; tell whether two cannot overlap."""
        for a, b in itertools.permutations(itertools.chain(*dwells), 2):
            if a.segment == b.segment:
                continue
            if a.until <= b.since and a.until < end and b.melt and a.freeze:
                late = b.lead - self.heats[a.segment].longest
                edges += [(a.melt[1], b.melt[0], b.lead)] if a.melt else []
                edges.append((a.freeze, b.melt[0], late))
            both = max(a.since, b.since) < min(a.until, b.until, end)
            both &= bool(a.melt or b.melt) or (a.freeze is None and b.freeze is None)
            if both and not self._coasts(a, b) and not self._coasts(b, a):
                return True
        return False

    def _coasts(self, a: Dwell, b: Dwell) -> bool:
        """True if a may stay liquid without heat while b melts."""
        return b.melt is not None and not self.heats[a.segment].longest < b.heating

    def _waits(
        self, sequence: ModeSequence, least: Sequence[arb], stops: Sequence[Stop]
    ) -> Network:
        """The same where everything waits through every change of mode."""
        edges, cost, before = list[Edge](), arb(0), ORIGIN
        mode: tuple[float, ...] = tuple(self.problem.melt_fractions)
        for i, after in enumerate(sequence):
            wait, price = self._switch(mode, after)
            begin, end = ("start", i, 0, 0), ("end", i, 0, 0)
            edges += [(before, begin, wait), (begin, end, least[i])]
            cost, before, mode = cost + price, end, after
        for stop in stops:
            cost += self._cheapest_way(mode, stop)
            mode = mode if stop.mode is None else stop.mode
        modes = [*sequence, *(stop.mode for stop in stops if stop.mode is not None)]
        refused = self.problem.heaters_at_once == 1 and max(map(sum, modes), default=0) > 1
        return Network(edges, [], cost, before, refused)

    def _switch(self, mode: tuple[float, ...], after: Mode) -> tuple[arb, arb]:
        """Wait from what is molten to a mode, and what its melts and freezes cost besides."""
        times, heater = self.problem.transition_times, self.problem.robot.heater
        assert isinstance(times, SequentialTiming)
        cool_s = arb(times.reconfigure_cool_s)
        if mode == after:
            return arb(0), arb(0)
        frozen = sum(share > 0 for share in mode)
        if is_rigid(after):
            return times.freeze_s * arb(max(mode)), self.weights.transition_s * arb(frozen)
        kept = [arb(share) for share, soft in zip(mode, after, strict=True) if soft]
        most = max(share for share, soft in zip((*mode, 0.0), (*after, 0), strict=True) if not soft)
        least = min(kept)
        cooled = (max(kept) - least).max(arb(most))
        heat_s = times.heat_s + cooled * (times.reconfigure_s - cool_s - times.heat_s)
        heated = heat_s * (1 - least + cooled).min(arb(1))
        energy_J = heated * sum(after) * arb(heater.melt_current_A) ** 2 * heater.resistance_ohm
        price = self.weights.energy_s_per_J * energy_J
        turns = frozen * bool(cooled > 0) + sum(after)
        return cool_s * cooled + heated, price + self.weights.transition_s * turns

    def _cheapest_way(self, mode: tuple[float, ...], stop: Stop) -> arb:
        """Least wait and price from a mode to a moment, through modes that melt what they must."""
        left = frozenset(j for j in stop.melted if mode[j] < 1)
        queue, seen = [(0.0, mode, left)], set[tuple[tuple[float, ...], frozenset[int]]]()
        while queue:
            spent, here, left = heapq.heappop(queue)
            if stop.mode in (None, here) and not left:
                return arb(spent) * (1 - arb(1e-12))  # more than the sums are rounded
            if (here, left) in seen:
                continue
            seen.add((here, left))
            for after in {*self.problem.modes, *filter(None, [stop.mode])} - {here}:
                rest = frozenset(j for j in left if not after[j])
                wait, price = self._switch(here, after)
                heapq.heappush(queue, (spent + low(wait + price), after, rest))
        return arb.pos_inf()

    def cost(self, network: Network) -> float:
        """The finish is no earlier than by the longest path to it, no hold is shorter than one."""
        if network.refused:
            return math.inf
        cost = network.cost + _longest(network.edges, ORIGIN, network.finish)
        for u, v, price in network.holds if self.weights.energy_s_per_J else ():
            cost += price * _longest(network.edges, u, v)
        return max(0.0, low(cost))


def _least(one: tuple[arb, arb, arb], other: tuple[arb, arb, arb]) -> tuple[arb, arb, arb]:
    return one[0].min(other[0]), one[1].min(other[1]), one[2].min(other[2])


def _longest(edges: Sequence[Edge], source: Event, target: Event) -> arb:
    """Length of the longest path between two events; 0 if there is none."""
    least = {source: arb(0)}
    for u, v, apart in (*edges, *edges):  # what follows one heater's turn comes too early once
        if u in least:
            least[v] = least.get(v, arb(0)).max(least[u] + apart)
    return least.get(target, arb(0))
