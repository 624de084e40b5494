"""The reference: every public name once a module, every attribute with a sentence and its unit."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from twosra_mpc.keys import describe

PAGES = sorted((Path(__file__).parent.parent / "docs" / "reference").glob("*.md"))
MODULES = [
    f"twosra_mpc{suffix}"
    for suffix in (
        *("", ".execution", ".execution.tracking", ".plotting", ".lab.batch", ".lab.figures"),
        *(".lab.identification", ".lab.paper", ".lab.report", ".lab.serial", ".lab.studio"),
    )
]


def listed(text: str) -> list[tuple[str, list[str]]]:
    """Each module that a page shows, with its members there; without a list it shows them all."""
    found = []
    for module, options in re.findall(r"^::: ([\w.]+)\n((?:    .*\n)*)", text, flags=re.MULTILINE):
        members = re.search(r"members: \[([^\]]*)\]", options)
        names = members[1].replace(",", " ").split() if members else None
        found.append((module, names or importlib.import_module(module).__all__))
    return found


SHOWN = [entry for page in PAGES for entry in listed(page.read_text(encoding="utf-8"))]
RECORDS = {
    getattr(importlib.import_module(module), name)
    for module, names in SHOWN
    for name in names
    if inspect.isclass(getattr(importlib.import_module(module), name, None))
}


@pytest.mark.parametrize("module", MODULES)
def test_nothing_public_is_missing_and_nothing_is_there_twice(module: str) -> None:
    names = [name for other, names in SHOWN if other == module for name in names]
    public = [name for name in importlib.import_module(module).__all__ if name[0] != "_"]
    assert sorted(names) == sorted(public)


def test_every_key_of_a_record_has_a_sentence() -> None:
    """Where a docstring has no section, the schema's words are shown; names say their units."""
    records = [record for record in RECORDS if issubclass(record, BaseModel)]
    keys = {
        key
        for record in records
        if "Attributes:" not in (record.__doc__ or "")
        for key in record.model_fields
    }
    assert not {key for key in keys if describe(key) == key.replace("_", " ")}


@pytest.mark.parametrize("record", sorted(RECORDS, key=str), ids=lambda record: record.__name__)
def test_a_section_on_attributes_leaves_none_out(record: type) -> None:
    text = inspect.getdoc(record) or ""
    assert text
    if "\nAttributes:" in text:
        said = set(re.findall(r"^    (\w+): ", text.split("\nAttributes:")[1], flags=re.MULTILINE))
        own = {name for name in inspect.get_annotations(record) if name[0] != "_"}
        assert own <= said
