"""The notebooks run from start to end without a warning, and say what they are saved with."""

from __future__ import annotations

import contextlib
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import nbformat
import pytest
from IPython.core.displayhook import DisplayHook
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import CapturedIO, capture_output
from nbformat import NotebookNode
from test_reproduce import draw_little
from traitlets.config import Config

from twosra_mpc.plotting import film

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
LARGEST_BYTES = 1_000_000

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


class Shown(DisplayHook):
    """Shows the value of a cell as ``display`` would, without a prompt."""

    def write_output_prompt(self) -> None:
        """There is none."""

    def write_format_data(
        self, format_dict: dict[str, Any], md_dict: dict[str, Any] | None = None
    ) -> None:
        self.shell.display_pub.publish(data=format_dict, metadata=md_dict)


class Shell(InteractiveShell):
    """Runs cells in this process, whose packages and kinematics need not be loaded again."""

    displayhook_class = Shown

    def enable_gui(self, gui: str | None = None) -> None:
        """There is none: figures are shown in the notebook."""


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shell]:
    """A shell in an unrelated folder: warnings are errors, films short, reports not drawn."""
    monkeypatch.chdir(tmp_path)
    draw_little(monkeypatch)
    monkeypatch.setattr(film, "FRAMES_PER_S", 0.5)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(sys.modules, "__main__", sys.modules["__main__"])  # a shell has its own
    backend = plt.get_backend()
    with contextlib.ExitStack() as stack:
        stack.enter_context(plt.rc_context())
        stack.callback(plt.switch_backend, backend)
        stack.callback(Shell.clear_instance)
        made = Shell.instance(config=Config({"HistoryManager": {"enabled": False}}))
        stack.callback(made.restore_sys_module_state)
        yield made


def run_cell(shell: Shell, code: str) -> CapturedIO:
    """Run one cell and keep what it shows."""
    with capture_output() as shown:
        done = shell.run_cell(code)
    done.raise_error()
    assert not shown.stderr
    return shown


def code_cells(notebook: NotebookNode) -> list[NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def saved_texts(notebook: NotebookNode) -> list[str]:
    """What each cell prints, and the tables it shows; figures are left out."""
    shown: list[str] = []
    for cell in code_cells(notebook):
        shown.append("".join(output.get("text", "") for output in cell.outputs))
        shown += [output.get("data", {}).get("text/markdown", "") for output in cell.outputs]
    return [text for text in shown if text]


def texts(shell: Shell, notebook: NotebookNode) -> list[str]:
    """Run the cells; the same of what they show now."""
    shown: list[str] = []
    for cell in code_cells(notebook):
        made = run_cell(shell, cell.source)
        shown += [made.stdout, *(output.data.get("text/markdown", "") for output in made.outputs)]
    return [text for text in shown if text]


def alike(old: str, new: str) -> bool:
    """Equal words, and numbers that agree to the last digit but one that is shown."""
    pattern = r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?"
    if re.sub(pattern, "#", old) != re.sub(pattern, "#", new):
        return False
    pairs = zip(re.findall(pattern, old), re.findall(pattern, new), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=0.03, abs_tol=0.02) for a, b in pairs)


@each_notebook
def test_the_notebook_runs_and_says_what_it_is_saved_with(path: Path, shell: Shell) -> None:
    saved = nbformat.read(path, as_version=4)
    before, after = saved_texts(saved), texts(shell, saved)
    assert len(after) == len(before)
    for old, new in zip(before, after, strict=True):
        assert alike(old, new), f"execute {path.name} again and save it:\n{old}\n{new}"


@each_notebook
def test_the_notebook_is_saved_as_it_runs_from_start_to_end(path: Path) -> None:
    saved = nbformat.read(path, as_version=4)
    cells = code_cells(saved)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert outputs
    assert not any(output.output_type == "error" for output in outputs)
    assert not any(output.get("name") == "stderr" for output in outputs)
    assert path.stat().st_size < LARGEST_BYTES


def test_a_warning_would_be_noticed(shell: Shell) -> None:
    with pytest.raises(UserWarning, match="told"):
        run_cell(shell, "import warnings\nwarnings.warn('told')")
