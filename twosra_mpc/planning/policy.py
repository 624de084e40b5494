"""Planning for what is not known: which plan is best, if joint bends may end elsewhere.

Segments that are soft together share a bend as the fibre likes, and the wheels decide one number:
where several have to be right at its end (`relies`), it may miss, and the rest is planned again,
with melts and freezes in series. A policy is a plan with that recourse, and its price.

The least of any policy is an estimate: it is made of proved bounds of plans whose joint bends are
equal, and a split that by chance spares a bend before it undercuts those.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twosra_mpc.effort import Ending, OutOfEffortError, spent
from twosra_mpc.errors import InputError
from twosra_mpc.model.bending import bending
from twosra_mpc.planning.confirmed_bound import least_confirmed_s
from twosra_mpc.planning.planner import Progress, searched
from twosra_mpc.plans.branches import Branch, Policy, priced
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.limits import bent_back
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.accuracy import ACCEPTED
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.joint_bends import JointBend, Uncertainty
from twosra_mpc.robot.modes import Mode, ModeSequence, last_bent, soft_segments


@dataclass(frozen=True)
class Sequences:
    """All mode sequences of a kind."""

    kind: Callable[[Sequence[Mode]], bool]

    def __contains__(self, modes: object) -> bool:
        return isinstance(modes, tuple) and self.kind(modes)


def relies(modes: Sequence[Mode]) -> bool:
    """True if several segments have to be right at the end of the same joint bend."""
    return any(len(last_bent(modes[k:])) > 1 for k in range(len(modes)))


def at_once(modes: Sequence[Mode]) -> bool:
    """True if that is after a single melt of each: whoever misses must melt or freeze once more."""
    return any(
        len(last := last_bent(modes[k:])) > 1
        and all(sorted(own) == own for own in ([m[j] for m in modes[: k + 1]] for j in last))
        for k in range(len(modes))
    )


RELYING, AT_ONCE = Sequences(relies), Sequences(at_once)


def plan_policy(problem: Problem, on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Plan with recourse: the best by ``problem.risk`` of two plans, with its policy.

    One is the plan of a robot whose joint bends end where they are planned. The other relies on
    none: one segment after the other, or together and then one alone.

    Args:
        problem: The problem.
        on_progress: Called as the first search proceeds.
    """
    first = searched(problem, on_progress=on_progress)
    if first.plan is None or not first.found or first.ending is Ending.INTERRUPTED:
        return first
    try:
        made, policy = _best(first.plan)
    except KeyboardInterrupt:
        return replace(first, ending=Ending.INTERRUPTED)
    except OutOfEffortError:
        return replace(first, ending=Ending.LIMIT)
    stats = replace(first.stats, work=spent())
    if not np.isfinite(policy.mean_s):
        words = f"{made}; no plan of the rest is found where a joint bend misses"
        return replace(first, words=words, stats=stats)
    words = f"{made}; {policy.words[0]}"
    return replace(first, plan=made, status=made.status, words=words, policy=policy, stats=stats)


def _best(plan: Plan) -> tuple[Plan, Policy]:
    """The plan, which counts joint bends as certain, or one that needs none; with its policy."""
    problem, least_s = plan.problem, _bound_s(plan)
    bends = (problem.robot.uncertainty or Uncertainty()).joint_bends
    policy = _policy(plan, bends, least_s)
    if not policy.branches or (other := _relying_on_none(problem)) is None:
        return plan, policy
    chance, later_s = _chance(problem, bends), max(least_s, _bound_s(other, AT_ONCE))
    least_any_s = priced([(chance, least_s), (1 - chance, later_s)], problem.risk)
    surer = _policy(other, bends, least_any_s)
    if surer.cost_s < policy.cost_s:
        return replace(other, lower_bound=plan.lower_bound), surer
    return plan, policy._replace(least_s=least_any_s)


def _relying_on_none(problem: Problem) -> Plan | None:
    """The best plan that relies on no joint bend, if any is found.

    Raises:
        KeyboardInterrupt: At Ctrl-C.
        OutOfEffortError: If there is no effort left to look for one.
    """
    found = searched(problem, excluded=RELYING)
    if found.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    if found.stopped_early and not found.found:
        raise OutOfEffortError
    return found.plan if found.found else None


def _known_s(plan: Plan) -> float:
    """Duration of a run of it."""
    return plan.duration_s if plan.confirmed_s is None else plan.confirmed_s


def _bound_s(plan: Plan, excluded: Container[ModeSequence] = ()) -> float:
    """Lower bound on that of every plan, or of those that are not excluded."""
    if (known := least_confirmed_s(plan, excluded)) is not None:
        return known
    return 0.0 if excluded or plan.lower_bound is None else plan.lower_bound


