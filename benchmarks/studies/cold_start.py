"""From the shell to a plan, and other first uses: against importing CasADi alone."""

from __future__ import annotations

import json
import os
import re
import resource
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from pydantic import TypeAdapter

from benchmarks import figures
from benchmarks.study import Count, Measured, Study

ROOT = Path(__file__).parents[2]
PLAN, CASADI, NOTHING = "twosra plan", "import casadi", "python -c pass"
VERSION, HELP, IMPORT = "twosra --version", "twosra --help", "import twosra_mpc"
AT_MOST = {PLAN: 4.0, IMPORT: 2.5, VERSION: 1.0, HELP: 1.0}  # times as long as importing CasADi
PACKAGES = ("casadi", "numpy", "scipy", "pydantic", "matplotlib", "click", "rich", "twosra_mpc")
_PLAN_TWICE = """
import gc, json, sys, time
gc.set_threshold(200_000, 20, 20)  # as the program does
from twosra_mpc import load_problem, plan
problem = load_problem(sys.argv[1])
times = [time.perf_counter()]
for _ in range(2):
    plan(problem)
    times.append(time.perf_counter())
spent = {"first": times[1] - times[0], "again": times[2] - times[1]}
print(json.dumps(spent | {"ended": time.monotonic()}))
gc.freeze()  # as the program does
"""


class Case(NamedTuple):
    """A round of fresh processes, all commands in turns."""

    round: int


@dataclass(frozen=True)
class RoundRecord:
    """One round; all times in s.

    Attributes:
        wall_s: Wall time of each command.
        cpu_s: CPU time of each command.
        imports_s: Own import times of what planning loads, by package.
        plan_s: Times of a process's first plan, of planning again, and of its exit.
    """

    wall_s: dict[str, float]
    cpu_s: dict[str, float]
    imports_s: dict[str, float]
    plan_s: dict[str, float]


class ColdStart(Study):
    """Fresh processes that plan, against fresh processes that only import.

    Attributes:
        scenario: The built-in scenario to plan.
        rounds: How often.
    """

    record: ClassVar = TypeAdapter(RoundRecord)
    question: ClassVar = "How long does a plan take from the shell, and where does the time go?"

    scenario: str = "paper-1"
    rounds: Count = 3

    def cases(self) -> Iterator[Case]:
        """Yield the rounds."""
        yield from map(Case, range(1, self.rounds + 1))

    def run(self, case: Case) -> RoundRecord:
        """Run every command once in a process of its own."""
        del case
        commands = {  # ``python -m twosra_mpc`` is the twosra program
            PLAN: ["-m", "twosra_mpc", "plan", self.scenario],
            CASADI: ["-c", "import casadi"],
            IMPORT: ["-c", "import twosra_mpc"],
            VERSION: ["-m", "twosra_mpc", "--version"],
            HELP: ["-m", "twosra_mpc", "--help"],
            NOTHING: ["-c", "pass"],
        }
        _python(*commands[PLAN])  # leaves compiled byte code
        wall_s, cpu_s = {}, {}
        for name, command in commands.items():
            wall, cpu = time.perf_counter(), _children_cpu_s()
            _python(*command)
            wall_s[name] = time.perf_counter() - wall
            cpu_s[name] = _children_cpu_s() - cpu
        known, loaded = (
            own_import_times(_python("-X", "importtime", *commands[name]).stderr)
            for name in (NOTHING, PLAN)
        )
        new = {module: seconds for module, seconds in loaded.items() if module not in known}
        planned = json.loads(_python("-c", _PLAN_TWICE, self.scenario).stdout)
        planned["exit"] = time.monotonic() - planned.pop("ended")  # one clock for all processes
        return RoundRecord(wall_s, cpu_s, _by_package(new), planned)

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Medians of ratios, and the breakdown."""
        records = [made for _, made in results]
        parts = breakdown(records)
        figures.draw_cold_start(parts, folder / "cold-start.png")
        ratios = {
            name: [
                statistics.median(times[name] / times[CASADI] for times in of_all)
                for of_all in ([r.wall_s for r in records], [r.cpu_s for r in records])
            ]
            for name in AT_MOST
        }
        commands = (PLAN, IMPORT, VERSION, HELP, CASADI, NOTHING)
        return {"commands": commands, "parts": parts, "ratios": ratios, "at_most": AT_MOST}


def breakdown(records: Sequence[RoundRecord]) -> dict[str, float]:
    """Split the median time of a plan into its parts [s], by medians; imports longest first."""

    def median(times: Sequence[Mapping[str, float]], name: str) -> float:
        return statistics.median(one.get(name, 0.0) for one in times)

    walls, plans = [one.wall_s for one in records], [one.plan_s for one in records]
    imports = [one.imports_s for one in records]
    packages = {f"import {name}": median(imports, name) for one in imports for name in one}
    parts = {"interpreter": median(walls, NOTHING)}
    parts |= dict(sorted(packages.items(), key=lambda item: -item[1]))
    again = median(plans, "again")
    parts["building functions"] = max(0.0, median(plans, "first") - again)
    parts |= {"planning": again, "exit of the process": median(plans, "exit")}
    return parts | {"everything else": median(walls, PLAN) - sum(parts.values())}


def _children_cpu_s() -> float:
    """CPU time of all child processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python with the planner of this clone; byte code is kept, as in an installed one."""
    command, environment = [sys.executable, *arguments], {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )


def own_import_times(text: str) -> defaultdict[str, float]:
    """Module -> its own import time [s], from the output of ``python -X importtime``."""
    own: defaultdict[str, float] = defaultdict(float)
    for microseconds, module in re.findall(r"^import time: +(\d+) \|.*\| +(\S+)", text, re.M):
        own[module] += 1e-6 * int(microseconds)
    return own


def _by_package(own: Mapping[str, float]) -> dict[str, float]:
    """Sum up import times by package; the standard library is one, small ones another."""
    packages: defaultdict[str, float] = defaultdict(float)
    for module, seconds in own.items():
        top = module.partition(".")[0]
        name = next((name for name in PACKAGES if top.startswith(name)), "other packages")
        packages["standard library" if top in sys.stdlib_module_names else name] += seconds
    return dict(packages)
