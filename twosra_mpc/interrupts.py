"""Ctrl-C and its relatives as a request, so that no second one can cut a stop short."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# By which a person or the system ends or suspends a program.
_USUAL = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")  # Windows knows the first two
_SUSPENDING = ("SIGTSTP", "SIGTTIN", "SIGTTOU")
# Nobody can catch the first two; the next four mean that the program itself is broken; the rest
# does nothing to a program that does not ask for it.
_LEFT_ALONE = (
    *("SIGKILL", "SIGSTOP", "SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL"),
    *("SIGCHLD", "SIGCONT", "SIGURG", "SIGWINCH", "SIGINFO"),
)


class Interrupts:
    """Interrupts of a block.

    Attributes:
        requested: An interrupt has been asked for.
        held: ``interrupt_once`` raises no more.
    """

    def __init__(self) -> None:
        """None yet."""
        self.requested = self.held = False

    def request(self, *_signal: object) -> None:
        """Ask for one; usable as a signal handler."""
        self.requested = True

    def interrupt(self, *_signal: object) -> None:
        """Ask for one and interrupt at once; a library that swallows that is found out later.

        Raises:
            KeyboardInterrupt: Always.
        """
        self.requested = True
        raise KeyboardInterrupt

    def interrupt_once(self, *_signal: object) -> None:
        """Ask for one and interrupt at once, unless that was done before or interrupts are held.

        Raises:
            KeyboardInterrupt: The first time, if not held.
        """
        raises, self.requested = not (self.held or self.requested), True
        if raises:
            raise KeyboardInterrupt

    def check(self) -> None:
        """Interrupt here, if that was asked for.

        Raises:
            KeyboardInterrupt: If so.
        """
        if self.requested:
            raise KeyboardInterrupt


@contextmanager
def deferred_interrupts() -> Iterator[Interrupts]:
    """Collect interrupts for the length of a block instead of raising them anywhere in it.

    So are all signals that would end or suspend the program, if nobody else has a use for them.
    Outside of the main thread, where Python delivers none, nothing changes.
    """
    interrupts = Interrupts()
    numbers = _numbers((*_USUAL, *_SUSPENDING)) | _ending()
    with _handled(numbers | _deferred(), interrupts.request):
        yield interrupts


@contextmanager
def noted_interrupts() -> Iterator[Interrupts]:
    """Have Ctrl-C interrupt a block as ever, and know of it where a library swallows it.

    So are other signals that do as Ctrl-C does. Of two blocks the inner one knows.
    """
    interrupts = Interrupts()
    with _handled(_interrupting(), interrupts.interrupt):
        yield interrupts


@contextmanager
def raised_interrupts() -> Iterator[Interrupts]:
    """Have Ctrl-C or a signal that would end the program interrupt a block once, wherever it is."""
    interrupts = Interrupts()
    with _handled(_ending() | _interrupting(), interrupts.interrupt_once):
        yield interrupts


@contextmanager
def _handled(
    numbers: set[signal.Signals | int], handler: Callable[[int, FrameType | None], object]
) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        for number in numbers:
            signal.signal(number, handler)
        yield
    finally:
        for number, handled_by in before.items():
            signal.signal(number, handled_by)


def _ending() -> set[signal.Signals | int]:
    """Signals that would end the program, for nobody handles them."""
    known = signal.valid_signals() - _numbers((*_LEFT_ALONE, *_SUSPENDING))
    return {number for number in known if signal.getsignal(number) is signal.SIG_DFL}


def _interrupting() -> set[signal.Signals | int]:
    """Signals that interrupt as Ctrl-C does where nobody changes that, or as a block here does."""
    return {
        number
        for number in _numbers(_USUAL)
        if (handler := signal.getsignal(number)) is signal.default_int_handler
        or getattr(handler, "__func__", None) in (Interrupts.interrupt, Interrupts.interrupt_once)
    }


def _deferred() -> set[signal.Signals | int]:
    """Signals that a block around this one collects."""
    return {
        number
        for number in signal.valid_signals()
        if isinstance(getattr(signal.getsignal(number), "__self__", None), Interrupts)
    }


def _numbers(names: tuple[str, ...]) -> set[signal.Signals | int]:
    return {getattr(signal, name) for name in names if hasattr(signal, name)}
