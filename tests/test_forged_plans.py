"""Plans that something is wrong with: each is refused, and told by name what is wrong with it."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from missions import made, repeated
from numpy.typing import NDArray
from once import planned, solved
from problems import at_once
from test_verification import planned_with

from twosra_mpc import InputError, Plan, Problem, Result, load_problem, load_robot
from twosra_mpc.checking import reintegration
from twosra_mpc.checking.plan_file import check_plan
from twosra_mpc.checking.reintegration import between, between_problems, reintegrate
from twosra_mpc.checking.verification import verify
from twosra_mpc.plans.result import Stats
from twosra_mpc.plans.trajectory import Samples, Trajectory, wheel_speeds
from twosra_mpc.problem.tolerances import JUMP_TOLERANCE, RATE_TOLERANCE, WHEEL_TOLERANCE_RAD_S
from twosra_mpc.robot.description import PATH_MODELS, segment_model, with_path_model
from twosra_mpc.robot.timing import SequentialTiming
from twosra_mpc.thermal.model import replayed

Array = NDArray[np.float64]


def told(trajectory: Trajectory) -> str:
    return "\n".join(verify(trajectory).problems)


def with_samples(made: Plan, **arrays: Array) -> Trajectory:
    return replace(made.trajectory, samples=replace(made.samples, **arrays))


def column(samples: Samples, name: str, segment: int, values: Array) -> Samples:
    array = getattr(samples, name).copy()
    array[:, segment] = values
    return replace(samples, **{name: array})


# --- the heating policy --------------------------------------------------------------------------


def remade(problem: Problem, samples: Samples, segment: int) -> Samples:
    """The samples with what their currents make of a segment."""
    model = segment_model(problem.robot, problem.ambient, segment)
    begins, currents = problem.temperatures[segment], samples.heater_current_A[:, segment]
    states = replayed(model, model.initial(begins), samples.t_s, currents)
    for name, of in (
        ("temperature_C", model.temperature_C),
        ("melt_fraction", model.melt_fraction),
    ):
        samples = column(samples, name, segment, of(states))
    return samples


def preheated(made: Plan) -> Trajectory:
    """The first melt is preheated at 0.9 A, so that its heater, at 0.8 A, goes on later."""
    item, given = made.transitions[0], made.trajectory
    segment, model = (
        item.segment - 1,
        segment_model(made.robot, made.problem.ambient, item.segment - 1),
    )
    inside = (made.samples.t_s > item.heater_s + 5.0) & (made.samples.t_s < item.onset_s - 1.0)
    later = float(made.samples.t_s[inside][-1])
    cold = model.initial(made.problem.ambient)
    warm = model.propagate(cold, made.robot.heater.melt_current_A, later - item.heater_s)
    on = later - model.time_until(cold, 0.9, model.level(warm))
    assert item.heater_s < on < later
    samples = given.at(np.sort([*made.samples.t_s, on]))
    preheats, before = (samples.t_s >= on) & (samples.t_s < later), samples.t_s < later
    current, setpoint = samples.heater_current_A[:, segment], samples.heater_setpoint_C[:, segment]
    current = np.where(before, np.where(preheats, 0.9, 0.0), current)
    setpoint = np.where(before, made.robot.heater.rigid_setpoint_C, setpoint)
    samples = column(samples, "heater_current_A", segment, current)
    samples = column(samples, "heater_setpoint_C", segment, setpoint)
    first = item._replace(heater_s=later)
    heated = replace(given, transitions=(first, *given.transitions[1:]))
    return replace(heated, samples=remade(made.problem, samples, segment))


def test_preheating_is_no_plan_of_the_policy() -> None:
    forged = preheated(planned("paper-2", robot="2sra-v1-paper"))
    (problem,) = verify(forged).problems
    assert "gives 0.9 A, not the 0 A of the heating policy" in problem


@cache
def kept_warm() -> Plan:
    """A plan in which segment 1 is kept warm until it melts again."""
    bend, drive = repeated((0.05, 0, 0, 0, 0)), repeated((0, 0, 6.0, 0, 0))
    inputs = np.array([bend, drive, bend, 0 * bend])
    asked = {"transition_quantile": 0.95, "heating": "keep_warm"}
    return made(np.zeros(5), ((1, 0), (0, 0), (1, 0), (0, 0)), inputs, **asked)


def test_segments_are_kept_warm_only_where_that_is_asked_for() -> None:
    warmed = kept_warm()
    assert 58.0 in warmed.samples.heater_setpoint_C[:, 0]
    assert verify(warmed.trajectory).problems == ()
    never = warmed.problem.with_values(heating="fastest")
    assert "A, not the 0 A of the heating policy" in told(replace(warmed.trajectory, problem=never))
    hotter = np.where(
        warmed.samples.heater_setpoint_C == 58.0, 59.0, warmed.samples.heater_setpoint_C
    )
    forged = with_samples(warmed, heater_setpoint_C=hotter)
    assert "heater 1 does not do what the transitions say" in told(forged)


def test_a_heater_that_regulates_instead_of_holding_is_found() -> None:
    warmed = kept_warm()
    warm = np.flatnonzero(warmed.samples.heater_setpoint_C[:, 0] == 58.0)
    current = warmed.samples.heater_current_A[:, 0].copy()
    current[warm[2:-2:2]] *= 1.1
    samples = column(warmed.samples, "heater_current_A", 0, current)
    forged = with_samples(warmed, **vars(remade(warmed.problem, samples, 0)))
    assert "heater 1 does not hold the 58 C of the heating policy" in told(forged)


# --- constant times ------------------------------------------------------------------------------


@pytest.mark.parametrize("timing", ["constant", "paper"])
def test_a_melt_takes_its_current(timing: str) -> None:
    made = planned("paper-1", timing=timing)
    samples = made.samples
    forged = with_samples(made, heater_current_A=1e-6 * (samples.heater_current_A > 0))
    assert "gives 1e-06 A, not the 0.8 A of the heating policy" in told(forged)


@pytest.mark.parametrize("timing", ["constant", "paper"])
@pytest.mark.parametrize(
    ("name", "value", "words"),
    [("temperature_C", 25.0, "warmer or colder"), ("melt_fraction", 0.0, "more or less of it")],
)
def test_metal_that_melts_gets_hot_and_liquid(
    timing: str, name: str, value: float, words: str
) -> None:
    made = planned("paper-1", timing=timing)
    forged = with_samples(made, **{name: np.full_like(getattr(made.samples, name), value)})
    assert words in told(forged)


# --- fixed waits ---------------------------------------------------------------------------------


def sooner(made: Plan, begin: float, by: float) -> Trajectory:
    """The plan without the span of time ``by`` in the middle of a wait that begins then."""
    t = made.samples.t_s
    kept = (t <= begin + 1.0) | (t >= begin + 1.0 + by)

    def shifted(time: float) -> float:
        return time - by if time > begin + 1.0 else time

    arrays = {name: array[kept] for name, array in vars(made.samples).items()}
    arrays["t_s"] = np.array([shifted(time) for time in arrays["t_s"].tolist()])
    return replace(
        made.trajectory,
        samples=Samples(**arrays),
        phases=tuple(
            p._replace(start_s=shifted(p.start_s), end_s=shifted(p.end_s)) for p in made.phases
        ),
        transitions=tuple(
            item._replace(**{name: shifted(getattr(item, name)) for name in item._fields[2:]})
            for item in made.transitions
        ),
    )


def test_nothing_bends_while_a_fixed_wait_freezes() -> None:
    made = planned("paper-1", timing="paper")
    last = made.transitions[-1]
    early = last._replace(heater_s=made.phases[-1].start_s)
    forged = replace(made.trajectory, transitions=(*made.transitions[:-1], early))
    words = (
        f"segment {last.segment} to rigid at {early.heater_s:.3f} s: the robot waits from then on"
    )
    assert words in told(forged)


def test_segments_do_not_change_one_by_one_where_waits_are_fixed() -> None:
    made = planned("paper-1", timing="paper", robot="2sra-v1-paper")  # [1,1], then [1,0]
    first = [item for item in made.transitions if item.segment == 1]
    gone = first[1:3]  # it just stays soft while the other one freezes
    left = tuple(item for item in made.transitions if item not in gone)
    assert "segment 1 is left soft, but all freeze before any melts" in told(
        replace(made.trajectory, transitions=left)
    )


def test_half_a_reconfiguration_is_no_wait() -> None:
    """Cooling as briefly as before a long melt, then melting as quickly as after a long freeze."""
    brief_cooling = SequentialTiming(
        overlap="none", heat_s=100.0, freeze_s=300.0, reconfigure_s=502.0, reconfigure_cool_s=10.0
    )
    made = planned_with(at_once(load_robot("2sra-v1")), brief_cooling)
    cooled = next(item for item in made.transitions if item.done_s - item.heater_s < 11.0)
    assert verify(made.trajectory).problems == ()
    forged = sooner(made, cooled.done_s, by=380.0)
    assert f"segment {cooled.segment} to rigid" in told(forged)
    assert "changes in 10.000 s instead of 300 s" in told(forged)


# --- the motion ----------------------------------------------------------------------------------


def test_the_mode_at_rest_is_that_of_the_metal() -> None:
    made = planned("paper-1")
    resting = np.flatnonzero(~made.samples.moves)
    for row in (resting[0], resting[len(resting) // 2], resting[-1]):
        mode = made.samples.mode.copy()
        mode[row, 1] = 1 - mode[row, 1]
        assert "rests in a mode in which segment 2 is" in told(with_samples(made, mode=mode))


@pytest.mark.parametrize("key", ["start_s", "end_s"])
def test_phases_begin_and_end_where_motion_does(key: str) -> None:
    made = planned("paper-1")
    for i, phase in enumerate(made.phases):
        moved = phase._replace(**{key: 1.001 * getattr(phase, key) + 1e-3})
        phases = (*made.phases[:i], moved, *made.phases[i + 1 :])
        assert "phase" in told(replace(made.trajectory, phases=phases))


def test_events_are_samples() -> None:
    made = planned("paper-1")
    later = made.transitions[0]._replace(onset_s=made.transitions[0].onset_s + 1e-3)
    forged = replace(made.trajectory, transitions=(later, *made.transitions[1:]))
    assert "heater, onset or done is at no sample" in told(forged)


# --- between samples -----------------------------------------------------------------------------


def bent_at_once(bent_per_m: tuple[float, float], lasting_s: float, most: float) -> Trajectory:
    """Both units at 0.03 m/s in one interval; wheels may turn at ``most``."""
    robot = at_once(load_robot("2sra-v1"))
    limits = robot.limits.with_values(wheel_speed_rad_s=most)
    path = {"model": "arc", "speed_reference": "fibre_end"}  # there speeds of wheels vary
    robot = robot.with_values(limits=limits, path=path)
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": bent_per_m}
    problem = load_problem("shape-change", robot=robot, start=start)
    v, rest = np.array([[0.03, 0.03, 0, 0, 0], [0, 0, 0, 0, 0]]), np.zeros((2, 2))
    q, mode = np.tile(problem.start.configuration, (2, 1)), np.ones((2, 2), dtype=int)
    t, wheels = np.array([0.0, lasting_s]), np.zeros((2, 4))
    samples = Samples(t, q, v, 0 * v, mode, wheels, rest + 25.0, rest, rest + 25.0, rest)
    end = reintegrate(problem, samples)
    return Trajectory(problem, replace(samples, q=end), (), ())


def speeds_at(trajectory: Trajectory, shares: list[float]) -> Array:
    """Largest speed of a wheel at shares of the time [rad/s]."""
    t = np.array(shares) * trajectory.duration_s
    samples = trajectory.samples
    v, mode = np.tile(samples.v[0], (len(t), 1)), np.tile(samples.mode[0], (len(t), 1))
    q = trajectory.configuration(t)
    return np.abs(wheel_speeds(trajectory.problem.robot, q, v, mode)).max(axis=1)


def test_wheels_are_looked_at_midway_between_samples() -> None:
    quick = bent_at_once((-55.0, -20.0), lasting_s=2.4, most=7.55)
    begin, middle, end = speeds_at(quick, [0.0, 0.5, 0.999])
    assert max(begin, end) < 7.5 < 7.6 < middle
    assert "limit wheel_speed_rad_s exceeded by" in told(quick)


def test_wheels_that_are_too_fast_only_in_between_are_found() -> None:
    quick = bent_at_once((-66.8, -31.8), lasting_s=6.4, most=7.55)
    assert speeds_at(quick, [0.0, 0.5, 0.999]).max() < 7.5
    assert 7.6 < speeds_at(quick, np.linspace(0.1, 0.9, 99).tolist()).max() < 7.615
    assert "limit wheel_speed" not in told(quick)
    (problem,) = too_fast(quick)
    assert problem.startswith("limit wheel_speed_rad_s exceeded by up to 0.06")
    assert not too_fast(bent_at_once((-66.8, -31.8), lasting_s=6.4, most=7.62))


def too_fast(trajectory: Trajectory) -> list[str]:
    """What is said of wheels between samples."""
    return [text for text in between_problems(trajectory) if "wheel_speed_rad_s" in text]


def test_enclosed_rates_hold_what_is_used_between_samples() -> None:
    """The bound is above every speed in between, and close to it."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        start, lasting = tuple(rng.uniform(-45.0, 0.0, 2).tolist()), float(rng.uniform(0.5, 4.0))
        fastest = speeds_at(bent_at_once(start, lasting, 10.0), np.linspace(0, 0.999, 400).tolist())
        assert too_fast(bent_at_once(start, lasting, 0.998 * fastest.max()))
        assert not too_fast(bent_at_once(start, lasting, 1.001 * fastest.max()))


