"""Films of plans and runs: which files there are, recording, showing one in a notebook.

Time passes at a constant pace along the stretched time axis of the scene: driving takes a few
seconds, and minutes of waiting a few seconds more; the clock in the corner tells. Needs no display.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FFMpegWriter, writers
from matplotlib.colors import to_rgb
from PIL import Image

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.files import check_writable, ending_of, write_bytes
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plotting.figures import PALETTE, STYLE
from twosra_mpc.plotting.plan_figures import plan_title
from twosra_mpc.plotting.playback import PLACES, Playback, plan_playback
from twosra_mpc.plotting.scene import Scene
from twosra_mpc.validation import Seconds

FRAMES_PER_S = 12.5  # a GIF counts in hundredths of a second
LAST_FRAME_S = 2.5  # how long the end is shown
SHADES = 9  # of each colour in a GIF, towards white
UNCHANGED = 255  # place in the palette of a GIF for what is as in the frame before
LEAST = 0.25  # of the length of the unstretched time axis that a motion phase takes

_ENDINGS = ".gif", ".mp4"
OnProgress = Callable[[int, int], None]  # frames done, frames in all


@public
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


@public
def check_animation_path(path: str | Path) -> None:
    """Check that an animation of this ending can be written here.

    Raises:
        InputError: If it cannot.
    """
    if ending_of(path, *_ENDINGS) == ".mp4" and not writers.is_available("ffmpeg"):
        allowed = "a file ending in .gif: .mp4 needs the program ffmpeg, which is not installed"
        raise InputError("output", str(path), allowed)


@public
def animate_plan(
    plan: Plan,
    path: str | Path | None = None,
    *,
    duration_s: Seconds = 12.0,
    on_progress: OnProgress | None = None,
) -> Film:
    """Animate a plan; a notebook shows what is returned.

    Args:
        plan: The plan.
        path: Where to save the animation, atomically; its ending (gif, mp4) is the format.
        duration_s: Of the animation, without its last frame.
        on_progress: Called with the frames done and the frames in all, after each of them.

    Raises:
        InputError: If such a file cannot be written.
    """
    titles = plan.robot.name, plan_title(plan).replace("\n", ", ")
    return animate(plan_playback(plan, LEAST), titles, path, duration_s, on_progress)


def animate(
    playback: Playback,
    titles: tuple[str, str],
    path: str | Path | None,
    duration_s: float,
    on_progress: OnProgress | None,
) -> Film:
    """Film a plan or a run, with what is written above it and at its end; as ``animate_plan``."""
    if path is not None:
        check_animation_path(path)
        check_writable(path)
    count = max(2, round(duration_s * FRAMES_PER_S))
    rows = np.rint(np.linspace(0, PLACES - 1, count)).astype(int).tolist()
    told = on_progress or (lambda done, total: None)
    with rc_context(STYLE):
        scene = Scene(playback, titles, duration_s)
        width_px = round(scene.figure.bbox.width)
        if path is None or ending_of(path, *_ENDINGS) == ".gif":
            film = Film(gif(scene, rows, told), "image/gif", width_px)
        else:
            film = Film(_mp4(scene, rows, told), "video/mp4", width_px)
    if path is not None:
        write_bytes(path, film.data)
    return film


def gif(scene: Scene, rows: Sequence[int], told: OnProgress) -> bytes:
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


def _mp4(scene: Scene, rows: Sequence[int], told: OnProgress) -> bytes:
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
