"""Fresh processes: how long commands take, what their imports cost, how long planning takes."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.suite import Record

ROOT = Path(__file__).parent.parent.parent
PLAN, CASADI, NOTHING = "plan", "casadi", "nothing"
_PLAN_TWICE = """
import json, sys, time
from twosra_mpc import load_problem, plan
problem = load_problem(sys.argv[1])
times = [time.perf_counter()]
for _ in range(2):
    plan(problem)
    times.append(time.perf_counter())
spent = {"first_s": times[1] - times[0], "again_s": times[2] - times[1]}
print(json.dumps(spent | {"ended_s": time.monotonic()}))
"""


def commands(scenario: str) -> dict[str, list[str]]:
    """Return the commands that are compared; ``python -m twosra_mpc`` is the twosra program."""
    return {
        PLAN: [sys.executable, "-m", "twosra_mpc", "plan", scenario],
        CASADI: [sys.executable, "-c", "import casadi"],
        NOTHING: [sys.executable, "-c", "pass"],
    }


def measured_round(scenario: str) -> Record:
    """Run every command once in a process of its own."""
    made = commands(scenario)
    wall_s, cpu_s = {}, {}
    for name, command in made.items():
        wall, cpu = time.perf_counter(), _children_cpu_s()
        _run(command)
        wall_s[name] = time.perf_counter() - wall
        cpu_s[name] = _children_cpu_s() - cpu
    known = _import_times(made[NOTHING])
    imports = {k: v for k, v in _import_times(made[PLAN]).items() if k not in known}
    planned = _planned_twice(scenario)
    by_package = _by_package(imports)
    return {"wall_s": wall_s, "cpu_s": cpu_s, "imports_s": by_package, "plan_s": planned}


def _planned_twice(scenario: str) -> dict[str, float]:
    """Times of a process's first plan, its second one, and of its exit [s]."""
    planned = json.loads(_run([sys.executable, "-c", _PLAN_TWICE, scenario]).stdout)
    exit_s = time.monotonic() - planned.pop("ended_s")  # one clock for all processes
    return {**planned, "exit_s": exit_s}


def _children_cpu_s() -> float:
    """CPU time of all child processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a command with the planner of this clone."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )


def _import_times(command: Sequence[str]) -> dict[str, float]:
    """Module -> its own import time [s], without what it imports in turn."""
    python, *rest = command
    return own_import_times(_run([python, "-X", "importtime", *rest]).stderr)


def own_import_times(text: str) -> dict[str, float]:
    """Read the output of ``python -X importtime``: lines "import time: own | all | name"."""
    own: dict[str, float] = {}
    for line in text.splitlines():
        if not line.startswith("import time:") or "imported package" in line:
            continue
        microseconds, _, name = line.removeprefix("import time:").split("|")
        own[name.strip()] = own.get(name.strip(), 0.0) + 1e-6 * int(microseconds)
    return own


def _by_package(own: dict[str, float]) -> dict[str, float]:
    """Sum up import times by top-level package; the standard library is one."""
    packages: dict[str, float] = {}
    for module, seconds in own.items():
        top = module.partition(".")[0]
        if top in sys.stdlib_module_names:
            top = "standard library"
        packages[top] = packages.get(top, 0.0) + seconds
    return packages
