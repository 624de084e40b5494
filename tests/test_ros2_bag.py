"""A bag for ROS 2, read back by a reader of its own: the chain of the URDF is the robot."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from conftest import Run
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from once import planned

from twosra_mpc import Follow, InputError, Plan, load_robot
from twosra_mpc.lab.export.robot_chain import angles, joints, urdf
from twosra_mpc.lab.export.ros2_mcap import TEMPERATURE_STEP_C, save_ros2_bag
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.robot.geometry import Geometry

LATCHED = {"/robot_description", "/path", "/mode", "/surroundings"}
Messages = dict[str, list[tuple[float, Any]]]


def read(path: Path) -> Messages:
    found: Messages = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, message, content in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time * 1e-9, content))
    return found


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Messages]:
    plan, path = planned("paper-1"), tmp_path_factory.mktemp("bag") / "bag.mcap"
    save_ros2_bag(plan, path)
    return plan, read(path)


def turn(axis: str, angle: float) -> np.ndarray:
    """Homogeneous rotation about y or z."""
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.eye(4)
    rows = np.ix_((0, 2), (0, 2)) if axis == "y" else np.ix_((0, 1), (0, 1))
    matrix[rows] = [[c, s], [-s, c]] if axis == "y" else [[c, -s], [s, c]]
    return matrix


def frames_of(description: str, angle: dict[str, float]) -> dict[str, np.ndarray]:
    """Frames in b0 by the URDF alone: every joint at its angle, parents before children."""
    document = ElementTree.fromstring(description)
    links = {link.attrib["name"] for link in document.iter("link")}
    placed = {"b0": np.eye(4)}
    for joint in document.iter("joint"):
        ends = [joint.find(role) for role in ("parent", "child", "origin", "axis")]
        parent, child, origin, axis = (each.attrib for each in ends if each is not None)
        at = np.eye(4)
        at[:3, 3] = [float(value) for value in origin["xyz"].split()]
        at = at @ turn("z", float(origin["rpy"].split()[2]))
        about = {"0 1 0": "y", "0 0 1": "z"}[axis["xyz"]]
        placed[child["link"]] = (
            placed[parent["link"]] @ at @ turn(about, angle[joint.attrib["name"]])
        )
    assert set(placed) == links
    return placed


@pytest.mark.parametrize("robot", ["2sra-v1", "2sr-v2", "3sra"])
@pytest.mark.parametrize("bend", [0.0, 0.4, 1.0])
def test_the_chain_ends_where_the_arcs_do(robot: str, bend: float) -> None:
    described = load_robot(robot)
    geometry = described.geometry
    alpha = bend * np.resize([1.5, -1.2, 0.9], geometry.segments)
    q = np.array([0, 0, 0, *alpha / geometry.lengths_m])
    names = [joint.name for joint in joints(geometry)]
    angle = dict(zip(names, angles(geometry, q, np.zeros(4)).tolist(), strict=True))
    placed = frames_of(urdf(described), angle)
    shape = robot_shape(geometry, q)
    for frame, (x, y, heading) in zip(("b1", "b2"), shape.ends, strict=True):
        at = placed[frame]
        assert math.atan2(at[1, 0], at[0, 0]) == pytest.approx(heading, abs=1e-9)
        assert math.hypot(at[0, 3] - x, at[1, 3] - y) < 0.01 * sum(geometry.lengths_m)
    if not bend:
        for i, corners in enumerate(shape.wheels):
            at = placed[f"wheel{i + 1}"]
            np.testing.assert_allclose(at[:2, 3], corners.mean(axis=0), atol=1e-9)
            rolls = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
            np.testing.assert_allclose(at[:2, 0], rolls, atol=1e-9)


def test_one_segment_has_unit_1_at_b0() -> None:
    values = load_robot("2sra-v1").geometry.model_dump() | {"segments": 1}
    one = load_robot("2sra-v1").model_copy(update={"geometry": Geometry(**values)})
    angle = dict.fromkeys((joint.name for joint in joints(one.geometry)), 0.0)
    assert len(frames_of(urdf(one), angle)) == 1 + 8 + 1 + 4


def test_frames_are_those_of_the_urdf_and_the_joint_states(bag: tuple[Plan, Messages]) -> None:
    plan, messages = bag
    ((_, description),) = messages["/robot_description"]
    q = dict(zip(np.round(plan.samples.t_s, 9).tolist(), plan.samples.q, strict=True))
    assert len(messages["/tf"]) == len(messages["/joint_states"])
    for (time_s, state), (same_s, tf) in zip(
        messages["/joint_states"], messages["/tf"], strict=True
    ):
        assert time_s == same_s
        placed = frames_of(description.data, dict(zip(state.name, state.position, strict=True)))
        world, seen = {}, {"world": np.eye(4)}
        for item in tf.transforms:
            seen[item.child_frame_id] = seen[item.header.frame_id] @ matrix(item.transform)
            world[item.child_frame_id] = seen[item.child_frame_id]
        np.testing.assert_allclose(world["b0"], planar(*q[round(time_s, 9)][:3]), atol=1e-9)
        for name, at in placed.items():
            np.testing.assert_allclose(world[name], world["b0"] @ at, atol=1e-7)


def planar(x: float, y: float, heading: float) -> np.ndarray:
    at = turn("z", heading)
    at[:2, 3] = x, y
    return at


def matrix(transform: Any) -> np.ndarray:
    r, t = transform.rotation, transform.translation
    x, y, z, w = r.x, r.y, r.z, r.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t.z],
            [0, 0, 0, 1],
        ]
    )


def test_commands_turn_the_wheels_as_far_as_planned(bag: tuple[Plan, Messages]) -> None:
    plan, messages = bag
    times, states = zip(*messages["/wheel_commands"], strict=True)
    speeds = np.array([state.velocity for state in states])
    assert not speeds[-1].any()
    turned = (speeds[:-1] * np.diff(times)[:, None]).sum(axis=0)
    np.testing.assert_allclose(
        turned, plan.trajectory.wheel_travel_rad(plan.duration_s)[0], atol=1e-6
    )
    *_, (_, last) = messages["/joint_states"]
    np.testing.assert_allclose(last.position[-4:], turned, atol=1e-6)
    (_, path), *others = messages["/path"]
    assert not others
    end = path.poses[-1].pose.position
    assert (end.x, end.y) == pytest.approx(tuple(plan.samples.q[-1, :2]))


def test_nothing_is_told_while_nothing_changes(bag: tuple[Plan, Messages]) -> None:
    plan, messages = bag
    for topic, step in (("temperature", TEMPERATURE_STEP_C), ("setpoint", 0.0)):
        for segment in (1, 2):
            told = [item.temperature for _, item in messages[f"/segment{segment}/{topic}"]]
            assert (np.abs(np.diff(told[:-1])) > step).all()  # but for the end
    moving = [(phase.start_s - 1e-6, phase.end_s + 1e-6) for phase in plan.phases]
    for time_s, _ in messages["/tf"][1:-1]:
        assert any(start <= time_s <= end for start, end in moving)


def test_the_bag_is_the_plan_to_its_end(bag: tuple[Plan, Messages]) -> None:
    plan, messages = bag
    for topic, told in messages.items():
        assert topic in LATCHED or told[-1][0] == pytest.approx(plan.duration_s, abs=1e-9), topic
    told = messages["/mode"]
    times = np.array([time_s for time_s, _ in told])
    for time_s, mode in zip(plan.samples.t_s, plan.samples.mode, strict=True):
        (last,) = np.flatnonzero(times <= time_s + 1e-9)[-1:]
        assert list(told[last][1].data) == mode.tolist()


def test_who_comes_late_gets_what_is_latched(tmp_path: Path) -> None:
    """In the numbers of rmw: durability 1 is transient local, 2 volatile."""
    save_ros2_bag(planned("paper-2"), tmp_path / "bag.mcap")
    with (tmp_path / "bag.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    for channel in summary.channels.values():
        (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert profile["durability"] == (1 if channel.topic in LATCHED else 2)
        assert profile["reliability"] == 1


def test_objects_are_outlines_in_frames_that_move_with_them(tmp_path: Path) -> None:
    made, path = planned("grasp-cube"), tmp_path / "plan.mcap"
    save_ros2_bag(made, path)
    messages = read(path)
    ((_, around),) = messages["/surroundings"]
    problem = made.problem
    outlines = {each.ns: np.array([(p.x, p.y) for p in each.points]) for each in around.markers}
    assert list(outlines) == [*problem.world.names, *(each.name for each in problem.objects)]
    for name, obstacle in zip(problem.world.names, problem.obstacles, strict=True):
        assert outlines[name][:-1] == pytest.approx(obstacle.inner_corners_m)
    frames = {each.ns: each.header.frame_id for each in around.markers}
    for time_s, tf in messages["/tf"]:
        placed = {each.child_frame_id: matrix(each.transform) for each in tf.transforms}
        poses = object_poses(made.trajectory, np.array([time_s]))[0]
        for item, pose in zip(problem.objects, poses, strict=True):
            corners = np.insert(outlines[item.name][:-1], 2, [[0.0], [1.0]], axis=1)
            there = (corners @ placed[frames[item.name]].T)[:, :2]
            assert there == pytest.approx(item.at(pose).inner_corners_m, abs=1e-6)
    for number, pose in enumerate(poses, start=1):
        ((_, path),) = messages[f"/object{number}/path"]
        end = path.poses[-1].pose.position
        assert (end.x, end.y) == pytest.approx(tuple(pose[:2]))


def test_what_is_to_be_followed_is_a_path(tmp_path: Path) -> None:
    made, path = planned("follow-bezier"), tmp_path / "plan.mcap"
    save_ros2_bag(made, path)
    ((_, asked),) = read(path)["/follow1/path"]
    (task,) = made.problem.tasks
    assert isinstance(task, Follow)
    at = [pose.pose.position for pose in asked.poses]
    assert np.array([(p.x, p.y) for p in at]) == pytest.approx(task.line.points)


def test_the_command_writes_a_bag(run: Run, tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    code, _, err = run("plan", "paper-1", "--out", str(plan))
    assert code == 0, err
    code, _, err = run("export", str(plan), str(tmp_path / "bag.mcap"), "--rate", "5")
    assert code == 0, err
    assert "/tf" in read(tmp_path / "bag.mcap")


def test_without_the_extra_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcap_ros2", None)
    with pytest.raises(InputError, match="mcap-ros2-support"):
        save_ros2_bag(planned("paper-1"), tmp_path / "bag.mcap")
