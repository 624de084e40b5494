"""``twosra plan``."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import click

from twosra_mpc import (
    Plan,
    Problem,
    Progress,
    Result,
    Status,
    confirmed_lower_bound,
    plotting,
    save_setpoints,
)
from twosra_mpc.checking.followed import OFF_PATH, plan_off_words
from twosra_mpc.cli import options
from twosra_mpc.cli.options import written
from twosra_mpc.cli.output import Exit, Output, print_table
from twosra_mpc.installation import require
from twosra_mpc.planning.planner import plan_until_interrupted
from twosra_mpc.plans.plan import above_bound, as_confirmed
from twosra_mpc.robot.modes import mode_name


@options.command("plan")
def plan_command(
    scenario: options.Scenario,
    out: Annotated[Path | None, written(options.ending(".json"))],
    csv: Annotated[Path | None, written(options.ending(".csv"))],
    rate_Hz: Annotated[float | None, options.RATE],
    plot: options.Plot,
    proof: bool,
    load: Annotated[options.Load, options.overrides()],
    output: Output,
) -> int:
    """Plan SCENARIO: a built-in name (see "twosra scenarios") or a TOML/JSON file.

    \b
    Plan the first published experiment, and keep plan, figure and set-points at 20 Hz:
      twosra plan paper-1 --out plan.json --plot plan.png --csv setpoints.csv --rate 20
    What the greedy rule of the paper would do:
      twosra plan paper-1 --planner greedy
    Another robot, and how good the plan is proved to be, for a program to read:
      twosra plan shape-change --robot 2sra-v1-paper --json
    A plan for joint bends that may end elsewhere, with what is done then, and a proved bound:
      twosra plan paper-5 --risk mean
    A plan that carries its proof, for "twosra verify --proof":
      twosra plan paper-1 --proof --out plan.json

    Ctrl-C, --work-limit and --time-limit end the search; the best plan so far is written, with its
    true gap. Within a work limit the same plan is found on every machine.

    Options:
        out: Write the plan as JSON.
        csv: Write the set-points as CSV.
        rate_Hz: Rows per second of --csv; default: the plan's grid.
        plot: Draw the plan (png, pdf, svg).
        proof: Add a certificate that proves the bound anew.
    """
    if rate_Hz is not None and csv is None:
        raise click.UsageError("--rate is the rate of --csv, which is not given")
    problem = load(scenario)
    prove = _prover(problem) if proof else None
    result = plan_with_progress(problem, output, f"planning ({problem.planner})")
    if prove is not None and result.lower_bound is not None:
        with output.progress("proving"):
            result = result.proved_by(prove(result.lower_bound))
    if result.plan is not None:
        least_s = confirmed_lower_bound(result.plan)
        result = replace(result, plan=replace(result.plan, confirmed_lower_bound=least_s))
    with output.progress("writing"):
        if out is not None:
            result.save(out)
        if csv is not None and result.plan is not None:
            save_setpoints(result.plan, csv, rate_Hz)
        if plot is not None and result.plan is not None:
            plotting.plot_plan(result.plan, plot, result.policy)
    if result.plan is None and (csv or plot):
        unwritten = " and ".join(str(target) for target in (csv, plot) if target is not None)
        click.echo(f"twosra: there is no plan to write to {unwritten}", err=True)
    if prove is not None and result.certificate is None:
        click.echo("twosra: there is no lower bound to prove", err=True)
    output.report(result.to_dict, lambda: _print_summary(result))
    return exit_code(result)


def _prover(problem: Problem) -> Callable[[float], dict[str, Any]]:
    """Maker of certificates of a problem, if it can have one and the arithmetic is installed."""
    if problem.planner == "greedy":
        raise click.UsageError("--proof proves a lower bound, and the greedy rule has none")
    require("--proof", "proof", "python-flint")
    from twosra_mpc.planning.proof import Prover

    return Prover(problem).certificate


def plan_with_progress(problem: Problem, output: Output, words: str) -> Result:
    """Plan with one line of live progress on standard error, where that is a terminal."""
    with output.progress(words) as tell:

        def show(progress: Progress) -> None:
            best = "none yet" if progress.cost == math.inf else f"{progress.cost:z.1f} s"
            tell(f"{words}: best plan {best}, no plan below {progress.lower_bound:z.1f} s")

        return plan_until_interrupted(problem, on_progress=show)


def _print_summary(result: Result) -> None:
    rows = [("status", result.status.words), ("outcome", result.message)]
    if result.plan is not None:
        rows += _summary(result.plan)
    if (policy := result.policy) is not None:
        rows += [("branch" if i else "policy", words) for i, words in enumerate(policy.sentences)]
    if (proof := result.certificate) is not None:
        size = f"{len(json.dumps(proof)) / 1e3:z.1f} kB, {len(proof['opened'])} sequences opened"
        words = f"proves {proof['bound_s']:z.2f} s of the search's {proof['target_s']:z.2f} s"
        rows.append(("certificate", f"{words} ({size})"))
    print_table((result.problem.robot.name, f"planner {result.planner}"), rows)


def _summary(plan: Plan) -> Iterator[tuple[str, str]]:
    cost, check = plan.cost, plan.verification
    yield "duration", f"{cost.time_s:z.2f} s ({plan.moving_s:z.2f} s of it moving)"
    if words := as_confirmed(plan):
        yield "run", words
    if plan.gap is not None:
        yield "lower bound", f"{plan.lower_bound:z.2f} s; the plan costs {above_bound(plan)}"
    yield "energy", f"{cost.energy_J:z.0f} J in {cost.transitions} transitions"
    if plan.problem.weights.effort:
        yield "effort", f"{cost.effort_s:z.3f} s, with which the plan costs {cost.total:z.2f} s"
    for phase in plan.phases:
        yield f"drive {mode_name(phase.mode)}", f"{phase.start_s:z8.2f} s to {phase.end_s:z8.2f} s"
    for item in plan.transitions:
        span = f"{item.heater_s:z8.2f} s to {item.done_s:z8.2f} s"
        yield f"segment {item.segment} {item.to}", f"{span}, holds from {item.onset_s:z.2f} s"
    if words := plan_off_words(plan.trajectory):
        yield OFF_PATH, words
    goal = max(abs(error) for error in check.goal_error)
    missed = f" (largest goal error {goal:z.1e} m, rad or 1/m)"
    verdict = "passed" if check.ok else "; ".join(check.problems)
    yield "verification", verdict + ("" if plan.problem.ends_anywhere else missed)


def exit_code(*results: Result) -> int:
    """Exit code of a command that plans these: of the worst of them."""
    if any(result.status is Status.INFEASIBLE for result in results):
        return Exit.INFEASIBLE
    finished = all(result.found and not result.stopped_early for result in results)
    return Exit.PLANNED if finished else Exit.NO_PLAN
