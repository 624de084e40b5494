"""Stages placed among obstacles and objects: where to reshape, grasp and put down, and the ways."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Sequence
from functools import partial

import numpy as np

from twosra_mpc.effort import Cost, charge, out_of_effort
from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import Motion, joined, roll_out, twists
from twosra_mpc.planning.bounds.schedule import hidden_by_phase_s
from twosra_mpc.planning.bounds.sequence_bound import SequenceBound
from twosra_mpc.planning.search.nodes import Whole
from twosra_mpc.planning.solver.fixed_sequence import INTERVALS, Candidate, timed
from twosra_mpc.planning.solver.guess import correct_end
from twosra_mpc.planning.solver.itinerary import Itinerary
from twosra_mpc.planning.solver.sequence_solver import Solved, checked, shapes, stage_bends, turning
from twosra_mpc.planning.solver.turning_drive import there, turned
from twosra_mpc.planning.stages.along import Along
from twosra_mpc.planning.stages.necessity import necessities
from twosra_mpc.planning.stages.variants import Placement, Variant, goals_of
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.limits import broken_by_shapes, may_drive_in
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import ModeSequence, blocks_of, is_rigid, soft_runs
from twosra_mpc.space.drives import Drives
from twosra_mpc.space.footprint import footprint
from twosra_mpc.space.screws import Bools
from twosra_mpc.timing import TemporalNetwork

Made = tuple[float, Solved] | None  # (cost, plan), or nothing that verifies
Bends = Sequence[Array]  # change of W in each phase of each stage

_SHARES = ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))  # of the units' travel: fastest first
_STEP_PER_M, _STEPS = 15.0, 5  # between shapes that are tried on the way
_MOST_WAYS, _MOST_SHAPES = 5000, 24
_ENOUGH, _ENOUGH_OF_ALL = 2, 8  # plans of several blocks in a stage: of a sequence, of all
_MOST_MEMBERS = 8  # of a variant, that are tried
_SAME_PER_M, _ASKED_PER_M = 1.0, 1e-3
_STILL = 1e-9  # m, rad or change of W
_LEAST_BEND = 1e-3  # change of W that is more than rounding


class OneWay(Drives):
    """The one drive of a stage that follows a path, among the drives of the shape it has."""

    def __init__(self, among: Drives, along: Along) -> None:
        self.__dict__ |= vars(among)
        self._along = along

    def leg_times_s(self, start: Array, end: Array) -> Array:
        """Its time, from wherever it begins."""
        shape = np.broadcast_shapes(start.shape, end.shape)[:-1]
        return np.full(shape, self._along.lasts_s)

    def time_s(self, poses: Array) -> float:
        """Its time [s]."""
        del poses
        return self._along.lasts_s

    def best(self, start: Array, goal: Array) -> Array | None:
        """Its poses, if they keep clear."""
        poses = self._along.poses
        return poses if self.proof(start, goal)(poses[:-1], poses[1:]).all() else None

    def apart(self, start: Array, goal: Array) -> Bools:
        """Nothing is known."""
        return np.zeros((len(start), len(goal)), dtype=bool)


class Placer:
    """Yields plans of one sequence of each stage among obstacles.

    Soft phases without driving in between are blocks. Their bends are those of the bound; a stage
    of several blocks takes other shapes on the way. Of a variant's members the first that has a
    plan counts.

    Args:
        variants: The ways to solve the problem.
    """

    iterations = 0

    def __init__(self, variants: Sequence[Variant]) -> None:
        self.variants = variants
        self._several, self._planned = 0, False  # plans of several blocks, any plan
        self.in_the_way = [necessities(each) for each in variants]
        self._drives: dict[tuple[int, bytes, bytes], Drives] = {}

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound, whole: Whole
    ) -> Iterator[Made]:
        """Yield (cost, plan) of every attempt; None: it failed."""
        variant, blocks = self.variants[whole.variant], [*map(blocks_of, whole.sequences)]
        several, hidden_s = max(blocks) > 1, hidden_by_phase_s(network)
        placed = False
        for shares in _SHARES[: 1 if several or not any(blocks) else None]:
            if placed and len(blocks) > 1:  # of several stages the fastest travel that has a plan
                return
            for stages in variant.easy[:_MOST_MEMBERS]:
                for goals in goals_of(stages):
                    found = 0
                    for bends in self._ways(variant.problem, stages, goals, whole, bound):
                        enough = several and (found == _ENOUGH or self._several == _ENOUGH_OF_ALL)
                        if enough or out_of_effort():
                            return
                        itinerary = Itinerary(
                            variant.problem, stages, whole.sequences, bends, shares, self._drives_of
                        )
                        some = False
                        for made in self._attempts(itinerary, network, hidden_s):
                            some |= made is not None
                            impossible = not some and self._proved_impossible(whole)
                            yield made
                            if impossible:
                                return
                        found += some
                        placed |= some
                        self._several += several and some
                    if found:
                        break

    def _attempts(
        self, itinerary: Itinerary, network: TemporalNetwork, hidden_s: Sequence[float]
    ) -> Iterator[Made]:
        """The plan of the best chain; where no plan is known yet, first that of the first one."""
        best, last = None, dict[int, Array]()
        first: Made = None
        for _, last in itinerary.chains(hidden_s) if itinerary.possible else ():
            best = last
            if not self._planned and (first := self._made(itinerary, best, network)):
                self._planned, best = True, None
                yield first
        if best is not None or first is None:
            first = None if best is None else self._made(itinerary, best, network)
            yield first
        for made in turning(first, partial(self._candidate, itinerary, last, network)):
            self.iterations += made[1].candidate.iterations
            yield made

    def _made(
        self, itinerary: Itinerary, routes: dict[int, Array], network: TemporalNetwork
    ) -> Made:
        candidate = self._candidate(itinerary, routes, network)
        return checked(itinerary.problem, candidate, network)

    def _candidate(
        self,
        itinerary: Itinerary,
        routes: dict[int, Array],
        network: TemporalNetwork,
        turns: Collection[int] = (),
        most: int = 0,
    ) -> Candidate | None:
        """The motion of a chain on the clock; ends of goals are met exactly; some drives turn."""
        problem, inputs = itinerary.problem, _inputs(network.sequence, itinerary, routes)
        q = problem.start.configuration
        corrected, first, iterations = list[Motion](), 0, 0
        for stage, sequence in zip(itinerary.stages, itinerary.sequences, strict=True):
            found = stage.along.begun_at(q) if stage.along is not None else None
            if found is None:
                motion = roll_out(problem.robot, q, sequence, inputs[first : first + len(sequence)])
                found = correct_end(motion, stage.goal) if stage.reaches else motion
                if found is None:
                    return None
                own = [i - first for i in turns if first <= i < first + len(sequence)]
                goal = stage.goal if stage.reaches else there(found.end)
                found, count = turned(found, goal, own, most, partial(self._clear, stage))
                iterations += count
            corrected.append(found)
            q, first = found.end, first + len(sequence)
        ends = tuple(itertools.accumulate(map(len, itinerary.sequences)))
        return timed(joined(corrected), network, problem, iterations, ends)

    def _clear(self, stage: Placement, phase: int, q: Array) -> bool:
        """True if the screws between configurations (m, 3 + n) of a drive are clear."""
        proof = self._drives_of(stage, q[0, POSE:]).proof(q[0, :POSE], q[-1, :POSE])
        return bool(proof(q[:-1, :POSE], q[1:, :POSE]).all())

    def _proved_impossible(self, whole: Whole) -> bool:
        """True if obstacles are proved to forbid a sequence, as far as is known or found now."""
        pairs = zip(self.in_the_way[whole.variant], whole.sequences, strict=True)
        return any(stage.proves_impossible(sequence) for stage, sequence in pairs)

    def _drives_of(self, stage: Placement, shape: Array) -> Drives:
        """Drives of a stage in a shape (n,), worked out once."""
        key = id(stage.world), stage.held.tobytes(), shape.round(9).tobytes()
        if key not in self._drives:
            robot = self.variants[0].problem.robot
            self._drives[key] = Drives(
                robot, stage.world, shape, held=stage.held, may=stage.may, sagitta_m=stage.sagitta_m
            )
        return self._drives[key] if stage.along is None else OneWay(self._drives[key], stage.along)

    def _ways(
        self,
        problem: Problem,
        stages: Sequence[Placement],
        goals: Sequence[GoalSet],
        whole: Whole,
        bound: SequenceBound,
    ) -> Iterator[Bends]:
        """Ways to bend: as the bound does, or, in several blocks, by other shapes between them."""
        direct = stage_bends(problem, goals, whole.sequences, bound.bends)
        ends = shapes(problem, whole.sequences, direct)
        if not _as_asked(problem, stages, goals, direct, ends):
            return
        starts = [problem.start.configuration[POSE:], *ends]
        choices = [
            _other_ways(problem.robot, start, sequence, bends)
            if blocks_of(sequence) > 1
            else [bends]
            for start, sequence, bends in zip(starts, whole.sequences, direct, strict=False)
        ]
        yield from itertools.islice(itertools.product(*choices), _MOST_SHAPES)


def _other_ways(robot: Robot, start: Array, sequence: ModeSequence, direct: Array) -> list[Array]:
    """Bends that end as the direct ones do, by shapes in which the robot is slim."""
    facts, runs = bending(robot), soft_runs(sequence)
    step, free = facts.coordinate(_STEP_PER_M), _null_space(sequence)
    origin, modes = facts.coordinates(start), np.array(sequence, dtype=float)
    found = []
    ways = itertools.product(range(-_STEPS, _STEPS + 1), repeat=len(free))
    for counts in itertools.islice(ways, _MOST_WAYS):
        charge(Cost.SHAPE)
        bends = direct + step * np.array(counts) @ free
        passed = origin + np.cumsum(modes * bends[:, None], axis=0)
        shapes = np.array([facts.curvatures(w.tolist()) for w in passed])
        stops = np.vstack([start, shapes[[run[-1] for run in runs]]])
        changed = np.abs(np.diff(stops, axis=0)).max(axis=1).min() > _SAME_PER_M
        if (
            changed
            and broken_by_shapes(robot, shapes) is None
            and may_drive_in(robot, stops[1:-1]).all()
        ):
            width_m = max(_width_m(robot, shape) for shape in stops[1:-1])
            found.append((width_m, float(np.abs(bends).sum()), bends))
    found.sort(key=lambda each: each[:2])
    return [bends for *_, bends in found[:_MOST_SHAPES]]


def _width_m(robot: Robot, kappa: Array) -> float:
    """Least width of the robot in a shape, to a centimetre: what passes best is tried first."""
    corners = footprint(robot.geometry, kappa).outer.reshape(-1, 2)
    angles = np.linspace(0.0, np.pi, 60)
    along = corners @ np.array([np.cos(angles), np.sin(angles)])
    return round(float(np.ptp(along, axis=0).min()), 2)


def _inputs(sequence: ModeSequence, itinerary: Itinerary, routes: dict[int, Array]) -> Array:
    """Input displacements of every phase, (phases, intervals, 5): a leg takes an interval."""
    legs = {phase: twists(route[:-1], route[1:]) for phase, route in routes.items()}
    legs = {phase: by[np.abs(by).max(axis=1) > _STILL] for phase, by in legs.items()}
    inputs = np.zeros((len(sequence), max(INTERVALS, *map(len, legs.values()), 0), 5))
    for phase, soft in itinerary.inputs.items():
        inputs[phase, :INTERVALS] = soft
    for phase, by in legs.items():
        inputs[phase, : len(by), 2:] = by
    return inputs


def _as_asked(
    problem: Problem,
    stages: Sequence[Placement],
    goals: Sequence[GoalSet],
    bends: Bends,
    found: Array,
) -> bool:
    """True if every stage ends in a shape of its goal, and bends if it must."""
    for stage, goal, bend, shape in zip(stages, goals, bends, found, strict=True):
        low, high = goal.box(problem.start.configuration)
        off = np.maximum(low[POSE:] - shape, shape - high[POSE:])
        rests = np.abs(bend).max(initial=0.0) < _LEAST_BEND
        if off.max() > _ASKED_PER_M or (stage.reshapes and rests):
            return False
    return True


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
                independent = np.linalg.matrix_rank([*found, vector]) > len(found)
                if independent and not (incidence @ vector).any():
                    found.append(vector)
    return np.array(found).reshape(-1, len(sequence))
