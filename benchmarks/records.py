"""Records: the table that a finished study came to, with what was measured, when, and on what.

A record is a file of the repository. It holds digests of the source files that it measures, so that
changes to them are noticed without the history of the repository.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from twosra_mpc import InputError
from twosra_mpc.files import read_document, write_text
from twosra_mpc.validation import Value, plain

ROOT = Path(__file__).parent.parent
FOLDER = Path(__file__).parent / "records"
REPORTING = ("figures.py", "records.py", "report.py", "tables.py")  # change nothing measured

Cells = Annotated[tuple[str, ...], BeforeValidator(plain)]
Rows = Annotated[tuple[Cells, ...], Field(min_length=1), BeforeValidator(plain)]


class Record(Value):
    """The table of a finished study.

    Attributes:
        command: Command that measures it anew.
        date: Day on which it was measured.
        commit: Last commit that had changed what is measured.
        cases: Number of cases.
        cpu_s: CPU time that all of them took [s].
        settings: Settings of the study.
        machine: Machine.
        versions: Versions of Python and of packages.
        measures: Folder of the repository -> digest of its source files as they were measured.
        columns: Names of the columns.
        rows: Cells of each row.
    """

    command: str
    date: str
    commit: str
    cases: Annotated[int, Field(ge=1)]
    cpu_s: float
    settings: dict[str, Any]
    machine: dict[str, str]
    versions: dict[str, str]
    measures: dict[str, str]
    columns: Cells
    rows: Rows

    @property
    def origin(self) -> str:
        """One sentence on where the numbers come from."""
        cases = f"{self.cases} case{'s' * (self.cases != 1)}, {self.cpu_s:z.0f} s of CPU"
        return f"`{self.command}`: {cases}, measured on {self.date}, commit {self.commit}."

    def changed(self, root: Path = ROOT) -> list[str]:
        """Measured folders whose source files are no longer those that were measured."""
        return [path for path, was in self.measures.items() if source_digest(root / path) != was]

    def save(self, path: Path) -> None:
        """Write the record, one line for each key and for each row.

        Raises:
            InputError: If it cannot be written.
        """
        values = self.model_dump(mode="json", exclude={"rows"})
        lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in values.items()]
        rows = ",\n  ".join(json.dumps(row, ensure_ascii=False) for row in self.rows)
        write_text(path, "{" + ",\n ".join([*lines, f'"rows": [\n  {rows}]']) + "}\n")


def load_records(folder: Path = FOLDER) -> Mapping[str, Record]:
    """Name -> record, of all files in a folder.

    Raises:
        InputError: If one is no record.
    """
    paths = sorted(folder.glob("*.json"))
    return {path.stem: Record.parse(read_document(path, str(path)), str(path)) for path in paths}


def source_digest(*folders: Path) -> str:
    """Digest of all source files in folders but those that only report, 12 hexadecimal digits."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".toml") and path.name not in REPORTING:
                digest.update(path.relative_to(folder).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def commit_of(paths: Iterable[str], root: Path = ROOT) -> str:
    """Name of the last commit that changed any of some folders.

    Raises:
        InputError: If there is no history, or the folders hold what is not committed.
    """
    git = ("git", "-C", str(root))
    try:
        for arguments in (("status", "--porcelain"), ("log", "-1", "--format=%h", "--abbrev=7")):
            done = subprocess.run(
                [*git, *arguments, "--", *paths], check=True, capture_output=True, text=True
            )
            if arguments[0] == "status" and done.stdout:
                raise InputError("commit", done.stdout.strip(), "a tree without changes: commit")
    except (OSError, subprocess.CalledProcessError) as error:
        raise InputError("commit", str(root), f"a clone with its history ({error})") from None
    return done.stdout.strip()
