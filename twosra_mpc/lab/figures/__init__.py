"""Figures of measurements, studies and the paper: what `plotting` draws plans with, used."""

import twosra_mpc.plotting  # noqa: F401  # before matplotlib, which speaks when it is imported
from twosra_mpc import exported

__getattr__, __dir__, __all__ = exported(__name__)
