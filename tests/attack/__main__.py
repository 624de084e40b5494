"""``python tests/attack [COUNT [NAME ...]]``: attack the program, and print what went wrong.

COUNT files of each kind are spoilt, a quarter as many commands killed, and a fifth interrupted.
Ctrl-C ends it early.
"""

from __future__ import annotations

import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[1]))

from attack.mutations import MUTATIONS
from attack.spoilt_files import KINDS, attacked
from attack.stopped import COMMANDS, interrupted, killed


def attacks(count: int) -> dict[str, tuple[int, Any]]:
    """What is attacked, how often, and what yields the outcomes."""
    seeds = range(-(-count // len(MUTATIONS)))
    kills, interrupts = (range(-(-count // (each * len(COMMANDS)))) for each in (4, 5))
    total = len(seeds) * len(MUTATIONS)
    found: dict[str, tuple[int, Any]] = {
        kind: (total, partial(attacked, kind, seeds)) for kind in KINDS
    }
    found |= {f"kill {name}": (len(kills), partial(killed, name, kills)) for name in COMMANDS}
    found |= {
        f"interrupt {name}": (len(interrupts), partial(interrupted, name, interrupts))
        for name in COMMANDS
    }
    return found


def attack(count: int, names: list[str]) -> bool:
    """Attack, and print a table, after Ctrl-C of what was tried; whether nothing went wrong."""
    console, found = Console(), dict[str, list[Any]]()
    asked = list[bool]()  # noted only: what is attacked must not take it for its own
    signal.signal(signal.SIGINT, lambda *_: asked.append(True))
    for name, (total, outcomes) in attacks(count).items():
        if asked or (names and name not in names):
            continue
        made = found[name] = []
        for outcome in track(outcomes(), name, total, console=Console(stderr=True)):
            made.append(outcome)
            if asked:
                break
    table = Table("attack", "tried", "deviations")
    for name, made in found.items():
        wrong = [each for each in made if each is not None]
        table.add_row(name, str(len(made)), str(len(wrong)))
        for each in wrong:
            console.print(*each, sep=", ", markup=False)
    console.print(table)
    return not any(each for made in found.values() for each in made)


if __name__ == "__main__":
    count, *names = [*sys.argv[1:], "100"][: max(1, len(sys.argv) - 1)]
    sys.exit(0 if attack(int(count), names) else 1)
