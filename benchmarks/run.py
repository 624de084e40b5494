"""Run a study: every case that the log does not hold, each written down as soon as it is known."""

from __future__ import annotations

import os
import platform
import re
import signal
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

import twosra_mpc
from benchmarks.records import source_digest
from benchmarks.run_log import RunLog
from benchmarks.study import Measured, Study
from twosra_mpc.files import reading

_OF_DEVELOPERS = re.compile(r"extra == .(dev|docs|test).")  # what takes part in no run
_CPU_INFO = Path("/proc/cpuinfo")


def open_log(name: str, study: Study, folder: Path) -> RunLog:
    """The log of a study in a folder.

    Raises:
        InputError: If it was made by another study, or with other settings, versions or machine.
    """
    settings = study.model_dump(mode="json")
    about = {"study": name, "settings": settings, "machine": machine(), "versions": versions()}
    return RunLog(folder, about)


def run_study(study: Study, log: RunLog, console: Console) -> bool:
    """Measure every case that ``log`` does not hold yet; False if interrupted before the end."""
    if log.dropped:
        console.print(f"dropped half a record at the end of {log.path}", highlight=False)
    asked: list[bool] = []

    def interrupt(*_: object) -> None:
        asked.append(True)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        with Progress(console=console) as progress:
            task = progress.add_task("")
            for case in progress.track(list(study.cases()), task_id=task):
                progress.update(task, description=", ".join(map(str, case)))
                if case._asdict() in log:
                    continue
                began_s = _spent_s()
                record = study.record.dump_python(study.run(case), mode="json")
                if asked:  # the planner answers Ctrl-C with the best plan so far: no record
                    return False
                log.append(case._asdict(), record, _spent_s() - began_s)
    except KeyboardInterrupt:
        return False
    finally:
        signal.signal(signal.SIGINT, before)
    return True


def _spent_s() -> float:
    """CPU time of this process and of those that it waited for [s]."""
    return sum(os.times()[:4])


def results_of(study: Study, log: RunLog) -> list[Measured]:
    """Cases and records of a study that was run to its end.

    Raises:
        InputError: If the log holds a record that is none of this study's.
    """
    read = study.record.validate_python
    with reading(str(log.path)):
        return [Measured(case, read(log[case._asdict()])) for case in study.cases()]


def machine() -> dict[str, str]:
    """Describe the machine."""
    text = _CPU_INFO.read_text(encoding="utf-8") if _CPU_INFO.is_file() else ""
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    cpu = found[1] if found else platform.processor() or "unknown CPU"
    system = f"{platform.system()} {platform.machine()}"
    return {"cpu": f"{cpu}, {os.cpu_count()} logical CPUs", "system": system}


def packages() -> set[str]:
    """Names of the packages that the program may use, its extras included."""
    needed = (each for each in requires("twosra-mpc") or () if not _OF_DEVELOPERS.search(each))
    return {re.split(r"[^\w.-]", each)[0] for each in needed}


def _installed(name: str) -> bool:
    try:
        return bool(version(name))
    except PackageNotFoundError:
        return False


def versions() -> dict[str, str]:
    """Return the versions of everything that takes part in a run.

    ``source`` names the files of planner and benchmarks by their content: a plan may change
    without a new version.
    """
    folders = (Path(twosra_mpc.__file__).parent, Path(__file__).parent)
    own = {"twosra_mpc": twosra_mpc.__version__, "source": source_digest(*folders)}
    others = {name: version(name) for name in sorted(packages()) if _installed(name)}
    return {"python": platform.python_version(), **own, **others}
