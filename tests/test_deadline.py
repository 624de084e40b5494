"""Time limits hold wherever planning goes; what is known by then is returned."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from twosra_mpc import Problem, load_problem, plan
from twosra_mpc.deadline import (
    OVERTIME_S,
    OutOfTimeError,
    check_time,
    out_of_time,
    overtime_left_s,
    time_limit,
)
from twosra_mpc.planning.nlp import fixed_sequence
from twosra_mpc.planning.nlp.multiple_shooting import ipopt
from twosra_mpc.plans.ending import Ending


def test_a_limit_holds_inside_another_and_no_longer() -> None:
    assert not out_of_time()
    with time_limit(1000.0):
        with time_limit(1e-9):
            assert out_of_time()
            check_time()  # there is some overtime
            with time_limit(5000.0):
                assert overtime_left_s() < OVERTIME_S
            with pytest.raises(OutOfTimeError):
                check_time(OVERTIME_S + 1.0)
        assert 990.0 < overtime_left_s() < 1001.0
    assert overtime_left_s() == np.inf


def mission(name: str, **changes: object) -> Callable[[float], Problem]:
    return lambda limit_s: load_problem(name, time_limit_s=limit_s, **changes)


FAR = {"x_m": 60.0, "y_m": -40.0}
ROOM = {"x_m": [-99.0, 99.0], "y_m": [-99.0, 99.0]}
LONG = {  # each would take seconds more than it may
    "contacts": mission("grasp-cube"),
    "a far goal, all of it inside": mission("rigid-move", goal=FAR, workspace=ROOM, gap=0.0),
    "slices": mission("doorway"),
    "roads": mission("scattered"),
    "compiling": mission("three-segments", gap=0.0),
}


@pytest.mark.parametrize("name", LONG)
def test_what_takes_long_is_stopped(name: str) -> None:
    """In CPU time: other programs are at work, too."""
    limit_s = 0.05
    problem = LONG[name](limit_s)
    began = time.process_time()
    made = plan(problem)
    assert time.process_time() - began < limit_s + 1.0
    assert made.ending in (Ending.LIMIT, None)
    assert "raise time_limit_s" in made.message


def test_an_nlp_stops_after_an_iteration_and_says_it_was_the_limit() -> None:
    problem = load_problem("rigid-move", gap=0.0)
    program, solver, _ = ipopt(problem.robot, None, 1, 10, 2, 150)
    size, rows = program.nlp["x"].numel(), program.nlp["g"].numel()
    call = partial(solver, x0=np.ones(size), p=1.0, lbg=-np.ones(rows), ubg=np.ones(rows))
    call()
    assert solver.stats()["iter_count"] > 1
    with time_limit(-2 * OVERTIME_S):
        call()
    assert solver.stats()["iter_count"] <= 1
    status = fixed_sequence.solve_status(solver.stats()["return_status"])
    assert status is fixed_sequence.SolveStatus.LIMIT
