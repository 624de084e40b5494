"""What the numbers depend on besides the suite: machine, versions and the planner's own source."""

from __future__ import annotations

import hashlib
import os
import platform
from importlib.metadata import version
from pathlib import Path

import twosra_mpc

PACKAGES = ("casadi", "numpy", "scipy", "pydantic", "matplotlib")
_CPU_INFO = Path("/proc/cpuinfo")


def machine() -> dict[str, str]:
    """Describe the machine."""
    return {
        "cpu": f"{_cpu_name()}, {os.cpu_count()} logical CPUs",
        "system": f"{platform.system()} {platform.machine()}",
    }


def versions() -> dict[str, str]:
    """Return the versions of everything that takes part in a run.

    ``source`` names the planner's and the problem sets' files by their content: a plan may change
    without a new version.
    """
    return {
        "python": platform.python_version(),
        "twosra_mpc": twosra_mpc.__version__,
        "source": source_digest(),
        **{name: version(name) for name in PACKAGES},
    }


def source_digest() -> str:
    """Digest of the planner's and the problem sets' source files, 12 hexadecimal digits."""
    package = Path(twosra_mpc.__file__).parent
    digest = hashlib.sha256()
    for folder in (package, Path(__file__).parent / "sets"):
        for path in sorted(folder.rglob("*")):
            if path.suffix in (".py", ".toml"):
                digest.update(path.relative_to(folder).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _cpu_name() -> str:
    if _CPU_INFO.is_file():
        for line in _CPU_INFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown CPU"
