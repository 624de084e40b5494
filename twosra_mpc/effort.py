"""Effort: how much work may be done, counted where it is done, and CPU time as a backstop.

Whatever costs something says so (`charge`), with what it is about to do. A unit of work is about
a millisecond on a usual machine, and the same work on every machine, however busy: what is found
within a work limit does not depend on a clock. The limit of CPU time is for machines far slower.

Work that sees in time that its limit is reached (`out_of_effort`) ends with the best it has. What
it has begun by then may take an overtime more; then `charge` raises, and who set the limit goes on
with what is known. The limits belong to the running context, as those of a thread do, so that no
function needs to hand them down.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache, update_wrapper
from typing import Concatenate, ParamSpec, TypeVar

from twosra_mpc.arguments import Word
from twosra_mpc.errors import TwosraError

OVERTIME = 500  # units of work that what was begun in time may take more
OVERTIME_S = 0.2  # the same of CPU time
_IN_A_UNIT = 10_000  # work is counted in whole parts, so that sums are exact
_LOOK = 5 * _IN_A_UNIT  # work between two looks at the clock

Given = ParamSpec("Given")
Owner = TypeVar("Owner")
Made = TypeVar("Made")


class Cost:
    """Costs of work, in ten-thousandths of a unit: about as many tenths of a microsecond.

    Measured as CPU time from one charge to the next, over plans of all built-in scenarios.
    """

    # Of the search: event times, programs, bounds.
    NETWORK = 110  # a phase of a mode sequence: its events, and how early they can be
    SCHEDULE = 350  # an event of the schedule of least cost
    LINEAR_PROGRAM = 105  # a row or column of HiGHS's
    ENCLOSURE = 100  # a thousand operations on intervals
    HEADING_STEP = 40  # a slice of twists in a step of the least time of a drive
    NEWTON_STEP = 15  # a row or column in a step of the interior point method
    PROOF = 25_000  # a sequence that a certificate bounds, in interval arithmetic
    NLP_STEP = 750  # a variable in an iteration of IPOPT
    DRIVE_STEP = 120  # the same of the program of a drive, which is sparse and written out
    GREEDY_STEP = 2000  # a mode that proposes a step
    STAGE = 5000  # a stage of a way to do a mission
    # Of plans: paths, speeds, checks.
    INTERVAL = 600  # an interval of a path that is rolled out
    PROFILE = 600  # an interval of a path that is travelled as fast as can be
    REINTEGRATION = 60  # a step
    SAMPLE = 800  # a sample of a plan that is verified
    OUTLINE = 300  # the distance of the drawn robot
    POINT = 30  # of a plane, and how far the drawn robot is from it
    BOX = 5  # a thousand of poses of an object that a disc in it may block
    BEND = 1800  # a look at whether a bend passes a forbidden shape
    CELL = 300  # a thousand cells of the plane of shapes in a bend
    # Among obstacles and objects.
    DISTANCE = 11  # a piece, or all, against a part of an obstacle, by separating axes
    BALL = 300  # the distance of an outline to all that is around
    LEG = 1  # a coordinate of a leg whose time is asked
    TOUCH = 400  # a configuration at an outline
    SLICE = 1500  # what is free at a heading
    CORNER = 1000  # of an outline that is grown
    PART = 300  # of an obstacle, convex
    MERGE = 1000  # of two convex parts of an obstacle, or that they are none
    SUM = 300  # of two convex pieces, and its share of their union
    MEETING = 280  # two parts of neighbouring slices
    ROAD = 28  # a node of a map of roads
    WAY = 6  # a node of a map that is searched
    SHAPE = 2000  # another shape on the way
    CHAIN = 60  # a thousand legs that a chain of stations may have
    KEPT = 1  # what was kept, when it is first asked for: as much as it cost when it was made


class Ending(Word):
    """Reason for the end of a search."""

    CLOSED = "closed"  # the incumbent is within the gap of the lower bound
    EXHAUSTED = "exhausted"  # nothing left to open can beat the incumbent
    LIMIT = "limit"  # of time
    INTERRUPTED = "interrupted"  # by Ctrl-C


class OutOfEffortError(TwosraError):
    """Work was not done within its limits; never raised out of `plan`."""


class Account:
    """Account of the work under one set of limits; times of ``time.process_time``."""

    def __init__(self, work: float, cpu_s: float, given_up: Callable[[], bool]) -> None:
        """With a limit in parts of a unit, one of CPU time from now on, and who may end it."""
        self.work, self.spent, self.given_up = work, 0, given_up
        self.paid = dict[Hashable, int]()  # what was kept and is counted here, with its own cost
        self.until_s = time.process_time() + cpu_s
        self.look_at = 0  # work at which the clock is looked at next

    @property
    def most(self) -> float:
        """Limit with the overtime."""
        return self.work + OVERTIME * _IN_A_UNIT

    def look(self) -> None:
        """Stop here if even the overtime is over.

        Raises:
            OutOfEffortError: If so, or nobody waits for it any more; what is spent then is no more
                than that.
        """
        if self.given_up():
            raise OutOfEffortError
        if self.spent > self.most:
            self.spent = int(self.most)
            raise OutOfEffortError
        if time.process_time() > self.until_s + OVERTIME_S:
            raise OutOfEffortError
        self.look_at = int(min(self.spent + _LOOK, self.most))


_UNLIMITED = Account(math.inf, math.inf, lambda: False)
_ACCOUNT: ContextVar[Account] = ContextVar("account", default=_UNLIMITED)


@contextmanager
def limited(
    work: float, cpu_s: float, given_up: Callable[[], bool] | None = None
) -> Iterator[Account]:
    """Limit the work [units] and the CPU time [s] of a block; what is around it holds, too.

    So does ``given_up``: true once nobody waits for the work any more, asked every few units.
    """
    outer = _ACCOUNT.get()
    parts = math.ceil(work * _IN_A_UNIT) if work < math.inf else math.inf
    left = outer.work - outer.spent, outer.until_s - time.process_time()
    account = Account(min(parts, left[0]), min(cpu_s, left[1]), given_up or outer.given_up)
    token = _ACCOUNT.set(account)
    try:
        yield account
    finally:
        _ACCOUNT.reset(token)
        outer.spent += account.spent


def lend_overtime() -> None:
    """Lend the overtime once more, from now on, to what makes use of all the work before."""
    account = _ACCOUNT.get()
    account.work = max(account.spent, account.work)
    account.until_s = max(time.process_time(), account.until_s)


def charge(cost: int, times: int = 1) -> None:
    """Count what is about to be done, so many times.

    Raises:
        OutOfEffortError: If it may not be done any more.
    """
    account = _ACCOUNT.get()
    account.spent += cost * times
    if account.spent > account.look_at:
        account.look()


def spent() -> float:
    """Work so far under the innermost limit [units]."""
    return _ACCOUNT.get().spent / _IN_A_UNIT


def limit_reached() -> str | None:
    """The setting that says nothing more should be begun; None: there is effort left."""
    account = _ACCOUNT.get()
    if account.spent >= account.work or account.given_up():
        return "work_limit"
    return "time_limit_s" if time.process_time() >= account.until_s else None


def out_of_effort() -> bool:
    """True if nothing more should be begun."""
    return limit_reached() is not None


def once(
    make: Callable[Concatenate[Owner, Given], Made],
) -> Callable[Concatenate[Owner, Given], Made]:
    """Keep what a method makes for each of its arguments, as long as there is its object."""

    def asked(owner: Owner, /, *args: Given.args, **kwargs: Given.kwargs) -> Made:
        made: dict[object, Made] = vars(owner).setdefault(f"{make.__name__} by arguments", {})
        if (key := (args, *kwargs.items())) not in made:
            made[key] = make(owner, *args, **kwargs)
        return made[key]

    return update_wrapper(asked, make)


def remembered(most: int) -> Callable[[Callable[Given, Made]], Callable[Given, Made]]:
    """Keep the last results of a function, as ``lru_cache`` does, with what they cost.

    They, and what was kept to make them, cost as much once under each limit: so the work of a plan
    is not less after another one.
    """

    def decorate(make: Callable[Given, Made]) -> Callable[Given, Made]:
        @lru_cache(most)
        def kept(*args: Hashable, **kwargs: Hashable) -> tuple[Made, dict[Hashable, int]]:
            with limited(math.inf, math.inf) as account:
                made = make(*args, **kwargs)  # type: ignore[arg-type]
            _ACCOUNT.get().spent -= account.spent
            own = account.spent - sum(account.paid.values())
            return made, {**account.paid, (make, args, *kwargs.items()): own}

        def asked(*args: Given.args, **kwargs: Given.kwargs) -> Made:
            made, costs = kept(*args, **kwargs)  # type: ignore[arg-type]
            account = _ACCOUNT.get()
            owed = {key: cost for key, cost in costs.items() if key not in account.paid}
            if owed:
                charge(Cost.KEPT, sum(owed.values()))
                account.paid |= owed if account is not _UNLIMITED else {}
            return made

        return update_wrapper(asked, make)

    return decorate
