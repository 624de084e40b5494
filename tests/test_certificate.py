"""Certificates: what is proved is below every cost, near the bound reported, whatever is edited."""

from __future__ import annotations

import copy
import itertools
import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from flint import arb
from problems import bold, exactly, overlapping_on_the_way_to, random_problem

from twosra_mpc import InputError, Plan, Problem, Result, load_problem, load_robot, plan
from twosra_mpc import installation as installed
from twosra_mpc.checking import certificate
from twosra_mpc.checking.certificate import Bounded, Checker, Proof, check
from twosra_mpc.checking.fibre import Fibre, between, low, nearest
from twosra_mpc.checking.melts import heat
from twosra_mpc.checking.plan_file import load_plan
from twosra_mpc.model.bending import bending
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.proof import Prover
from twosra_mpc.problem.limits import body_gaps_m
from twosra_mpc.problem.tolerances import BODY_TOLERANCE_M, COST_TOLERANCE, COST_TOLERANCE_S
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.description import with_path_model
from twosra_mpc.robot.modes import ModeSequence, all_modes
from twosra_mpc.timing import transition_model

SHORTFALL = 5e-4  # of the bound that is reported
# Where bends that the goal leaves free must keep units apart, and what touches ask beyond that
# something melts, is not in the proof.
MORE = {
    **{"both soft": 0.02, "conform-cylinder": 0.005, "three-shapes": 0.02},
    **{"pick-and-place": 0.04, "grasp-cube": 0.15, "tidy-up": 0.3},
}


@cache
def proved(problem: Problem) -> tuple[Result, dict[str, Any], float]:
    """A plan, its certificate, and what that proves."""
    result = plan(problem)
    assert result.lower_bound is not None
    certificate = Prover(problem).certificate(result.lower_bound)
    certificate = json.loads(json.dumps(certificate))  # as a file has it
    bound = check(problem, certificate).bound
    assert bound == certificate["bound_s"]
    assert bound <= result.require().cost.total * (1 + 1e-9)
    return result, certificate, bound


def warmer(problem: Problem, *temperature_C: float) -> Problem:
    return problem.with_values(start=problem.start.with_values(temperature_C=temperature_C))


def freed(problem: Problem) -> Problem:
    goal = problem.goal.with_values(kappa_per_m=(20.0, "free"), x_m=None)
    return problem.with_values(goal=goal)


