"""Tracking a plan: linear time-varying model predictive control, one phase at a time."""

from twosra_mpc.execution.tracking.setup import SolverSettings, TrackerLimits, TrackerWeights
from twosra_mpc.execution.tracking.tracker import Command, CommandStatus, Measurement, Tracker

__all__ = [
    "Command",
    "CommandStatus",
    "Measurement",
    "SolverSettings",
    "Tracker",
    "TrackerLimits",
    "TrackerWeights",
]
