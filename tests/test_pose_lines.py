"""Poses as lines: what is taken, what is refused, and that a robot nothing sees is not driven."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import Run
from once import planned, solved
from simulated_firmware import SimulatedFirmware, assert_off

from twosra_mpc import InputError, Plan, Problem, load_problem, load_robot
from twosra_mpc.execution.run import Ending, load_run
from twosra_mpc.lab.serial.port import stop_command
from twosra_mpc.lab.serial.pose_lines import LATEST_S, PoseLines, pose_lines
from twosra_mpc.lab.serial.robot import STOPS, SerialRobot
from twosra_mpc.lab.serial.stream import Confirm, RunFile, StreamError, ThinkAside, stream
from twosra_mpc.model.rolling import NO_DRIFT, rolling
from twosra_mpc.planning.planner import plan as find_plan
from twosra_mpc.plans.result import Result
from twosra_mpc.plotting import plot_run

ROBOT = load_robot("2sra-v1")
UNIX_S = 1.7e9
RATE_HZ = 15.0


def lines_of(text: bytes) -> PoseLines:
    """A source that holds these bytes, read at ``UNIX_S``."""
    left = [text]
    return PoseLines(lambda: left.pop() if left else b"", ROBOT, RATE_HZ, lambda: UNIX_S)


# --- lines ---------------------------------------------------------------------------------------


def test_lines_become_frames_on_the_streams_clock() -> None:
    poses = lines_of(
        b"# t x y phi k1 k2\n\n"
        b"1699999999.9 0.1 -0.2 0.3 10 -20\r\n"
        b"1699999999.95,0.1,-0.2,0.3,11,-21\n"
        b"1699999999.99 0.1 -0"
    )
    times, q = poses.frames(50.0)
    np.testing.assert_allclose(times, [49.9, 49.95], atol=1e-6)
    np.testing.assert_allclose(q, [[0.1, -0.2, 0.3, 10, -20], [0.1, -0.2, 0.3, 11, -21]])
    assert (poses.taken, poses.refused) == (2, 0)
    times, q = poses.frames(51.0)
    assert (times.shape, q.shape) == ((0,), (0, 5))


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("1700000000 0 0 0 0", "5 numbers, not 6"),
        ("1700000000 0 0 0 0 0 0", "7 numbers, not 6"),
        ("1700000000 0 0 0 zero 0", "could not convert"),
        ("1700000000 0 nan 0 0 0", "not all numbers are finite"),
        ("1700000000 0 0 0 inf 0", "not all numbers are finite"),
        ("nan 0 0 0 0 0", "not all numbers are finite"),
        ("1699999998.5 0 0 0 0 0", "taken 1.5 s ago; at most 1 s are of use"),
        ("1700000000.5 0 0 0 0 0", "taken -0.5 s ago"),
        ("0.25 0 0 0 0 0", "taken 1.7e[+]09 s ago"),
        ("1699999999.5 0 0 0 0 0", "not taken after the line before it"),
        ("1700000000 0 0 0 0 125", "a curvature beyond 118 1/m"),
        ("\xff\xfe\x00", "could not convert"),
    ],
)
def test_lines_that_cannot_be_trusted_are_refused(line: str, why: str) -> None:
    good = "1699999999.9 0 0 0 0 0\n"
    poses = lines_of((good + line + "\n").encode("latin-1"))
    times, q = poses.frames(0.0)
    assert len(times) == len(q) == 1
    assert (poses.taken, poses.refused) == (1, 1)
    with pytest.raises(ValueError, match=why):
        raise ValueError(poses.describe())


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        port: int = found.getsockname()[1]
        return port


def test_datagrams_are_lines() -> None:
    number = free_port()
    with (
        pose_lines(str(number), ROBOT, RATE_HZ) as poses,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tracker,
    ):
        for _ in range(2):
            tracker.sendto(b"%.6f 0.1 0 0 0 0" % time.time(), ("127.0.0.1", number))
            time.sleep(1e-3)
        times, q = poses.frames(3.0)
        assert len(times) == 2
        assert (np.abs(3.0 - times) < 0.5).all()
        np.testing.assert_allclose(q[:, 0], 0.1)
        with pytest.raises(InputError, match="a UDP port that can be opened"):
            pose_lines(str(number), ROBOT, RATE_HZ).__enter__()


@pytest.mark.parametrize("source", ["tracker", "0", "65536", "-1"])
def test_a_source_is_standard_input_or_a_port(source: str) -> None:
    with pytest.raises(InputError, match="standard input, or a UDP port from 1 to 65535"):
        pose_lines(source, ROBOT, RATE_HZ).__enter__()


# --- a robot that is seen ------------------------------------------------------------------------


class SeenByLines(SimulatedFirmware):
    """Firmware whose robot rolls as its wheels turn, and a tracking system that writes lines."""

    def __init__(self, plan: Plan, grip: float = 1.0) -> None:
        super().__init__(plan)
        self.q, self._robot, self._grip = plan.problem.start.configuration, plan.robot, grip
        self._next_s, self._lines = 0.0, b""
        self.spoil: Callable[[float, bytes], bytes] = lambda _time_s, line: line
        self.poses = PoseLines(self._written, plan.robot, RATE_HZ, lambda: UNIX_S + self.now_s())

    def sleep(self, duration_s: float) -> None:
        super().sleep(duration_s)
        if self.received and any(self.received[-1].wheel_rad_s):
            mode = tuple(int(segment.soft) for segment in self.segments)
            turned = self._grip * duration_s * np.array(self.received[-1].wheel_rad_s)
            self.q = rolling(self._robot, mode)(self.q, turned, NO_DRIFT).full().ravel()
        if self.now_s() >= self._next_s:
            self._next_s = self.now_s() + 1 / RATE_HZ
            numbers = " ".join(f"{value:.5f}" for value in self.q)
            line = f"{UNIX_S + self.now_s():.4f} {numbers}\n".encode()
            self._lines += self.spoil(self.now_s(), line)

    def _written(self) -> bytes:
        written, self._lines = self._lines, b""
        return written


def test_lines_of_poses_close_the_loop_and_bad_ones_among_them_change_nothing(
    tmp_path: Path,
) -> None:
    plan = planned("paper-2")
    firmware = SeenByLines(plan, grip=0.8)
    firmware.spoil = lambda t, line: line if int(10 * t) % 7 else line.replace(b"0", b"nan", 1)
    run = stream(plan, firmware.port, firmware, poses=firmware.poses, log=tmp_path / "r.json")
    assert run.ending is Ending.REACHED
    assert firmware.poses.refused > 100
    assert run.accuracy.of(plan.problem.goal.error(firmware.q.copy())) <= 1.0
    assert run.transitions == plan.cost.transitions
    assert {item.truly_soft for item in firmware.moves} <= {phase.mode for phase in plan.phases}
    assert_off(firmware)
    again = load_run(tmp_path / "r.json")
    assert (again.ending, again.reason, again.executor) == (run.ending, run.reason, "optimal")
    firmware.close()


@pytest.mark.parametrize("push", [(0.5, 0.0, 0.0), (0.0, 0.0, 2.0)])
def test_a_robot_that_is_not_where_the_plan_starts_is_not_driven(
    push: tuple[float, float, float],
) -> None:
    plan = planned("rigid-move")
    firmware = SeenByLines(plan)
    firmware.q = firmware.q + np.array([*push, 0.0, 0.0])
    with pytest.raises(StreamError, match="are poses in m and rad, and in the plan's frame"):
        stream(plan, firmware.port, firmware, poses=firmware.poses)
    assert not any(any(item.wheel_rad_s) for item in firmware.received)
    assert_off(firmware)
    firmware.close()


def test_the_line_is_not_silent_while_the_rest_is_planned_again() -> None:
    plan = planned("rigid-move")
    firmware = SeenByLines(plan)
    push = np.array([0.0, 0.15, 0.0, 0.0, 0.0])
    firmware.at[4.0] = lambda: setattr(firmware, "q", firmware.q + push)
    run = stream(plan, firmware.port, firmware, poses=firmware.poses)
    assert run.ending is Ending.REACHED
    assert run.corrections >= 1
    times = [item.time_s for item in firmware.received]
    assert max(np.diff(times)) <= 1.3
    firmware.close()


BLIND: dict[str, Callable[[bytes], bytes]] = {
    "nothing": lambda line: b"",
    "nan": lambda line: line[:16] + b"nan nan nan nan nan\n",
    "garbled": lambda line: line[:9] + b"\x00" + line[10:],
    "late": lambda line: b"%.4f" % (float(line[:15]) - 2 * LATEST_S) + line[15:],
}


@pytest.mark.parametrize("kind", BLIND)
def test_lines_that_turn_bad_stop_the_robot(kind: str) -> None:
    plan = planned("rigid-move")
    firmware = SeenByLines(plan)
    firmware.spoil = lambda t, line: line if t < 3.0 else BLIND[kind](line)
    run = stream(plan, firmware.port, firmware, poses=firmware.poses)
    assert run.ending is Ending.CAMERA_LOST
    assert "no camera frame for 4 s" in run.reason
    assert max(item.time_s for item in firmware.moves) < 3.0 + 0.6
    assert_off(firmware)
    firmware.close()


@pytest.mark.parametrize("kind", BLIND)
def test_a_robot_that_nothing_sees_at_first_is_an_error(kind: str) -> None:
    plan = planned("rigid-move")
    firmware = SeenByLines(plan)
    firmware.spoil = lambda _t, line: BLIND[kind](line)
    with pytest.raises(StreamError, match="no pose within 5 s: 0 lines of poses were taken"):
        stream(plan, firmware.port, firmware, poses=firmware.poses)
    assert not firmware.moves
    assert_off(firmware)
    firmware.close()


def test_a_camera_needs_reports() -> None:
    plan = planned("rigid-move")
    firmware = SeenByLines(plan)
    with pytest.raises(InputError, match="begins its phases by reports"):
        stream(plan, firmware.port, firmware, poses=firmware.poses, confirm=Confirm.NEVER)
    firmware.close()


# --- planning meanwhile --------------------------------------------------------------------------

PUSH = np.array([0.0, 0.15, 0.0, 0.0, 0.0])
PLANNER = "twosra_mpc.lab.serial.stream.plan_again"


def pushed(plan: Plan) -> SeenByLines:
    """A robot that is moved after 4 s, so that the rest has to be planned again."""
    firmware = SeenByLines(plan)
    firmware.at[4.0] = lambda: setattr(firmware, "q", firmware.q + PUSH)
    return firmware


def test_a_robot_is_told_to_stand_while_somebody_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    plan, enough = planned("rigid-move"), threading.Event()
    firmware = pushed(plan)
    firmware.at[16.0] = enough.set

    def slowly(problem: Problem) -> Result:
        assert enough.wait(60.0)
        return find_plan(problem)

    monkeypatch.setattr(PLANNER, slowly)
    run = stream(plan, firmware.port, firmware, poses=firmware.poses)
    assert run.reached
    assert run.corrections + run.replans >= 1
    times = [item.time_s for item in firmware.received]
    assert max(np.diff(times)) <= 1.3
    standing = (run.log.time_s > 8.0) & (run.log.time_s < 16.0)
    assert standing.sum() > 5
    assert not run.log.wheel_rad_s[standing].any()
    firmware.close()


def test_an_error_of_what_is_planned_comes_through() -> None:
    def fail(problem: Problem) -> Result:
        raise InputError("goal", 1, "another")

    think = ThinkAside(fail)
    with pytest.raises(InputError, match="goal = 1"):
        list(iter(lambda: think(load_problem("rigid-move")), Result))


def test_an_interrupt_does_not_wait_for_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    plan, never = planned("rigid-move"), threading.Event()
    firmware = pushed(plan)
    firmware.at[16.0] = lambda: os.kill(os.getpid(), signal.SIGINT)
    monkeypatch.setattr(PLANNER, lambda problem: never.wait())
    with pytest.raises(KeyboardInterrupt):
        stream(plan, firmware.port, firmware, poses=firmware.poses)
    never.set()
    assert firmware.now_s() < 18.0
    assert_off(firmware)
    firmware.close()


@pytest.mark.parametrize("part", ["read", "send", "wait", "plan_again"])
def test_whatever_raises_the_last_command_is_a_stop(
    monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    plan = planned("rigid-move")
    firmware = pushed(plan)

    def broken(*given: object) -> object:
        if part == "plan_again" or firmware.now_s() > 4.0:
            raise ZeroDivisionError(part)
        return whole(*given)

    if part == "plan_again":
        monkeypatch.setattr(PLANNER, broken)
    else:
        whole = getattr(SerialRobot, part)
        monkeypatch.setattr(SerialRobot, part, broken)
    with pytest.raises(ZeroDivisionError, match=part):
        stream(plan, firmware.port, firmware, poses=firmware.poses)
    assert firmware.moves
    assert_off(firmware)
    firmware.close()


def test_a_stop_that_fails_in_an_unknown_way_is_tried_again() -> None:
    plan = planned("rigid-move")
    firmware = SimulatedFirmware(plan)
    write, tries = firmware.port.write, list[bytes]()

    def fails_once(data: bytes) -> None:
        if data == stop_command(2) and firmware.moves:
            tries.append(data)
            if len(tries) == 2:  # the first is the end of the plan
                raise RuntimeError("what is this")
        write(data)

    firmware.port.write = fails_once  # type: ignore[method-assign]
    stream(plan, firmware.port, firmware)
    firmware.receive()
    assert not any(firmware.received[-1].wheel_rad_s)
    firmware.close()


# --- logs ----------------------------------------------------------------------------------------


def test_a_log_is_the_run_is_on_the_disk_under_way_and_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, path, found = planned("paper-2"), tmp_path / "run.json", list[float]()
    firmware = SimulatedFirmware(plan)
    monkeypatch.setattr("twosra_mpc.lab.serial.stream.SAVED_EVERY_S", 60.0)
    clock = SimpleNamespace(monotonic=firmware.now_s)
    monkeypatch.setattr("twosra_mpc.lab.serial.stream.time", clock)
    written = RunFile.end

    def looked(file: RunFile, reason: str) -> None:
        written(file, reason)
        found.append(load_run(path).duration_s)

    monkeypatch.setattr(RunFile, "end", looked)
    run = stream(plan, firmware.port, firmware, rate_Hz=5.0, log=path)
    assert len(found) > 3
    assert max(np.diff([0.0, *found])) < 60.0 + 20.0  # no phase lasts longer than that
    assert run.duration_s > found[-1]
    again = load_run(path)
    assert again.to_dict() == run.to_dict()
    assert again.ending is Ending.LOGGED
    assert len(again.changes) == plan.cost.transitions
    log, sent = again.log, np.array([item.wheel_rad_s for item in firmware.moves])
    driven = ~np.isnan(log.mode[:, 0])
    np.testing.assert_allclose(log.wheel_rad_s[driven], sent, atol=5.001e-4)
    assert [tuple(mode) for mode in log.mode[driven]] == [
        move.truly_soft for move in firmware.moves
    ]
    assert np.isfinite(log.temperature_C).all()
    plot_run(again, path=tmp_path / "run.png")
    firmware.close()


ENDINGS: dict[str, tuple[Callable[[SimulatedFirmware], object], type[BaseException], str]] = {
    "interrupt": (lambda f: os.kill(os.getpid(), signal.SIGTERM), KeyboardInterrupt, "interrupted"),
    "dead line": (lambda f: f.die(), StreamError, "could NOT be told to stop"),
    "too hot": (
        lambda f: setattr(f, "reports", lambda t, j, T: b"%c90.0\n" % (65 + j)),
        StreamError,
        "segment 1: too hot",
    ),
}


@pytest.mark.parametrize("kind", ENDINGS)
def test_every_ending_leaves_a_log(tmp_path: Path, kind: str) -> None:
    happens, error, words = ENDINGS[kind]
    plan, path = planned("paper-2"), tmp_path / "run.json"
    firmware = SimulatedFirmware(plan)
    firmware.at[30.0] = lambda: happens(firmware)
    with pytest.raises(error):
        stream(plan, firmware.port, firmware, log=path)
    run = load_run(path)
    assert words in run.reason
    assert 28.0 < run.duration_s < 33.0
    assert run.log.wheel_rad_s.any()
    assert sum(run.begun) > 0
    firmware.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "twosra-plan"}, "format = "),
        ({"version": 7}, "format = "),
        ({"log": {}}, "values that fit together"),
        ({"ending": "somehow"}, "Ending = 'somehow'"),
        ({"plans": [{}]}, "plans.scenario"),
    ],
)
def test_a_file_that_is_no_run_is_refused(
    tmp_path: Path, change: dict[str, object], words: str
) -> None:
    plan, path = planned("rigid-move"), tmp_path / "run.json"
    firmware = SimulatedFirmware(plan)
    stream(plan, firmware.port, firmware, rate_Hz=5.0, log=path)
    firmware.close()
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(InputError, match=words):
        load_run(path)


# --- the program ---------------------------------------------------------------------------------


def test_the_program_follows_standard_input_and_logs(tmp_path: Path) -> None:
    result = solved("rigid-move")
    result.save(tmp_path / "plan.json")
    start = result.require().problem.start.configuration
    line, robot_end = os.openpty()
    asked = ["stream", str(tmp_path / "plan.json"), "--port", os.ttyname(robot_end)]
    asked += ["--camera", "-", "--log", str(tmp_path / "run.json")]
    program = subprocess.Popen(
        [sys.executable, "-m", "twosra_mpc", *asked], stdin=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert program.stdin is not None
    heard, still = b"", b"s0.000\n0.000\n0.000\n0.000\n"
    until_s = time.monotonic() + 60.0
    while heard.count(b"s") < 10 or heard.count(b"s") == heard.count(still):  # until it drives
        assert time.monotonic() < until_s, heard[-100:]
        program.stdin.write(
            b"%.6f " % time.time() + " ".join(f"{v:.5f}" for v in start).encode() + b"\n"
        )
        program.stdin.flush()
        os.write(line, b"A25.0\nB25.0\n")
        if select.select([line], [], [], 0.05)[0]:
            heard += os.read(line, 1024)
    program.send_signal(signal.SIGTSTP)
    while not heard.endswith(stop_command(2) * STOPS):
        assert select.select([line], [], [], 10.0)[0], heard[-100:]
        heard += os.read(line, 1024)
    _, err = program.communicate(timeout=20)
    assert program.returncode == 4
    assert b"interrupted; wheels and heaters are off" in err
    run = load_run(tmp_path / "run.json")
    assert "interrupted" in run.reason
    assert np.isfinite(run.log.measured[:, 0]).any()
    os.close(line)
    os.close(robot_end)


def test_a_camera_that_is_none_is_refused(run: Run, tmp_path: Path) -> None:
    solved("rigid-move").save(tmp_path / "plan.json")
    line, robot_end = os.openpty()
    at = ("stream", tmp_path / "plan.json", "--port", os.ttyname(robot_end))
    outcome = run(*at, "--camera", "x")
    assert (outcome.code, outcome.out) == (2, "")
    assert "camera = 'x' is not acceptable" in outcome.err
    outcome = run(*at, "--log", "run.csv")
    assert outcome.code == 2
    assert "a file ending in .json" in outcome.err
    os.close(line)
    os.close(robot_end)
