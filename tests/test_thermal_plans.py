"""Plans by the thermal model: bounds below costs, checked by replaying their currents."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from once import planned, solved
from problems import at_once
from test_verification import Case, assert_found, case_of
from thermal_problems import V1, V2

from twosra_mpc import Goal, Plan, Problem, Start, Status, load_problem, plan
from twosra_mpc.robot.description import segment_model

Array = NDArray[np.float64]

# --- bounds and costs of whole plans -------------------------------------------------------------


def drawn_problem(seed: int) -> Problem:
    """A random problem of either robot: air, start temperatures, window, policy and price."""
    rng = np.random.default_rng(seed)
    robot, widest = ((V1, 50.0), (V2, 15.0))[seed % 2]
    solid, liquid = ((60.9, 61.1), (53.0, 68.4))[seed % 2]
    ambient = float(rng.choice([5.0, robot.heater.ambient_C, 40.0]))

    def pose() -> dict[str, Any]:
        x, y, phi = rng.uniform(-0.25, 0.25, 3) * [1, 1, 12]
        return {"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": rng.uniform(-widest, widest, 2)}

    kinds = rng.choice(3, size=2, p=[0.5, 0.35, 0.15])
    warm = [[ambient, rng.uniform(0, solid), rng.uniform(liquid, 85)][kind] for kind in kinds]
    return Problem(
        robot=robot,
        start=Start(**pose(), temperature_C=warm),
        goal=Goal(**pose(), tolerance="exact"),
        ambient_C=ambient,
        transition_quantile=[None, None, 0.9][rng.integers(3)],
        heating=["fastest", "keep_warm"][rng.integers(2)],
        weights={"energy_s_per_J": float(rng.choice([0.0, 0.0, 0.02]))},
        gap=0.02,
        work_limit=8000.0,
    )


# Not among them: segments of 2sr-v2 that start liquid (their bound is up to 13 % below), and those
# that are warm while the first drive takes longer than they take to melt.
FAST = [400, 402, 404, 406, 412, 424, 432, 438, 409, 413, 423, 433, 437, 441, 447]
# Metal of 2sr-v2 that melts in half a minute leaves the driving in view, whose bound is looser.
WIDE = {403: 0.06, 427: 0.03, 429: 0.06, 435: 0.04}
# Ramps, and parts of the body that are kept apart, add up to 3 % to these that the bound does not
# know of: here they are at speed at once, and only the units are kept apart.
AT_ONCE = [406, 423, 427, 435]


@pytest.mark.parametrize("seed", FAST)
def test_random_thermal_plans_are_verified_and_close_to_their_bound(seed: int) -> None:
    problem = drawn_problem(seed)
    if seed in AT_ONCE:
        problem = problem.with_values(robot=at_once(problem.robot))
    result = plan(problem).require()
    assert result.status is Status.OPTIMAL
    assert result.verification.ok
    assert result.lower_bound is not None
    assert result.gap is not None
    assert result.lower_bound <= result.cost.total + 1e-6
    assert result.gap <= 0.02


@pytest.mark.parametrize("seed", WIDE)
def test_short_melts_leave_an_honest_gap(seed: int) -> None:
    problem = drawn_problem(seed).with_values(work_limit=2000.0)
    if seed in AT_ONCE:
        problem = problem.with_values(robot=at_once(problem.robot))
    result = plan(problem).require()
    assert result.verification.ok
    assert result.gap is not None
    assert 0.0 <= result.gap <= WIDE[seed]


@pytest.mark.parametrize("name", ["paper-2", "paper-4"])
def test_a_warmer_start_never_makes_the_papers_robot_slower(name: str) -> None:
    start = load_problem(name).start.model_dump()
    ends = []
    for warm in (10.0, 25.0, 45.0, 60.0):
        result = planned(name, start={**start, "temperature_C": (warm, warm)})
        ends.append(result.duration_s)
    assert ends == sorted(ends, reverse=True)
    assert ends[1] - ends[3] > 20.0


@pytest.mark.parametrize("robot", [V1, V2], ids=lambda robot: robot.name)
def test_in_colder_air_melts_take_longer_and_freezes_less(robot: Any) -> None:
    spans = []
    for ambient in (5.0, 15.0, 25.0, 35.0):
        result = solved("shape-change", robot=robot, goal=GOAL, ambient_C=ambient)
        spans.append([item.done_s - item.heater_s for item in result.require().transitions])
    melts, freezes = zip(*spans, strict=True)
    assert list(melts) == sorted(melts, reverse=True)
    assert list(freezes) == sorted(freezes)
    assert melts[0] > 1.2 * melts[-1]
    assert freezes[-1] > 1.2 * freezes[0]


GOAL = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (12.0, 0.0)}


# --- plans that were tampered with ---------------------------------------------------------------


@pytest.fixture(scope="module", params=[None, 0.9], ids=["exact", "window"])
def case(request: pytest.FixtureRequest) -> Case:
    """The plan of paper-1, [0,0] > [1,0] > [1,1], with and without windows."""
    found: Plan = planned("paper-1", transition_quantile=request.param)
    return case_of(found)


def later_current(case: Case, segment: int, by_s: float) -> Case:
    """All that a heater does happens later, as the same rows in time."""
    t, current = case.samples.t_s, case.samples.heater_current_A.copy()
    before = np.searchsorted(t, t - by_s, side="right") - 1
    current[:, segment - 1] = np.where(before < 0, 0.0, current[before, segment - 1])
    return replace(case, samples=replace(case.samples, heater_current_A=current))


def without_heat(case: Case, segment: int, share: float) -> Case:
    """A heater gives less."""
    current = case.samples.heater_current_A.copy()
    current[:, segment - 1] *= share
    return replace(case, samples=replace(case.samples, heater_current_A=current))


def warmer(case: Case, segment: int, by_C: float) -> Case:
    temperature = case.samples.temperature_C.copy()
    temperature[:, segment - 1] += by_C
    return replace(case, samples=replace(case.samples, temperature_C=temperature))


def less_molten(case: Case, segment: int, by: float) -> Case:
    fraction = case.samples.melt_fraction.copy()
    fraction[:, segment - 1] = np.maximum(0.0, fraction[:, segment - 1] - by)
    return replace(case, samples=replace(case.samples, melt_fraction=fraction))


def replayed(case: Case, segment: int, current: Array) -> Case:
    """Another current, with the temperature and melt fraction that it makes."""
    model, samples = segment_model(case.problem.robot, case.problem.ambient, 0), case.samples
    states = [model.initial(case.problem.temperatures[segment - 1])]
    for ampere, span in zip(current[:-1].tolist(), np.diff(samples.t_s).tolist(), strict=True):
        states.append(model.propagate(states[-1], ampere, span))
    columns = {
        "heater_current_A": current,
        "temperature_C": np.array([model.temperature_C(state) for state in states]),
        "melt_fraction": np.array([model.melt_fraction(state) for state in states]),
    }
    arrays = {name: getattr(samples, name).copy() for name in columns}
    for name, column in columns.items():
        arrays[name][:, segment - 1] = column
    return replace(case, samples=replace(samples, **arrays))


def kept_liquid(case: Case, segment: int) -> Case:
    """The heater holds on at a low set-point where the metal should freeze."""
    onset = case.transitions[case.find(segment, "rigid")].onset_s
    current = case.samples.heater_current_A[:, segment - 1]
    return replayed(case, segment, np.where(case.samples.t_s >= onset - 1e-3, 0.31, current))


def molten_again(case: Case, segment: int) -> Case:
    """The last 45 s of the plan melt some of the metal again."""
    t, current = case.samples.t_s, case.samples.heater_current_A[:, segment - 1]
    return replayed(case, segment, np.where(t >= t[-1] - 45.0, 0.8, current))


def under(case: Case, **changes: Any) -> Case:
    """The same plan checked against a problem that differs."""
    return replace(case, problem=case.problem.with_values(**changes))


WARMER = "^segment {}: its currents make it .* C warmer or colder at .* s$"
TAMPERED: dict[str, tuple[Callable[[Case], Case], list[str]]] = {
    "a heater that starts 6 s late": (lambda c: later_current(c, 1, 6.0), [WARMER.format(1)]),
    "the other heater 6 s late": (lambda c: later_current(c, 2, 6.0), [WARMER.format(2)]),
    "a heater of 9 tenths of the current": (
        lambda c: without_heat(c, 1, 0.9),
        [WARMER.format(1), "^segment 1: its currents leave it changing at .* s$"],
    ),
    "a heater without current": (
        lambda c: without_heat(c, 2, 0.0),
        [WARMER.format(2), "^segment 2: its currents leave it changing at .* s$"],
    ),
    "a temperature column that is 0.05 C too warm": (
        lambda c: warmer(c, 1, 0.05),
        ["^segment 1: its currents make it 0.05 C warmer or colder"],
    ),
    "a temperature column that is 1 C too cold": (lambda c: warmer(c, 2, -1.0), [WARMER.format(2)]),
    "a melt fraction that is too small": (
        lambda c: less_molten(c, 1, 0.01),
        ["^segment 1: its currents melt 0.01 more or less of it"],
    ),
    **{
        f"an onset of a change to {to} that is too late": (
            lambda c, to=to: c.move(2, to, onset_s=1.0),
            [f"^segment 2 to {to} at .* s: begins to change at .* s, before .* s$"],
        )
        for to in ("soft", "rigid")
    },
    **{
        f"a change to {to} that is done too early": (
            lambda c, to=to: c.move(1, to, done_s=-1.0),
            [f"^segment 1 to {to} at .* s: has changed at .* s only, after .* s$"],
        )
        for to in ("soft", "rigid")
    },
    "a heater said to be on later": (
        lambda c: c.move(2, "soft", heater_s=3.0),
        ["^at .* s heater 2 does not do what the transitions say$"],
    ),
    "a heater said to be off earlier": (
        lambda c: c.move(2, "rigid", heater_s=-3.0),
        ["^segment 2 to rigid at .* s"],
    ),
    "metal that is kept liquid for ever": (
        lambda c: kept_liquid(c, 1),
        ["^segment 1: its currents do not make it rigid until .* s$"],
    ),
    "metal that melts again in the end": (
        lambda c: molten_again(c, 2),
        ["^segment 2: its currents do not make it rigid until .* s$"],
    ),
    "one heater at a time": (
        lambda c: under(c, heaters_at_once=1),
        ["^at .* s both heaters are on$"],
    ),
    "warmer air": (lambda c: under(c, ambient_C=27.0), [WARMER.format(1), WARMER.format(2)]),
    "a colder start": (
        lambda c: under(c, start=c.problem.start.with_values(temperature_C=(24.0, 25.0))),
        ["^segment 1: its currents make it .* C warmer or colder at 0.000 s$"],
    ),
    "a wider window": (
        lambda c: under(c, transition_quantile=0.97),
        ["^segment 1 to soft at .* s: has changed at .* s only", "segment 2 to rigid at .* only"],
    ),
}


def test_thermal_plans_hold_as_they_are(case: Case) -> None:
    assert case.check().problems == ()


@pytest.mark.parametrize("how", TAMPERED)
def test_what_was_tampered_with_is_named(case: Case, how: str) -> None:
    tamper, words = TAMPERED[how]
    assert_found(tamper(case), *words)


def test_two_heaters_on_at_once_are_named_where_one_is_allowed() -> None:
    """A plan for one heater, its second one on for a while during the first one's dwell."""
    case = case_of(planned("paper-1", heaters_at_once=1))
    assert case.check().problems == ()
    current = case.samples.heater_current_A
    row = int(np.flatnonzero(current[:, 0] > 0)[1])
    spoilt = case.set("heater_current_A", row, 1, 0.1)
    when = re.escape(f"at {case.samples.t_s[row]:.3f} s both heaters are on")
    assert_found(spoilt, f"^{when}$")


@pytest.mark.parametrize("kappa_per_m", [(12.0, -1.0), (2.0, 10.0)])
def test_a_plans_own_end_temperatures_are_a_start(kappa_per_m: tuple[float, float]) -> None:
    """53.00000000000001 C was neither solid nor liquid."""
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(2.0, -1.0))
    goal = Goal(x_m=0.1, y_m=-0.1, phi_rad=0.2, kappa_per_m=kappa_per_m)
    problem = Problem(robot=V2, start=start, goal=goal)
    made = plan(problem).require()
    ends = tuple(made.samples.temperature_C[-1].tolist())
    assert max(ends) == pytest.approx(53.0, abs=1e-6)
    again = start.model_copy(update={"temperature_C": ends})
    assert problem.with_values(start=again).start_mode == (0, 0)
