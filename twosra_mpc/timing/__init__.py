"""Transition timing: the events of a mode sequence, and how far apart they must be."""

from twosra_mpc.timing import overlapped, sequential, thermal  # noqa: F401  # they register
from twosra_mpc.timing.network import (
    EventLayout,
    TemporalNetwork,
    earliest_times,
    latest_times,
    resting_s,
)
from twosra_mpc.timing.transitions import (
    SegmentHeating,
    Transition,
    TransitionModel,
    model_of,
    transition_model,
)

__all__ = [
    "EventLayout",
    "SegmentHeating",
    "TemporalNetwork",
    "Transition",
    "TransitionModel",
    "earliest_times",
    "latest_times",
    "model_of",
    "resting_s",
    "transition_model",
]
