"""A closed-loop run, live: the controller's step on a simulated robot, a record for each step."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from typing import Any

import numpy as np

from twosra_mpc import Plan, Problem, plan, robot_shape
from twosra_mpc.execution.executor import plan_controller
from twosra_mpc.execution.robot_interface import still
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.execution.simulation.simulate import settings_for
from twosra_mpc.lab.report import player
from twosra_mpc.lab.studio.answers import way_of
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import sequence_name
from twosra_mpc.validation import Count, Metres, Positive, Radians, Several, Value


class Run(Value):
    """A run that a page asks for: a problem as scenario document, and the robot that runs it.

    ``speed`` is how many times as fast as the robot it is shown.
    """

    problem: dict[str, Any]
    plant: str = "arc"
    disturbance: str = "moderate"
    seed: Count = 0
    broken_heaters: Several[Count] = ()
    speed: Positive = 20.0


class Push(Value):
    """A push by hand: the robot is shifted and turned about b0, whatever its wheels do."""

    x_m: Metres = 0.0
    y_m: Metres = 0.0
    phi_rad: Radians = 0.0


class LiveRun:
    """A run on its way; pushes are taken before the next reading.

    Attributes:
        asked: What was asked for.
        pushes: Those to come.
    """

    def __init__(self, asked: Run) -> None:
        """Not begun yet."""
        self.asked, self.pushes = asked, deque[Push]()

    def frames(self) -> Generator[dict[str, Any], None, None]:
        """Plan and run; a record for each step. However it ends, wheels stand and heaters are off.

        Raises:
            InputError: If the problem or the robot is none.
            NoPlanError: If there is no plan.
        """
        asked = self.asked
        problem, level = Problem(**asked.problem), disturbance_level(asked.disturbance)
        broken = asked.broken_heaters
        robot = SimulatedRobot(problem, asked.plant, level, asked.seed, broken_heaters=broken)
        made = plan(problem.with_values(planner="optimal")).require()
        controller = plan_controller(made, robot.camera, settings_for(level), robot.think)
        off_C = np.full(len(robot.segments), problem.robot.heater.rigid_setpoint_C)
        frame, seen, shown = robot.q.copy(), 0, None
        try:
            while controller.verdict is None:
                while self.pushes:
                    push = self.pushes.popleft()
                    robot.push(np.array([push.x_m, push.y_m, push.phi_rad]))
                reading = robot.read()
                if len(reading.frames):
                    frame = reading.frames[-1]
                command = controller.step(reading)
                robot.send(command.wheel_rad_s, command.heater_setpoint_C)
                belief, policy = controller.belief, controller.policy
                new, seen = belief.events[seen:], len(belief.events)
                in_force = policy.course.plan  # type: ignore[attr-defined]  # it follows one
                yield {
                    "kind": "frame",
                    "time_s": robot.time_s,
                    "true": _pose(problem, robot.q),
                    "seen": _pose(problem, frame),
                    "temperature_C": [segment.temperature_C for segment in robot.segments],
                    "measured_C": [segment.measured_C for segment in robot.segments],
                    "melt_fraction": [segment.melt_fraction for segment in robot.segments],
                    "doing": policy.during,
                    "events": [[event.time_s, event.kind, event.text] for event in new],
                    "ended": controller.verdict and str(controller.verdict.ending),
                    "plan": None if in_force is shown else _told(in_force),
                }
                shown = in_force
                robot.wait(command.at_most_s)
        finally:
            robot.send(still(), off_C)


def _pose(problem: Problem, q: Array) -> dict[str, Any]:
    return player.pose(robot_shape(problem.robot.geometry, q, player.ARC_POINTS))


def _told(made: Plan) -> dict[str, Any]:
    """A plan: its sequence and the way of b0."""
    return {"sequence": sequence_name(made.sequence), "path": way_of(made)}
