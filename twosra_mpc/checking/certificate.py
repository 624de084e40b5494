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

from twosra_mpc.checking.events import ORIGIN, Event, Events, Network
from twosra_mpc.checking.fibre import NOTHING, Fibre, Least, between, low
from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import BEYOND_PER_M, GOAL_TOLERANCE, forgiven
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


class Bounded(NamedTuple):
    """Least cost of the plans of a sequence, or of all that begin with it."""

    sequence: ModeSequence
    leaf: bool
    bound: float


@dataclass(frozen=True)
class Proof:
    """Proof of a certificate: the least of ``parts`` bounds every plan of the problem [s].

    Parts are bounds of plans that keep everything exactly.
    """

    parts: tuple[Bounded, ...]
    replay_tolerance: float = 0.0

    @property
    def bound(self) -> float:
        """Proved lower bound on the cost of every verified plan, of any number of phases [s]."""
        least = min((part.bound for part in self.parts), default=math.inf)
        return forgiven(least, self.replay_tolerance)


class Checker:
    """Lower bounds on sets of plans of one problem."""

    def __init__(self, problem: Problem) -> None:
        if any(task.rests for task in problem.tasks):
            raise InputError("tasks", "a mission", "a problem with one goal: others have no proof")
        self.problem, self.events, self.fibre = problem, Events(problem), Fibre(problem.robot)
        self.first, self.last = problem.start_stiffness, problem.goal.mode
        self.rigid, self.segments = rigid_mode(len(self.first)), range(len(self.first))
        start = problem.start.configuration
        limit = problem.robot.limits.curvature_per_m + BEYOND_PER_M
        lower, upper = (end.tolist()[POSE:] for end in problem.goal.box(start))
        self.origin = [self.fibre.coordinate(j, k) for j, k in enumerate(start.tolist()[POSE:])]
        self.room = [self.fibre.coordinate(j, limit) for j in self.segments]
        self.limit, self.change, self._fastest = arb(limit), list[arb](), dict[Any, arb]()
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

    def node_bound(self, node: ModeSequence) -> float:
        """Lower bound on every plan whose sequence begins with these phases [s]."""
        melted = [self.first[j] or any(mode[j] for mode in node) for j in self.segments]
        missing = [j for j in self.segments if not melted[j] and not self.change[j].contains(0)]
        return self.events.cost(self.events.network(node, [arb(0)] * len(node), missing))

    # Bends: section 2.

    def leaf_bound(self, sequence: ModeSequence, prices: Prices | None = None) -> float:
        """Lower bound on every plan of exactly these phases [s]; inf if there is none."""
        if self._kept(sequence):
            return math.inf
        least = self.least(sequence)
        if least is None:
            return math.inf
        network = self.events.network(sequence, [one.time for one in least])
        bound = self.events.cost(network)
        if prices is None or network.refused:
            return bound
        efforts = [one.effort for one in least]
        return max(bound, self._priced(sequence, network, prices, efforts))

    def sums(self, sequence: ModeSequence) -> list[list[arb]]:
        """Changes of W after each phase, segment by segment, within limits and goal."""
        room = [between(-r - w, r - w) for r, w in zip(self.room, self.origin, strict=True)]
        later = [sequence[i + 1 :] for i in range(len(sequence))]
        return [
            [room[j] if any(m[j] for m in rest) else self.change[j] for j in self.segments]
            for rest in later
        ]

    def _priced(
        self, sequence: ModeSequence, network: Network, prices: Prices, efforts: Sequence[arb]
    ) -> float:
        """Dual bound: proved by prices of all changes of W and all differences of event times."""
        rows = len(prices.edges), len(prices.slopes), [len(row) for row in prices.bends]
        if rows != (len(network.edges), len(sequence), [len(self.segments)] * len(sequence)):
            raise InputError("certificate.priced", rows, "prices of each edge, phase and W")
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
                most = most.max(self.fibre.rate_of_w(mode, kappa)[0]).upper()
            self._fastest[key] = most
        return self._fastest[key]

    def _kept(self, sequence: ModeSequence) -> bool:
        """True if sums of W with weights -1, 0, 1 must change which these modes cannot change."""
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

    def least(self, sequence: ModeSequence) -> list[Least] | None:
        """Least durations of phases whose bends are known; None if one is forbidden."""
        bends, here, least = self._bends(sequence), list(self.origin), list[Least]()
        if bends is None:
            return [NOTHING] * len(sequence)
        for mode, bend in zip(sequence, bends, strict=True):
            one = self.fibre.least(mode, here, bend) if any(mode) else NOTHING
            here = [w + bend if soft else w for w, soft in zip(here, mode, strict=True)]
            beyond = any(abs(w) > room for w, room in zip(here, self.room, strict=True))
            if one is None or beyond:
                return None
            least.append(one)
        return least


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
    return Proof(tuple(parts), problem.replay_tolerance)


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
