"""The seams of the architecture, read off the imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "twosra_mpc"
MODULES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))

# Library -> where in the package it may be imported.
ALLOWED = {
    "casadi": ("model/", "planning/nlp/", "execution/tracking/"),
    "matplotlib": ("plotting/",),
    "tomlkit": ("robot/document.py", "identification/", "report/"),
    "jinja2": ("report/",),
    "osqp": ("execution/tracking/",),
    "serial": ("execution/serial/port.py",),
    "mcap": ("export/",),
    "click": ("cli/",),
    "rich": ("cli/",),
    "pydantic": (
        *("validation.py", "schema.py", "robot/", "problem/", "plans/document.py"),
        "execution/tracking/settings.py",
    ),
    "pydantic_core": ("validation.py",),
}
# Against the flow, inside a function: module and what it imports -> why.
AGAINST_THE_FLOW = {
    ("plans/plan.py", "twosra_mpc.plotting.notebook"): "a notebook shows a plan as its figure",
}
# Stages in the direction of flow; a module may import from its own stage and from those before it.
STAGES = [
    ("version.py", "errors.py", "files.py", "validation.py"),
    ("robot/",),
    ("thermal/", "model/"),
    ("control/",),
    ("identification/",),
    ("problem/",),
    ("timing/",),
    ("plans/heating.py", "planning/search/"),
    ("planning/nlp/",),
    ("plans/",),
    ("schema.py",),
    ("checking/",),
    ("planning/outcome.py",),
    ("reproduction/",),
    ("planning/",),
    ("analysis/",),
    ("execution/tracking/",),
    ("execution/",),
    ("export/",),
    ("plotting/",),
    ("report/",),
    ("__init__.py",),
    ("cli/",),
    ("__main__.py",),
]


def imports(module: str) -> Iterator[str]:
    for node in ast.walk(ast.parse((PACKAGE / module).read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def stage(module: str) -> int:
    found = [
        (len(name), i)
        for i, names in enumerate(STAGES)
        for name in names
        if module.startswith(name)
    ]
    assert found, f"{module} belongs to no stage"
    return max(found)[1]  # the longest name is the nearest one


@pytest.mark.parametrize("module", MODULES)
def test_libraries_stay_behind_their_seam(module: str) -> None:
    for name in imports(module):
        places = ALLOWED.get(name.split(".")[0])
        assert places is None or module.startswith(places), f"{module} imports {name}"


@pytest.mark.parametrize("module", MODULES)
def test_the_flow_has_one_direction(module: str) -> None:
    for name in imports(module):
        if name.startswith("twosra_mpc.") and (module, name) not in AGAINST_THE_FLOW:
            path = name.removeprefix("twosra_mpc.").replace(".", "/")
            target = f"{path}.py" if (PACKAGE / f"{path}.py").exists() else f"{path}/"
            assert stage(target) <= stage(module), f"{module} imports {name}"


def test_search_and_nlp_meet_only_in_the_bounds_interface() -> None:
    for module in MODULES:
        names = set(imports(module))
        if module.startswith("planning/search/"):
            assert not any(
                n.startswith(("twosra_mpc.planning.nlp", "twosra_mpc.model")) for n in names
            )
