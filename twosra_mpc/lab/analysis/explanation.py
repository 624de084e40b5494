"""``explain(problem)``: why a plan is what it is, and what other plans would cost.

Everything said of another plan comes from planning it (`analysis.alternatives`); what the duration
is made of, and what each task takes, is read off the plan itself. Among obstacles that comes with
what is proved of its reshaping.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from twosra_mpc import InputError, Plan, PlanInterrupted, Problem, Result
from twosra_mpc.arguments import public
from twosra_mpc.effort import Ending
from twosra_mpc.lab.analysis.alternatives import (
    MOST_ORDERS,
    Alternative,
    alternatives,
    complete_sequence,
    moving_modes,
    of_policy,
    orders_not_planned,
    with_better,
)
from twosra_mpc.lab.analysis.critical_path import (
    Activity,
    Hidden,
    critical_path,
    hidden_activities,
    in_words,
)
from twosra_mpc.planning.bounds.bends import unreachable_reason
from twosra_mpc.planning.planner import plan_until_interrupted
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.planning.stages.necessity import Necessity
from twosra_mpc.plans.trajectory import stretches
from twosra_mpc.problem.tasks import grasps
from twosra_mpc.robot.modes import mode_name, named
from twosra_mpc.timing import transition_model
from twosra_mpc.validation import ArrayValue, Count

_ROUNDS = 8  # how often a cheaper alternative becomes the plan that is explained
_SAME_S = 1e-5  # events closer than this are one
_HELD = {
    "caged": "caged: proved, it cannot leave",
    "pushed": "pushed: held only while contact is kept",
}


@dataclass(frozen=True)
class TaskCost:
    """Cost of a task of a plan.

    Attributes:
        words: What is done, e.g. "grasp cup".
        from_s: When the task before was done [s].
        done_s: When this one is [s].
        melted: Segments (from 1) whose melts end in that time.
        bends: Whether the robot bends in that time.
        energy_J: Heat of all heaters in that time.
        shape_of: The task whose shape serves this one too, or "the start"; None where the robot
            bends, and where a task asks for no shape (to pass, and to carry).
        held: How an object is held until then; empty where none is.
    """

    words: str
    from_s: float
    done_s: float
    melted: tuple[int, ...]
    bends: bool
    energy_J: float
    shape_of: str | None
    held: str

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.done_s - self.from_s

    @property
    def shares(self) -> str:
        """Segments that it melts, or why it need not, in words."""
        if self.melted:
            return f"melts {named('segment', self.melted, len(self.melted) + 1)}"
        if self.bends:
            return "bends what is soft already: no melt of its own"
        if self.shape_of is not None:
            return f"in the shape of {self.shape_of}: no melt of its own"
        return "no melt"


@public
@dataclass(frozen=True, eq=False, repr=False)
class Explanation(ArrayValue):
    """Reasons for a plan, and its alternatives.

    Attributes:
        result: What is explained: the plan, or that there is none.
        why: Reasons, in sentences.
        critical_path: Activities that add up to the duration.
        hidden: Activities that cost no time of their own.
        tasks: What each task costs; none of a single goal.
        alternatives: Other plans, as far as they are known.
        orders_left: How many more orders of tasks there are.
        complete: Whether all alternatives were planned; Ctrl-C ends that.
    """

    result: Result
    why: tuple[str, ...]
    critical_path: tuple[Activity, ...]
    hidden: tuple[Hidden, ...]
    tasks: tuple[TaskCost, ...]
    alternatives: tuple[Alternative, ...]
    orders_left: int
    complete: bool

    @property
    def tables(self) -> Iterator[tuple[tuple[str, ...], list[tuple[str, ...]]]]:
        """Its parts as tables: header, and rows in words."""
        if self.tasks:
            rows = [
                (each.words, f"{each.duration_s:z8.2f} s", f"{each.energy_J:z.0f} J", each.shares)
                for each in self.tasks
            ]
            yield ("task", "takes", "heat", "melts"), [*rows]
        if path := self.critical_path:
            sums = [(f"{lasts:z8.2f} s", words) for lasts, words in in_words(path)]
            yield (f"{path[-1].end_s:z8.2f} s", "is the sum of"), [*sums]
        if self.hidden:
            free = [(f"{one.activity.duration_s:z8.2f} s", str(one)) for one in self.hidden]
            yield ("at no cost", "meanwhile"), [*free]
        if (policy := self.result.policy) is not None:
            yield (
                (f"{policy.what} {policy.cost_s:z.2f} s", "of"),
                [("", each) for each in policy.sentences],
            )
        options = [(other.change, other.price, other.outcome) for other in self.alternatives]
        if self.orders_left:
            options.append(("in other orders", "", f"{self.orders_left} were not planned"))
        if options:
            own = self.alternatives[0] if self.alternatives else None
            cost_s = own.compared_s if own else self.result.require().cost.total
            speed = " at full speed" if own and own.original is not self.result.plan else ""
            yield (f"instead of {cost_s:z.2f} s{speed}", "more", "outcome"), [*options]

    @property
    def message(self) -> str:
        """Outcome in words."""
        return self.result.message if self.complete else "not all alternatives were planned"

    def __str__(self) -> str:
        lines = [self.result.message, *(f"  {reason}" for reason in self.why)]
        for header, rows in self.tables:
            lines += [" ".join(header), *("  " + " ".join(filter(None, row)) for row in rows)]
        if not self.complete:
            lines.append(f"interrupted: {self.message}")
        return "\n".join(lines)


@public
def explain(
    subject: Result | Problem,
    *,
    on_progress: Callable[[str], None] | None = None,
    most_orders: Count = MOST_ORDERS,
) -> Explanation:
    """Explain a plan of the optimal planner by planning what would have been otherwise.

    Every other plan may take the problem's ``work_limit``.

    Args:
        subject: A result of planning, or a problem that is planned first.
        on_progress: Told what is planned next.
        most_orders: Other orders of tasks that are planned, at most.

    Raises:
        InputError: If the problem asks for the greedy planner, which weighs nothing, or if the
            locomotion units would overlap at the start or at the goal.
        PlanInterrupted: At Ctrl-C: its ``result`` is the explanation so far.
    """
    problem = subject.problem if isinstance(subject, Result) else subject
    if problem.planner != "optimal":
        allowed = "'optimal': the greedy rule weighs no alternatives"
        raise InputError("planner", problem.planner, allowed)
    tell = on_progress or (lambda _: None)
    tell("the plan itself")
    result = subject if isinstance(subject, Result) else plan_until_interrupted(subject)
    others, left = list[Alternative](), 0
    complete = isinstance(subject, Result) or result.ending is not Ending.INTERRUPTED
    for _ in range(_ROUNDS if complete else 0):
        others.clear()
        made = result.plan
        if made is None or not (made.phases or made.transitions):
            break
        if result.policy is not None:
            complete = _collect(of_policy(result, result.policy, tell), others)
            break
        orders = orders_not_planned(made)
        left = max(len(orders) - most_orders, 0)
        complete = _collect(alternatives(made, orders[:most_orders], tell), others)
        may_change = not problem.tasks or problem.order == "free"
        better = with_better(result, others) if complete and may_change else None
        if better is None:
            break
        result = better
    made = result.plan
    found = Explanation(
        result=result,
        why=() if made is None else tuple(reasons(made)),
        critical_path=() if made is None else critical_path(made),
        hidden=() if made is None else hidden_activities(made),
        tasks=() if made is None else task_costs(made),
        alternatives=tuple(others),
        orders_left=left,
        complete=complete,
    )
    if not complete:
        raise PlanInterrupted(found)
    return found


def _collect(alternatives: Iterator[Alternative], known: list[Alternative]) -> bool:
    """Add the alternatives to ``known``; return False if Ctrl-C ended that early."""
    try:
        for other in alternatives:
            known.append(other)
            if other.result is not None and other.result.ending is Ending.INTERRUPTED:
                return False
    except KeyboardInterrupt:
        return False
    return True


def reasons(made: Plan) -> Iterator[str]:
    """Reasons that need no other plan."""
    task, used = bending_task(made.problem), moving_modes(made)
    for mode in () if made.problem.tasks else dict.fromkeys(used):
        rest = tuple(other for other in complete_sequence(used, made.problem) if other != mode)
        if any(mode) and (reason := unreachable_reason(rest, task)) is not None:
            yield f"{mode_name(mode)} cannot be left out of this sequence: {reason}"
    if not made.transitions:
        yield "no segment has to bend, so nothing is melted"
    elif made.problem.obstacles and not made.problem.tasks:
        necessity, rigid = Necessity(made.problem), made.robot.rigid
        necessity.proves_impossible((rigid, tuple(1 for _ in rigid), rigid))  # one reshaping
        yield necessity.words
    for item in critical_path(made):
        if item.kind in ("melt", "freeze") and len(item.segments) > 1:
            times = ("twice", "three times", "four times")[len(item.segments) - 2]
            yield f"{item} at the same time takes {item.duration_s:z.1f} s once, not {times}"
    yield f"the robot moves for {made.moving_s:z.1f} s of {made.cost.time_s:z.1f} s"
    if made.lower_bound is not None:
        policy = transition_model(made.problem).policy
        yield f"proved: no plan costs less than {made.lower_bound:z.2f} s under {policy}"


def task_costs(made: Plan) -> tuple[TaskCost, ...]:
    """Costs of the stages of a mission's plan: times and energies add up to the plan's."""
    problem = made.problem
    heating, grasping = transition_model(problem).heating(made.transitions), grasps(problem.tasks)
    found, shape_of = list[TaskCost](), "the start"
    held = "held since the start" if problem.start.holding else ""
    parts = stretches(made.trajectory)
    for i, stage in enumerate(parts):
        ends_s = stage.to_s if i + 1 < len(parts) else made.duration_s
        melts = [item for item in made.transitions if item.to == "soft"]
        melted = {item.segment for item in melts if _within(item.done_s, stage.from_s, ends_s)}
        soft = [each for each in made.phases if any(each.mode)]
        bends = any(_within(each.end_s, stage.from_s, ends_s) for each in soft)
        used = [item.energy_J(ends_s) - item.energy_J(stage.from_s) for item in heating]
        if i in grasping:
            held = _HELD[grasping[i].hold]
        elif stage.task is not None and stage.task.lets_go:
            held = ""
        shaped = not bends and (stage.task is None or stage.task.asks_shape)
        found.append(
            TaskCost(
                words=stage.words,
                from_s=stage.from_s,
                done_s=ends_s,
                melted=tuple(sorted(melted)),
                bends=bends,
                energy_J=float(sum(used)),
                shape_of=shape_of if shaped else None,
                held=held,
            )
        )
        if bends:
            shape_of = stage.words
    return tuple(found)


def _within(time_s: float, from_s: float, to_s: float) -> bool:
    return from_s + _SAME_S < time_s <= to_s + _SAME_S
