"""A trajectory is exact between its samples, not interpolated, and repeats them at them."""

from __future__ import annotations

import itertools
from dataclasses import fields, replace

import numpy as np
import pytest
from once import planned
from scipy.integrate import solve_ivp

from twosra_mpc import InputError, Plan
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.rolling import NO_DRIFT, rolling
from twosra_mpc.plans.trajectory import SAME_TIME_S, Samples, Trajectory, flown
from twosra_mpc.robot.description import with_path_model
from twosra_mpc.timing import transition_model

EXACT = 1e-9  # m, rad, 1/m


@pytest.fixture(scope="module")
def bending() -> Trajectory:
    """A plan whose wheels turn at a changing rate, from rest to rest and as the shape changes."""
    return planned("shape-change").trajectory


def between(trajectory: Trajectory) -> np.ndarray:
    """Times inside every interval of the grid."""
    t = trajectory.samples.t_s
    return np.concatenate([t[:-1] + share * np.diff(t) for share in (0.1, 0.5, 0.77)])


def test_at_its_samples_a_trajectory_is_its_samples(any_plan: Plan) -> None:
    given = any_plan.trajectory
    found = given.at(given.samples.t_s)
    for item in fields(Samples):
        expected = getattr(given.samples, item.name)
        atol = {"temperature_C": 1e-9, "melt_fraction": 1e-9, "wheel_rad_s": 1e-14}.get(
            item.name, 0.0
        )
        np.testing.assert_allclose(getattr(found, item.name), expected, rtol=0, atol=atol)


