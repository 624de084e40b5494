"""Effort is limited by work that is counted: the same plan on every machine, however busy."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from once import solved

from twosra_mpc import Problem, Status, effort, load_problem, load_robot, plan, scenario_names
from twosra_mpc.effort import (
    OVERTIME,
    OVERTIME_S,
    Cost,
    Ending,
    OutOfEffortError,
    charge,
    lend_overtime,
    limit_reached,
    limited,
    out_of_effort,
    remembered,
    spent,
)
from twosra_mpc.planning.solver import fixed_sequence
from twosra_mpc.planning.solver.multiple_shooting import ipopt
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.space.minkowski import parts_around
from twosra_mpc.space.possible import blocked_unit
from twosra_mpc.space.separation import Surroundings

UNIT = 10_000  # of `Cost.KEPT`, which is the smallest


def do(units: float) -> None:
    charge(Cost.KEPT, round(UNIT * units))


def test_a_limit_holds_inside_another_and_no_longer() -> None:
    assert not out_of_effort()
    with limited(1000.0, math.inf):
        do(900.0)
        with limited(5000.0, math.inf):  # the outer one holds, too
            do(99.0)
            assert limit_reached() is None
            do(2.0)
            assert limit_reached() == "work_limit"
            with pytest.raises(OutOfEffortError):
                do(OVERTIME)
        assert out_of_effort()
    assert not out_of_effort()


def test_no_more_is_ever_spent_than_the_limit_and_the_overtime() -> None:
    with limited(10.0, math.inf):
        do(9.0)
        do(OVERTIME)  # begun in time
        with pytest.raises(OutOfEffortError):
            do(1e9)
        assert spent() == 10.0 + OVERTIME
        lend_overtime()
        do(OVERTIME)
        with pytest.raises(OutOfEffortError):
            do(1e-4)
        assert spent() == 10.0 + 2 * OVERTIME


def test_cpu_time_is_the_backstop_and_sleeping_costs_nothing() -> None:
    with limited(math.inf, 0.05):
        time.sleep(0.2)
        assert not out_of_effort()
        begun = time.process_time()
        while time.process_time() < begun + 0.05:
            pass
        assert limit_reached() == "time_limit_s"
        do(10.0)  # begun in time
        while time.process_time() < begun + 0.05 + OVERTIME_S:
            pass
        with pytest.raises(OutOfEffortError):
            do(10.0)


def test_what_is_remembered_costs_as_much_once_under_each_limit() -> None:
    """In the middle of other work, where other work made it, and where the limit ends it."""

    @remembered(8)
    def square(x: int) -> int:
        do(x)
        return x * x

    @remembered(8)
    def fourth(x: int) -> int:
        return square(square(x))

    costs, ends = [], []
    for _ in range(2):
        with limited(1000.0, math.inf):
            do(1.0)
            assert (square(3), fourth(3), square(9), fourth(3)) == (9, 81, 81, 81)
            costs.append(spent())
        with limited(5.0, math.inf):
            with pytest.raises(OutOfEffortError):
                fourth(30)
            ends.append(spent())
    assert costs == [1.0 + 3 + 9] * 2
    assert ends[0] == ends[1]


LONG: dict[str, dict[str, object]] = {  # each would take far more than it may
    "grasp-cube": {},
    "rigid-move": {
        "goal": {"x_m": 60.0, "y_m": -40.0},
        "workspace": {"x_m": [-99.0, 99.0], "y_m": [-99.0, 99.0]},
        "gap": 0.0,
    },
    "doorway": {},
    "three-segments": {"gap": 0.0, "max_phases": 12},
}


@pytest.mark.parametrize("name", LONG)
def test_what_takes_long_is_stopped(name: str) -> None:
    made = plan(load_problem(name, work_limit=50.0, **LONG[name]))
    assert made.stats.work is not None
    assert made.stats.work <= 50.0 + 2 * OVERTIME
    assert made.ending is Ending.LIMIT
    assert "raise work_limit" in made.message


@pytest.mark.parametrize("name", ["grasp-cube", "doorway"])
def test_cpu_time_stops_it_too(name: str) -> None:
    limit_s, began = 0.05, time.process_time()
    made = plan(load_problem(name, time_limit_s=limit_s))
    assert time.process_time() - began < limit_s + 1.0  # what is loaded counts
    assert made.ending is Ending.LIMIT
    assert "raise time_limit_s" in made.message


def test_an_nlp_stops_after_an_iteration_and_says_it_was_the_limit() -> None:
    problem = load_problem("rigid-move", gap=0.0)
    program, solver, _ = ipopt(problem.robot, None, 1, 10, 2, 150)
    size, rows = program.nlp["x"].numel(), program.nlp["g"].numel()
    call = partial(solver, x0=np.ones(size), p=1.0, lbg=-np.ones(rows), ubg=np.ones(rows))
    call()
    assert solver.stats()["iter_count"] > 1
    with limited(-OVERTIME, math.inf):
        call()
    assert solver.stats()["iter_count"] <= 1
    status = fixed_sequence.solve_status(solver.stats()["return_status"])
    assert status is fixed_sequence.SolveStatus.LIMIT


# --- the same plan ------------------------------------------------------------------------------

STOPPED: dict[str, tuple[float, dict[str, object]]] = {  # each by its limit, in the middle of it
    "rigid-move": (150.0, {"gap": 0.0}),
    "paper-3": (100.0, {"gap": 0.0}),
    "three-shapes": (100.0, {}),
    "scattered": (500.0, {}),
}


def stopped(name: str) -> Problem:
    work, given = STOPPED[name]
    return load_problem(name, work_limit=work, **given)


def as_written(made: Result) -> str:
    """The plan file, but for the time that it took by the clock."""
    document = made.to_dict()
    del document["stats"]["wall_s"]
    return json.dumps(document)


def elsewhere() -> dict[str, str]:
    """The plan files as another process writes them, with other hashes."""
    words = (
        "import json; from test_effort import STOPPED, as_written, stopped; "
        "from twosra_mpc import plan; "
        "print(json.dumps({name: as_written(plan(stopped(name))) for name in STOPPED}))"
    )
    made = subprocess.run(
        [sys.executable, "-c", words],
        env={**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": str(Path(__file__).parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    found: dict[str, str] = json.loads(made.stdout)
    return found


def test_the_plan_is_the_same_beside_a_load_with_other_hashes_and_after_other_plans() -> None:
    """To the byte: cold, and with everything known that earlier plans of a process leave."""
    with ThreadPoolExecutor(1) as at_once:  # each is the other's load
        other = at_once.submit(elsewhere)
        first, second = (
            {name: as_written(plan(stopped(name))) for name in STOPPED} for _ in range(2)
        )
    assert other.result() == first
    assert first == second


@pytest.mark.parametrize(
    ("name", "given", "limits"),
    [
        ("rigid-move", {"gap": 0.0}, (1.0, 10.0, 30.0, 100.0, 300.0, 1000.0)),
        ("paper-5", {"gap": 0.0, "max_phases": 4}, (1.0, 5.0, 10.0, 20.0, 40.0, 80.0)),
        ("three-shapes", {}, (10.0, 300.0, 450.0, 800.0, 1200.0)),
    ],
)
def test_more_work_never_finds_a_worse_plan_nor_proves_less(
    name: str, given: dict[str, object], limits: tuple[float, ...]
) -> None:
    cost, proved, first = math.inf, -math.inf, None
    for work in limits:
        made = plan(load_problem(name, work_limit=work, motion="fastest", **given))
        assert first in (None, made.stats.first_plan_work)
        first = made.stats.first_plan_work
        now = math.inf if made.plan is None else made.plan.cost.total
        assert now <= cost
        assert (made.lower_bound or 0.0) >= proved
        cost, proved = now, made.lower_bound or 0.0
    assert cost < math.inf


# --- what plans may cost ------------------------------------------------------------------------

_FIRST, _WHOLE = 450.0, 700.0  # of every built-in scenario [units]


@pytest.mark.parametrize("name", scenario_names())
def test_a_built_in_scenario_has_a_plan_soon_and_reaches_its_gap(name: str) -> None:
    made = solved(name)
    assert made.stats.work is not None
    assert made.stats.work <= _WHOLE
    if name == "blocked":
        assert made.status is Status.INFEASIBLE
        return
    assert made.status is Status.OPTIMAL, made.message
    assert made.stats.first_plan_work is not None
    assert made.stats.first_plan_work <= (650.0 if name == "corridor" else _FIRST)


def test_every_cost_is_a_whole_number_that_counts() -> None:
    costs = {name: cost for name, cost in vars(Cost).items() if not name.startswith("_")}
    assert all(isinstance(cost, int) and cost > 0 for cost in costs.values())
    assert effort.Cost.KEPT == min(costs.values()) == 1


def fine_outline(corners: int = 400) -> Obstacle:
    """A rough disc, drawn with many corners."""
    rng, angles = np.random.default_rng(1), np.linspace(0.0, 2 * np.pi, corners, endpoint=False)
    radii = 0.05 * (1 + rng.uniform(-0.02, 0.02, corners))
    points = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return Obstacle(polygon_m=tuple(map(tuple, points.tolist())))


@pytest.mark.parametrize("name", ["merged", "parts", "grown"])
def test_what_fine_outlines_cost_is_charged_as_it_is_done(name: str) -> None:
    """Forty of them took half a minute more than a limit of 3 s, and half a gigabyte."""
    world, geometry = World(obstacles=[fine_outline()]), load_robot("2sra-v1").geometry
    begin, end = np.zeros(5), np.array([0.5, 0.0, 0.0, 0.0, 0.0])
    work = {
        "merged": lambda: parts_around(world.obstacles, 0.0),
        "parts": lambda: Surroundings(world, 0.002),
        "grown": lambda: blocked_unit(geometry, world, begin, end, 0.0),
    }
    with pytest.raises(OutOfEffortError), limited(2.0 - OVERTIME, math.inf):
        work[name]()
