"""Robot files as they are written, to be copied with their comments and one table changed."""

from __future__ import annotations

from pathlib import Path

import tomlkit
from tomlkit import TOMLDocument

from twosra_mpc.errors import InputError
from twosra_mpc.files import locate, read_text


def robot_document(source: str | Path) -> TOMLDocument:
    """Read a robot file (a built-in name or a path) with its comments and layout.

    Raises:
        InputError: If there is none, it cannot be read, or is not a TOML file.
    """
    path = locate(source, "robots", "robot")
    if path.suffix == ".json":
        raise InputError("robot", str(source), "a TOML file, to be copied with its comments")
    return tomlkit.parse(read_text(path, str(source)))
