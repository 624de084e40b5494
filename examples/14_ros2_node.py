"""A ROS 2 node around the controller's step: jobs as an action, poses of markers in.

`Job` knows no ROS, and drives a simulated robot where there is none. `node()` serves the action
`twosra_msgs/action/Drive` (`string scenario --- string ending, string reason --- float64 time_s`),
after `colcon build` of a package of that one file. Topics: `markers` (PoseArray) and
`segment1/temperature` ... in, `wheel_commands` (JointState) and `segment1/setpoint` ... out.
"""

import importlib.util
import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import Problem, plan
from twosra_mpc.execution import (
    Camera,
    Command,
    KnownStiffness,
    Reading,
    SimulatedRobot,
    plan_controller,
)
from twosra_mpc.lab.serial import Marker, Markers, configuration_by_markers, marker_poses

Array = NDArray[np.float64]
MARKERS = Markers(marker=(Marker(link="unit 1"), Marker(link="unit 2")))  # where yours sit
CAMERA = Camera(rate_Hz=15.0, noise=(1e-3, 0.02, 1.0))
JOB = {
    "robot": "2sra-v1",
    "start": {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]},
    "goal": {"x_m": 0.1, "y_m": 0.05, "phi_rad": 0.5},
}


class Job:
    """A job: what is told goes in, what to publish comes out of `step`, at the camera's rate."""

    def __init__(self, scenario: str) -> None:
        self.made = plan(Problem(**json.loads(scenario))).require()
        self.controller = plan_controller(self.made, CAMERA)
        self.q, self.seen = self.made.samples.q[0], list[tuple[float, Array]]()
        self.warm_C = [math.nan] * (len(self.q) - 3)

    def markers(self, time_s: float, poses: Array) -> None:
        self.q = configuration_by_markers(self.made.robot, MARKERS, poses, near=self.q).q
        self.seen.append((time_s, self.q))

    def step(self, now_s: float) -> Command:
        taken_s = np.array([time_s for time_s, _ in self.seen])
        frames = np.array([q for _, q in self.seen]).reshape(-1, len(self.q))
        told, self.seen = tuple(map(self.stiffness, self.warm_C)), []
        well = (False,) * len(told)
        reading = Reading(now_s, taken_s, frames, tuple(self.warm_C), told, well)
        return self.controller.step(reading)

    def stiffness(self, warm_C: float) -> KnownStiffness:
        above_K = warm_C - self.made.robot.heater.melting_point_C
        return "soft" if above_K > 2.2 else "rigid" if above_K < -2.5 else "changing"


def node() -> Any:
    """Node that serves the action; spin it by a MultiThreadedExecutor, for a job takes minutes."""
    import rclpy
    from geometry_msgs.msg import PoseArray
    from rclpy.action import ActionServer
    from sensor_msgs.msg import JointState, Temperature
    from twosra_msgs.action import Drive

    ros, jobs = rclpy.create_node("twosra"), list[Job]()
    began = ros.get_clock().now().nanoseconds
    wheels = ros.create_publisher(JointState, "wheel_commands", 1)
    heaters = [ros.create_publisher(Temperature, f"segment{j}/setpoint", 1) for j in (1, 2)]

    def tell(wheel_rad_s: Array, setpoint_C: Array) -> None:
        names = [f"wheel{number}_axle" for number in (1, 2, 3, 4)]
        wheels.publish(JointState(name=names, velocity=wheel_rad_s.tolist()))
        for heater, value in zip(heaters, setpoint_C.tolist(), strict=True):
            heater.publish(Temperature(temperature=value))

    def seen(message: PoseArray) -> None:
        stamp, turns = message.header.stamp, [p.orientation for p in message.poses]
        headings = [2 * math.atan2(turn.z, turn.w) for turn in turns]
        places = [(p.position.x, p.position.y) for p in message.poses]
        time_s = (stamp.sec * 10**9 + stamp.nanosec - began) * 1e-9
        for job in jobs:
            job.markers(time_s, np.column_stack([places, headings]))

    def warm(segment: int, message: Temperature) -> None:
        for job in jobs:
            job.warm_C[segment] = message.temperature

    def drive(goal: Any) -> Any:
        job, rate = Job(goal.request.scenario), ros.create_rate(CAMERA.rate_Hz)
        jobs.append(job)
        try:
            while job.controller.verdict is None and not goal.is_cancel_requested:
                command = job.step((ros.get_clock().now().nanoseconds - began) * 1e-9)
                tell(command.wheel_rad_s, command.heater_setpoint_C)
                goal.publish_feedback(Drive.Feedback(time_s=job.controller.belief.now_s))
                rate.sleep()
        finally:  # whatever happens
            tell(np.zeros(4), np.full(2, job.made.robot.heater.rigid_setpoint_C))
            jobs.remove(job)
        if (verdict := job.controller.verdict) is None:
            goal.canceled()
            return Drive.Result(ending="cancelled")
        (goal.succeed if verdict.ending == "reached" else goal.abort)()
        return Drive.Result(ending=str(verdict.ending), reason=verdict.reason)

    ros.create_subscription(PoseArray, "markers", seen, 10)
    for j in (0, 1):
        topic = f"segment{j + 1}/temperature"
        ros.create_subscription(Temperature, topic, lambda told, j=j: warm(j, told), 10)
    ActionServer(ros, Drive, "drive", drive)
    return ros


def simulated() -> None:
    """Let a job drive a simulated robot."""
    job = Job(json.dumps(JOB))
    robot = SimulatedRobot(job.made.problem, seed=1)
    while job.controller.verdict is None:
        reading = robot.read()
        for taken_s, q in zip(reading.taken_s, reading.frames, strict=True):
            job.markers(taken_s, marker_poses(job.made.robot, MARKERS, q))
        job.warm_C = list(reading.temperature_C)
        command = job.step(reading.time_s)
        robot.send(command.wheel_rad_s, command.heater_setpoint_C)
        robot.wait(command.at_most_s)
    print(job.controller.verdict.reason)


if __name__ == "__main__":
    if importlib.util.find_spec("rclpy") is None:
        simulated()
    else:
        import rclpy
        from rclpy.executors import MultiThreadedExecutor

        rclpy.init()
        rclpy.spin(node(), MultiThreadedExecutor())
