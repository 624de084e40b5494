"""Planning for what is not known: which plan is best, if joint bends may end elsewhere.

Segments that are soft together share a bend as the fibre likes, and the wheels decide one number:
where several have to be right at its end (`relies`), it may miss, and the rest is planned again,
with melts and freezes in series. A policy is a plan with that recourse, and its price.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twosra_mpc.effort import Ending, OutOfEffortError, spent
from twosra_mpc.errors import InputError
from twosra_mpc.model.bending import bending
from twosra_mpc.planning.confirmed_bound import Sequences, bent_before, least_costs_s
from twosra_mpc.planning.planner import Progress, searched
from twosra_mpc.plans.branches import Branch, Policy, priced
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.limits import bent_back
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.accuracy import ACCEPTED
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.joint_bends import JointBend, evened
from twosra_mpc.robot.modes import Mode, ModeSequence, last_bent, soft_segments


def relies(modes: Sequence[Mode]) -> bool:
    """True if several segments have to be right at the end of the same joint bend."""
    return any(len(last_bent(modes[k:])) > 1 for k in range(len(modes)))


_ALIKE = 6  # decimals of 1/m

RELYING = Sequences(relies)
RELYING_OR_ALONE = Sequences(lambda modes: relies(modes) or bent_before(modes) is None)


def plan_policy(
    problem: Problem, on_progress: Callable[[Progress], None] | None = None, worth_s: float = 0.0
) -> Result:
    """Plan with recourse: the best by ``problem.risk`` of three plans, with its policy.

    One is the plan of a robot whose joint bends end where they are planned. The others rely on
    none: the best one, and the best that bends segments together, which may be right by chance.

    Args:
        problem: The problem.
        on_progress: Called as the first search proceeds.
        worth_s: What is better by no more than that is not looked for; nor, unless it is 0, are
            bounds of the cost of policies.
    """
    first = searched(problem, on_progress=on_progress, worth_s=worth_s)
    if first.plan is None or not first.found or first.ending is Ending.INTERRUPTED:
        return first
    result = first
    try:
        for made, policy in _better_and_better(first.plan, worth_s):
            result = _with_policy(first, made, policy)
    except KeyboardInterrupt:
        return replace(first, ending=Ending.INTERRUPTED)
    except OutOfEffortError:
        result = replace(result, ending=Ending.LIMIT)
    return replace(result, stats=replace(first.stats, work=spent()))


def _with_policy(first: Result, made: Plan, policy: Policy) -> Result:
    if not np.isfinite(policy.mean_s):
        words = f"{made}; no plan of the rest is found where a joint bend misses"
        return replace(first, words=words)
    words = f"{made}; {policy.words}"
    return replace(first, plan=made, status=made.status, words=words, policy=policy)


def _better_and_better(plan: Plan, worth_s: float) -> Iterator[tuple[Plan, Policy]]:
    """Plans that need no joint bend, then the plan, which counts them as certain; if better.

    At last the best of them again, with the bounds of its policy.
    """
    known, problem, found = plan, plan.problem, list[tuple[Plan, Policy]]()
    bends = problem.robot.joint_bends

    def priced_so(made: Plan) -> Iterator[tuple[Plan, Policy]]:
        most_s = found[-1][1].cost_s if found else math.inf
        if (policy := _policy(made, bends, most_s, worth_s)) is not None:
            found.append((made, policy))
            yield found[-1]

    for excluded in (RELYING, RELYING_OR_ALONE) * any(surprise(plan, each) for each in bends):
        if known.sequence not in excluded:  # it is the best of the others, too
            continue
        if (other := _found(problem, excluded, worth_s)) is None:
            break
        known = replace(other, lower_bound=plan.lower_bound)
        yield from priced_so(known)
    yield from priced_so(plan)  # last: it needs plans of rests
    if not worth_s:
        made, policy = found[-1]
        least_s, known_s = least_costs_s(problem, bends, policy.cost_s)
        yield made, policy._replace(lower_bound=least_s, known_bound=known_s)


def _found(problem: Problem, excluded: Container[ModeSequence], worth_s: float) -> Plan | None:
    """The best plan, if any is found.

    Raises:
        KeyboardInterrupt: At Ctrl-C.
        OutOfEffortError: If there is no effort left to look for one.
    """
    found = searched(problem, excluded=excluded, worth_s=worth_s)
    if found.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    if found.stopped_early and not found.found:
        raise OutOfEffortError
    return found.plan if found.found else None


def _known_s(plan: Plan) -> float:
    """Duration of a run of it."""
    return plan.duration_s if plan.confirmed_s is None else plan.confirmed_s


def _policy(plan: Plan, bends: Sequence[JointBend], most_s: float, worth_s: float) -> Policy | None:
    """The plan with what is done wherever a joint bend misses, or is right by chance.

    None as soon as it is known to cost more than ``most_s``.
    """
    share, planned_s, risk = 1 / len(bends), _known_s(plan), plan.problem.risk
    found = dict[tuple[int, ModeSequence], list[tuple[JointBend, float, float]]]()
    rests = dict[object, Plan | None]()  # of bends that end alike
    surprises = [surprise(plan, bend) for bend in bends]
    costs = [planned_s if new is None else _least_s(plan, new.phase) for new in surprises]
    for k, (bend, new) in enumerate(zip(bends, surprises, strict=True)):
        if new is not None:
            ended = new.phase, *new.kappa.round(_ALIKE).tolist()
            if ended not in rests:
                rests[ended] = _rest(plan, new.phase, new.kappa, worth_s)
            rest = rests[ended]
            other_s = plan.known_end_s(new.phase) + (np.inf if rest is None else _known_s(rest))
            costs[k] = min(other_s, planned_s) if new.right else other_s
            if costs[k] == other_s:
                same = found.setdefault((new.phase + 1, () if rest is None else rest.sequence), [])
                same.append((bend, new.off_per_m, other_s))
        if (cost_s := priced(((share, each) for each in costs), risk)) > most_s:
            return None
    branches = []
    for (phase, modes), same in sorted(found.items()):
        own, off_per_m, each_s = zip(*same, strict=True)
        shown = _how(own), min(off_per_m), modes, float(np.mean(each_s))
        branches.append(Branch(share * len(same), phase, *shown))
    return Policy(risk, cost_s, planned_s, tuple(branches))


def _how(bends: Sequence[JointBend]) -> str:
    """Joint bends in words; splits that go with the same losses are told together."""
    losses, splits = dict[float, list[str]](), dict[str, list[str]]()
    for bend in bends:
        losses.setdefault(bend.split, []).append(f"{100 * bend.relaxation:z.0f}")
    for split, lost in losses.items():
        splits.setdefault(" or ".join(lost), []).append(f"{100 * split:+z.0f}")
    each = (f"{' or '.join(own)} % and evens out by {lost} %" for lost, own in splits.items())
    return f"splits by {', or by '.join(each)}"


class Surprise(NamedTuple):
    """A joint bend after which the rest is another one than planned.

    Attributes:
        phase: The bend (from 0).
        kappa: Curvatures then, (n,) [1/m].
        off_per_m: How far the worst is off the goal.
        right: Whether all are right by chance, where more bends were planned; else they miss.
    """

    phase: int
    kappa: Array
    off_per_m: float
    right: bool


def surprise(plan: Plan, bend: JointBend) -> Surprise | None:
    """The first joint bend that misses the goal, or is right by chance; None: all goes as planned.

    Wheels bring the mean of the segments that bend for the last time to where it is planned, and
    one that is soft alone; where others bend again, that of all to the goal if it is right then.

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
            here[soft] = evened(bend, here[soft])
        bent = np.zeros_like(here)
        bent[soft] = 1 + bend.split * (-1.0) ** np.arange(len(soft))
        relied = len(last) > 1
        aims, aim = (last, planned[k + 1]) if relied else (soft, planned[-1])
        at = here + bent * (aim - here)[aims].mean() / bent[aims].mean()
        kappa, at_end = np.array(facts.curvatures(at.tolist())), ends[-1].copy()
        at_end[POSE:][last if relied else slice(None)] = kappa[last if relied else slice(None)]
        off = accuracy.of_shape(goal.error(at_end))
        if relied and off > ACCEPTED:
            return Surprise(k, kappa, off * accuracy.curvature_per_m, right=False)
        if not relied and off <= ACCEPTED and any(map(any, modes[k + 1 :])):
            low, high = plan.problem.goal.box(ends[-1])
            within = np.clip(kappa, low[POSE:], high[POSE:])
            return Surprise(k, within, off * accuracy.curvature_per_m, right=True)
        here += bent * (planned[k + 1] - here)[last or soft].mean() / bent[last or soft].mean()
        away = here - planned[k + 1]
    return None


def _least_s(plan: Plan, phase: int) -> float:
    """Least time of a run in which the rest is planned again after a phase.

    What is soft has to freeze, also where nothing was to melt any more.
    """
    later = plan.phases[phase + 1 :]
    frozen_s = _known_s(plan) - sum(each.end_s - each.start_s for each in later)
    return plan.known_end_s(phase) if any(any(each.mode) for each in later) else frozen_s


def _rest(plan: Plan, phase: int, kappa: Array, worth_s: float) -> Plan | None:
    """The plan of what is left after a joint bend that has ended at these curvatures, if any."""
    try:
        left = plan.rest_at(plan.phases[phase].end_s)
        bent = tuple(bent_back(plan.robot, kappa).tolist())
        start = left.start.with_values(kappa_per_m=bent)
        return _found(left.with_values(start=start), RELYING, worth_s)
    except InputError:  # it would be where it must not
        return None
