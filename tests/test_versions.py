"""Floors of the dependencies, and the exact versions that are kept beside them, agree."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def asked() -> list[Requirement]:
    """Every direct dependency, those of the extras included."""
    extras = PROJECT["optional-dependencies"].values()
    every = [*PROJECT["dependencies"], *(line for extra in extras for line in extra)]
    found = [Requirement(line) for line in every]
    return [requirement for requirement in found if requirement.name != PROJECT["name"]]


def test_constraints_name_every_dependency_and_are_not_older_than_the_floors() -> None:
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    kept = dict(re.findall(r"^([a-z0-9-]+)==(\S+)$", text, flags=re.MULTILINE))
    assert len(asked()) > 20
    for requirement in asked():
        name = re.sub(r"[-_.]+", "-", requirement.name).lower()
        assert name in kept, f"{name}: write constraints.txt anew, as its head says"
        assert kept[name] in requirement.specifier, f"{name}: write constraints.txt anew"


def test_dependencies_have_a_floor_and_nothing_else() -> None:
    for requirement in asked():
        assert [each.operator for each in requirement.specifier] == [">="], requirement
