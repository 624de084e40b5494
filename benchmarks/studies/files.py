"""Files spoilt, commands killed and interrupted: is it said what is wrong, and nothing left?

What is attacked, and how, stands in `benchmarks/files`; tests try a few of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, NamedTuple

from benchmarks.study import Count, Study


class Case(NamedTuple):
    """A kind of file that is spoilt, or a command that is stopped."""

    way: str
    name: str


class Files(Study):
    """Attacks on every kind of file and on every command that writes one.

    Attributes:
        count: Files of each kind and mutation; stops of each command.
    """

    question: ClassVar = "Does the program say what is wrong with a file, and leave no half of one?"
    measures: ClassVar = ("twosra_mpc", "benchmarks/files")

    count: Count = 1

    def cases(self) -> Iterator[Case]:
        """Yield the kinds of files, then the commands."""
        for way, (_, attacked) in _ways().items():
            yield from (Case(way, name) for name in attacked)

    def run(self, case: Case) -> dict[str, Any]:
        """Attack; how often, and what went wrong."""
        attack, _ = _ways()[case.way]
        made = list(attack(case.name, range(self.count)))
        return {"tried": len(made), "wrong": [list(each) for each in made if each is not None]}


def _ways() -> dict[str, tuple[Callable[[str, range], Iterator[Any]], Mapping[str, Any]]]:
    """Way -> its attack on a name with some seeds, and the names; imports all of the package."""
    from benchmarks.files.kinds import KINDS
    from benchmarks.files.spoilt import attacked
    from benchmarks.files.stopped import COMMANDS, interrupted, killed

    return {
        "spoilt": (attacked, KINDS),
        "killed": (killed, COMMANDS),
        "interrupted": (interrupted, COMMANDS),
    }
