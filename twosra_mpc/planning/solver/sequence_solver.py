"""Plans of one sequence of each stage where nothing is in the way: guess first, then the NLP."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from twosra_mpc.effort import out_of_effort
from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import Motion, joined
from twosra_mpc.planning.bounds.schedule import feasible_schedule, hidden_by_phase_s
from twosra_mpc.planning.bounds.sequence_bound import SequenceBound
from twosra_mpc.planning.search.nodes import Whole
from twosra_mpc.planning.solver.fixed_sequence import (
    INTERVALS,
    Candidate,
    cost_s,
    scheduled,
    solve,
    timed,
    verified,
)
from twosra_mpc.planning.solver.gentle import cheapest
from twosra_mpc.planning.solver.guess import (
    bends_around,
    clipped_w,
    correct_end,
    guess_motion,
    inner_bends,
    moved_inside,
)
from twosra_mpc.planning.solver.turning_drive import turned
from twosra_mpc.planning.stages.variants import Variant
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.ends import may_drive
from twosra_mpc.problem.goals import GoalSet, inner_goal
from twosra_mpc.problem.limits import levers_kept
from twosra_mpc.problem.problem import Alone, Problem, Start
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence, is_rigid
from twosra_mpc.timing import TemporalNetwork

_WIDE_PER_M = 1e-3  # around shapes that are chosen for several stages
# In runs NLPs that might gain 3.4, 3.8 and 5.1 s took 0.3 to 0.7 s and gained 0.5, 0 and 0 s.
_NLP_WORTH = 3.0
_DRIVES = 4  # that turn, for the same ends: on either side, either way round


@dataclass(frozen=True, eq=False)
class Solved:
    """Parts of a plan.

    Attributes:
        problem: The problem.
        candidate: Its motion and schedule.
        network: The temporal network of its sequence.
        fastest_cost: What it cost before it was made gentle [s].
        plan: The plan, once it is made; its verification says whether it is one.
    """

    problem: Problem
    candidate: Candidate
    network: TemporalNetwork
    fastest_cost: float = math.inf
    plan: Plan | None = None

    def with_plan(self) -> Solved:
        """The same with its plan, sampled and verified."""
        if self.plan is not None:
            return self
        made = self.problem, self.candidate, self.network
        return replace(self, plan=verified(*made, fastest_cost=self.fastest_cost))

    @property
    def verifies(self) -> bool:
        """True if its plan was made and verifies."""
        return self.plan is not None and self.plan.verification.ok

    @cached_property
    def cost(self) -> float:
        """Cost of its plan [s]."""
        return cost_s(self.problem, self.candidate, self.network)


Guessed = tuple[Motion, tuple[float, Solved] | None]  # a guess, and the plan that it is
Check = Callable[
    [Problem, Candidate | None, TemporalNetwork], tuple[float, Solved] | None
]  # makes (cost, plan) of a candidate, or None


class SequenceSolver:
    """Yields plans of one sequence of each stage where nothing is in the way."""

    in_the_way = None

    def __init__(
        self, variants: Sequence[Variant], guessed: Check | None = None, worth_s: float = 0.0
    ) -> None:
        self.variants, self._checked, self._worth_s = variants, guessed or checked, worth_s
        self._of_a_goal: dict[int, GoalSolver] = {}
        self.iterations = 0  # of the nonlinear programs so far

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound, whole: Whole
    ) -> Iterator[tuple[float, Solved] | None]:
        """Yield (cost, plan) of every attempt; None: it failed."""
        variant = self.variants[whole.variant]
        if len(whole.sequences) > 1:
            make = partial(stage_by_stage, variant, network, bound, whole)
            first = self._checked(variant.problem, make(), network)
            yield first
            for made in turning(first, make):
                self.iterations += made[1].candidate.iterations
                yield made
            return
        if whole.variant not in self._of_a_goal:
            self._of_a_goal[whole.variant] = GoalSolver(variant, self._checked, self._worth_s)
        solver = self._of_a_goal[whole.variant]
        for solved in solver(network, bound):
            self.iterations += solver.iterations
            solver.iterations = 0
            yield solved


class GoalSolver:
    """Yields plans of one mode sequence: the guess and, if it is not enough, the NLP's.

    Those of the NLP are verified, and guesses unless they are to be ``trusted``. Where it cannot
    gain `_NLP_WORTH` times ``worth_s`` it is left out.
    """

    def __init__(
        self, variant: Variant, guessed: Check | None = None, worth_s: float = 0.0
    ) -> None:
        ((stage,),) = variant.members
        self.problem = problem = variant.reaching(stage)
        self._asked, self._guessed_plan = variant.problem, guessed or checked
        self._least_s = _NLP_WORTH * worth_s
        start = problem.start.configuration
        boxes = problem.goal.box(start), problem.inner_goal.box(start)
        here, *ends = clipped_w(problem, start, *itertools.chain(*boxes))
        self._box, self._aim = np.reshape(ends - here, (2, 2, -1))  # changes of W, low and high
        least = np.clip(0.0, *self._box)
        self._nearest = np.array([least, least])  # where a margin does not fit, bending less may
        self.iterations = 0

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound
    ) -> Iterator[tuple[float, Solved] | None]:
        """Yield (cost, plan) of every attempt, each dearer than the one before; None: it failed."""
        problem, (direct, (guess, first)) = self.problem, self._cheapest_guess(network, bound)
        yield first
        at_once = np.zeros(network.layout.phases)
        if first is None and feasible_schedule(network, at_once, problem) is None:
            return  # no motion changes that
        if bound.detour or not levers_kept(
            problem.robot, network.sequence, direct.states[:, :, POSE:]
        ):
            return  # a nonlinear program, which knows of no levers, would bend straight on
        if first is not None and first[0] - bound.cost < self._least_s:
            return
        yield from self._turned(first, network)
        bends = any(map(any, network.sequence))  # else all there is to do is to drive
        if (bends or first is None) and not out_of_effort():
            candidate = solve(guess, network, problem)
            self.iterations += candidate.iterations if candidate else 0
            yield (made := checked(self._asked, candidate, network))
            yield from self._turned(made, network)

    def _turned(
        self, first: tuple[float, Solved] | None, network: TemporalNetwork
    ) -> Iterator[tuple[float, Solved]]:
        def make(turns: Collection[int], most: int) -> Candidate | None:
            assert first is not None, "else nothing is made anew"
            motion, goal = first[1].candidate.motion, self.problem.goal
            motion, count = turned(motion, goal, turns, most, lambda *_: True)
            self.iterations += count
            return timed(motion, network, self.problem, count)

        yield from turning(first, make)

    def _cheapest_guess(
        self, network: TemporalNetwork, bound: SequenceBound
    ) -> tuple[Motion, Guessed]:
        """The first guess; and the first that is a plan or, if beyond the gap, the cheapest."""
        problem, sequence = self.problem, network.sequence
        inside = inner_bends(sequence, bound.bends, self._box, self._aim)
        usable = may_drive(problem, sequence)
        drives = [i for i, mode in enumerate(sequence) if is_rigid(mode) and usable[i]]
        drive = drives[0] if drives else None
        tried = [self._guessed(network, inside, drive)]
        if tried[0][1] is None:
            nearest = inner_bends(sequence, bound.bends, self._box, self._nearest)
            tried += [
                self._guessed(network, bends, drive)
                for bends in (bound.bends, nearest)
                if bends is not None and not np.array_equal(bends, inside)
            ]
        best = min(tried, key=_cost)
        cost = _cost(best)
        if math.isinf(cost) or cost - bound.cost <= problem.gap * cost:
            return tried[0][0], best
        others = drives[1:] if np.array_equal(inside, bound.bends) else drives
        more = [self._guess(network, bound.bends, other) for other in others]  # to the goal's edge
        guess, candidate = min(more, key=lambda each: _end_s(each[1]), default=(best[0], None))
        if _end_s(candidate) >= _end_s(best[1] and best[1][1].candidate):
            return tried[0][0], best
        other = guess, self._guessed_plan(self._asked, candidate, network)
        return tried[0][0], min(best, other, key=_cost)

    def _guessed(self, network: TemporalNetwork, bends: Array, drive: int | None) -> Guessed:
        """The guess that bends as told and drives in one phase, and the plan that it is."""
        guess, candidate = self._guess(network, bends, drive)
        return guess, self._guessed_plan(self._asked, candidate, network)

    def _guess(
        self, network: TemporalNetwork, bends: Array, drive: int | None
    ) -> tuple[Motion, Candidate | None]:
        problem, sequence = self.problem, network.sequence
        start, goal = problem.start.configuration, problem.goal
        usable = [i == drive for i in range(len(sequence))]
        made = guess_motion(problem.robot, start, goal, sequence, bends, INTERVALS, usable)
        guess = moved_inside(made, problem)
        return guess, scheduled(guess, network, problem, iterations=0)


def _end_s(candidate: Candidate | None) -> float:
    return float(candidate.times.max()) if candidate else math.inf


def _cost(guessed: Guessed) -> float:
    return guessed[1][0] if guessed[1] else math.inf


def checked(
    problem: Problem, candidate: Candidate | None, network: TemporalNetwork
) -> tuple[float, Solved] | None:
    """(cost, plan) of a candidate at its durations of least cost; None if it does not verify."""
    if (found := trusted(problem, candidate, network)) is None:
        return None
    made = found[1].with_plan()
    return (made.cost, made) if made.verifies else None


def trusted(
    problem: Problem, candidate: Candidate | None, network: TemporalNetwork
) -> tuple[float, Solved] | None:
    """As ``checked``, but to be verified by whoever uses the plan."""
    if candidate is None:
        return None
    found = Solved(problem, cheapest(problem, candidate, network), network)
    return found.cost, found


def turning(
    first: tuple[float, Solved] | None, make: Callable[[Collection[int], int], Candidate | None]
) -> Iterator[tuple[float, Solved]]:
    """Yield plans whose drives turn on the way, if they gain the gap on one that was found.

    Args:
        first: Cost and plan.
        make: Makes it anew with these of its drives turning, the quickest of so many.
    """
    if first is None:
        return
    (cost, found), hidden_s = first, hidden_by_phase_s(first[1].network)
    motion, limits = found.candidate.motion, found.problem.robot.limits
    far = np.abs(motion.states[:, -1] - motion.states[:, 0])
    straight_s = np.hypot(*far[:, :2].T) / (limits.speed_m_s or math.inf)
    least_s = np.maximum(straight_s, far[:, 2] / (limits.turn_rate_rad_s or math.inf))
    lasts_s = np.array([profile.duration_s for profile in found.candidate.profiles])
    longer_s = lasts_s - np.maximum(least_s, hidden_s)
    free = np.array([*map(is_rigid, motion.sequence)]) & ~motion.lasting_s.any(axis=1)
    drives, gained = np.flatnonzero(free & (longer_s > 0)), found.problem.gap * cost
    for most in (1, _DRIVES) if longer_s[drives].sum() > gained else ():
        if out_of_effort():
            return
        made = checked(found.problem, make(drives.tolist(), most), found.network)
        if made is not None:
            if made[0] >= cost - gained:
                return
            yield made


def stage_by_stage(
    variant: Variant,
    network: TemporalNetwork,
    bound: SequenceBound,
    whole: Whole,
    turns: Collection[int] = (),
    most: int = 0,
) -> Candidate | None:
    """One sequence of each stage, each of them as it is guessed alone; some drives turn.

    A nonlinear program for each stage finds nothing better: what it could gain, waiting hides.
    """
    problem, goals = variant.problem, [stage.goal for stage in variant.members[0]]
    bends = stage_bends(problem, goals, whole.sequences, bound.bends)
    ends = shapes(problem, whole.sequences, bends)
    q, motions, iterations = problem.start.configuration, list[Motion](), 0
    for goal, sequence, bend, shape in zip(goals, whole.sequences, bends, ends, strict=True):
        motion = _motion(problem, q, goal.shaped(shape, _WIDE_PER_M), sequence, bend)
        if motion is None:
            return None
        first = sum(len(motion.sequence) for motion in motions)
        own = [i - first for i in turns if first <= i < first + len(sequence)]
        motion, count = turned(motion, goal, own, most, lambda *_: True)
        iterations += count
        motions.append(motion)
        q = motion.end
    stage_ends = tuple(itertools.accumulate(len(motion.sequence) for motion in motions))
    return timed(joined(motions), network, problem, iterations, stage_ends)


def _motion(
    problem: Problem, q: Array, goal: GoalSet, sequence: ModeSequence, bends: Array
) -> Motion | None:
    """A stage from a configuration to its goal; None if it does not get there."""
    x_m, y_m, phi_rad, *kappa_per_m = q.tolist()
    start = Start(x_m=x_m, y_m=y_m, phi_rad=phi_rad, kappa_per_m=tuple(kappa_per_m))
    alone = Alone(problem.robot, start, goal, problem.workspace)
    rests = not bends.any() and goal.met_at(q)
    usable = [False] * len(sequence) if rests else may_drive(alone, sequence)
    made = guess_motion(alone.robot, q, goal, sequence, bends, INTERVALS, usable)
    if not levers_kept(alone.robot, sequence, made.states[:, :, POSE:]):
        detour = bends_around(alone, sequence, bends)
        if detour is None:
            return None
        made = guess_motion(alone.robot, q, goal, sequence, detour, INTERVALS, usable)
    return correct_end(moved_inside(made, alone), goal)


Box = tuple[Array, Array]


def stage_bends(
    problem: Problem, goals: Sequence[GoalSet], sequences: Sequence[ModeSequence], relaxed: Array
) -> list[Array]:
    """Change of W in each phase of each stage.

    Args:
        problem: The problem.
        goals: What each stage ends in.
        sequences: Its modes.
        relaxed: Change of W in each phase of all, (phases,), by the relaxation.
    """
    here = bending(problem.robot).coordinates(problem.start.kappa_per_m)
    parts = np.split(relaxed, np.cumsum([len(each) for each in sequences])[:-1])
    found = []
    start, inner_goals = problem.start.configuration, [inner_goal(problem.robot, g) for g in goals]
    boxes = ([clipped_w(problem, *goal.box(start)) for goal in of] for of in (goals, inner_goals))
    kept = (_kept_boxes(each, sequences) for each in boxes)
    for sequence, bends, outer, inner in zip(sequences, parts, *kept, strict=True):
        inner = inner if (inner[0] <= inner[1]).all() else outer
        box = np.array(outer) - here
        chosen = inner_bends(sequence, _into(sequence, bends, box), box, np.array(inner) - here)
        found.append(chosen)
        here = here + np.array(sequence, dtype=float).T @ chosen
    return found


def _into(sequence: ModeSequence, bends: Array, box: Array) -> Array:
    """The nearest bends that end in a box, (2, n), as a stage may begin a bit aside."""
    incidence = np.array(sequence, dtype=float).T
    reached = incidence @ bends
    step, *_ = np.linalg.lstsq(incidence, np.clip(reached, *box) - reached, rcond=1e-12)
    return bends + step


def shapes(problem: Problem, sequences: Sequence[ModeSequence], bends: Sequence[Array]) -> Array:
    """Curvatures where each stage ends, (stages, n) [1/m]."""
    facts = bending(problem.robot)
    here = facts.coordinates(problem.start.kappa_per_m)
    found = []
    for sequence, each in zip(sequences, bends, strict=True):
        here = here + np.array(sequence, dtype=float).T @ each
        found.append(facts.curvatures(here.tolist()))
    return np.array(found)


def _kept_boxes(boxes: Sequence[Array], sequences: Sequence[ModeSequence]) -> Iterator[Box]:
    """What each stage may end in so that segments that then stay rigid suit what follows."""
    for k, (low, high) in enumerate(boxes):
        rigid = np.ones(len(low), dtype=bool)
        least, most = low.copy(), high.copy()
        for sequence, (later_low, later_high) in zip(
            sequences[k + 1 :], boxes[k + 1 :], strict=True
        ):
            rigid &= ~np.array(sequence, dtype=bool).any(axis=0)
            least = np.where(rigid, np.maximum(least, later_low), least)
            most = np.where(rigid, np.minimum(most, later_high), most)
        yield least, most
