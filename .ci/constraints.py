"""Print what is installed here of all that pyproject.toml asks for, however indirectly."""

import platform
import re
import tomllib
from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement

HEAD = f"""\
# Exact versions of where .ci/constraints.py was run, on Python {platform.python_version()}.
# .ci/run does that after all tests have passed; by hand:
#   .venv/bin/python .ci/constraints.py > constraints.txt
# To install these versions from a clone:  pip install -c constraints.txt '.[batch,proof]'
# Without this file, pip takes the newest versions that pyproject.toml allows."""


def add(line: str, extras: frozenset[str], found: dict[tuple[str, frozenset[str]], str]) -> None:
    """Add a requirement of something with these extras, and what that requires in turn."""
    asked = Requirement(line)
    if asked.marker and not any(asked.marker.evaluate({"extra": e}) for e in (*extras, "")):
        return
    key = re.sub(r"[-_.]+", "-", asked.name).lower(), frozenset(asked.extras)
    if key in found or key[0] == "twosra-mpc":
        return
    here = distribution(asked.name)
    found[key] = here.version
    for further in here.requires or []:
        add(further, key[1], found)


project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
found: dict[tuple[str, frozenset[str]], str] = {}
for lines in (project["dependencies"], *project["optional-dependencies"].values()):
    for line in lines:
        add(line, frozenset(), found)
print(HEAD, *sorted({f"{name}=={version}" for (name, _), version in found.items()}), sep="\n")
