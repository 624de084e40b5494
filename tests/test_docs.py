"""All prose runs: every command, Python block and titled file of README and the documentation."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from conftest import Run
from distributed import Client, LocalCluster
from matplotlib.figure import Figure
from once import solved
from test_cli_output import examples

from twosra_mpc import Plan, Problem, Result, load_problem, load_robot, plotting
from twosra_mpc.cli import options
from twosra_mpc.lab.batch import workers
from twosra_mpc.lab.batch.problems import Problems
from twosra_mpc.lab.batch.spec import load_spec
from twosra_mpc.lab.paper import applications, statistics
from twosra_mpc.lab.reproduction.published_runs import Kind, RandomRun, random_runs
from twosra_mpc.planning.proof import Prover
from twosra_mpc.plans.branches import Policy
from twosra_mpc.plotting import film

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "twosra_mpc"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
README = PAGES[0]
GALLERY = ROOT / "docs" / "gallery.md"  # its figures are drawn when the site is built
WRITTEN = (".png", ".gif", ".csv", ".html", ".mcap", ".json")


class Block(NamedTuple):
    """A fenced block: its language, the title after it, and what it holds."""

    language: str
    title: str | None
    text: str


def blocks(page: Path) -> list[Block]:
    found = re.findall(
        r'^```(\w+)(?: title="([^"]*)")?\n(.*?)^```$',
        page.read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    return [Block(language, title or None, text) for language, title, text in found]


def commands(page: Path) -> list[str]:
    """Every line of the shell blocks that runs the program, without its comment."""
    lines = [line for b in blocks(page) if b.language == "sh" for line in b.text.splitlines()]
    return [line.split(" #")[0].strip() for line in lines if line.startswith("twosra ")]


# A command that several pages show is run once, as on the first of them; if it is an example of its
# help and names no scenario, which would be a quicker one there, with those (test_cli_output).
HELPED = {e for name in ("export", "jog", "report", "stream", "verify") for e in examples(name)}
COMMANDS = {
    command: page
    for page in reversed(PAGES)
    for command in reversed(commands(page))
    if command not in HELPED
}
PYTHON = [
    pytest.param(page, block.text, id=f"{page.stem}-{number}")
    for page in PAGES
    if page not in (README, GALLERY)
    for number, block in enumerate(blocks(page))
    if block.language == "python"
]
TITLED = [
    pytest.param(block, id=f"{page.stem}-{block.title}")
    for page in PAGES
    for block in blocks(page)
    if block.language == "toml" and block.title
]


@pytest.fixture(scope="module")
def proved() -> Result:
    """A plan that carries its proof."""
    result, bound = solved("paper-1"), solved("paper-1").require().lower_bound
    assert bound is not None
    return replace(result, certificate=Prover(result.problem).certificate(bound))


@pytest.fixture
def folder(proved: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a plan that carries its proof, in which the reader is."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(film, "FRAMES_PER_S", 0.5)  # films are long, and all frames alike
    monkeypatch.setattr(options, "load_problem", load_briefly)
    monkeypatch.setattr(workers, "local_cluster", cluster_here)
    monkeypatch.setattr(plotting, "plot_plan", blank)
    monkeypatch.setattr(statistics, "random_runs", few_runs)
    monkeypatch.setattr(applications, "SCENARIOS", {"conform-cylinder": "conform to a cylinder"})
    proved.save(tmp_path / "plan.json")
    return tmp_path


NEAR = {"goal": {"x_m": 0.02, "y_m": 0.0}}


def load_briefly(asked: str, **overrides: Any) -> Problem:
    """Load a scenario for which the first plan will do."""
    return load_problem(asked, **{"work_limit": 4500.0, "gap": 0.9, **overrides})


def blank(_: Plan, path: Path | None = None, __: Policy | None = None) -> Figure:
    """A figure that takes no time; the real ones have tests of their own."""
    figure = Figure(figsize=(1, 1))
    if path is not None:
        figure.savefig(path)
    return figure


@contextmanager
def cluster_here(_workers: int | None) -> Iterator[Client]:
    """A worker in this process, which need not import all that there is."""
    with (
        LocalCluster(1, 1, processes=False, dashboard_address=":0") as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def few_runs(_problems: int, kind: Kind) -> list[RandomRun]:
    return random_runs(3, kind)


def write_files(page: Path, folder: Path) -> None:
    for block in blocks(page):
        if block.title and block.language == "toml":
            (folder / block.title).write_text(block.text)


def test_there_is_something_to_run() -> None:
    assert len(COMMANDS) > 15
    assert len(PYTHON) > 2
    assert len(TITLED) > 1


@pytest.mark.parametrize("command", COMMANDS)
def test_the_command_runs(
    command: str, folder: Path, run_as_is: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = COMMANDS[command]
    if command.startswith("twosra simulate "):  # runs in which metal melts have tests of their own
        monkeypatch.setattr(
            options, "load_problem", lambda _, **more: load_briefly("rigid-move", **NEAR, **more)
        )
    monkeypatch.setattr("twosra_mpc.lab.studio.server.Server.serve", lambda server: server.close())
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    write_files(page, folder)
    before = commands(page)[: commands(page).index(command)]
    for new in (each for each in before if each.startswith("twosra new ")):  # files it begins with
        assert run_as_is(*shlex.split(new)[1:]).code == 0
    line, _, redirected = command.partition(" > ")
    words = shlex.split(line)[1:]
    code, out, err = run_as_is(*words)
    assert code == 0, err
    assert out or "--quiet" in words
    assert not redirected or out.startswith("{")
    for word in words[1:]:
        if word.endswith(WRITTEN):
            assert (folder / word).stat().st_size > 0


@pytest.mark.parametrize(("page", "code"), PYTHON)
def test_the_python_runs(page: Path, code: str, folder: Path) -> None:
    write_files(page, folder)
    exec(compile(code, str(page), "exec"), {})


@pytest.mark.parametrize("block", TITLED)
def test_the_file_is_valid(block: Block, tmp_path: Path) -> None:
    path = tmp_path / str(block.title)
    path.write_text(block.text)
    keys = tomllib.loads(block.text).keys()
    if {"goal", "tasks"} & keys:
        load_problem(path)
    elif {"random", "grid"} & keys:
        assert Problems(load_spec(path), tmp_path)
    else:
        load_robot(path)


def test_the_impossible_is_explained_as_the_guide_says(tmp_path: Path) -> None:
    (block,) = (b for b in blocks(ROOT / "docs/guide/explain.md") if b.title == "impossible.toml")
    path = tmp_path / "impossible.toml"
    path.write_text(block.text)
    result = solved(path)
    assert result.status == "infeasible"
    assert "segment 2" in result.message


def test_every_folder_has_its_line_in_the_architecture() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    said = set(re.findall(r"`(\w+)/`", text.split("## Where to start")[0]))
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert packages <= said
    inner = {path.parent.name for path in PACKAGE.glob("*/*/__init__.py")}
    assert said <= packages | inner
