"""First melts and freezes of warm segments: no time of the first heating undercuts their bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from problems import ROBOT, at, goal_tree, random_problem
from thermal_problems import V2, earliest_finish, settled, thermal_model, thermal_problem

from twosra_mpc import Goal, Problem, Robot, Start, Status, plan
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode
from twosra_mpc.robot.timing import OverlappedTiming
from twosra_mpc.thermal.least_times import FirstCycle
from twosra_mpc.timing import transition_model

FREEZE = (RIGID, SOFT_1, RIGID)
TWICE = (RIGID, SOFT_1, RIGID, SOFT_1, RIGID)


def ends_of(problem: Problem, onset_s: float, held_s: float) -> tuple[float, float, float]:
    """(end of the melt, onset, end of the freeze) if a melt begins then and the metal is held."""
    heating = thermal_model(problem).plans[0]
    start = problem.start_states[0]
    melt = heating.heated(start, False, [("soft", onset_s)])[1][0]
    onsets: Any = [("soft", onset_s), ("rigid", melt.done_s + held_s)]
    freeze = heating.heated(start, False, onsets)[1][1]
    return melt.done_s, freeze.onset_s, freeze.done_s


def first_cycle(problem: Problem) -> FirstCycle:
    return thermal_model(problem).start.least[0].first_cycle


@pytest.mark.parametrize("held_s", [0.0, 20.0])
@pytest.mark.parametrize("quantile", [None, 0.9])
@pytest.mark.parametrize("start_C", [5.0, 25.0, 40.0, 50.0, 52.9])
def test_whenever_a_segment_is_heated_first_its_bounds_hold(
    start_C: float, quantile: float | None, held_s: float
) -> None:
    given: dict[str, Any] = {"temperature_C": (start_C, start_C), "heating": "keep_warm"}
    problem = thermal_problem(V2, **given, transition_quantile=quantile)
    cycle = first_cycle(problem)
    for onset_s in np.geomspace(1.0, 400.0, 7).tolist():
        molten_s, freeze_s, solid_s = ends_of(problem, onset_s, held_s)
        onset_s = max(onset_s, thermal_model(problem).start.least[0].first_lead_s)
        assert cycle.molten_s(onset_s - 1e-6) <= molten_s + 1e-6
        for earlier_s in (0.0, 10.0, 100.0):
            since_s, share = freeze_s - earlier_s, 0.6
            assert cycle.frozen_s(since_s - 1e-6, held_s) <= solid_s + 1e-6
            beyond = cycle.frozen_s(since_s - 1e-6, held_s, share)
            assert solid_s - share * freeze_s >= beyond - 1e-6


@pytest.mark.parametrize("start_C", [22.6, 25.0, 40.0, 50.0])
def test_without_windows_the_bounds_are_what_heating_at_once_takes(start_C: float) -> None:
    """Of a segment held at its threshold; the bodies of warm segments are half of the freeze."""
    problem = thermal_problem(V2, temperature_C=(start_C, start_C))
    molten_s, freeze_s, solid_s = ends_of(problem, 0.0, 0.0)
    cycle = first_cycle(problem)
    assert cycle.molten_s(0.0) == pytest.approx(molten_s, abs=0.1)
    assert cycle.frozen_s(0.0, 0.0) == pytest.approx(solid_s, abs=0.1)
    assert cycle.frozen_s(freeze_s + 50.0, 0.0) >= solid_s + 20.0


@pytest.mark.parametrize("sequence", [FREEZE, TWICE])
@pytest.mark.parametrize("start_C", [40.0, 50.0])
def test_transitions_of_a_warm_segment_take_about_what_the_network_says(
    start_C: float, sequence: tuple[Mode, ...]
) -> None:
    problem = thermal_problem(V2, temperature_C=(start_C, start_C))
    found = settled(problem, sequence, [0.0] * len(sequence))
    assert found is not None
    network = thermal_model(problem).network(sequence, RIGID, [0.0] * len(sequence))
    share = earliest_finish(network) / found.finish_s
    assert (0.995 if sequence == FREEZE else 0.85) <= share <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("robot", "start_C", "body_C", "lengths_s", "least"),
    [
        (ROBOT, 45.0, 45.0, (0.0,) * 5, 0.97),
        (ROBOT, 40.0, 40.0, (110.0, 15.0, 40.0), 0.885),
        (V2, 50.0, 30.0, (0.0,) * 3, 0.89),
    ],
)
def test_windows_of_a_warm_segment_are_counted(
    robot: Robot, start_C: float, body_C: float, lengths_s: tuple[float, ...], least: float
) -> None:
    body = (body_C, body_C) if robot is V2 else None
    given: dict[str, Any] = {"temperature_C": (start_C, start_C), "body_temperature_C": body}
    problem = thermal_problem(robot, **given, transition_quantile=0.9)
    found = settled(problem, sequence := TWICE[: len(lengths_s)], lengths_s)
    assert found is not None
    network = thermal_model(problem).network(sequence, RIGID, lengths_s)
    assert least <= earliest_finish(network) / found.finish_s <= 1.0 + 1e-9


@pytest.mark.parametrize(("start_C", "most"), [(25.0, 0.02), (40.0, 0.02), (50.0, 0.05)])
@pytest.mark.parametrize("seed", [1, 3, 6])
def test_the_follow_up_robot_starts_warm_with_a_small_gap(
    seed: int, start_C: float, most: float
) -> None:
    rng = np.random.default_rng(seed)

    def pose() -> dict[str, Any]:
        (x_m, y_m), phi_rad = rng.uniform(-0.25, 0.25, 2), rng.uniform(-np.pi, np.pi)
        kappa = tuple(rng.uniform(-15.0, 15.0, 2))
        return {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad, "kappa_per_m": kappa}

    start = Start(**pose(), temperature_C=(start_C, start_C))
    problem = Problem(robot=V2, start=start, goal=Goal(**pose()), gap=most)
    result = plan(problem).require()
    assert result.status is Status.OPTIMAL
    assert result.gap is not None
    assert 0.0 <= result.gap <= most


# --- what was called impossible once -------------------------------------------------------------


def test_a_segment_that_only_a_warm_body_lets_melt_is_not_called_impossible() -> None:
    """Heated with an impossibly cold body its metal would cool, and never coast."""
    assert V2.segment is not None
    weak = {"power_K_per_s": 0.874, "coupling_per_s": 0.02}
    segment = V2.segment.with_values(**weak, ranges={"body_loss_per_s": (0.006, 0.0088)})
    problem = Problem(
        robot=V2.with_values(segment=segment),
        start=Start(
            x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0), temperature_C=(50.0, 50.0)
        ),
        goal=Goal(kappa_per_m=(10.0, 0.0)),
        ambient_C=5.0,
        transition_quantile=0.9,
        gap=0.05,
    )
    result = plan(problem).require()
    assert result.verification.ok
    assert result.gap is not None
    assert 0.0 <= result.gap <= 0.05


def coasting_robot(melt_s: float) -> Robot:
    """One whose metal stays liquid for 20 s without heat."""
    timing = OverlappedTiming(
        overlap="full",
        melt_s=melt_s,
        melt_changing_s=4.0,
        freeze_s=100.0,
        freeze_changing_s=80.0,
        superheat_s=3.0,
    )
    return ROBOT.with_values(timing={"nominal": timing})


def both_at_once(melt_s: float, temperature_C: tuple[float, float]) -> Problem:
    start = random_problem(0).start.with_values(kappa_per_m=(0.0, 0.0), temperature_C=temperature_C)
    return Problem(
        robot=coasting_robot(melt_s),
        start=start,
        goal=Goal(kappa_per_m=(15.0, 15.0)),
        modes=[RIGID, SOFT_BOTH],
        heaters_at_once=1,
    )


@pytest.mark.parametrize("temperature_C", [(25.0, 25.0), (25.0, 50.0), (64.0, 25.0)])
def test_with_one_heater_metal_that_coasts_long_enough_lets_the_other_segment_melt(
    temperature_C: tuple[float, float],
) -> None:
    result = plan(both_at_once(12.0, temperature_C)).require()
    assert result.status is Status.OPTIMAL
    on = result.samples.heater_current_A > 0
    lasting = np.append(np.diff(result.samples.t_s), np.inf) > 1e-4
    assert not (on.all(axis=1) & lasting).any()


def test_where_it_freezes_before_the_other_one_is_molten_that_is_still_refused() -> None:
    assert plan(both_at_once(21.0, (25.0, 25.0))).status is Status.INFEASIBLE


@pytest.mark.parametrize("melt_s", [12.0, 18.0])
def test_bounds_with_coasting_hold_for_every_node_above(melt_s: float) -> None:
    problem = both_at_once(melt_s, (25.0, 40.0))
    problem = problem.with_values(modes=(RIGID, SOFT_1, SOFT_2, SOFT_BOTH))
    assert transition_model(problem).refusal((SOFT_1, SOFT_BOTH), RIGID) is None
    tree, leaves = goal_tree(problem), 0
    for first in problem.modes:
        for second in tree.children(at((RIGID, first))):
            above = max(map(tree.bound, [*map(at, [(RIGID,), second.head[:2]]), second]))
            leaf = tree.leaf_bound(second)
            leaves += leaf < np.inf
            assert leaf >= above - 1e-6
    assert leaves >= 3
