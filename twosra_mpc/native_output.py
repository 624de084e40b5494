"""Standard output and error of compiled libraries, which Python's own streams do not see."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

_STREAMS = (1, 2)  # file descriptors of standard output and error


@contextmanager
def discarded_native_output() -> Iterator[None]:
    """Discard what compiled code writes to standard output and error within a block.

    The two file descriptors belong to the process: keep the block short, for another thread's
    output is discarded, too. A descriptor that is closed stays so.
    """
    with ExitStack() as stack:
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
