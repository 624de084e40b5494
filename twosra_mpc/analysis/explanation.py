"""``explain(problem)``: why a plan is what it is, and what other plans would cost.

Everything said of another plan comes from planning it: the next best mode sequence, the plan
without a mode, with one heater, with slower transitions. Plans are compared at full speed: gentle
ones all cost as much as the gap allows. What the duration is made of is read off the plan itself.

Among obstacles each plan takes longer to find, and other plans are planned: the next best mode
sequence, the next best way round (the narrowest gap that b0 goes through closed), and the plan that
keeps 5 mm more clearance. That comes with why the plan reshapes, and where.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.analysis.critical_path import (
    Activity,
    Hidden,
    critical_path,
    hidden_activities,
    in_words,
)
from twosra_mpc.analysis.transition_speed import slowed
from twosra_mpc.arguments import made, public
from twosra_mpc.checking.verification import verify
from twosra_mpc.errors import InputError
from twosra_mpc.planning.missions.relaxed import bending_task
from twosra_mpc.planning.planner import plan_until_interrupted, plan_without
from twosra_mpc.planning.search.bends import unreachable_reason
from twosra_mpc.plans.ending import Ending
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import Mode, ModeSequence, mode_name
from twosra_mpc.timing import transition_model

if TYPE_CHECKING:
    from twosra_mpc.analysis.reshaping import Reshaping

SLOWER = 1.5  # how many times slower a freeze or a melt is made
FARTHER_M = 0.005  # how much more clearance is asked for

_ROUNDS = 8  # how often a sequence that only adds unused phases is set aside
_BETTER = "cheaper than the plan that was to be explained: found among the alternatives"
_SAME_S = 1e-5  # events closer than this are one
_LOOKS = 200  # at a phase


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another plan, and what it costs more.

    Attributes:
        change: What is different, e.g. "without mode [1,0]".
        details: What exactly was changed, or what the other plan does; may be empty.
        original: The plan that is explained, at full speed.
        result: Of planning the changed problem, with its own status and gap; None if the change
            makes no valid problem.
    """

    change: str
    details: str
    original: Plan
    result: Result | None

    @property
    def plan(self) -> Plan | None:
        """The other plan, if there is one."""
        return None if self.result is None else self.result.plan

    @property
    def difference_s(self) -> float | None:
        """Cost of this plan less that of the original [s]; None without a plan."""
        return None if self.plan is None else self.plan.cost.total - self.original.cost.total

    @property
    def difference(self) -> float | None:
        """``difference_s`` relative to the cost of the original."""
        if self.difference_s is None or not self.original.cost.total:
            return None
        return self.difference_s / self.original.cost.total

    @property
    def outcome(self) -> str:
        """What came of it, in words."""
        if self.result is None:
            return self.details
        return f"{self.result.message} ({self.details})" if self.details else self.result.message

    @property
    def price(self) -> str:
        """``difference_s`` and ``difference`` in words; empty where there is no plan."""
        if self.difference_s is None:
            return ""
        return price_words(self.difference_s, self.original.cost.total)

    def __str__(self) -> str:
        return ": ".join(filter(None, [self.change, self.price, self.outcome]))


def price_words(more_s: float, cost_s: float) -> str:
    """How much more another plan costs than one of ``cost_s``, in words."""
    if more_s < -_SAME_S:
        return f"{-more_s:z.2f} s less: this plan is not the best"
    percent = 100 * more_s / cost_s if cost_s else 0.0
    digits = 1 if abs(percent) >= 1 else 3
    return f"{more_s:+z.2f} s ({percent:+z.{digits}f} %)"


@made
@dataclass(frozen=True, eq=False)
class Explanation:
    """Why a plan is what it is.

    Attributes:
        result: What is explained: the plan, or that there is none.
        why: Reasons, in sentences.
        critical_path: Activities that add up to the duration.
        hidden: Activities that cost no time of their own.
        alternatives: Other plans, as far as they are known.
        complete: Whether all alternatives were planned; False after Ctrl-C.
        reshaping: Why it reshapes, and where; None where there are no obstacles.
    """

    result: Result
    why: tuple[str, ...]
    critical_path: tuple[Activity, ...]
    hidden: tuple[Hidden, ...]
    alternatives: tuple[Alternative, ...]
    complete: bool
    reshaping: Reshaping | None = None

    def __str__(self) -> str:
        lines = [self.result.message, *(f"  {reason}" for reason in self.why)]
        if self.reshaping is not None:
            lines += [f"  {words}" for words in (*self.reshaping.why, *self.reshaping.places)]
        if self.critical_path:
            lines.append(f"The {self.critical_path[-1].end_s:z.1f} s are")
            told = in_words(self.critical_path)
            lines += [f"  {duration:z8.2f} s {words}" for duration, words in told]
        if self.hidden:
            lines.append("At the same time, at no cost")
            lines += [f"  {one.activity.duration_s:z8.2f} s {one}" for one in self.hidden]
        if self.alternatives:
            quick = self.alternatives[0].original
            compared = f", compared at full speed ({quick.cost.total:z.2f} s for this plan)"
            lines.append(f"Instead{'' if quick is self.result.plan else compared}")
            lines += [f"  {other}" for other in self.alternatives]
        if not self.complete:
            lines.append("Interrupted: not all alternatives were planned.")
        return "\n".join(lines)