# --- plan files ----------------------------------------------------------------------------------

Document = dict[str, Any]


def problems_in(document: Document, path: Path) -> str:
    path.write_text(json.dumps(document), encoding="utf-8")
    try:
        found = check_plan(path)
    except InputError as error:
        return str(error)
    assert found.ok == (not found.problems)
    return "\n".join(found.problems)


FORGED: dict[str, tuple[Callable[[Document], object], str]] = {
    "a robot with faster wheels": (
        lambda d: d["robot"]["limits"].update(wheel_speed_rad_s=12.0),
        "robot: not '2sra-v1': limits.wheel_speed_rad_s is 12.0, not 10.0",
    ),
    "a robot with other metal": (
        lambda d: d["robot"]["segment"]["metal"].update(heat_liquid_J_per_kg_K=1e3),
        "robot: not '2sra-v1': segment.metal.heat_liquid_J_per_kg_K is 1000.0",
    ),
    "a bound below zero": (lambda d: d.update(lower_bound_s=-1.0), "lower bound: below zero"),
    "a bound that is no number": (lambda d: d.update(lower_bound_s=float("nan")), "lower_bound_s"),
    "a plan better than it says": (lambda d: d.update(status="feasible"), "status: feasible; gap"),
    "a planner that proves nothing": (lambda d: d.update(planner="greedy"), "planner greedy"),
    "an end that was none": (lambda d: d.update(stopped_early=True), "stopped_early: True"),
    "a mission without tasks": (lambda d: d.update(version=3), "version: 3, without tasks"),
    "transitions in no order": (lambda d: d["transitions"].reverse(), "after a later one"),
    "a verification with problems": (
        lambda d: d["verification"].update(problems=["none"]),
        "in the file: its numbers are others",
    ),
}


