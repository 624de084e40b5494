"""Films: which files there are, recording a scene, showing the result in a notebook."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, Protocol

import numpy as np
from matplotlib.animation import FFMpegWriter, writers
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from twosra_mpc.errors import InputError
from twosra_mpc.files import atomic_path
from twosra_mpc.plotting.style import PALETTE

FRAMES_PER_S = 12.5  # a GIF counts in hundredths of a second
LAST_FRAME_S = 2.5  # how long the end is shown
SHADES = 9  # of each colour in a GIF, towards white
UNCHANGED = 255  # place in the palette of a GIF for what is as in the frame before

OnProgress = Callable[[int, int], None]  # frames done, frames in all


class Filmed(Protocol):
    """What can be filmed."""

    figure: Figure

    def show(self, row: int) -> None:
        """Move to a row of what is played."""

    def image(self, row: int) -> Image.Image:
        """Move to a row, and return a picture of it."""


@dataclass(frozen=True)
class Film:
    """A film; a notebook shows it where it is the last value of a cell.

    Attributes:
        data: Content of its file.
        media_type: Kind of file.
        width_px: Width of the picture.
    """

    data: bytes = field(repr=False)
    media_type: Literal["image/gif", "video/mp4"]
    width_px: int

    def _repr_html_(self) -> str:
        source = f"data:{self.media_type};base64,{base64.b64encode(self.data).decode('ascii')}"
        shown = f'src="{source}" width="{self.width_px}"'
        if self.media_type == "image/gif":
            return f'<img {shown} alt="animation">'
        return f"<video {shown} controls autoplay loop muted></video>"


def check_animation_path(path: str | Path) -> None:
    """Check that an animation of this ending can be written here.

    Raises:
        InputError: If it cannot.
    """
    ending = Path(path).suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise InputError("output", str(path), "a file ending in .gif or .mp4")
    if ending == ".mp4" and not writers.is_available("ffmpeg"):
        allowed = "a file ending in .gif: .mp4 needs the program ffmpeg, which is not installed"
        raise InputError("output", str(path), allowed)


def record(
    scene: Filmed,
    rows: Sequence[int],
    path: str | Path | None = None,
    on_progress: OnProgress | None = None,
) -> Film:
    """Film a scene.

    Args:
        scene: What is filmed.
        rows: A frame each; the last one is shown longer.
        path: Where to save the film, atomically; its ending (gif, mp4) is the format.
        on_progress: Called after each frame.

    Raises:
        InputError: If such a file cannot be written.
    """
    told = on_progress or (lambda done, total: None)
    width_px = round(scene.figure.get_figwidth() * scene.figure.dpi)
    if path is None:
        return Film(_gif(scene, rows, told), "image/gif", width_px)
    check_animation_path(path)
    with atomic_path(path) as temporary:
        if Path(path).suffix.lower() == ".gif":
            film = Film(_gif(scene, rows, told), "image/gif", width_px)
        else:
            film = Film(_mp4(scene, rows, told), "video/mp4", width_px)
        temporary.write_bytes(film.data)
    return film


def _gif(scene: Filmed, rows: Sequence[int], told: OnProgress) -> bytes:
    """All frames in one palette, undithered, with only the changes after the first."""
    palette = _palette()

    def frames() -> Iterator[Image.Image]:
        shown = np.full((1, 1), UNCHANGED, dtype=np.uint8)
        for number, row in enumerate(rows, start=1):
            picture = scene.image(row).quantize(palette=palette, dither=Image.Dither.NONE)
            pixels = np.asarray(picture)
            changes = Image.fromarray(np.where(pixels == shown, np.uint8(UNCHANGED), pixels))
            changes.putpalette(palette.getpalette() or [])
            shown = pixels
            yield changes
            told(number, len(rows))

    file, images = io.BytesIO(), frames()
    durations_ms = [round(1000 / FRAMES_PER_S)] * (len(rows) - 1) + [round(1000 * LAST_FRAME_S)]
    style: dict[str, Any] = {"loop": 0, "optimize": False, "duration": durations_ms}
    style |= {"transparency": UNCHANGED, "disposal": 1}  # what is transparent stays as it was
    next(images).save(file, format="GIF", save_all=True, append_images=images, **style)
    return file.getvalue()


def _palette() -> Image.Image:
    """The colours of the figures in shades towards white, and greys.

    None is so near to white that Pillow, which compares roughly, takes it for white.
    """
    shades = np.linspace(0.0, 1.0, SHADES)[:-1, None]
    colours = np.array([to_rgb(colour) for colour in PALETTE])
    ramps = [colour + shades * (1.0 - colour) for colour in colours]
    greys = np.repeat(np.linspace(0.0, 1.0, 3 * SHADES)[:, None], 3, axis=1)
    every = np.concatenate([*ramps, greys])
    far = (every.min(axis=1) < 0.95) | (every.min(axis=1) == 1.0)
    image = Image.new("P", (1, 1))
    image.putpalette(np.rint(255 * every[far]).astype(int).ravel().tolist())
    return image


def _mp4(scene: Filmed, rows: Sequence[int], told: OnProgress) -> bytes:
    writer = FFMpegWriter(fps=FRAMES_PER_S)  # type: ignore[arg-type]  # ffmpeg takes any number
    last = [rows[-1]] * round(LAST_FRAME_S * FRAMES_PER_S)
    with TemporaryDirectory() as folder:
        file = Path(folder, "film.mp4")
        with writer.saving(scene.figure, str(file), scene.figure.dpi):
            for number, row in enumerate([*rows, *last], start=1):
                scene.show(row)
                writer.grab_frame()
                told(number, len(rows) + len(last))
        return file.read_bytes()