V1, V2 = load_robot("2sra-v1"), load_robot("2sr-v2")
NARROW = {"x_m": 0.05, "y_m": 0.1, "phi_rad": 0.3}
PROBLEMS = {
    **{f"paper-{n}": load_problem(f"paper-{n}") for n in (1,)},
    **{f"paper-{n}, spirals": load_problem(f"paper-{n}", robot="2sra-v1-paper") for n in (2,)},
    "three segments": load_problem("three-segments", robot=bold(load_robot("3sra"))),
    "exact arcs": exactly(random_problem(1, V1)),
    "corrected spirals": random_problem(
        2, with_path_model(load_robot("2sra-v1-paper"), "log_spiral_corrected")
    ),
    "constant times": random_problem(3, timing="constant"),
    "waits and weights": random_problem(
        4, timing="paper", weights={"energy_s_per_J": 0.1, "transition_s": 45.0}
    ),
    "weights": random_problem(5, weights={"energy_s_per_J": 0.1, "transition_s": 4.0}),
    "warm": warmer(random_problem(6), 50.0, 35.0),
    "soft": warmer(random_problem(0, gap=0.02), 70.0, 25.0),
    "both soft": warmer(
        exactly(random_problem(6, V1, gap=0.03)), 70.0, 70.0
    ),  # a leaf that only prices exclude
    "free": freed(random_problem(8)),
    "few modes": random_problem(9, modes=[[0, 0], [1, 0], [0, 1]]),
    "soft in the end": random_problem(10).with_values(
        goal=random_problem(10).goal.with_values(mode=(0, 1))
    ),
    "no drives": freed(random_problem(11, modes=[[1, 0], [1, 1]])).with_values(
        goal={"kappa_per_m": (10.0, 15.0)}
    ),
    **{name: load_problem(name) for name in MORE if name != "both soft"},
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_nearly_all_of_the_bound_is_proved(name: str) -> None:
    result, certificate, bound = proved(PROBLEMS[name])
    assert result.lower_bound is not None
    assert bound >= (1 - MORE.get(name, SHORTFALL)) * result.lower_bound
    assert len(json.dumps(certificate)) < (4000 if name not in MORE else 20_000)


@pytest.mark.parametrize(
    "problem",
    [
        random_problem(0, V1, heaters_at_once=1),
        random_problem(1, V1, transition_quantile=0.9),
        random_problem(3, V1, weights={"effort": 10.0}, gap=0.05),
        load_problem("rigid-move"),
        Problem(
            robot=V2,
            start={"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (3.0, -8.0)},
            goal={**NARROW, "kappa_per_m": (9.0, 4.0), "tolerance": "exact"},
        ),
    ],
)
def test_where_less_is_proved_it_is_below_the_cost(problem: Problem) -> None:
    result, _, bound = proved(problem)
    assert result.lower_bound is not None
    assert 0 <= bound <= (1 + SHORTFALL) * result.lower_bound


@pytest.mark.parametrize(
    ("overrides", "known_s"),
    [({"weights": {"transition_s": 45.0}}, 981.1), ({"modes": [[0, 0], [1, 0], [0, 1]]}, 801.1)],
)
def test_to_freeze_and_melt_anew_may_be_quicker_than_to_go_on(
    overrides: dict[str, Any], known_s: float
) -> None:
    """Plans that cost this are known: with waits, the way round another mode is the cheaper one."""
    problem = load_problem("paper-1", robot="2sra-v1-paper", timing="paper", **overrides)
    assert 0.999 * known_s < Prover(problem).certificate(2 * known_s)["bound_s"] <= known_s


def test_sequences_longer_than_any_plan_are_covered() -> None:
    problem = random_problem(1)
    least = check(problem, {"opened": []}).bound
    _, certificate, bound = proved(problem)
    assert 0 < least < bound
    assert check(problem.with_values(max_phases=12), certificate).bound == bound


def own_leaf(found: Plan, checker: Checker) -> ModeSequence:
    """The sequence of a plan, as certificates write it: with the ends of its legs."""
    node, stages = checker.root(), found.problem.stages[:-1]
    both = zip(found.trajectory.done_s, stages, strict=False)
    ends = [t for t, stage in both if stage.through is None and stage.releases is None]
    for since, until in itertools.pairwise((0.0, *ends, math.inf)):
        for phase in found.phases:
            within = phase.start_s < until - 1e-6 and phase.end_s > since + 1e-6
            if within and node[-1:] != (phase.mode,):
                node = (*node, phase.mode)
        if until < math.inf:
            bases = node, node[:-1]  # the latter where the plan itself ends the leg rigid
            longer = [(base, child) for base in bases for child in checker.children(base)]
            node = next(child for base, child in longer if () in child[len(base) :])
    return checker.leaf(node) or checker.leaf(node[:-1]) or ()


NAMES = sorted(MORE.keys() - {"tidy-up", "both soft"})


@pytest.mark.parametrize("name", [*NAMES, "paper-1", "free"])
def test_a_plan_costs_no_less_than_its_own_sequence(name: str) -> None:
    """Nor than anything that begins it: so nothing that is asked of every plan is too much."""
    found = proved(PROBLEMS[name])[0].require()
    checker = Checker(found.problem)
    leaf, cost = own_leaf(found, checker), found.cost.total * (1 + 1e-9)
    assert 0.9 * cost <= checker.leaf_bound(leaf) <= cost
    begun = [leaf[:k] for k in range(len(checker.root()), len(leaf) + 1)]
    assert max(map(checker.node_bound, begun)) <= cost


@pytest.mark.parametrize("seed", range(1, 4))
def test_no_plan_of_a_mission_costs_less_than_is_proved(seed: int) -> None:
    """Goals in a row, exact or wide, in any stiffness or one; every other time in any order."""
    rng = np.random.default_rng(seed)
    places = [{"x_m": x, "y_m": 0.1, "phi_rad": 0.5} for x in rng.uniform(-0.3, 0.3, 2)]
    shapes = [{"kappa_per_m": rng.uniform(-30, 30, 2).round(1).tolist()} for _ in range(2)]
    wide = {"tolerance": {"kappa_per_m": [10.0, 2.0]}}
    more: list[dict[str, Any]] = [{}, wide, {"mode": "any"}, {"mode": [1, 0]}]
    tasks = [
        {"do": "reach", **place, **shape, **more[rng.integers(4)]}
        for place, shape in zip(places, shapes, strict=True)
    ]
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (10.0, 0.0)}
    order = ("given", "free")[seed % 2]
    problem = Problem(robot=V1, start=start, tasks=tasks, order=order, gap=0.05, work_limit=3000)
    _, certificate, bound = proved(problem)
    assert 0.8 * (plan(problem).lower_bound or 0.0) <= bound
    assert bound >= check(problem, {**certificate, "opened": [], "priced": []}).bound > 0


def test_a_certificate_proves_nothing_of_another_mission() -> None:
    """A cup that is already where the robot stands, and things that may be pushed, ask for less."""
    _, certificate, bound = proved(load_problem("pick-and-place"))
    problem = load_problem("pick-and-place")
    (cup,) = problem.objects
    near = cup.with_values(pose={"x_m": -0.3, "y_m": -0.2}, friction=0.5)
    pushed = [problem.tasks[0].with_values(hold="pushed"), *problem.tasks[1:]]
    others = {"objects": (near,)}, {"objects": (near,), "tasks": pushed}, {"tasks": pushed[:1]}
    for other in others:
        asked = problem.with_values(**{"objects": (cup.with_values(friction=0.5),), **other})
        assert bound_of(asked, certificate) < bound - 1


@pytest.mark.parametrize(
    ("name", "edits"), [("paper-1", 30), ("both soft", 10), ("pick-and-place", 40)]
)
def test_no_edit_proves_more(name: str, edits: int) -> None:
    """Rejected, or a bound that is true: no plan costs less than the best one known."""
    result, certificate, bound = proved(PROBLEMS[name])
    cost, rng = result.require().cost.total, np.random.default_rng(0)
    checked = [edited_bound(PROBLEMS[name], certificate, rng) for _ in range(edits)]
    assert max(checked) <= cost * (1 + 1e-9)
    assert min(checked) < bound - 1  # that of one that opens too little, or is refused
    assert any(value > 0 for value in checked)


def edited_bound(problem: Problem, certificate: dict[str, Any], rng: np.random.Generator) -> float:
    edited = copy.deepcopy(certificate)
    for _ in range(rng.integers(1, 4)):
        edit(edited, rng)
    return bound_of(problem, edited)


def bound_of(problem: Problem, certificate: dict[str, Any]) -> float:
    """What a certificate proves of a problem; nothing if it is refused."""
    try:
        return check(problem, certificate).bound
    except InputError:
        return -math.inf


def edit(document: Any, rng: np.random.Generator) -> None:
    """Change one random place of a document: drop it, repeat it, or put something else there."""
    place = document
    while isinstance(place, dict | list) and len(place):
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = keys[rng.integers(len(keys))]
        if isinstance(place[key], dict | list) and len(place[key]) and rng.random() < 0.8:
            place = place[key]
            continue
        number = place[key] if isinstance(place[key], int | float) else 1
        others: list[Any] = [0, 1, 2, -1, None, "1", [], {}, 1e308, math.nan, number * 1.5, -number]
        if rng.random() < 0.3:
            del place[key]
        elif rng.random() < 0.3 and isinstance(place, list):
            place.insert(key, copy.deepcopy(place[key]))
        else:
            place[key] = others[rng.integers(len(others))]
        return


ROBOTS = {name: load_robot(name) for name in ("2sra-v1", "2sra-v1-paper", "2sr-v2", "3sra")}
ROBOTS["fibre end"] = V1.with_values(path=V1.path.with_values(speed_reference="fibre_end"))


@pytest.mark.parametrize("name", ROBOTS)
def test_both_accounts_of_bending_agree(name: str) -> None:
    robot, rng = ROBOTS[name], np.random.default_rng(0)
    fibre, facts, segments = Fibre(robot), bending(robot), robot.geometry.segments
    limit, jacobian = robot.limits.curvature_per_m, kinematics(robot).jacobian
    for kappa in [np.zeros(segments), *rng.uniform(-limit, limit, (8, segments))]:
        shape, boxed = [arb(k) for k in kappa], [between(k - 0.3, k + 0.2) for k in kappa]
        for mode, unit in itertools.product(all_modes(segments)[1:], (0, 1)):
            moved = fibre.bend(mode, shape, unit)
            column = jacobian(np.concatenate([np.zeros(POSE), kappa]), mode).full()[:POSE, unit]
            np.testing.assert_allclose([float(x) for x in moved[:POSE]], column, atol=1e-12)
            around = fibre.bend(mode, boxed, unit)
            assert all((a - b).contains(0) for a, b in zip(around, moved, strict=True))
        for j, k in enumerate(kappa.tolist()):
            assert float(fibre.coordinate(j, k)) == pytest.approx(facts.coordinate(k, j), abs=1e-12)
            assert abs(fibre.curvature(j, fibre.coordinate(j, k)) - k) < 1e-2


@pytest.mark.parametrize("name", ROBOTS)
def test_both_accounts_of_the_body_agree(name: str) -> None:
    """What certificates forbid is what no verified plan may pass, of all parts of the robot."""
    robot, rng = ROBOTS[name], np.random.default_rng(1)
    limit = robot.limits.curvature_per_m
    shapes = rng.choice([-1, 1], (60, robot.geometry.segments)) * limit
    shapes *= rng.uniform(0.5, 1.0, shapes.shape)
    for kappa, gap_m in zip(shapes, body_gaps_m(robot, shapes), strict=True):
        found = nearest(robot, [[arb(k) for k in kappa]])
        assert found.meet == (gap_m < -BODY_TOLERANCE_M - 1e-6)
        assert not found.meet or found.apart_m >= gap_m - 1e-12
        assert not nearest(robot, [[arb(k, 10) for k in kappa]]).meet  # what is known says nothing


@pytest.mark.parametrize(("overlap_m", "possible"), [(2e-4, True), (1.1e-3, False)])
def test_a_bend_in_which_parts_meet_on_the_way_has_no_plan(
    overlap_m: float, possible: bool
) -> None:
    kappa2 = overlapping_on_the_way_to(V1, 57.3, overlap_m)
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (-30.0, kappa2)}
    goal = {"kappa_per_m": (57.3, kappa2), "tolerance": "exact"}
    bound = Checker(Problem(robot=V1, start=start, goal=goal)).leaf_bound(((0, 0), (1, 0), (0, 0)))
    assert math.isfinite(bound) == possible


