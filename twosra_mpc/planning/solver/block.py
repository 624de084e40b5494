"""Blocks: soft phases without driving in between, wherever in the plane they are carried out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.solver.fixed_sequence import INTERVALS
from twosra_mpc.planning.solver.guess import bent
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import Mode
from twosra_mpc.space.footprint import SAGITTA_M, footprints, kept_m, reach_per_curvature_m2
from twosra_mpc.space.separation import Surroundings, placed

Shares = tuple[float, float]

_NODES = 6  # in an interval
_CURVED = 1.02  # times as long as their chords are paths between nodes
_COARSE = 8  # nodes looked at before all are


@dataclass(frozen=True, eq=False)
class Block:
    """Soft phases from one shape to another, as seen from where b0 is as they begin.

    Attributes:
        inputs: Input displacements, (phases, intervals, 5) [m].
        nodes: Configurations on the way, (m, 3 + n), the first at the origin.
        ways: Shapes on the way of each phase, (m, n) each.
    """

    inputs: Array
    nodes: Array
    ways: tuple[Array, ...]

    @property
    def displacement(self) -> Array:
        """Pose of b0 at the end, as seen from its pose at the beginning, (3,)."""
        return self.nodes[-1, :POSE]

    @property
    def shape(self) -> Array:
        """Curvatures at the end, (n,)."""
        return self.nodes[-1, POSE:]


def block(
    robot: Robot,
    shape: Array,
    modes: Sequence[Mode],
    bends: Sequence[float],
    shares: Shares,
    fine: int = 1,
) -> Block:
    """A block that bends W by ``bends`` in its modes, the units travelling by ``shares``.

    Args:
        robot: The robot.
        shape: Curvatures at the beginning, (n,) [1/m].
        modes: Mode of each phase.
        bends: Change of W in each.
        shares: Of the travel of the two locomotion units; see ``model.flow.bending_step``.
        fine: Times as many nodes as usual.
    """
    nodes, ways = [np.append(np.zeros(POSE), shape)[None]], list[Array]()
    inputs = np.zeros((len(modes), INTERVALS, 5))
    for i, (mode, bend) in enumerate(zip(modes, bends, strict=True)):
        ways.append(nodes[-1][-1:, POSE:])  # where it rests
        if bend != 0.0:
            count = fine * _NODES
            states, travel = bent(robot, nodes[-1][-1], mode, bend, INTERVALS * count, shares)
            inputs[i, :, :2] = travel.reshape(INTERVALS, count, 2).sum(axis=1)
            nodes.append(states[1:])
            ways[-1] = states[:, POSE:]
    return Block(inputs, np.concatenate(nodes), tuple(ways))


class Sweep:
    """Sweep of a block, and whether it is clear of what is around the robot."""

    def __init__(
        self, block: Block, robot: Robot, world: World, sagitta_m: float = SAGITTA_M
    ) -> None:
        geometry = robot.geometry
        pieces, _ = footprints(geometry, block.nodes[:, POSE:], sagitta_m)
        self._pieces = placed(pieces, block.nodes[:, :POSE])
        self._around = Surroundings(world, kept_m(world, geometry))
        radius = float(np.linalg.norm(pieces, axis=-1).max())
        travel = _travel_m(block.nodes, geometry, radius)
        half = np.maximum(np.append(travel, 0.0), np.append(0.0, travel)) / 2
        self._needed = self._around.kept_m + half

    def may_be_clear(self, poses: Array) -> NDArray[np.bool_]:
        """True if some shapes on the way are clear where the block begins at poses (m, 3), (m,)."""
        last = len(self._pieces) - 1
        left = np.arange(len(poses))
        for k in dict.fromkeys([last, 0, *range(0, last, max(1, last // _COARSE))]):
            corners = placed(self._pieces[k], poses[left])
            left = left[self._around.distances(corners) >= self._around.kept_m]
        clear = np.zeros(len(poses), dtype=bool)
        clear[left] = True
        return clear

    def clear(self, pose: Array) -> bool:
        """True if the whole sweep is clear where the block begins at a pose (3,)."""
        corners = placed(self._pieces, np.tile(pose, (len(self._pieces), 1)))
        return bool((self._around.distances(corners) >= self._needed).all())


def _travel_m(nodes: Array, geometry: Geometry, radius: float) -> Array:
    """Largest travel of any point of the robot from node to node, at most, (m - 1,) [m]."""
    moved, left = np.abs(np.diff(nodes, axis=0)), geometry.inner_link_of_b0
    by_bending = moved[:, POSE:] * reach_per_curvature_m2(geometry)
    bent = np.maximum(by_bending[:, :left].sum(axis=1), by_bending[:, left:].sum(axis=1))
    return _CURVED * (np.hypot(moved[:, 0], moved[:, 1]) + radius * moved[:, 2] + bent)
