"""Policies: plans that count with joint bends that end elsewhere than they are planned."""

from __future__ import annotations

import itertools
import json
import operator
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from once import solved
from problems import random_problem

from twosra_mpc import InputError, Plan, Problem, load_plan, load_problem, load_robot, plan
from twosra_mpc.checking.plan_file import check_plan
from twosra_mpc.effort import Ending
from twosra_mpc.execution.simulation.disturbance import LEVELS, Disturbance
from twosra_mpc.execution.simulation.plant import PathMotion, SimulatedRobot
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.files import write_json
from twosra_mpc.lab.analysis.explanation import explain
from twosra_mpc.lab.identification.bend_learning import learned, told_by
from twosra_mpc.planning.confirmed_bound import Sequences, at_once, least_costs_s
from twosra_mpc.planning.planner import plan_again, plan_until_interrupted, searched
from twosra_mpc.planning.policy import RELYING, relies, surprise
from twosra_mpc.plans.branches import priced
from twosra_mpc.problem.limits import CLEARANCE
from twosra_mpc.robot.joint_bends import JointBend, Uncertainty

ROBOT = load_robot("2sra-v1")
MODERATE = LEVELS["moderate"]
KNOWN = ROBOT.with_values(uncertainty=None)
MODES = ((1, 0), (0, 1), (1, 1))


def bending(seed: int, splits: Sequence[float]) -> Problem:
    """Only the shape changes, by up to three phases; splits are equally likely."""
    uncertain = Uncertainty(joint_splits=tuple(splits))
    robot = ROBOT.with_values(uncertainty=uncertain)
    limited = {"modes": MODES, "max_phases": 3, "risk": "mean"}
    drawn = random_problem(seed, robot, **limited)
    goal = drawn.goal.with_values(x_m=None, y_m=None, phi_rad=None)
    shapes = 0.5 * np.array([drawn.start.kappa_per_m, goal.configuration[3:]])
    start = drawn.start.with_values(kappa_per_m=tuple(shapes[0]))
    return drawn.with_values(start=start, goal=goal.with_values(kappa_per_m=tuple(shapes[1])))


def known_s(made: Plan) -> float:
    assert made.confirmed_s is not None
    return made.confirmed_s


def every_plan(problem: Problem) -> Iterator[Plan]:
    """The plan of each sequence of up to three phases."""
    for count in (1, 2, 3):
        for modes in itertools.product(MODES, repeat=count):
            if all(one != other for one, other in itertools.pairwise(modes)):
                found = searched(problem, excluded=Sequences(partial(operator.ne, modes)))
                if found.plan is not None and found.found:
                    yield found.plan


def walked_s(made: Plan, bend: JointBend) -> float:
    """Time of a run that bends so: where it misses, the best of what relies on no bend follows."""
    if (new := surprise(made, bend)) is None:
        return known_s(made)
    left = made.rest_at(made.phases[new.phase].end_s)
    left = left.with_values(start=left.start.with_values(kappa_per_m=tuple(new.kappa)))
    rest_s = known_s(searched(left, excluded=RELYING).require())
    return min(made.known_end_s(new.phase) + rest_s, known_s(made) if new.right else np.inf)


def test_without_uncertainty_the_policy_is_the_plan_and_nominal_ones_stay_as_they_are() -> None:
    for name in ("paper-1", "paper-4"):
        problem = load_problem(name)
        nominal, told = solved(name), plan(problem.with_values(robot=KNOWN))
        assert np.array_equal(nominal.require().samples.q, told.require().samples.q)
        assert nominal.policy is None
        assert "risk" not in nominal.to_dict()["scenario"]
        for robot in (KNOWN, ROBOT.with_values(uncertainty=Uncertainty())):
            result = plan(problem.with_values(robot=robot), risk="mean")
            assert result.policy is not None
            assert np.array_equal(result.require().samples.q, nominal.require().samples.q)
            assert result.policy.cost_s == result.policy.planned_s == known_s(nominal.require())
            assert not result.policy.branches


