"""Other plans than the one that is explained, found by planning again, and what they cost more.

All are compared at full speed: gentle plans all cost as much as the gap allows. Of a goal: the next
best mode sequence, the plan without a mode, with one heater. Among obstacles, where each takes
longer to plan: the next best mode sequence, and the plan that keeps 5 mm more clearance. Of tasks:
other orders.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from twosra_mpc import InputError, Mode, Plan, Problem, Result, Task
from twosra_mpc.checking.sweep import stiffness
from twosra_mpc.checking.verification import verify
from twosra_mpc.effort import Ending
from twosra_mpc.planning.planner import plan_until_interrupted
from twosra_mpc.plans.branches import Policy
from twosra_mpc.problem.limits import BEND_LEVER
from twosra_mpc.problem.tasks import orders
from twosra_mpc.robot.modes import ModeSequence, merged, mode_name

FARTHER_M = 0.005  # how much more clearance is asked for
MOST_ORDERS = 5  # other orders of tasks that are planned

_ROUNDS = 8  # how often a sequence that only adds unused phases is set aside
_BETTER = "cheaper than the plan that was to be explained: found among the alternatives"
_SAME_S = 1e-5  # events closer than this are one

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Alternative:
    """Another plan, and what it costs more.

    Attributes:
        change: What is different, e.g. "without mode [1,0]".
        details: What exactly was changed, or what the other plan does; may be empty.
        original: The plan that is explained, at full speed.
        result: Of planning the changed problem; None if the change makes no valid problem.
        expected_s: Cost of the policy that is explained, with which that of the other is compared.
    """

    change: str
    details: str
    original: Plan
    result: Result | None
    expected_s: float | None = None

    @property
    def plan(self) -> Plan | None:
        """The other plan, if there is one."""
        return None if self.result is None else self.result.plan

    @property
    def difference_s(self) -> float | None:
        """Cost less that of the original [s]; None without a plan."""
        return None if self.cost_s is None else self.cost_s - self.compared_s

    @property
    def cost_s(self) -> float | None:
        """Cost of the other plan, or of its policy where that is compared [s]; None without."""
        if self.result is None or self.result.plan is None:
            return None
        if self.expected_s is None:
            return self.result.plan.cost.total
        return None if self.result.policy is None else self.result.policy.cost_s

    @property
    def compared_s(self) -> float:
        """Cost that it is compared with [s]."""
        return self.original.cost.total if self.expected_s is None else self.expected_s

    @property
    def difference(self) -> float | None:
        """``difference_s`` relative to the cost of the original."""
        if self.difference_s is None or not self.compared_s:
            return None
        return self.difference_s / self.compared_s

    @property
    def outcome(self) -> str:
        """Outcome in words."""
        if self.result is None:
            return self.details
        return f"{self.result.message} ({self.details})" if self.details else self.result.message

    @property
    def price(self) -> str:
        """``difference_s`` and ``difference`` in words; empty where there is no plan."""
        more_s = self.difference_s
        if more_s is None:
            return ""
        if more_s < -_SAME_S:
            asked = self.plan and (self.plan.robot, self.plan.problem.goal)
            easier = asked != (self.original.robot, self.original.problem.goal)
            return f"{-more_s:z.2f} s less{'' if easier else ': this plan is not the best'}"
        percent = 100 * (self.difference or 0.0)
        digits = 1 if abs(percent) >= 1 else 3
        return f"{more_s:+z.2f} s ({percent:+z.{digits}f} %)"

    def __str__(self) -> str:
        return ": ".join(filter(None, [self.change, self.price, self.outcome]))


def alternatives(
    made: Plan, other_orders: Sequence[tuple[Task, ...]], tell: Tell
) -> Iterator[Alternative]:
    """Plan one alternative after the other.

    Args:
        made: The plan.
        other_orders: Of its tasks, those to be planned.
        tell: Told what is planned next.

    Raises:
        KeyboardInterrupt: At Ctrl-C, where the planner does not return what it has.
    """
    problem = made.problem
    if problem.drives_gently or problem.order != "given":
        problem = problem.with_values(motion="fastest", order="given")
    if problem.tasks:
        yield from _of_tasks(made, problem, other_orders, tell)
        return
    original = _at_full_speed(made, problem, tell)
    tell("the next best mode sequence")
    yield next_best(original)
    for change, values in _changes(original):
        tell(change)
        yield _changed(change, values, original)
    robot, change = original.robot, f"without the limit {BEND_LEVER.name}"
    if robot.limits.bend_lever is not None and not problem.obstacles:
        tell(change)
        bold = robot.with_values(limits=robot.limits.with_values(bend_lever=None))
        found = plan_until_interrupted(original.problem.with_values(robot=bold))
        other = Alternative(change, "wheels would have to bend and hold", original, found)
        if found.ending is Ending.INTERRUPTED or (other.difference_s or 0.0) < -_SAME_S:
            yield other


def of_policy(result: Result, policy: Policy, tell: Tell) -> Iterator[Alternative]:
    """Plan one alternative to a policy after the other; their policies are compared.

    Args:
        result: Of planning.
        policy: Its policy.
        tell: Told what is planned next.
    """
    made = result.require()
    problem = made.problem
    measured = problem.robot.with_values(uncertainty=None)
    easier: dict[str, dict[str, object]] = {
        "with goal tolerances twice as wide": {
            "goal": problem.goal.loosened(problem.goal.half_width)
        },
        "with a robot measured to share its joint bends equally": {"robot": measured},
    }
    for change, values in (*easier.items(), *_changes(made)):
        tell(change)
        yield _changed(change, values, made, policy.cost_s)


def _changed(
    change: str, values: dict[str, object], original: Plan, expected_s: float | None = None
) -> Alternative:
    """Plan the problem with other values."""
    try:
        found = plan_until_interrupted(original.problem.with_values(**values))
        return Alternative(change, "", original, found, expected_s)
    except InputError as error:
        return Alternative(change, f"no such problem: {error}", original, None, expected_s)


def orders_not_planned(made: Plan) -> list[tuple[Task, ...]]:
    """Orders of the tasks that may be exchanged, other than the plan's; none without tasks."""
    found = dict.fromkeys(orders(made.problem.tasks, made.problem.start.holding))
    return [order for order in found if order != made.problem.tasks]