@public
def explain(
    subject: Result | Problem, *, on_progress: Callable[[str], None] | None = None
) -> Explanation:
    """Explain a plan of the optimal planner by planning what would have been otherwise.

    Every other plan may take the problem's ``work_limit``. Ctrl-C ends the planning, and what is
    known so far is returned.

    Args:
        subject: A result of planning, or a problem that is planned first.
        on_progress: Told what is planned next.

    Raises:
        InputError: If the problem asks for the greedy planner, which weighs nothing, if it is a
            mission (`analysis.missions.explain_mission`), or if the locomotion units would overlap
            at the start or at the goal.
    """
    problem = subject.problem if isinstance(subject, Result) else subject
    if problem.is_mission:
        raise InputError("tasks", problem.tasks, "one goal; `explain_mission` is for missions")
    if problem.planner != "optimal":
        allowed = "'optimal': the greedy rule weighs no alternatives"
        raise InputError("planner", problem.planner, allowed)
    tell = on_progress or (lambda _: None)
    tell("the plan itself")
    result = subject if isinstance(subject, Result) else plan_until_interrupted(subject)
    others = list[Alternative]()
    complete = isinstance(subject, Result) or result.ending is not Ending.INTERRUPTED
    reasons = None
    if complete:
        result, complete = _beside_others(result, others, tell)
    if complete and problem.obstacles:
        tell("without one obstacle after the other")
        reasons, complete = _reshaping(result)
    made = result.plan
    return Explanation(
        result=result,
        why=() if made is None else tuple(_why(made)),
        critical_path=() if made is None else critical_path(made),
        hidden=() if made is None else hidden_activities(made),
        alternatives=tuple(others),
        complete=complete,
        reshaping=reasons,
    )


def _beside_others(
    result: Result, others: list[Alternative], tell: Callable[[str], None]
) -> tuple[Result, bool]:
    """Collect the alternatives of a plan, or of a cheaper one among them; False after Ctrl-C."""
    complete = True
    for _ in range(_ROUNDS):
        others.clear()
        made = result.plan
        if made is None or not (made.phases or made.transitions):
            break
        complete = _collect(_alternatives(made, tell), others)
        if not complete or (better := with_better(result, others)) is None:
            break
        result = better
    return result, complete


def _reshaping(result: Result) -> tuple[Reshaping | None, bool]:
    """Why and where a plan reshapes; whether that was not ended by Ctrl-C."""
    from twosra_mpc.analysis.reshaping import reshaping  # only among obstacles anyone waits for it

    try:
        return reshaping(result), True
    except KeyboardInterrupt:
        return None, False


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


def _why(made: Plan) -> Iterator[str]:
    """Reasons that need no other plan."""
    task, used = bending_task(made.problem), _modes(made)
    for mode in dict.fromkeys(used):
        rest = tuple(other for other in _complete(used, made.problem) if other != mode)
        if any(mode) and (reason := unreachable_reason(rest, task)) is not None:
            yield f"{mode_name(mode)} cannot be left out of this sequence: {reason}"
    if not made.transitions:
        yield "no segment has to bend, so nothing is melted"
    for item in critical_path(made):
        if item.kind in ("melt", "freeze") and len(item.segments) > 1:
            times = ("twice", "three times", "four times")[len(item.segments) - 2]
            yield f"{item} at the same time takes {item.duration_s:z.1f} s once, not {times}"
    yield f"the robot moves for {made.moving_s:z.1f} s of {made.cost.time_s:z.1f} s"
    if made.lower_bound is not None:
        policy = transition_model(made.problem).policy
        yield f"proved: no plan costs less than {made.lower_bound:z.2f} s under {policy}"


def _alternatives(made: Plan, tell: Callable[[str], None]) -> Iterator[Alternative]:
    """Plan one alternative after the other."""
    problem = made.problem
    quick = problem.with_values(motion="fastest") if problem.drives_gently else problem
    original = at_full_speed(made, quick, tell)
    tell("the next best mode sequence")
    yield _next_best(original)
    among = original.problem.obstacles
    for change, changed in _changes_among_obstacles(original) if among else _changes(original):
        tell(change)
        try:
            problem, details = changed()
            yield Alternative(change, details, original, plan_until_interrupted(problem))
        except InputError as error:
            yield Alternative(change, f"no such problem: {error}", original, None)


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
                bound = made.lower_bound
                solving.append(
                    replace(other.plan, trajectory=same, verification=checked, lower_bound=bound)
                )
    better = min(solving, key=lambda each: each.cost.total, default=None)
    if better is None:
        return None
    return replace(result, plan=better, status=better.status, message=f"{better}; {_BETTER}")


