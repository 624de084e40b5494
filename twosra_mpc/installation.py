"""Installation of this package: its source, and how to add an extra from there."""

from __future__ import annotations

import json
import shlex
from importlib.util import find_spec
from typing import Any

from twosra_mpc.errors import InputError

DISTRIBUTION = "twosra-mpc"


def install_command(extra: str) -> str:
    """Return the command that adds an extra to this installation.

    A package index need not have the package: what was installed from a clone, an archive or a
    repository is installed from there again (as PEP 610 records it).

    Args:
        extra: Name of the extra, such as ``mcap``.
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


def require_flint() -> None:
    """Check that the interval arithmetic of proofs is installed.

    Raises:
        InputError: If it is not; says how to install it.
    """
    if find_spec("flint") is None:
        allowed = f"what is installed, or the package python-flint: {install_command('proof')}"
        raise InputError("--proof", "python-flint is missing", allowed)


def require_batch(field: str) -> None:
    """Check that what plans by the thousand is installed.

    Args:
        field: What needs it, for the message.

    Raises:
        InputError: If something is missing; says how to install it.
    """
    missing = [name for name in ("distributed", "pandas", "pyarrow") if find_spec(name) is None]
    if missing:
        allowed = f"any, once {', '.join(missing)} can be imported: {install_command('batch')}"
        raise InputError(field, f"{missing[0]} is missing", allowed)


def require_mujoco(field: str) -> None:
    """Check that the rigid-body engine is installed.

    Args:
        field: What needs it, for the message.

    Raises:
        InputError: If it is not; says how to install it.
    """
    if find_spec("mujoco") is None:
        allowed = f"another one, or the package mujoco: {install_command('physics')}"
        raise InputError(field, "mujoco is missing", allowed)
