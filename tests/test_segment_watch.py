"""What is wrong with a segment is told by name, and nothing is wrong with one that is sound."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from twosra_mpc import load_problem, load_robot
from twosra_mpc.control.stiffness import stiffness_controller
from twosra_mpc.control.thermistor import follow
from twosra_mpc.execution.segment_watch import SegmentError, SegmentWatch
from twosra_mpc.execution.settings import Patience
from twosra_mpc.execution.simulation.disturbance import Disturbance
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.robot.description import segment_model

ROBOT = load_robot("2sra-v1")
SOFT_C, OFF_C, STEP_S = 65.0, 25.0, 1.0

Row = tuple[float, float, Any, bool]  # set-point, temperature, stiffness, faulty


def rows(
    setpoint_C: float, temperature_C: Callable[[float], float], stiffness: Any, until_s: float
) -> Iterator[Row]:
    for time_s in np.arange(0.0, until_s, STEP_S).tolist():
        yield setpoint_C, temperature_C(time_s), stiffness, False


def noise(time_s: float) -> float:
    """A sensor that lives shows something else each time."""
    return 0.02 * math.sin(7 * time_s)


def trouble(
    watched: Iterator[Row], *, reports: bool = True, start_C: float = 25.0
) -> tuple[str, float] | None:
    """Cause of the first trouble, and when."""
    watch = SegmentWatch(ROBOT, 25.0, 0, Patience(), reports=reports, start_C=start_C)
    for k, (setpoint_C, *known) in enumerate(watched):
        try:
            watch.take(k * STEP_S, setpoint_C, *known)
        except SegmentError as error:
            return error.cause, k * STEP_S
    return None


CASES: list[tuple[str, Iterator[Row], str, float]] = [
    ("-127", rows(SOFT_C, lambda t: 30 + t if t < 9 else -127.0, "rigid", 60), "sensor", 15),
    ("NaN", rows(OFF_C, lambda t: math.nan, "rigid", 60), "sensor", 6),
    ("every 7 s", rows(OFF_C, lambda t: math.nan if t % 7 else 25.0, "rigid", 60), "sensor", 7),
    ("no stiffness", rows(OFF_C, lambda t: 25.0, None, 60), "sensor", 6),
    ("stays", rows(OFF_C, lambda t: 66.0, "soft", 2000), "sensor", 800),
    ("dead", rows(SOFT_C, lambda t: 25 + 0.01 * t, "rigid", 200), "heater", 40),
    ("hot", rows(SOFT_C, lambda t: 65 + t, "soft", 100), "hot", 22),
    ("welded", rows(OFF_C, lambda t: 40 + 0.5 * t, "changing", 200), "relay", 52),
    ("was hot", rows(OFF_C, lambda t: 89 - 5 * np.exp(-t / 5) - t / 20, "soft", 99), "cooling", 32),
    ("slow", rows(OFF_C, lambda t: 55 - 0.05 * t, "changing", 2000), "cooling", 100),
    ("weak", rows(SOFT_C, lambda t: 25 + 0.35 * t + noise(t), "changing", 2000), "sensor", 60),
    ("jump", rows(OFF_C, lambda t: 40 + noise(t) + 9 * (t > 20), "rigid", 60), "sensor", 30),
    ("drift", rows(OFF_C, lambda t: 25 - 0.5 * t + noise(t), "rigid", 60), "sensor", 30),
    ("shows too much", rows(SOFT_C, lambda t: 66.2 + noise(t), "soft", 99), "sensor", 60),
    ("latched", ((OFF_C, 40.0 - 0.01 * k, "changing", True) for k in range(2000)), "fault", 6),
]


@pytest.mark.parametrize(("name", "watched", "cause", "at_most_s"), CASES)
def test_each_trouble_has_its_name_and_comes_in_time(
    name: str, watched: Iterator[Row], cause: str, at_most_s: float
) -> None:
    found = trouble(watched, start_C={"hot": SOFT_C, "was hot": 84.0}.get(name, 25.0))
    assert found is not None, name
    assert found[0] == cause
    assert found[1] <= at_most_s


def test_a_missing_stiffness_is_not_called_a_silent_sensor() -> None:
    watch = SegmentWatch(ROBOT, 25.0, 0, Patience(), reports=True)
    watch.take(0.0, OFF_C, 25.0, None, False)
    with pytest.raises(SegmentError, match=r"sensor reads 25 C, but its stiffness is None .*soft"):
        watch.take(5.0, OFF_C, 25.0, None, False)


def test_single_readings_that_are_far_off_and_lags_are_no_trouble() -> None:
    odd = {7.0: -127.0, 20.0: 99.0, 50.0: math.nan, 60.0: 5.0, 80.0: 60.0}
    assert trouble(rows(OFF_C, lambda t: odd.get(t, 25.0), "rigid", 100)) is None
    assert trouble(rows(OFF_C, lambda t: math.nan, None, 100), reports=False) is None


@pytest.mark.parametrize(("setpoint_C", "asked"), [(SOFT_C, "soft"), (OFF_C, "rigid")])
def test_a_report_that_flickers_long_after_the_change_is_no_trouble(
    setpoint_C: float, asked: str
) -> None:
    """Times are those of a change, and begin when it does."""
    above_C = setpoint_C + 0.1  # which a switch at the set-point keeps
    flickers = (
        (setpoint_C, above_C + noise(k), "changing" if k == 1200 else asked, False)
        for k in range(1300)
    )
    assert trouble(flickers, start_C=setpoint_C) is None


def test_a_segment_that_froze_sooner_than_half_of_its_metal_can_is_not_believed() -> None:
    melt = rows(SOFT_C, lambda t: min(25 + t, 65.0) + noise(t), "soft", 160)
    falls = rows(OFF_C, lambda t: max(65 - 0.5 * t, 30.0) + noise(t), "rigid", 100)
    found = trouble(itertools.chain(melt, falls))
    assert found is not None
    assert found[0] == "sensor"
    assert found[1] < 195.0


def test_a_digital_sensor_without_noise_stands_still_while_metal_freezes() -> None:
    model, watch = (
        segment_model(ROBOT, 25.0, 0),
        SegmentWatch(ROBOT, 25.0, 0, Patience(), reports=True),
    )
    state, lag, seen = model.initial(25.0), (25.0, 25.0), set[float]()
    for k in range(400):
        shown_C, asked_C = round(2 * lag[1]) / 2, SOFT_C if k < 150 else OFF_C
        current_A = ROBOT.heater.melt_current_A * (shown_C < asked_C and asked_C > OFF_C)
        watch.take(float(k), asked_C, shown_C, "changing", False, current_A)
        seen |= {shown_C} if 250 <= k < 300 else set()
        before_C, state = model.temperature_C(state), model.propagate(state, current_A, 1.0)
        lag = follow(lag, (4.0, 4.0), before_C, model.temperature_C(state), 1.0)
    assert len(seen) == 1


def test_time_passes_for_a_simulated_robot_while_somebody_plans() -> None:
    problem = load_problem("rigid-move", robot=ROBOT.name)
    robot = SimulatedRobot(problem, "arc", Disturbance(unit_s=0.05))
    robot.send(np.ones(4), np.full(2, SOFT_C))
    before = robot.q.copy()
    while (made := robot.think(problem)) is None:
        robot.wait(0.1)
    assert robot.time_s == pytest.approx(0.05 * (made.stats.work or 0.0), abs=0.2)
    assert np.abs(robot.q - before).max() > 1e-3  # the last command was in force
    assert robot.segments[0].temperature_C > 26.0


@pytest.mark.parametrize("off_K", [0.0, 8.0])
def test_after_a_doubt_only_what_must_be_liquid_is_believed(off_K: float) -> None:
    """Metal that took the heat becomes soft; under a sensor that shows too much it never does."""
    model, believed = segment_model(ROBOT, 25.0, 0), dict[bool, float]()
    for doubted in (False, True):
        watch = SegmentWatch(ROBOT, 25.0, 0, Patience(), reports=True)
        watch.doubted, state, lag, k = doubted, model.initial(25.0), (25.0, 25.0), 0
        with contextlib.suppress(SegmentError):
            while k < 400 and doubted not in believed:
                shown_C, before_C = lag[1] + off_K + noise(k), model.temperature_C(state)
                current_A = ROBOT.heater.melt_current_A * (shown_C < SOFT_C)
                called: Any = (
                    "soft" if shown_C >= 63.5 else "rigid" if shown_C < 58.5 else "changing"
                )
                watch.take(float(k), SOFT_C, shown_C, called, False, current_A)
                if called == "soft" and watch.may_be_soft:
                    believed[doubted] = float(k)
                    assert not doubted or model.level(state) >= model.liquid_level
                state, k = model.propagate(state, current_A, 1.0), k + 1
                lag = follow(lag, (2.0, 2.0), before_C, model.temperature_C(state), 1.0)
        assert (doubted in believed) == (off_K == 0.0)
    assert not believed or believed[False] <= believed[True] < 200


def test_a_doubted_segment_melts_under_a_sensor_that_shows_too_much() -> None:
    """Its controller takes melting metal for liquid metal; asked for more, it goes on heating."""
    model, plain = segment_model(ROBOT, 25.0, 0), stiffness_controller(ROBOT, 25.0, 0)
    watch = SegmentWatch(ROBOT, 25.0, 0, Patience(), reports=True)
    watch.doubted = True
    took_s = []
    for controller, off_K in (
        (plain, 0.0),
        (plain, 2.4),
        (plain.holding(watch.allowed_C(SOFT_C)), 2.4),
    ):
        state, memory, step = model.initial(25.0), controller.start(25.0), 0
        while model.level(state) < model.liquid_level and step < 2000:
            state = model.propagate(state, memory.current_A, 0.2)
            shown_C = model.temperature_C(state) + off_K * (step > 100)
            memory = controller.step(memory, "soft", shown_C, 0.2)
            step += 1
        took_s.append(0.2 * step)
    sound_s, held_s, asked_s = took_s
    assert held_s > 1.5 * sound_s
    assert asked_s < 1.1 * sound_s
    assert watch.allowed_C(OFF_C) == OFF_C