@pytest.mark.parametrize("robot", ["2sra-v1", "2sr-v2"])
@pytest.mark.parametrize("warm", [(22.0, 45.0), (10.0, 70.0)])
def test_both_accounts_of_melting_agree(robot: str, warm: tuple[float, float]) -> None:
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    for quantile in (None, 0.9):
        problem = Problem(
            robot=load_robot(robot),
            start={**start, "temperature_C": warm},
            goal={"kappa_per_m": (5.0, 5.0)},
            transition_quantile=quantile,
        )
        for j, least in enumerate(transition_model(problem).start.least):  # type: ignore[attr-defined]
            own, soft = heat(problem, j), problem.start_mode[j]
            first = least.first_coasting_s if soft else least.first_lead_s
            assert float(own.first(1 - soft).lead) == pytest.approx(first, abs=1e-5)
            assert float(own.melt) == pytest.approx(least.melting_s, abs=1e-5)
            if not soft:
                assert low(own.first(1).plateau) <= least.first_melting_s + 1e-5
                frozen = float(own.freeze(1, arb(5)))
                assert frozen <= least.freezing_s(1, 5.0) + 1e-5
                assert quantile or frozen == pytest.approx(least.freezing_s(1, 5.0), abs=1e-5)


def test_leaves_and_nodes_are_in_order() -> None:
    """A node is bounded no higher than what is below it."""
    checker = Checker(random_problem(1))
    nodes = [checker.root()]
    for _ in range(2):
        for node in nodes:
            leaf, bound = checker.leaf(node), checker.node_bound(node)
            assert leaf is None or bound <= checker.leaf_bound(leaf) + 1e-9
            assert all(bound <= checker.node_bound(c) + 1e-9 for c in checker.children(node))
        nodes = [child for node in nodes for child in checker.children(node)]


