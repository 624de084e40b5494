"""Words in pictures that do not lie on other words, nor on what is drawn above them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox, IdentityTransform
from numpy.typing import ArrayLike

_FAR = np.arange(0.25, 5.1, 0.25)  # in heights of the words
_ROUND = np.pi / 2 + np.linspace(0.0, 2 * np.pi, 17)[:-1]
_STEPS = np.array(  # the least first
    [(0.0, 0.0), *((1.5 * far * np.cos(a), far * np.sin(a)) for far in _FAR for a in _ROUND)]
)


class Label(Annotation):
    """Words in a picture that step aside where they would lie on others (`settle`)."""


def label(ax: Axes, words: str, at: ArrayLike, shift_pt: ArrayLike = (0, 0), **style: Any) -> Label:
    """Write words at a place of an axes, in data, that may step aside; not outside the axes."""
    x, y = np.asarray(at, float).tolist()
    away = cast(tuple[float, float], tuple(np.asarray(shift_pt, float).tolist()))
    made = Label(words, (x, y), away, textcoords="offset points", clip_on=True, **style)
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
        away = next((way for way in ways if _is_free(box.translated(*way), full)), (0.0, 0.0))
        shift_pt = np.asarray(away) * 72 / ax.figure.dpi
        each.xyann = tuple((np.asarray(each.xyann) + shift_pt).tolist())
        taken.append(box.translated(*away))


def settle_all(figure: Figure) -> None:
    """Let every label of a figure step aside; its layout is worked out first, if there are any."""
    if figure.findobj(Label):
        figure.draw_without_rendering()
        for ax in figure.axes:
            settle(ax)


def _anchor(ax: Axes, words: Text) -> tuple[float, float]:
    """Place of words in the picture [pixels]."""
    at = words.xy if isinstance(words, Annotation) else words.get_position()
    frame = ax.transData if isinstance(words, Annotation) else words.get_transform()
    x, y = frame.transform(at).tolist()
    return x, y


def _extent(words: Text) -> Bbox:
    """Room that words take in the picture [pixels], with the frame around them."""
    return (words.get_bbox_patch() or words).get_window_extent()


def _is_free(box: Bbox, taken: Sequence[Bbox]) -> bool:
    return not any(box.overlaps(other) for other in taken)
