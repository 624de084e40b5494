"""Timing: warm calls, repeated, those of different functions in turns within one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

Result = TypeVar("Result")


@dataclass(frozen=True)
class Timing:
    """Times of repeated calls of one function.

    Attributes:
        first_s: Wall time of the first call, which may build functions.
        wall_s: Wall times of the calls after it; of the first, where it was too long for others.
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


def timed_in_turns(
    functions: Mapping[str, Callable[[], Result]], repeats: int, budget_s: float
) -> dict[str, tuple[Result, Timing]]:
    """Call each function once, then all of them in turns ``repeats`` times.

    A function whose repeats took ``budget_s`` together is not called again; where the first call
    took as long, that one counts. The result is that of the last call.
    """
    results: dict[str, Result] = {}
    made: dict[str, list[tuple[float, float]]] = {name: [] for name in functions}
    for _ in range(1 + repeats):
        for name, function in functions.items():
            first, *warm = [wall for wall, _ in made[name]] or [0.0]
            if max(first, sum(warm)) >= budget_s:
                continue
            wall, cpu = time.perf_counter(), time.process_time()
            results[name] = function()
            made[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: (results[name], _timing(calls)) for name, calls in made.items()}


def _timing(calls: Sequence[tuple[float, float]]) -> Timing:
    """Timing from the (wall, CPU) times of all calls; a single call counts as a warm one."""
    warm = calls[1:] or calls
    return Timing(calls[0][0], tuple(wall for wall, _ in warm), tuple(cpu for _, cpu in warm))
