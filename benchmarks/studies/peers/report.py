"""The comparison in words and numbers: one Markdown document."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.machine import machine, versions
from benchmarks.markdown import table
from benchmarks.peers.answer import Peer
from benchmarks.peers.comparison import CALLS, Row

_COLUMNS = (
    "problem",
    "peer",
    "status",
    "sequence",
    "verified",
    "cost [s]",
    "ours [s]",
    "above ours [%]",
    "wall [s]",
    "wall / ours",
    "CPU [s]",
    "CPU / ours",
)
_SUMMARY = (
    "peer",
    "verified",
    "cost above ours [%]: mean / worst / best",
    "wall time / ours: mean / least / most",
    "CPU time / ours: mean / least / most",
)
_ROUNDING = 1e-6  # relative; costs closer than this are equal

LIMITATIONS = """\
## Limitations

- Every peer's motion is landed, scheduled by our temporal network and verified after its clock has
  stopped; our time, and that of the enumeration, includes all of it.
- Programs are compiled before the clock starts, ours as well. All of them are run by CasADi's
  virtual machine with exact derivatives; generated C code would make every planner faster.
- The time-grid MINLP is not convex, so Bonmin's branch and bound is a heuristic and its bound no
  proof. Bonmin counts CPU time and looks at its limit between nonlinear programs only.
  Shorter stages, root heuristics and outer approximation were tried; a valid inequality on the
  finish raised its bound to within 12 % but lost the incumbents.
- Its timing is stage-wise: standstill while a segment melts or freezes, heating from t = 0. It does
  not know that a second melt needs heating again, nor what else the segments' history changes.
- The integral approximation rounds once. Where the rounded sequence has no plan, it has none.
- The enumeration solves our own multiple-shooting program from cold guesses, sequences of at most
  four phases; what it misses are the bounds and the guesses made from them.
- None of the peers proves anything. Times are of one shared machine: compare within a row only.
"""


def report(rows: Sequence[Row], peers: Sequence[Peer]) -> str:
    """Write the Markdown report."""
    facts = {**machine(), **versions()}
    loads = [row.load for row in rows]
    lines = [
        "# Peer planners against ours",
        "",
        *table(("machine and versions", ""), list(facts.items())),
        f"One thread. Load average as the rows were done: {min(loads):.1f} to {max(loads):.1f}.",
        f"Ours: median of {CALLS} warm calls before each problem's peers, in the same process.",
        "",
        *table(("peer", "settings"), [(peer.name, _settings(peer)) for peer in peers]),
        *table(_COLUMNS, [_cells(row) for row in rows]),
        "## Summary",
        "",
        *table(_SUMMARY, [_summary(peer.name, rows) for peer in peers]),
        "Means are geometric; costs are compared where both planners have a verified plan.",
        "",
        *_checks(rows),
        "",
        LIMITATIONS,
    ]
    return "\n".join(lines)


def _settings(peer: Peer) -> str:
    return ", ".join(f"{name} {value}" for name, value in peer.settings.items())


def cost_ratio(row: Row) -> float | None:
    """Cost over our cost; None unless both planners have a verified plan."""
    if not row.verified or row.cost is None or not row.our_cost:
        return None
    return row.cost / row.our_cost


def _cells(row: Row) -> list[str]:
    ratio = cost_ratio(row)
    return [
        row.problem,
        row.peer,
        row.status,
        row.sequence.replace(" ", "") or "-",
        "yes" if row.verified else f"no: {'; '.join(row.problems)}",
        _number(row.cost, ".2f"),
        _number(row.our_cost, ".2f"),
        _number(None if ratio is None else 100 * (ratio - 1), ".3f"),
        f"{row.wall_s:.2f}",
        f"{row.wall_s / row.our_wall_s:.0f}",
        f"{row.cpu_s:.2f}",
        f"{row.cpu_s / row.our_cpu_s:.0f}",
    ]


def _number(value: float | None, layout: str) -> str:
    return "-" if value is None else format(value, layout)


def _summary(name: str, every: Sequence[Row]) -> list[str]:
    rows = [row for row in every if row.peer == name]
    ratios = [ratio for row in rows if (ratio := cost_ratio(row)) is not None]
    verified = sum(row.verified for row in rows)
    costs = "-"
    if ratios:
        above = [100 * (value - 1) for value in (_mean(ratios), max(ratios), min(ratios))]
        costs = " / ".join(f"{value:.3f}" for value in above)
    wall = _spread([row.wall_s / row.our_wall_s for row in rows])
    cpu = _spread([row.cpu_s / row.our_cpu_s for row in rows])
    return [name, f"{verified} of {len(rows)}", costs, wall, cpu]


def _spread(ratios: Sequence[float]) -> str:
    return " / ".join(f"{value:.1f}" for value in (_mean(ratios), min(ratios), max(ratios)))


def _mean(ratios: Sequence[float]) -> float:
    return math.exp(float(np.mean(np.log(ratios))))


def _checks(rows: Sequence[Row]) -> list[str]:
    """What must not happen, and whether it did."""
    below = [
        f"{row.problem} ({row.peer})"
        for row in rows
        if row.verified
        and row.cost is not None
        and row.our_lower_bound is not None
        and row.cost < row.our_lower_bound * (1 - _ROUNDING)
    ]
    better = [
        f"{row.problem} ({row.peer}, {100 * (1 - ratio):.4f} %)"
        for row in rows
        if (ratio := cost_ratio(row)) is not None and ratio < 1 - _ROUNDING
    ]
    unplanned = sorted({row.problem for row in rows if row.our_cost is None})
    return [
        f"- Verified costs below our proved lower bound: {', '.join(below) or 'none'}.",
        f"- Verified costs below ours: {', '.join(better) or 'none'}.",
        f"- Problems without a plan of ours: {', '.join(unplanned) or 'none'}.",
    ]
