"""What a process keeps does not grow with what it has planned."""

from __future__ import annotations

import ast
import copy
import gc
import pickle
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from problems import ROBOT

import twosra_mpc
from twosra_mpc import load_problem, load_robot, plan
from twosra_mpc.model.cache import BODIES, per_body, per_function
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.rows import by_rows
from twosra_mpc.planning.solver.multiple_shooting import transcribe
from twosra_mpc.robot.description import Robot

PACKAGE = Path(twosra_mpc.__file__).parent
FEW = {  # functions asked for few things ever, so that their caches need no bound
    "cli/doctor.py": "_packages_of_modules: of nothing",
    "arguments.py": "checks: of nothing, for each public function",
    "files.py": "environment: of a few folders of templates",
    "model/chain.py": "_series: three series",
    "problem/geojson.py": "_units_of_codes: of nothing",
    "keys.py": "_words: of nothing",
    "lab/figures/paper_figures.py": "both_plans: five tasks",
    "lab/reproduction/published_runs.py": "run, run_freely: five simulations",
    "planning/relaxation.py": "rate, speed_m_s: modes of one problem, gone with its search",
    "planning/stages/variants.py": "handling: of nothing, gone with its ways",
    "timing/thermal.py": "least: gone once its segments have been asked for",
}


def test_every_cache_has_a_bound() -> None:
    unbounded = set()
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "cache" in text else ():
            name = node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")
            if name == "cache" or (name == "lru_cache" and "lru_cache(None" in ast.unparse(node)):
                unbounded.add(path.relative_to(PACKAGE).as_posix())
    assert unbounded == set(FEW)


def robots(count: int) -> list[Robot]:
    """Robots of different limits, hence of different compiled functions."""
    speeds_m_s = ROBOT.limits.unit_speed_m_s * np.linspace(0.9, 0.99, count)
    return [
        ROBOT.with_values(limits=ROBOT.limits.with_values(unit_speed_m_s=speed))
        for speed in speeds_m_s.tolist()
    ]


@pytest.fixture
def alive() -> Iterator[Callable[[], int]]:
    """How many functions there are, but for those of before: to look at all takes a second."""

    def count() -> int:
        gc.collect()
        return sum(isinstance(each, ca.Function) for each in gc.get_objects())

    gc.collect()
    gc.freeze()
    yield count
    gc.unfreeze()


def test_no_more_functions_are_kept_of_many_robots_than_of_few(alive: Callable[[], int]) -> None:
    problem, kept, compiled = load_problem("paper-1"), [], []
    for robot in robots(BODIES + 2):
        assert plan(problem.with_values(robot=robot)).plan is not None
        compiled.append(weakref.ref(kinematics(robot)))
        kept.append(alive())
    assert max(kept[BODIES:]) <= kept[BODIES]
    assert [each() is not None for each in compiled] == [False] * 2 + [True] * BODIES


def test_what_is_made_of_a_body_goes_with_it() -> None:
    made: list[float] = []

    @per_body(2, bodies=1)
    def compiled(body: object, number: int) -> int:
        made.append(number)
        return number

    one, other = robots(2)
    assert [compiled(one, number) for number in (1, 2, 1, 2)] == [1, 2, 1, 2]
    assert made == [1, 2]
    compiled(one, 3), compiled(one, 1)
    assert made == [1, 2, 3, 1]
    compiled(other, 1), compiled(one, 1)
    assert made == [1, 2, 3, 1, 1, 1]


def test_robots_that_move_alike_have_one_body_as_long_as_any_of_them_lives() -> None:
    again = load_robot(ROBOT.name).with_values(name="another")
    assert again.body is ROBOT.body
    assert pickle.loads(pickle.dumps(ROBOT)).body is copy.deepcopy(ROBOT).body is ROBOT.body
    limits = ROBOT.limits.with_values(unit_speed_m_s=0.0123)  # for which nothing was compiled
    other = ROBOT.with_values(limits=limits)
    kept = weakref.ref(other.body)
    assert kept() is not ROBOT.body
    del other
    gc.collect()
    assert kept() is None


def test_a_copy_with_other_values_keeps_nothing_that_was_worked_out_of_the_old_ones() -> None:
    problem = load_problem("paper-1")
    assert problem.start_mode == (0, 0)
    changes = {"start": problem.start.with_values(temperature_C=(64.0, 64.0))}
    for warm in (problem.model_copy(update=changes), problem.with_values(**changes)):
        assert warm.start_mode == (1, 1)


def test_what_is_made_of_a_function_goes_with_it(alive: Callable[[], int]) -> None:
    x = ca.SX.sym("x")

    @per_function()
    def doubled(function: ca.Function) -> ca.Function:
        return ca.Function("twice", [x], [2 * function(x)])

    before, square = alive(), ca.Function("square", [x], [x**2])
    assert float(doubled(square)(3)) == 18.0
    assert doubled(square) is doubled(square)
    del square
    assert alive() == before


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 1000])
def test_rows_are_evaluated_in_blocks_as_one_by_one(count: int) -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ca.vertcat(x * y, ca.sin(x[0])), x[1] - y])
    rng = np.random.default_rng(count)
    a, b = rng.normal(size=(count, 2)), rng.normal(size=(count, 1))
    first, second = by_rows(function, a, b)
    np.testing.assert_array_equal(first, np.column_stack([a * b, np.sin(a[:, :1])]))
    np.testing.assert_array_equal(second, a[:, 1:] - b)


def test_threads_evaluate_rows_of_one_function_at_once() -> None:
    x = ca.SX.sym("x", 3)
    function = ca.Function("f", [x], [ca.sin(x) @ x.T])
    given = np.random.default_rng(0).normal(size=(40, 200, 3))
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda rows: by_rows(function, rows)[0], given))
    np.testing.assert_array_equal(found, [by_rows(function, rows)[0] for rows in given])


def test_long_arrays_of_any_length_share_one_function(alive: Callable[[], int]) -> None:
    x = ca.SX.sym("x")
    function, kept = ca.Function("f", [x], [2 * x]), []
    for count in (640, 1015, 5000):
        by_rows(function, np.ones((count, 1)))
        kept.append(alive())
    assert kept == kept[:1] * 3


def test_programs_of_one_robot_share_its_flow() -> None:
    """Its derivatives weigh ten times what else a program does."""

    def flows(phases: int) -> set[int]:
        nlp = transcribe(ROBOT, None, phases, 2, 2).nlp
        within = ca.Function("g", [nlp["x"], nlp["p"]], [nlp["g"]]).find_functions()
        return {hash(each) for each in within if each.name() == "interval_flow"}

    assert len(flows(1)) == 1
    assert flows(1) == flows(2)
