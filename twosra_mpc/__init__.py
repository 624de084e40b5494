"""twosra_mpc: plans with a proved gap for soft-rigid robots that melt their spine (2SRA).

Examples:
    >>> from twosra_mpc import load_problem, plan
    >>> result = plan(load_problem("paper-1"))
    >>> result.status, result.gap
"""

from __future__ import annotations

import ast
import gc
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def exported(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package whose stub has its public names.

    They are imported when they are first asked for: solvers and matplotlib take a second to load.
    """
    own = sys.modules[package]
    stub = ast.parse(Path(own.__file__ or "").with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [each for each in stub.body if isinstance(each, ast.ImportFrom)]
    modules = {name.name: str(each.module) for each in imports for name in each.names}

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = vars(own)[name] = getattr(_loaded(modules[name]), name)
        return value

    return get, lambda: sorted({*vars(own), *modules}), sorted(modules)


def _loaded(module: str) -> Any:
    """Import a module; to look for garbage meanwhile takes an eighth of the time, for nothing."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        return importlib.import_module(module)
    finally:
        if collecting:
            gc.enable()


__getattr__, __dir__, __all__ = exported(__name__)
