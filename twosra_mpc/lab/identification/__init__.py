"""Thermal models from logged melts and freezes, and logs of motion replayed."""

from twosra_mpc.lab.identification.transition_fit import (
    LoggedTransition,
    TransitionFit,
    identify_transitions,
    read_transitions,
)

__all__ = ["LoggedTransition", "TransitionFit", "identify_transitions", "read_transitions"]
