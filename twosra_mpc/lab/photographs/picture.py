"""Thermal photographs: reading them, and finding the one segment that shines in them.

Places in a photograph are in pixels (x right, y down, the middle of the first pixel at 0, 0).
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ImageOps
from scipy import ndimage

from twosra_mpc.errors import InputError
from twosra_mpc.files import reading
from twosra_mpc.lab.image_file import open_image
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.validation import Pair, Positive, ReadOnlyArrays, Value

ENDINGS = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff")
WHITE = 255  # largest grey value of 8 bits
_SPECK = 0.25  # of the largest bright region: what is smaller is no segment
_EIGHT = np.ones((3, 3), dtype=bool)  # pixels touch at their corners too
_SHORTEST, _LONGEST = 0.5, 1.6  # bright length over that of the segment

_MARGIN = 3  # px around a segment that is cut out
_KEYS = -0.75  # parameter a of cubic convolution

Mask = NDArray[np.bool_]


class Camera(Value):
    """Camera and segment of photographs.

    Attributes:
        scale_m: Width of a pixel on the ground [m].
        length_m: Length of the segment [m].
        towards_px: A point (x, y) [px] near the end that the segment is followed to: curvature is
            positive where it turns left on the way there, as seen by the camera.
        threshold: Grey value, of 0 to 255, that is exceeded where the segment is.
    """

    scale_m: Positive
    length_m: Positive
    towards_px: Pair
    threshold: Positive = 120.0

    @property
    def length_px(self) -> float:
        """Length of the segment [px]."""
        return self.length_m / self.scale_m


# Of the robot's paper: 168 of its pixels, each a twentieth, are a segment's length.
PAPER_CAMERA = Camera(scale_m=0.04 / 8.4, length_m=0.04, towards_px=(37.0, 34.0))


@dataclass(frozen=True, eq=False, repr=False)
class Photograph(ReadOnlyArrays):
    """Grey values 0 to 255 of one picture, (rows, columns), read-only; with the file it is from."""

    path: Path
    grey: Array


def pictures_in(folder: str | Path) -> list[Path]:
    """List the pictures of a folder by name, numbers in names by their value.

    Raises:
        InputError: If it is no folder, or there is no picture in it.
    """
    folder = Path(folder)
    if not os.path.isdir(folder):
        raise InputError("folder", str(folder), "a folder of photographs")
    found = [path for path in folder.glob("[!.]*") if path.suffix.lower() in ENDINGS]
    if not found:
        raise InputError("folder", str(folder), f"one with files ending in {', '.join(ENDINGS)}")
    return sorted(found, key=lambda path: (number_of(path.stem), path.name))


def number_of(stem: str) -> float:
    """Return the number that a name ends with; infinity if it ends with none."""
    digits = stem[len(stem.rstrip("0123456789")) :]
    return float(digits) if digits else float("inf")


def read_photograph(path: str | Path) -> Photograph:
    """Read a picture; colours become grey.

    Raises:
        InputError: If the file is no image, or not one of 8 bits a colour.
    """
    with reading(str(path), "picture", "an image file"), open_image(Path(path)) as image:
        if image.mode not in ("1", "L", "LA", "P", "RGB", "RGBA", "YCbCr"):
            allowed = "grey or RGB, 8 bits a colour (scale temperatures to 0 to 255 first)"
            raise InputError("picture", f"mode {image.mode}", allowed, str(path))
        upright = ImageOps.exif_transpose(image)  # cameras store how they were held
        grey = np.asarray(upright.convert("L"), dtype=float)
    return Photograph(Path(path), grey)


def find_segment(photograph: Photograph, camera: Camera) -> Mask:
    """Return the pixels (rows, columns) of the one segment in a photograph.

    Raises:
        InputError: If there is none, more than one, one that reaches the border of the picture, or
            one that is much shorter or longer than the segment should be.
    """
    source = str(photograph.path)
    bright = photograph.grey > camera.threshold
    labels, count = ndimage.label(bright, structure=_EIGHT)
    if not count:
        allowed = f"one segment brighter than {camera.threshold:zg}; there is none"
        raise InputError("picture", photograph.path.name, allowed, source)
    sizes = np.bincount(labels.ravel())[1:]
    large = np.flatnonzero(sizes > _SPECK * sizes.max()) + 1
    if len(large) > 1:
        allowed = f"one segment brighter than {camera.threshold:zg}; there are {len(large)}"
        raise InputError("picture", photograph.path.name, allowed, source)
    region: Mask = labels == large[0]
    if region[[0, -1]].any() or region[:, [0, -1]].any():
        allowed = "one segment within the picture; it is cut off at the border"
        raise InputError("picture", photograph.path.name, allowed, source)
    return region


def check_length(photograph: Photograph, seen_px: float, camera: Camera) -> None:
    """Refuse what cannot be the segment by its length.

    Raises:
        InputError: If the bright line is less than half or more than 1.6 times as long.
    """
    share = seen_px / camera.length_px
    if not _SHORTEST <= share <= _LONGEST:
        seen, whole = (f"{1e3 * camera.scale_m * px:z.3g}" for px in (seen_px, camera.length_px))
        allowed = f"a segment of {whole} mm; what is bright is {seen} mm long"
        raise InputError("picture", photograph.path.name, allowed, str(photograph.path))


def upsampled(photograph: Photograph, region: Mask, factor: int) -> tuple[Array, tuple[int, int]]:
    """Cut out the segment, three pixels wider, and make its pixels smaller.

    By cubic convolution (Keys 1981, a = -0.75, as in OpenCV), rounded to whole grey values.

    Returns:
        Grey values, ``factor`` times as many rows and columns, and the pixel (row, column) that
        the cut begins at. The middle of fine pixel i is at (i + 0.5) / factor - 0.5 of the cut.
    """
    cut, first = cut_out(photograph, region, _MARGIN)
    rows, columns = (_cubic(size, factor) for size in cut.shape)
    return np.clip(np.rint(rows @ cut @ columns.T), 0, WHITE), first


def cut_out(photograph: Photograph, region: Mask, margin: int) -> tuple[Array, tuple[int, int]]:
    """Grey values around a segment, and the pixel (row, column) that they begin at."""
    rows, columns = ndimage.find_objects(region.astype(int))[0]
    top, left = (max(part.start - margin, 0) for part in (rows, columns))
    return photograph.grey[top : rows.stop + margin, left : columns.stop + margin], (top, left)


def _cubic(size: int, factor: int) -> Array:
    """Weights of ``size`` values in ``factor`` times as many between them."""
    at = (np.arange(size * factor) + 0.5) / factor - 0.5
    weights = np.zeros((len(at), size))
    for beside in range(-1, 3):
        nearest = np.floor(at).astype(int) + beside
        d = np.abs(at - nearest)
        near = (_KEYS + 2) * d**3 - (_KEYS + 3) * d**2 + 1
        far = _KEYS * (d**3 - 5 * d**2 + 8 * d - 4)
        held = np.clip(nearest, 0, size - 1)
        np.add.at(weights, (np.arange(len(at)), held), np.where(d <= 1, near, far))
    return weights
