"""Nothing but the program's own words on standard output and error, whatever libraries print."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import click
import pytest
from forks import Forks
from once import cases, solved
from test_occupancy_map import write_map
from test_replay import TRIAL, TRIAL_1

from benchmarks.files.heating import true_history, write_log
from benchmarks.files.photographs import write_folder
from twosra_mpc import cli
from twosra_mpc.native_output import discarded_native_output

TWOSRA = [sys.executable, "-m", "twosra_mpc"]

QUICK = cases("native_output")["quick"]
QUIET = ("plan", "schema")


def ran(*command: str) -> tuple[int, str, str]:
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the commands read."""
    folder = tmp_path_factory.mktemp("folder")
    solved("rigid-move").save(folder / "plan.json")
    write_log(true_history((40.0,)).log(0.5), folder / "heating.csv")
    write_map(folder, [[0, 255], [255, 255]])
    write_folder(folder / "shots", [-30.0, 20.0])
    (folder / "exp1.csv").write_text(f"{TRIAL}\n{TRIAL_1}", encoding="utf-8")
    return folder


def test_no_command_that_has_json_is_forgotten() -> None:
    context = click.Context(cli.commands)
    found = {name: cli.commands.get_command(context, name) for name in cli._MODULES}
    has = {name for name, it in found.items() if it and any(p.name == "as_json" for p in it.params)}
    assert set(QUICK) == has


@pytest.mark.parametrize("name", QUICK)
def test_standard_output_is_one_json_document_and_standard_error_is_ours(
    name: str, forks: Forks, folder: Path
) -> None:
    given, code = QUICK[name]
    done = forks.run(name, *given.split(), "--json", folder=folder)
    out, err = done.stdout.decode(), done.stderr.decode()
    assert done.returncode == code, err
    if code == 0:
        json.loads(out)
        assert err == ""
    else:
        assert out == ""
        assert re.fullmatch(r"(twosra: |Error: |Usage: ).*\n", err, flags=re.DOTALL)
        assert "Traceback" not in err


@pytest.mark.parametrize("name", QUIET)
def test_quiet_is_quiet(name: str, forks: Forks, folder: Path) -> None:
    done = forks.run(name, *QUICK[name][0].split(), "-q", folder=folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


# A library that prints as compiled code does, from the middle of a command to the process's end.
NOISY = """
import ctypes, os, subprocess, sys
from twosra_mpc import __main__
from twosra_mpc.cli import descriptions as robots
def noisy(*given):
    libc = ctypes.CDLL(None)
    libc.puts(b"of a library's buffer")
    os.write(1, b"past Python's stream\\n")
    os.write(2, b"past Python's errors\\n")
    subprocess.run(["echo", "of a child"])
    return names(*given)

names, robots.robot_names = robots.robot_names, noisy
sys.argv[0] = "twosra"
__main__.main()
"""


def test_what_libraries_print_goes_nowhere_and_with_debug_to_standard_error() -> None:
    noisy = [sys.executable, "-c", NOISY, "robots", "--json"]
    code, out, err = ran(*noisy)
    assert (code, err) == (0, "")
    assert out == ran(*TWOSRA, "robots", "--json")[1]
    code, shown, err = ran(*noisy, "--debug")
    assert (code, shown) == (0, out)
    assert {"of a library's buffer", "past Python's stream", "of a child"} <= {*err.splitlines()}


def test_a_crash_is_told() -> None:
    crash = NOISY.replace("return names(*given)", "ctypes.string_at(0)")
    code, out, err = ran(sys.executable, "-c", crash, "robots")
    assert (code, out) == (-11, "")
    assert err.startswith("Fatal Python error: Segmentation fault")


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_error(closed: str, tmp_path: Path) -> None:
    """Nor is a file that is written mistaken for one of them."""
    target = tmp_path / "plan.json"
    shell = f"exec {' '.join(TWOSRA)} plan shape-change --out {target} {closed}"
    assert ran("sh", "-c", shell)[0] == 0
    json.loads(target.read_text(encoding="utf-8"))


def test_streams_are_whole_again_after_many_threads_have_discarded() -> None:
    """Of two blocks at once, the first to end must not take away what the other one kept."""

    def discard() -> None:
        for _ in range(200):
            with discarded_native_output():
                pass

    before = [os.fstat(stream)[:3] for stream in (1, 2)]
    threads = [threading.Thread(target=discard) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [os.fstat(stream)[:3] for stream in (1, 2)] == before


def test_linear_programs_print_nothing_in_other_programs() -> None:
    code = """
import numpy as np
from twosra_mpc.planning.bounds.linear_program import minimise
assert minimise(np.ones(1), -np.ones((1, 1)), -np.ones(1), [(0.0, None)]).cost == 1.0
"""
    assert ran(sys.executable, "-c", code) == (0, "", "")


def test_the_solver_prints_nothing_where_a_program_is_undefined() -> None:
    """CasADi warns of NaN, and of multipliers that cannot be had; on Python's own stream."""
    code = """
from types import SimpleNamespace
import casadi as ca
from twosra_mpc.planning.solver import multiple_shooting
from twosra_mpc.robot.description import load_robot
x, p = ca.MX.sym("x"), ca.MX.sym("p")
nlp = {"x": x, "p": p, "f": p * ca.log(x), "g": ca.sqrt(x)}
multiple_shooting.transcribe = lambda *_: SimpleNamespace(nlp=nlp)
_, solver, stopping = multiple_shooting.ipopt(load_robot("2sra-v1"), None, 1, 1, 1, 5)
solver(x0=-1.0, p=1.0, lbx=-2.0, ubx=-1.0)
"""
    assert ran(sys.executable, "-c", code) == (0, "", "")


def test_figures_are_quiet_where_nothing_can_be_kept(tmp_path: Path) -> None:
    (tmp_path / "file").touch()  # in which there is no folder, whoever asks
    nowhere = dict.fromkeys(("HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"), str(tmp_path / "file"))
    kept = {name: value for name, value in os.environ.items() if name != "MPLCONFIGDIR"}
    done = subprocess.run(
        [sys.executable, "-c", "import twosra_mpc.lab.figures"],
        env={**kept, **nowhere},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
