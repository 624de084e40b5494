"""The README runs: its commands, its Python, its scenario, and its table says what comes out."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from twosra_mpc import load_problem, plan
from twosra_mpc.robot.modes import mode_name

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_python_block_runs(tmp_path: Path) -> None:
    (code,) = blocks("python")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "optimal" in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"plan.json", "plan.png", "setpoints.csv"}


def test_the_main_command_runs_after_its_set_up(tmp_path: Path) -> None:
    command = next(block for block in blocks("sh") if "twosra plan" in block)
    steps = [step.strip() for step in command.split("&&")]
    assert steps[0] == "python3 -m venv .venv"
    assert steps[1].startswith(".venv/bin/pip install")
    arguments = steps[2].removeprefix(".venv/bin/twosra ").split()
    subprocess.run(
        [sys.executable, "-m", "twosra_mpc", *arguments],
        cwd=tmp_path,
        capture_output=True,
        check=True,
    )
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"plan.json", "setpoints.csv", "plan.png"}


def test_every_other_command_runs_in_the_order_given(tmp_path: Path) -> None:
    plan(load_problem("paper-1")).save(tmp_path / "plan.json")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    commands = [line.split(" #")[0].strip() for line in lines if line.startswith("twosra ")]
    assert len(commands) > 8
    for command in commands:
        done = subprocess.run(
            command,
            shell=True,
            cwd=tmp_path,
            env={**os.environ, "PATH": path},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{command}: {done.stderr}"
    for written in ("report.html", "plan.gif", "both.png", "run.png", "plan.mcap", "plan.csv"):
        assert (tmp_path / written).stat().st_size > 0


def test_the_scenario_is_planned(tmp_path: Path) -> None:
    (scenario,) = blocks("toml")
    path = tmp_path / "mine.toml"
    path.write_text(scenario)
    assert plan(load_problem(path)).found


@pytest.mark.parametrize("name", [f"paper-{n}" for n in range(1, 6)])
def test_the_table_says_what_comes_out(name: str) -> None:
    row = next(line for line in README.splitlines() if line.startswith(f"| {name} "))
    _, _, greedy_modes, greedy_time, modes, time, gap, _ = (c.strip() for c in row.split("|"))
    for planner, said_modes, said_time in (
        ("greedy", greedy_modes, greedy_time),
        ("optimal", modes, time),
    ):
        result = plan(load_problem(name, planner=planner)).require()
        assert said_modes == f"`{' '.join(mode_name(phase.mode) for phase in result.phases)}`"
        assert said_time == f"{result.duration_s:.1f} s"
        if result.gap is not None:
            assert 100 * result.gap <= float(gap.removesuffix(" %")) * 1.3


def test_every_link_leads_somewhere() -> None:
    for target in re.findall(r"\]\(([^)]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target
