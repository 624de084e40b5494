"""``python tests/attack [COUNT]``: spoil many files of each kind, and print what went wrong."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1]))

from attack.mutations import MUTATIONS
from attack.spoilt_files import KINDS, attacked


def attack(count: int) -> bool:
    """Spoil about ``count`` files of each kind; whether none went wrong."""
    console, seeds = Console(), range(-(-count // len(MUTATIONS)))
    table, found = Table("file", "tried", "deviations"), []
    for kind in KINDS:
        total = len(seeds) * len(MUTATIONS)
        made = track(attacked(kind, seeds), kind, total=total, console=Console(stderr=True))
        wrong = [each for each in made if each is not None]
        table.add_row(kind, str(total), str(len(wrong)))
        found += wrong
    console.print(table)
    for each in found:
        console.print(f"{each.kind}, {each.mutation}, seed {each.seed}: {each.what}", markup=False)
    return not found


if __name__ == "__main__":
    sys.exit(0 if attack(int(sys.argv[1]) if len(sys.argv) > 1 else 100) else 1)
