"""Finished cases, one JSON line each, on the disk before the next one begins.

The first line says what made them: study, settings, versions and machine. A process that is killed
may leave half a line at the end: it is dropped, and that case is measured again. Cases of another
study or machine, or with other settings or versions, do not go into the same file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from twosra_mpc import InputError
from twosra_mpc.files import differences

NAME = "records.jsonl"
FORMAT = 3


class RunLog:
    """The cases finished so far in a folder.

    Attributes:
        path: The file.
        about: What made all its records.
        cpu_s: CPU time that each case took [s]; of one that stands there twice, the later one's.
        dates: Days on which cases were finished, e.g. ``2026-11-23``.
        dropped: Whether half a line was found at the end, and dropped.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        """Open the file in ``folder``, or begin it.

        Raises:
            InputError: If the records in it were made by something else (naming the first that
                differs), it holds something else than records, or it cannot be written.
        """
        self.path, self.cpu_s, self.dates = folder / NAME, dict[str, float](), set[str]()
        self.about = json.loads(json.dumps({"format": FORMAT, **about}))
        self._records: dict[str, Any] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with self.path.open("a+b") as file:
                file.seek(0)
                text, end, rest = file.read().rpartition(b"\n")
                file.truncate(len(text + end))
        except OSError as error:
            raise InputError("out", str(folder), f"a folder to write to ({error})") from None
        self.dropped = bool(rest)
        if not text:
            self._write(self.about)
        for number, line in enumerate(text.splitlines(), start=1):
            try:
                value = json.loads(line)
                if number > 1:
                    self._keep(**value)
            except (ValueError, TypeError, KeyError, RecursionError) as error:
                allowed = f"a finished case ({error!r})"
                raise InputError(f"line {number}", line, allowed, str(self.path)) from None
            if number == 1:
                self._check(value)

    def __contains__(self, case: Mapping[str, Any]) -> bool:
        return json.dumps(case) in self._records

    def __getitem__(self, case: Mapping[str, Any]) -> Any:
        return self._records[json.dumps(case)]

    def append(self, case: Mapping[str, Any], record: Any, cpu_s: float = 0.0) -> None:
        """Add a finished case to the file, down to the disk."""
        date = datetime.now(UTC).date().isoformat()
        line = {"case": case, "cpu_s": cpu_s, "date": date, "record": record}
        self._write(line)
        self._keep(**line)

    def _keep(self, case: Mapping[str, Any], cpu_s: float, date: str, record: Any) -> None:
        key = json.dumps(case)
        self._records[key], self.cpu_s[key] = record, float(cpu_s)
        self.dates.add(str(date))

    def _write(self, line: Mapping[str, Any]) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())

    def _check(self, found: Any) -> None:
        for name, before, now in differences(found, self.about):
            allowed = f"{before!r}, with which the records in {self.path} were made; "
            raise InputError(name, now, allowed + "choose another folder to begin anew")