@pytest.mark.parametrize("how", FORGED)
def test_a_forged_claim_is_refused_by_name(how: str, tmp_path: Path) -> None:
    document = deepcopy(solved("paper-1").to_dict())
    forge, words = FORGED[how]
    forge(document)
    assert words in problems_in(document, tmp_path / "plan.json")


def test_any_path_model_is_one_of_a_robot_and_other_robots_are_taken_as_they_are(
    tmp_path: Path,
) -> None:
    document = deepcopy(solved("paper-2", robot="2sra-v1-paper").to_dict())
    document["robot"]["path"]["growth"][0] *= 1.01
    words = "robot: not '2sra-v1-paper': path.growth is"
    assert words in problems_in(document, tmp_path / "plan.json")
    document["robot"]["path"]["model"] = "log_spiral_corrected"
    words = "robot: not '2sra-v1-paper' with path model log_spiral_corrected: path.growth is"
    assert words in problems_in(document, tmp_path / "plan.json")
    document["robot"]["path"]["growth"] = load_robot("2sra-v1-paper").path.growth  # type: ignore[attr-defined]
    assert "robot:" not in problems_in(document, tmp_path / "plan.json")
    for model in PATH_MODELS:
        robot = with_path_model(load_robot("2sra-v1"), model).model_dump(mode="json")
        kept, path = deepcopy(solved("paper-1").to_dict()), tmp_path / "plan.json"
        kept["robot"] = robot
        assert "robot:" not in problems_in(kept, path)
        if "scale" in robot["path"]:
            robot["path"]["scale"] = [0.2 * scale for scale in robot["path"]["scale"]]
            assert "path.scale is" in problems_in(kept, path)
    document = deepcopy(solved("paper-2", robot="2sra-v1-paper").to_dict())
    document["robot"]["name"] = document["scenario"]["robot"] = "mine"
    path = tmp_path / "plan.json"
    assert problems_in(document, path) == ""
    others = check_plan(path, load_robot("2sra-v1-paper")).problems
    assert any("name is mine" in problem for problem in others)


