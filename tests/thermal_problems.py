"""Thermal problems the tests share: drawn robots, air and start, and histories of one sequence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from twosra_mpc import Goal, Problem, Robot, Start, load_robot
from twosra_mpc.planning.bounds.schedule import schedule
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode, ModeSequence, all_modes
from twosra_mpc.thermal.heating import TemperatureTrajectory
from twosra_mpc.timing import TemporalNetwork, Transition, transition_model
from twosra_mpc.timing.network import events_of
from twosra_mpc.timing.thermal import Thermal
from twosra_mpc.timing.transitions import own_transitions

V1, V2, ARC = (load_robot(name) for name in ("2sra-v1", "2sr-v2", "2sra-v1"))


def robot_of(robot: Robot, *lengths_m: float) -> Robot:
    """The arc robot, or one that melts and freezes as ``robot`` does, with segments so long."""
    geometry = {"segments": len(lengths_m), "segment_length_m": lengths_m}
    given = {"name": f"{robot.name}-{len(lengths_m)}", "path": ARC.path}
    return robot.with_values(**given, geometry=robot.geometry.with_values(**geometry))


UNEQUAL = robot_of(V1, 0.03, 0.04, 0.05)
MIXED = Robot(
    **{
        **dict(UNEQUAL),
        "name": "mixed",
        "segment": None,
        "segments": (V1.segment, V2.segment, V1.segment),
    }
)


def thermal_problem(robot: Robot = V1, **overrides: Any) -> Problem:
    """A problem whose motion does not matter; the state of the metal by the keys of a start."""
    keys, count = (
        ("temperature_C", "melt_fraction", "body_temperature_C"),
        robot.coordinates.segments,
    )
    metal, straight = {key: overrides.pop(key, None) for key in keys}, (0.0,) * count
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=straight, **metal)
    goal = {"kappa_per_m": (1.0,) * count, "mode": overrides.pop("last", robot.rigid)}
    given = {"robot": robot, "start": start, "goal": Goal(**goal), **overrides}
    return Problem(**given)


def thermal_model(problem: Problem) -> Thermal:
    """The problem's transition model."""
    model = transition_model(problem)
    assert isinstance(model, Thermal)
    return model


def metal(
    ambient_C: float, thresholds_C: tuple[float, float]
) -> st.SearchStrategy[tuple[float, float, float]]:
    """(temperature, melt fraction, temperature of the body): cold, changing, liquid or hot."""
    solid, liquid = thresholds_C
    cold = st.one_of(st.just(ambient_C), st.floats(0.0, solid), st.floats(solid - 5.0, solid))
    hot = st.one_of(st.floats(liquid, liquid + 5.0), st.floats(liquid + 5.0, 85.0))
    amid = st.one_of(st.just(0.5), st.floats(0.0, 1.0))
    core = st.one_of(
        cold.map(lambda now: (now, 0.0)),
        hot.map(lambda now: (now, 1.0)),
        amid.map(lambda share: (solid + share * (liquid - solid), share)),
    )
    return core.flatmap(
        lambda now: st.floats(0.0, max(now[0], solid)).map(lambda body: (*now, body))
    )


@st.composite
def thermal_problems(draw: st.DrawFn, robots: Sequence[Robot] = (V1, V2), **fixed: Any) -> Problem:
    """Either robot in cold to warm air, its metal in any state at the start."""
    robot = draw(st.sampled_from(robots))
    ambient = draw(st.sampled_from([1.0, robot.heater.ambient_C, 45.0]))
    rows = [draw(metal(ambient, span)) for span in thermal_problem(robot).segment_thresholds_C]
    nodes = [len(model.initial(ambient)) for model in thermal_problem(robot).segment_models]
    temperatures, fractions, bodies = zip(*rows, strict=True)
    if draw(st.booleans()):
        every = zip(bodies, temperatures, nodes, strict=True)
        fixed["body_temperature_C"] = [b if many > 1 else core for b, core, many in every]
    given = {
        "ambient_C": ambient,
        "temperature_C": temperatures,
        "melt_fraction": fractions,
        "transition_quantile": draw(st.sampled_from([None, None, 0.5, 0.8, 0.95])),
        "heating": draw(st.sampled_from(["fastest", "fastest", "keep_warm"])),
        "weights": {"energy_s_per_J": draw(st.sampled_from([0.0, 0.01, 0.2]))},
        "last": draw(st.sampled_from([robot.rigid] * 3 + list(robot.modes[1:]))),
    }
    return thermal_problem(robot, **{**given, **fixed})


REMELTS = [
    (SOFT_1, RIGID, SOFT_1),
    (RIGID, SOFT_2, RIGID, SOFT_2, RIGID),
    (RIGID, SOFT_1, SOFT_2, SOFT_1, RIGID),
    (SOFT_BOTH, SOFT_2, SOFT_BOTH, SOFT_1, RIGID, SOFT_BOTH),
]


def sequences(segments: int) -> st.SearchStrategy[ModeSequence]:
    """Mode sequences of up to six phases, none of which repeats the mode before it."""
    return st.lists(st.sampled_from(all_modes(segments)), min_size=1, max_size=6).map(
        lambda modes: tuple(m for i, m in enumerate(modes) if i == 0 or modes[i - 1] != m)
    )


