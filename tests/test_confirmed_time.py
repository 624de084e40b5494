"""The time in which a plan is confirmed: of a run, of a second account, and bounded."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from once import planned, solved

from twosra_mpc import Plan, confirmed_lower_bound, load_problem, load_robot, plan
from twosra_mpc.checking.plan_file import checked_text
from twosra_mpc.checking.walk import walked_s
from twosra_mpc.control.heated_segment import confirming_windows
from twosra_mpc.execution import simulate
from twosra_mpc.robot.modes import MODES


def confirmed_s(made: Plan) -> float:
    assert made.confirmed_s is not None
    return made.confirmed_s


@pytest.mark.parametrize(("robot", "number"), [("2sra-v1", 5), ("2sra-v1-paper", 2)])
def test_a_robot_as_described_takes_the_confirmed_time(robot: str, number: int) -> None:
    """Published problems with one freeze and with two, whose melts are in series."""
    made = planned(f"paper-{number}", robot=robot)
    ran = simulate(made.problem, plant="as-planned", disturbance="none", plan=made)
    assert ran.metrics.reached
    assert 0.97 <= ran.run.duration_s / confirmed_s(made) <= 1.05


@pytest.mark.parametrize(
    ("scenario", "given"),
    [
        ("paper-1", {}),
        ("paper-1", {"planner": "greedy"}),
        ("paper-3", {"timing": "constant"}),
        ("paper-3", {"heaters_at_once": 1}),
        ("three-segments", {}),
        ("grasp-cube", {}),
    ],
)
def test_two_accounts_agree_from_any_state(scenario: str, given: dict[str, object]) -> None:
    """A network with late melts, and a walk with early ones; also of what is left of a plan."""
    made = planned(scenario, **given)
    rests = [] if made.problem.tasks else [0.1, 0.3, 0.6]
    for each in (made, *(plan(made.rest_at(s * made.duration_s)).require() for s in rests)):
        assert confirmed_s(each) == pytest.approx(walked_s(each), rel=1e-6)
        of_metal = each is made or "timing" not in given  # not of constant times, from its midst
        assert confirmed_s(each) >= (
            each.duration_s if each.planner == "optimal" and of_metal else 0
        )


def test_two_accounts_agree_where_the_body_is_slow() -> None:
    """Segments of two temperatures: early and late melts leave another body behind."""
    robot = load_robot("2sr-v2")
    goal = {"kappa_per_m": [12.0, -7.0]}
    made = plan(load_problem("rigid-move", robot=robot, goal=goal)).require()
    assert sum(map(sum, made.sequence)) > 0
    assert confirmed_s(made) == pytest.approx(walked_s(made), rel=0.01)


@pytest.mark.parametrize("number", [3])
def test_no_plan_is_confirmed_sooner_than_the_bound(number: int) -> None:
    """Of other sequences and timings: when the best one is forbidden, or windows are reserved."""
    asked: list[dict[str, object]] = [{}, {"timing": "constant"}, {"timing": "paper"}]
    asked += [{"transition_quantile": share} for share in (0.9, 0.99)]
    asked += [{"modes": tuple(mode for mode in MODES if mode != other)} for other in MODES[1:]]
    found = [planned(f"paper-{number}", **given) for given in asked]
    bounds = [confirmed_lower_bound(made) for made in found[:5]]  # of all modes
    soonest_s = min(map(confirmed_s, found))
    assert all(bound is not None and bound <= soonest_s for bound in bounds)


@pytest.mark.parametrize("given", [{}, {"timing": "paper"}, {"transition_quantile": 0.9}])
def test_a_bound_among_obstacles_is_one_of_exact_thermal_times(given: dict[str, object]) -> None:
    far = {"disc": {"x_m": 2.0, "y_m": 2.0, "radius_m": 0.1}}
    made = plan(load_problem("paper-2", obstacles=[far], **given)).require()
    bound_s = confirmed_lower_bound(made)
    assert bound_s is None if given else bound_s == made.lower_bound


def test_windows_hold_the_model_s_own_times() -> None:
    for name in ("2sra-v1", "2sr-v2", "3sra"):
        robot = load_robot(name)
        for j in range(robot.coordinates.segments):
            windows = confirming_windows(robot, robot.heater.ambient_C, j)
            assert 0.0 < windows.melt_early <= 1.0 <= windows.melt_late < 1.5
            assert windows.freeze_early == 0.0
            assert 1.0 <= windows.freeze_late < 1.5


@pytest.mark.parametrize(
    ("key", "factor"), [("confirmed_duration_s", 1.02), ("confirmed_lower_bound_s", 1.2)]
)
def test_a_false_claim_is_found(key: str, factor: float) -> None:
    result = solved("paper-2")
    made = result.require()
    stated = replace(made, confirmed_lower_bound=confirmed_lower_bound(made))
    document = replace(result, plan=stated).to_dict()
    assert checked_text(json.dumps(document), "plan.json").ok
    document[key] *= factor
    found = checked_text(json.dumps(document), "plan.json")
    assert [one.name for one in found.checks if not one.ok] == [key]


def test_nothing_is_told_without_segments() -> None:
    known = load_robot("2sra-v1")
    constant = {name: one for name, one in known.timing.items() if not one.needs_segment}
    robot = known.with_values(segment=None, timing=constant)
    document = plan(load_problem("paper-2", timing="constant", robot=robot)).to_dict()
    assert document["confirmed_duration_s"] is None
    assert document["duration_s"] > 0.0
