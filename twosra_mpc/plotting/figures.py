"""Style of figures: colours, matplotlib's settings, files, and words that do not lie on others."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from matplotlib import rc_context, rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox, IdentityTransform
from numpy.typing import ArrayLike

from twosra_mpc.arguments import public
from twosra_mpc.files import ending_of, write_bytes

_FAR = np.arange(0.25, 5.1, 0.25)  # in heights of the words
_ROUND = np.pi / 2 + np.linspace(0.0, 2 * np.pi, 17)[:-1]
_STEPS = np.array(  # the least first
    [(0.0, 0.0), *((1.5 * far * np.cos(a), far * np.sin(a)) for far in _FAR for a in _ROUND)]
)


_MOST_SIGNS = 24  # of a user's words


def short(words: str) -> str:
    """A user's words, as far as a picture has room for them."""
    return words if len(words) <= _MOST_SIGNS else f"{words[: _MOST_SIGNS - 1].rstrip()}…"


class Label(Annotation):
    """Words in a picture that step aside where they would lie on others (`settle`)."""


def label(ax: Axes, words: str, at: ArrayLike, shift_pt: ArrayLike = (0, 0), **style: Any) -> Label:
    """Write words at a place of an axes, in data, that may step aside; not outside the axes."""
    x, y = np.asarray(at, float).tolist()
    away = cast(tuple[float, float], tuple(np.asarray(shift_pt, float).tolist()))
    made = Label(short(words), (x, y), away, textcoords="offset points", clip_on=True, **style)
    ax.add_artist(made)
    made.set_transform(IdentityTransform())
    return made


def settle(ax: Axes) -> None:
    """Move labels by as little as keeps them off other words, and lines that are above them."""
    words = [each for each in ax.texts if each.get_text() and ax.bbox.contains(*_anchor(ax, each))]
    taken = [_extent(each) for each in words if not isinstance(each, Label)]
    for each in (each for each in words if isinstance(each, Label)):
        box, level = _extent(each), each.get_zorder()
        above = [line.get_window_extent() for line in ax.lines if line.get_zorder() >= level]
        ways, full = (_STEPS * box.height).tolist(), [*taken, *above]
        free = (way for way in ways if not any(map(box.translated(*way).overlaps, full)))
        away = next(free, (0.0, 0.0))
        shift_pt = np.asarray(away) * 72 / ax.figure.dpi
        each.xyann = tuple((np.asarray(each.xyann) + shift_pt).tolist())
        taken.append(box.translated(*away))


def _anchor(ax: Axes, words: Text) -> tuple[float, float]:
    """Place of words in the picture [pixels]."""
    at = words.xy if isinstance(words, Annotation) else words.get_position()
    frame = ax.transData if isinstance(words, Annotation) else words.get_transform()
    x, y = frame.transform(at).tolist()
    return x, y


def _extent(words: Text) -> Bbox:
    """Room that words take in the picture [pixels], with the frame around them."""
    return (words.get_bbox_patch() or words).get_window_extent()


RIGID_COLOUR = "#2a6fbb"
SOFT_COLOUR = "#c8202f"
CHANGING_COLOUR = "#f6b04e"  # while melting
FREEZING_COLOUR = "#86c5da"
SEGMENT_COLOURS = ("#222222", "#12997c", "#7b5ea7", "#e07b00")
UNIT_COLOURS = SEGMENT_COLOURS[:2]
MIDDLE_COLOUR = "#e07b00"  # path of the middle link
UNIT_COLOUR, METAL_COLOUR, HEATER_COLOUR = "#eceff1", "#455a64", "#262626"
OBSTACLE_COLOUR, OBSTACLE_EDGE_COLOUR = "#d9d9d9", "#737373"
TASK_COLOUR, NEAREST_COLOUR = "#12997c", "#e6007e"
OBJECT_COLOURS = ("#d8b384", "#c3a5dd", "#8ccfd6", "#e9a9c0")
STAGE_COLOUR = "0.15"  # where and when a task of a mission is done
PLANNED_COLOUR = "0.35"  # what shall be: goals, references
PALETTE = (
    *(RIGID_COLOUR, SOFT_COLOUR, CHANGING_COLOUR, FREEZING_COLOUR, *SEGMENT_COLOURS),
    *(UNIT_COLOUR, METAL_COLOUR, HEATER_COLOUR, TASK_COLOUR, NEAREST_COLOUR),
    *OBJECT_COLOURS,
)
FAINT = 0.33  # opacity of a pose that is left behind
DPI = 160  # of figures: a page's width in 1600 pixels

