"""A timing and a segment model that the package does not know: defined here, used everywhere."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest
from heater_loop import simulate_heater
from thermal_problems import V1

from twosra_mpc import InputError, Problem, Robot, Status, check_plan, plan
from twosra_mpc.control.stiffness import stiffness_controller
from twosra_mpc.control.thermistor import temperature_sensor
from twosra_mpc.problem.tolerances import TIME_TOLERANCE_S
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import Mode, ModeSequence
from twosra_mpc.robot.segment import Heater, LumpedSegment, Segment
from twosra_mpc.robot.timing import Timing
from twosra_mpc.thermal.lumped import Lumped, State
from twosra_mpc.timing import EventLayout, TemporalNetwork, Transition, TransitionModel, model_of
from twosra_mpc.timing.constant_heating import ConstantHeating
from twosra_mpc.validation import Positive

MOVE: dict[str, Any] = {
    "start": {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)},
    "goal": {"kappa_per_m": (12.0, 0.0)},
}


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test defines, the next one does not know."""
    for family in (Segment, Timing):
        monkeypatch.setattr(family, "kinds", dict(family.kinds))


# --- a segment with a fan ------------------------------------------------------------------------


@dataclass(frozen=True)
class FanCooled(Lumped):
    """A fan blows while there is no current, and takes ``fan`` times as much heat away."""

    fan: float

    def _blown(self, current_A: float) -> Lumped:
        values = {name: value for name, value in vars(self).items() if name != "fan"}
        loss = self.loss_W_per_K * (self.fan if current_A == 0.0 else 1.0)
        return Lumped(**{**values, "loss_W_per_K": loss})

    def propagate(self, state: State, current_A: float, duration_s: float) -> State:
        return self._blown(current_A).propagate(state, current_A, duration_s)

    def time_until(self, state: State, current_A: float, level: float) -> float:
        return self._blown(current_A).time_until(state, current_A, level)


def robot_with_a_fan() -> Robot:
    class FanSegment(LumpedSegment):
        model: Literal["fan"]  # type: ignore[assignment]  # a kind of its own
        fan: Positive

        def thermal_model(self, length_m: float, heater: Heater, ambient_C: float) -> FanCooled:
            still = super().thermal_model(length_m, heater, ambient_C)
            return FanCooled(**vars(still), fan=self.fan)

    document = V1.model_dump(mode="json")
    document["segment"] |= {"model": "fan", "fan": 4.0}
    return Robot(**{**document, "name": "with a fan"})


def test_a_new_segment_model_plans_is_checked_and_controlled(tmp_path: Path) -> None:
    robot = robot_with_a_fan()
    still = plan(Problem(robot=V1, **MOVE)).require()
    problem = Problem(robot=robot, **MOVE, transition_quantile=0.8)
    result = plan(Problem(robot=robot, **MOVE))
    found = result.require()
    assert found.status is Status.OPTIMAL
    freezes = [
        next(t.done_s - t.heater_s for t in each.transitions if t.to == "rigid")
        for each in (still, found)
    ]
    assert freezes[1] == pytest.approx(freezes[0] / 4.0, rel=0.05)
    path = tmp_path / "plan.json"
    result.save(path)
    assert check_plan(path).ok
    assert plan(problem).require().cost.total > found.cost.total
    model, sensor = segment_model(robot, 25.0, 0), temperature_sensor(robot, 25.0, 0)
    controller = stiffness_controller(robot, 25.0, 0)
    run = simulate_heater(model, sensor, controller, [(0.0, "soft"), (120.0, "rigid")], 300.0)
    assert {"soft", "rigid"} <= set(run.stiffness.tolist())


# --- a timing that pauses ------------------------------------------------------------------------


