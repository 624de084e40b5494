"""Running plans: on anything that can be read and driven, first of all on a simulated robot."""

from twosra_mpc import exported

__getattr__, __dir__, __all__ = exported(__name__)