def at_full_speed(made: Plan, problem: Problem, tell: Callable[[str], None]) -> Plan:
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


def _changes(original: Plan) -> Iterator[tuple[str, Callable[[], tuple[Problem, str]]]]:
    """Yield what is to be changed, in words, and how to change it."""
    problem = original.problem
    for mode in dict.fromkeys(_modes(original)):
        modes = tuple(other for other in problem.modes if other != mode)
        yield f"without mode {mode_name(mode)}", partial(_with, problem, modes=modes)
    if problem.heaters_at_once > 1 and original.transitions:
        yield "with one heater at a time", partial(_with, problem, heaters_at_once=1)
    kinds = {item.to for item in original.transitions}
    if "rigid" in kinds:
        yield f"freezing {SLOWER:zg} times slower", partial(slowed, problem, "freeze", SLOWER)
    if "soft" in kinds:
        yield f"melting {SLOWER:zg} times slower", partial(slowed, problem, "melt", SLOWER)


def _changes_among_obstacles(
    original: Plan,
) -> Iterator[tuple[str, Callable[[], tuple[Problem, str]]]]:
    """As `_changes`: another way round, and farther from all obstacles."""
    from twosra_mpc.checking.clearance import check_obstacles
    from twosra_mpc.space.gaps import gaps_through

    problem, moving = original.problem, [phase[1:] for phase in original.phases]
    times = np.concatenate([np.linspace(*ends, _LOOKS) for ends in moving])
    for gap in gaps_through(problem.world, original.trajectory.at(times).q[:, :2]):
        closed = problem.with_values(obstacles=(*problem.obstacles, gap.closed))
        try:
            check_obstacles(closed)
        except InputError:  # start or goal are in this gap
            continue
        yield f"the next best way round: {gap} closed", partial(_with, closed)
        break
    farther = problem.clearance_m + FARTHER_M
    change = f"with {1e3 * FARTHER_M:zg} mm more clearance"
    yield change, partial(_with, problem, clearance_m=farther)


def _with(problem: Problem, **changes: object) -> tuple[Problem, str]:
    return problem.with_values(**changes), ""


def _next_best(original: Plan) -> Alternative:
    """Plan with another mode sequence, one that differs in the phases in which something moves.

    Sequences whose further phases stay empty only melt and freeze for nothing; where only such are
    found, the cheapest of them is the answer.
    """
    excluded = _sequences(original)
    cheapest = found = plan_without(original.problem, frozenset(excluded))
    for _ in range(1 if original.problem.obstacles else _ROUNDS):
        other = found.plan
        if other is None or found.ending is Ending.INTERRUPTED or _differ(other, original):
            break
        known = len(excluded)
        excluded |= _sequences(other)
        if len(excluded) == known:
            break
        found = plan_without(original.problem, frozenset(excluded))
    if found.plan is not None and _differ(found.plan, original):
        return Alternative("with the next best mode sequence", "", original, found)
    details = ""
    if cheapest.found and cheapest.lower_bound is not None:
        details = f"melts more than it needs; none costs less than {cheapest.lower_bound:z.1f} s"
    return Alternative("with any other mode sequence", details, original, cheapest)


def _differ(one: Plan, other: Plan) -> bool:
    return _modes(one) != _modes(other)


def _modes(made: Plan) -> ModeSequence:
    """Modes of the phases in which something moves, none twice in a row."""
    return _merged(made.sequence)


def _merged(modes: Sequence[Mode]) -> ModeSequence:
    return tuple(mode for i, mode in enumerate(modes) if i == 0 or mode != modes[i - 1])


def _sequences(made: Plan) -> set[ModeSequence]:
    """The complete mode sequences of a plan: by its phases alone, and with those left empty."""
    problem = made.problem
    passed = [mode for mode in _passed_modes(made) if mode in problem.modes]
    return {_complete(_modes(made), problem), _complete(_merged(passed), problem)}


def _complete(modes: ModeSequence, problem: Problem) -> ModeSequence:
    """Add the rigid phases that open and close a sequence in the search."""
    rigid = problem.robot.rigid
    if rigid not in problem.modes:
        return modes
    opening = (rigid,) if problem.start_mode == rigid else ()
    closing = (rigid,) if problem.goal.mode == rigid else ()
    return _merged((*opening, *modes, *closing))


def _passed_modes(made: Plan) -> list[Mode]:
    """Stiffness of the segments whenever none of them is changing, in order of time."""
    changes = made.transitions
    moments = {0.0, *(t.onset_s for t in changes), *(t.done_s for t in changes)}
    passed: list[Mode] = []
    for now in sorted(moments):
        if any(t.onset_s + _SAME_S < now < t.done_s - _SAME_S for t in changes):
            continue
        mode = list(made.problem.start_mode)
        for item in sorted(changes, key=lambda t: t.done_s):
            if item.done_s <= now + _SAME_S:
                mode[item.segment - 1] = int(item.to == "soft")
        passed.append(tuple(mode))
    return passed
