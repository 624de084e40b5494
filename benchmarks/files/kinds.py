"""Kinds of files that the program reads: good ones to spoil, and what reads them."""

from __future__ import annotations

import io
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

import twosra_mpc
from benchmarks.__main__ import main as benchmark
from benchmarks.files.heating import true_history, write_log
from benchmarks.files.melts import made_up, write
from benchmarks.files.photographs import LENGTH_M, SCALE_M, write_folder
from benchmarks.problems import FOLDER, read_set
from benchmarks.run_log import NAME
from twosra_mpc import InputError, load_problem, plan
from twosra_mpc.cli import main
from twosra_mpc.lab.batch.problems import Problems
from twosra_mpc.lab.batch.spec import load_spec
from twosra_mpc.lab.batch.table import frame_of, write_table
from twosra_mpc.lab.identification.motion_log import save_authors_csv
from twosra_mpc.lab.identification.transition_fit import read_transitions

_PACKAGE = Path(twosra_mpc.__file__).parent
_LIMIT = ("--time-limit", "0.1")


class Kind(NamedTuple):
    """A kind of file: its ending, good ones to spoil, and the command that reads it."""

    suffix: str
    good: Callable[[], tuple[bytes, ...]]
    command: Callable[[Path], tuple[str, ...]]
    program: Callable[[list[str]], object] = main


def _built_in(folder: str, *names: str) -> Callable[[], tuple[bytes, ...]]:
    return lambda: tuple((_PACKAGE / folder / f"{name}.toml").read_bytes() for name in names)


@cache
def _plans() -> tuple[bytes, ...]:
    return tuple(_written(plan(load_problem(name)).save) for name in ("paper-2", "rigid-move"))


def _log() -> tuple[bytes, ...]:
    made = plan(load_problem("paper-2", robot="2sra-v1-paper")).require()
    return (_written(lambda path: save_authors_csv(made, path), ".csv"),)


def _written(write: Callable[[Path], object], ending: str = ".json") -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(path := Path(folder) / f"file{ending}")
        return path.read_bytes()


def _reads(read: Callable[[Path], object]) -> Callable[[list[str]], None]:
    """A program that only reads a file."""

    def program(arguments: list[str]) -> None:
        try:
            read(Path(arguments[0]))
        except InputError as error:
            print(error, file=sys.stderr)
            raise SystemExit(2) from None

    return program


@cache
def _run_log() -> tuple[bytes, ...]:
    with tempfile.TemporaryDirectory() as folder:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            _finish([str(Path(folder) / NAME)])
        return ((Path(folder) / NAME).read_bytes(),)


def _finish(arguments: list[str]) -> None:
    """Go on with a study from its log."""
    settings = ("count=2", "robots=2", "time_limit_s=0.01")
    with tempfile.TemporaryDirectory() as folder:
        if (log := Path(arguments[0])).exists():
            shutil.copy(log, Path(folder) / NAME)
        given = [word for each in settings for word in ("--set", each)]
        try:
            benchmark(["soak", "--out", folder, *given], standalone_mode=False)
        finally:
            shutil.copy(Path(folder) / NAME, log)


_CAMERA = ("--scale", str(SCALE_M), "--length", str(LENGTH_M), "--towards", "39,35")
_MAP = b"""image: map.pgm
resolution: 0.01
origin: [-0.1, 0.2, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
_SPEC = b"""planner = "both"

[random]
robot = "2sra-v1"
seed = 2026
count = 20
position_m = 0.25
heading_rad = 3.1
curvature_per_m = 60.0

[fixed]
time_limit_s = 10.0
goal.tolerance = "exact"

[grid]
robot.heater.melt_current_A = { from = 0.7, to = 0.9, steps = 3 }
"""


@cache
def _photographs() -> tuple[bytes, ...]:
    with tempfile.TemporaryDirectory() as folder:
        write_folder(shots := Path(folder) / "shots", [20.0])
        (png,) = shots.iterdir()
        Image.open(png).save(pgm := Path(folder) / "shot.ppm")
        return (png.read_bytes(), pgm.read_bytes())


def _cells() -> tuple[bytes, ...]:
    cells = np.where(np.random.default_rng(1).random((20, 30)) < 0.2, 0, 254).astype(np.uint8)
    return tuple(_written(partial(Image.fromarray(cells).save, format=f)) for f in ("PPM", "PNG"))


def _map_of(arguments: list[str]) -> None:
    """Import a map whose picture is the last argument; or whose file it is, beside a picture."""
    *given, path = arguments
    with tempfile.TemporaryDirectory() as folder:
        (told := Path(folder) / "map.yaml").write_bytes(_MAP)
        (Path(folder) / "map.pgm").write_bytes(_cells()[0])
        shutil.copy(path, told if path.endswith(".yaml") else told.with_suffix(".pgm"))
        main([*given, str(told)])


def _estimate(arguments: list[str]) -> None:
    """Estimate from a photograph, or beside a table of references."""
    (path,) = arguments
    with tempfile.TemporaryDirectory() as folder:
        (shot := Path(folder) / "shot-000.png").write_bytes(_photographs()[0])
        given = ("--reference", path)
        if not path.endswith(".csv"):
            shutil.copy(path, shot)
            given = ()
        main(["estimate-curvature", folder, *_CAMERA, *given])


_BLOCK = [[0.1, 0.2], [0.2, 0.2], [0.2, 0.3], [0.1, 0.3], [0.1, 0.2]]
_OBSTACLES = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"name": "block"},
            "geometry": {"type": "Polygon", "coordinates": [_BLOCK]},
        }
    ],
}
_AROUND = [(0.03 * np.cos(a), 0.03 * np.sin(a)) for a in np.arange(0, 6.2, 0.3)]
_OUTLINE = "".join(f"{x:z.5f},{y:z.5f}\n" for x, y in _AROUND)
_GRASP = """robot = "2sra-v1"
tasks = [{ do = "grasp", object = "cup" }]
start = { x_m = -0.1, y_m = -0.1, phi_rad = 0.0, kappa_per_m = [0.0, 0.0] }