def _policy(plan: Plan, bends: Sequence[JointBend], least_s: float) -> Policy:
    """The plan with what is done wherever a joint bend misses."""
    share, found = 1 / len(bends), list[Branch]()
    for bend in bends:
        if (missed := miss(plan, bend)) is not None:
            phase, kappa, off = missed
            rest = _rest(plan, phase, kappa)
            after_s = np.inf if rest is None else _known_s(rest)
            modes = () if rest is None else rest.sequence
            cost_s = plan.known_end_s(phase) + after_s
            found.append(Branch(share, phase + 1, off, modes, cost_s))
    found.sort(key=lambda each: (each.phase, each.sequence))
    branches = []
    for (phase, modes), group in itertools.groupby(found, key=lambda each: (each[1], each[3])):
        same = list(group)
        mean_s = float(np.mean([each.cost_s for each in same]))
        least = min(each.off_per_m for each in same)
        branches.append(Branch(share * len(same), phase, least, modes, mean_s))
    risk, planned_s = plan.problem.risk, _known_s(plan)
    went_well = 1 - share * len(found)
    costs = [(went_well, planned_s), *((share, each.cost_s) for each in found)]
    return Policy(risk, priced(costs, risk), least_s, planned_s, tuple(branches))


def miss(plan: Plan, bend: JointBend) -> tuple[int, Array, float] | None:
    """The first phase (from 0) at whose end a joint bend has missed the goal; None: none does.

    With the curvatures then, (n,), and how far the worst is off [1/m]. Wheels bring the mean of
    the segments that bend for the last time to where it is planned, and one that is soft alone.

    Args:
        plan: The plan.
        bend: How segments bend that are soft together.
    """
    facts, modes, accuracy = bending(plan.robot), plan.sequence, plan.robot.ends_within
    ends = plan.trajectory.configuration([0.0, *(phase.end_s for phase in plan.phases)])
    planned = facts.coordinates(ends[:, POSE:])
    away, goal = np.zeros(planned.shape[1]), plan.problem.judged_goal
    for k, mode in enumerate(modes):
        soft = list(soft_segments(mode))
        if len(soft) < 2:
            away[soft] = 0.0
            continue
        here, last = planned[k] + away, last_bent(modes[k:])
        if k == 0 or modes[k - 1] != mode:
            here[soft] += bend.relaxation * (here[soft].mean() - here[soft])
        bent = np.zeros_like(here)
        bent[soft] = 1 + bend.split * (-1.0) ** np.arange(len(soft))
        aims = last or soft
        here += bent * (planned[k + 1] - here)[aims].mean() / bent[aims].mean()
        away = here - planned[k + 1]
        if len(last) > 1:
            kappa, at_end = np.array(facts.curvatures(here.tolist())), ends[-1].copy()
            at_end[POSE:][last] = kappa[last]
            off = accuracy.of_shape(goal.error(at_end))
            if off > ACCEPTED:
                return k, kappa, off * accuracy.curvature_per_m
    return None


def _rest(plan: Plan, phase: int, kappa: Array) -> Plan | None:
    """The plan of what is left after a joint bend that has ended at these curvatures, if any."""
    try:
        left = plan.rest_at(plan.phases[phase].end_s)
        bent = tuple(bent_back(plan.robot, kappa).tolist())
        start = left.start.with_values(kappa_per_m=bent)
        return _relying_on_none(left.with_values(start=start))
    except InputError:  # it would be where it must not
        return None


def _chance(problem: Problem, bends: Sequence[JointBend]) -> float:
    """Largest probability with which a joint bend may be right after single melts, of any plan.

    Before it only one segment is bent, to a shape that is chosen without knowing how the joint
    bend goes: so the best any plan can do is the shape that suits the most of them.
    """
    if problem.robot.geometry.segments != 2:
        return 1.0
    facts, most = bending(problem.robot), problem.robot.limits.curvature_per_m
    accuracy = problem.robot.ends_within.scale(problem.robot.coordinates)
    box = problem.judged_goal.box(problem.start.configuration)
    ends = np.array([box[0] - accuracy, box[1] + accuracy])[:, POSE:]
    low, high = facts.coordinates(np.clip(ends, -most, most))
    here, best = facts.coordinates(problem.start.kappa_per_m), 0
    for first in (0, 1):
        spans = np.array([_suits(here, low, high, first, bend) for bend in bends])
        inside = (spans[:, :1] <= spans[:, 0]) & (spans[:, 0] <= spans[:, 1:])
        best = max(best, int(inside.sum(axis=0).max()))
    return best / len(bends)


def _suits(
    here: Array, low: Array, high: Array, first: int, bend: JointBend
) -> tuple[float, float]:
    """Interval of W of the segment bent first from which a joint bend ends in the box of W.

    With shares e = (1 + split, 1 - split) the bend keeps e2 W1 - e1 W2, whatever it is.
    """
    shares = np.array([1 - bend.split, -1 - bend.split])  # of W1 and W2 in what is kept
    least = shares @ [low[0], high[1]]
    largest = shares @ [high[0], low[1]]

    def kept(own: float) -> float:
        begin = here.copy()
        begin[first] = own
        begin += bend.relaxation * (begin.mean() - begin)
        return float(shares @ begin)

    at_zero, slope = kept(0.0), kept(1.0) - kept(0.0)
    if abs(slope) < 1e-9:
        return (-np.inf, np.inf) if least <= at_zero <= largest else (np.inf, -np.inf)
    ends = sorted(((least - at_zero) / slope, (largest - at_zero) / slope))
    return ends[0], ends[1]
