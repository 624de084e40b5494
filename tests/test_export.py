"""What other programs read: MCAP and CSV hold the plan, in the formats that they know."""

from __future__ import annotations

import csv
import itertools
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Planned, Run, Solved
from foxglove.messages import FrameTransforms, Quaternion, SceneUpdate
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from twosra_mpc import InputError, Plan, plotting
from twosra_mpc.checking.plan_file import refined
from twosra_mpc.export import foxglove_messages
from twosra_mpc.export.plan_mcap import TABLES, TOPICS, save_mcap
from twosra_mpc.installation import install_command
from twosra_mpc.plans.setpoints import save_authors_csv
from twosra_mpc.plans.trajectory import SAME_TIME_S

Messages = dict[str, list[tuple[float, Any]]]


def read(path: Path) -> Messages:
    """Messages by topic with their times [s], each as its schema in the file describes it."""
    found: Messages = {topic: [] for topic in TOPICS}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert message.log_time == message.publish_time
            if schema.encoding == "jsonschema":
                content = json.loads(message.data)
                Draft202012Validator(json.loads(schema.data)).validate(content)
            else:
                content = decoded(schema, message.data)
            found[channel.topic].append((message.log_time * 1e-9, content))
    return found


def decoded(schema: Schema, data: bytes) -> Any:
    """A message of Foxglove's, read by the schema that the file carries."""
    decode = DecoderFactory().decoder_for("protobuf", schema)
    assert decode is not None
    return decode(data)


@pytest.fixture(scope="module", params=["paper-1", "paper-2"])
def exported(
    request: pytest.FixtureRequest, planned: Planned, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Plan, Messages]:
    """A plan, and what is read back from its MCAP file."""
    plan = planned(request.param)
    path = tmp_path_factory.mktemp("export") / "plan.mcap"
    save_mcap(plan, path)
    return plan, read(path)


# --- MCAP ----------------------------------------------------------------------------------------


def test_tables_hold_the_samples_from_message_to_message(exported: tuple[Plan, Messages]) -> None:
    plan, messages = exported
    samples = plan.trajectory.held()
    expected = {
        "/configuration": samples.q,
        "/mode": samples.mode,
        "/wheels": samples.wheel_rad_s,
        "/heaters": np.hstack([samples.heater_setpoint_C, samples.heater_current_A]),
        "/temperatures": np.hstack([samples.temperature_C, samples.melt_fraction]),
    }
    for topic, table in expected.items():
        times, contents = zip(*messages[topic], strict=True)
        told = np.array([list(each.values()) for each in contents])
        last = np.searchsorted(times, samples.t_s + 1e-9) - 1
        step = [0.1, 0.1, 0.01, 0.01] if topic == "/temperatures" else 0.0
        assert (np.abs(told[last] - table) <= step).all()
        new = np.abs(np.diff(told, axis=0)) > step
        assert new.any(axis=1).all(), "nothing is told twice"


def test_wheels_that_hold_from_message_to_message_turn_as_far_as_planned(
    exported: tuple[Plan, Messages],
) -> None:
    plan, messages = exported
    times, contents = zip(*messages["/wheels"], strict=True)
    speeds = np.array([list(each.values()) for each in contents])
    turned = (speeds[:-1] * np.diff(times)[:, None]).sum(axis=0)
    expected = plan.trajectory.wheel_travel_rad(plan.duration_s)[0]
    np.testing.assert_allclose(turned, expected, atol=1e-6)


def test_the_robot_is_written_whenever_it_moves_or_changes(
    exported: tuple[Plan, Messages],
) -> None:
    plan, messages = exported
    samples = plan.samples
    times = [time_s for time_s, _ in messages["/robot"]]
    assert times == [time_s for time_s, _ in messages["/tf"]]
    moved = samples.t_s[1:][np.diff(samples.q, axis=0).any(axis=1)]
    assert {0.0, *np.round(moved, 9).tolist()} <= set(np.round(times, 9).tolist())
    for time_s, content in messages["/robot"]:
        (entity,) = content.entities
        assert entity.timestamp.ToNanoseconds() * 1e-9 == pytest.approx(time_s)


