"""Suites by name: TOML files in ``benchmarks/suites``, or anywhere by path."""

from __future__ import annotations

from pathlib import Path

from benchmarks.cold_start import ColdStart
from benchmarks.comparison import Comparison
from benchmarks.growth import Growth
from benchmarks.suite import Suite
from benchmarks.transition_sweep import TransitionSweep
from twosra_mpc import InputError
from twosra_mpc.files import read_document

FOLDER = Path(__file__).parent / "suites"
KINDS: dict[str, type[Suite]] = {
    "comparison": Comparison,
    "transition-sweep": TransitionSweep,
    "growth": Growth,
    "cold-start": ColdStart,
}


def suite_names() -> list[str]:
    """Names of the suites that come with the benchmarks."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_suite(source: str) -> tuple[str, Suite]:
    """Load a suite by name, or from a TOML file by path; return its name and the suite.

    Raises:
        InputError: If there is no such suite, or its file is wrong; the message names the key.
    """
    named = FOLDER / f"{source}.toml"
    path = named if source in suite_names() else Path(source)
    if not path.is_file():
        allowed = f"one of {', '.join(suite_names())}, or the path of a suite's TOML file"
        raise InputError("name", source, allowed)
    document = read_document(path, source)
    kind = document.pop("kind", "missing")
    if kind not in KINDS:
        raise InputError("kind", kind, f"one of {', '.join(KINDS)}", source)
    return path.stem, KINDS[kind].parse(document, source)
