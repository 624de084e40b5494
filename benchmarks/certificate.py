"""``python -m benchmarks.certificate``: bounds against the best of many local solutions.

For every problem, transition time and admissible mode sequence of up to four phases, the proved
bound is compared with the best plan over several starts of the fixed-sequence program, and the
search with the best over all sequences (brute force). One line of JSON per problem and transition
time is written as soon as it is done; a run that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from benchmarks.problem_set import load_set
from benchmarks.transition_sweep.thermal_scale import thermally_faster
from twosra_mpc import Problem, plan
from twosra_mpc.planning.nlp.fixed_sequence import INTERVALS, improve, timed
from twosra_mpc.planning.nlp.guess import guess_motion
from twosra_mpc.planning.outcome import verified
from twosra_mpc.planning.planner import bending_task, rigid_time
from twosra_mpc.planning.search.bounds import (
    BendingTask,
    SequenceBound,
    least_durations,
    pose_bound,
    sequence_bound,
    unreachable_reason,
)
from twosra_mpc.problem.limits import may_drive
from twosra_mpc.robot.modes import MODES, RIGID, ModeSequence
from twosra_mpc.timing import TemporalNetwork, transition_model

FACTORS = (1.0, 10.0, 50.0)
TOLERANCE_S = 1e-6
GAP = 1e-3  # of the search


@dataclass(frozen=True)
class Outcome:
    """One problem at one transition time.

    Attributes:
        label: The problem.
        factor: How many times faster than the robot file's the segments melt and freeze.
        sequences: Admissible mode sequences that can bring the shape about.
        solved: Of these, sequences with a verified plan.
        violated: Sequences with a verified plan below their bound: must be zero.
        tightest: Smallest (best - bound) / best over the solved sequences.
        brute_s: Best verified cost over all sequences.
        search_s: Cost of the search's plan.
        bounded: Sequences the search bounded.
        searched: Sequences the search solved.
    """

    label: str
    factor: float
    sequences: int
    solved: int
    violated: int
    tightest: float
    brute_s: float
    search_s: float
    bounded: int
    searched: int


def judge(label: str, problem: Problem, factor: float, starts: int, phases: int) -> Outcome:
    """Compare bounds and search with brute force on one problem."""
    task, rng = bending_task(problem), np.random.default_rng(0)
    best = math.inf
    count = solved = violated = 0
    tightest = math.inf
    for network, bound in _bounded(problem, task, phases):
        count += 1
        costs = list(_costs(problem, network, bound, starts, rng))
        if costs:
            solved += 1
            violated += min(costs) < bound.cost - TOLERANCE_S
            tightest = min(tightest, (min(costs) - bound.cost) / min(costs))
            best = min(best, *costs)
    found = plan(problem.model_copy(update={"max_phases": phases, "gap": GAP}))
    return Outcome(
        label=label,
        factor=factor,
        sequences=count,
        solved=solved,
        violated=violated,
        tightest=tightest,
        brute_s=best,
        search_s=found.plan.cost.total if found.plan else math.inf,
        bounded=found.stats.sequences_bounded,
        searched=found.stats.sequences_solved,
    )


def _sequences(length: int) -> Iterator[ModeSequence]:
    """Sequences of up to ``length`` phases, solid at both ends, no phase like the one before."""
    open_ones: list[ModeSequence] = [(RIGID,)]
    while open_ones:
        sequence = open_ones.pop()
        if sequence[-1] == RIGID:
            yield sequence
        if len(sequence) < length:
            open_ones += [(*sequence, mode) for mode in MODES if mode != sequence[-1]]


def _bounded(
    problem: Problem, task: BendingTask, phases: int
) -> Iterator[tuple[TemporalNetwork, SequenceBound]]:
    timing = transition_model(problem)
    for sequence in _sequences(phases):
        if unreachable_reason(sequence, task) or timing.refusal(sequence, RIGID):
            continue
        durations = least_durations(sequence, task)
        if not all(map(math.isfinite, durations)):
            continue
        network = timing.network(sequence, RIGID, durations)
        bound = sequence_bound(network, task, problem.cost_weights, durations)
        if bound is None:
            continue
        if len(sequence) == 1:
            tighter = rigid_time(problem)
        else:
            tighter = pose_bound(network, task, problem.cost_weights, durations, math.inf)
        yield network, SequenceBound(max(bound.cost, tighter), bound.times, bound.bends)


def _costs(
    problem: Problem,
    network: TemporalNetwork,
    bound: SequenceBound,
    starts: int,
    rng: np.random.Generator,
) -> Iterator[float]:
    """Costs of verified plans: of the relaxation's own bends, and from disturbed ones."""
    for start in range(starts):
        noise = rng.normal(0.0, 0.01, len(bound.bends)) if start else 0.0
        soft = np.array([any(mode) for mode in network.sequence])
        guess = guess_motion(
            problem.robot,
            problem.start.configuration,
            problem.goal,
            network.sequence,
            np.where(soft, bound.bends + noise, 0.0),
            INTERVALS,
            may_drive(problem, network.sequence),
        )
        for candidate in (timed(guess, network, problem, 0), improve(guess, network, problem)):
            if candidate is None:
                continue
            checked = verified(problem, candidate, network)
            if checked.verification.ok:
                yield checked.cost.total


@click.command()
@click.option("--problems", default=50, show_default=True, help="Problems of random-100.")
@click.option("--starts", default=3, show_default=True, help="Starts of each sequence.")
@click.option("--phases", default=4, show_default=True, help="Longest sequence.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("certificate.jsonl"))
def main(problems: int, starts: int, phases: int, out: Path) -> None:
    """Judge the bounds and the search, and print a Markdown table."""
    done = [Outcome(**json.loads(line)) for line in _complete_lines(out)]
    known = {(item.label, item.factor) for item in done}
    chosen = load_set("random-100").problems[:problems]
    wanted = [(factor, label, problem) for factor in FACTORS for label, problem in chosen]
    with Progress(console=Console(stderr=True)) as progress, out.open("a") as log:
        task = progress.add_task("certificate", total=len(wanted))
        for factor, label, problem in wanted:
            if (label, factor) not in known:
                faster = problem.with_robot(thermally_faster(problem.robot, factor))
                done.append(judge(label, faster, factor, starts, phases))
                log.write(json.dumps(asdict(done[-1])) + "\n")
                log.flush()
            progress.advance(task)
    sys.stdout.write(report(done))


def _complete_lines(path: Path) -> list[str]:
    text = path.read_text() if path.exists() else ""
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole)  # the line an interruption left half written
    return whole.splitlines()


def report(outcomes: list[Outcome]) -> str:
    """Write the Markdown table, one row a transition time."""
    lines = [
        "| faster by | problems | sequences bounded | with a plan | below their bound "
        "| search / brute force - 1, largest | solved by the search |",
        "|---|---|---|---|---|---|---|",
    ]
    for factor in sorted({item.factor for item in outcomes}):
        rows = [item for item in outcomes if item.factor == factor]
        worst = max(item.search_s / item.brute_s - 1 for item in rows)
        lines.append(
            f"| {factor:g} | {len(rows)} | {sum(r.sequences for r in rows)} "
            f"| {sum(r.solved for r in rows)} | {sum(r.violated for r in rows)} "
            f"| {100 * worst:.3f} % | {sum(r.searched for r in rows)} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
