"""A plan as a ROS 2 bag (MCAP) of standard messages, written without ROS.

``/robot_description`` is the robot as URDF (`robot_chain`), ``/joint_states`` its hinges and
wheels, ``/tf`` all its frames, ``/path`` the course of b0, ``/objectN/path`` that of each object
and ``/followN/path`` a path as it is asked for. ``/wheel_commands`` are joint states whose
velocities hold to the next message. ``/mode`` is the stiffness mode, 1 for each soft segment;
``/segmentN/temperature`` is what the metal is expected to be and ``/segmentN/setpoint`` what its
heater regulates to, in degrees Celsius. Times are the plan's, from zero; what does not change is
not written again, but for the plan's end, at which every topic has a last message. The description,
paths, mode and ``/surroundings`` are latched: who subscribes later gets them, too. Surroundings are
outlines: of obstacles in the world, of each object in a frame of its own that ``/tf`` moves.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import Object, Plan, Problem, refined
from twosra_mpc.arguments import public
from twosra_mpc.files import check_writable, data_file, write_bytes
from twosra_mpc.installation import require
from twosra_mpc.lab.export.robot_chain import BASE, Joint, angles, joints, urdf
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.robot.coordinates import POSE, Array

WORLD = "world"
TEMPERATURE_STEP_C = 0.1  # a temperature is written when it has moved so far
_RULE = f"{'=' * 80}\nMSG: "  # before each definition, as rosbag2 writes it
_TYPES = dict(  # interface -> its fields
    each.split("\n", 1) for each in data_file("lab/export/interfaces.msg").split(_RULE)[1:]
)

_LATCHED = ("/robot_description", "/path", "/mode", "/surroundings")  # what ends like this
_FOREVER = {"sec": 9223372036, "nsec": 854775807}
_QOS = {  # of a publisher, in the numbers of rmw: reliable, keeps the last message
    **{"history": 1, "depth": 1, "reliability": 1, "durability": 2, "deadline": _FOREVER},
    **{"lifespan": _FOREVER, "liveliness": 1, "liveliness_lease_duration": _FOREVER},
    "avoid_ros_namespace_conventions": False,
}
_TRANSIENT_LOCAL = 1  # durability of what is latched
_LINE_STRIP = 4  # visualization_msgs/Marker
_LINE_M, _GREY = 0.005, 0.45  # of outlines

Send = Callable[[str, str, float, dict[str, Any]], None]  # topic, interface, time [s], message


@public
def save_ros2_bag(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write a plan as a ROS 2 bag in MCAP, atomically.

    Args:
        plan: The plan.
        path: Where to write it.
        rate_Hz: Samples per second that are added to the plan's own; default: none.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If mcap-ros2-support is not installed, or rate or path are not acceptable.
    """
    require("a bag for ROS 2", "ros", "mcap-ros2-support")
    from mcap_ros2.writer import Writer

    shown = plan.require() if rate_Hz is None else refined(plan, rate_Hz).require()
    check_writable(path)
    memory = io.BytesIO()
    with Writer(memory) as bag:
        schemas = {
            name: bag.register_msgdef(name.replace("/", "/msg/"), _definition(name))
            for name in _TYPES
        }

        def send(topic: str, interface: str, time_s: float, message: dict[str, Any]) -> None:
            if topic not in bag._channel_ids:  # it would register one without metadata
                durable = {"durability": _TRANSIENT_LOCAL} if topic.endswith(_LATCHED) else {}
                bag._channel_ids[topic] = bag._writer.register_channel(
                    topic=topic,
                    message_encoding="cdr",
                    schema_id=schemas[interface].id,
                    metadata={"offered_qos_profiles": json.dumps([_QOS | durable])},  # JSON is YAML
                )
            at = round(time_s * 1e9)
            bag.write_message(topic, schemas[interface], message, log_time=at, publish_time=at)

        send("/robot_description", "std_msgs/String", 0.0, {"data": urdf(plan.robot)})
        _send_surroundings(plan.problem, send)
        _send_motion(shown, send)
        _send_commands(shown.trajectory.held(), send)
    write_bytes(path, memory.getvalue())