def _of_tasks(
    made: Plan, problem: Problem, other_orders: Sequence[tuple[Task, ...]], tell: Tell
) -> Iterator[Alternative]:
    """The plan in other orders of its tasks."""
    if not other_orders:
        return
    original = _at_full_speed(made, problem, tell)
    for tasks in other_orders:
        begun = (t.said(i) for i, t in enumerate(tasks, start=1) if not t.needs_held)
        change = f"in the order {', '.join(begun)}"
        tell(change)
        yield _changed(change, {"tasks": tasks}, original)


def with_better(result: Result, others: Sequence[Alternative]) -> Result | None:
    """The result with the cheapest other plan that solves its problem for less; None: none does.

    Tasks may be done in the other plan's order.
    """
    made, solving = result.require(), list[Plan]()
    for other in others:
        if other.plan is not None and (other.difference_s or 0.0) < -_SAME_S:
            asked = made.problem.with_values(tasks=other.plan.problem.tasks)
            same = replace(other.plan.trajectory, problem=asked)
            if (checked := verify(same)).ok:
                proved = replace(other.plan, lower_bound=made.lower_bound)
                solving.append(replace(proved, trajectory=same, verification=checked))
    better = min(solving, key=lambda each: each.cost.total, default=None)
    if better is None:
        return None
    return replace(result, plan=better, status=better.status, words=f"{better}; {_BETTER}")


def _at_full_speed(made: Plan, problem: Problem, tell: Tell) -> Plan:
    """The plan itself if it costs no more than at full speed, or the best plan that is.

    Args:
        made: The plan.
        problem: What it solves, without gentleness.
        tell: Told what is planned.
    """
    if made.problem is problem:
        return made
    if made.slower_by == 0.0:
        return replace(made, trajectory=replace(made.trajectory, problem=problem))
    tell("the same at full speed")
    quickest = plan_until_interrupted(problem)
    if quickest.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return quickest.plan or made


def _changes(original: Plan) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield changes of the problem, in words and as values; among obstacles planning takes long."""
    problem = original.problem
    if problem.obstacles:
        change = f"with {1e3 * FARTHER_M:zg} mm more clearance"
        yield change, {"clearance_m": problem.clearance_m + FARTHER_M}
        return
    for mode in dict.fromkeys(moving_modes(original)):
        modes = tuple(other for other in problem.modes if other != mode)
        yield f"without mode {mode_name(mode)}", {"modes": modes}
    if problem.heaters_at_once > 1 and original.transitions:
        yield "with one heater at a time", {"heaters_at_once": 1}


def next_best(original: Plan) -> Alternative:
    """Plan with another mode sequence, one that differs in the phases in which something moves.

    Sequences whose further phases stay empty only melt and freeze for nothing; where only such are
    found, the cheapest of them is the answer.
    """
    excluded = _sequences(original)
    cheapest = found = plan_until_interrupted(original.problem, excluded=frozenset(excluded))
    for _ in range(1 if original.problem.obstacles else _ROUNDS):
        other = found.plan
        if other is None or found.ending is Ending.INTERRUPTED or _differ(other, original):
            break
        known = len(excluded)
        excluded |= _sequences(other)
        if len(excluded) == known:
            break
        found = plan_until_interrupted(original.problem, excluded=frozenset(excluded))
    if found.plan is not None and _differ(found.plan, original):
        return Alternative("with the next best mode sequence", "", original, found)
    details = ""
    if cheapest.found and cheapest.lower_bound is not None:
        details = f"melts more than it needs; none costs less than {cheapest.lower_bound:z.1f} s"
    return Alternative("with any other mode sequence", details, original, cheapest)


def _differ(one: Plan, other: Plan) -> bool:
    return moving_modes(one) != moving_modes(other)


def moving_modes(made: Plan) -> ModeSequence:
    """Modes of the phases in which something moves, none twice in a row."""
    return merged([each.mode for each in made.phases if each.end_s > each.start_s])


def _sequences(made: Plan) -> set[ModeSequence]:
    """The complete mode sequences of a plan: by its phases alone, and with those left empty."""
    problem = made.problem
    passed = [mode for mode in _passed_modes(made) if mode in problem.modes]
    return {complete_sequence(each, problem) for each in (moving_modes(made), merged(passed))}


def complete_sequence(modes: ModeSequence, problem: Problem) -> ModeSequence:
    """Add the rigid phases that open and close a sequence in the search."""
    rigid = problem.robot.rigid
    if rigid not in problem.modes:
        return modes
    opening = (rigid,) if problem.start_stiffness == rigid else ()
    closing = (rigid,) if problem.goal.mode == rigid else ()
    return merged((*opening, *modes, *closing))


def _passed_modes(made: Plan) -> list[Mode]:
    """Stiffness of the segments whenever none of them is changing, in order of time."""
    changes = made.transitions
    moments = {0.0, *(t.onset_s for t in changes), *(t.done_s for t in changes)}
    known = (stiffness(made.trajectory, now) for now in sorted(moments))
    return [tuple(soft for soft in mode if soft is not None) for mode in known if None not in mode]
