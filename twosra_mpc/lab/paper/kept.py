"""Parts of a report that are computed once: kept in a folder with what they were computed from.

A part is a JSON file, written as a whole when the part is done. It is used again if it was computed
by the same version of this package, to the letter, with the same settings, and its figures are
there; otherwise, also where the file is spoilt, it is computed anew.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from twosra_mpc.errors import InputError
from twosra_mpc.files import write_json
from twosra_mpc.installation import __version__

Tell = Callable[[str], None]
Data = dict[str, Any]


@dataclass(frozen=True)
class Part:
    """Part of the report that is computed at once.

    Attributes:
        name: Of its file.
        settings: Plain data that its outcome depends on, besides the version.
        compute: Computes it, after it has drawn its figures into the folder it is given.
        figures: Names of these figures.
    """

    name: str
    settings: Mapping[str, Any]
    compute: Callable[[Path, Tell], Data]
    figures: tuple[str, ...] = ()


@dataclass(frozen=True)
class Kept:
    """The folder in which parts are kept."""

    folder: Path

    def read(self, part: Part) -> Data | None:
        """Return a part that was kept; None if it has to be computed."""
        try:
            document = json.loads((self.folder / f"{part.name}.json").read_text(encoding="utf-8"))
            same = document["computed_from"] == self._origin(part)
            data = document["data"] if same else None
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None
        drawn = all((self.folder.parent / figure).is_file() for figure in part.figures)
        return data if drawn and isinstance(data, dict) else None

    def write(self, part: Part, data: Data) -> Data:
        """Keep a part; returns it as it will be read.

        Raises:
            InputError: If it cannot be written.
        """
        document = {"computed_from": self._origin(part), "data": data}
        write_json(self.folder / f"{part.name}.json", document)
        kept: Data = json.loads(json.dumps(data))
        return kept

    def get(self, part: Part, tell: Tell) -> Data:
        """Return a part, computed and kept if it is not there yet."""
        if (found := self.read(part)) is not None:
            return found
        tell(part.name)
        return self.write(part, part.compute(self.folder.parent, tell))

    @staticmethod
    def _origin(part: Part) -> Data:
        origin = {"version": __version__, "package": package_digest(), **part.settings}
        plain: Data = json.loads(json.dumps(origin))
        return plain


@cache
def package_digest() -> str:
    """Checksum of this package's code and data: a version may change while it is worked on."""
    return digest(Path(str(files("twosra_mpc"))), (".py", ".toml"))


def digest(source: Path, endings: tuple[str, ...] = ()) -> str:
    """Return the checksum of a file, or of all files in a folder, their names included.

    Args:
        source: The file or folder.
        endings: Of the files that count; all of them by default.

    Raises:
        InputError: If there is no such file or folder, or it cannot be read.
    """
    if not source.exists():
        raise InputError("data", str(source), "a file or folder that exists")
    checksum = hashlib.sha256()
    for path in sorted(source.rglob("*")) if source.is_dir() else [source]:
        if path.is_file() and (not endings or path.suffix in endings):
            content = path.read_bytes()
            checksum.update(f"{path.relative_to(source)}\n{len(content)}\n".encode() + content)
    return checksum.hexdigest()