def robot_that_pauses(pause_s: float) -> Robot:
    class PauseTiming(Timing):
        overlap: Literal["pause"]
        pause_s: Positive

    @model_of.register(PauseTiming)
    @dataclass(frozen=True)
    class Pausing(TransitionModel):
        """Whatever changes takes one pause, and nothing moves meanwhile."""

        times: PauseTiming

        @property
        def words(self) -> str:
            return "a pause for every change of mode"

        def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
            return None

        def _changes(self, sequence: ModeSequence, last: Mode) -> Iterator[tuple[int, Mode, Mode]]:
            modes = zip((self.first, *sequence), (*sequence, last), strict=True)
            yield from ((g, old, new) for g, (old, new) in enumerate(modes) if old != new)

        def network(
            self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
        ) -> TemporalNetwork:
            layout = EventLayout(len(sequence), len(last))
            least, count = layout.phase_order(), 0
            for gap, before, after in self._changes(sequence, last):
                least[layout.end(gap - 1), layout.start(gap)] = self.times.pause_s
                count += sum(old != new for old, new in zip(before, after, strict=True))
            return TemporalNetwork(sequence, last, least, count, 0.0)

        def settle(
            self, network: TemporalNetwork, times: Sequence[float]
        ) -> TemporalNetwork | None:
            return None

        def made(self, network: TemporalNetwork, times: Sequence[float]) -> Iterator[Transition]:
            for gap, before, after in self._changes(network.sequence, network.last):
                begin = times[network.layout.end(gap - 1)]
                yield from (
                    Transition(j + 1, "soft" if after[j] else "rigid", begin, begin, begin + span)
                    for j, span in enumerate([self.times.pause_s] * len(after))
                    if before[j] != after[j]
                )

        def segment_heating(self, segment: int, own: tuple[Transition, ...]) -> ConstantHeating:
            soft, now = bool(self.first[segment]), self.problem.temperatures[segment]
            heater, air = self.problem.robot.heater, self.problem.ambient
            return ConstantHeating(soft, own, heater, air, now)

        def violations(
            self, item: Transition, before: Transition | None, others: Sequence[Transition]
        ) -> Iterator[str]:
            if item.done_s - item.heater_s < self.times.pause_s - TIME_TOLERANCE_S:
                yield "pauses too short a time"

    document = V1.model_dump(mode="json")
    document["timing"]["pauses"] = {"overlap": "pause", "pause_s": pause_s}
    return Robot(**{**document, "name": "with pauses"})


def test_a_new_timing_plans_and_is_checked(tmp_path: Path) -> None:
    problem = Problem(robot=robot_that_pauses(70.0), **MOVE, timing="pauses", motion="fastest")
    result = plan(problem)
    found = result.require()
    assert found.status is Status.OPTIMAL
    assert [item.to for item in found.transitions] == ["soft", "rigid"]
    assert 140.0 < found.cost.total < 145.0
    path = tmp_path / "plan.json"
    result.save(path)
    assert check_plan(path).ok


def test_the_checks_of_a_new_timing_are_asked(tmp_path: Path) -> None:
    document = plan(Problem(robot=robot_that_pauses(60.0), **MOVE, timing="pauses")).to_dict()
    document["robot"]["timing"]["pauses"]["pause_s"] = 70.0
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    broken = check_plan(path).problems
    assert any("pauses too short a time" in text for text in broken)


# --- what is not known ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "tag", "allowed"),
    [
        ("segment.model", "fan", "lumped, two_node"),
        ("timing.nominal.overlap", "pause", "full, none, thermal"),
        ("path.model", "line", "arc, cardioid"),
    ],
)
def test_a_kind_that_nobody_defined_is_refused_by_name(field: str, tag: str, allowed: str) -> None:
    document: dict[str, Any] = V1.model_dump(mode="json")
    table, *keys, last = field.split(".")
    inner = document[table]
    for key in keys:
        inner = inner[key]
    inner[last] = tag
    with pytest.raises(InputError) as caught:
        Robot(**document)
    assert caught.value.field == field
    assert caught.value.value == tag
    assert allowed in caught.value.allowed
    del inner[last]
    with pytest.raises(InputError) as caught:
        Robot(**document)
    assert (caught.value.field, caught.value.value) == (field, "missing")
