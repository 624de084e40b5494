"""Finished runs, one JSON line each, written at once, so that a run can be taken up again.

The first line holds the settings. A process that is killed may leave half a line at the end: it is
dropped, and the run made again. Runs with other settings do not go into the same file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.suite import Record
from twosra_mpc import InputError

NAME = "runs.jsonl"


class RunLog:
    """The runs finished so far in a folder.

    Attributes:
        path: The file.
        settings: What all its runs have in common.
        records: Key of each finished run -> what it measured.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        """Open the file in ``folder``, or begin it.

        Raises:
            InputError: If it holds runs with other settings (naming the first that differs), or
                something else than runs.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / NAME
        self.settings = settings
        self.records: dict[str, Record] = {}
        lines = self._complete_lines()
        if not lines:
            self._write({"settings": settings})
            return
        self._check(lines[0].get("settings"), settings)
        for number, line in enumerate(lines[1:], start=2):
            if not {"key", "record"} <= line.keys():
                raise InputError(f"line {number}", line, "a finished run", str(self.path))
            self.records[line["key"]] = line["record"]

    def append(self, key: str, record: Record) -> None:
        """Add a finished run to the file, down to the disk."""
        self._write({"key": key, "record": record})
        self.records[key] = record

    def _write(self, line: dict[str, Any]) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())

    def _complete_lines(self) -> list[dict[str, Any]]:
        """Read every complete line; cut off what an interrupted process left behind the last."""
        if not self.path.exists():
            return []
        text = self.path.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        if len(whole) < len(text):
            os.truncate(self.path, len(whole))
        return [self._parsed(i, line) for i, line in enumerate(whole.splitlines(), start=1)]

    def _parsed(self, number: int, line: bytes) -> dict[str, Any]:
        try:
            value = json.loads(line)
        except ValueError as error:
            raise InputError(f"line {number}", line, f"JSON ({error})", str(self.path)) from error
        if not isinstance(value, dict):
            raise InputError(f"line {number}", value, "a table of keys", str(self.path))
        return value

    def _check(self, found: Any, settings: dict[str, Any]) -> None:
        before, now = dict(_flat("", found)), dict(_flat("", json.loads(json.dumps(settings))))
        for name in [*now, *before]:
            if before.get(name) != now.get(name):
                allowed = (
                    f"{before.get(name)!r}, with which the runs in {self.path} were made; "
                    "choose another folder to begin anew"
                )
                raise InputError(name, now.get(name), allowed)


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested tables with their dotted names."""
    if not isinstance(value, dict):
        yield name, value
        return
    for key, item in value.items():
        yield from _flat(f"{name}.{key}" if name else key, item)
