"""Everything this package raises on purpose."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Sequence
from reprlib import Repr
from types import FrameType
from typing import Any

from twosra_mpc.keys import near_word, other_unit

_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = 300  # characters of a value in a message
_SHORT.maxlong = 80  # digits
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxdict = 8  # entries
_VALUE = 100  # characters of a value that are shown
_LONGEST = 500  # characters of what else is said in a line
_MOST = 12  # further problems that are told
_OWN = {"twosra_mpc", "pydantic"}  # packages whose lines no user wrote


def printable(text: str, most: int = _LONGEST) -> str:
    """Text without control characters, cut off where it is too long."""
    shown = "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)
    return shown if len(shown) <= most else f"{shown[:most]}..."


class TwosraError(Exception):
    """Base of every error raised on purpose by this package."""

    def __reduce__(self) -> tuple[object, ...]:  # as it is, without its constructor
        return (type(self).__new__, (type(self), *self.args), vars(self))


class RobotError(TwosraError):
    """The robot cannot be driven any more: its line is dead, it is silent, or it is in danger."""


class InputWarning(UserWarning):
    """Input is legal, and probably not what was meant: another unit or frame, parts left out."""


def is_users(call: FrameType | None, *through: str) -> bool:
    """True if a call came from a user's program, perhaps through some modules of this package."""
    while call and call.f_globals.get("__name__") in through:
        call = call.f_back
    return call is not None and str(call.f_globals.get("__name__")).partition(".")[0] not in _OWN


def doubt(doubts: Iterable[str], source: str | None = None) -> None:
    """Warn of input (`InputWarning`) at the line of the user's program that it came from."""
    frame = sys._getframe()
    while frame.f_back and not is_users(frame):
        frame = frame.f_back
    seen = frame.f_globals.setdefault("__warningregistry__", {})
    place = frame.f_code.co_filename, frame.f_lineno
    for each in doubts:
        words = f"{source}: {each}" if source else each
        warnings.warn_explicit(words, InputWarning, *place, registry=seen)


class Missing(str):
    """In place of the value of a key that is not there."""


MISSING = Missing("missing")


class InputError(TwosraError, ValueError):
    """A value given by the user is not acceptable.

    Attributes:
        field: Dotted name of the field, as written in the file (``start.kappa_per_m.0``).
        value: What was given.
        allowed: What is allowed, as a phrase that completes "allowed: ...".
        source: File or built-in name the value came from, if any.
        others: Further problems found at the same time.
        hint: What was probably meant, as a sentence; by default, the number in another unit, or the
            nearest of the words that are allowed ("one of ...").
    """

    def __init__(
        self,
        field: str,
        value: object,
        allowed: str,
        source: str | None = None,
        others: tuple[InputError, ...] = (),
        hint: str = "",
    ) -> None:
        self.field, self.value, self.allowed = field, value, allowed
        self.source, self.others = source, others
        one_of = allowed.removeprefix("one of ") if isinstance(value, str) else allowed
        words = one_of.split(", ") if one_of != allowed else ()
        self.hint = hint or other_unit(field, value) or near_word(value, words)
        lines = [printable(f"{source}: " if source else "") + self._said()]
        more = [f"and {len(others) - _MOST} more"] if len(others) > _MOST else []
        super().__init__("\n".join([*lines, *map(str, others[:_MOST]), *more]))

    def _said(self) -> str:
        name, allowed = printable(self.field) or "value", printable(self.allowed)
        if isinstance(self.value, Missing):
            return f"{name} is missing: {allowed}"
        shown = printable(_SHORT.repr(self.value).replace("\n", ""), _VALUE)
        hint = f"{printable(self.hint)} " if self.hint else ""
        return f"{name} = {shown} is not acceptable; {hint}allowed: {allowed}"

    def within(self, parent: str, source: str | None = None, hint: str = "") -> InputError:
        """Return the same error seen from the record that holds this one under ``parent``."""
        field = ".".join(part for part in (parent, self.field) if part)
        others = tuple(other.within(parent, source) for other in self.others)
        known, hint = self.source or source, hint or self.hint
        return InputError(field, self.value, self.allowed, known, others, hint)

    def among(self, others: Sequence[InputError]) -> InputError:
        """Return this error with further ones found at the same time."""
        every = (*self.others, *others)
        return InputError(self.field, self.value, self.allowed, self.source, every, self.hint)


class NoPlanError(TwosraError):
    """Raised by ``Result.require()`` when the planner ended without a verified plan.

    Attributes:
        status: Status of the result that was asked for its plan.
        reason: The planner's message.
    """

    def __init__(self, status: str, reason: str) -> None:
        self.status, self.reason = status, reason
        super().__init__(f"no verified plan ({status}): {reason}")


class PlanInterrupted(KeyboardInterrupt):
    """Ctrl-C while planning.

    Attributes:
        result: The best plan so far, with its true gap; of ``explain``, the explanation so far.
    """

    def __init__(self, result: Any) -> None:
        self.result = result
        super().__init__(str(result.message))

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.result,))


class ContradictionError(TwosraError, RuntimeError):
    """A plan costs less than what was proved to be the least: a mistake in this package.

    Attributes:
        cost: Of the plan.
        bound: What was proved of its mode sequence.
    """

    def __init__(self, cost: float, bound: float) -> None:
        self.cost, self.bound = cost, bound
        super().__init__(
            f"a plan costs {cost:z.9g} although its mode sequence was proved to cost {bound:z.9g}"
            " at least: this is a bug of twosra_mpc, and neither the bound nor the plan can be"
            " trusted; please report it with the robot and the scenario"
        )
