"""Figures and animations: the only part of the package that knows matplotlib.

``plot_...`` makes a figure and may write it to a file; ``draw_...`` draws on axes that are given to
it and returns them; ``animate_...`` makes a film that a notebook shows. Nothing here needs a
display or changes ``rcParams``.
"""

import logging

from twosra_mpc import exported

# Matplotlib's advice is for those who set up logging; else it would stand on standard error.
logging.getLogger("matplotlib").addHandler(logging.NullHandler())

__getattr__, __dir__, __all__ = exported(__name__)
