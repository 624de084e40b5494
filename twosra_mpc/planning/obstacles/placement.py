"""Mode sequences placed among obstacles: the solver that the search asks where there are some."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar

import numpy as np

from twosra_mpc.deadline import out_of_time
from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.planning.nlp.fixed_sequence import INTERVALS, Candidate, scheduled
from twosra_mpc.planning.nlp.guess import bend_changes, inner_bends, inner_goal
from twosra_mpc.planning.obstacles.block import Block, Shares, block, blocks_of, soft_runs
from twosra_mpc.planning.obstacles.itinerary import Itinerary
from twosra_mpc.planning.obstacles.necessity import Necessity
from twosra_mpc.planning.obstacles.stations import Chain
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.schedule import with_durations
from twosra_mpc.problem.limits import broken_by_shapes, may_drive_in
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence, is_rigid
from twosra_mpc.space.drives import Drives
from twosra_mpc.space.footprint import footprint
from twosra_mpc.space.screws import twists
from twosra_mpc.timing import TemporalNetwork, earliest_times

Solution = TypeVar("Solution")
Check = Callable[[Problem, Candidate | None, TemporalNetwork], tuple[float, Solution] | None]

_SHARES = ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))  # of the units' travel: fastest first
_STEP_PER_M, _STEPS = 15.0, 5  # between shapes that are tried on the way
_MOST_WAYS, _MOST_SHAPES = 5000, 24
_ENOUGH, _ENOUGH_OF_ALL = 2, 8  # plans of several blocks: of a sequence, of all
_SAME_PER_M = 1.0
_STILL = 1e-9  # m or rad
_LONG_S = 1e5


class Placer(Generic[Solution]):
    """Yields plans of one mode sequence among obstacles.

    Soft phases without driving in between are blocks. Their bends are those of the bound; a
    sequence of several blocks takes other shapes on the way.

    Args:
        problem: The problem.
        checked: Makes (cost, plan) of a candidate, or None if it does not verify.
    """

    def __init__(self, problem: Problem, checked: Check[Solution]) -> None:
        self.problem, self._checked = problem, checked
        self.iterations = self._several = 0
        self.necessity = Necessity(problem)
        self._drives: dict[bytes, Drives] = {}
        inner = inner_goal(problem.robot, problem.goal)
        self._box, self._aim = bend_changes(problem, problem.goal, inner)

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound
    ) -> Iterator[tuple[float, Solution] | None]:
        """Yield (cost, plan) of every attempt; None: it failed."""
        sequence, found = network.sequence, 0
        several = blocks_of(sequence) > 1
        hidden_s = _hidden_s(network)
        for bends, shares in self._bends_and_shares(sequence, bound):
            enough = several and (found == _ENOUGH or self._several == _ENOUGH_OF_ALL)
            if enough or out_of_time():
                return
            made = self._attempt(network, bends, shares, hidden_s)
            impossible = made is None and self.necessity.proves_impossible(sequence)
            yield made
            if impossible:
                return
            found += made is not None
            self._several += several and made is not None

    def _attempt(
        self,
        network: TemporalNetwork,
        bends: Array,
        shares: Shares,
        hidden_s: Sequence[float],
    ) -> tuple[float, Solution] | None:
        sequence = network.sequence
        blocks = self._blocks(sequence, bends, shares)
        chain = None if blocks is None else self._chain(sequence, blocks, hidden_s)
        if blocks is None or chain is None:
            return None
        motion = self._motion(sequence, blocks, chain)
        candidate = scheduled(motion, network, self.problem, iterations=0)
        return self._checked(self.problem, candidate, network)

    def drives(self, kappa: Array) -> Drives:
        """Drives in a shape (n,), worked out once."""
        key = kappa.round(9).tobytes()
        if key not in self._drives:
            self._drives[key] = Drives(self.problem.robot, self.problem.world, kappa)
        return self._drives[key]

    def _bends_and_shares(
        self, sequence: ModeSequence, bound: SequenceBound
    ) -> Iterator[tuple[Array, Shares]]:
        """Ways to bend: as the bound does, or, in several blocks, by other shapes between them."""
        direct = inner_bends(sequence, bound.bends, self._box, self._aim)
        if blocks_of(sequence) > 1:
            yield from ((bends, _SHARES[0]) for bends in self._other_ways(sequence, direct))
        else:
            yield from ((direct, shares) for shares in _SHARES[: 3 * blocks_of(sequence) or 1])

    def _other_ways(self, sequence: ModeSequence, direct: Array) -> list[Array]:
        """Bends that end as the direct ones do, by shapes in which the robot is slim."""
        facts, runs = bending(self.problem.robot), soft_runs(sequence)
        step, free = facts.coordinate(_STEP_PER_M), _null_space(sequence)
        start = self.problem.start.configuration[POSE:]
        origin, modes = facts.coordinates(start), np.array(sequence, dtype=float)
        found = []
        ways = itertools.product(range(-_STEPS, _STEPS + 1), repeat=len(free))
        for counts in itertools.islice(ways, _MOST_WAYS):
            bends = direct + step * np.array(counts) @ free
            passed = origin + np.cumsum(modes * bends[:, None], axis=0)
            shapes = np.array([facts.curvatures(w.tolist()) for w in passed])
            stops = np.vstack([start, shapes[[run[-1] for run in runs]]])
            changed = np.abs(np.diff(stops, axis=0)).max(axis=1).min() > _SAME_PER_M
            if changed and self._allowed(shapes, stops[1:-1]):
                width_m = max(map(self._width_m, stops[1:-1]))
                found.append((width_m, float(np.abs(bends).sum()), bends))
        found.sort(key=lambda each: each[:2])
        return [bends for *_, bends in found[:_MOST_SHAPES]]

    def _allowed(self, shapes: Array, driven_in: Array) -> bool:
        robot = self.problem.robot
        if broken_by_shapes(robot, shapes) is not None:
            return False
        return bool(may_drive_in(robot, driven_in).all())

    def _width_m(self, kappa: Array) -> float:
        """Least width of the robot in a shape, to a centimetre: what passes best is tried first."""
        corners = footprint(self.problem.robot.geometry, kappa).outer.reshape(-1, 2)
        angles = np.linspace(0.0, np.pi, 60)
        along = corners @ np.array([np.cos(angles), np.sin(angles)])
        return round(float(np.ptp(along, axis=0).min()), 2)

    def _blocks(self, sequence: ModeSequence, bends: Array, shares: Shares) -> list[Block] | None:
        """The blocks of a sequence; None if a shape on the way is not allowed."""
        robot, shape = self.problem.robot, self.problem.start.configuration[POSE:]
        blocks = []
        for run in soft_runs(sequence):
            made = block(robot, shape, [sequence[i] for i in run], bends[run].tolist(), shares)
            far = float(np.hypot(*made.displacement[:2])) > robot.limits.soft_travel_m
            if far or broken_by_shapes(robot, made.nodes[:, POSE:]) is not None:
                return None
            blocks.append(made)
            shape = made.shape
        return blocks

    def _chain(
        self, sequence: ModeSequence, blocks: Sequence[Block], hidden_s: Sequence[float]
    ) -> Chain | None:
        """Where to carry out the blocks, and when to pass the boxes: the best chain found."""
        shapes = [self.problem.start.configuration[POSE:], *(each.shape for each in blocks)]
        drives: list[Drives | None] = [self.drives(shape) for shape in shapes]
        if not is_rigid(sequence[0]):
            drives[0] = None
        if not is_rigid(sequence[-1]):
            drives[-1] = None
        itinerary = Itinerary(self.problem, blocks, drives, hidden_s)
        usable = [k for k, each in enumerate(drives) if each is not None]
        best: Chain | None = None
        for passed_in in itertools.combinations_with_replacement(usable, len(self.problem.passes)):
            found = itinerary.chain(passed_in)
            if found is not None and (best is None or found.cost_s < best.cost_s):
                best = found
            if best is not None and best.cost_s == 0.0:
                break
        return best

    def _motion(self, sequence: ModeSequence, blocks: Sequence[Block], chain: Chain) -> Motion:
        """The motion of a chain: a leg takes an interval."""
        legs = [twists(route[:-1], route[1:]) for route in chain.routes]
        routes = [each[np.abs(each).max(axis=1) > _STILL] for each in legs]
        intervals = max(INTERVALS, *map(len, routes))
        inputs = np.zeros((len(sequence), intervals, 5))
        drives = iter(routes if is_rigid(sequence[0]) else routes[1:])
        soft = iter(np.concatenate([each.inputs for each in blocks]) if blocks else ())
        for i, mode in enumerate(sequence):
            if is_rigid(mode):
                legs = next(drives)
                inputs[i, : len(legs), 2:] = legs
            else:
                inputs[i, :INTERVALS] = next(soft)
        return roll_out(self.problem.robot, self.problem.start.configuration, sequence, inputs)


def _null_space(sequence: ModeSequence) -> Array:
    """Bends that change no segment in the end, in steps of one phase, (dimensions, phases)."""
    incidence = np.array(sequence, dtype=float).T
    found: list[Array] = []
    for size in (2, 3, 4):
        soft = [i for i, mode in enumerate(sequence) if not is_rigid(mode)]
        for phases in itertools.combinations(soft, size):
            for signs in itertools.product((-1.0, 1.0), repeat=size - 1):
                vector = np.zeros(len(sequence))
                vector[list(phases)] = (1.0, *signs)
                if not (incidence @ vector).any() and _independent([*found, vector]):
                    found.append(vector)
    return np.array(found).reshape(-1, len(sequence))


def _independent(vectors: Sequence[Array]) -> bool:
    return bool(np.linalg.matrix_rank(np.array(vectors)) == len(vectors))


def hidden_by_phase_s(network: TemporalNetwork) -> list[float]:
    """How long each rigid phase may last without making the plan longer, alone; else 0 [s]."""

    def finish(durations: Sequence[float]) -> float:
        times = earliest_times(with_durations(network, durations))
        return math.inf if times is None else times[network.layout.finish]

    count = len(network.sequence)
    least = finish([0.0] * count)
    found = [0.0] * count
    for i, mode in enumerate(network.sequence):
        if is_rigid(mode):
            lasting = [_LONG_S if k == i else 0.0 for k in range(count)]
            found[i] = _LONG_S - (finish(lasting) - least)
    return found


def _hidden_s(network: TemporalNetwork) -> list[float]:
    """The same of the drives before, between and after blocks; 0 where there is none."""
    sequence = network.sequence
    of_phases = zip(sequence, hidden_by_phase_s(network), strict=True)
    found = [time_s for mode, time_s in of_phases if is_rigid(mode)]
    if not is_rigid(sequence[0]):
        found.insert(0, 0.0)
    if not is_rigid(sequence[-1]):
        found.append(0.0)
    return found