def test_between_samples_the_configuration_solves_the_kinematics(bending: Trajectory) -> None:
    samples, jacobian = bending.samples, kinematics(bending.problem.robot).jacobian
    moving = np.flatnonzero(samples.moves)
    assert not samples.v[moving[0]].any()  # from rest, by its acceleration alone
    for i in moving[:: len(moving) // 12]:
        v, a, mode = samples.v[i], samples.a[i], samples.mode[i]
        span = 0.6 * (samples.t_s[i + 1] - samples.t_s[i])
        exact = solve_ivp(
            lambda t, q, v=v, a=a, mode=mode: (jacobian(q, mode) @ (v + a * t)).full().ravel(),
            (0.0, span),
            samples.q[i],
            method="DOP853",
            rtol=1e-12,
            atol=1e-14,
        )
        found = bending.configuration([samples.t_s[i] + span])[0]
        np.testing.assert_allclose(found, exact.y[:, -1], rtol=0, atol=EXACT)


def test_wheels_travel_as_fast_as_they_turn(bending: Trajectory) -> None:
    t, step = between(bending), 1e-4
    inside = np.abs(t[:, None] - bending.samples.t_s).min(axis=1) > 2 * step
    t = t[inside]
    ahead, behind = bending.wheel_travel_rad(t + step), bending.wheel_travel_rad(t - step)
    np.testing.assert_allclose((ahead - behind) / (2 * step), bending.at(t).wheel_rad_s, atol=1e-6)
    held = bending.samples.wheel_rad_s[np.searchsorted(bending.samples.t_s, t) - 1]
    assert np.abs(bending.at(t).wheel_rad_s - held).max() > 1e-3


def test_wheel_travel_adds_up_over_samples(bending: Trajectory) -> None:
    t = bending.samples.t_s
    before, at = bending.wheel_travel_rad(t[1:] - 2 * SAME_TIME_S), bending.wheel_travel_rad(t[1:])
    speed = np.abs(bending.samples.wheel_rad_s).max()
    assert np.abs(at - before).max() <= 4 * SAME_TIME_S * speed
    assert not bending.wheel_travel_rad(0.0).any()


def test_between_samples_the_metal_follows_its_model(any_plan: Plan) -> None:
    given = any_plan.trajectory
    t = between(given)
    found = given.at(t)
    for j, heating in enumerate(transition_model(any_plan.problem).heating(any_plan.transitions)):
        temperature, fraction = heating.temperature_and_melt_fraction(t)
        np.testing.assert_allclose(found.temperature_C[:, j], temperature, atol=EXACT)
        np.testing.assert_allclose(found.melt_fraction[:, j], fraction, atol=EXACT)


def test_just_before_a_sample_counts_as_the_sample(bending: Trajectory) -> None:
    samples = bending.samples
    found = bending.at(samples.t_s[1:] - 0.5 * SAME_TIME_S)
    for name in ("q", "v", "a", "mode", "heater_setpoint_C", "heater_current_A"):
        np.testing.assert_array_equal(getattr(found, name), getattr(samples, name)[1:])


def test_times_outside_of_the_plan_are_its_ends(bending: Trajectory) -> None:
    found = bending.at([-5.0, bending.duration_s + 5.0])
    np.testing.assert_array_equal(found.q, bending.samples.q[[0, -1]])
    assert found.t_s.tolist() == [0.0, bending.duration_s]


def test_samples_of_another_number_of_segments_are_refused(bending: Trajectory) -> None:
    samples = bending.samples
    wider = {
        item.name: np.column_stack([getattr(samples, item.name), np.zeros(len(samples))])
        for item in fields(Samples)
        if item.name not in ("t_s", "v", "a", "wheel_rad_s")
    }
    with pytest.raises(InputError, match="a column for each of 2 segments"):
        replace(bending, samples=replace(samples, **wider))


# --- set-points that hold ------------------------------------------------------------------------


def following(trajectory: Trajectory, held: Samples) -> np.ndarray:
    """Where a robot comes to that drives every row's input until the next row, (rows, 3 + n)."""
    robot, q = trajectory.problem.robot, [held.q[0]]
    for i, dt in enumerate(np.diff(held.t_s)):
        rests = not held.v[i].any()
        here, s, mode = q[-1][None], held.v[i : i + 1] * dt, held.mode[i : i + 1]
        q.append(q[-1] if rests else flown(robot, here, s, None, mode)[0])
    return np.array(q)


@pytest.mark.parametrize(
    ("scenario", "rate"),
    [
        ("paper-1", None),  # the plan's own grid
        *itertools.product(("paper-1", "move-and-shape", "three-segments"), (15.0, 7.3)),
    ],
)
def test_set_points_that_hold_from_row_to_row_lose_nothing(
    scenario: str, rate: float | None
) -> None:
    given = planned(scenario).trajectory
    held = given.held(rate)
    assert not held.a.any()
    q = following(given, held)
    np.testing.assert_allclose(q, held.q, rtol=0, atol=EXACT)
    assert np.abs(given.problem.goal.error(q[-1])).max() <= EXACT
    dt = np.diff(held.t_s)
    turned = np.cumsum(held.wheel_rad_s[:-1] * dt[:, None], axis=0)
    np.testing.assert_allclose(turned, given.wheel_travel_rad(held.t_s[1:]), rtol=0, atol=EXACT)
    assert held.t_s[-1] == given.duration_s
    assert not held.v[-1].any()
    assert not held.wheel_rad_s[-1].any()


@pytest.mark.parametrize(
    ("robot", "low", "high"), [("2sra-v1", 0.99, 1.01), ("2sra-v1-paper", 0.19, 0.73)]
)
@pytest.mark.parametrize("number", range(1, 6))
def test_wheel_speeds_of_plans_bend_arcs_that_do_not_slip(
    number: int, robot: str, low: float, high: float
) -> None:
    """All that was planned, or as little as a refusal of the paper's wheel map says."""
    path = planned(f"paper-{number}", robot=robot).trajectory
    arcs = with_path_model(path.problem.robot, "arc")
    for phase in path.phases:
        times, soft = np.linspace(phase.start_s, phase.end_s, 201), np.flatnonzero(phase.mode)
        first, last = path.configuration(times[[0, -1]])
        q = first
        for turned in np.diff(path.wheel_travel_rad(times), axis=0):
            q = rolling(arcs, phase.mode)(q, turned, NO_DRIFT).full().ravel()
        if len(soft):
            share = (q - first)[3:][soft].sum() / (last - first)[3:][soft].sum()
            assert low <= share <= high
