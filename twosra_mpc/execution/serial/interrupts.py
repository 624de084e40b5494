"""Ctrl-C and its relatives as a request, so that no second one can cut a stop short."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# Every signal by which a person or the system ends or suspends a program; SIGKILL cannot be caught.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")  # Windows knows the first two


class Interrupts:
    """Whether an interrupt has been asked for."""

    def __init__(self) -> None:
        """None yet."""
        self._requested = False

    def request(self, *_signal: object) -> None:
        """Ask for one; usable as a signal handler."""
        self._requested = True

    def check(self) -> None:
        """Interrupt here, if that was asked for.

        Raises:
            KeyboardInterrupt: If so.
        """
        if self._requested:
            raise KeyboardInterrupt


@contextmanager
def deferred_interrupts() -> Iterator[Interrupts]:
    """Collect interrupts for the length of a block instead of raising them anywhere in it.

    Outside of the main thread, where Python delivers none, nothing changes.
    """
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    numbers = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    before = {number: signal.signal(number, interrupts.request) for number in numbers}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
