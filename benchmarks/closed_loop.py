"""``python -m benchmarks.closed_loop``: runs in closed loop on simulated robots, ours and greedy.

The question: does a plan reach its goal on a robot that slips, drifts, and melts earlier or later
than its model, and what does that cost? 25 problems (the five published ones and 20 random ones),
each on 8 robots drawn from the ranges of a disturbance level, driven by this package's executor and
by the greedy rule; planned with exact arcs and with the paper's spirals, on a robot of exact arcs.

Runs are appended to a file of JSON lines and not repeated; a table is printed at the end.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
from rich.console import Console
from rich.progress import Progress

from benchmarks import markdown
from benchmarks.problem_set import load_set
from benchmarks.report_file import out_option, publish
from twosra_mpc import Problem, with_path_model
from twosra_mpc.execution.simulation.disturbance import LEVELS
from twosra_mpc.execution.simulation.metrics import Metrics, spread
from twosra_mpc.execution.simulation.simulate import EXECUTORS, simulate

PATH_MODELS = {"arc": "exact arcs", "log_spiral": "the paper's spirals"}
WORDS = {"optimal": "this package", "greedy": "greedy rule"}
RANDOM_PROBLEMS = 20
_HEADER = (
    *("driven by", "planned with", "level", "reached", "time [s] median / p90 / max"),
    *("transitions mean", "planned again", "energy [J] median"),
    "error median / max [mm, degrees, 1/m]",
)


class Case(NamedTuple):
    """One run."""

    executor: str
    path_model: str
    level: str
    problem: str
    seed: int


class Done(NamedTuple):
    """One run and what it came to."""

    case: Case
    metrics: Metrics


def problems() -> dict[str, Problem]:
    """The five published problems and the first random ones."""
    random = load_set("random-100").problems[:RANDOM_PROBLEMS]
    return dict((*load_set("published").problems, *random))


def cases(
    level: str, seeds: int, executors: Sequence[str], path_models: Sequence[str]
) -> Iterator[Case]:
    """All runs; those that share a robot are neighbours, its kinematics is compiled once."""
    names = list(problems())
    for executor in executors:
        for model in path_models:
            for seed in range(1, seeds + 1):
                for name in names:
                    yield Case(executor, model, level, name, seed)


def run_case(case: Case, named: dict[str, Problem]) -> Metrics:
    """Run one case on a robot of exact arcs."""
    problem = named[case.problem]
    problem = problem.with_robot(with_path_model(problem.robot, case.path_model))
    return simulate(problem, disturbance=case.level, seed=case.seed, executor=case.executor).metrics


def load_done(path: Path) -> dict[Case, Metrics]:
    """Runs that are in a file already; a line that was cut off is left out."""
    done: dict[Case, Metrics] = {}
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for line in lines:
        try:
            record: dict[str, Any] = json.loads(line)
        except json.JSONDecodeError:
            continue
        done[Case(**record["case"])] = Metrics(**record["metrics"])
    return done


def table(done: dict[Case, Metrics]) -> str:
    """The Markdown table, and every run that did not reach its goal."""
    rows = []
    groups = dict.fromkeys((case.executor, case.path_model, case.level) for case in done)
    for executor, model, level in groups:
        runs = [found for case, found in done.items() if case[:3] == (executor, model, level)]
        rows.append(_row(executor, model, level, runs))
    lines = markdown.table(_HEADER, rows)
    lost = [(case, found) for case, found in done.items() if not found.reached]
    lines += [f"Not reached ({len(lost)}):" if lost else "Every run reached its goal."]
    for case, found in lost:
        where = f"{case.executor}, {case.path_model}, {case.problem}, seed {case.seed}"
        lines.append(f"- {where}: {found.ending}: {found.reason}")
    extra = [case for case, found in done.items() if _unjustified(case, found)]
    lines += ["", f"Runs of this package with transitions that no plan asked for: {len(extra)}."]
    forced = spread(list(done.values()), lambda found: found.forced_s).largest if done else 0.0
    lines += [f"Longest time with turning wheels while metal was changing: {forced:.1f} s.", ""]
    return "\n".join(lines)


def _unjustified(case: Case, found: Metrics) -> bool:
    return case.executor == "optimal" and found.transitions > found.allowed


def _row(executor: str, model: str, level: str, runs: Sequence[Metrics]) -> tuple[str, ...]:
    reached = sum(found.reached for found in runs)
    time = spread(runs, lambda found: found.time_s)
    energy = spread(runs, lambda found: found.energy_J)
    position = spread(runs, lambda found: 1e3 * found.position_m)
    heading = spread(runs, lambda found: 57.29578 * found.heading_rad)
    shape = spread(runs, lambda found: found.curvature_per_m)
    transitions = sum(found.transitions for found in runs) / len(runs)
    again = sum(found.replans > 0 for found in runs)
    replanned = f"{again} of {len(runs)}" if executor == "optimal" else ""
    return (
        WORDS[executor],
        PATH_MODELS[model],
        level,
        f"{reached} of {len(runs)}",
        f"{time.median:.0f} / {time.p90:.0f} / {time.largest:.0f}",
        f"{transitions:.2f}",
        replanned,
        f"{energy.median:.0f}",
        f"{position.median:.1f}, {heading.median:.2f}, {shape.median:.2f} / "
        f"{position.largest:.1f}, {heading.largest:.2f}, {shape.largest:.2f}",
    )


@click.command()
@click.option(
    "--runs",
    type=click.Path(path_type=Path),
    default=Path("closed-loop.jsonl"),
    show_default=True,
    help="File of JSON lines; runs that are in it are not repeated.",
)
@out_option("Write the table here as well.")
@click.option("--level", type=click.Choice(list(LEVELS)), default="moderate", show_default=True)
@click.option("--seeds", type=click.IntRange(min=1), default=8, show_default=True)
@click.option("--executor", "executors", multiple=True, type=click.Choice(EXECUTORS))
@click.option("--path-model", "models", multiple=True, type=click.Choice(list(PATH_MODELS)))
def main(
    runs: Path,
    out: Path | None,
    level: str,
    seeds: int,
    executors: tuple[str, ...],
    models: tuple[str, ...],
) -> None:
    """Run what is missing in the file and print the table."""
    done, named = load_done(runs), problems()
    asked = list(cases(level, seeds, executors or EXECUTORS, models or list(PATH_MODELS)))
    with (
        Progress(console=Console(stderr=True)) as progress,
        runs.open("a", encoding="utf-8") as file,
    ):
        for case in progress.track(asked, description="closed loop"):
            if case not in done:
                done[case] = run_case(case, named)
                record = {"case": case._asdict(), "metrics": done[case]._asdict()}
                file.write(json.dumps(record) + "\n")
                file.flush()
    publish(table({case: done[case] for case in asked}), out)


if __name__ == "__main__":
    main()
