"""Matplotlib's advice is for those who set up logging; else it would stand on standard error."""

import logging

logging.getLogger("matplotlib").addHandler(logging.NullHandler())
