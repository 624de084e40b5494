"""Tracking a plan: linear time-varying model predictive control, one phase at a time."""

from twosra_mpc import exported

__getattr__, __dir__, __all__ = exported(__name__)
