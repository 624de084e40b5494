"""A process of its own for solvers, so that one that crashes takes nothing else with it."""

from __future__ import annotations

import os
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

_CONTEXT = get_context("spawn")  # a fork would inherit HiGHS' scheduler without its threads


class WorkerDiedError(Exception):
    """The worker did not live to answer; the message says how it ended."""


class Worker:
    """Calls functions in another process, one at a time; begun anew after it died.

    What the process prints goes nowhere: Bonmin and HiGHS print whatever their options say.
    """

    def __init__(self, time_limit_s: float) -> None:
        self.time_limit_s = time_limit_s  # wall time of one call
        self._running: tuple[BaseProcess, Connection] | None = None

    def call(
        self,
        function: Callable[Parameters, Result],
        *args: Parameters.args,
        **kwargs: Parameters.kwargs,
    ) -> Result:
        """Call a function of a module with arguments that can be pickled.

        Raises:
            WorkerDiedError: If the process crashed, or was ended at the time limit.
        """
        process, connection = self._running or self._start()
        self._running = None  # until it has answered
        connection.send((function, args, kwargs))
        if not connection.poll(self.time_limit_s):
            process.kill()
            process.join()
            raise WorkerDiedError(f"ended after {self.time_limit_s:g} s")
        try:
            failure, result = connection.recv()
        except EOFError:
            process.join()
            raise WorkerDiedError(f"the process died with exit code {process.exitcode}") from None
        self._running = process, connection
        if failure is not None:
            raise failure
        answer: Result = result
        return answer

    def _start(self) -> tuple[BaseProcess, Connection]:
        ours, theirs = _CONTEXT.Pipe()
        process = _CONTEXT.Process(target=_serve, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        return process, ours


def _serve(connection: Connection) -> None:
    """Answer calls until the other side is gone."""
    nowhere = os.open(Path(os.devnull), os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    while True:
        try:
            function, args, kwargs = connection.recv()
        except (EOFError, KeyboardInterrupt):
            return
        try:
            connection.send((None, function(*args, **kwargs)))
        except Exception as error:  # raised where it was called
            connection.send((error, None))