[[objects]]
name = "cup"
pose = { x_m = 0.15, y_m = 0.05 }
"""


def _scenario(arguments: list[str]) -> None:
    """Plan among obstacles of a file, or to grasp what has its outline."""
    (path,) = arguments
    with tempfile.TemporaryDirectory() as folder:
        text = (_PACKAGE / "scenarios" / "rigid-move.toml").read_text(encoding="utf-8")
        text = f"obstacles = {json.dumps(path)}\n{text}"
        if path.endswith(".csv"):
            text = f"{_GRASP}outline = {json.dumps(path)}\n"
        (scenario := Path(folder) / "scenario.toml").write_text(text, encoding="utf-8")
        main(["plan", str(scenario), *_LIMIT])


@cache
def _heating() -> tuple[bytes, ...]:
    log = true_history((30.0, 20.0)).log(rate_Hz=2.0)
    return (_written(partial(write_log, log)),)


@cache
def _melts() -> tuple[tuple[bytes, ...], tuple[bytes, ...]]:
    logged, readings = (_written(partial(write, rows)) for rows in made_up())
    return (logged,), (readings,)


def _fit(arguments: list[str]) -> None:
    """Read melts and freezes, one of the two files spoilt."""
    (path,) = arguments
    with tempfile.TemporaryDirectory() as folder:
        logged, readings = Path(folder) / "melts.csv", Path(folder) / "readings.csv"
        logged.write_bytes(_melts()[0][0])
        readings.write_bytes(_melts()[1][0])
        shutil.copy(path, logged if path.endswith("melts.csv") else readings)
        _reads(lambda _: read_transitions(logged, readings, 2))([path])


@cache
def _runs() -> tuple[bytes, ...]:
    varied = {"robot.heater.melt_current_A": "float64", "goal.kappa_per_m.0": "float64"}
    texts = dict.fromkeys(("status", "message", "sequence"), "")
    row = {**texts, **{f"greedy_{name}": "" for name in texts}, "verified": True}
    rows = [
        {**row, "problem": k, "status": "optimal", "duration_s": 300.0 + k, "gap": 0.01}
        | dict.fromkeys(varied, float(k))
        for k in range(8)
    ]
    return (_written(partial(write_table, frame_of(rows, varied, greedy=True))),)


_SCENARIOS = ("paper-1", "move-and-shape", "doorway", "pick-and-place", "three-segments")
_ROBOTS = _built_in("robots", "2sra-v1", "2sr-v2", "2sra-v1-paper")
KINDS = {
    "scenario": Kind(
        ".toml", _built_in("scenarios", *_SCENARIOS), lambda path: ("plan", str(path), *_LIMIT)
    ),
    "robot": Kind(".toml", _ROBOTS, lambda path: ("check-robot", str(path))),
    "robot that plans": Kind(
        ".toml", _ROBOTS, lambda path: ("plan", "rigid-move", "--robot", str(path), *_LIMIT)
    ),
    "plan": Kind(".json", _plans, lambda path: ("verify", str(path))),
    "problem set": Kind(
        ".toml",
        lambda: tuple(path.read_bytes() for path in sorted(FOLDER.glob("[rt]*.toml"))),
        lambda path: (str(path),),
        _reads(read_set),
    ),
    "run log": Kind(".jsonl", _run_log, lambda path: (str(path),), _finish),
    "log": Kind(".csv", _log, lambda path: ("replay", str(path), "--robot", "2sra-v1-paper")),
    "plan reported": Kind(".json", _plans, lambda path: ("report", str(path), f"{path}.html")),
    "plan driven": Kind(".json", _plans, lambda path: ("stream", str(path), "--dry-run")),
    "plan exported": Kind(".json", _plans, lambda path: ("export", str(path), f"{path}.mcap")),
    "map": Kind(".yaml", lambda: (_MAP,), lambda path: ("import-map", str(path)), _map_of),
    "map picture": Kind(".pgm", _cells, lambda path: ("import-map", str(path)), _map_of),
    "photograph": Kind(".png", _photographs, lambda path: (str(path),), _estimate),
    "references": Kind(
        ".csv", lambda: (b"kappa_per_m\n21.5\n",), lambda path: (str(path),), _estimate
    ),
    "heating log": Kind(
        ".csv", _heating, lambda path: ("fit-thermal", str(path), "--robot", "2sr-v2", "--score")
    ),
    "melts": Kind("-melts.csv", lambda: _melts()[0], lambda path: (str(path),), _fit),
    "readings": Kind("-readings.csv", lambda: _melts()[1], lambda path: (str(path),), _fit),
    "batch": Kind(
        ".toml",
        lambda: (_SPEC,),
        lambda path: (str(path),),
        _reads(lambda path: Problems(load_spec(path), path.parent)),
    ),
    "obstacles": Kind(
        ".geojson", lambda: (json.dumps(_OBSTACLES).encode(),), lambda path: (str(path),), _scenario
    ),
    "outline": Kind(".csv", lambda: (_OUTLINE.encode(),), lambda path: (str(path),), _scenario),
    "runs": Kind(".parquet", _runs, lambda path: ("atlas", str(path))),
}
