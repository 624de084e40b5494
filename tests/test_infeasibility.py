"""Where there is no plan, the message names goal, invariant or limit, and what to change."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from once import cases, solved
from problems import goal_tree

from twosra_mpc import Goal, Problem, Start, Status, load_robot, plan
from twosra_mpc.effort import Ending
from twosra_mpc.model.bending import bending
from twosra_mpc.planning.bounds.bends import unreachable_reason
from twosra_mpc.planning.planner import plan_until_interrupted
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.planning.search.infeasibility import impossibility
from twosra_mpc.robot.description import PATH_MODELS, with_path_model
from twosra_mpc.robot.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode, ModeSequence
from twosra_mpc.timing import transition_model

ROBOT = load_robot("2sra-v1-paper")
ARC = load_robot("2sra-v1")


def problem(
    start: tuple[float, float], goal: tuple[float | str, float | str], **other: Any
) -> Problem:
    """Bend from ``start`` to ``goal`` [1/m]; ``goal_*`` keys go into the goal."""
    asked = {key.removeprefix("goal_"): other.pop(key) for key in list(other) if "goal_" in key}
    here = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=start)
    there = Goal(kappa_per_m=goal, **{"tolerance": "exact", **asked})
    return Problem(**{"robot": ROBOT, "start": here, "goal": there, **other})


# --- proved infeasible ---------------------------------------------------------------------------

PROVED = cases("infeasibility")["proved"]


@pytest.mark.parametrize("given", PROVED, ids=[given["case"] for given in PROVED])
def test_what_is_proved_infeasible_says_why_and_what_to_change(given: dict[str, Any]) -> None:
    robot = ARC if "path_model" in given else ROBOT
    result = plan(problem(given["start"], given["goal"], robot=robot, **given["asked"]))
    assert result.status is Status.INFEASIBLE
    assert given["words"] in result.message
    assert (result.plan, result.lower_bound, result.stopped_early) == (None, None, False)


def test_what_is_impossible_is_proved_even_without_time() -> None:
    case = problem((0, 0), (10, 10), goal_mode=SOFT_BOTH, heaters_at_once=1, work_limit=1e-9)
    result = plan(case)
    assert result.status is Status.INFEASIBLE
    assert not result.stopped_early


def test_where_no_other_sequence_is_allowed_that_is_said() -> None:
    case = problem((0, 0), (10, 0), modes=[SOFT_1])
    result = plan_until_interrupted(case, excluded=frozenset({(SOFT_1,)}))
    assert result.message == (
        "proved infeasible: there is no other mode sequence; allowed modes are [1,0]: add another "
        "mode"
    )


@pytest.mark.parametrize("modes", [[RIGID], [RIGID, SOFT_1], [RIGID, SOFT_BOTH]], ids=str)
def test_following_the_advice_gives_a_plan(modes: list[Mode]) -> None:
    case = problem((0, 0), (10, -20), modes=modes)
    advice = plan(case).message.rpartition(": add ")[2]
    for option in advice.split(" or "):
        more = [mode for mode in MODES if f"[{mode[0]},{mode[1]}]" in option]
        assert more
        assert plan(case.with_values(modes=[*modes, *more])).found


@pytest.mark.parametrize("name", PATH_MODELS)
def test_what_both_segments_keep_is_measured_as_it_is_named(name: str) -> None:
    """Bent to a goal that keeps it [1,1] suffices; off by some of it, just that is reported."""
    robot = with_path_model(ARC if name == "arc" else ROBOT, name)
    case = problem((0, 0), (20, 5), robot=robot)
    task = bending_task(case)
    reason = unreachable_reason((RIGID, SOFT_BOTH, RIGID), task)
    assert reason is not None
    w1, w2 = (bending(robot).coordinate(kappa) for kappa in (20.0, 5.0))
    value, unit = (15.0, "1/m") if name == "arc" else (w1 - w2, "m")
    assert f"must change by {value:+.3g} {unit};" in reason
    same = replace(task, change=((w1, w1), (w1, w1)))
    assert unreachable_reason((RIGID, SOFT_BOTH, RIGID), same) is None


def test_the_invariants_forbid_exactly_what_the_modes_cannot_bend() -> None:
    """Every set of soft modes: two unequal bends take two modes that differ."""
    task = bending_task(problem((0, 0), (10, -20)))
    for count in range(4):
        for modes in itertools.combinations((SOFT_1, SOFT_2, SOFT_BOTH), count):
            assert (unreachable_reason((RIGID, *modes), task) is None) == (count >= 2)


@pytest.mark.parametrize(
    ("timing", "heaters"), [("nominal", 1), ("nominal", 2), ("constant", 1), ("paper", 2)]
)
def test_nothing_is_called_impossible_that_some_sequence_bends(timing: str, heaters: int) -> None:
    """Every set of modes, with starts that are soft already and goals that stay soft."""
    possible = impossible = 0
    sets = [modes for count in range(1, 5) for modes in itertools.combinations(MODES, count)]
    goals, warm = [(6.0, 6.0), (6.0, -3.0)], [(25.0, 25.0), (64.0, 25.0)]
    for modes, (k, last), goal in itertools.product(sets, enumerate(MODES), goals):
        for temperatures in warm[(k + heaters) % 2 :][:1]:  # the other with the other heaters
            start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
            case = Problem(
                robot=ROBOT,
                start={**start, "temperature_C": temperatures},
                goal={"kappa_per_m": goal, "mode": last},
                modes=modes,
                timing=timing,
                heaters_at_once=heaters,
            )
            reason = impossibility(goal_tree(case))
            found = bending_sequences(case)
            assert reason is None or not found, (modes, last, goal, reason)
            if case.start_mode == RIGID:  # metal that is liquid already may coast: no proof then
                assert found or reason is not None, (modes, last, goal)
            impossible += reason is not None
            possible += reason is None
    assert min(possible, impossible) > 20


def bending_sequences(case: Problem) -> list[ModeSequence]:
    """Sequences of up to four phases that can be heated, and whose bends add up to the goal's."""
    timing, task = transition_model(case), bending_task(case)
    wanted = np.array([low for low, _ in task.change])
    found = []
    for length in range(1, 5):
        for modes in itertools.product(case.modes, repeat=length):
            bends, *_ = np.linalg.lstsq(np.array(modes, dtype=float).T, wanted, rcond=None)
            missed = np.abs(np.array(modes).T @ bends - wanted).max()
            if missed < 1e-9 and timing.refusal(modes, case.goal.mode) is None:
                found.append(modes)
    return found


