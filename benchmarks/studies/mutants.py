"""Mistakes put into what proves: whether the tests beside it notice each.

Slacks are set to zero, sums become differences, the larger of two the lesser, comparisons their
opposite: one of these at a time, in a copy of the repository.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks.study import Count, Measured, Names, Study

ROOT = Path(__file__).parents[2]
_COPIED = ("twosra_mpc", "tests", "benchmarks", "examples", "pyproject.toml")
_LONGEST_S = 1800.0  # of a run of tests: a mutant that never ends is noticed, too
_BOUNDS = "twosra_mpc/planning/bounds"
# Module -> the tests beside it.
TESTS: dict[str, tuple[str, ...]] = {
    f"{_BOUNDS}/bends.py": ("test_bounds", "test_bending", "test_node_bounds", "test_tolerance"),
    f"{_BOUNDS}/sequence_bound.py": ("test_bounds", "test_motion_effort"),
    f"{_BOUNDS}/drive_bound.py": ("test_drive_bound",),
    f"{_BOUNDS}/linear_program.py": ("test_linear_program",),
    f"{_BOUNDS}/stage_bounds.py": ("test_missions", "test_node_bounds"),
    f"{_BOUNDS}/motion_bound.py": ("test_motion_bound",),
    f"{_BOUNDS}/pose_bound.py": ("test_pose_bound",),
    f"{_BOUNDS}/rigid_motion.py": ("test_rigid_motion",),
    f"{_BOUNDS}/schedule.py": ("test_timing", "test_bounds"),
    "twosra_mpc/model/bending.py": ("test_bending", "test_bounds"),
    "twosra_mpc/timing/network.py": ("test_timing", "test_motion_bound", "test_segment_timing"),
    "twosra_mpc/timing/overlapped.py": ("test_timing", "test_verification"),
    "twosra_mpc/thermal/heating.py": ("test_heating", "test_heating_plan"),
    "twosra_mpc/thermal/least_times.py": ("test_thermal_timing", "test_first_cycle"),
    "twosra_mpc/space/convex.py": ("test_slices",),
    "twosra_mpc/space/minkowski.py": ("test_slices",),
    "twosra_mpc/space/contour.py": ("test_object_plant",),
    "twosra_mpc/problem/tolerances.py": ("test_tolerance", "test_attack", "test_verify_command"),
    "twosra_mpc/checking/sweep.py": ("test_forged_plans", "test_checking_missions"),
    "twosra_mpc/checking/reintegration.py": ("test_verification", "test_forged_plans"),
    "twosra_mpc/checking/certificate.py": ("test_certificate",),
    "twosra_mpc/checking/events.py": ("test_certificate",),
    "twosra_mpc/checking/fibre.py": ("test_certificate",),
    "twosra_mpc/checking/legs.py": ("test_certificate",),
    "twosra_mpc/checking/heat.py": ("test_forged_plans", "test_verify_command"),
    "twosra_mpc/checking/plan_file.py": ("test_forged_plans", "test_verify_command"),
    "twosra_mpc/checking/verification.py": (
        *("test_verification", "test_forged_plans", "test_motion_effort"),
        "test_verify_command",
    ),
}
QUICK = (
    *(f"{_BOUNDS}/drive_bound.py", f"{_BOUNDS}/linear_program.py"),
    *("twosra_mpc/model/bending.py", "twosra_mpc/checking/sweep.py"),
)
_OPPOSITE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    **{ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt},
    **{ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
}
_PAIRS = (("max", "min"), ("maximum", "minimum"), ("floor", "ceil"))
_OTHER = {one: other for pair in _PAIRS for one, other in (pair, pair[::-1])}


class Case(NamedTuple):
    """A mutant: the ``number``-th place of a module that can be mistaken."""

    module: str
    number: int


@dataclass(frozen=True)
class MutantRecord:
    """What came of a mutant.

    Attributes:
        line: Where it is.
        before: What stood there.
        after: What stands there instead.
        lives: Whether all tests beside it pass.
    """

    line: int
    before: str
    after: str
    lives: bool


class Mutants(Study):
    """Random mutants of modules that prove or verify.

    Attributes:
        modules: Which modules, by default those whose tests are quick.
        count: Mutants of each.
    """

    record: ClassVar = TypeAdapter(MutantRecord)
    question: ClassVar = "Is every mistake in a proof noticed by the tests beside it?"
    measures: ClassVar = ("twosra_mpc", "tests")

    modules: Names = QUICK
    count: Count = 2

    def cases(self) -> Iterator[Case]:
        """Yield the mutants, module by module."""
        for module in self.modules:
            found = sum(1 for _ in places(_tree(module)))
            chosen = np.random.default_rng(0).permutation(found)[: self.count].tolist()
            yield from (Case(module, number) for number in chosen)

    def run(self, case: Case) -> MutantRecord:
        """Make the mistake and run the tests beside it."""
        tree = _tree(case.module)
        place = list(places(tree))[case.number]
        before, line = ast.unparse(place), place.lineno
        mistake(place)
        with tempfile.TemporaryDirectory() as folder:
            for name in _COPIED:
                copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
                copy(ROOT / name, Path(folder) / name)
            (Path(folder) / case.module).write_text(ast.unparse(tree), encoding="utf-8")
            tests = [f"tests/{name}.py" for name in TESTS[case.module]]
            lives = passes(tests, folder)
        return MutantRecord(line, before, ast.unparse(place), lives)

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Counts of each module, and those that live."""
        counts = {
            module: [each.record.lives for each in results if each.case.module == module]
            for module in self.modules
        }
        return {"counts": counts, "living": [each for each in results if each.record.lives]}


def passes(tests: Sequence[str], folder: str) -> bool:
    """Whether tests pass that run on the package in a folder."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": folder, "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, timeout=_LONGEST_S
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


@cache
def _source(module: str) -> str:
    return (ROOT / module).read_text(encoding="utf-8")


def _tree(module: str) -> ast.Module:
    return ast.parse(_source(module))


def places(tree: ast.Module) -> Iterator[ast.expr]:
    """What can be mistaken, in order: slacks of the module, then expressions in its functions."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name | ast.Tuple):
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            yield from (each for each in values if _is_slack(each))
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.expr) and _other(node))


def _other(node: ast.expr) -> bool:
    """Whether an expression is one that a mistake makes another one of."""
    match node:
        case ast.BinOp(op=ast.Add() | ast.Sub()):
            return True
        case ast.Compare(ops=[first, *_]):
            return type(first) in _OPPOSITE
        case ast.Call(func=function):
            return _name(function) in _OTHER
    return False


def mistake(place: ast.expr) -> None:
    """Make the one mistake that can be made at a place."""
    match place:
        case ast.Constant():
            place.value = 0.0
        case ast.BinOp():
            place.op = ast.Sub() if isinstance(place.op, ast.Add) else ast.Add()
        case ast.Compare():
            place.ops[0] = _OPPOSITE[type(place.ops[0])]()
        case ast.Call(func=ast.Attribute() as function):
            function.attr = _OTHER[function.attr]
        case ast.Call(func=ast.Name() as function):
            function.id = _OTHER[function.id]


def _is_slack(value: ast.expr) -> bool:
    """Whether it is a number so small that it can only be an allowance."""
    return isinstance(value, ast.Constant) and isinstance(value.value, float) and value.value < 0.01


def _name(function: ast.expr) -> str:
    match function:
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name
    return ""
