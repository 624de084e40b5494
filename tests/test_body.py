"""The robot does not pass through itself: in plans, bounds, verification, in simulation.

The oracle shares nothing with the package: outlines of many points, laid out by complex numbers, as
polygons of GEOS.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from problems import bold, overlapping_on_the_way_to

from benchmarks.attack.body import overlap_m2
from twosra_mpc import (
    Goal,
    InputError,
    Problem,
    Robot,
    Start,
    load_problem,
    load_robot,
    plan,
    robot_names,
)
from twosra_mpc.checking.reintegration import between, reintegrate
from twosra_mpc.execution.belief import Metal
from twosra_mpc.execution.guard import bends_into_itself
from twosra_mpc.execution.replanning import remaining_problem
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.problem.ends import check_shapes
from twosra_mpc.problem.limits import body_gaps_m, broken_by_shapes, shape_margins
from twosra_mpc.robot.geometry import Geometry, Wheel

ROBOT = load_robot("2sra-v1")
_CHORDS_M = 6e-4  # by which a tube may be wider than its arc, both of a pair together


def robots() -> list[Robot]:
    """The built-in ones, and some of other lengths, offsets, numbers of segments."""
    built_in, rng = [load_robot(name) for name in robot_names()], np.random.default_rng(5)
    arc = load_robot("3sra")
    for segments in (1, 2, 3, 4):
        lengths = rng.uniform(0.02, 0.06, segments)
        geometry = arc.geometry.with_values(
            segments=segments,
            segment_length_m=tuple(lengths.tolist()),
            middle_link_m=float(rng.choice([0.0, 0.02])),
            end_link_m=float(rng.uniform(0.01, 0.04)),
            unit_offset_m=float(rng.uniform(-0.02, 0.02)),
        )
        limits = arc.limits.with_values(curvature_per_m=float(3.1 / lengths.max()))
        built_in.append(arc.with_values(geometry=geometry, limits=limits, name=f"of {segments}"))
    return built_in


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
def test_shapes_are_allowed_exactly_where_outlines_do_not_overlap(robot: Robot) -> None:
    most, n = robot.limits.curvature_per_m, robot.geometry.segments
    shapes = np.random.default_rng(0).uniform(-most, most, (150, n))
    margins = shape_margins(robot, shapes)
    left = np.minimum(margins["unit_gap_m"] + robot.limits.unit_gap_m, margins["body_gap_m"])
    shared = np.array([overlap_m2(robot.geometry, kappa) for kappa in shapes])
    assert (shared[left >= 0] < 1e-9).all()
    assert (shared[left < -_CHORDS_M] > 0).all()


def test_none_of_a_grid_of_allowed_shapes_overlaps() -> None:
    """At 4 1/m, 1,416 shapes kept the units apart; 122 of these overlapped by over 4 mm2."""
    grid = np.array([*itertools.product(np.arange(-76.0, 77.0, 4.0), repeat=2)])
    allowed = np.array([broken_by_shapes(ROBOT, kappa) is None for kappa in grid])
    shared = np.array([overlap_m2(ROBOT.geometry, kappa) for kappa in grid])
    assert (shared[allowed] < 1e-9).all()
    assert allowed.sum() >= 0.97 * (shared == 0).sum()


def test_a_simulated_robot_cannot_bend_through_itself() -> None:
    """Both segments molten, its units are driven towards each other for 20 s, then apart."""
    start = Start(
        x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(30.0, 25.0), temperature_C=(66.0, 66.0)
    )
    simulated = SimulatedRobot(Problem(robot=ROBOT, start=start, goal=Goal(x_m=0.0)), "as-planned")
    hot, seen = np.full(2, ROBOT.heater.soft_setpoint_C), []
    assert simulated.mode == (1, 1)
    closing = kinematics(ROBOT).wheel_matrix(simulated.q, (1, 1)).full() @ [0.02, 0.02, 0, 0, 0]
    for sense in (1.0, -1.0):
        for _ in range(300):
            simulated.send(sense * closing, hot)
            simulated.wait(simulated.camera.period_s)
            seen.append(simulated.q[3:].copy())
    least_m = body_gaps_m(ROBOT, np.array(seen))
    assert least_m.min() >= 0
    assert least_m.min() < 2e-3  # it came there
    assert np.abs(simulated.q[3:]).sum() < np.abs(seen[299]).sum()  # and back


def test_a_robot_believed_to_overlap_starts_bent_back() -> None:
    """As it was seen in a run whose bends split unevenly: the rest was refused for its start."""
    seen = np.array([0.2, 0.2, 0.1, 59.5, 33.0])
    asked = load_problem("paper-3")
    rest = remaining_problem(asked, seen, [Metal(70.0, 1.0)] * 2)
    check_shapes(rest)
    kappa = np.array(rest.start.kappa_per_m)
    assert kappa[0] * 33.0 == pytest.approx(kappa[1] * 59.5)
    assert 50 < kappa[0] < 59.5
    assert bends_into_itself(ROBOT, kappa_at(50.0, 30.0), kappa_at(59.5, 33.0)[None])
    assert not bends_into_itself(ROBOT, kappa_at(60.0, 34.0), kappa_at(59.5, 33.0)[None])


def kappa_at(*kappa: float) -> np.ndarray:
    """Configuration of a shape."""
    return np.array([0.0, 0.0, 0.0, *kappa])


def test_a_goal_that_overlaps_itself_is_refused_by_name() -> None:
    """Unit 2 would lie on the fibre."""
    goal = Goal(kappa_per_m=(78.0, 78.0))
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    overlap_mm = -1e3 * float(body_gaps_m(ROBOT, [goal.kappa_per_m])[0])
    words = f"unit 1 overlaps the fibre of segment 2 by {overlap_mm:.1f} mm"
    with pytest.raises(InputError, match=f"goal.kappa_per_m.*{words}"):
        check_shapes(Problem(robot=ROBOT, start=start, goal=goal))


@pytest.mark.parametrize("seed", range(5))
def test_plans_that_bend_a_lot_do_not_pass_through_the_robot(seed: int) -> None:
    """What is verified overlaps by no more than half a millimetre between its samples either."""
    rng = np.random.default_rng(seed)
    while True:
        kappa = rng.uniform(-78, 78, (2, 2))
        if np.abs(kappa).max(axis=1).min() > 50 and broken_by_shapes(ROBOT, kappa) is None:
            break
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=tuple(kappa[0]))
    found = plan(Problem(robot=ROBOT, start=start, goal=Goal(kappa_per_m=tuple(kappa[1]))))
    if found.plan is None:
        return
    fine, _ = between(found.plan.samples, np.full(len(found.plan.samples.t_s) - 1, 5e-4), least=1)
    shapes = np.unique(reintegrate(found.plan.problem, fine)[:, 3:].round(2), axis=0)
    slimmer = ROBOT.geometry.with_values(fibre_radius_m=ROBOT.geometry.fibre_radius_m - 5e-4)
    for kappa in shapes:
        assert overlap_m2(slimmer, kappa) < 1e-6, kappa


@pytest.mark.parametrize("overlap_m", [1e-4, 3e-4])
def test_bounds_forgive_the_overlap_that_verification_forgives(overlap_m: float) -> None:
    """On its way segment 1 bends where parts overlap by 0.1 or 0.3 mm: proofs forbade that too."""
    kappa2 = overlapping_on_the_way_to(ROBOT, 57.3, overlap_m)
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(-30.0, kappa2))
    goal = Goal(kappa_per_m=(57.3, kappa2), tolerance="exact")
    modes = ((0, 0), (1, 0))
    given = ROBOT.geometry
    slim = {key: getattr(given, key) - 1e-3 for key in ("wheel_thickness_m", "unit_frame_m")}
    robot = bold(ROBOT)
    slimmer = robot.with_values(geometry=given.with_values(**slim, wheels=placed_as(given)))
    asked = Problem(robot=robot, start=start, goal=goal, modes=modes)
    passes = plan(asked.with_values(robot=slimmer))
    assert passes.plan is not None
    found = plan(asked)
    assert found.lower_bound is not None
    assert found.lower_bound <= passes.plan.cost.total


def placed_as(geometry: Geometry) -> tuple[Wheel, ...]:
    """The wheels where they are, whatever the lengths."""
    return tuple(Wheel(x_m=x, y_m=y, angle_rad=a) for x, y, a in geometry.wheel_placement)
