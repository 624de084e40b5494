"""``twosra doctor``: what works passes, and whatever is broken is a line that says so."""

from __future__ import annotations

import json
from functools import partial
from importlib import metadata
from typing import Any

import pytest
from conftest import Run

from twosra_mpc import __version__, plan
from twosra_mpc.cli import doctor
from twosra_mpc.installation import install_command

TEST = "self-test: a plan is made, tracked, written, read and verified"


@pytest.fixture
def run(run: Run) -> Run:
    """Run ``twosra doctor``; see ``conftest``."""
    return partial(run, "doctor")


def requires(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    """Let the installed package require these."""
    monkeypatch.setattr(metadata, "requires", lambda _: list(lines))


@pytest.fixture
def no_planning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what takes time."""
    monkeypatch.setattr(doctor, "self_test", lambda: "verified")


def test_a_sound_installation_passes(run: Run) -> None:
    code, out, err = run()
    assert (code, err) == (0, ""), out
    assert f"twosra-mpc {__version__}" in out
    for name in ("casadi", "scipy", "pydantic"):
        assert f"PASS {name} {metadata.version(name)}" in out
    assert "PASS self-test: a plan is made, tracked, written, read and verified IPOPT: " in out
    assert "FAIL" not in out


@pytest.mark.usefixtures("no_planning")
class TestWithoutPlanning:
    """What does not depend on the solvers."""

    def test_a_program_reads_json(self, run: Run) -> None:
        code, out, err = run("--json")
        assert (code, err) == (0, "")
        found = json.loads(out)
        assert found["ok"] is True
        assert found["findings"][-1] == {"what": TEST, "verdict": "PASS", "details": "verified"}

    def test_quiet_leaves_the_exit_code(self, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
        assert run("--quiet") == (0, "", "")
        requires(monkeypatch, "numpy>=99")
        assert run("--quiet") == (4, "", "")

    def test_an_old_package_fails(self, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
        requires(monkeypatch, "numpy>=99.1", "scipy")
        code, out, _ = run()
        assert code == 4
        assert f"FAIL numpy RuntimeError: {metadata.version('numpy')} is too old" in out
        assert "at least 99.1" in out
        assert f"PASS scipy {metadata.version('scipy')}" in out

    def test_a_missing_package_fails(self, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
        requires(monkeypatch, "no-such-package>=1.0")
        code, out, _ = run()
        assert code == 4
        assert "FAIL no-such-package PackageNotFoundError" in out

    def test_a_missing_extra_says_how_to_install_it(
        self, run: Run, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        requires(
            monkeypatch,
            "numpy>=1.26; extra == 'there'",
            "no-such-package>=1.0 ; extra == 'away'",
            'numpy ; extra == "away"',
        )
        code, out, _ = run()
        assert code == 0
        assert "PASS extra: there numpy" in out
        how = f"{install_command('away')} (missing: no-such-package)"
        assert f"none extra: away {how}" in out

    def test_a_package_that_is_not_installed_fails(
        self, run: Run, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def missing(name: str) -> Any:
            raise metadata.PackageNotFoundError(name)

        monkeypatch.setattr(metadata, "requires", missing)
        code, out, _ = run()
        assert code == 4
        assert "FAIL packages not known: install twosra-mpc with pip" in out

    def test_ffmpeg_is_no_must(self, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(doctor.shutil, "which", lambda _: None)
        code, out, _ = run()
        assert code == 0
        assert "none ffmpeg films as mp4 need it" in out
        monkeypatch.setattr(doctor.shutil, "which", lambda _: "/usr/bin/ffmpeg")
        assert "PASS ffmpeg /usr/bin/ffmpeg" in run().out


def test_a_planner_that_fails_is_a_line(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> Any:
        raise RuntimeError("Plugin 'ipopt' is not found\nwith a long list of paths")

    monkeypatch.setattr(doctor, "plan", broken)
    code, out, _ = run()
    assert code == 4
    assert f"FAIL {TEST} RuntimeError: Plugin 'ipopt' is not found" in out
    assert "long list" not in out


def test_a_plan_without_the_nonlinear_program_does_not_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    easy = lambda problem: plan(problem.with_values(gap=0.5))  # noqa: E731
    monkeypatch.setattr(doctor, "plan", easy)
    with pytest.raises(RuntimeError, match="of no use"):
        doctor.self_test()
