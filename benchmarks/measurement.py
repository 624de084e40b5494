"""Timing: warm calls, repeated, those of different functions in turns within one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

Result = TypeVar("Result")


@dataclass(frozen=True)
class Timing:
    """Times of repeated calls of one function.

    Attributes:
        first_s: Wall time of the first call, which may build functions.
        wall_s: Wall times of the calls after it.
        cpu_s: CPU times of the same calls.
    """

    first_s: float
    wall_s: tuple[float, ...]
    cpu_s: tuple[float, ...]

    @property
    def median_s(self) -> float:
        """Median wall time of a warm call."""
        return statistics.median(self.wall_s)

    @property
    def cpu_median_s(self) -> float:
        """Median CPU time of a warm call: its wall time, had the CPU been free."""
        return statistics.median(self.cpu_s)

    @property
    def cpu_share(self) -> float:
        """CPU time over wall time of the warm calls; less than 1 where others used the CPU."""
        return sum(self.cpu_s) / sum(self.wall_s)


@dataclass
class _Calls:
    first_s: float
    wall_s: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)


def timed_in_turns(
    functions: Mapping[str, Callable[[], Result]], repeats: int, budget_s: float
) -> dict[str, tuple[Result, Timing]]:
    """Call each function once, then all of them in turns ``repeats`` times.

    A function whose repeats took ``budget_s`` together is not called again. The result is that of
    the last call.
    """
    results: dict[str, Result] = {}
    calls: dict[str, _Calls] = {}
    for name, function in functions.items():
        started = time.perf_counter()
        results[name] = function()
        calls[name] = _Calls(time.perf_counter() - started)
    for _ in range(repeats):
        for name, function in functions.items():
            made = calls[name]
            if sum(made.wall_s) >= budget_s:
                continue
            wall, cpu = time.perf_counter(), time.process_time()
            results[name] = function()
            made.wall_s.append(time.perf_counter() - wall)
            made.cpu_s.append(time.process_time() - cpu)
    return {
        name: (results[name], Timing(made.first_s, tuple(made.wall_s), tuple(made.cpu_s)))
        for name, made in calls.items()
    }
