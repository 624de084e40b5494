"""A plan on real hardware, over a serial line, in the line format of the authors' firmware."""

from twosra_mpc import exported

__getattr__, __dir__, __all__ = exported(__name__)
