"""The folder of a batch: what made it, the pieces that are finished, and in the end one table."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.files import differences, json_document, read_text, write_json, write_text
from twosra_mpc.installation import __version__
from twosra_mpc.lab.batch.chunk import Chunk
from twosra_mpc.lab.batch.problems import Problems
from twosra_mpc.lab.batch.table import (
    PARTS,
    RUNS,
    frame_of,
    problems_in,
    read_runs,
    table_paths,
    write_table,
)

FORMAT = 1
_ABOUT, _SPEC, _PLANS = "batch.json", "spec.toml", "plans"


class Folder:
    """The runs of a batch on disk. Every file is written as a whole or not at all.

    Attributes:
        path: The folder.
    """

    def __init__(self, path: Path, problems: Problems, spec: str) -> None:
        """Open the folder of this batch, or begin it with a copy of the spec's text.

        Raises:
            InputError: If it holds something else, or was made from another spec, other files or by
                another version of the package (naming everything that differs).
        """
        self.path, self._problems = path, problems
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._check()
            (path / PARTS).mkdir(exist_ok=True)
            if problems.spec.plans:
                (path / _PLANS).mkdir(exist_ok=True)
        except OSError as error:
            raise InputError("--out", str(path), f"a folder to write to ({error})") from error
        write_text(path / _SPEC, spec)

    def done(self) -> NDArray[np.bool_]:
        """True where a problem is finished, (n,): read from the disk, whatever was interrupted."""
        done = np.zeros(len(self._problems), dtype=bool)
        for part in table_paths(self.path):
            done[problems_in(part)] = True
        return done

    def add(self, chunk: Chunk) -> None:
        """Write what problems came to; their plans first, so that no row is without its plan.

        Raises:
            InputError: If it cannot be written, e.g. on a full disk.
        """
        for name, text in chunk.plans.items():
            write_text(self.path / _PLANS / name, text)
        greedy = self._problems.spec.planner == "both"
        frame = frame_of(chunk.rows, self._problems.kinds, greedy=greedy)
        write_table(frame, self.path / PARTS / f"{chunk.rows[0]['problem']:08}.parquet")

    def finish(self) -> None:
        """Join the pieces of a table that has all problems.

        Raises:
            InputError: If it cannot be written, or somebody else took pieces away.
        """
        if not os.path.isfile(self.path / RUNS):
            whole = read_runs(self.path)
            if len(whole) < len(self._problems):
                allowed = f"all {len(self._problems)} problems: does another batch run here?"
                raise InputError("--out", f"{len(whole)} problems", allowed, str(self.path))
            write_table(whole, self.path / RUNS)
        shutil.rmtree(self.path / PARTS, ignore_errors=True)

    def _check(self) -> None:
        """Compare what made the runs in the folder, or say so in a new one."""
        problems, path = self._problems, self.path / _ABOUT
        spec = problems.spec.model_dump(mode="json", by_alias=True, exclude_none=True)
        about = {"format": FORMAT, "package": __version__, **spec, "files": problems.files}
        now: dict[str, Any] = json.loads(json.dumps(about, default=str))
        if not os.path.isfile(path):
            if any(not one.name.startswith(".") for one in self.path.iterdir()):
                raise InputError("--out", str(self.path), "a new folder, or one of this batch")
            write_json(path, now)
            return
        before = json_document(read_text(path, str(path)), str(path))
        found = [
            InputError(name, new, f"{old!r}, as the runs in {self.path} were begun; or a new --out")
            for name, old, new in differences(before, now)
        ]
        if found:
            raise found[0].among(found[1:])