# --- nothing found, nothing proved ---------------------------------------------------------------


@pytest.mark.parametrize("most", [1, 2, 3])
def test_too_few_phases_say_how_many_are_needed(most: int) -> None:
    case = problem((0, 0), (10, 20), max_phases=most)
    result = plan(case)
    assert result.status is Status.FAILED
    assert "a plan needs at least 4 phases, possibly [0,0] > " in result.message
    assert result.message.endswith(f"but max_phases is {most}: raise max_phases")
    enough = plan(case.with_values(max_phases=4)).require()
    assert result.lower_bound is not None
    assert result.lower_bound <= enough.cost.total


def test_a_shape_limit_that_asks_for_more_phases_is_named() -> None:
    """[1,0] would first have to make up for what [1,1] adds: more than the range allows."""
    case = problem((-20, -60), (-40, 60), modes=[RIGID, SOFT_1, SOFT_BOTH], max_phases=4)
    result = plan(case)
    assert result.status is Status.FAILED
    assert "a plan needs at least 5 phases" in result.message
    assert (
        "in [0,0] > [1,0] > [1,1] > [0,0], mode [1,0] would have to bend segment 1 beyond "
        "curvature_per_m = 78.5 1/m (kappa1 from -20 to -40 1/m, kappa2 from -60 to 60 1/m)"
    ) in result.message


def test_how_many_phases_are_needed_is_not_searched_for_ever() -> None:
    """[1,0] there, [1,1], [1,0] back: five phases, further off than is looked."""
    case = problem((0, -70), (0, 70), modes=[RIGID, SOFT_1, SOFT_BOTH], max_phases=1)
    result = plan(case)
    assert result.status is Status.FAILED
    assert "a plan needs at least 5 phases, but max_phases is 1: raise" in result.message
    assert "possibly" not in result.message


def test_a_pose_without_driving_asks_for_mode_00() -> None:
    result = plan(problem((5, -5), (5, -5), goal_x_m=0.1, modes=[SOFT_1], max_phases=2))
    assert result.status is Status.FAILED
    assert "without mode [0,0] the pose changes only by bending: add [0,0]" in result.message


def test_a_limit_is_told_with_the_effort() -> None:
    result = plan(problem((0, 0), (10, 20), work_limit=1e-9))
    assert result.message == (
        "no plan found (a limit was reached): raise work_limit (0 mode sequences tried, "
        "work_limit is 1e-09)"
    )


# --- found, but not as good as asked -------------------------------------------------------------


def test_a_gap_that_is_left_is_explained() -> None:
    result = solved("rigid-move", gap=0.0)
    assert (result.status, result.ending) == (Status.FEASIBLE, Ending.EXHAUSTED)
    assert 0 < (result.gap or 0.0) < 0.06
    assert result.message.endswith(
        "no mode sequence of up to max_phases = 8 is left to try: the gap is slack of the bounds, "
        "or in longer sequences"
    )


def test_a_bound_of_zero_is_said_in_plain_numbers() -> None:
    case = Problem(
        robot=ROBOT,
        start=Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0)),
        goal=Goal(x_m=0.05),
        max_phases=1,
    )
    result = plan(case)
    assert result.gap is not None
    if result.gap > 0.995:
        assert "within 100 % of the best" in result.message
    assert "e+" not in result.message
