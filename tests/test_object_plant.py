"""Objects move only where something pushes them, and nothing is left overlapping."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from grasps import disc
from numpy.typing import NDArray

from twosra_mpc import Problem, load_problem, load_robot
from twosra_mpc.contact.touch import grasp_touches
from twosra_mpc.execution.simulation.object_plant import SQUEEZED_M, ObjectPlant
from twosra_mpc.robot.coordinates import POSE, composed, inverse
from twosra_mpc.space.contour import Pieces, Thing
from twosra_mpc.space.footprint import footprints
from twosra_mpc.space.separation import placed

Array = NDArray[np.float64]

ROBOT = load_robot("2sra-v1")
IN_CAGE = np.array([0.0, 0.0342, 0.0])
DISC = {"disc": {"radius_m": 0.03}}
CAGE = tuple(0.975 * grasp_touches(load_robot("2sra-v1"), disc(0.03)).touches[0].kappa)  # looser
BOX = {"box": {"x_m": [-0.02, 0.02], "y_m": [-0.02, 0.02]}}


def among(*objects: dict[str, Any], obstacles: Any = (), kappa: Any = (0.0, 0.0)) -> Problem:
    """A robot at the origin with things around it."""
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": kappa}
    goal = {"x_m": 0.3, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": kappa}
    return load_problem("rigid-move", start=start, goal=goal).with_values(
        objects=list(objects), obstacles=obstacles
    )


def thing(shape: dict[str, Any], x: float, y: float, **more: Any) -> dict[str, Any]:
    return {"name": "cup", "pose": {"x_m": x, "y_m": y}, **shape, **more}


def plant_of(problem: Problem) -> ObjectPlant:
    return ObjectPlant(problem, ROBOT.geometry)


def driven(plant: ObjectPlant, kappa: Any, *poses: Any) -> Array:
    """Drive through poses in steps of a period, and return the first object's pose after each."""
    found = []
    for a, b in itertools.pairwise(poses):
        ends = np.linspace(a, b, 1 + max(1, math.ceil(np.abs(np.subtract(b, a)).max() / 0.003)))
        for before, after in itertools.pairwise(ends):
            plant.follow(np.append(before, kappa), np.append(after, kappa))
            found.append(plant.poses[0].copy())
    return np.array(found)


def depth_m(problem: Problem, pose: Array, q: Array) -> float:
    """How deep a disc lies in the robot."""
    pieces = placed(footprints(ROBOT.geometry, q[None, POSE:], 5e-5)[0][0], q[None, :POSE])[0]
    found = ObjectPlant(problem, ROBOT.geometry)._things[0].deepest(pose, Pieces(pieces))
    return 0.0 if found is None else found.depth_m


def test_how_deep_things_lie_is_told_by_the_sides_of_both() -> None:
    """A box of 40 mm beside the side of a square, and beside its corner."""
    problem = among(thing(BOX, 0.0, 0.0))
    (item,) = ObjectPlant(problem, ROBOT.geometry)._things
    square = np.array([[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]])
    found = item.deepest(np.array([0.028, 0.003, 0.0]), Pieces(square[None]))
    assert found is not None
    assert found.depth_m == pytest.approx(0.002)
    for k in range(200):  # touching, to rounding: no overlap, or next to none
        beside = composed(np.array([0.3, -0.2, k]), np.array([0.03 - k % 4 * 1e-17, 0.003, 0.0]))
        moved = Pieces(placed(square[None], np.array([[0.3, -0.2, k]]))[0])
        assert item.deepest(beside, moved) is None
    turn = math.sqrt(0.5) * np.array([[1.0, 1.0], [-1.0, 1.0]])
    standing = Pieces((square @ turn)[None])
    assert item.deepest(np.array([0.0274, 0.0274, 0.0]), standing) is None
    found = item.deepest(np.array([0.0265, 0.0265, 0.0]), standing)
    assert found is not None
    assert found.depth_m == pytest.approx(0.01 - math.sqrt(0.5) * 0.013, abs=1e-9)
    outline = {"polygon_m": [[-0.01, -0.01], [0.05, 0.0], [-0.01, 0.01]]}
    assert Thing(among(thing(outline, 0.0, 0.0)).objects[0]).radius_m == pytest.approx(0.05)


