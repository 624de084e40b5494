"""Reports that are none, and signals, on a serial line: the robot is stopped, or never begins."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from functools import partial

import pytest
from once import planned
from simulated_firmware import SimulatedFirmware

from twosra_mpc.interrupts import deferred_interrupts
from twosra_mpc.lab.serial.stream import Confirm, StreamError, stream

Reports = Callable[[float, int, float], bytes]

UNREADABLE: dict[str, Reports] = {
    "-127": lambda _t, j, _T: b"%c-127.00\n" % (65 + j),
    "NaN": lambda _t, j, _T: b"%cnan\n" % (65 + j),
    "garbage": lambda _t, j, _T: b"%c\xff\x07x\n" % (65 + j),
}


@pytest.mark.parametrize("kind", UNREADABLE)
@pytest.mark.parametrize("confirm", list(Confirm))
def test_reports_that_nobody_can_read_are_not_heated_by_trust(kind: str, confirm: Confirm) -> None:
    plan = planned("paper-2", transition_quantile=0.9)
    firmware = SimulatedFirmware(plan, reports=UNREADABLE[kind], regulates=False)
    with pytest.raises(StreamError, match="segment 1: nobody can read the temperatures"):
        stream(plan, firmware.port, firmware, confirm=confirm)
    firmware.receive()
    assert firmware.now_s() < 7.0
    assert not any(firmware.received[-1].heated)
    assert firmware.hottest_C < 35.0


def test_a_report_every_seven_seconds_is_not_none() -> None:
    plan = planned("paper-2", transition_quantile=0.9)

    def rare(time_s: float, segment: int, temperature_C: float) -> bytes:
        told = time_s > 5.0 and time_s % 7.0 < 0.5
        return b"%c%.2f\n" % (65 + segment, temperature_C) if told else b""

    firmware = SimulatedFirmware(plan, reports=rare, regulates=False)
    with pytest.raises(StreamError, match=r"it reports .* C, but is heated by its model"):
        stream(plan, firmware.port, firmware, confirm=Confirm.NEVER)
    firmware.receive()
    assert firmware.now_s() < 10.0
    assert not any(firmware.received[-1].heated)


def catchable() -> list[signal.Signals]:
    """Signals that would end or suspend this program, by which a test can be sent one."""
    left_alone = ("KILL", "STOP", "SEGV", "BUS", "FPE", "ILL", "ABRT", "CHLD", "CONT", "URG")
    left_alone += ("WINCH", "INFO", "PIPE", "XFSZ")
    names = [item for item in signal.Signals if item.name[3:] not in left_alone]
    return [item for item in names if signal.getsignal(item) is not signal.SIG_IGN]


def test_every_signal_that_can_be_caught_stops_the_robot_first() -> None:
    plan = planned("rigid-move")
    assert {signal.SIGTSTP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGALRM} <= {*catchable()}
    for number in catchable():
        before, firmware = signal.getsignal(number), SimulatedFirmware(plan)
        firmware.at[2.0] = partial(os.kill, os.getpid(), number)
        with pytest.raises(KeyboardInterrupt):
            stream(plan, firmware.port, firmware)
        firmware.receive()
        assert firmware.now_s() < 3.0
        assert firmware.moves
        assert not any(any(item.wheel_rad_s) for item in firmware.received[-5:])
        assert signal.getsignal(number) == before


def test_somebody_elses_handler_is_left_alone() -> None:
    before = signal.signal(signal.SIGUSR1, lambda *_: None)
    try:
        mine = signal.getsignal(signal.SIGUSR1)
        with deferred_interrupts() as interrupts:
            assert signal.getsignal(signal.SIGUSR1) is mine
            assert signal.getsignal(signal.SIGUSR2) == interrupts.request
    finally:
        signal.signal(signal.SIGUSR1, before)
