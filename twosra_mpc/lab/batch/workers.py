"""Chunks of problems in processes of this machine: which are planned, retried and balanced."""

from __future__ import annotations

import itertools
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process, resource_tracker

from twosra_mpc.lab.batch.chunk import Asked, Chunk, failed, plan_chunk
from twosra_mpc.lab.batch.problems import Posed

CHUNK_S = 1.0  # what a task should take
_FIRST, _MOST = 2, 500  # problems in the first chunks, and at most
_EACH = 2  # chunks on their way for each worker: one is planned, one waits
# Numerical libraries would start a thread for every core in every worker.
_ONE_CORE = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}

Submit = Callable[[list[Posed], Asked], Future[Chunk]]


def planned(posed: Iterator[Posed], asked: Asked, workers: int | None) -> Iterator[Chunk]:
    """Plan problems in processes; yields what chunks of them came to, as they finish.

    Where a process dies, all that was on its way is planned once more, one at a time: problems that
    end a process again are called failed.

    Args:
        posed: The problems.
        asked: How they are planned.
        workers: Processes of one thread each; None: one a core.
    """
    suspects: list[Posed] = []
    while True:
        yield from _together(posed, asked, workers or os.cpu_count() or 1, suspects)
        if not suspects:
            return
        yield from _alone(iter(suspects), asked)
        suspects.clear()


def _together(
    posed: Iterator[Posed], asked: Asked, workers: int, suspects: list[Posed]
) -> Iterator[Chunk]:
    """Plan until there are no more problems, or until a process dies with what is added then."""
    flying: dict[Future[Chunk], list[Posed]] = {}
    size = _FIRST
    with _processes(workers) as submit:
        while True:
            while not suspects and len(flying) < _EACH * workers:
                if not (chunk := list(itertools.islice(posed, size))):
                    break
                try:
                    flying[submit(chunk, asked)] = chunk
                except BrokenProcessPool:
                    suspects += chunk
            if not flying:
                return
            for future in wait(flying, return_when=FIRST_COMPLETED).done:
                chunk = flying.pop(future)
                try:
                    found = future.result()
                except BrokenProcessPool:
                    suspects += chunk
                    continue
                size = max(1, min(_MOST, round(len(chunk) * CHUNK_S / found.wall_s)))
                yield found


def _alone(suspects: Iterator[Posed], asked: Asked) -> Iterator[Chunk]:
    """Plan problems one at a time, each in a process that none has ended before."""
    while (one := next(suspects, None)) is not None:
        with _processes(1) as submit:
            while one is not None:
                try:
                    yield submit([one], asked).result()
                except BrokenProcessPool:
                    yield failed(one, asked, "every process that planned it died")
                    break
                one = next(suspects, None)


@contextmanager
def _processes(count: int) -> Iterator[Submit]:
    """Processes that plan chunks; they never see Ctrl-C, and are gone at the end, busy or not."""
    others = {process.pid for process in active_children()}
    pool = ProcessPoolExecutor(count, get_context("spawn"), _end_with_parent)

    def submit(posed: list[Posed], asked: Asked) -> Future[Chunk]:
        with _inherited():  # by the process that this may start
            return pool.submit(plan_chunk, posed, asked)

    try:
        yield submit
    finally:
        for process in active_children():
            if process.pid not in others:
                process.terminate()
        pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """End this process when the one that started it ends, even by ``kill -9``."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _inherited() -> Iterator[None]:
    """Have processes that are started use one core, and never see Ctrl-C, which waits meanwhile.

    They inherit the environment and the mask of signals.
    """
    outside = {name: os.environ.get(name) for name in _ONE_CORE}
    masks = hasattr(signal, "pthread_sigmask")
    resource_tracker.ensure_running()  # would start with the first of them, and drop the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masks else set()
    os.environ.update(_ONE_CORE)
    try:
        yield
    finally:
        for name, value in outside.items():
            del os.environ[name]
            os.environ.update({} if value is None else {name: value})
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