def test_colours_tell_the_stiffness(exported: tuple[Plan, Messages]) -> None:
    plan, messages = exported
    colours = {
        "rigid": plotting.RIGID_COLOUR,
        "melting": plotting.CHANGING_COLOUR,
        "soft": plotting.SOFT_COLOUR,
        "freezing": plotting.FREEZING_COLOUR,
    }
    seen = set()
    for time_s, content in messages["/robot"]:
        for j, line in enumerate(content.entities[0].lines[3:]):
            state = "soft" if plan.problem.start_mode[j] else "rigid"
            for item in plan.transitions:
                if item.segment == j + 1 and time_s >= item.onset_s - SAME_TIME_S:
                    changing = "melting" if item.to == "soft" else "freezing"
                    state = changing if time_s < item.done_s - SAME_TIME_S else item.to
            shade = "".join(f"{round(255 * getattr(line.color, c)):02x}" for c in "rgb")
            assert f"#{shade}" == colours[state]
            seen.add(state)
    assert seen == {*colours}


def test_frames_and_scene_are_the_same_robot(exported: tuple[Plan, Messages]) -> None:
    plan, messages = exported
    geometry = plan.robot.geometry
    h1, (h2, h3) = geometry.side_wheel_m, geometry.front_wheel_m
    for (_, scene), (_, tf) in zip(messages["/robot"], messages["/tf"], strict=True):
        placed = {"world": np.eye(3)}
        for item in tf.transforms:
            assert (item.rotation.x, item.rotation.y) == (0.0, 0.0)
            placed[item.child_frame_id] = placed[item.parent_frame_id] @ matrix(item)
        entity = scene.entities[0]
        for side, frame, line in zip((-1, 1), ("b1", "b2"), entity.lines[3:], strict=True):
            points = [[point.x, point.y, 1.0] for point in line.points][::side]
            root = placed["b0"] @ [side * geometry.middle_link_m / 2, 0.0, 1.0]
            np.testing.assert_allclose(points[0], root, atol=1e-11)
            np.testing.assert_allclose(points[-1], placed[frame] @ [0.0, 0.0, 1.0], atol=1e-11)
            length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
            assert length == pytest.approx(geometry.lengths_m[0], rel=5e-3)  # a polygon
        centres = [
            placed["b1"] @ [-h2, 0.0, 1.0],
            placed["b2"] @ [h2, 0.0, 1.0],
            placed["b1"] @ [-h1, 0.0, 1.0],
            placed["b1"] @ [-h2, h3, 1.0],
            placed["b2"] @ [h1, 0.0, 1.0],
            placed["b2"] @ [h2, -h3, 1.0],
        ]
        for cube, centre in zip(entity.cubes, centres, strict=True):
            position = cube.pose.position
            np.testing.assert_allclose((position.x, position.y), centre[:2], atol=1e-11)
            assert position.z == pytest.approx(cube.size.z / 2)  # it stands on the floor
        for wheel in entity.cubes[2:]:
            rolling, across = 2 * geometry.wheel_radius_m, geometry.wheel_thickness_m
            assert (wheel.size.x, wheel.size.y) == pytest.approx((rolling, across))


def matrix(transform: Any) -> np.ndarray:
    """Homogeneous matrix of a transform in the plane."""
    z, w = transform.rotation.z, transform.rotation.w
    assert z * z + w * w == pytest.approx(1.0)
    c, s = w * w - z * z, 2 * w * z
    at = transform.translation
    return np.array([[c, -s, at.x], [s, c, at.y], [0.0, 0.0, 1.0]])


