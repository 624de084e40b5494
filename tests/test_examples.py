"""The examples read as user's code should; they run when the site is built (``docs/hooks.py``)."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest

import twosra_mpc
from twosra_mpc import Robot, load_robot
from twosra_mpc.execution import RobotInterface

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
USER_SCRIPT = ROOT / "tests" / "user_script.py"

each_example = pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)


def used(path: Path) -> Iterator[tuple[str, str]]:
    """Module of this package, and name from it, of every import."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("twosra_mpc"):
            yield from ((str(node.module), alias.name) for alias in node.names)


def test_they_are_numbered() -> None:
    assert [int(path.name[:2]) for path in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))


@each_example
def test_the_example_is_short_and_says_what_it_shows(path: Path) -> None:
    text = path.read_text()
    longest = 150 if "ros2" in path.stem else 66  # a node has topics, an action and a simulation
    assert 10 <= len(text.splitlines()) <= longest
    assert ast.get_docstring(ast.parse(text))


@pytest.mark.parametrize("path", [*EXAMPLES, USER_SCRIPT], ids=lambda path: path.stem)
def test_only_public_names_are_used(path: Path) -> None:
    for module, name in used(path):
        assert name in importlib.import_module(module).__all__, f"{module}.{name}"


def test_every_public_record_is_built_and_type_checked() -> None:
    names = {name for path in (*EXAMPLES, USER_SCRIPT) for _, name in used(path)}
    classes = {name for name in twosra_mpc.__all__ if inspect.isclass(getattr(twosra_mpc, name))}
    returned = {"Explanation", "Kinematics", "PlanCheck", "RobotShape"}
    errors = {"ContradictionError", "NoPlanError", "PlanInterrupted", "TwosraError", "InputWarning"}
    assert classes - names == returned | errors


def test_a_driver_may_be_a_subclass_that_sets_its_attributes() -> None:
    class Driver(RobotInterface):
        robot: Robot

        def __init__(self, robot: Robot) -> None:
            self.robot = robot

    robot = load_robot("3sra")
    assert Driver(robot).robot is robot
