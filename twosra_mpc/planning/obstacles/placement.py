"""Mode sequences placed among obstacles: the solver that the search asks where there are some."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.planning.nlp.fixed_sequence import INTERVALS, scheduled
from twosra_mpc.planning.nlp.guess import bend_changes, inner_bends, inner_goal
from twosra_mpc.planning.obstacles.block import Block, Sweep, block, soft_runs
from twosra_mpc.planning.obstacles.necessity import Necessity
from twosra_mpc.planning.obstacles.stations import Chain, Stations, around, between, shortest_chain
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.schedule import with_durations
from twosra_mpc.planning.sequence_solver import Solved, checked
from twosra_mpc.problem.limits import broken_by_shapes, may_drive_in
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence, is_rigid
from twosra_mpc.space.drives import Drives
from twosra_mpc.space.footprint import footprint
from twosra_mpc.space.screws import composed, inverse, twists
from twosra_mpc.timing import TemporalNetwork, earliest_times

_SHARES = ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))  # of the units' travel: fastest first
_STEP_PER_M = 20.0  # between shapes that are tried on the way
_MOST_SHAPES = 60
_CANDIDATES, _REACH_M = 300, 0.4  # stations of a block, and how far from where it should be
_MOST_LOOKS = 60
_LONG_S = 1e5


class Placer:
    """Yields verified plans of one mode sequence among obstacles.

    Soft phases without driving in between are blocks. Their bends are those of the bound; a
    sequence of several blocks also takes other shapes on the way.
    """

    def __init__(self, problem: Problem, deadline: float = math.inf) -> None:
        self.problem, self.deadline = problem, deadline  # of time.perf_counter()
        self.iterations = 0
        self.necessity = Necessity(problem)
        self._drives: dict[bytes, Drives] = {}
        self._box = bend_changes(problem, problem.goal)
        self._aim = bend_changes(problem, inner_goal(problem))

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound
    ) -> Iterator[tuple[float, Solved] | None]:
        """Yield (cost, plan) of every attempt; None: it failed."""
        sequence = network.sequence
        hidden_s = _hidden_s(network)
        for bends in self._bends(sequence, bound):
            for shares in _SHARES:
                if time.perf_counter() > self.deadline:
                    return
                blocks = self._blocks(sequence, bends, shares)
                chain = None if blocks is None else self._chain(sequence, blocks, hidden_s)
                if blocks is None or chain is None:
                    self.necessity.work_out()
                    yield None
                    if self.necessity(sequence) is not None:
                        return
                    continue
                motion = self._motion(sequence, blocks, chain)
                candidate = scheduled(motion, network, self.problem, iterations=0)
                yield checked(self.problem, candidate, network)
                if not blocks:
                    return

    def drives(self, kappa: Array) -> Drives:
        """Drives in a shape (n,), worked out once."""
        key = kappa.round(9).tobytes()
        if key not in self._drives:
            self._drives[key] = Drives(self.problem.robot, self.problem.world, kappa)
        return self._drives[key]

    def _bends(self, sequence: ModeSequence, bound: SequenceBound) -> Iterator[Array]:
        """Bends of the phases: the bound's own, then with other shapes between blocks."""
        first = inner_bends(sequence, bound.bends, self._box, self._aim)
        yield first
        runs = soft_runs(sequence)
        if len(runs) < 2:
            return
        facts = bending(self.problem.robot)
        step = facts.coordinate(_STEP_PER_M)
        free = _null_space(sequence)
        origin = np.array(facts.coordinates(self.problem.start.configuration[POSE:].tolist()))
        modes = np.array(sequence, dtype=float)
        found = []
        steps = range(-4, 5)
        for counts in itertools.islice(itertools.product(steps, repeat=len(free)), 20_000):
            if not any(counts):
                continue
            bends = first + step * np.array(counts) @ free
            passed = origin + np.cumsum(modes * bends[:, None], axis=0)
            shapes = np.array([facts.curvatures(w.tolist()) for w in passed])
            if self._allowed(shapes, [run[-1] for run in runs[:-1]]):
                found.append(
                    (self._width_m(shapes[runs[0][-1]]), float(np.abs(bends).sum()), bends)
                )
        found.sort(key=lambda each: each[:2])
        yield from (bends for *_, bends in found[:_MOST_SHAPES])

    def _allowed(self, shapes: Array, between: Sequence[int]) -> bool:
        robot = self.problem.robot
        if broken_by_shapes(robot, shapes) is not None:
            return False
        return bool(may_drive_in(robot, shapes[list(between)]).all())

    def _width_m(self, kappa: Array) -> float:
        """Least width of the robot in a shape, to a centimetre: what passes best is tried first."""
        corners = footprint(self.problem.robot.geometry, kappa).outer.reshape(-1, 2)
        angles = np.linspace(0.0, np.pi, 60)
        along = corners @ np.array([np.cos(angles), np.sin(angles)])
        return round(float(np.ptp(along, axis=0).min()), 2)

    def _blocks(
        self, sequence: ModeSequence, bends: Array, shares: tuple[float, float]
    ) -> list[Block] | None:
        """The blocks of a sequence; None if a shape on the way is not allowed."""
        robot, shape = self.problem.robot, self.problem.start.configuration[POSE:]
        blocks = []
        for run in soft_runs(sequence):
            made = block(robot, shape, [sequence[i] for i in run], bends[run].tolist(), shares)
            if broken_by_shapes(robot, made.nodes[:, POSE:]) is not None:
                return None
            blocks.append(made)
            shape = made.shape
        return blocks

    def _chain(
        self, sequence: ModeSequence, blocks: Sequence[Block], hidden_s: Sequence[float]
    ) -> Chain | None:
        """Where to carry out the blocks: a first choice, then one nearer to the goal."""
        problem, start = self.problem, self.problem.start.configuration
        shapes = [start[POSE:], *(each.shape for each in blocks)]
        sweeps = [Sweep(each, problem.robot, problem.world) for each in blocks]
        opens, closes = is_rigid(sequence[0]), is_rigid(sequence[-1])
        used = [opens, *[True] * (len(blocks) - 1), closes][: len(shapes)]
        drivers = [
            self.drives(each) if use else None for each, use in zip(shapes, used, strict=True)
        ]
        goals = partial(self._goals, shape=shapes[-1])

        def chain_through(ends: Array) -> Chain | None:
            """The best chain whose last block ends at one of these poses."""
            begins = [around(start[:POSE], _CANDIDATES, _REACH_M) for _ in blocks]
            if blocks:
                begins[-1] = composed(ends, inverse(blocks[-1].displacement))
            if blocks and not opens:
                begins[0] = start[None, :POSE]
            layers = []
            for each, sweep, begin in zip(blocks, sweeps, begins, strict=True):
                clear = begin[sweep.may_be_clear(begin)]
                layers.append(Stations(clear, composed(clear, each.displacement)))
            return shortest_chain(
                start[:POSE],
                goals,
                layers,
                lambda k, pose: sweeps[k].clear(pose),
                drivers,
                hidden_s,
                _MOST_LOOKS,
            )

        goal = goals(start[None, :POSE])[0]
        found = chain_through(around(goal, _CANDIDATES, _REACH_M))
        if found is None or not blocks or found.cost_s == 0.0:
            return found
        end = composed(found.begins[-1], blocks[-1].displacement)
        nearer = chain_through(between(goals(end[None])[0], end, _CANDIDATES))
        return min(found, nearer or found, key=lambda each: each.cost_s)

    def _goals(self, poses: Array, shape: Array) -> Array:
        """Members of the goal to aim at from poses (m, 3) in a shape, (m, 3)."""
        goal = self.problem.goal
        return np.array([goal.aim(np.append(pose, shape))[:POSE] for pose in poses])

    def _motion(self, sequence: ModeSequence, blocks: Sequence[Block], chain: Chain) -> Motion:
        """The motion of a chain: a leg takes an interval."""
        routes = [twists(route[:-1], route[1:]) for route in chain.routes]
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


def _hidden_s(network: TemporalNetwork) -> list[float]:
    """How long each rigid phase may last without making the plan longer, alone [s]."""

    def finish(durations: Sequence[float]) -> float:
        times = earliest_times(with_durations(network, durations))
        return math.inf if times is None else times[network.layout.finish]

    count = len(network.sequence)
    least = finish([0.0] * count)
    found = []
    for i, mode in enumerate(network.sequence):
        if is_rigid(mode):
            lasting = [_LONG_S if k == i else 0.0 for k in range(count)]
            found.append(_LONG_S - (finish(lasting) - least))
    if not is_rigid(network.sequence[0]):
        found.insert(0, 0.0)
    if not is_rigid(network.sequence[-1]):
        found.append(0.0)
    return found