def _news(table: Array, step: float = 0.0) -> NDArray[np.bool_]:
    """Rows of a table (rows, columns) that say something new, and the last one: the plan's end.

    A row is new where it differs from the last new one by more than ``step`` in any column.
    """
    new, known = np.zeros(len(table), dtype=bool), np.full(table.shape[1], np.inf)
    for row, values in enumerate(table):
        if (np.abs(values - known) > step).any():
            new[row], known = True, values
    new[-1] = True
    return new


def _send_surroundings(problem: Problem, send: Send) -> None:
    """Outlines of obstacles and objects, once, if there are any."""
    placed = zip(problem.world.names, problem.obstacles, strict=True)
    outlines = [(WORLD, name, obstacle.inner_corners_m) for name, obstacle in placed]
    outlines += [(_frame_of(each), each.name, each.own.inner_corners_m) for each in problem.objects]
    markers = [
        {
            "header": _header(0.0, frame),
            "ns": name,
            "type": _LINE_STRIP,
            "pose": {"position": _xyz(0.0, 0.0), "orientation": _turn(0.0)},
            "scale": _xyz(_LINE_M, 0.0),
            "color": dict.fromkeys("rgb", _GREY) | {"a": 1.0},
            "frame_locked": True,
            "points": [_xyz(*corner) for corner in [*corners.tolist(), corners[0].tolist()]],
        }
        for frame, name, corners in outlines
    ]
    if markers:
        send("/surroundings", "visualization_msgs/MarkerArray", 0.0, {"markers": markers})


def _frame_of(item: Object) -> str:
    return f"object {item.name}"


def _send_motion(plan: Plan, send: Send) -> None:
    """Paths once; joint states and frames wherever robot or objects have moved."""
    geometry, samples = plan.robot.geometry, plan.samples
    turned = plan.trajectory.wheel_travel_rad(samples.t_s)
    things = plan.problem.objects
    moved = object_poses(plan.trajectory, samples.t_s, samples.q)
    new = _news(np.hstack([samples.q, turned, moved.reshape(len(turned), -1)]))
    times = samples.t_s[new].tolist()
    _send_path("/path", times, samples.q[new, :POSE], send)
    for number in range(len(things)):
        _send_path(f"/object{number + 1}/path", times, moved[new, number], send)
    lines = [task.stage(plan.problem.modes).follows for task in plan.problem.tasks]
    for number, line in enumerate((each.line for each in lines if each is not None), start=1):
        asked = np.where(np.isnan(line.headings), line.tangent.headings, line.headings)
        poses = np.column_stack([line.points, asked])
        _send_path(f"/follow{number}/path", [0.0] * len(poses), poses, send)
    chain = joints(geometry)
    names = [joint.name for joint in chain]
    rows = zip(times, samples.q[new], turned[new], moved[new].tolist(), strict=True)
    for time_s, q, wheel_rad, at in rows:
        position = angles(geometry, q, wheel_rad).tolist()
        state = _joint_state(time_s, names, position)
        send("/joint_states", "sensor_msgs/JointState", time_s, state)
        x, y, phi = q[:POSE].tolist()
        frames = [_frame(time_s, WORLD, BASE, _xyz(x, y), _turn(phi))]
        frames += [_joint_frame(time_s, *each) for each in zip(chain, position, strict=True)]
        for item, (x, y, phi) in zip(things, at, strict=True):
            frames.append(_frame(time_s, WORLD, _frame_of(item), _xyz(x, y), _turn(phi)))
        send("/tf", "tf2_msgs/TFMessage", time_s, {"transforms": frames})