def test_a_caged_disc_follows_whatever_the_robot_does() -> None:
    problem = among(thing(DISC, *IN_CAGE[:2]), kappa=CAGE)
    plant = plant_of(problem)
    assert depth_m(problem, IN_CAGE, np.append(np.zeros(3), CAGE)) == 0
    ways = [(0, 0, 0), (0.1, 0, 0), (0.1, 0, 2.0), (0.1, -0.1, 2.0), (0, 0, 0)]
    poses = driven(plant, CAGE, *ways)
    seen = composed(inverse(np.array(ways[-1], dtype=float)), poses[-1])
    assert np.hypot(*(seen - IN_CAGE)[:2]) < 0.005
    assert np.ptp(poses[:, 0]) > 0.09
    assert not plant.squeezed


def test_a_robot_at_rest_moves_nothing_and_one_that_is_far_neither() -> None:
    plant = plant_of(among(thing(DISC, *IN_CAGE[:2]), kappa=CAGE))
    at_rest = np.append(np.zeros(3), CAGE)
    plant.follow(at_rest, at_rest)
    assert (plant.poses[0] == IN_CAGE).all()
    plant = plant_of(among(thing(DISC, 0.0, 0.3)))
    assert (driven(plant, (0, 0), (0, 0, 0), (0.2, 0, 0)) == [0.0, 0.3, 0.0]).all()


@pytest.mark.parametrize("shape", [DISC, BOX])
def test_a_straight_robot_pushes_ahead_and_leaves_behind(shape: dict[str, Any]) -> None:
    plant = plant_of(among(thing(shape, 0.0, 0.05)))
    ahead = driven(plant, (0, 0), (0, 0, 0), (0, 0.1, 0))[-1]
    reach = 0.004 + (0.03 if shape is DISC else 0.02)
    np.testing.assert_allclose(ahead, [0.0, 0.1 + reach, 0.0], atol=1e-3)
    behind = driven(plant, (0, 0), (0, 0.1, 0), (0, 0, 0))[-1]
    assert (behind == ahead).all()


def test_a_push_beside_the_centroid_turns_as_the_limit_surface_says() -> None:
    problem = among(thing(BOX, 0.0, 0.0))
    plant, c = plant_of(problem), 0.6 * math.sqrt(0.04**2 / math.pi)
    plant._push(0, np.array([0.0, 1.0]), 1e-3, np.array([0.01, -0.02]))
    x, y, phi = plant.poses[0]
    assert x == pytest.approx(0.0, abs=1e-12)
    assert phi / y == pytest.approx(0.01 / c**2)
    assert y + 0.01 * phi == pytest.approx(1e-3, rel=1e-9)


def test_nothing_is_left_overlapping_after_a_step() -> None:
    problem = among(thing(DISC, 0.09, 0.06))
    plant, rng = plant_of(problem), np.random.default_rng(3)
    q = np.zeros(5)
    for _ in range(60):
        after = q + rng.normal(0, [0.002, 0.002, 0.03, 0.4, 0.4])
        plant.follow(q, after)
        q = after
        assert depth_m(problem, plant.poses[0], q) < 2e-5
    assert not plant.squeezed


def test_what_is_pushed_against_a_wall_is_squeezed_and_says_so() -> None:
    wall = {"name": "wall", "box": {"x_m": [-0.3, 0.3], "y_m": [0.1, 0.12]}}
    plant = plant_of(among(thing(BOX, 0.0, 0.05), obstacles=[wall]))
    driven(plant, (0, 0), (0, 0, 0), (0, 0.056 - 2e-5, 0))
    assert not plant.squeezed
    driven(plant, (0, 0), (0, 0.056, 0), (0, 0.056 + 4 * SQUEEZED_M, 0))
    assert plant.squeezed.startswith("cup in ")


def test_an_object_pushes_the_one_behind_it() -> None:
    first, second = thing(BOX, 0.0, 0.05), thing(BOX, 0.0, 0.1, name="other")
    plant = plant_of(among(first, second))
    driven(plant, (0, 0), (0, 0, 0), (0, 0.1, 0))
    np.testing.assert_allclose(plant.poses[:, 1], [0.124, 0.164], atol=2e-4)


def test_friction_keeps_what_is_pushed_aslant() -> None:
    aslant = [(0, 0, 0), (0.02, 0.1, 0)]
    slid, kept = (
        driven(plant_of(among(thing(BOX, 0.0, 0.024, friction=mu))), (0, 0), *aslant)[-1]
        for mu in (0.0, 0.5)
    )
    assert slid[0] == pytest.approx(0.0, abs=1e-3)
    assert kept[0] == pytest.approx(0.02, abs=1e-3)
