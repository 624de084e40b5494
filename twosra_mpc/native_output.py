"""Standard output and error of compiled libraries, which write past Python's own streams.

The program gives Python's streams descriptors of their own (``separate_native_output``). A library
in somebody else's process may not; there output is discarded for the length of a block.
"""

from __future__ import annotations

import faulthandler
import io
import os
import sys
from _thread import allocate_lock  # loaded already; "threading" takes a millisecond
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TextIO

_STREAMS = (1, 2)  # file descriptors of standard output and error
_ONE_BLOCK = allocate_lock()  # of two at once, the first to end would undo what the other kept


@contextmanager
def discarded_native_output() -> Iterator[None]:
    """Discard what compiled code writes to standard output and error within a block.

    The two file descriptors belong to the process: keep the block short, for another thread's
    output is discarded, too. A descriptor that is closed stays so.
    """
    with _ONE_BLOCK, ExitStack() as stack:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        stack.callback(os.close, nowhere)
        for stream in _STREAMS:
            try:
                kept = os.dup(stream)
            except OSError:  # closed
                continue
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, stream)
            os.dup2(nowhere, stream)
        yield


def separate_native_output(*, shown: bool) -> None:
    """Let only Python's own streams write to standard output and error, until the process ends.

    Descriptors 1 and 2, which compiled code and child processes write to, lead nowhere from then
    on. Crashes are still reported on standard error. A stream that is closed leads nowhere, too.

    Args:
        shown: Whether native output goes to standard error instead.
    """
    while (nowhere := os.open(os.devnull, os.O_RDWR)) <= max(_STREAMS):
        os.set_inheritable(nowhere, True)  # as a standard stream is; this one was closed
    sys.stdout = sys.__stdout__ = _stream_of_its_own(1, sys.stdout)  # type: ignore[misc]
    sys.stderr = sys.__stderr__ = _stream_of_its_own(2, sys.stderr)  # type: ignore[misc]
    if not shown:
        os.dup2(nowhere, 2)
    os.dup2(2, 1)
    os.close(nowhere)
    faulthandler.enable(sys.stderr)


def _stream_of_its_own(descriptor: int, stream: TextIO | None) -> io.TextIOWrapper:
    """Open a stream to where a descriptor leads, which writes as ``stream`` does."""
    kind = stream if isinstance(stream, io.TextIOWrapper) else None
    unbuffered = kind is not None and kind.write_through
    return io.TextIOWrapper(
        open(os.dup(descriptor), "wb", buffering=0 if unbuffered else -1),
        encoding=kind.encoding if kind else "utf-8",
        errors=kind.errors if kind else "backslashreplace",
        line_buffering=kind is not None and kind.line_buffering,
        write_through=unbuffered,
    )
