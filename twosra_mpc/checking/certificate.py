"""Prove the lower bound of a plan anew, from the problem and a certificate, and nothing else.

A certificate names the mode sequences that are *opened*: what begins with one of them is taken
apart into the plans of the sequence itself, a *leaf*, and those of every longer one. What is not
opened is bounded as a whole. Nothing in a certificate is believed: every bound is worked out here
from the robot's parameters, in interval arithmetic rounded outward, and the least of them is what
is proved. Obstacles, a workspace and boxes to pass only forbid plans, so it holds with them too.

The lemmas and their proofs are in ``docs/certificate.md``.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from flint import arb, fmpq_mat

from twosra_mpc.checking.fibre import Fibre, between, low
from twosra_mpc.checking.melts import Heat, heat
from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid, rigid_mode
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming

GOAL_TOLERANCE = 1e-6  # m, rad, 1/m: by so much verified plans may miss their goal
_BOXES = (1, 200, 40, 14, 7)  # of each curvature that is not known, by their number

Event = tuple[str, int, int, int]
Edge = tuple[Event, Event, arb]
_ORIGIN: Event = ("origin", 0, 0, 0)


class Network(NamedTuple):
    """Events of a sequence, and what they cost.

    Attributes:
        edges: (u, v, w): t[v] - t[u] >= w [s]; what leads to an event before what leads from it.
        holds: (u, v, price): a heater holds from u to v, at a price for every second.
        cost: Of transitions and melts.
        finish: The end of the plan.
    """

    edges: list[Edge]
    holds: list[Edge]
    cost: arb
    finish: Event


class Prices(NamedTuple):
    """Multipliers of a leaf: of what W has changed by after each phase, and of its edges."""

    bends: list[list[float]]
    edges: list[float]


class Bounded(NamedTuple):
    """What the plans of a sequence cost at least, or all that begin with it."""

    sequence: ModeSequence
    leaf: bool
    bound: float


@dataclass(frozen=True)
class Proof:
    """What a certificate proves: the least of ``parts`` bounds every plan of the problem [s]."""

    parts: tuple[Bounded, ...]

    @property
    def bound(self) -> float:
        """Proved lower bound on the cost of every plan, of any number of phases [s]."""
        return min((part.bound for part in self.parts), default=math.inf)


class Checker:
    """Lower bounds on sets of plans of one problem."""

    def __init__(self, problem: Problem) -> None:
        if problem.is_mission:
            raise InputError("tasks", "a mission", "a problem with one goal: others have no proof")
        kinds = (ThermalTiming, OverlappedTiming, SequentialTiming)
        if type(problem.transition_times) not in kinds:
            raise InputError("timing", problem.timing, "one that is thermal, full or none")
        self.problem, self.weights = problem, problem.cost_weights
        self.fibre, self.first = Fibre(problem.robot), problem.start_mode
        self.rigid, self.last = rigid_mode(len(self.first)), problem.goal.mode
        self.segments = range(len(self.first))
        sequential = type(problem.transition_times) is SequentialTiming
        self.heats: list[Heat] = [] if sequential else [heat(problem, j) for j in self.segments]
        start, limit = problem.start.configuration, problem.robot.limits.curvature_per_m
        lower, upper = (end.tolist()[POSE:] for end in problem.goal.box(start))
        self.origin = [self.fibre.coordinate(j, k) for j, k in enumerate(start.tolist()[POSE:])]
        self.room = [self.fibre.coordinate(j, limit + 1e-5) for j in self.segments]
        self.limit, self.change, self._fastest = arb(limit + 1e-5), list[arb](), dict[Any, arb]()
        for j, (a, b) in enumerate(zip(lower, upper, strict=True)):
            a, b = max(a - GOAL_TOLERANCE, -limit), min(b + GOAL_TOLERANCE, limit)
            self.change.append(self.fibre.coordinate(j, between(a, b)) - self.origin[j])

    # The tree of mode sequences: section 1 of the lemmas.

    def root(self) -> ModeSequence:
        """With what every sequence begins: the rigid mode, if the robot is rigid and may drive."""
        drives = self.first == self.rigid and self.rigid in self.problem.modes
        return (self.rigid,) if drives else ()

    def children(self, node: ModeSequence) -> list[ModeSequence]:
        """Every sequence that is longer by a phase; no phase repeats the mode before it."""
        return [(*node, mode) for mode in self.problem.modes if node[-1:] != (mode,)]

    def leaf(self, node: ModeSequence) -> ModeSequence | None:
        """The sequence whose plans are counted at a node: the node, or closed by a rigid phase.

        None at a node that is itself another one closed.
        """
        opening = node == self.root() == (self.rigid,)
        if opening or self.last != self.rigid or self.rigid not in self.problem.modes:
            return node
        return None if node[-1:] == (self.rigid,) else (*node, self.rigid)

    # Time and cost: section 4.

    def network(
        self, sequence: ModeSequence, least: Sequence[arb], missing: Sequence[int] = ()
    ) -> Network:
        """What every plan passes that begins with these phases, and melts what is missing."""
        if not self.heats:
            return self._waits(sequence, least, missing)
        edges, holds, cost = list[Edge](), list[Edge](), arb(0)
        stiff, made, done = list(self.first), [0] * len(self.first), [_ORIGIN] * len(self.first)
        before, begin, held = _ORIGIN, _ORIGIN, [arb(0)] * len(self.first)
        for gap, mode in enumerate((*sequence, self.last)):
            begin = ("start", gap, 0, 0)
            edges.append((before, begin, arb(0)))
            for j, own in enumerate(self.heats):
                to = [mode[j]] if mode[j] != stiff[j] else []
                if gap == len(sequence) and j in missing:
                    to = [1] if self.last[j] else [1, 0]
                for stiff[j] in to:
                    onset, end = ("onset", gap, j, made[j]), ("done", gap, j, made[j])
                    lead, plateau = (own.again, own.melt) if stiff[j] else (arb(0), arb(0))
                    cost += self.weights.transition_s
                    if made[j] == 0:
                        lead, plateau = own.lead, own.first
                        edges.append((_ORIGIN, end, own.total))
                    elif not stiff[j]:
                        plateau = own.freeze(made[j], held[j])
                        holds.append((done[j], onset, self.weights.energy_s_per_J * own.hold_W))
                    if stiff[j]:
                        energy, held[j] = own.melt_J if made[j] else own.first_J, arb(0)
                        cost += self.weights.energy_s_per_J * energy
                    edges += [(before, onset, arb(0)), (done[j], onset, lead)]
                    edges += [(onset, end, plateau), (end, begin, arb(0))]
                    made[j], done[j] = made[j] + 1, end
            if gap < len(sequence):
                before = ("end", gap, 0, 0)
                edges.append((begin, before, least[gap]))
                held = [one + least[gap] for one in held]
        return Network(edges, holds, cost, begin)

    def _waits(
        self, sequence: ModeSequence, least: Sequence[arb], missing: Sequence[int]
    ) -> Network:
        """The same where everything waits through every change of mode."""
        edges, cost, before, mode = list[Edge](), arb(0), _ORIGIN, self.first
        for i, after in enumerate(sequence):
            wait, price = self._switch(mode, after)
            begin, end = ("start", i, 0, 0), ("end", i, 0, 0)
            edges += [(before, begin, wait), (begin, end, least[i])]
            cost, before, mode = cost + price, end, after
        return Network(edges, [], cost + self._cheapest_way(mode, frozenset(missing)), before)

    def _switch(self, mode: Mode, after: Mode) -> tuple[arb, arb]:
        """Wait between two modes, and what its transitions and melts cost besides."""
        times, heater = self.problem.transition_times, self.problem.robot.heater
        assert isinstance(times, SequentialTiming)
        if mode == after:
            return arb(0), arb(0)
        wait, heated = arb(times.reconfigure_s), arb(times.reconfigure_s) - times.reconfigure_cool_s
        if is_rigid(mode):
            wait = heated = arb(times.heat_s)
        elif is_rigid(after):
            wait = arb(times.freeze_s)
        energy_J = heated * sum(after) * arb(heater.melt_current_A) ** 2 * heater.resistance_ohm
        price = self.weights.energy_s_per_J * energy_J
        return wait, price + self.weights.transition_s * (sum(mode) + sum(after))

    def _cheapest_way(self, mode: Mode, missing: frozenset[int]) -> arb:
        """Least wait and price from a mode to the end, through modes that melt what is missing."""
        queue, seen = [(0.0, mode, missing)], set[tuple[Mode, frozenset[int]]]()
        while queue:
            spent, here, left = heapq.heappop(queue)
            if here == self.last and not left:
                return arb(spent) * (1 - arb(1e-12))  # more than the sums are rounded
            if (here, left) in seen:
                continue
            seen.add((here, left))
            for after in {*self.problem.modes, self.last} - {here}:
                rest = frozenset(j for j in left if not after[j])
                wait, price = self._switch(here, after)
                heapq.heappush(queue, (spent + low(wait + price), after, rest))
        return arb.pos_inf()

    def _cost(self, network: Network) -> float:
        """The finish is no earlier than by the longest path to it, no hold is shorter than one."""
        cost = network.cost + _longest(network.edges, _ORIGIN, network.finish)
        for u, v, price in network.holds if self.weights.energy_s_per_J else ():
            cost += price * _longest(network.edges, u, v)
        return max(0.0, low(cost))

    def node_bound(self, node: ModeSequence) -> float:
        """What every plan costs whose sequence begins with these phases [s]."""
        melted = [self.first[j] or any(mode[j] for mode in node) for j in self.segments]
        missing = [j for j in self.segments if not melted[j] and not self.change[j].contains(0)]
        return self._cost(self.network(node, [arb(0)] * len(node), missing))

    # Bends: section 2.

    def leaf_bound(self, sequence: ModeSequence, prices: Prices | None = None) -> float:
        """What every plan costs whose phases are these [s]; inf if there is none."""
        if self._kept(sequence):
            return math.inf
        least = self.least_durations(sequence)
        if least is None:
            return math.inf
        network = self.network(sequence, least)
        bound = self._cost(network)
        return bound if prices is None else max(bound, self._priced(sequence, network, prices))

    def sums(self, sequence: ModeSequence) -> list[list[arb]]:
        """What W has changed by after each phase, segment by segment, within limits and goal."""
        room = [between(-r - w, r - w) for r, w in zip(self.room, self.origin, strict=True)]
        later = [sequence[i + 1 :] for i in range(len(sequence))]
        return [
            [room[j] if any(m[j] for m in rest) else self.change[j] for j in self.segments]
            for rest in later
        ]

    def _priced(self, sequence: ModeSequence, network: Network, prices: Prices) -> float:
        """What a price of every change of W, and of every difference of event times, proves."""
        rows = len(prices.edges), [len(row) for row in prices.bends]
        if rows != (len(network.edges), [len(self.segments)] * len(sequence)):
            raise InputError("certificate.priced", rows, "a price for each edge and change of W")
        need, drawn = arb(0), [arb(0)] * len(sequence)  # price of the bend of each phase
        for i, (priced, sums) in enumerate(zip(prices.bends, self.sums(sequence), strict=True)):
            for j, (price, total) in enumerate(zip(priced, sums, strict=True)):
                need += price * total
                for k in range(i + 1):
                    drawn[k] += price * sequence[k][j]
        most = arb(0)  # what bends within the limits can be worth
        for drawn_here, mode in zip(drawn, sequence, strict=True):
            most += abs(drawn_here) * min(
                (2 * self.room[j] for j in self.segments if mode[j]), default=0
            )
        if need.lower() > most:
            return math.inf
        value, left = need.lower() + network.cost, dict[Event, arb]()

        def count(event: Event, coefficient: arb) -> None:
            left[event] = left.get(event, arb(0)) + coefficient

        count(network.finish, arb(1))
        for u, v, per_s in network.holds:
            count(v, per_s)
            count(u, -per_s)
        for (u, v, apart), given in zip(network.edges, prices.edges, strict=True):
            value += given * apart
            count(v, arb(-given))
            count(u, arb(given))
        for i in range(len(sequence)):
            if drawn[i] != 0:
                worth = abs(drawn[i]) * self.fastest(sequence, i)
                count(("end", i, 0, 0), -worth)
                count(("start", i, 0, 0), worth)
        short = sum((-rest.min(arb(0)) for e, rest in left.items() if e != _ORIGIN), arb(0))
        return max(0.0, low(value / (1 + short)))

    def fastest(self, sequence: ModeSequence, phase: int) -> arb:
        """Largest abs(dW/dt) in a soft phase, whatever shapes the segments may have there."""
        mode, before, after = sequence[phase], sequence[:phase], sequence[phase + 1 :]
        known: list[arb | None] = [None for _ in self.segments]
        for j, start in enumerate(self.origin):
            if not any(m[j] for m in (*before, mode)):
                known[j] = start
            elif not any(m[j] for m in (mode, *after)):
                known[j] = start + self.change[j]
        key = (
            mode,
            *(
                0 if w is None else 1 + (w is start)
                for w, start in zip(known, self.origin, strict=True)
            ),
        )
        if key not in self._fastest:
            boxes, most = _BOXES[known.count(None)], arb(0)
            for cell in itertools.product(*(range(1 if w is not None else boxes) for w in known)):
                kappa = [between(2 * k / boxes - 1, 2 * (k + 1) / boxes - 1) for k in cell]
                kappa = [
                    share * self.limit if w is None else self.fibre.curvature(j, w)
                    for j, (w, share) in enumerate(zip(known, kappa, strict=True))
                ]
                most = most.max(self.fibre.rate_of_w(mode, kappa)).upper()
            self._fastest[key] = most
        return self._fastest[key]

    def _kept(self, sequence: ModeSequence) -> bool:
        """Whether what these modes cannot change must change: sums of W with weights -1, 0, 1."""
        soft = {mode for mode in sequence if any(mode)}
        for kept in itertools.product((-1, 0, 1), repeat=len(self.first)):
            idle = all(sum(c * s for c, s in zip(kept, mode, strict=True)) == 0 for mode in soft)
            moved = sum((c * w for c, w in zip(kept, self.change, strict=True)), arb(0))
            if idle and not moved.contains(0):
                return True
        return False

    def _bends(self, sequence: ModeSequence) -> list[arb] | None:
        """Change of W in each phase; None where the soft modes leave a choice."""
        soft = [i for i, mode in enumerate(sequence) if any(mode)]
        if not soft:
            return [arb(0)] * len(sequence)
        incidence = fmpq_mat([list(sequence[i]) for i in soft])
        gram = incidence * incidence.transpose()
        if gram.rank() < len(soft):
            return None
        inverse, bends = gram.inv() * incidence, [arb(0)] * len(sequence)
        for row, i in enumerate(soft):
            bends[i] = sum((arb(inverse[row, j]) * self.change[j] for j in self.segments), arb(0))
        return bends

    def least_durations(self, sequence: ModeSequence) -> list[arb] | None:
        """Least durations of the phases, where bends are known; None if one is forbidden."""
        bends, here = self._bends(sequence), list(self.origin)
        if bends is None:
            return [arb(0)] * len(sequence)
        least = []
        for mode, bend in zip(sequence, bends, strict=True):
            time = self.fibre.bend_time(mode, here, bend) if any(mode) else arb(0)
            here = [w + bend if soft else w for w, soft in zip(here, mode, strict=True)]
            beyond = any(abs(w) > room for w, room in zip(here, self.room, strict=True))
            if time is None or beyond:
                return None
            least.append(time)
        return least


def _longest(edges: Sequence[Edge], source: Event, target: Event) -> arb:
    """Length of the longest path between two events; 0 if there is none."""
    least = {source: arb(0)}
    for u, v, apart in edges:
        if u in least:
            least[v] = least.get(v, arb(0)).max(least[u] + apart)
    return least.get(target, arb(0))


def check(problem: Problem, certificate: dict[str, Any]) -> Proof:
    """Work out what a certificate proves of a problem.

    Raises:
        InputError: If it is no certificate, or the problem is of a kind that has none.
    """
    checker, parts = Checker(problem), list[Bounded]()
    opened, prices = _read(certificate)
    nodes = [checker.root()]
    while nodes:
        node = nodes.pop()
        if node not in opened:
            parts.append(Bounded(node, False, checker.node_bound(node)))
            continue
        opened.remove(node)
        nodes += checker.children(node)
        if (sequence := checker.leaf(node)) is not None:
            bound = checker.leaf_bound(sequence, prices.pop(sequence, None))
            parts.append(Bounded(sequence, True, bound))
    if opened or prices:
        allowed = "sequences of the tree, each with all that it begins with"
        raise InputError("certificate.opened", next(iter(opened or prices)), allowed)
    return Proof(tuple(parts))


def _read(certificate: dict[str, Any]) -> tuple[set[ModeSequence], dict[ModeSequence, Prices]]:
    """The sequences that are opened, and the prices of leaves."""
    try:
        opened = {_sequence(modes) for modes in certificate["opened"]}
        prices = {
            _sequence(leaf["sequence"]): Prices(
                [[float(price) for price in row] for row in leaf["bends"]],
                [max(0.0, float(price)) for price in leaf["edges"]],
            )
            for leaf in certificate.get("priced", ())
        }
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        allowed = "opened: a list of mode sequences; priced: a list of leaves with their prices"
        raise InputError("certificate", repr(error), allowed) from None
    return opened, prices


def _sequence(modes: Any) -> ModeSequence:
    return tuple(tuple(int(soft) for soft in mode) for mode in modes)