def test_the_best_of_small_trees_is_found_and_costs_what_its_runs_do() -> None:
    """Two looks, three scenarios, two segments: against every first plan."""
    problem = bending(6, [0.0, 0.02, 0.2])
    result, uncertain = plan(problem), problem.robot.uncertainty
    policy = result.policy
    assert policy is not None
    assert uncertain is not None
    bends = uncertain.joint_bends
    trees = [[walked_s(each, bend) for bend in bends] for each in every_plan(problem)]
    least = min(trees, key=np.mean)
    assert policy.cost_s <= np.mean(least) * (1 + problem.gap)
    own = [walked_s(result.require(), bend) for bend in bends]
    assert policy.branches
    assert [policy.cost_s, policy.mean_s] == pytest.approx([np.mean(own)] * 2)
    assert policy.known_bound <= policy.lower_bound <= policy.cost_s
    for risk in (0.3, 0.9):
        bounds = least_costs_s(problem.with_values(risk=risk), bends, max(least))
        costs = [priced([(1 / 3, cost) for cost in each], risk) for each in trees]
        assert bounds[1] <= bounds[0] <= min(costs)
    wider, measured, *_ = explain(result).alternatives
    assert wider.difference_s is not None
    assert wider.difference_s <= problem.gap * policy.cost_s
    nominal = plan(problem.with_values(robot=KNOWN)).policy
    assert nominal is not None
    assert measured.difference_s == nominal.cost_s - policy.cost_s


def test_a_bend_that_is_zero_if_all_goes_as_planned_is_a_phase_and_makes_misses_good() -> None:
    """From one even shape to another the correction after an even joint bend is nothing."""
    shapes: dict[str, dict[str, object]] = {
        "start": {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (20.0, 20.0)},
        "goal": {"kappa_per_m": (0.0, 0.0)},
    }
    problem = Problem.parse({"robot": ROBOT, "modes": MODES, "risk": "mean", **shapes}, "test")
    made = searched(problem, excluded=RELYING).require()
    joint, alone = made.phases[-2:]
    assert (sum(joint.mode), sum(alone.mode)) == (2, 1)
    assert alone.start_s == alone.end_s >= joint.end_s
    assert made.verification.ok
    assert known_s(made) >= made.duration_s
    surprises = [surprise(made, bend) for bend in ROBOT.joint_bends]
    assert all(new is None or new.right for new in surprises)


@pytest.mark.parametrize(("at_m", "in_the_way"), [((5.0, 5.0), False), ((0.014, -0.22), True)])
def test_obstacles_change_a_policy_only_where_they_are_in_its_way(
    at_m: tuple[float, float], *, in_the_way: bool
) -> None:
    """And what they add is found: no policy is below the bound, and its plan keeps clear."""
    free = plan(problem := bending(6, [0.0, 0.2])).policy
    disc = {"disc": {"x_m": at_m[0], "y_m": at_m[1], "radius_m": 0.03}}
    result = plan(problem.with_values(obstacles=(disc,)))
    policy = result.policy
    assert free is not None
    assert policy is not None
    assert result.require().verification.limits[CLEARANCE.name] >= 0
    assert policy.known_bound <= policy.lower_bound <= policy.cost_s
    assert free.lower_bound <= policy.lower_bound * (1 + 1e-9)
    if in_the_way:
        assert policy.cost_s > free.cost_s
    else:
        assert policy.branches == free.branches
        assert policy.cost_s == free.cost_s


@pytest.mark.parametrize("name", [f"paper-{number}" for number in range(1, 6)])
def test_published_problems_have_a_policy_near_its_bound(name: str) -> None:
    result = solved(name, risk="mean")
    policy, made = result.policy, result.require()
    assert policy is not None
    assert policy.known_bound <= policy.lower_bound <= policy.cost_s <= 1.15 * policy.lower_bound
    assert made.verification.ok
    assert made.lower_bound == pytest.approx(solved(name).lower_bound)
    assert sum(each.probability for each in policy.branches) <= 1.0
    assert all("segment" in words for words in list(policy.sentences)[1:])
    if not policy.branches:
        assert not relies(made.sequence)


