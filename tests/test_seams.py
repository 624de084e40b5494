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
    "casadi": ("model/", "nlp/", "motion.py", "tracking/"),
    "matplotlib": ("plotting/",),
    "tomlkit": ("robot_document.py", "path_choice.py", "thermal/identified_robot.py", "report/"),
    "jinja2": ("report/",),
    "osqp": ("tracking/",),
    "serial": ("streaming/port.py",),
    "mcap": ("export/",),
    "click": ("cli/",),
    "rich": ("cli/",),
    "pydantic": (
        *("validation.py", "segment.py", "robot.py", "problem.py", "plan.py", "schema.py"),
        "tracking/settings.py",
    ),
    "pydantic_core": ("validation.py",),
}
# Stages in the direction of flow; a module may import from its own stage and from those before it.
STAGES = [
    ("version.py", "errors.py", "modes.py", "files.py", "validation.py"),
    ("segment.py",),
    ("robot.py",),
    ("path_fitting.py", "robot_shape.py", "robot_document.py"),
    ("path_choice.py",),
    ("thermal/",),
    ("problem.py",),
    ("model/",),
    ("shape.py", "timing/"),
    ("heating.py",),
    ("motion.py", "search/"),
    ("nlp/",),
    ("plan.py",),
    ("setpoints.py", "transition_check.py", "schema.py"),
    ("verification.py",),
    ("plan_check.py", "resampling.py"),
    ("outcome.py",),
    ("greedy/",),
    ("planner.py",),
    ("model_comparison.py",),
    ("critical_path.py", "transition_speed.py"),
    ("explanation.py",),
    ("tracking/",),
    ("execution/",),
    ("export/", "streaming/"),
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
    found = [i for i, names in enumerate(STAGES) if any(module.startswith(n) for n in names)]
    assert len(found) == 1, f"{module} belongs to no stage, or to several: {found}"
    return found[0]


@pytest.mark.parametrize("module", MODULES)
def test_libraries_stay_behind_their_seam(module: str) -> None:
    for name in imports(module):
        places = ALLOWED.get(name.split(".")[0])
        assert places is None or module.startswith(places), f"{module} imports {name}"


@pytest.mark.parametrize("module", MODULES)
def test_the_flow_has_one_direction(module: str) -> None:
    for name in imports(module):
        if name.startswith("twosra_mpc."):
            path = name.removeprefix("twosra_mpc.").replace(".", "/")
            target = f"{path}.py" if (PACKAGE / f"{path}.py").exists() else f"{path}/"
            assert stage(target) <= stage(module), f"{module} imports {name}"


def test_search_and_nlp_meet_only_in_the_bounds_interface() -> None:
    for module in MODULES:
        names = set(imports(module))
        if module.startswith("search/"):
            assert not any(n.startswith(("twosra_mpc.nlp", "twosra_mpc.model")) for n in names)
