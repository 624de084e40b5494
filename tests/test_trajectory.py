"""A trajectory is exact between its samples, not interpolated, and repeats them at them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from conftest import Planned
from scipy.integrate import solve_ivp

from twosra_mpc import InputError, Plan
from twosra_mpc.identification.path_choice import with_path_model
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.plans.trajectory import SAME_TIME_S, Samples, Trajectory
from twosra_mpc.timing import transition_model

EXACT = 1e-9  # m, rad, 1/m


@pytest.fixture(scope="module")
def bending(planned: Planned) -> Trajectory:
    """A plan that bends both segments, by a path model whose wheels turn at a changing rate."""
    given = planned("shape-change")
    robot = with_path_model(given.robot, "arc")
    return planned("shape-change", robot=robot).trajectory


def between(trajectory: Trajectory) -> np.ndarray:
    """Times inside every interval of the grid."""
    t = trajectory.samples.t_s
    return np.concatenate([t[:-1] + share * np.diff(t) for share in (0.1, 0.5, 0.77)])


def test_at_its_samples_a_trajectory_is_its_samples(any_plan: Plan) -> None:
    given = any_plan.trajectory
    found = given.at(given.samples.t_s)
    for item in fields(Samples):
        expected = getattr(given.samples, item.name)
        atol = 1e-9 if item.name in ("temperature_C", "melt_fraction") else 0.0
        np.testing.assert_allclose(getattr(found, item.name), expected, rtol=0, atol=atol)


def test_between_samples_the_configuration_solves_the_kinematics(bending: Trajectory) -> None:
    samples, jacobian = bending.samples, kinematics(bending.problem.robot).jacobian
    moving = np.flatnonzero(samples.v.any(axis=1))
    for i in moving[:: len(moving) // 12]:
        v, mode = samples.v[i], samples.mode[i]
        span = 0.6 * (samples.t_s[i + 1] - samples.t_s[i])
        exact = solve_ivp(
            lambda _, q, v=v, mode=mode: (jacobian(q, mode) @ v).full().ravel(),
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
    for name in ("q", "v", "mode", "heater_setpoint_C", "heater_current_A"):
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
        if item.name not in ("t_s", "v", "wheel_rad_s")
    }
    with pytest.raises(InputError, match="a column for each of 2 segments"):
        replace(bending, samples=replace(samples, **wider))
