"""Studio: a problem held in the hand, on a local page that plans while it is moved."""

from twosra_mpc.studio.server import Server, widget

__all__ = ["Server", "widget"]
