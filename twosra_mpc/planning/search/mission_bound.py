"""Proved lower bounds on the cost of a mission whose mode sequence is known.

The relaxation of ``bounds`` over all stages together: the bends up to the end of each stage lead
into what its goal allows, and all drives of a stage together take what its ends are apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from twosra_mpc.planning.search.bends import Intervals
from twosra_mpc.planning.search.bounds import Relaxation, SequenceBound
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, is_rigid
from twosra_mpc.timing import TemporalNetwork


@dataclass(frozen=True, eq=False)
class MissionRelaxation:
    """How far and how fast the bending coordinates may go.

    Attributes:
        room: (low, high) of each segment: change of W since t = 0 that curvature limits allow.
        rate: Mode -> upper bound of abs(dW/dt), for every shape.
    """

    room: Intervals
    rate: Callable[[Mode], float]


def mission_bound(
    network: TemporalNetwork,
    relaxation: MissionRelaxation,
    weights: Weights,
    least_durations: Sequence[float],
    ends: Sequence[tuple[int, Intervals]],
    drives_s: Sequence[float],
) -> SequenceBound | None:
    """Solve the relaxation of a mission; None if it is infeasible.

    Args:
        network: Of all phases.
        relaxation: Room and rates of the bending coordinates.
        weights: Weights of the cost.
        least_durations: Of the phases [s].
        ends: Number of phases up to the end of each stage, and (low, high) of every segment's
            change of W there.
        drives_s: Least duration of all drives of each stage together.
    """
    sequence, layout = network.sequence, network.layout
    rates = [relaxation.rate(mode) if any(mode) else 0.0 for mode in sequence]
    program = Relaxation(network, weights, least_durations, rates)
    for j, room in enumerate(relaxation.room):
        stops = dict(ends)
        bends: dict[int, float] = {}
        for i, mode in enumerate(sequence):
            if mode[j]:
                bends[layout.count + i] = 1.0
            allowed = [room] if mode[j] else []
            allowed += [stops[i + 1][j]] if i + 1 in stops else []
            for low, high in allowed:
                if not bends and not low <= 0.0 <= high:
                    return None
                program.at_least(bends, low)
                program.at_least(dict.fromkeys(bends, -1.0), -high)
    begin = 0
    for (end, _), least in zip(ends, drives_s, strict=True):
        drives: dict[int, float] = {}
        for i in range(begin, end):
            if is_rigid(sequence[i]):
                drives |= {layout.end(i): 1.0, layout.start(i): -1.0}
        if least > 0.0 and drives:
            program.at_least(drives, least)
        begin = end
    return program.optimum()