def _send_path(topic: str, times: list[float], poses: Array, send: Send) -> None:
    stamped = [
        {"header": _header(t), "pose": {"position": _xyz(x, y), "orientation": _turn(phi)}}
        for t, (x, y, phi) in zip(times, poses.tolist(), strict=True)
    ]
    send(topic, "nav_msgs/Path", 0.0, {"header": _header(0.0), "poses": stamped})


def _send_commands(held: Samples, send: Send) -> None:
    """Mode, wheel speeds, set-points and temperatures, each when it changes."""
    new = _news(held.mode.astype(float))
    for t, mode in zip(held.t_s[new].tolist(), held.mode[new].tolist(), strict=True):
        dimension = {"label": "segment", "size": len(mode), "stride": len(mode)}
        message = {"layout": {"dim": [dimension], "data_offset": 0}, "data": mode}
        send("/mode", "std_msgs/UInt8MultiArray", t, message)
    axles = [f"wheel{i}_axle" for i in range(1, held.wheel_rad_s.shape[1] + 1)]
    new = _news(held.wheel_rad_s)
    for t, speeds in zip(held.t_s[new].tolist(), held.wheel_rad_s[new].tolist(), strict=True):
        state = _joint_state(t, axles, [], speeds)
        send("/wheel_commands", "sensor_msgs/JointState", t, state)
    series = {"setpoint": (held.heater_setpoint_C, 0.0)}
    series["temperature"] = held.temperature_C, TEMPERATURE_STEP_C
    for name, (values, step) in series.items():
        for segment in range(values.shape[1]):
            new = _news(values[:, segment, None], step)
            link = f"segment{segment + 1}_piece1"
            for t, value in zip(held.t_s[new].tolist(), values[new, segment].tolist(), strict=True):
                message = {"header": _header(t, link), "temperature": value, "variance": 0.0}
                topic = f"/segment{segment + 1}/{name}"
                send(topic, "sensor_msgs/Temperature", t, message)


def _definition(name: str) -> str:
    """Definition of an interface, followed by those that it is made of, as bags hold it."""
    parts, wanted = [_TYPES[name]], [name]
    for each in wanted:
        for line in _TYPES[each].splitlines():
            inner = line.split()[0].removesuffix("[]")
            if inner in _TYPES and inner not in wanted:
                wanted.append(inner)
                parts.append(f"{_RULE}{inner}\n{_TYPES[inner]}")
    return "".join(parts)


def _joint_frame(time_s: float, joint: Joint, angle_rad: float) -> dict[str, Any]:
    x, y, turned = joint.at
    if joint.wheel is None:
        return _frame(time_s, joint.parent, joint.child, _xyz(x, y), _turn(turned + angle_rad))
    z, w = math.sin(turned / 2), math.cos(turned / 2)
    y_, v = math.sin(angle_rad / 2), math.cos(angle_rad / 2)  # about y, in the frame turned about z
    rolled = _quaternion(-z * y_, w * y_, z * v, w * v)
    return _frame(time_s, joint.parent, joint.child, _xyz(x, y), rolled)


def _frame(
    time_s: float, parent: str, child: str, at: dict[str, float], turned: dict[str, float]
) -> dict[str, Any]:
    transform = {"translation": at, "rotation": turned}
    return {"header": _header(time_s, parent), "child_frame_id": child, "transform": transform}


def _joint_state(
    time_s: float, names: list[str], position: list[float], velocity: list[float] | None = None
) -> dict[str, Any]:
    values = {"position": position, "velocity": velocity or [], "effort": []}
    return {"header": _header(time_s), "name": names, **values}


def _header(time_s: float, frame: str = WORLD) -> dict[str, Any]:
    sec, nanosec = divmod(round(time_s * 1e9), 1_000_000_000)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def _xyz(x: float, y: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": 0.0}


def _turn(angle_rad: float) -> dict[str, float]:
    """A turn about z."""
    return _quaternion(0.0, 0.0, math.sin(angle_rad / 2), math.cos(angle_rad / 2))


def _quaternion(x: float, y: float, z: float, w: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z, "w": w}
