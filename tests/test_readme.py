"""What README says comes out does; its further commands are run with those of the documentation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from once import solved
from test_docs import COMMANDS

from twosra_mpc.robot.modes import mode_name

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
MEASUREMENTS = (ROOT / "docs" / "measurements.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_python_block_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (code,) = blocks("python")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert "optimal" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"plan.json", "plan.png", "setpoints.csv"}


def test_the_main_command_is_run_after_its_set_up() -> None:
    command = next(block for block in blocks("sh") if "twosra plan" in block)
    steps = [step.strip() for step in command.split("&&")]
    assert steps[0] == "python3 -m venv .venv"
    assert steps[1].startswith(".venv/bin/pip install")
    assert steps[2].removeprefix(".venv/bin/") in COMMANDS  # which test_docs runs


def test_the_scenario_is_planned(tmp_path: Path) -> None:
    (scenario,) = blocks("toml")
    path = tmp_path / "mine.toml"
    path.write_text(scenario)
    assert solved(path).found


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("name", [f"paper-{n}" for n in range(1, 6)])
def test_the_table_says_what_comes_out(name: str, exact: bool) -> None:
    text = MEASUREMENTS if exact else README
    row = next(line for line in text.splitlines() if line.startswith(f"| {name} "))
    _, _, greedy_modes, greedy_time, modes, fastest, gentle, _ = map(str.strip, row.split("|"))
    fastest, said_gap = fastest.removesuffix(" %)").split(" (")
    for choice, said_modes, said_time in (
        ({"planner": "greedy"}, greedy_modes, greedy_time),
        ({"motion": "fastest"}, modes, fastest),
        ({}, modes, gentle),
    ):
        result = solved(name, exact=exact, **choice).require()
        assert said_modes == f"`{' '.join(mode_name(phase.mode) for phase in result.phases)}`"
        assert said_time == f"{result.duration_s:.1f} s"
        if "motion" in choice:
            assert 100 * result.gap <= float(said_gap) * 1.3


def test_every_link_leads_somewhere() -> None:
    for target in re.findall(r"\]\(([^)]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target
