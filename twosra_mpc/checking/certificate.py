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

from twosra_mpc.checking.enclosures import Fibre, Heat, between, heat, low
from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid, rigid_mode
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming

GOAL_TOLERANCE = 1e-6  # m, rad, 1/m: by so much verified plans may miss their goal
_PIECES = 120  # of a bend
_MOVES = 1e-5  # of W: a phase that bends by less may be left out

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
        self.change = []
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

    def _network(
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
        return self._cost(self._network(node, [arb(0)] * len(node), missing))

    # Bends: section 2.

    def leaf_bound(self, sequence: ModeSequence) -> float:
        """What every plan costs whose phases are these [s]; inf if there is none."""
        if self._kept(sequence):
            return math.inf
        least = self._least_durations(sequence)
        return math.inf if least is None else self._cost(self._network(sequence, least))

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

    def _least_durations(self, sequence: ModeSequence) -> list[arb] | None:
        """Least durations of the phases, where bends are known; None if one is forbidden."""
        bends, here = self._bends(sequence), list(self.origin)
        if bends is None:
            return [arb(0)] * len(sequence)
        least = []
        for mode, bend in zip(sequence, bends, strict=True):
            time = self._bend_time(mode, here, bend) if any(mode) else arb(0)
            here = [w + bend if soft else w for w, soft in zip(here, mode, strict=True)]
            beyond = any(abs(w) > room for w, room in zip(here, self.room, strict=True))
            if time is None or beyond:
                return None
            least.append(time)
        return least

    def _bend_time(self, mode: Mode, here: Sequence[arb], bend: arb) -> arb | None:
        """Least time of a bend, from rest to rest; None if it passes a forbidden shape."""
        ends = bend.lower(), bend.upper()
        surely = ends[0] if ends[0] > 0 else ends[1] if ends[1] < 0 else arb(0)
        if surely == 0:
            return arb(0)
        limits, at_speed, turned = self.problem.robot.limits, arb(0), [arb(0)] * len(mode)
        piece = abs(surely) / _PIECES
        for k in range(_PIECES):
            if self.fibre.overlaps(self._shapes(mode, here, surely * k / _PIECES)):
                return None
            kappa = self._shapes(mode, here, between(k, k + 1) * surely / _PIECES)
            paces = [abs(self.fibre.bend(mode, kappa, unit)[3]).upper() for unit in (0, 1)]
            if all(pace.is_finite() for pace in paces):
                at_speed += piece / (sum(paces) * self.fibre.unit_speed)
            turned = [
                t + piece * self.fibre.share(j, kappa[j]).abs_lower() if mode[j] else t
                for j, t in enumerate(turned)
            ]
        ramp = arb(0)
        if limits.wheel_acceleration_rad_s2 is not None and self.fibre.rolls_v:
            radius = self.problem.robot.geometry.wheel_radius_m
            ramp = self.fibre.unit_speed / (arb(limits.wheel_acceleration_rad_s2) * radius)
        time = at_speed + ramp if at_speed > ramp else 2 * (at_speed * ramp).sqrt()
        if limits.bend_rate_rad_s is not None:
            time = max([time, *(t / limits.bend_rate_rad_s for t in turned)], key=low)
        return time.max(arb(limits.phase_s)) if abs(surely) > _MOVES else time

    def _shapes(self, mode: Mode, here: Sequence[arb], moved: arb) -> list[arb]:
        """Curvatures where the W of the soft segments have changed by so much."""
        moves = zip(here, mode, strict=True)
        return [self.fibre.curvature(j, w + soft * moved) for j, (w, soft) in enumerate(moves)]


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
    try:
        opened = {tuple(map(tuple, sequence)) for sequence in certificate["opened"]}
    except (KeyError, TypeError) as error:
        raise InputError("certificate", repr(error), "opened: a list of mode sequences") from None
    nodes = [checker.root()]
    while nodes:
        node = nodes.pop()
        if node not in opened:
            parts.append(Bounded(node, False, checker.node_bound(node)))
            continue
        opened.remove(node)
        nodes += checker.children(node)
        if (sequence := checker.leaf(node)) is not None:
            parts.append(Bounded(sequence, True, checker.leaf_bound(sequence)))
    if opened:
        allowed = "sequences of the tree, each with all that it begins with"
        raise InputError("certificate.opened", next(iter(opened)), allowed)
    return Proof(tuple(parts))