SEQUENCES = st.one_of(st.sampled_from(REMELTS), sequences(2))
SPANS_S = st.lists(
    st.one_of(st.just(0.0), st.floats(0.0, 3.0), st.floats(0.0, 100.0), st.floats(0.0, 900.0)),
    min_size=34,
    max_size=34,
)  # waits in up to 7 gaps (before 3 onsets, before the start of the phase), up to 6 durations


class History(NamedTuple):
    """What really happened: when, and how each segment was heated."""

    network: TemporalNetwork
    times: list[float]
    trajectories: list[TemperatureTrajectory]

    @property
    def finish_s(self) -> float:
        """The end of the plan."""
        return self.times[self.network.layout.finish]

    @property
    def energy_J(self) -> float:
        """Heater energy of all segments."""
        return sum(one.energy_J(self.finish_s) for one in self.trajectories)

    def violated(self) -> list[str]:
        """What the network, its energy and its longest path say and the history does not keep."""
        found = []
        layout, times = self.network.layout, self.times
        for (u, v), least in self.network.least.items():
            if times[v] - times[u] < least - 1e-6:
                found.append(f"{u} to {v} takes {times[v] - times[u]} s, not {least} s")
        for since, until, share, least in self.network.delays:
            if times[until] - share * times[since] < least - 1e-6:
                found.append(f"{until} is no later than {times[until]} s after {since}")
        energy = self.network.melt_energy_J
        energy += sum(h.power_W * (times[h.until] - times[h.since]) for h in self.network.holds)
        if self.energy_J < energy - 1e-6:
            found.append(f"takes {self.energy_J} J, not {energy} J")
        earliest = earliest_finish(self.network)
        if times[layout.finish] < earliest - 1e-6:
            found.append(f"ends at {times[layout.finish]} s, before {earliest} s")
        return found


def earliest_finish(network: TemporalNetwork) -> float:
    """End of the plan if its phases took no time."""
    times = network.earliest
    assert times is not None
    return times[network.layout.finish]


def history(problem: Problem, sequence: ModeSequence, spans_s: Sequence[float]) -> History:
    """Let each segment melt and freeze as soon as it can after some waits.

    Only the trajectory of the segments decides what takes how long: the network is not asked.
    """
    model, last = thermal_model(problem), problem.goal.mode
    durations = list(spans_s[: len(sequence)])
    network = model.with_delays(model.network(sequence, last, durations), durations)
    layout, waits = network.layout, iter(spans_s[len(sequence) :])
    due = {(event.gap, event.segment): event for event in events_of(sequence, model.first, last)}
    times = [0.0] * layout.count
    count = len(model.first)
    onsets: list[list[tuple[Any, float]]] = [[] for _ in range(count)]
    for gap in range(len(sequence) + 1):
        ends = [times[layout.end(gap - 1)]]
        for segment in range(count):
            wait = next(waits)
            if (event := due.get((gap, segment))) is None:
                continue
            asked = [*onsets[segment], (event.to, ends[0] + wait)]
            soft, start = model.first[segment] == 1, problem.start_states[segment]
            made = model.plans[segment].heated(start, soft, asked)[1][-1]
            onsets[segment].append((event.to, made.onset_s))
            times[layout.onset(gap, segment)] = made.onset_s
            ends.append(made.done_s)
        times[layout.start(gap)] = max(ends) + next(waits)
        if gap < len(sequence):
            times[layout.end(gap)] = times[layout.start(gap)] + durations[gap]
    trajectories = [
        model.plans[j].heated(problem.start_states[j], model.first[j] == 1, onsets[j])[0]
        for j in range(count)
    ]
    return History(network, times, trajectories)


def settled(problem: Problem, sequence: ModeSequence, durations: Sequence[float]) -> History | None:
    """The cheapest schedule that the model settles; None if there is none."""
    model = thermal_model(problem)
    first = network = model.network(sequence, problem.goal.mode, durations)
    for _ in range(60):
        times = schedule(network, np.array(durations), problem.cost_weights)
        if times is None:
            return None
        raised = model.settle(network, times.tolist())
        if raised is None:
            made = transitions_of(problem, first, times)
            trajectories = [trajectory_of(problem, j, made) for j in range(len(model.first))]
            return History(first, times.tolist(), trajectories)
        network = raised
    raise AssertionError(f"not settled: {sequence}, {durations}")


def transitions_of(
    problem: Problem, network: TemporalNetwork, times: Sequence[float]
) -> list[Transition]:
    """Melts and freezes at these event times."""
    return transition_model(problem).transitions(network, [float(t) for t in times])


def trajectory_of(
    problem: Problem, segment: int, transitions: Sequence[Transition]
) -> TemperatureTrajectory:
    """How a segment (from 0) is heated."""
    return thermal_model(problem).segment_heating(segment, own_transitions(transitions, segment))


def phases_of(found: History) -> Iterator[tuple[Mode, float, float]]:
    """(mode, start, end) of every phase."""
    layout = found.network.layout
    for i, mode in enumerate(found.network.sequence):
        yield mode, found.times[layout.start(i)], found.times[layout.end(i)]
