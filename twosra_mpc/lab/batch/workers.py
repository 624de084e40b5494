"""Chunks of problems on a Dask cluster: alone it knows Dask, which plans, retries and balances."""

from __future__ import annotations

import asyncio
import itertools
import logging
import signal
import warnings
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing import resource_tracker
from tempfile import TemporaryDirectory

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, Worker, as_completed, rpc

from twosra_mpc.errors import InputError
from twosra_mpc.installation import __version__
from twosra_mpc.lab.batch.folder import Asked, Chunk, failed, plan_chunk
from twosra_mpc.lab.batch.problems import Posed

CHUNK_S = 1.0  # what a task should take
_FIRST, _MOST = 2, 500  # problems in the first chunks, and at most
_EACH = 2  # chunks on their way for each worker: one is planned, one waits
_ANSWER_S = 10.0  # within which a scheduler answers [s]
_LOOPBACK = "127.0.0.1"  # neither scheduler nor dashboard asks who is there
# Numerical libraries would start a thread for every core in every worker.
_ONE_CORE = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}

_scratch = partial(TemporaryDirectory, prefix="twosra-batch-", ignore_cleanup_errors=True)

# 100 looks a second at every process, and 50 ticks, cost 4 % of a core with two workers.
_SELDOM = {"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "500ms"}


@contextmanager
def local_cluster(workers: int | None) -> Iterator[Client]:
    """Start workers on this machine, each a process of one thread; by default one a core."""
    with _quiet(), _scratch() as folder, ExitStack() as stack:
        stack.enter_context(dask.config.set(_SELDOM | {"temporary-directory": folder}))
        with _interrupts_not_for_children():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host=_LOOPBACK,
                dashboard_address=f"{_LOOPBACK}:0",
                env=_ONE_CORE,
                silence_logs=logging.CRITICAL,
            )
            stack.enter_context(cluster)
        yield stack.enter_context(Client(cluster, set_as_default=False))


@contextmanager
def cluster_at(scheduler: str) -> Iterator[Client]:
    """Connect to a Dask scheduler, and check it and its workers.

    Raises:
        InputError: If it does not answer, it or a worker has another version of this package, or a
            worker several threads.
    """
    with _quiet():
        try:
            asyncio.run(_identity(scheduler))
        except Exception as error:  # who knows what a server answers that is no scheduler
            reason = str(error) or type(error).__name__
            allowed = f"tcp://host:port of one that answers within {_ANSWER_S:zg} s ({reason})"
            raise InputError("--scheduler", scheduler, allowed) from error
        with Client(scheduler, set_as_default=False) as client:
            _check_versions(client, scheduler)
            yield client


def planned(client: Client, posed: Iterator[Posed], asked: Asked) -> Iterator[Chunk]:
    """Plan problems on a cluster; yields what chunks of them came to, as they finish.

    What a dying worker was at, Dask gives to another one. Problems that took several workers with
    them in a row are planned once more in the end, one at a time: those that do it again are
    called failed.

    Raises:
        InputError: If the scheduler goes, or a worker of another version has come.
    """
    suspects: list[Posed] = []
    try:
        yield from _together(client, posed, asked, suspects)
        for one in suspects:
            try:
                yield client.submit(plan_chunk, [one], asked, pure=False).result()
            except KilledWorker as error:
                yield failed(one, asked, f"every worker that planned it died: {error}")
    except CancelledError as error:
        address = client.scheduler.address if client.scheduler else "unknown"
        allowed = "a scheduler that stays; what is finished is kept, the same command goes on"
        raise InputError("--scheduler", address, allowed) from error


def _together(
    client: Client, posed: Iterator[Posed], asked: Asked, suspects: list[Posed]
) -> Iterator[Chunk]:
    """Plan all but problems that kill workers; these are added to the suspects."""
    flying: dict[Future[Chunk], list[Posed]] = {}
    finished = as_completed(loop=client.loop)
    size = _FIRST

    def fill() -> None:
        most = _EACH * max(1, len(client.nthreads()))
        while len(flying) < most and (chunk := list(itertools.islice(posed, size))):
            future = client.submit(plan_chunk, chunk, asked, pure=False)
            flying[future] = chunk
            finished.add(future)

    fill()
    for future in finished:
        chunk = flying.pop(future)
        try:
            found = future.result()
        except KilledWorker:
            suspects += chunk
            fill()
            continue
        size = max(1, min(_MOST, round(len(chunk) * CHUNK_S / found.wall_s)))
        fill()
        yield found


async def _identity(address: str) -> None:
    """Ask a scheduler who it is; a Client that fails takes half a minute to go."""
    async with asyncio.timeout(_ANSWER_S), rpc(address) as scheduler:
        await scheduler.identity()


def about_worker(dask_worker: Worker) -> tuple[str, int]:
    """Version of this package on a worker, and how many threads it has."""
    return __version__, dask_worker.state.nthreads


def about_scheduler() -> tuple[str, int]:
    """Version of this package on a scheduler, which reads tasks, too."""
    return __version__, 1


def _check_versions(client: Client, scheduler: str) -> None:
    found = client.run(about_worker, on_error="return")
    try:
        found[scheduler] = client.run_on_scheduler(about_scheduler)
    except Exception as error:  # whatever it lacks
        found[scheduler] = error
    for address, told in found.items():
        who = "scheduler" if address == scheduler else "worker"
        if isinstance(told, Exception):
            raise InputError(f"{who} {address}", str(told), f"one with twosra_mpc {__version__}")
        version, threads = told
        if version != __version__:
            allowed = f"{__version__}, the version here: plans of two versions are no table"
            raise InputError(f"{who} {address}: version of twosra_mpc", version, allowed)
        if threads != 1:
            raise InputError(f"{who} {address}: threads", threads, "1: dask worker --nthreads 1")


@contextmanager
def _quiet() -> Iterator[None]:
    """Nobody needs to know of taken ports or restarted workers: results say what is wrong."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    finally:
        logging.disable(before)


@contextmanager
def _interrupts_not_for_children() -> Iterator[None]:
    """Have processes that are started never see Ctrl-C: this one ends them. One meanwhile waits.

    They inherit the mask of signals. So does the thread that starts others in their place.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # would start with the first of them, and drop the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
