"""Figures and their files: one style, which endings there are, saving atomically."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from twosra_mpc.errors import InputError
from twosra_mpc.files import atomic_path
from twosra_mpc.plotting.style import DPI, STYLE


@contextmanager
def styled_figure(size_in: tuple[float, float], path: str | Path | None) -> Iterator[Figure]:
    """Yield an empty figure to draw on; at the end it is written to ``path``, if there is one.

    Args:
        size_in: Width and height [in].
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file (before anything is drawn), or the
            folder cannot be written.
    """
    if path is not None:
        check_figure_path(path)
    with rc_context(STYLE):
        figure = Figure(figsize=size_in, dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        for ax in figure.axes:
            ax.tick_params(labelsize=8.5)  # not from rcParams: ticks are made when drawn
        if path is not None:
            save_figure(figure, path)


def picture_address(figure: Figure, kind: Literal["png", "svg"]) -> str:
    """Return a figure as the address of a picture that is part of the address."""
    picture = io.BytesIO()
    figure.savefig(picture, format=kind, metadata={"Date": None} if kind == "svg" else None)
    data = base64.b64encode(picture.getvalue()).decode()
    return f"data:image/{'svg+xml' if kind == 'svg' else kind};base64,{data}"


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
