"""How much work a first plan among obstacles and objects is, counted; and what is made at once."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from twosra_mpc import Obstacle, Result, load_problem, plan
from twosra_mpc.planning.obstacles.placement import Placer
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space import drives, slices, sweep


class FirstPlanError(Exception):
    """There is a first plan: no more is asked."""


def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count what making plans is made of: sums of polygons, legs tried, plans verified."""
    work: Counter[str] = Counter()
    sums, legs, made = slices.minkowski_sums, sweep.clear_legs, Placer._made

    def count_sums(first: Array, second: Array) -> Array:
        here = int(np.prod(first.shape[:-2])) * len(second)
        work["sums"] += here
        work["at once"] = max(work["at once"], here)
        return sums(first, second)

    def count_legs(clear: Any, start: Array, *given: Any) -> Any:
        work["legs"] += len(start)
        return legs(clear, start, *given)

    def count_plans(*given: Any) -> Any:
        work["plans"] += 1
        found = made(*given)
        if found is not None:
            raise FirstPlanError
        return found

    monkeypatch.setattr(slices, "minkowski_sums", count_sums)
    monkeypatch.setattr(drives, "clear_legs", count_legs)
    monkeypatch.setattr(Placer, "_made", count_plans)
    return work


@pytest.mark.parametrize(
    "name",
    ["scattered", "doorway", "corridor", "conform-cylinder", "grasp-cube", "pick-and-place", "tidy-up"],
)
def test_a_first_plan_is_little_work(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    work = counted(monkeypatch)
    with pytest.raises(FirstPlanError):
        plan(load_problem(name))
    print(name, work)
    assert work["plans"] == 1
