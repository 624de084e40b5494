"""Studio: a problem held in the hand, on a local page that plans while it is moved."""

from twosra_mpc import exported

__getattr__, __dir__, __all__ = exported(__name__)
