"""Motion of a simulated robot: by a path model and its disturbances, or in a rigid-body engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from twosra_mpc.control.heated_segment import HeatedSegment
from twosra_mpc.execution.guard import bends_into_itself
from twosra_mpc.execution.robot_interface import RobotError
from twosra_mpc.execution.simulation.disturbance import Disturbance
from twosra_mpc.model.rolling import Drift, rolling
from twosra_mpc.physics.engine import DivergedError, Engine
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import WHEELS, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import all_modes
from twosra_mpc.robot.physics import Physics

if TYPE_CHECKING:  # loaded where there are objects
    from twosra_mpc.execution.simulation.object_plant import ObjectPlant


Segments = Sequence[HeatedSegment]


class Motion(Protocol):
    """Motion of a simulated robot, and the objects around it."""

    @property
    def touched(self) -> str | None:
        """Obstacle that the robot has touched, empty if none; None if nothing keeps them apart."""

    @property
    def objects(self) -> ObjectPlant | Engine | None:
        """Objects with their ``poses``; None without any."""

    def at_rest(self, segments: Segments) -> bool:
        """True if nothing moves while the wheels stand and metal is as it is."""

    def roll(self, q: Array, turned: Array, segments: Segments, duration_s: float) -> Array:
        """Return where the robot is after its wheels have turned by ``turned`` (4,) [rad]."""


class PathMotion:
    """Motion by a path model, with slipping wheels and units that do not hold."""

    touched = None  # it goes through obstacles, and is judged by where it was

    def __init__(
        self,
        problem: Problem,
        robot: Robot,
        what: Disturbance,
        drawn: np.random.Generator,
        noise: np.random.Generator,
    ) -> None:
        """Draw how this robot differs from its model.

        Args:
            problem: The objects.
            robot: With the path model and the lengths that are true.
            what: How much it differs.
            drawn: For what differs from robot to robot.
            noise: For what differs from frame to frame.
        """
        self._robot, self._what, self._noise = robot, what, noise
        self._grip = 1 - np.clip(drawn.normal(what.slip, what.slip_spread, WHEELS), 0.0, 0.9)
        modes = all_modes(robot.coordinates.segments)[1:]
        by_number = sorted(modes, key=lambda mode: (sum(mode), mode[::-1]))  # [1,0] first
        self._drift = {mode: _drift(what, drawn) for mode in by_number}
        self._bends = {mode: drawn.uniform(*what.bend_share) for mode in by_number}
        self.objects: ObjectPlant | Engine | None = None
        if problem.objects:
            from twosra_mpc.execution.simulation.object_plant import ObjectPlant

            self.objects = self._pushed = ObjectPlant(problem, robot.geometry)

    def at_rest(self, segments: Segments) -> bool:
        """Always: nothing but wheels moves it."""
        del segments
        return True

    def roll(self, q: Array, turned: Array, segments: Segments, duration_s: float) -> Array:
        """Roll for a period; metal that is changing does not bend yet."""
        del duration_s
        mode = tuple(int(segment.soft) for segment in segments)
        grip = self._grip * (1 + self._what.slip_noise * self._noise.standard_normal(WHEELS))
        drift, share = self._drift.get(mode, Drift()), self._bends.get(mode, 1.0)
        after: Array = rolling(self._robot, mode)(q, turned * grip * share, drift).full().ravel()
        if bends_into_itself(self._robot, q, after[None]):  # the wheels slip
            after = q
        if self.objects is not None:
            self._pushed.follow(q, after)
        return after


class PhysicsMotion:
    """Motion in a rigid-body engine."""

    def __init__(
        self,
        problem: Problem,
        robot: Robot,
        physics: Physics,
        segments: Segments,
        *,
        viewer: bool = False,
    ) -> None:
        """Put a robot with these lengths and physics where the problem starts.

        Raises:
            InputError: If the engine is not installed, its viewer has no display, or the wheels
                cannot carry the robot.
            RobotError: If its start cannot be simulated.
        """
        try:
            self._engine = Engine(problem, robot, physics, _melted(segments))
        except DivergedError as error:
            raise RobotError(str(error)) from error
        self.objects = self._engine if problem.objects else None
        if viewer:
            self._engine.view()

    @property
    def touched(self) -> str:
        """Obstacle that the robot touched first, by the engine's contacts."""
        return self._engine.touched

    def at_rest(self, segments: Segments) -> bool:
        """True if the engine's state rests, and metal has not changed since."""
        return self._engine.at_rest(_melted(segments))

    def roll(self, q: Array, turned: Array, segments: Segments, duration_s: float) -> Array:
        """Let the engine run.

        Raises:
            RobotError: If its state diverges.
        """
        del q
        try:
            return self._engine.roll(turned, _melted(segments), duration_s)
        except DivergedError as error:
            raise RobotError(str(error)) from error


def _melted(segments: Segments) -> list[float]:
    return [segment.melt_fraction for segment in segments]


def _drift(what: Disturbance, drawn: np.random.Generator) -> Drift:
    turn, shift = (what.pivot_rad_per_rad, what.slide_m_per_rad) * drawn.standard_normal(2)
    return Drift(turn, shift, drawn.uniform(-what.split, what.split))
