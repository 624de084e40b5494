"""How long work may take: one deadline, asked by every loop under it, however deep.

Work that sees in time that its time is up (`out_of_time`) ends with the best it has. What it has
begun by then may take `OVERTIME_S` more; then `check_time` raises wherever it is asked, and who set
the limit goes on with what is known. The deadline belongs to the running context, as that of a
thread does, so that no function needs to hand it down.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from twosra_mpc.errors import TwosraError

OVERTIME_S = 0.4  # that what was begun in time may take more

_DEADLINE_S: ContextVar[float] = ContextVar("deadline_s", default=math.inf)  # of perf_counter()


class OutOfTimeError(TwosraError):
    """Work was not done within its time limit; never raised out of `plan`."""


@contextmanager
def time_limit(limit_s: float) -> Iterator[None]:
    """Set a time limit [s] on a block; one around it holds, too."""
    with _until(min(time.perf_counter() + limit_s, _DEADLINE_S.get())):
        yield


@contextmanager
def finishing() -> Iterator[None]:
    """Lend the overtime once more, from now on, to what makes use of all the work before."""
    with _until(max(time.perf_counter(), _DEADLINE_S.get())):
        yield


@contextmanager
def _until(until_s: float) -> Iterator[None]:
    token = _DEADLINE_S.set(until_s)
    try:
        yield
    finally:
        _DEADLINE_S.reset(token)


def out_of_time() -> bool:
    """Whether nothing more should be begun."""
    return time.perf_counter() > _DEADLINE_S.get()


def overtime_left_s() -> float:
    """How long what was begun may still take [s]; inf without a limit."""
    return _DEADLINE_S.get() + OVERTIME_S - time.perf_counter()


def check_time(needed_s: float = 0.0) -> None:
    """Stop here, if even the overtime is over, or too short for what is to be done next.

    Raises:
        OutOfTimeError: If so.
    """
    if overtime_left_s() < needed_s:
        raise OutOfTimeError
