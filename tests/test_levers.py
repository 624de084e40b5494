"""The lever of the wheels on a segment that is soft alone, and what it forbids."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from problems import bold

from twosra_mpc import Goal, Problem, Start, load_plan, load_problem, load_robot, plan
from twosra_mpc.checking.levers import bend_levers as own_levers
from twosra_mpc.checking.verification import verify
from twosra_mpc.lab.analysis.explanation import explain
from twosra_mpc.model.bending import bending
from twosra_mpc.model.kinematics import bend_levers, kinematics
from twosra_mpc.model.rows import by_rows
from twosra_mpc.planning.bounds.detours import COARSE, FINE, Detours
from twosra_mpc.planning.solver.shape_plane import cells_of
from twosra_mpc.problem.limits import bend_margins, broken_by_shapes, singular_bend
from twosra_mpc.robot.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode

ARC = load_robot("2sra-v1")
ONE_AT_A_TIME = (RIGID, SOFT_1, SOFT_2)


@pytest.mark.parametrize("name", ["2sra-v1", "3sra", "2sr-v2"])
def test_levers_are_zero_where_four_wheels_do_not_determine_pose_and_bend(name: str) -> None:
    """By two accounts, whatever the wheels; the determinant of the exact map is another one."""
    robot, rng = load_robot(name), np.random.default_rng(0)
    shapes = rng.uniform(-1, 1, (50, robot.geometry.segments)) * robot.limits.curvature_per_m
    (levers,) = by_rows(bend_levers(robot.body), shapes)
    for j, length_m in enumerate(robot.geometry.lengths_m):
        np.testing.assert_allclose(levers[:, j], own_levers(robot, shapes, j), atol=1e-12)
        lost = []
        for kappa in shapes:
            whole = kinematics(robot).wheel_map(kappa).full() * robot.geometry.wheel_radius_m
            rigid = whole[:, :3].T @ whole[:, :3]
            lost.append(np.linalg.det(whole[:, [0, 1, 2, 3 + j]]) / np.sqrt(np.linalg.det(rigid)))
        share = levers[:, j] * length_m**2 / np.array(lost)
        np.testing.assert_allclose(share, share[0], rtol=1e-6)


def test_the_paper_robots_singular_curve() -> None:
    for shape in ((5.7, -13.0), (-3.0, 0.0), (-11.7, 13.0), (-19.8, 25.0)):
        both = np.array([shape, (-shape[1], -shape[0])])
        levers = by_rows(bend_levers(ARC.body), both)[0]
        assert abs(levers[0, 0]) < 0.01
        assert levers[1, 1] == pytest.approx(-levers[0, 0], abs=1e-9)


BENDS = [  # of segment 1, beside that of segment 2 [1/m]; whether it arrives in MuJoCo
    (-11.0, 38.0, -13.0, False),
    (38.0, -11.0, -13.0, True),
    (-14.2, 8.8, -13.0, False),
    (-14.2, 4.3, -13.0, True),
    (17.0, -23.0, 0.0, False),
    (-23.0, 17.0, 0.0, True),
    (-9.0, -23.0, 0.0, True),
    (34.0, 20.0, -25.0, False),
    (0.0, -2.2, 0.0, True),
]


@pytest.mark.parametrize(("begin", "end", "beside", "arrives"), BENDS)
def test_bends_that_stick_in_a_rigid_body_engine_are_forbidden(
    begin: float, end: float, beside: float, arrives: bool
) -> None:
    bends = np.linspace(begin, end, 12)
    shapes = np.column_stack([bends, np.full(12, beside)])
    assert (bend_margins(ARC, SOFT_1, shapes).min() >= 0) == arrives
    mirrored = -shapes[:, ::-1]
    assert (bend_margins(ARC, SOFT_2, mirrored).min() >= 0) == arrives
    assert np.isinf(bend_margins(ARC, SOFT_BOTH, shapes)).all()
    assert np.isinf(bend_margins(bold(ARC), SOFT_1, shapes)).all()


@pytest.mark.parametrize("seed", range(60))
def test_bounds_forbid_only_bends_that_no_verified_plan_makes(seed: int) -> None:
    """Boxes of starts and of ends; every bend from one into the other breaks the limit."""
    robot, rng = (ARC, load_robot("3sra"))[seed % 2], np.random.default_rng(seed)
    n = robot.geometry.segments
    j, off = int(rng.integers(n)), rng.uniform(0, 1.5, n) * (rng.random() < 0.5)
    begin, end = rng.uniform(-40, 40, (2, n))
    way = np.tile(begin, (41, 1))
    way[:, j] = np.linspace(begin[j], end[j], 41)
    mode = tuple(int(k == j) for k in range(n))
    if singular_bend(robot, mode, way, off, None) is None:
        return
    for _ in range(20):
        shapes = way + rng.uniform(-off, off)
        shapes[-1, j] = end[j] + math.copysign(rng.uniform(0, 20), end[j] - begin[j])
        fine = np.tile(shapes[0], (2000, 1))
        fine[:, j] = np.linspace(shapes[0, j], shapes[-1, j], 2000)
        assert bend_margins(robot, mode, fine).min() < 0


def test_an_order_of_modes_that_crosses_is_proved_impossible_and_refused() -> None:
    """Both orders of paper-3 one segment at a time; a forged plan, and a file of before."""
    asked = load_problem("paper-3", modes=ONE_AT_A_TIME)
    made, forged = plan(asked).require(), plan(asked.with_values(robot=bold(ARC))).require()
    assert forged.cost.total < 550 < 770 < (made.lower_bound or 0.0) <= made.cost.total
    assert made.verification.limits["bend_lever"] >= 0
    told = verify(replace(forged.trajectory, problem=asked))
    assert told.problems == (told.problems[0],)
    assert "limit bend_lever exceeded" in told.problems[0]
    words = "wheels lose hold of segment 1, soft alone: bend_lever < 0.6"
    assert words in plan(asked.with_values(max_phases=4)).message
    cost = next(o for o in explain(asked).alternatives if o.change.startswith("without the limit"))
    assert cost.price == f"{-(cost.difference_s or 0.0):.2f} s less"
    assert (cost.difference_s or 0.0) < -200


@pytest.mark.parametrize("crossing", [False, True])
def test_a_plan_file_of_before_is_checked_with_the_limit(crossing: bool, tmp_path: Path) -> None:
    robot = bold(ARC) if crossing else ARC
    made = plan(load_problem("paper-3", modes=ONE_AT_A_TIME).with_values(robot=robot))
    document = made.to_dict()
    del document["robot"]["limits"]["bend_lever"]
    document["verification"]["limits"].pop("bend_lever", None)
    path = tmp_path / "old.json"
    path.write_text(json.dumps(document))
    assert load_plan(path).found is not crossing


@pytest.mark.parametrize("seed", range(2))
def test_of_all_sequences_the_planner_finds_the_best_that_keeps_its_levers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begin, end = rng.uniform(-30, 30, (2, 2))
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=tuple(begin))
    asked = Problem(robot=ARC, start=start, goal=Goal(kappa_per_m=tuple(end)), motion="fastest")
    asked = asked.with_values(max_phases=4, gap=1e-4)
    found, single = plan(asked), list[float]()
    for soft in itertools.chain(*(itertools.combinations(MODES[1:], k) for k in (1, 2))):
        alone = plan(asked.with_values(modes=(RIGID, *soft)))
        single += [alone.plan.cost.total] if alone.plan else []
    assert found.require().cost.total <= min(single) * (1 + 2e-4)
    free = plan(asked.with_values(robot=bold(ARC)))
    assert (free.lower_bound or 0.0) <= found.require().cost.total


@pytest.mark.parametrize("seed", range(12))
def test_ways_that_keep_all_limits_are_never_called_impossible(seed: int) -> None:
    """Ways at random, each bend as far as is allowed or less; and what is found comes there."""
    rng, facts, modes = np.random.default_rng(seed), bending(ARC), list[Mode]()
    start = w = facts.coordinates(rng.uniform(-20, 20, 2))
    for _ in range(rng.integers(2, 6)):
        mode = MODES[1:][rng.integers(3)]
        way = w + np.linspace(0, rng.uniform(-4, 4), 150)[:, None] * mode
        kappa = np.stack([facts.curvature(way[:, j], j) for j in range(2)], axis=-1)
        ends = range(2, 150, 4)
        kept = [n for n in ends if bend_margins(ARC, mode, kappa[:n]).min() >= 0]
        if kept := [n for n in kept if broken_by_shapes(ARC, kappa[:n]) is None]:
            w, modes = way[rng.choice([kept[-1], *kept]) - 1], [*modes, mode]
    for fineness in (COARSE, FINE)[: 1 + (seed < 3)] if modes else ():
        detours = Detours(partial(cells_of, ARC.body), np.array([start] * 2), np.array([w] * 2))
        found = detours.bends(tuple(modes), fineness)
        assert found is not None
        np.testing.assert_allclose(found @ np.array(modes), w - start, atol=0.2)
