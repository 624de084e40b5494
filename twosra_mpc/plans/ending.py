"""Endings of a search: said by the search, kept with its result."""

from __future__ import annotations

import enum


class Ending(enum.StrEnum):
    """Reason for the end of a search."""

    CLOSED = "closed"  # the incumbent is within the gap of the lower bound
    EXHAUSTED = "exhausted"  # nothing left to open can beat the incumbent
    LIMIT = "limit"  # of time
    INTERRUPTED = "interrupted"  # by Ctrl-C
