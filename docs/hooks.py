"""Build of the site beside Markdown: changelog, figures, ages of tables, its own checks.

Figures of the gallery and of the examples are made by the code beside them, so that a figure that
can no longer be drawn that way fails the build.
"""

from __future__ import annotations

import importlib
import io
import re
import runpy
import sys
import warnings
from contextlib import chdir, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent
GALLERY = "gallery.md"
PUBLIC = (
    *("", ".execution", ".execution.tracking", ".plotting", ".lab.batch", ".lab.figures"),
    *(".lab.identification", ".lab.paper", ".lab.report", ".lab.serial", ".lab.studio"),
)
sys.path.append(str(ROOT))  # benchmarks are not installed
TABLES = importlib.import_module("benchmarks.tables")
_FIGURE = re.compile(r'```python title="([\w-]+\.\w+)"\n(.*?)```\n', re.DOTALL)
_FETCHED = re.compile(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(?:https?:)?//[^"]*"')


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the changelog, the examples, and the gallery's figures, drawn now."""
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    files.append(File.generated(config, "changelog.md", content=changelog))
    gallery = (ROOT / "docs" / GALLERY).read_text(encoding="utf-8")
    for name, content in _drawn(_FIGURE.findall(gallery)).items():
        files.append(File.generated(config, f"gallery/{name}", content=content))
    text = "# Examples\n\nIn the folder `examples/`: each runs by itself, in a second or a few.\n"
    for path in sorted((ROOT / "examples").glob("*.py")):
        shown, figures = _example(path)
        text += f"\n## {path.stem.replace('_', ' ')}\n\n{shown}"
        for name, content in figures.items():
            files.append(File.generated(config, f"examples/{name}", content=content))
    files.append(File.generated(config, "examples.md", content=text))
    return files


def _example(path: Path) -> tuple[str, dict[str, bytes]]:
    """Run an example; return it as Markdown, with what it prints, and the figures it draws.

    Raises:
        Warning: If it warns: what users copy does not.
        PluginError: If it prints nothing, or does not draw what it names.
    """
    with TemporaryDirectory() as folder, chdir(folder), redirect_stdout(io.StringIO()) as printed:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            runpy.run_path(str(path), run_name="__main__")
        figures = {item.name: item.read_bytes() for item in sorted(Path(folder).glob("*.png"))}
    named = re.findall(r'"([\w-]+\.png)"', path.read_text(encoding="utf-8"))
    if not printed.getvalue() or sorted(named) != sorted(figures):
        raise PluginError(f"{path.name} prints nothing, or draws {[*figures]}, not {named}")
    pictures = "".join(f"![{path.stem}](examples/{name})\n\n" for name in figures)
    code = f'```python title="{path.name}"\n{path.read_text(encoding="utf-8")}```\n\n'
    return f"{pictures}{code}```text\n{printed.getvalue()}```\n", figures


def _drawn(figures: list[tuple[str, str]]) -> dict[str, bytes]:
    """Run the code blocks one after the other; each writes the file it is titled with."""
    known: dict[str, Any] = {}
    with TemporaryDirectory() as folder, chdir(folder):
        for name, code in figures:
            exec(compile(code, f"gallery: {name}", "exec"), known)
        return {name: Path(name).read_bytes() for name, _ in figures}


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Show each of the gallery's figures above the code that draws it; say which tables are old."""
    del config, files
    if page.file.src_uri != GALLERY:
        return TABLES.filled(markdown, importlib.import_module("benchmarks.records").load_records())
    return _FIGURE.sub(lambda found: f"![{found[1]}](gallery/{found[1]})\n\n{found[0]}", markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse pages that fetch anything, and a reference that leaves out a public name."""
    pages = {
        path: path.read_text(encoding="utf-8") for path in Path(config.site_dir).rglob("*.html")
    }
    for path, text in pages.items():
        if fetched := _FETCHED.search(text):
            raise PluginError(f"{path} fetches from the network: {fetched[0]}")
    reference = "".join(text for path, text in pages.items() if path.parent.name == "reference")
    for suffix in PUBLIC:
        module = importlib.import_module(f"twosra_mpc{suffix}")
        for name in module.__all__:
            if name[0] != "_" and f'id="{module.__name__}.{name}"' not in reference:
                raise PluginError(f"the reference leaves out {module.__name__}.{name}")
