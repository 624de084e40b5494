"""The package's version, where it was installed from, and how to add an extra from there."""

from __future__ import annotations

import json
import shlex
from importlib.util import find_spec
from typing import Any

from twosra_mpc.errors import MISSING, InputError

__version__ = "0.1.0"  # written here, and read by what builds the package
DISTRIBUTION = "twosra-mpc"
BATCH = ("distributed", "pandas", "pyarrow")  # packages that it needs
_MODULES = {  # package -> its module, where that is called otherwise
    **{"mcap-ros2-support": "mcap_ros2", "pyserial": "serial"},
    **{"python-flint": "flint", "scikit-image": "skimage"},
}


def install_command(extra: str) -> str:
    """Return the command that adds an extra to this installation.

    A package index need not have the package: what was installed from a clone, an archive or a
    repository is installed from there again (as PEP 610 records it).

    Args:
        extra: Name of the extra, such as ``ros``.
    """
    from importlib.metadata import distribution  # it and urllib take as long as a plan

    return f"pip install {_source(distribution(DISTRIBUTION).read_text('direct_url.json'), extra)}"


def _source(direct_url: str | None, extra: str) -> str:
    """Argument of pip: the name alone if it came from an index, else where it came from."""
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    named = f"{DISTRIBUTION}[{extra}]"
    if direct_url is None:
        return shlex.quote(named)
    origin: dict[str, Any] = json.loads(direct_url)
    url = origin["url"]
    if "dir_info" in origin:
        folder = shlex.quote(f"{url2pathname(urlsplit(url).path)}[{extra}]")
        return f"-e {folder}" if origin["dir_info"].get("editable") else folder
    if "vcs_info" in origin:
        url = f"{origin['vcs_info']['vcs']}+{url}@{origin['vcs_info']['commit_id']}"
    return shlex.quote(f"{named} @ {url}")


def require(use: str, extra: str, *packages: str) -> None:
    """Check that the packages of an extra are installed.

    Args:
        use: What needs them, for the message.
        extra: Its name.
        packages: Names of the packages.

    Raises:
        InputError: Names the first that is missing, what needs it, and how to install it.
    """
    for package in packages:
        if find_spec(_MODULES.get(package, package)) is None:
            needed = f"{use} needs this package: {install_command(extra)}"
            raise InputError(package, MISSING, needed)
