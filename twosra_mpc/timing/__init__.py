"""Transition timing: the events of a mode sequence, and how far apart they must be."""

from twosra_mpc.timing.choice import transition_model
from twosra_mpc.timing.network import EventLayout, TemporalNetwork, earliest_times, latest_times
from twosra_mpc.timing.transitions import Transition, TransitionModel

__all__ = [
    "EventLayout",
    "TemporalNetwork",
    "Transition",
    "TransitionModel",
    "earliest_times",
    "latest_times",
    "transition_model",
]
