"""The program in forks of a process that has imported everything: a tenth of a start's time."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import CompletedProcess

# For each message: the folder to be in and the arguments, beside streams 0, 1 and 2.
_SERVER = """
import importlib, json, os, socket, sys
from matplotlib import pyplot
from twosra_mpc import __main__, cli, execution, planning, plotting
from twosra_mpc.lab import report
for module in sorted({*cli._MODULES.values()}):
    importlib.import_module(f"twosra_mpc.{module}")
line = socket.socket(fileno=int(sys.argv[1]))
while (received := socket.recv_fds(line, 1 << 16, 3))[0]:
    message, streams, *_ = received
    folder, *arguments = json.loads(message)
    if (child := os.fork()) == 0:
        line.close()
        os.chdir(folder)
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
            os.close(stream)
        sys.argv[:] = ["twosra", *arguments]
        sys.exit(__main__.main())
    for stream in streams:
        os.close(stream)
    line.send(b"%d" % os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


class Forks:
    """A process that runs the program again and again, each time in a fork of itself."""

    def __init__(self, line: socket.socket) -> None:
        self._line = line

    def run(
        self, *arguments: object, given: str | bytes | Path = b"", folder: Path | None = None
    ) -> CompletedProcess[bytes]:
        """Run it in a folder (the current one), given a file or what comes out of a pipe."""
        message = json.dumps([str(folder or Path.cwd()), *map(str, arguments)]).encode()
        (source, ours), *written = (os.pipe() for _ in range(3))
        if isinstance(given, Path):
            os.close(source)
            source, given = os.open(given, os.O_RDONLY), b""
        theirs = [source, *(into for _, into in written)]
        socket.send_fds(self._line, [message], theirs)
        for stream in theirs:
            os.close(stream)
        with ThreadPoolExecutor(3) as at_once:
            at_once.submit(_give, ours, given.encode() if isinstance(given, str) else given)
            out, err = [at_once.submit(_all_of, stream) for stream, _ in written]
            code = int(self._line.recv(16))
        return CompletedProcess(arguments, code, out.result(), err.result())


def _give(stream: int, text: bytes) -> None:
    with contextlib.suppress(BrokenPipeError), open(stream, "wb") as pipe:  # nobody need read all
        pipe.write(text)


def _all_of(stream: int) -> bytes:
    with open(stream, "rb") as pipe:
        return pipe.read()


@contextlib.contextmanager
def forking() -> Iterator[Forks]:
    """Start the process; what it imports prints nothing."""
    ours, theirs = socket.socketpair()
    with tempfile.TemporaryFile("w+") as told:
        server = subprocess.Popen(
            [sys.executable, "-c", _SERVER, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=told,
            stderr=told,
            pass_fds=[theirs.fileno()],
        )
        theirs.close()
        with ours:
            yield Forks(ours)
        assert server.wait(30) == 0
        told.seek(0)
        assert told.read() == ""
