"""Files spoilt, commands killed and interrupted: is it said what is wrong, and nothing left?

What is attacked, and how, stands with the tests (`tests/attack`), which try a few of each.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from pydantic import TypeAdapter

from benchmarks.study import Count, Study

_TESTS = str(Path(__file__).parents[2] / "tests")
_WAYS = {  # module, function, names of what it attacks
    "spoilt": ("attack.spoilt_files", "attacked", "KINDS"),
    "killed": ("attack.stopped", "killed", "COMMANDS"),
    "interrupted": ("attack.stopped", "interrupted", "COMMANDS"),
}


class Case(NamedTuple):
    """A kind of file that is spoilt, or a command that is stopped."""

    way: str
    name: str


class Files(Study):
    """Attacks on every kind of file and on every command that writes one.

    Attributes:
        count: Files of each kind and mutation; stops of each command.
    """

    record: ClassVar = TypeAdapter(dict[str, Any])
    question: ClassVar = "Does the program say what is wrong with a file, and leave no half of one?"
    measures: ClassVar = ("twosra_mpc", "tests")

    count: Count = 1

    def cases(self) -> Iterator[Case]:
        """Yield the kinds of files, then the commands."""
        for way, (module, _, names) in _WAYS.items():
            yield from (Case(way, name) for name in getattr(_imported(module), names))

    def run(self, case: Case) -> dict[str, Any]:
        """Attack; how often, and what went wrong."""
        module, function, _ = _WAYS[case.way]
        made = list(getattr(_imported(module), function)(case.name, range(self.count)))
        return {"tried": len(made), "wrong": [list(each) for each in made if each is not None]}


def _imported(module: str) -> Any:
    if _TESTS not in sys.path:
        sys.path.append(_TESTS)
    return importlib.import_module(module)
