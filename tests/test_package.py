"""What ``import twosra_mpc`` offers, and what it leaves alone."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import twosra_mpc

SLOW = (
    *("numpy", "scipy", "casadi", "pydantic", "matplotlib", "jinja2", "osqp", "rich"),
    *("importlib.metadata", "urllib.request", "twosra_mpc.lab.analysis.explanation"),
)


@pytest.mark.parametrize("name", twosra_mpc.__all__)
def test_every_public_name_is_there(name: str) -> None:
    found = getattr(twosra_mpc, name)
    if callable(found):
        assert found.__doc__, f"{name} does not say what it is for"


def test_another_name_is_not_there() -> None:
    with pytest.raises(AttributeError, match="no attribute 'solve'"):
        twosra_mpc.solve  # noqa: B018  # it is the access that is tested


def test_in_a_zip_file_it_says_that_it_needs_a_folder(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as packed:
        packed.write(twosra_mpc.__file__, "twosra_mpc/__init__.py")
    code = f"import sys; sys.path.insert(0, {str(tmp_path / 'packed.zip')!r}); import twosra_mpc"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.splitlines()[-1].startswith("ImportError: twosra_mpc runs from a folder")


def test_the_import_leaves_slow_libraries_alone_until_they_are_needed() -> None:
    code = f"""
import sys, twosra_mpc
print([name for name in {SLOW!r} if name in sys.modules])
twosra_mpc.explain
print("twosra_mpc.lab.analysis.explanation" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n") == ["[]", "True", ""]


@pytest.mark.parametrize(
    ("arguments", "without"),
    [
        (["--version"], ("numpy", "pydantic", "rich", "importlib.metadata")),
        (["--help"], ("numpy", "pydantic", "rich", "importlib.metadata")),
        (["scenarios"], ()),
        (["robots", "--json"], ()),
    ],
    ids=lambda x: " ".join(x),
)
def test_commands_that_plan_nothing_load_no_solver(
    arguments: list[str], without: tuple[str, ...]
) -> None:
    done = loads(arguments, ("casadi", "scipy", "matplotlib", "osqp", "tomlkit", *without))
    assert done.stdout
    assert done.stderr == "[]\n"


def test_planning_loads_nothing_that_a_plan_does_not_need() -> None:
    unused = (
        *("scipy", "matplotlib", "PIL", "jinja2", "tomlkit", "osqp", "shapely"),
        *("urllib.request", "numpy.ma", "numpy.random", "asyncio"),
    )
    assert loads(["plan", "paper-2"], unused).stderr == "[]\n"


def loads(arguments: list[str], names: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own; which of these modules it loads is in ``stderr``."""
    code = f"""
import sys
from twosra_mpc import cli
try:
    cli.main({arguments!r})
except SystemExit as end:
    assert end.code == 0
print([name for name in {names!r} if name in sys.modules], file=sys.stderr)
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


def test_the_version_is_that_of_the_installed_package() -> None:
    assert twosra_mpc.__version__ == importlib.metadata.version("twosra-mpc")
