"""``twosra stream``: what it prints, what it refuses, and that a killed program stops the robot."""

from __future__ import annotations

import functools
import json
import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conftest import Run
from once import planned, solved
from test_forged_plans import as_file, kept_warm

from twosra_mpc.execution.settings import Patience
from twosra_mpc.installation import install_command
from twosra_mpc.lab.serial import port as port_module
from twosra_mpc.lab.serial.port import (
    PortError,
    Report,
    SerialPort,
    command,
    parse_report,
    stop_command,
)
from twosra_mpc.lab.serial.robot import STOPS
from twosra_mpc.lab.serial.stream import stream

STOP = stop_command(2)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan file."""
    path = tmp_path_factory.mktemp("stream") / "plan.json"
    solved("paper-2", transition_quantile=0.9).save(path)
    return path


class Terminal(NamedTuple):
    """A pseudo-terminal: our end, and the name of the other."""

    ours: int
    name: str

    def read_until(self, heard: bytes, enough: Callable[[bytes], bool]) -> bytes:
        """Go on reading after what was heard until it is enough."""
        while not enough(heard):
            assert select.select([self.ours], [], [], 30.0)[0], heard
            heard += os.read(self.ours, 1024)
        return heard


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    """A line on which a robot could be; nobody answers, and the test closes our end."""
    ours, theirs = os.openpty()
    yield Terminal(ours, os.ttyname(theirs))
    os.close(theirs)


UNREADABLE = Report(0, math.nan)

# --- lines ---------------------------------------------------------------------------------------


def test_a_command_is_written_as_the_firmware_reads_it() -> None:
    assert (
        command((1.23456, -0.0001, -10.0, 0.0), (1, 0)) == b"s1.235\n0.000\n-10.000\n0.000\n1\n0\n"
    )
    assert command((0.0, 0.0, 0.0, 0.0), (0, 1), 7) == b"s0.000\n0.000\n0.000\n0.000\n0\n1\n7\n"
    assert STOP == b"s0.000\n0.000\n0.000\n0.000\n0\n0\n"
    assert command((1.0, 0.0, 0.0, 0.0), (0, 1, 1), 7).endswith(b"0.000\n0\n1\n1\n7\n")
    assert stop_command(4).count(b"\n") == 8


@pytest.mark.parametrize(
    ("line", "report"),
    [
        (b"A58.25", Report(0, 58.25)),
        (b"B24.9\r", Report(1, 24.9)),
        (b" B-3 ", Report(1, -3.0)),
        (b"C24.9", None),
        (b"58.25", None),
        (b"A", UNREADABLE),
        (b"", None),
        (b"Anan", UNREADABLE),
        (b"Ainf", UNREADABLE),
        (b"A-127.00", UNREADABLE),
        (b"A126", UNREADABLE),
        (b"B\xff4", Report(1, math.nan)),
        (b"Booting firmware 1.2", None),
    ],
)
def test_reports_are_read_and_other_lines_are_not(line: bytes, report: Report | None) -> None:
    assert parse_report(line, 2) == report


def test_as_many_segments_report_as_there_are() -> None:
    heard = [[parse_report(line, n) for line in (b"A20", b"B30", b"C40", b"D50")] for n in (1, 4)]
    assert heard[0] == [Report(0, 20.0), None, None, None]
    assert heard[1] == [Report(j, 20.0 + 10 * j) for j in range(4)]


def test_lines_arrive_whole_however_they_are_cut(terminal: Terminal) -> None:
    port = port_module.open_serial_port(terminal.name)
    lines: list[bytes] = []
    for piece in (b"A2", b"4.5\nB25.", b"5\nA2", b"6\n\n"):
        os.write(terminal.ours, piece)
        deadline = time.monotonic() + 5
        while not port._serial.in_waiting:
            assert time.monotonic() < deadline
        lines += port.read_lines()
    assert lines == [b"A24.5", b"B25.5", b"A26", b""]
    os.close(terminal.ours)
    with pytest.raises(PortError, match=f"cannot read from {terminal.name}"):
        port.read_lines()
    with pytest.raises(PortError, match=f"cannot write to {terminal.name}"):
        port.write(STOP)
    port.close()


# --- the program ---------------------------------------------------------------------------------


def test_a_dry_run_prints_times_and_lines(run: Run, saved: Path) -> None:
    plan = planned("paper-2", transition_quantile=0.9)
    outcome = run("stream", saved, "--dry-run", "--rate", "10")
    assert (outcome.code, outcome.err) == (0, "")
    words = outcome.out.split()
    times = np.array([float(word) for word in words[::2]])
    sent = [word.removeprefix("s").removesuffix("\\n").split("\\n") for word in words[1::2]]
    values = np.array(sent, dtype=float)
    assert values.shape[1] == 6
    travel = (values[:, :4] * np.minimum(np.diff(times, append=times[-1]), 1 / 10)[:, None]).sum(0)
    turned = plan.trajectory.wheel_travel_rad(plan.duration_s)[0]
    np.testing.assert_allclose(travel, turned, atol=2e-3 * plan.moving_s)
    assert (values[-STOPS:] == 0).all()
    listed = json.loads(run("stream", saved, "--dry-run", "--rate", "10", "--json").out)
    assert [item["line"].split() for item in listed] == [["s" + v[0], *v[1:]] for v in sent]
    assert abs(times[-STOPS] - plan.samples.t_s[-1]) < 0.2


def test_a_plan_is_sent_with_the_real_clock_and_sigterm_stops_the_robot(
    terminal: Terminal, saved: Path
) -> None:
    arguments = ["stream", str(saved), "--port", terminal.name, "--confirm", "never"]
    program = subprocess.Popen(
        [sys.executable, "-m", "twosra_mpc", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    heard = terminal.read_until(b"", lambda heard: heard.count(b"s") >= 10)
    assert heard.startswith(b"s")
    assert not heard.startswith(STOP)
    program.send_signal(signal.SIGTERM)
    terminal.read_until(heard, lambda heard: heard.endswith(STOP * STOPS))
    out, err = program.communicate(timeout=20)
    os.close(terminal.ours)
    assert (program.returncode, out) == (4, "")
    assert err.splitlines() == ["twosra: interrupted; wheels and heaters are off"]


def test_a_missing_answer_is_told_with_the_exit_code(
    run: Run, saved: Path, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    hasty = functools.partial(stream, patience=Patience(listen_s=0.2))
    monkeypatch.setattr("twosra_mpc.lab.commands.serial_commands.stream", hasty)
    outcome = run("stream", saved, "--port", terminal.name, "--confirm", "required")
    os.close(terminal.ours)
    assert (outcome.code, outcome.out) == (4, "")
    assert "before the plan began: no temperature report within 0.2 s" in outcome.err


def test_a_plan_that_keeps_a_segment_warm_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text(json.dumps(as_file(kept_warm())))
    outcome = run("stream", tmp_path / "p.json", "--dry-run")
    assert outcome.code == 2
    assert "the firmware can heat a segment or not, but not keep it warm" in outcome.err


def test_the_papers_wheel_map_is_refused_unless_it_is_accepted(run: Run, tmp_path: Path) -> None:
    solved("rigid-move", robot="2sra-v1-paper").save(tmp_path / "p.json")
    refused = run("stream", tmp_path / "p.json", "--dry-run")
    assert (refused.code, refused.out) == (2, "")
    for words in ("robot.path.model = 'log_spiral'", "a plan for 2sra-v1", "by 17 to 48 %"):
        assert words in refused.err
    accepted = run("stream", tmp_path / "p.json", "--dry-run", "--accept-paper-wheels")
    assert (accepted.code, accepted.err) == (0, "")


def test_without_pyserial_the_error_says_how_to_install_it(
    run: Run, saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    outcome = run("stream", saved, "--port", "/dev/ttyUSB0")
    assert outcome.code == 2
    assert install_command("serial") in outcome.err


def test_its_help_has_the_time_of_silence_and_how_to_install_what_it_needs(run: Run) -> None:
    _, told, _ = run("stream", "--help")
    assert f"within {Patience().listen_s:g} s" in " ".join(told.split())
    assert install_command("serial") in told


def test_a_port_is_closed_even_if_nothing_could_be_sent(
    run: Run, saved: Path, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[SerialPort] = []
    close = SerialPort.close

    def noted(port: SerialPort) -> None:
        closed.append(port)
        close(port)

    monkeypatch.setattr(SerialPort, "close", noted)
    monkeypatch.setattr(
        SerialPort, "write", lambda _self, _data: (_ for _ in ()).throw(PortError("cannot write"))
    )
    outcome = run("stream", saved, "--port", terminal.name)
    os.close(terminal.ours)
    assert outcome.code == 4
    assert "could NOT be told to stop: switch it off" in outcome.err
    assert len(closed) == 1
