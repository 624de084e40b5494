"""The paper, claim by claim, with few random problems: what ``twosra reproduce`` finds.

The authors' logs and photographs are no part of this repository: claims that rest on them are
checked where they are in a folder.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from pydantic import TypeAdapter

from benchmarks.study import PLANNING, Count, Measured, Study
from twosra_mpc.lab.commands.reproduce_command import located
from twosra_mpc.lab.paper import Sources, reproduce


class Case(NamedTuple):
    """The paper, and whether there are data."""

    data: bool


class Paper(Study):
    """All claims of the paper.

    Attributes:
        problems: Random problems of each kind.
        data: Folder of the authors' data, as ``twosra reproduce --data`` takes it.
    """

    record: ClassVar = TypeAdapter(dict[str, Any])
    question: ClassVar = "What comes of the paper's claims?"
    measures: ClassVar = (*PLANNING, "twosra_mpc/lab/paper", "twosra_mpc/lab/reproduction")

    problems: Count = 40
    data: str = "lab"

    def cases(self) -> Iterator[Case]:
        """Yield the paper."""
        yield Case(Path(self.data).is_dir())

    def run(self, case: Case) -> dict[str, Any]:
        """Claims with their readings and verdicts, and the tables of each section."""
        sources = Sources(**located(Path(self.data))) if case.data else Sources()
        with tempfile.TemporaryDirectory() as folder:
            made = reproduce(folder, sources, problems=self.problems, processes=1)
        return {
            "claims": [claim.document() for one in made.sections for claim in one.claims],
            "tables": {
                section.name: [
                    [list(table.header), *map(list, table.rows)] for table in section.tables
                ]
                for section in made.sections
            },
            "verdicts": {str(verdict): count for verdict, count in made.verdicts.items()},
        }

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """The one record."""
        del folder
        return results[0].record
