"""Reading user files with errors that name the place, and writing results atomically."""

from __future__ import annotations

import difflib
import json
import os
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

from twosra_mpc.errors import InputError

_JSON = (".json", ".geojson")


def built_in_names(folder: str) -> list[str]:
    """Names of the TOML files in a data folder of the package."""
    names = [entry.name for entry in files("twosra_mpc").joinpath(folder).iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def locate(source: str | Path, folder: str, field: str) -> Path:
    """Find a built-in by name, or a user's file by path.

    Raises:
        InputError: If neither exists; the message lists the built-in names.
    """
    names = built_in_names(folder)
    if str(source) in names:
        return Path(str(files("twosra_mpc").joinpath(folder, f"{source}.toml")))
    path = Path(source)
    if path.is_file():
        return path
    close = difflib.get_close_matches(str(source), names, n=1)
    hint = f"did you mean {close[0]}? " if close else ""
    raise InputError(field, str(source), f"{hint}a file that exists, or one of {', '.join(names)}")


def read_text(path: Path, source: str) -> str:
    """Read a UTF-8 text file.

    Raises:
        InputError: If the file cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("file", source, f"a readable UTF-8 file ({error})") from error


def read_document(path: Path, source: str) -> dict[str, Any]:
    """Read a TOML or (by its ending: json, geojson) JSON file into a dictionary.

    Raises:
        InputError: If the file cannot be read or parsed; the message carries line and column.
    """
    text = read_text(path, source)
    try:
        document = json.loads(text) if path.suffix in _JSON else tomllib.loads(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        kinds = "JSON" if path.suffix == ".geojson" else "TOML, or JSON in a .json file"
        allowed = f"valid {kinds} ({error})"
        raise InputError("file", source, allowed) from error
    if not isinstance(document, dict):
        raise InputError("file", source, "a table of keys at the top level")
    return document


@contextmanager
def atomic_path(target: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside ``target``; move it there only if the block succeeds.

    Raises:
        InputError: If the folder of ``target`` does not exist or cannot be written.
    """
    target = Path(target)
    if target.is_dir():
        raise InputError("output", str(target), "the path of a file, not of a folder")
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent
        )
    except OSError as error:
        allowed = f"a path in a folder that exists and can be written ({error.strerror})"
        raise InputError("output", str(target), allowed) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(target: str | Path, document: dict[str, Any]) -> None:
    """Write plain data as JSON, atomically.

    Raises:
        InputError: If the folder does not exist or cannot be written.
    """
    write_text(target, json.dumps(document, allow_nan=False) + "\n")


def write_text(target: str | Path, text: str) -> None:
    """Write a text file atomically (UTF-8).

    Raises:
        InputError: If it cannot be written, e.g. on a full disk.
    """
    with atomic_path(target) as temporary:
        try:
            temporary.write_text(text, encoding="utf-8")
        except OSError as error:
            allowed = f"a path with room for {len(text)} characters ({error.strerror})"
            raise InputError("output", str(target), allowed) from error
