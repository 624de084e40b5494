"""Prove the lower bound of a plan anew, from the problem and a certificate, and nothing else.

A certificate names the mode sequences that are *opened*: what begins with one of them is taken
apart into the plans of the sequence itself, a *leaf*, and those of every longer one. What is not
opened is bounded as a whole. Nothing in a certificate is believed: every bound is worked out here
from the robot's parameters, in interval arithmetic rounded outward, and the least of them is what
is proved. Obstacles, a workspace and boxes to pass only forbid plans, so it holds with them too.

The lemmas and their proofs are in ``docs/certificate.md``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from flint import arb, fmpq_mat

from twosra_mpc.checking.events import ORIGIN, Event, Events, Network, Stop
from twosra_mpc.checking.fibre import NO_TIME, Fibre, Least, between, low
from twosra_mpc.checking.legs import NOTHING, Choices, Leg, Legs, in_any_order
from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import BEYOND_PER_M, COST_TOLERANCE_S, forgiven
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import ModeSequence, rigid_mode

_BOXES = (1, 200, 40, 14, 7)  # of each curvature that is not known, by their number


class Prices(NamedTuple):
    """Multipliers of a leaf: of what W has changed by after each phase, and of its edges.

    ``slopes``: effort of each phase that a second more would save [s/s].
    """

    bends: list[list[float]]
    edges: list[float]
    slopes: list[float]


class Leaf(NamedTuple):
    """The phases of a leaf: the least of each, and their events."""

    least: list[Least]
    network: Network


class Bounded(NamedTuple):
    """Least cost of the plans of a sequence, or of all that begin with it."""

    sequence: ModeSequence
    leaf: bool
    bound: float


@dataclass(frozen=True)
class Proof:
    """Proof of a certificate: the least of ``parts`` bounds every plan of the problem [s].

    Parts are bounds of plans that keep everything exactly; each leg has changes of mode whose
    events may be a bit early.
    """

    parts: tuple[Bounded, ...]
    replay_tolerance: float = 0.0
    legs: int = 1

    @property
    def bound(self) -> float:
        """Proved lower bound on the cost of every verified plan, of any number of phases [s]."""
        least = min((part.bound for part in self.parts), default=math.inf)
        return max(0.0, forgiven(least, self.replay_tolerance) - (self.legs - 1) * COST_TOLERANCE_S)


class Checker:
    """Lower bounds on sets of plans of one problem, whose tasks are done in the order given."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.events, self.fibre = problem, Events(problem), Fibre(problem.robot)
        self.legs, self.first = tuple(Legs(problem).legs()), problem.start_stiffness
        self.rigid, self.segments = rigid_mode(len(self.first)), range(len(self.first))
        start = problem.start.configuration
        limit = problem.robot.limits.curvature_per_m + BEYOND_PER_M
        self.origin = [self.fibre.coordinate(j, k) for j, k in enumerate(start.tolist()[POSE:])]
        self.room = [self.fibre.coordinate(j, limit) for j in self.segments]
        self.ends = [
            [self.fibre.coordinate(j, k) for j, k in enumerate(leg.shape)] for leg in self.legs
        ]
        self.limit, self._fastest = arb(limit), dict[Any, arb]()

    # The tree of mode sequences: section 1 of the lemmas. () marks the end of a leg.

    def root(self) -> ModeSequence:
        """With what every sequence begins: the rigid mode, if the robot is rigid and may drive."""
        return self._begun(())

    def _begun(self, node: ModeSequence) -> ModeSequence:
        number = node.count(())
        before = self.legs[number - 1].last if number else self.first
        drives = before == self.rigid and self.rigid in self.legs[number].modes
        return (*node, self.rigid) if drives else node

    def children(self, node: ModeSequence) -> list[ModeSequence]:
        """Every sequence that is longer by a phase, or a leg; no phase repeats the one before."""
        leg, final = self._leg(node)
        found = [(*node, mode) for mode in leg.modes if node[-1:] != (mode,)]
        if not final and (closed := self._closed(node)) is not None:
            found.append(self._begun((*closed, ())))
        return found

    def leaf(self, node: ModeSequence) -> ModeSequence | None:
        """The sequence whose plans are counted at a node: the node, or closed by a rigid phase.

        None at a node that is itself another one closed, or has legs to come.
        """
        return self._closed(node) if self._leg(node)[1] else None

    def _leg(self, node: ModeSequence) -> tuple[Leg, bool]:
        """The leg that a node is in, and whether it is the last one."""
        number = node.count(())
        return self.legs[number], number == len(self.legs) - 1

    def _closed(self, node: ModeSequence) -> ModeSequence | None:
        (leg, final), head = self._leg(node), parts(node)[-1]
        drives = leg.last == self.rigid and self.rigid in leg.modes
        opening = drives and head == (self.rigid,) and node == self._begun(node[:-1])
        if leg.last is None or (final and not drives) or opening:
            return node
        return None if head[-1:] == (leg.last,) else (*node, leg.last)

    def _choices(self, sequences: Sequence[ModeSequence]) -> list[Choices]:
        """What must still melt in each leg, after these phases of the first ones."""
        found, soft = list[Choices](), [now == 1 for now in self.first]
        none = [()] * (len(self.legs) - len(sequences))
        for leg, phases in zip(self.legs, [*sequences, *none], strict=True):
            had = {j for j in self.segments if soft[j] or any(mode[j] for mode in phases)}
            left = tuple(either - had for either in leg.melts)
            found.append(NOTHING if frozenset() in left else left)
            ends = leg.last or (phases[-1] if phases else soft)
            soft = [now == 1 for now in ends]
        return found

    def node_bound(self, node: ModeSequence) -> float:
        """Lower bound on every plan whose sequence begins with these phases [s]."""
        sequences = parts(node)
        over, choices = len(sequences) - 1, self._choices(sequences)
        if any(each != NOTHING for each in choices[:over]):
            return math.inf
        phases, least = joined(node), list[float]()
        lasting = [s for k, own in enumerate(sequences) for s in self._drives(k, own, k < over)]
        for melts in itertools.product(*choices[over:]):
            stops, pending = list[Stop](), frozenset[int]()
            for k, (leg, own) in enumerate(zip(self.legs[over:], melts, strict=True)):
                pending |= own
                drive_s = leg.drive_s if k and leg.modes == (self.rigid,) else 0.0
                if leg.last is not None or leg is self.legs[-1]:
                    stops.append(Stop(leg.last, pending, drive_s))
                    pending = frozenset()
            network = self.events.network(phases, lasting, stops)
            least.append(self.events.cost(network))
        return min(least)

    def _drives(self, number: int, phases: ModeSequence, over: bool) -> list[arb]:
        """Least durations of the phases of a leg, by what it comes where it only drives."""
        leg, none = self.legs[number], [arb(0)] * len(phases)
        alone = phases == (self.rigid,) and (over or leg.modes == (self.rigid,))
        return [arb(leg.drive_s)] if alone else none

    # Bends: section 2.

    def leaf_bound(self, sequence: ModeSequence, prices: Prices | None = None) -> float:
        """Lower bound on every plan of exactly these phases [s]; inf if there is none."""
        if (leaf := self.timed(sequence)) is None:
            return math.inf
        bound = self.events.cost(leaf.network)
        if prices is None or leaf.network.refused:
            return bound
        return max(bound, self._priced(sequence, leaf, prices))

    def timed(self, sequence: ModeSequence) -> Leaf | None:
        """Least durations of the phases of a leaf, and its events; None if there is no plan."""
        sequences, least, here = parts(sequence), list[Least](), list(self.origin)
        if any(each != NOTHING for each in self._choices(sequences)):
            return None
        for number, (phases, ends) in enumerate(zip(sequences, self.ends, strict=True)):
            change = [end - w for end, w in zip(ends, here, strict=True)]
            if self._kept(phases, change) or (own := self._least(phases, here, change)) is None:
                return None
            drives = self._drives(number, phases, over=True)
            least += [
                Least(one.time.max(s), one.effort) for one, s in zip(own, drives, strict=True)
            ]
            soft = [any(mode[j] for mode in phases) for j in self.segments]
            here = [b if s else a for a, b, s in zip(here, ends, soft, strict=True)]
        times, end = [one.time for one in least], [Stop(self.legs[-1].last)]
        return Leaf(least, self.events.network(joined(sequence), times, end))

    def sums(self, sequence: ModeSequence) -> list[list[arb]]:
        """Changes of W since t = 0 after each phase, segment by segment, within limits and ends."""
        room = [between(-r - w, r - w) for r, w in zip(self.room, self.origin, strict=True)]
        found = list[list[arb]]()
        for phases, ends in zip(parts(sequence), self.ends, strict=True):
            change = [end - w for end, w in zip(ends, self.origin, strict=True)]
            for later in (phases[i + 1 :] for i in range(len(phases))):
                bends = [any(mode[j] for mode in later) for j in self.segments]
                found.append([room[j] if bends[j] else change[j] for j in self.segments])
        return found

    def _priced(self, leaf: ModeSequence, timed: Leaf, prices: Prices) -> float:
        """Dual bound: proved by prices of all changes of W and all differences of event times."""
        sequence, network = joined(leaf), timed.network
        efforts = [one.effort for one in timed.least]
        rows = len(prices.edges), len(prices.slopes), [len(row) for row in prices.bends]
        if rows != (len(network.edges), len(sequence), [len(self.segments)] * len(sequence)):
            raise InputError("certificate.priced", rows, "prices of each edge, phase and W")
        need, drawn = arb(0), [arb(0)] * len(sequence)  # price of the bend of each phase
        for i, (priced, sums) in enumerate(zip(prices.bends, self.sums(leaf), strict=True)):
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
        for i, (slope, effort) in enumerate(zip(prices.slopes, efforts, strict=True)):
            worth = arb(slope) * self.problem.cost_weights.effort
            value += 2 * worth * (effort / slope).sqrt() if slope else arb(0)
            if drawn[i] != 0:
                worth += abs(drawn[i]) * self.fastest(sequence, i)
            count(("end", i, 0, 0), -worth)
            count(("start", i, 0, 0), worth)
        short = sum((-rest.min(arb(0)) for e, rest in left.items() if e != ORIGIN), arb(0))
        return max(0.0, low(value / (1 + short)))

    def fastest(self, sequence: ModeSequence, phase: int) -> arb:
        """Largest abs(dW/dt) in a soft phase, whatever shapes the segments may have there."""
        mode, before, after = sequence[phase], sequence[:phase], sequence[phase + 1 :]
        known: list[arb | None] = [None for _ in self.segments]
        for j, start in enumerate(self.origin):
            if not any(m[j] for m in (*before, mode)):
                known[j] = start
            elif not any(m[j] for m in (mode, *after)):
                known[j] = self.ends[-1][j]
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
                most = most.max(self.fibre.rate_of_w(mode, kappa)[0]).upper()
            self._fastest[key] = most
        return self._fastest[key]

    def _kept(self, phases: ModeSequence, change: Sequence[arb]) -> bool:
        """True if sums of W with weights -1, 0, 1 must change which these modes cannot change."""
        soft = {mode for mode in phases if any(mode)}
        for kept in itertools.product((-1, 0, 1), repeat=len(self.first)):
            idle = all(sum(c * s for c, s in zip(kept, mode, strict=True)) == 0 for mode in soft)
            moved = sum((c * w for c, w in zip(kept, change, strict=True)), arb(0))
            if idle and not moved.contains(0):
                return True
        return False

    def _bends(self, phases: ModeSequence, change: Sequence[arb]) -> list[arb] | None:
        """Change of W in each phase; None where the soft modes leave a choice."""
        soft = [i for i, mode in enumerate(phases) if any(mode)]
        if not soft:
            return [arb(0)] * len(phases)
        incidence = fmpq_mat([list(phases[i]) for i in soft])
        gram = incidence * incidence.transpose()
        if gram.rank() < len(soft):
            return None
        inverse, bends = gram.inv() * incidence, [arb(0)] * len(phases)
        for row, i in enumerate(soft):
            bends[i] = sum((arb(inverse[row, j]) * change[j] for j in self.segments), arb(0))
        return bends

    def _least(
        self, phases: ModeSequence, here: Sequence[arb], change: Sequence[arb]
    ) -> list[Least] | None:
        """Least durations of the phases of a leg whose bends are known; None if one is forbidden.

        ``here`` has the W of every segment where it begins.
        """
        bends, least = self._bends(phases, change), list[Least]()
        if bends is None:
            return [NO_TIME] * len(phases)
        for mode, bend in zip(phases, bends, strict=True):
            one = self.fibre.least(mode, here, bend) if any(mode) else NO_TIME
            here = [w + bend if soft else w for w, soft in zip(here, mode, strict=True)]
            beyond = any(abs(w) > room for w, room in zip(here, self.room, strict=True))
            if one is None or beyond:
                return None
            least.append(one)
        return least


