"""Effort in the cost: durations of least cost, what bends take at least, and what files state."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from hypothesis import given
from hypothesis import strategies as st
from once import planned, solved
from problems import ROBOT, at_once, bound_of, guessed, network_of, random_problem

from twosra_mpc import Problem, Result, Robot, load_plan, load_problem, load_robot, plan
from twosra_mpc.checking.plan_file import check_plan
from twosra_mpc.checking.verification import effort_s
from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import roll_out
from twosra_mpc.planning.bounds.schedule import cost_coefficients
from twosra_mpc.planning.solver.fixed_sequence import (
    INTERVALS,
    Candidate,
    feasible_schedule,
    scheduled,
    verified,
)
from twosra_mpc.planning.solver.gentle import cheapest
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode, ModeSequence

ARC = load_robot("2sra-v1")
LEAST = ARC.limits.wheel_speed_min_rad_s or 0.0
SEQUENCES = [(RIGID, SOFT_1, SOFT_BOTH), (RIGID, SOFT_2, SOFT_1), (RIGID, SOFT_BOTH, SOFT_2)]


def weighed(weight: float, name: str = "paper-2", **overrides: object) -> Problem:
    return load_problem(name, weights={"effort": weight}, **overrides)


@pytest.mark.parametrize("robot", ["2sra-v1", "2sra-v1-paper"])
@pytest.mark.parametrize("name", ["paper-1", "paper-3"])
def test_effort_is_the_integral_of_the_squares_of_wheel_speeds(name: str, robot: str) -> None:
    """By Gauss and Legendre's rule, at places that are flown to."""
    whole = planned(name, robot=robot).trajectory
    nodes, weights = np.polynomial.legendre.leggauss(6)
    begin, lasting = whole.samples.t_s[:-1, None], np.diff(whole.samples.t_s)[:, None]
    wheels = whole.at((begin + (1 + nodes) / 2 * lasting).ravel()).wheel_rad_s
    squares = ((wheels / whole.problem.robot.limits.wheel_speed_rad_s) ** 2).sum(axis=1)
    expected = (squares.reshape(-1, len(nodes)) @ weights / 2) @ lasting.ravel()
    assert effort_s(whole) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("timing", ["constant", "nominal"])
@pytest.mark.parametrize("weight", [1.0, 20.0, 300.0])
def test_no_other_durations_cost_less(timing: str, weight: float) -> None:
    """Random durations near the ones found, each with its best schedule."""
    problem = weighed(weight, timing=timing)
    network = network_of(problem, (RIGID, SOFT_1))
    quick = candidate_of(problem, (RIGID, SOFT_1))
    found = cheapest(problem, quick, network)
    coefficients, constant = cost_coefficients(network, problem.cost_weights)

    def cost(times: Array, effort: float) -> float:
        return float(coefficients @ times) + constant + weight * effort

    best = cost(found.times, found.effort_s)
    assert best <= cost(quick.times, quick.effort_s)
    durations = np.array([profile.duration_s for profile in found.profiles])
    rng, tried = np.random.default_rng(0), 0
    for spread in np.repeat([0.01, 0.1, 0.5], 20).tolist():
        other = durations * rng.uniform(1 - spread, 1 + spread, len(durations))
        other = np.maximum(other, [profile.duration_s for profile in quick.profiles])
        slower = [p.lasting(d) for p, d in zip(quick.profiles, other.tolist(), strict=True)]
        made = feasible_schedule(network, other, problem)
        if made is None or any(0 < p.peak_rad_s < LEAST for p in slower):
            continue
        tried += 1
        assert cost(made[0], sum(p.effort_s for p in slower)) >= best * (1 - 1e-7)
    assert tried >= 20


def candidate_of(problem: Problem, sequence: ModeSequence) -> Candidate:
    """The guess of a sequence at full speed."""
    motion = guessed(problem, sequence, intervals=INTERVALS)
    candidate = scheduled(motion, network_of(problem, sequence), problem, 0)
    assert candidate is not None
    return candidate


@pytest.mark.parametrize(
    "made",
    [
        lambda: plan(load_problem("paper-1")),
        lambda: plan(weighed(1.0, "three-segments")),
        lambda: plan(weighed(1.0, gap=0.05, robot="2sra-v1-paper")),
        lambda: plan(weighed(30.0, planner="greedy")),
        lambda: plan(weighed(1.0, gap=0.05, robot=at_once(ARC))),
    ],
    ids=["gentle", "three", "paper", "greedy", "at once"],
)
def test_the_effort_stated_is_that_of_the_wheels(made: Callable[[], Result]) -> None:
    found = made().require()
    cost, problem = found.cost, found.problem
    total = 0.0
    for phase in found.phases:
        t = np.linspace(phase.start_s, phase.end_s - 1e-9, 4001)
        share = found.trajectory.at(t).wheel_rad_s / problem.robot.limits.wheel_speed_rad_s
        total += float(np.trapezoid((share**2).sum(axis=1), t))
    assert cost.effort_s == pytest.approx(total, rel=2e-4)
    assert cost.total == pytest.approx(
        cost.time_s + problem.weights.effort * (cost.effort_s or 0.0)
    )


