"""Writing figures: which endings there are, and saving atomically."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from twosra_mpc.errors import InputError
from twosra_mpc.files import atomic_path


def check_figure_path(path: str | Path) -> None:
    """Check that matplotlib can write a file of this ending.

    Raises:
        InputError: If it cannot; the message lists the endings it knows.
    """
    endings = sorted(FigureCanvasAgg(Figure()).get_supported_filetypes())
    if Path(path).suffix[1:].lower() not in endings:
        raise InputError("output", str(path), f"a file ending in .{', .'.join(endings)}")


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure atomically, in the format that the ending of ``path`` names.

    Raises:
        InputError: If the ending is unknown, or the folder cannot be written.
    """
    check_figure_path(path)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=figure.dpi)