# All settings that matplotlib has: nothing is taken of a user's own but where ffmpeg is.
STYLE: dict[Any, Any] = dict(rc_params_from_file(Path(__file__).with_suffix(".mplstyle")))
del STYLE["animation.ffmpeg_path"]
BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
BEHIND_WORDS: dict[str, Any] = {"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.6}
BARE: dict[str, Any] = {"xticks": (), "yticks": ()}  # axes that show a place, not a quantity
_HATCHED = {"ec": "white", "lw": 0}
STATES: dict[str, dict[str, Any]] = {
    "rigid": {"fc": RIGID_COLOUR, "lw": 0},
    "melting": _HATCHED | {"fc": CHANGING_COLOUR, "hatch": "////"},
    "soft": {"fc": SOFT_COLOUR, "lw": 0},
    "freezing": _HATCHED | {"fc": FREEZING_COLOUR, "hatch": r"\\\\"},
    "heater current": {"fc": HEATER_COLOUR, "lw": 0},
}


_THINNER = 0.75  # is each curve than the one that it may lie over
_DASHES = {"--": 0.28, ":": 0.12}  # width of those, of that of their curve; dots lie over dashes


def curve(number: int, dashes: str = "-") -> dict[str, Any]:
    """Look of one of several curves, counted from 0 and drawn in this order.

    Each is thinner than those that it may lie over, and dashes have white gaps: where curves are
    equal, all of them are seen.
    """
    width = 3.4 * _THINNER**number
    if dashes == "-":
        return {"lw": width, "zorder": 2.0}
    thin = _DASHES[dashes]
    return {"lw": thin * width, "ls": dashes, "gapcolor": "white", "zorder": 2.5 - thin}


def segment_curve(segment: int, dashes: str = "-") -> dict[str, Any]:
    """Look of the curve of a segment (from 0), as `curve`."""
    return {"color": SEGMENT_COLOURS[segment], **curve(segment, dashes)}


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
        if figure.findobj(Label):
            figure.draw_without_rendering()  # its layout
            for ax in figure.axes:
                settle(ax)
        if path is not None:
            save_figure(figure, path)


def picture_address(figure: Figure, kind: Literal["png", "svg"]) -> str:
    """Return a figure as the address of a picture that is part of the address."""
    picture = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(picture, format=kind, metadata={"Date": None} if kind == "svg" else None)
    data = base64.b64encode(picture.getvalue()).decode()
    return f"data:image/{'svg+xml' if kind == 'svg' else kind};base64,{data}"


@public
def check_figure_path(path: str | Path) -> None:
    """Check that matplotlib can write a file of this ending.

    Raises:
        InputError: If it cannot; the message lists the endings it knows.
    """
    _format(path)


def _format(path: str | Path) -> str:
    """Format of a figure by its ending; a pipe's is png."""
    known = sorted(FigureCanvasAgg(Figure()).get_supported_filetypes())
    return ending_of(path, ".png", *(f".{each}" for each in known if each != "png"))[1:]


@public
def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure atomically, in the format that the ending of ``path`` names.

    Raises:
        InputError: If the ending is unknown, or the folder cannot be written.
    """
    data = io.BytesIO()
    figure.savefig(data, format=_format(path), dpi=figure.dpi)
    write_bytes(path, data.getvalue())