def parts(node: ModeSequence) -> list[ModeSequence]:
    """The phases of each leg of a node."""
    found: list[ModeSequence] = [()]
    for mode in node:
        if mode:
            found[-1] = (*found[-1], mode)
        else:
            found.append(())
    return found


def joined(node: ModeSequence) -> ModeSequence:
    """All phases of a node."""
    return tuple(filter(None, node))


def check(problem: Problem, certificate: dict[str, Any]) -> Proof:
    """Work out what a certificate proves of a problem.

    Raises:
        InputError: If it is no certificate, or the problem is of a kind that has none.
    """
    (opened, prices), found = _read(certificate), list[Bounded]()
    unused = opened | prices.keys()
    for checker in map(Checker, in_any_order(problem)):
        nodes = [(0.0, checker.root())]
        while nodes:
            least, node = nodes.pop()
            least = max(least, checker.node_bound(node))
            if node not in opened:
                found.append(Bounded(node, False, least))
                continue
            nodes += [(least, child) for child in checker.children(node)]
            if (sequence := checker.leaf(node)) is not None:
                bound = checker.leaf_bound(sequence, prices.get(sequence))
                found.append(Bounded(sequence, True, max(least, bound)))
            unused -= {node, sequence}
    if unused:
        allowed = "sequences of the tree, each with all that it begins with"
        raise InputError("certificate.opened", next(iter(unused)), allowed)
    return Proof(tuple(found), problem.replay_tolerance, len(problem.stages))


def _read(certificate: dict[str, Any]) -> tuple[set[ModeSequence], dict[ModeSequence, Prices]]:
    """The sequences that are opened, and the prices of leaves."""
    try:
        opened = {_sequence(modes) for modes in certificate["opened"]}
        prices = {
            _sequence(leaf["sequence"]): Prices(
                [[float(price) for price in row] for row in leaf["bends"]],
                [max(0.0, float(price)) for price in leaf["edges"]],
                [max(0.0, float(slope)) for slope in leaf["slopes"]],
            )
            for leaf in certificate.get("priced", ())
        }
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        allowed = "opened: a list of mode sequences; priced: a list of leaves with their prices"
        raise InputError("certificate", repr(error), allowed) from None
    return opened, prices


def _sequence(modes: Any) -> ModeSequence:
    return tuple(tuple(int(soft) for soft in mode) for mode in modes)
