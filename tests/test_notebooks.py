"""The notebooks run from start to end without a warning, and say what they are saved with."""

from __future__ import annotations

import math
import re
from copy import deepcopy
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_notebook

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
LARGEST_BYTES = 1_000_000
TIMEOUT_S = 200  # of one cell

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def executed(notebook: NotebookNode, folder: Path) -> NotebookNode:
    """Run a copy in a fresh kernel, from an unrelated folder; warnings are errors, films short."""
    strict = new_code_cell("import warnings\nwarnings.simplefilter('error')")
    short = new_code_cell("from twosra_mpc.plotting import film\nfilm.FRAMES_PER_S = 0.5")
    lenient = new_code_cell("warnings.simplefilter('default')")  # the kernel's own, as it ends
    cells = [strict, short, *deepcopy(notebook.cells), lenient]  # what was saved stays as it is
    copy = new_notebook(cells=cells, metadata=notebook.metadata)
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(copy, timeout=TIMEOUT_S, kernel_name="python3", resources=resources).execute()
    copy.cells = copy.cells[2:-1]
    return copy


def texts(notebook: NotebookNode) -> list[str]:
    """What each cell prints, and the tables it shows; figures are left out."""
    shown: list[str] = []
    for cell in notebook.cells:
        outputs = cell.get("outputs", [])
        shown.append("".join(output.get("text", "") for output in outputs))
        shown += [output.get("data", {}).get("text/markdown", "") for output in outputs]
    return [text for text in shown if text]


def alike(old: str, new: str) -> bool:
    """Equal words, and numbers that agree to the last digit but one that is shown."""
    pattern = r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?"
    if re.sub(pattern, "#", old) != re.sub(pattern, "#", new):
        return False
    pairs = zip(re.findall(pattern, old), re.findall(pattern, new), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=0.03, abs_tol=0.02) for a, b in pairs)


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@each_notebook
def test_the_notebook_runs_and_says_what_it_is_saved_with(path: Path, tmp_path: Path) -> None:
    saved = nbformat.read(path, as_version=4)
    made = executed(saved, tmp_path)
    outputs = [output for cell in made.cells for output in cell.get("outputs", [])]
    assert not [output for output in outputs if output.get("name") == "stderr"]
    before, after = texts(saved), texts(made)
    assert len(after) == len(before)
    for old, new in zip(before, after, strict=True):
        assert alike(old, new), f"execute {path.name} again and save it:\n{old}\n{new}"


@each_notebook
def test_the_notebook_is_saved_as_it_runs_from_start_to_end(path: Path) -> None:
    saved = nbformat.read(path, as_version=4)
    cells = [cell for cell in saved.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert outputs
    assert not any(output.output_type == "error" for output in outputs)
    assert not any(output.get("name") == "stderr" for output in outputs)
    assert path.stat().st_size < LARGEST_BYTES


def test_a_warning_would_be_noticed(tmp_path: Path) -> None:
    warning = new_code_cell("import warnings\nwarnings.warn('told')")
    with pytest.raises(CellExecutionError, match="told"):
        executed(new_notebook(cells=[warning]), tmp_path)