def test_robot_and_frames_are_whole_messages_of_the_official_schemas(
    planned: Planned, tmp_path: Path
) -> None:
    save_mcap(planned("paper-2"), tmp_path / "plan.mcap")
    official = {"/robot": SceneUpdate.get_schema(), "/tf": FrameTransforms.get_schema()}
    with (tmp_path / "plan.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(list(official)):
            assert schema is not None
            expected = official[channel.topic]
            assert (schema.name, schema.encoding) == (expected.name, "protobuf")
            assert schema.data == expected.data
            content = decoded(schema, message.data)
            fields = {field.name for field in content.DESCRIPTOR.fields}
            known = {"/robot": {"deletions", "entities"}, "/tf": {"transforms"}}
            assert fields == known[channel.topic]
            assert content.SerializeToString() == message.data  # nothing the schema does not know


def test_a_table_refuses_what_is_not_in_its_schema(planned: Planned, tmp_path: Path) -> None:
    save_mcap(planned("paper-2"), tmp_path / "plan.mcap")
    with (tmp_path / "plan.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    schemas = [s.data for s in summary.schemas.values() if s.encoding == "jsonschema"]
    assert len(schemas) == len(TABLES)
    for data in schemas:
        validator = Draft202012Validator(json.loads(data))
        validator.check_schema(validator.schema)
        assert all(field["description"] for field in validator.schema["properties"].values())
        assert not validator.is_valid({})
        assert not validator.is_valid({"mode1": "soft", "x_m": "0"})


def test_a_rate_adds_samples_and_keeps_the_plans_own(planned: Planned, tmp_path: Path) -> None:
    plan = planned("paper-2")
    save_mcap(plan, tmp_path / "plan.mcap", rate_Hz=2.0)
    denser = refined(plan, 2.0).samples
    new = [True, *np.diff(denser.q, axis=0).any(axis=1).tolist()]
    messages = read(tmp_path / "plan.mcap")
    times, contents = zip(*messages["/configuration"], strict=True)
    np.testing.assert_allclose(times, denser.t_s[new], atol=1e-9)
    np.testing.assert_array_equal([list(each.values()) for each in contents], denser.q[new])
    for phase in plan.phases:
        there = [t for t in times if phase.start_s <= t <= phase.end_s]
        assert np.diff(there).max() <= 0.5 + 1e-9


def test_the_file_says_what_it_is(planned: Planned, tmp_path: Path) -> None:
    plan = planned("paper-2")
    save_mcap(plan, tmp_path / "plan.mcap")
    with (tmp_path / "plan.mcap").open("rb") as stream:
        reader = make_reader(stream)
        (metadata,) = reader.iter_metadata()
        summary = reader.get_summary()
    assert metadata.metadata["robot"] == plan.robot.name
    assert metadata.metadata["status"] == plan.status
    assert summary is not None
    assert summary.statistics is not None
    assert {channel.topic for channel in summary.channels.values()} == set(TOPICS)


# --- CSV -----------------------------------------------------------------------------------------


def rows_of(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array(rows, dtype=float)


def test_csv_values_equal_the_plan(planned: Planned, tmp_path: Path) -> None:
    plan = planned("paper-1")
    samples = plan.trajectory.held()
    save_authors_csv(plan, tmp_path / "plan.csv")
    header, table = rows_of(tmp_path / "plan.csv")
    assert ",".join(header) == "x,y,angle,k1,k2,v1,v2,u0,v0,r0,s1,s2,time"
    expected = np.column_stack([samples.q, samples.v, samples.mode, samples.t_s])
    np.testing.assert_array_equal(table, expected)


def test_csv_at_a_rate_lies_on_the_path(planned: Planned, tmp_path: Path) -> None:
    plan = planned("paper-2")
    save_authors_csv(plan, tmp_path / "plan.csv", rate_Hz=10.0)
    header, table = rows_of(tmp_path / "plan.csv")
    times = table[:, header.index("time")]
    regular = np.arange(int(10 * plan.duration_s) + 1) / 10
    events = [time_s for phase in plan.phases for time_s in phase[1:]]
    np.testing.assert_allclose(times, np.unique([*regular, *events, plan.duration_s]), atol=1e-9)
    dense = refined(plan, 10.0).samples
    assert dense is not None
    for row, time_s in zip(table, times, strict=True):
        near = int(np.argmin(np.abs(dense.t_s - time_s)))
        if abs(dense.t_s[near] - time_s) < 1e-9:
            np.testing.assert_allclose(row[:5], dense.q[near], atol=1e-9)


# --- refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("save", "name"), [(save_mcap, "p.mcap"), (save_authors_csv, "p.csv")])
def test_a_wrong_rate_is_refused_and_nothing_is_written(
    planned: Planned, tmp_path: Path, save: Any, name: str
) -> None:
    with pytest.raises(InputError, match="rate"):
        save(planned("paper-2"), tmp_path / name, -1.0)
    assert not list(tmp_path.iterdir())


def test_an_export_that_fails_leaves_nothing_behind(
    planned: Planned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = itertools.count()

    def fail(heading: float) -> Quaternion:
        if next(calls) > 200:
            raise RuntimeError("in the middle")
        return Quaternion(w=1.0)

    monkeypatch.setattr(foxglove_messages, "_turned", fail)
    with pytest.raises(RuntimeError, match="in the middle"):
        save_mcap(planned("paper-2"), tmp_path / "plan.mcap")
    assert not list(tmp_path.iterdir())


def test_without_foxglove_the_error_says_how_to_install_it(
    planned: Planned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(InputError, match=re.escape(install_command("mcap"))):
        save_mcap(planned("paper-2"), tmp_path / "plan.mcap")


@pytest.mark.parametrize("name", ["plan.mcap", "plan.csv"])
def test_the_command_writes_and_says_what(
    run: Run,
    solved: Solved,
    tmp_path: Path,
    name: str,
) -> None:
    solved("paper-2").save(tmp_path / "plan.json")
    outcome = run("export", "plan.json", name, "--rate", "1")
    assert (outcome.code, outcome.err) == (0, "")
    assert name in outcome.out
    assert (tmp_path / name).stat().st_size > 1000
    assert len(list(tmp_path.iterdir())) == 2
    outcome = run("export", "plan.json", name, "--json")
    found = json.loads(outcome.out)
    assert found["robot"] == "2sra-v1"
    assert found.get("topics") == (list(TOPICS) if name == "plan.mcap" else None)


def test_the_papers_wheel_map_is_refused_unless_it_is_accepted(
    run: Run, solved: Solved, tmp_path: Path
) -> None:
    solved("rigid-move", robot="2sra-v1-paper").save(tmp_path / "paper.json")
    for name in ("plan.csv", "plan.mcap"):
        refused = run("export", "paper.json", name)
        assert (refused.code, refused.out) == (2, "")
        assert "paper.json: robot.path.model = 'log_spiral' is not acceptable" in refused.err
        assert "bends a robot by 17 to 48 % of what is planned" in refused.err
        assert not (tmp_path / name).exists()
        accepted = run("export", "paper.json", name, "--accept-paper-wheels")
        assert (accepted.code, accepted.err) == (0, "")
        assert (tmp_path / name).exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("plan.json", "plan.bag"), "allowed: a file ending in .mcap or .csv"),
        (("plan.json", "no/folder/plan.mcap"), "a path in a folder that exists and can be written"),
        (("none.json", "plan.mcap"), "none.json"),
        (("plan.json", "plan.csv", "--rate", "0"), "rate = 0.0 is not acceptable"),
    ],
)
def test_bad_input_is_refused(
    run: Run,
    solved: Solved,
    tmp_path: Path,
    arguments: tuple[str, ...],
    words: str,
) -> None:
    solved("paper-2").save(tmp_path / "plan.json")
    outcome = run("export", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert words in outcome.err
    assert len(list(tmp_path.iterdir())) == 1
