"""What a sweep of transition times says in Markdown."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator

import numpy as np

from benchmarks.markdown import figure, milliseconds, percent, share, table
from benchmarks.plan_record import PlanRecord
from benchmarks.summary import quantiles
from twosra_mpc.robot.modes import sequence_name

SEQUENCES, TOTAL_TIME, PROOFS = "sequences.png", "total-time.png", "gap-and-wall-time.png"

Sweep = dict[str, dict[float, PlanRecord]]  # label -> freezing time [s] -> plan


def freezing_times(sweep: Sweep) -> list[float]:
    """Return the freezing times [s] in ascending order."""
    return sorted({freeze for plans in sweep.values() for freeze in plans})


def column(sweep: Sweep, freeze_s: float) -> list[PlanRecord]:
    """All problems' plans at one freezing time."""
    return [plans[freeze_s] for plans in sweep.values()]


def report_lines(sweep: Sweep, reference_s: float, limit_s: float) -> list[str]:
    """Everything the report says of a sweep."""
    return [
        "## Best mode sequences",
        "",
        *figure(
            SEQUENCES,
            "Mode sequence of the best plan found. One block per phase; upper lane segment 1, "
            "lower lane segment 2. Pale: not proved within the asked gap.",
        ),
        *figure(
            TOTAL_TIME,
            "Total time of the best plan found (line) and proved lower bound (shaded down to it). "
            "A mode sequence stands where it is first chosen.",
        ),
        *_changes(sweep, reference_s),
        "## Proof and wall time",
        "",
        *figure(
            PROOFS,
            "Proved gap and warm wall time over all problems: every run (triangles: the time "
            "limit ended the search), median and largest.",
        ),
        *_columns(sweep, reference_s, limit_s),
        *_worst(sweep),
        *_limitations(limit_s),
    ]


def _changes(sweep: Sweep, reference_s: float) -> list[str]:
    times = freezing_times(sweep)
    slow = min(times, key=lambda freeze: abs(np.log(freeze / reference_s)))
    fast = min(times, key=lambda freeze: abs(np.log(10 * freeze / reference_s)))
    rows = []
    for label, plans in sweep.items():
        before, after = plans[slow], plans[fast]
        changed = before.sequence != after.sequence
        count = sum(
            plans[one].sequence != plans[other].sequence for one, other in itertools.pairwise(times)
        )
        name = sequence_name(after.sequence)
        rows.append(
            (
                label,
                f"`{before.sequence_name}`, {before.cost or np.nan:.1f} s",
                f"{f'`{name}`' if changed else 'the same'}, {after.cost or np.nan:.1f} s",
                str(count),
            )
        )
    header = (
        *("problem", f"freeze {slow:g} s", f"freeze {fast:g} s (ten times faster)"),
        "changes in the whole sweep",
    )
    different = sum(plans[slow].sequence != plans[fast].sequence for plans in sweep.values())
    return [
        f"Ten times faster, another sequence is chosen in {different} of {len(sweep)} problems.",
        "",
        *table(header, rows),
    ]


def _columns(sweep: Sweep, reference_s: float, limit_s: float) -> list[str]:
    rows = []
    for freeze in reversed(freezing_times(sweep)):
        plans = column(sweep, freeze)
        gaps = [100 * plan.gap for plan in plans if plan.gap is not None]
        wall = [1e3 * plan.timing.median_s for plan in plans]
        sequences = Counter(plan.sequence for plan in plans)
        rows.append(
            (
                f"{freeze:g}",
                f"{reference_s / freeze:.3g}",
                share(sum(plan.success for plan in plans), len(plans)),
                share(sum(plan.correct for plan in plans), len(plans)),
                str(sum(plan.status == "optimal" for plan in plans)),
                str(sum(plan.stopped_early for plan in plans)),
                str(len(sequences)),
                quantiles([plan.cost for plan in plans if plan.cost], (0.5, 1.0), ".1f"),
                quantiles(gaps, (0.5, 1.0), ".2g"),
                quantiles(wall, (0.5, 0.9, 1.0), ".0f"),
            )
        )
    header = (
        *("freeze [s]", "times faster", "success rate", "correct rate", "proved optimal"),
        *(f"stopped at {limit_s:g} s", "different sequences", "cost [s] median / max"),
        *("proved gap [%] median / max", "wall time [ms] median / p90 / max"),
    )
    return table(header, rows)


def _worst(sweep: Sweep) -> list[str]:
    runs = list(_all(sweep))
    slow = sorted(runs, key=lambda run: -run[1].timing.median_s)[:5]
    loose = sorted(runs, key=lambda run: -(run[1].gap or 0.0))[:5]
    wrong = [run for run in runs if not run[1].correct]
    slowest = ", ".join(
        f"{plan.problem} at {freeze:g} s ({milliseconds(plan.timing.median_s)} ms)"
        for freeze, plan in slow
    )
    loosest = ", ".join(
        f"{plan.problem} at {freeze:g} s ({percent(plan.gap)})" for freeze, plan in loose
    )
    return [
        "## What looks bad",
        "",
        f"- Slowest: {slowest}.",
        f"- Largest proved gaps: {loosest}.",
        *(
            f"- Not correct: {plan.problem} at {freeze:g} s ({plan.status}): {plan.message}"
            for freeze, plan in wrong
        ),
        "",
    ]


def _all(sweep: Sweep) -> Iterator[tuple[float, PlanRecord]]:
    for plans in sweep.values():
        yield from plans.items()


def _limitations(limit_s: float) -> list[str]:
    return [
        "## Limitations",
        "",
        "- Faster robots are the same robot with less heat to move (densities and heating wire), "
        "not designs that anybody has built.",
        f"- A plan stopped at {limit_s:g} s is the best found by then; its sequence may not be the "
        "best one, and the limit is only looked at between two nodes of the search.",
        "- Plans that take longer than the budget for repeats are made once; their wall time "
        "contains building the compiled functions.",
        "- Where the gap is larger than asked, that another sequence is better is not excluded.",
        "",
    ]
