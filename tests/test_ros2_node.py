"""The example of a ROS 2 node without ROS: a simulated robot plays topics and action."""

from __future__ import annotations

import json
import math
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from twosra_mpc import Problem
from twosra_mpc.execution import SimulatedRobot
from twosra_mpc.lab.serial import marker_poses

EXAMPLE = Path(__file__).parent.parent / "examples" / "14_ros2_node.py"


class Ros:
    """What the node asks of ROS: each sleep of the job lets a robot move, and be seen."""

    def __init__(self, example: dict[str, Any], cancelled_after_s: float = math.inf) -> None:
        self.markers, self.cancelled_after_s = example["MARKERS"], cancelled_after_s
        self.robot = SimulatedRobot(Problem(**example["JOB"]), seed=1)
        self.subscribed: dict[str, Callable[[Any], None]] = {}
        self.setpoint_C, self.wheel_rad_s = [0.0, 0.0], [1.0] * 4
        self.fed_back, self.ended = list[float](), ""
        self.serve: Callable[[Any], Any] = lambda goal: None
        self.succeed, self.abort, self.canceled = map(self.ending, ("succeed", "abort", "canceled"))

    # --- as rclpy and its node ---

    def create_node(self, name: str) -> Ros:
        return self

    def create_publisher(self, kind: Any, topic: str, depth: int) -> SimpleNamespace:
        def publish(message: Any) -> None:
            if topic == "wheel_commands":
                self.wheel_rad_s = message.velocity
            else:
                self.setpoint_C[int(topic[7]) - 1] = message.temperature

        return SimpleNamespace(publish=publish)

    def create_subscription(
        self, kind: Any, topic: str, take: Callable[[Any], None], depth: int
    ) -> None:
        self.subscribed[topic] = take

    def get_clock(self) -> SimpleNamespace:
        at = SimpleNamespace(nanoseconds=round(self.robot.time_s * 1e9))
        return SimpleNamespace(now=lambda: at)

    def create_rate(self, frequency_Hz: float) -> SimpleNamespace:
        return SimpleNamespace(sleep=self.sleep)

    def sleep(self) -> None:
        """Let the robot do as it is told until the next frame, and tell what is seen of it."""
        self.robot.send(np.array(self.wheel_rad_s), np.array(self.setpoint_C))
        self.robot.wait(0.0)
        reading = self.robot.read()
        for taken_s, q in zip(reading.taken_s.tolist(), reading.frames, strict=True):
            poses = [pose(*each) for each in marker_poses(self.robot.robot, self.markers, q)]
            stamp = SimpleNamespace(sec=int(taken_s), nanosec=round(taken_s % 1 * 1e9))
            header = SimpleNamespace(stamp=stamp)
            self.subscribed["markers"](SimpleNamespace(header=header, poses=poses))
        for j, warm_C in enumerate(reading.temperature_C, start=1):
            self.subscribed[f"segment{j}/temperature"](SimpleNamespace(temperature=warm_C))

    # --- as a goal of the action ---

    @property
    def is_cancel_requested(self) -> bool:
        return self.robot.time_s > self.cancelled_after_s

    def publish_feedback(self, message: Any) -> None:
        self.fed_back.append(message.time_s)

    def ending(self, name: str) -> Callable[[], None]:
        def end() -> None:
            self.ended = name

        return end

    def modules(self) -> dict[str, ModuleType]:
        """Modules of ROS as the node imports them."""
        drive = SimpleNamespace(Feedback=SimpleNamespace, Result=SimpleNamespace)
        serve = {"ActionServer": lambda node, kind, name, take: setattr(self, "serve", take)}
        names: dict[str, dict[str, Any]] = {
            "rclpy": {"create_node": self.create_node},
            "rclpy.action": serve,
            "geometry_msgs": {},
            "geometry_msgs.msg": {"PoseArray": SimpleNamespace},
            "sensor_msgs": {},
            "sensor_msgs.msg": {"JointState": SimpleNamespace, "Temperature": SimpleNamespace},
            "twosra_msgs": {},
            "twosra_msgs.action": {"Drive": drive},
        }
        made = {name: ModuleType(name) for name in names}
        for name, content in names.items():
            vars(made[name]).update(content)
        return made


def pose(x_m: float, y_m: float, phi_rad: float) -> SimpleNamespace:
    """A geometry_msgs/Pose."""
    turn = SimpleNamespace(z=math.sin(phi_rad / 2), w=math.cos(phi_rad / 2))
    return SimpleNamespace(position=SimpleNamespace(x=x_m, y=y_m), orientation=turn)


def served(monkeypatch: pytest.MonkeyPatch, **more: float) -> tuple[Ros, Any]:
    """A goal of the action, and its result."""
    example = runpy.run_path(str(EXAMPLE))
    ros = Ros(example, **more)
    for name, module in ros.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    example["node"]()
    ros.request = SimpleNamespace(scenario=json.dumps(example["JOB"]))  # type: ignore[attr-defined]
    return ros, ros.serve(ros)


def test_a_job_is_driven_to_its_goal_by_topics(monkeypatch: pytest.MonkeyPatch) -> None:
    ros, result = served(monkeypatch)
    assert (ros.ended, result.ending) == ("succeed", "reached"), result.reason
    off = ros.robot.q[:3] - [0.1, 0.05, 0.5]
    assert np.abs(off / [2e-3, 2e-3, 0.0175]).max() <= 1
    assert ros.wheel_rad_s == [0.0] * 4
    assert ros.fed_back == sorted(ros.fed_back)


def test_a_job_that_is_cancelled_leaves_the_robot_off(monkeypatch: pytest.MonkeyPatch) -> None:
    ros, result = served(monkeypatch, cancelled_after_s=1.5)
    assert (ros.ended, result.ending) == ("canceled", "cancelled")
    assert ros.wheel_rad_s == [0.0] * 4
    assert ros.setpoint_C == [ros.robot.robot.heater.rigid_setpoint_C] * 2
