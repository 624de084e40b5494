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

    Raises:
        ImportError: If the package is in an archive, where what stands beside its modules is none.
    """
    own = sys.modules[package]
    path = Path(own.__file__ or "").with_suffix(".pyi")
    if not path.is_file():
        raise ImportError(f"twosra_mpc runs from a folder, not from a zip file: {path} is no file")
    stub = ast.parse(path.read_text(encoding="utf-8"))
    imports = [each for each in stub.body if isinstance(each, ast.ImportFrom)]
    modules = {name.name: str(each.module) for each in imports for name in each.names}

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"{package!r} has no attribute {name!r}", name=name, obj=own)
        thresholds = gc.get_threshold()
        gc.set_threshold(0)  # looking for garbage meanwhile takes an eighth of the time
        try:
            module = importlib.import_module(modules[name])
        finally:
            gc.set_threshold(*thresholds)
        return vars(own).setdefault(name, getattr(module, name))

    return get, lambda: sorted({*vars(own), *modules}), sorted(modules)


__getattr__, __dir__, __all__ = exported(__name__)
