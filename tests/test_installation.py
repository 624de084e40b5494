"""Hints that install what is missing, from where the package itself was installed."""

from __future__ import annotations

import importlib.metadata
import json

import pytest

from twosra_mpc.installation import install_command

COMMIT = "0123456789abcdef0123456789abcdef01234567"


class _Distribution:
    """An installed package with this record of where it came from."""

    def __init__(self, origin: object) -> None:
        self.origin = origin

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self.origin is None else json.dumps(self.origin)


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "pip install 'twosra-mpc[ros]'"),
        ({"url": "file:///src/mine", "dir_info": {}}, "pip install '/src/mine[ros]'"),
        (
            {"url": "file:///my%20src/mine", "dir_info": {"editable": True}},
            "pip install -e '/my src/mine[ros]'",
        ),
        (
            {"url": "file:///tmp/twosra_mpc-0.1.0-py3-none-any.whl", "archive_info": {}},
            "pip install 'twosra-mpc[ros] @ file:///tmp/twosra_mpc-0.1.0-py3-none-any.whl'",
        ),
        (
            {"url": "https://example.org/r.git", "vcs_info": {"vcs": "git", "commit_id": COMMIT}},
            f"pip install 'twosra-mpc[ros] @ git+https://example.org/r.git@{COMMIT}'",
        ),
    ],
    ids=["index", "clone", "editable clone", "archive", "repository"],
)
def test_an_extra_comes_from_where_the_package_came_from(
    monkeypatch: pytest.MonkeyPatch, origin: object, command: str
) -> None:
    monkeypatch.setattr(importlib.metadata, "distribution", lambda _: _Distribution(origin))
    assert install_command("ros") == command


def test_this_installation_has_a_command() -> None:
    assert install_command("ros").startswith("pip install ")
