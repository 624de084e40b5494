"""Images: maps and photographs."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twosra_mpc.errors import InputError, doubt
from twosra_mpc.files import read_bytes


@contextmanager
def open_image(path: Path) -> Iterator[Any]:
    """Open an image (of Pillow) for a block.

    Warns:
        InputWarning: If it has several pictures, of which the first is taken.

    Raises:
        InputError: If it cannot be read, or is none.
        Exception: Of many kinds, if it is spoilt, or so large that Pillow warns of it.
    """
    from PIL import Image, UnidentifiedImageError

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            image = Image.open(io.BytesIO(read_bytes(path, str(path))))
        except UnidentifiedImageError:
            raise InputError("file", str(path), "an image file, as PNG, PGM or JPEG") from None
        several = getattr(image, "n_frames", 1) > 1
    doubt(["several pictures are in it; the first is taken"] * several, str(path))
    with image:
        yield image
