"""Check types of the package, of its examples, and of all Python blocks of the documentation."""

import re
import sys
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

from mypy.main import main

BLOCK = re.compile(r"^```python.*?\n(.*?)^```$", re.DOTALL | re.MULTILINE)

settings = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
with TemporaryDirectory() as folder:
    for number, page in enumerate([Path("README.md"), *sorted(Path("docs").rglob("*.md"))]):
        module = Path(folder, f"{page.stem.replace('-', '_')}_{number}.py")
        blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
        module.write_text("\n".join(blocks), encoding="utf-8")
    main(args=[*settings["files"], folder], stdout=sys.stdout, stderr=sys.stderr)
