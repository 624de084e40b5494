"""Time for the stream: the computer's own, or one that only the stream itself moves."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that can be waited on; times in s from its start."""

    def now_s(self) -> float:
        """Time since the start."""

    def sleep(self, duration_s: float) -> None:
        """Let so much time pass."""


class SystemClock:
    """The computer's monotonic clock."""

    def __init__(self) -> None:
        """Start it."""
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Time since the start."""
        return time.monotonic() - self._start_s

    def sleep(self, duration_s: float) -> None:
        """Let so much time pass."""
        time.sleep(duration_s)


class SteppedClock:
    """A clock on which waiting takes no time, for trying a stream out."""

    def __init__(self) -> None:
        """Start it."""
        self._now_s = 0.0

    def now_s(self) -> float:
        """Time since the start."""
        return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Move on by so much."""
        self._now_s += duration_s