def test_more_weight_is_less_effort_in_more_time() -> None:
    quick = planned("paper-1", motion="fastest")
    made = [plan(weighed(weight, "paper-1")).require() for weight in (1e-6, 1.0, 20.0)]
    assert made[0].cost.time_s == pytest.approx(quick.cost.time_s, abs=1e-4)
    for less, more in itertools.pairwise(made):
        assert less.sequence == more.sequence
        assert (less.cost.effort_s or 0.0) >= (more.cost.effort_s or 0.0) - 1e-6
        assert less.cost.time_s <= more.cost.time_s + 1e-6
    for each in made:
        assert each.verification.ok
        assert each.lower_bound is not None
        assert each.lower_bound <= each.cost.total
        other = plan(each.problem.with_values(motion="fastest")).require()
        assert other.cost == each.cost  # motion has nothing to add


def test_no_weight_is_no_change() -> None:
    plain, zero = (plan(problem).require() for problem in (load_problem("paper-2"), weighed(0.0)))
    assert plain.cost == zero.cost
    assert plain.lower_bound == zero.lower_bound
    assert (plain.samples.q == zero.samples.q).all()


@given(
    kappa=st.tuples(st.floats(-40, 40), st.floats(-40, 40)),
    mode=st.sampled_from([SOFT_1, SOFT_2, SOFT_BOTH]),
    travel=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)),
    robot=st.sampled_from([at_once(ARC), ARC, ROBOT, load_robot("2sr-v2")]),
)
def test_a_bend_takes_the_effort_of_its_bound(
    kappa: tuple[float, float], mode: Mode, travel: tuple[float, float], robot: Robot
) -> None:
    """Whichever unit moves, and at whatever share."""
    inputs = np.zeros((1, 20, 5))
    inputs[0, :, :2] = np.array(travel) / 20
    motion = roll_out(robot, np.array([0.0, 0.0, 0.0, *kappa]), (mode,), inputs)
    if np.abs(motion.states[..., 3:]).max() >= robot.limits.curvature_per_m:
        return
    facts, profile = bending(robot), fastest(motion)[0]
    before, after = (facts.coordinates(q[3:]) for q in motion.states[0, [0, -1]])
    bend = after[mode.index(1)] - before[mode.index(1)]
    least = facts.least_effort_s2(mode, [(w, w) for w in before], bend)
    assert least <= profile.effort_s * profile.duration_s * (1 + 1e-3) + 1e-12


@pytest.mark.parametrize("weight", [2.0, 50.0])
@pytest.mark.parametrize("seed", range(4))
def test_bounds_are_below_what_plans_cost(seed: int, weight: float) -> None:
    problem = random_problem(seed, ARC, weights={"effort": weight}, timing="constant")
    without, tried = problem.with_values(weights={}), 0
    for sequence in SEQUENCES:
        bound = bound_of(problem, sequence)
        if bound is None:
            continue
        least = bound_of(without, sequence)
        assert least is not None
        assert bound.cost > least.cost
        motion = guessed(problem, sequence, intervals=INTERVALS)
        network = network_of(problem, sequence)
        candidate = scheduled(motion, network, problem, 0)
        if candidate is not None:
            tried += 1
            made = verified(problem, cheapest(problem, candidate, network), network)
            assert bound.cost <= made.cost.total + 1e-6
    assert tried


def test_files_state_the_effort_and_are_believed_in_nothing(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    plan(weighed(10.0)).save(path)
    assert check_plan(path).ok
    document = json.loads(path.read_text(encoding="utf-8"))
    document["cost"]["effort_s"] *= 0.9
    document["cost"]["total"] -= document["cost"]["effort_s"] / 9 * 10
    path.write_text(json.dumps(document), encoding="utf-8")
    assert any("cost.effort_s" in problem for problem in check_plan(path).problems)
    del document["cost"]["effort_s"]  # weighed, but not stated
    path.write_text(json.dumps(document), encoding="utf-8")
    assert any("cost.effort_s: none" in problem for problem in check_plan(path).problems)


def test_older_files_state_no_effort(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    solved("paper-2").save(path)
    document = json.loads(path.read_text(encoding="utf-8"))
    del document["cost"]["effort_s"], document["scenario"]["weights"]["effort"]
    path.write_text(json.dumps(document), encoding="utf-8")
    assert load_plan(path).require().cost.effort_s is None
    assert check_plan(path).ok


def test_people_are_told(run: Run, tmp_path: Path) -> None:
    text = 'weights = { effort = 1 }\nrobot = "2sra-v1"\n'
    text += "start = { x_m = 0, y_m = 0, phi_rad = 0, kappa_per_m = [0, 0] }\n"
    (tmp_path / "mine.toml").write_text(text + "goal = { kappa_per_m = [20, 'free'] }\n")
    planned = run("plan", "mine.toml", "--out", "plan.json")
    assert planned.code == 0
    assert "effort 0." in planned.out
    assert "with which the plan costs" in planned.out
    assert run("report", "plan.json", "report.html").code == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "1 times the effort" in page
    assert "<dt>Effort</dt>" in page
    assert run("verify", "plan.json").code == 0
    (tmp_path / "mine.toml").write_text(text.replace("= 1", "= -1") + "goal = { x_m = 1 }\n")
    refused = run("plan", "mine.toml")
    assert refused.code == 2
    assert "weights.effort" in refused.err
