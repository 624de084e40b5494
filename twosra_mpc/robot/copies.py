"""Robot files copied with their comments, but one part."""

from __future__ import annotations

from pathlib import Path

import tomlkit
from tomlkit import TOMLDocument

from twosra_mpc.errors import InputError
from twosra_mpc.files import locate, read_text


def renamed_robot(source: str | Path, name: str) -> str:
    """Return the text of a robot file with another ``name``, comments included.

    Raises:
        InputError: If ``source`` is not TOML.
    """
    document = robot_document(source)
    document["name"] = name
    return tomlkit.dumps(document)


def robot_document(source: str | Path) -> TOMLDocument:
    """Read a robot file (a built-in name or a path) with its comments and layout.

    Raises:
        InputError: If there is none, it cannot be read, or is not a TOML file.
    """
    path = locate(source, "robots", "robot")
    if path.suffix == ".json":
        raise InputError("robot", str(source), "a TOML file, to be copied with its comments")
    return tomlkit.parse(read_text(path, str(source)))