@given(st.integers(0, 172), st.integers(1, 5))
@settings(max_examples=20)
def test_rows_are_left_out_unnoticed_only_where_the_plan_stays_the_same(
    first: int, count: int
) -> None:
    made = planned("paper-1")
    given, few = made.samples, np.delete(np.arange(len(made.samples)), slice(first, first + count))
    names = [item.name for item in fields(Samples)]
    forged = with_samples(made, **{name: getattr(given, name)[few] for name in names})
    if not verify(forged).problems:
        again = forged.at(given.t_s)
        for name in ("q", "v", "mode", "wheel_rad_s", "heater_current_A", "heater_setpoint_C"):
            assert np.allclose(getattr(again, name), getattr(given, name), atol=1e-6), name


# What may be changed unnoticed, and why.
HARMLESS = {
    "message": "words",
    "package": "who wrote the file",
    "stats": "what the search has cost",
    "scenario": "the problem itself: the plan is checked against what it says",
    "robot.description": "words",
    "verification.max_defect": "rounding of the integration, to its tolerance",
    "verification.goal_error": "the same",
    "gap": "where it is below the tolerance",
}
LEAST = {"temperature_C": 0.05, "melt_fraction": 0.005, "mode": 1.0}  # changes that count


def numbers(value: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Where the numbers of a document are, its samples aside."""
    if isinstance(value, dict | list):
        inner = value.items() if isinstance(value, dict) else enumerate(value)
        for key, item in inner:
            if key != "samples":
                yield from numbers(item, (*path, key))
    elif isinstance(value, int | float):
        yield path


def changed(value: float, rng: random.Random) -> float:
    """A number that is another: by one per cent, of the other sign, or the other truth value."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    return rng.choice([1.01, 0.99, -1.0]) * value if value else 0.01


def edits(document: Document, rng: random.Random, count: int) -> Iterator[tuple[str, Document]]:
    """Documents with one number changed, half of them in the samples."""
    said = {".".join(map(str, path)): path for path in numbers(document)}
    counted = [path for name, path in said.items() if not name.startswith(tuple(HARMLESS))]
    while count:
        edited = deepcopy(document)
        if count % 2:
            *where, last = rng.choice(counted)
            place: Any = edited
            for key in where:
                place = place[key]
            place[last] = changed(place[last], rng)
            name = ".".join(map(str, (*where, last)))
        else:
            name = rng.choice(list(document["samples"]))
            rows = edited["samples"][name]
            row = rng.randrange(len(rows))
            place = rows if name == "t_s" else rows[row]
            last = row if name == "t_s" else rng.randrange(len(place))
            before = place[last]
            place[last] = 1 - before if name == "mode" else changed(before, rng)
            if abs(place[last] - before) < LEAST.get(name, 1e-4):
                continue
            name = f"samples.{name}.{row}"
        count -= 1
        yield name, edited


CASES: dict[str, dict[str, Any]] = {
    "paper": {"scenario": "paper-2", "robot": "2sra-v1-paper"},
    "accelerations": {"scenario": "paper-1"},
    "constant": {"scenario": "paper-1", "timing": "constant"},
    "waits": {"scenario": "paper-1", "timing": "paper"},
    "three": {"scenario": "three-segments"},
}
MISSION = {
    "tasks": ({"do": "reach", "x_m": 0.1, "y_m": 0.05, "phi_rad": 0.2, "kappa_per_m": (0.0, 0.0)},),
    "goal": {"x_m": 0.2, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (15.0, 0.0)},
}


def as_file(made_by_hand: Plan) -> Document:
    """The document of a plan that was made by hand."""
    stats, known = Stats(0.0, 0, 0, 0), replace(made_by_hand, lower_bound=0.0)
    return Result(known.problem, "optimal", known.status, "", 0.0, None, stats, known).to_dict()


@pytest.mark.parametrize("case", [*CASES, "kept warm", "mission"])
def test_no_number_of_a_plan_is_changed_unnoticed(case: str, tmp_path: Path) -> None:
    if case in CASES:
        document = solved(**CASES[case]).to_dict()
    elif case == "mission":
        document = solved("rigid-move", **MISSION).to_dict()
    else:
        document = as_file(kept_warm())
    document = json.loads(json.dumps(document))
    path = tmp_path / "plan.json"
    assert problems_in(document, path) == ""
    for name, edited in edits(document, random.Random(case), 4):
        assert problems_in(edited, path), name


def test_what_speeds_may_gain_between_samples_is_added_to_their_shares(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The units are at full speed all the time: any gain is too much, beyond rounding."""
    trajectory = planned("paper-1", robot="2sra-v1-paper").trajectory
    samples, rates = trajectory.samples, reintegration.share_rates
    soft = samples.mode[:-1].any(axis=1)
    fine, _ = between(samples, np.where(soft, reintegration._CUT, np.inf), least=1)
    moving = fine.mode[:-1].any(axis=1) & fine.moves[:-1]
    longest_s = float(np.diff(fine.t_s)[moving].max())
    for gain, told in ((0.5 * RATE_TOLERANCE, False), (2 * RATE_TOLERANCE, True)):
        rate = 2 * gain / longest_s  # within +-rate it is (M - m) h / 4 = rate h / 2 at most

        def known(*given: Any, most: float = rate) -> Any:
            return tuple(sign * np.full_like(rates(*given)[0], most) for sign in (-1, 1))

        monkeypatch.setattr(reintegration, "share_rates", known)
        found = [text for text in between_problems(trajectory) if "unit_speed_m_s" in text]
        assert bool(found) == told


@pytest.mark.parametrize(("count", "kept"), [(4, True), (20, False)])
def test_small_jumps_of_wheels_add_up(count: int, kept: bool) -> None:
    """Each is less than a wheel may turn otherwise than its inputs ask; all together are told."""
    made = planned("paper-1")
    by = 0.9 * WHEEL_TOLERANCE_RAD_S
    most = JUMP_TOLERANCE * made.robot.limits.wheel_speed_rad_s
    assert by < most
    wheels = made.samples.wheel_rad_s.copy()
    inside = np.flatnonzero(made.samples.moves[:-1] & made.samples.moves[1:])[1::2][:count] + 1
    assert len(inside) == count
    wheels[inside, 0] += by
    assert (count * by <= most) == kept
    assert ("a wheel's speed jumps" in told(with_samples(made, wheel_rad_s=wheels))) != kept