def test_a_plan_file_carries_its_proof(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    assert run("plan", "paper-2", "--proof", "--out", str(file))[0] == 0
    code, text, _ = run("verify", str(file), "--proof")
    assert code == 0
    assert "certificate" in text
    result, document = load_plan(file), json.loads(file.read_text())
    assert result.certificate == document["certificate"] == result.to_dict()["certificate"]
    document["certificate"]["bound_s"] += 1.0
    file.write_text(json.dumps(document))
    assert run("verify", str(file), "--proof")[0] == 4
    assert run("verify", str(file))[0] == 0  # not asked for
    document["certificate"]["bound_s"] -= 1.0
    known_s = document["confirmed_lower_bound_s"]
    document["confirmed_lower_bound_s"] = document["confirmed_duration_s"]  # claimed, not proved
    file.write_text(json.dumps(document))
    assert run("verify", str(file))[0] == 0
    code, text, _ = run("verify", str(file), "--proof")
    assert code == 4
    assert "confirmed bound: " in text
    document["confirmed_lower_bound_s"] = known_s
    document["lower_bound_s"] += 1.0  # as if the plan were better than is proved
    document["fastest_cost_s"] += 1.0
    for gap, cost in (
        ("gap", document["cost"]["total"]),
        ("search_gap", document["fastest_cost_s"]),
    ):
        document[gap] = 1 - document["lower_bound_s"] / cost
    file.write_text(json.dumps(document))
    assert run("verify", str(file))[0] == 0
    code, text, _ = run("verify", str(file), "--proof")
    assert code == 4
    assert "s are reported" in text
    del document["certificate"]
    file.write_text(json.dumps(document))
    code, _, error = run("verify", str(file), "--proof")
    assert code == 2
    assert "made with --proof" in error
    assert "certificate" not in load_plan(file).to_dict()


@pytest.mark.parametrize("name", ["pick-and-place", "rigid-move"])
def test_what_is_planned_with_proof_reports_what_is_proved(
    name: str, run: Run, tmp_path: Path
) -> None:
    """Of both the search proves more: its own bound is printed, and the file is verified."""
    file = tmp_path / "plan.json"
    code, text, _ = run("plan", name, "--proof", "--out", str(file))
    document = json.loads(file.read_text())
    proof, lower_s = document["certificate"], document["lower_bound_s"]
    assert code == 0
    assert document["status"] == "feasible"
    assert lower_s == proof["bound_s"] < 0.9995 * proof["target_s"]
    assert f"of the search's {proof['target_s']:.2f} s" in " ".join(text.split())
    assert run("verify", str(file), "--proof")[0] == 0
    document["certificate"]["bound_s"] = proof["target_s"]
    file.write_text(json.dumps(document))
    assert run("verify", str(file), "--proof")[0] == 4


def test_what_is_proved_is_compared_with_what_the_plan_costs(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "plan.json"
    assert run("plan", "paper-2", "--proof", "--out", str(file))[0] == 0
    reported = load_plan(file).lower_bound
    cost = load_plan(file).require().cost.total
    assert reported is not None
    for bound, ok, words in (
        (cost * (1 + 1e-8), False, "contradiction: no plan costs less than"),
        (cost, True, f"proves {cost:.3f} s"),
        (reported * (1 - 4e-4), True, f"{4e-4 * reported:.3f} s (0.04 %) more than"),
        (reported * (1 - 6e-4), False, "(0.06 %) more than is proved"),
    ):
        exact = (bound + COST_TOLERANCE_S) / (1 - COST_TOLERANCE)
        bounded = Proof((Bounded((), False, exact),))
        monkeypatch.setattr(certificate, "check", lambda *_, found=bounded: found)
        document = json.loads(file.read_text())
        document["certificate"]["bound_s"] = 0.0
        file.write_text(json.dumps(document))
        code, text, _ = run("verify", str(file), "--proof", "--json")
        (told,) = json.loads(text) if isinstance(json.loads(text), list) else [json.loads(text)]
        assert code == (0 if ok else 4)
        found = [one for one in told["checks"] if one["name"] in ("certificate", "contradiction")]
        assert any(words in f"{one['name']}: {one['found']}" for one in found), found
        assert all((one["margin"] >= 0) == one["ok"] for one in found)


def test_what_has_no_proof_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for wrong in ({}, {"opened": 3}, {"opened": [[[1, 1]]]}, {"opened": [], "priced": [{}]}):
        with pytest.raises(InputError, match="certificate"):
            check(random_problem(0), wrong)
    monkeypatch.setattr(installed, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="python-flint"):
        installed.require("--proof", "proof", "python-flint")


def test_a_certificate_ends_at_its_limit_with_what_it_proves_by_then() -> None:
    problem = load_problem("three-segments")
    known = plan(problem).lower_bound
    assert known is not None
    made = [Prover(problem.with_values(work_limit=w)).certificate(known) for w in (1.0, 50.0, 1e5)]
    opened = [len(each["opened"]) for each in made]
    assert opened == sorted(set(opened))
    assert opened[0] == 1
    bounds = [check(problem, each).bound for each in made]
    assert bounds == sorted(bounds)
    assert 0.0 < bounds[0] < bounds[-1] <= known * (1 + 1e-3)