@pytest.mark.parametrize(("split", "relaxation"), [(0.44, 0.0), (-0.1, 0.8), (0.0, 1.0)])
def test_where_a_joint_bend_ends_is_where_a_robot_drawn_by_its_file_ends(
    split: float, relaxation: float
) -> None:
    """Its wheels roll as planned; the pose differs, the mean bend does not."""
    made = solved("paper-1").require()
    missed = surprise(made, JointBend(split, relaxation))
    assert missed is not None
    phase, kappa, off, _ = missed
    begin, end = made.phases[phase].start_s, made.phases[phase].end_s
    times = np.linspace(begin, end, 200)
    path = made.trajectory.at(times)
    turned = np.diff(made.trajectory.wheel_travel_rad(times), axis=0)
    uncertain = Uncertainty(joint_splits=(split,), joint_relaxations=(relaxation,))
    robot, rng = ROBOT.with_values(uncertainty=uncertain), np.random.default_rng(0)
    plant = PathMotion(made.problem, robot, Disturbance(joint_bends=1.0), rng, rng)
    plant.q = path.q[0]
    for step in turned:
        plant.roll(step, [1.0, 1.0], 0.1)
    q = plant.q
    assert q[3:] == pytest.approx(kappa, abs=0.05)
    assert off == pytest.approx(np.abs(q[3:] - path.q[-1, 3:]).max(), abs=0.05)
    assert surprise(made, JointBend()) is None


@pytest.mark.parametrize(
    ("modes", "at_goal", "single"),
    [
        ([(1, 0), (0, 1)], False, False),
        ([(1, 1), (1, 0)], False, False),
        ([(1, 1), (0, 0), (1, 1), (1, 0)], False, False),
        ([(1, 0), (1, 1), (0, 0)], True, True),
        ([(1, 0), (0, 0), (1, 1)], True, False),
        ([(1, 0), (0, 1), (1, 1)], True, False),
        ([(1, 1, 0), (0, 1, 1), (0, 0, 1)], False, False),
        ([(1, 1, 0), (0, 0, 1)], True, True),
    ],
)
def test_which_sequences_need_several_segments_right_at_once(
    modes: list[tuple[int, ...]], at_goal: bool, single: bool
) -> None:
    assert (relies(modes), at_once(modes)) == (at_goal, single)
    assert (tuple(modes) in RELYING) == at_goal


def test_quantiles_and_means_of_costs() -> None:
    costs = [(0.2, 400.0), (0.8, 600.0)]
    assert priced(costs, "mean") == pytest.approx(560.0)
    assert [priced(costs, risk) for risk in (0.1, 0.2, 0.21, 0.9)] == [400.0, 400.0, 600.0, 600.0]
    assert priced([(0.0, np.inf), (1.0, 5.0)], "mean") == 5.0


def test_a_policy_is_kept_in_its_file_and_limits_and_interrupts_end_it(tmp_path: Path) -> None:
    result = solved("paper-5", risk="mean")
    result.save(path := tmp_path / "plan.json")
    back = load_plan(path)
    assert back.policy == result.policy
    assert check_plan(path).ok
    older = json.loads(path.read_text())
    del older["policy"], older["robot"]["uncertainty"]
    path.write_text(json.dumps(older))
    assert check_plan(path).ok
    some = plan(result.problem.with_values(work_limit=100.0))  # of 600
    assert result.policy is not None
    assert some.policy is not None
    assert (some.ending, some.policy.lower_bound) == (Ending.LIMIT, 0.0)
    assert some.policy.cost_s >= result.policy.lower_bound
    assert not relies(some.require().sequence)
    short = plan_until_interrupted(result.problem.with_values(work_limit=30.0))
    assert short.found
    assert short.ending in (Ending.LIMIT, Ending.CLOSED)


