"""The rigid-body plant: it is the robot of the kinematics where these hold, and fails in words."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import pytest

from twosra_mpc import InputError, Problem, Robot, cli, installation, load_problem, load_robot
from twosra_mpc.execution import RobotError, SimulatedRobot
from twosra_mpc.execution.simulation.disturbance import LEVELS
from twosra_mpc.model.chain import fibre_end_pose
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.physics.engine import Engine
from twosra_mpc.physics.mjcf import mjcf
from twosra_mpc.problem.speeds import drive_rows
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array
from twosra_mpc.robot.modes import Mode
from twosra_mpc.robot.physics import Physics

HERE = {"x_m": 0.1, "y_m": 0.2, "phi_rad": 0.3}
OFF_C = np.array([25.0, 25.0])


def with_segments(*lengths_m: float) -> Robot:
    robot = load_robot("2sra-v1")
    return robot.with_values(
        geometry=robot.geometry.with_values(
            segments=len(lengths_m), segment_length_m=lengths_m, unit_offset_m=0.004
        )
    )


def problem(*kappa_per_m: float, **more: object) -> Problem:
    start = {**HERE, "kappa_per_m": list(kappa_per_m)}
    return load_problem("paper-2", start=start, **more)


def engine_of(task: Problem, *melted: float, **physics: float) -> Engine:
    robot = task.robot
    return Engine(task, robot, robot.true_physics.with_values(**physics, ranges={}), melted)


def seconds(engine: Engine, duration_s: float, wheel_rad_s: Array, *melted: float) -> Array:
    for _ in range(round(duration_s * 15)):
        engine.roll(wheel_rad_s / 15, melted, 1 / 15)
    return engine.q


def dragged(robot: Robot, mode: Mode, inputs: Array, q: Array) -> tuple[Array, Array]:
    """Mean speeds of idle wheels of a robot that is moved by force, and by the exact wheel map."""
    model = mujoco.MjModel.from_xml_string(mjcf(robot))
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0
    model.jnt_stiffness[:] = model.dof_damping[:] = 0.0
    data, lengths_m = mujoco.MjData(model), np.array(robot.geometry.lengths_m)
    joints = [f"bend{j + 1}_{k + 1}" for j in range(len(lengths_m)) for k in range(8)]
    bends = np.array([model.joint(name).id for name in joints]).reshape(-1, 8)
    pose = [model.joint(name).id for name in ("x", "y", "phi")]
    wheels = [model.joint(f"wheel{number + 1}").id for number in range(WHEELS)]
    exact, turned, sigma = kinematics(robot), np.zeros((2, WHEELS)), np.array(mode)
    for step in range(400):
        rate = exact.jacobian(q, sigma).full() @ inputs
        data.qpos[pose], data.qvel[pose] = q[:POSE], rate[:POSE]
        data.qpos[bends] = (q[POSE:] * lengths_m / 8)[:, None]
        data.qvel[bends] = (rate[POSE:] * lengths_m / 8)[:, None]
        if step == 200:  # they have come up to speed
            turned[0] = data.qpos[wheels]
        if step >= 200:
            turned[1] += model.opt.timestep * (exact.wheel_matrix(q, sigma).full() @ inputs)
        mujoco.mj_step(model, data)
        q = q + model.opt.timestep * rate
    duration_s = 200 * model.opt.timestep
    return (data.qpos[wheels] - turned[0]) / duration_s, turned[1] / duration_s


@pytest.mark.parametrize(
    ("robot", "mode"),
    [
        (with_segments(0.05), (1,)),
        (with_segments(0.04, 0.04), (0, 0)),
        (with_segments(0.04, 0.06), (0, 1)),
        (with_segments(0.03, 0.05, 0.04), (1, 0, 0)),
        (with_segments(0.04, 0.03, 0.04, 0.05), (0, 0, 1, 0)),
        (load_robot("2sr-v2").with_values(path=load_robot("2sra-v1").path), (0, 0)),  # own wheels
    ],
    ids=lambda each: each.name if isinstance(each, Robot) else str(each),
)
def test_idle_wheels_roll_by_the_exact_wheel_map(robot: Robot, mode: Mode) -> None:
    rng = np.random.default_rng(1)
    q = np.array([*rng.uniform(-0.1, 0.1, POSE), *rng.uniform(-15, 15, len(mode))])
    inputs = np.array([0.01, -0.02, *rng.uniform(-0.02, 0.02, 2), 0.1])
    inputs[slice(2, None) if any(mode) else slice(2)] = 0.0
    found, exact = dragged(robot, mode, inputs, q)
    np.testing.assert_allclose(found, exact, atol=0.01 * np.abs(exact).max())


def test_the_chain_of_hinges_becomes_the_arcs() -> None:
    robot = with_segments(0.04, 0.06, 0.05)
    q = np.array([0.0, 0.0, 0.0, 30.0, -20.0, 10.0])
    off_m = []
    for hinges in (4, 8, 16):
        model = mujoco.MjModel.from_xml_string(mjcf(robot, hinges=hinges))
        data = mujoco.MjData(model)
        for j, length_m in enumerate(robot.geometry.lengths_m):
            for k in range(hinges):
                data.joint(f"bend{j + 1}_{k + 1}").qpos = q[POSE + j] * length_m / hinges
        mujoco.mj_kinematics(model, data)
        ends = np.array([ca.DM(fibre_end_pose(robot.geometry, ca.SX(q), unit)) for unit in (0, 1)])
        bodies = [model.joint(f"wheel{number}").bodyid[0] for number in (1, 3)]
        found = data.xpos[model.body_parentid[bodies]][:, :2]
        off_m.append(np.abs(found - ends[:, :2, 0]).max())
    assert off_m[1] < 2e-4
    assert off_m[0] / off_m[1] == pytest.approx(4.0, rel=0.05)  # second order
    assert off_m[1] / off_m[2] == pytest.approx(4.0, rel=0.05)


def test_solid_it_drives_as_planned_and_soft_it_bends_and_freezes_as_it_is() -> None:
    task = problem(20.0, -10.0)
    twist, engine = np.array([0.02, -0.01, 0.05]), engine_of(task, 0.0, 0.0)
    q = seconds(engine, 2.0, drive_rows(task.robot, engine.q[3:])[1] @ twist, 0.0, 0.0)
    assert q[2] - 0.3 == pytest.approx(0.1, rel=0.05)
    assert np.hypot(*(q[:2] - [0.1, 0.2])) == pytest.approx(2 * np.hypot(0.02, 0.01), rel=0.05)
    assert q[POSE:] == pytest.approx([20.0, -10.0], abs=0.3)

    straight = engine_of(problem(0.0, 0.0), 1.0, 0.0)
    bent = seconds(straight, 3.0, np.array([4.0, 0.83, 0.0, 0.0]), 1.0, 0.0)
    assert bent[3] > 10.0  # both wheels of unit 1: the exact map's command
    assert abs(bent[4]) < 0.5
    for melted in np.linspace(1.0, 0.0, 10):
        frozen = seconds(straight, 0.2, np.zeros(WHEELS), melted, 0.0)
    assert frozen[3] == pytest.approx(bent[3], abs=1.0)
    straight.model.actuator_gainprm[:] = straight.model.actuator_biasprm[:] = 0.0
    assert seconds(straight, 2.0, np.zeros(WHEELS), 0.0, 0.0)[3] == pytest.approx(
        frozen[3], rel=0.02
    )
    assert abs(seconds(straight, 2.0, np.zeros(WHEELS), 1.0, 0.0)[3]) < 0.7 * frozen[3]


def test_walls_stop_it_and_objects_are_pushed() -> None:
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}  # to x = 145 mm
    wall = {"name": "wall", "box": {"x_m": [0.16, 0.20], "y_m": [-0.2, 0.2]}}
    stopped = engine_of(load_problem("paper-2", start=start, obstacles=[wall]), 0.0, 0.0)
    forward = drive_rows(load_robot("2sra-v1"), stopped.q[3:])[1] @ [0.02, 0.0, 0.0]
    assert stopped.touched == ""
    assert seconds(stopped, 2.0, forward, 0.0, 0.0)[0] == pytest.approx(0.015, abs=1e-3)
    assert stopped.touched == "wall"
    cup = {"name": "cup", "disc": {"radius_m": 0.02}, "pose": {"x_m": 0.18, "y_m": 0.0}}
    behind = {"name": "wall", "box": {"x_m": [0.225, 0.30], "y_m": [-0.2, 0.2]}}
    around = {"objects": [cup], "obstacles": [behind]}
    pushing = engine_of(load_problem("paper-2", start=start, **around), 0.0, 0.0)
    assert pushing.poses[0] == pytest.approx([0.18, 0.0, 0.0], abs=1e-6)
    assert seconds(pushing, 2.0, forward, 0.0, 0.0)[0] == pytest.approx(0.04, abs=2e-3)
    assert pushing.poses[0, 0] == pytest.approx(0.205, abs=3e-3)
    assert pushing.touched == ""  # the cup alone may touch the wall


def test_what_rests_does_not_creep() -> None:
    engine = engine_of(problem(20.0, -10.0), 1.0, 0.0)
    seconds(engine, 1.0, np.array([4.0, 0.83, 0.0, 0.0]), 1.0, 0.0)
    before = seconds(engine, 1.0, np.zeros(WHEELS), 1.0, 0.0)
    crept = np.abs(seconds(engine, 5.0, np.zeros(WHEELS), 1.0, 0.0) - before)
    assert (
        crept < [2e-5, 2e-5, 1e-3, 0.02, 0.02]
    ).all()  # without the pass against slip: ten times


def test_segments_of_the_fibre_touch_each_other_and_not_themselves() -> None:
    """A segment of 80 mm rolled up meets the one beside it; either alone meets nothing."""
    robot, touching = with_segments(0.08, 0.08), []
    model = mujoco.MjModel.from_xml_string(mjcf(robot))
    fibre = model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE
    for kappa in ([0.0, 0.0], [8.0, -8.0], [65.0, 65.0]):
        data = mujoco.MjData(model)
        for j, bent in enumerate(kappa):
            for k in range(8):
                data.joint(f"bend{j + 1}_{k + 1}").qpos = bent * 0.08 / 8
        mujoco.mj_forward(model, data)
        touching.append(int(fibre[data.contact.geom].all(axis=1).sum()))
    assert touching[:2] == [0, 0]
    assert touching[2] > 0


def test_a_problem_is_exported_as_it_starts(tmp_path: Path) -> None:
    for name in ("pick-and-place", "scattered", "paper-1"):
        target, task = tmp_path / f"{name}.xml", load_problem(name)
        with pytest.raises(SystemExit) as ended:
            cli.main(["export", name, str(target), "--quiet"])
        assert ended.value.code == 0
        model = mujoco.MjModel.from_xml_path(str(target))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
        start = task.start.configuration
        for _ in range(400):
            mujoco.mj_step(model, data)
        pose = [data.joint(each).qpos[0] for each in ("x", "y", "phi")]
        bent = [
            sum(data.joint(f"bend{j + 1}_{k + 1}").qpos[0] for k in range(8)) / length_m
            for j, length_m in enumerate(task.robot.geometry.lengths_m)
        ]
        np.testing.assert_allclose(pose, start[:POSE], atol=2e-3)
        np.testing.assert_allclose(bent, start[POSE:], atol=0.3)


def test_the_plant_is_the_same_robot_with_other_motion() -> None:
    task = problem(10.0, -5.0)
    by_arcs, ideal = (SimulatedRobot(task, plant, seed=4) for plant in ("arc", "mujoco"))
    drawn = [SimulatedRobot(task, "mujoco", LEVELS["mild"], seed) for seed in (4, 4, 5)]
    for robot in (by_arcs, ideal, *drawn):
        robot.send(np.array([3.0, 0.0, -3.0, 0.0]), np.array([65.0, 25.0]))
        robot.wait(0.4)
        robot.send(np.zeros(WHEELS), np.array([65.0, 25.0]))
        robot.wait(1.0)
    heat_J = [robot.truth().heat_J[-1] for robot in (by_arcs, ideal)]
    assert heat_J[0] == pytest.approx(heat_J[1], rel=1e-12)
    assert ideal.q[:POSE] == pytest.approx(by_arcs.q[:POSE], abs=2e-3)
    np.testing.assert_array_equal(drawn[0].truth().q, drawn[1].truth().q)
    assert np.abs(drawn[0].q - drawn[2].q).max() > 1e-6


def test_what_nobody_has_measured_is_drawn_from_its_ranges() -> None:
    known = load_robot("2sra-v1").true_physics
    assert known == Physics()  # what robots without [physics] are taken for
    rng = np.random.default_rng(0)
    drawn = [known.drawn(1.0, rng) for _ in range(300)]
    for name, (low, high) in known.ranges.items():
        values = [getattr(one, name) for one in drawn]
        assert low <= min(values) < low + 0.05 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    assert known.drawn(0.0, rng) == known


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"unit_mass_kg": 0.5}, "ranges.unit_mass_kg"),
        ({"soft_stiffness_N_m2": 0.3, "ranges": {}}, "solid_stiffness_N_m2"),
        ({"ranges": {"mass": [1.0, 2.0]}}, "ranges.mass"),
        ({"wheel_friction": -0.1}, "wheel_friction"),
    ],
)
def test_physics_that_cannot_be_are_refused(table: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Physics(**table)  # type: ignore[arg-type]


def test_a_simulation_that_diverges_ends_with_its_cause() -> None:
    robot = load_robot("2sra-v1")
    stiff = Physics(solid_stiffness_N_m2=1e6, relaxation_s=1e-9, ranges={})
    with pytest.raises(RobotError, match=r"diverged .* steps of 1.5 ms"):
        SimulatedRobot(problem(10.0, -5.0, robot=robot.with_values(physics=stiff)), "mujoco")


def test_wheels_that_cannot_carry_the_robot_are_refused() -> None:
    robot = load_robot("2sra-v1")
    aside = [(-0.08, 0.03), (-0.05, 0.04), (0.08, 0.03), (0.05, 0.04)]
    wheels = [{"x_m": x_m, "y_m": y_m, "angle_rad": 0.3 * x_m} for x_m, y_m in aside]
    tips = robot.with_values(geometry=robot.geometry.with_values(wheels=wheels))
    with pytest.raises(InputError, match="it tips over"):
        mjcf(tips)
    drags = robot.geometry.with_values(fibre_radius_m=0.011)
    with pytest.raises(InputError, match="wheel_radius_m"):
        mjcf(robot.with_values(geometry=drags))


def test_without_mujoco_or_a_display_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match=r"--viewer.*no display"):
        SimulatedRobot(problem(0.0, 0.0), "mujoco", viewer=True)
    with pytest.raises(InputError, match="only plant mujoco"):
        SimulatedRobot(problem(0.0, 0.0), "arc", viewer=True)
    monkeypatch.setattr(installation, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"mujoco is missing.*\[physics\]"):
        SimulatedRobot(problem(0.0, 0.0), "mujoco")


def test_a_robot_is_exported_as_mjcf(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("3sra", "2sr-v2"):
        target = tmp_path / f"{name}.xml"
        with pytest.raises(SystemExit) as ended:
            cli.main(["export", name, str(target)])
        assert ended.value.code == 0
        assert name in capsys.readouterr().out
        model = mujoco.MjModel.from_xml_path(str(target))
        assert model.nu == WHEELS
