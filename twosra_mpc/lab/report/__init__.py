"""Reports: one self-contained HTML page about a plan, to read, to send and to plan again from."""

from twosra_mpc import exported

__getattr__, __dir__, __all__ = exported(__name__)