def test_what_is_planned_again_relies_on_nothing_it_did_not_count_with() -> None:
    problem = load_problem("paper-1", risk="mean")
    assert not relies(plan_again(problem, 1000.0).require().sequence)
    assert plan_again(problem, 400.0).plan is None


@pytest.mark.parametrize(
    ("key", "ask"),
    [
        *(
            ("risk", partial(load_problem, "paper-1", risk=risk))
            for risk in (0, 1.0, "worst", True)
        ),
        ("risk", partial(load_problem, "pick-and-place", risk="mean")),
        ("risk", partial(load_problem, "paper-1", risk=0.9, heating="least_energy")),
        ("joint_splits", partial(Uncertainty.parse, {"joint_splits": [1.0]}, "robot")),
        ("joint_splits", partial(Uncertainty.parse, {"joint_splits": []}, "robot")),
        ("joint_relaxations", partial(Uncertainty.parse, {"joint_relaxations": [1.5]}, "robot")),
    ],
)
def test_risks_and_uncertainty_that_are_none_are_refused_by_name(
    key: str, ask: Callable[[], object]
) -> None:
    with pytest.raises(InputError, match=key):
        ask()


def test_runs_rely_on_no_joint_bend_once_one_has_missed_and_tell_how_it_went(
    run: Run, tmp_path: Path
) -> None:
    problem = load_problem("paper-1")
    simulation = simulate(problem, disturbance="moderate", seed=100)
    first, *others = simulation.run.plans
    assert simulation.metrics.reached
    assert relies(first.sequence)
    assert [relies(other.sequence) for other in others] == [False] * max(1, len(others))
    told, robot = told_by(simulation.run, ROBOT), SimulatedRobot(problem, "arc", MODERATE, 100)
    drawn = vars(vars(robot)["_motion"])["_joint"][1, 1]
    assert told[:2] == pytest.approx(drawn, abs=0.02)
    files = tmp_path / "run.json", tmp_path / "robot.toml"
    write_json(files[0], simulation.run.to_dict())
    code, out, _ = run("learn", files[0], "--out", files[1])
    assert (code, "joint_splits" in out) == (0, True)
    uncertain, learnt = ROBOT.uncertainty, load_robot(files[1]).uncertainty
    assert uncertain is not None
    assert learnt is not None
    assert load_robot(files[1]).with_values(uncertainty=uncertain) == ROBOT
    assert learnt.joint_splits == learned(uncertain.joint_splits, [told.split], (-1, 1)).values
    code, _, err = run("learn", files[0], "--robot", "2sr-v2")
    assert (code, "run = '2sra-v1'" in err) == (2, True)


def test_what_is_learned_narrows_with_runs_and_never_below_how_they_differ() -> None:
    known, shown = [0.44, 0.10, 0.01, -0.10, 0.02], [0.11, 0.08, 0.14, 0.05, 0.12]
    found = [learned(known, shown[: n + 1], (-1, 1)) for n in range(5)]
    spreads = [each.spread for each in found]
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[0] >= np.std(known) * (1 - 1e-9)
    differ = [0.3, -0.3, 0.3, -0.3]
    for given in (None, known, [0.0]):
        assert learned(given, differ, (-1, 1)).spread >= np.std(differ, ddof=1)
    for each in (*found, learned(None, shown, (-1, 1))):
        assert np.mean(each.values) == pytest.approx(each.mean, abs=1e-3)
        assert np.std(each.values) == pytest.approx(each.spread, abs=1e-3)
    same = learned(None, [0.1] * 5, (-1, 1))
    assert (same.mean, same.spread) == pytest.approx((0.1, 0.0))
    assert set(learned([0.0, 1.0], [1.0], (0.0, 1.0)).values) <= {*np.linspace(0, 1, 1001).round(3)}
