"""``twosra simulate``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import click
import numpy as np

from twosra_mpc import Problem, Result, plotting
from twosra_mpc.checking.followed import OFF_PATH, off_words
from twosra_mpc.cli import options
from twosra_mpc.cli.options import option, word
from twosra_mpc.cli.output import Exit, Output, counting, print_table
from twosra_mpc.cli.planning import exit_code, plan_with_progress
from twosra_mpc.execution.run import Ending, times
from twosra_mpc.execution.simulation.disturbance import LEVELS, disturbance_level
from twosra_mpc.execution.simulation.plant import ALL_PLANTS, SimulatedRobot
from twosra_mpc.execution.simulation.simulate import (
    EXECUTORS,
    Metrics,
    Simulation,
    simulate,
)
from twosra_mpc.files import write_json
from twosra_mpc.plans.plan import planned_words


@options.command("simulate")
def simulate_command(
    scenario: options.Scenario,
    plant: Annotated[str, word(ALL_PLANTS, default="arc")],
    viewer: bool,
    disturbance: Annotated[str, word(LEVELS, default="moderate")],
    seed: Annotated[int, option(type=click.IntRange(min=0), default=0)],
    executor: Annotated[str, option(type=click.Choice(EXECUTORS), default="optimal")],
    runs: Annotated[int, option(type=click.IntRange(1), default=1)],
    broken: Annotated[tuple[int, ...], option("--broken-heater")],
    load: Annotated[options.Load, options.overrides("planner", "max_phases")],
    out: Annotated[Path | None, options.written()],
    plot: options.Plot,
    animate: Annotated[Path | None, options.written(options.film)],
    output: Output,
) -> int:
    """Run SCENARIO in closed loop on a simulated robot: plan, execute, plan again when needed.

    The robot slips, drifts, melts earlier or later than its description says, and is seen by a
    camera that is late, noisy and rounds; all of it is drawn from --seed. Where segments may share
    a bend unequally the plan is the one that takes least time on average, unless --risk says else.

    \b
    A run with its figure and its film:
      twosra simulate paper-1 --seed 1 --out run.json --plot run.png --animate run.gif
    What to expect of the same task on ten robots:
      twosra simulate paper-1 --runs 10
    The same robot in a rigid-body engine, with rolling wheels and a fibre of springs:
      twosra simulate rigid-move --plant mujoco --seed 1
    A heater fails; here the other segment alone cannot reach the goal, and the reason is given:
      twosra simulate paper-2 --broken-heater 1

    Options:
        plant: How it moves: {}.
        viewer: Watch the first run of plant mujoco.
        disturbance: How far from its description: {}.
        seed: Of all that is drawn.
        executor: Follow an optimal plan, or act by the greedy rule.
        runs: Run as many robots, and sum up.
        broken: Number of a segment.
        out: Write the (first) run as JSON.
        plot: Draw it (png, pdf, svg).
        animate: Film it (gif; mp4 with ffmpeg).
    """
    problem = load(scenario, to_run=True)
    level = disturbance_level(disturbance)
    SimulatedRobot(problem, plant, level, seed, broken_heaters=broken)  # or an error, early
    optimal = problem.with_values(planner="optimal")
    result = plan_with_progress(optimal, output, "planning")
    if executor == "optimal" and not result.found:
        click.echo(f"twosra: there is nothing to run: {result.message}", err=True)
        return exit_code(result)
    drawn: dict[str, Any] = {"plant": plant, "disturbance": disturbance, "executor": executor}
    drawn |= {"broken_heaters": broken, "plan": result.plan}
    with output.progress(f"running 1 of {runs}") as tell:
        first = simulate(problem, seed=seed, viewer=viewer, **drawn)
        tell("writing")
        if out is not None:
            write_json(out, first.to_dict())
        if plot is not None:
            plotting.plot_run(first.run, first.truth, plot)
        if animate is not None:
            shown = counting(tell, "filming: frame")
            plotting.animate_run(first.run, animate, first.truth, on_progress=shown)
        found = [first.metrics]
        for other in range(1, runs):
            tell(f"running {other + 1} of {runs}")
            found.append(simulate(problem, seed=seed + other, **drawn).metrics)
    if runs == 1:
        output.report(first.to_dict, lambda: _print_run(first))
    else:
        document = {"plan": result.to_dict(), "first_seed": seed, "runs": found}
        output.report(lambda: document, lambda: _print_runs(problem, result, found))
    missed = {each.ending for each in found if not each.reached}
    if missed == {Ending.UNSEEN}:
        return Exit.UNSEEN
    return Exit.NO_PLAN if missed else Exit.PLANNED


def _print_run(simulation: Simulation) -> None:
    run, found, problem = simulation.run, simulation.metrics, simulation.run.problem
    against = f", planned were {planned_words(run.plans[0])}" if run.plans else ""
    degrees, curvature = math.degrees(found.heading_rad), found.curvature_per_m
    error = f"{1e3 * found.position_m:z.2f} mm, {degrees:z.2f} degrees, {curvature:z.2f} 1/m"
    again = f"{times(run.replans)}, and the pose was corrected {times(run.corrections)}"
    done = f"{found.tasks_done} of {len(problem.tasks)}"
    rows = {
        "ending": str(run.ending),
        "reason": run.reason,
        "true error": "" if problem.ends_anywhere else error,
        f"true error, {OFF_PATH}": _off_path(found),
        "duration": f"{found.time_s:z.1f} s{against}",
        "energy": f"{found.energy_J:z.0f} J in {found.transitions} transitions",
        "planned again": again,
        "true clearance": _clearance(simulation),
        "tasks done": done if any(task.rests for task in problem.tasks) else "",
        "true error of objects": _off_target(found),
        "objects lost": times(found.lost) if problem.objects else "",
        "squeezed": found.squeezed,
    }
    title = problem.robot.name, f"executor {run.executor}, disturbance {simulation.disturbance}"
    print_table(title, [(name, words) for name, words in rows.items() if words])
    events = [(f"{event.time_s:z.1f} s", event.kind, event.text) for event in run.events]
    print_table(("time", "event", "what"), events)


def _clearance(simulation: Simulation) -> str:
    """How near obstacles were, in words; empty without any."""
    run, found = simulation.run, simulation.metrics
    if (least_m := found.least_clearance_m) is None:
        return ""
    needed_m = LEVELS[simulation.disturbance].clearance_m
    planned_m = (run.plans[-1] if run.plans else run).problem.clearance_m
    least = found.touched or f"{1e3 * least_m:z.1f} mm at the closest approach"
    advice = f", needed are {1e3 * needed_m:z.3g}" if planned_m < needed_m else ""
    return f"{least}, planned were {1e3 * planned_m:z.3g} mm{advice}"


def _off_path(found: Metrics) -> str:
    """How a path was followed, in words; empty without one."""
    if found.off_path_mean_m is None or found.off_path_m is None:
        return ""
    late = "" if found.late_s is None else f"; {found.late_s:z.1f} s late at worst"
    return off_words(found.off_path_mean_m, found.off_path_m) + late


def _off_target(found: Metrics) -> str:
    """How far off objects were, in words; empty where nothing is known of any."""
    if found.object_m is None:
        return ""
    degrees = math.degrees(found.object_rad or 0.0)
    return f"{1e3 * found.object_m:z.2f} mm, {degrees:z.2f} degrees"


def _print_runs(problem: Problem, result: Result, found: list[Metrics]) -> None:
    """Distribution of the numbers over the runs."""
    of_goal: dict[str, tuple[str, float]] = {
        "position error [mm]": ("position_m", 1e3),
        "heading error [degrees]": ("heading_rad", math.degrees(1.0)),
        "curvature error [1/m]": ("curvature_per_m", 1.0),
    }
    names = {
        "duration [s]": ("time_s", 1.0),
        "transitions": ("transitions", 1.0),
        "energy [J]": ("energy_J", 1.0),
        "planned again": ("replans", 1.0),
        "pose corrected": ("corrections", 1.0),
        **({} if problem.ends_anywhere else of_goal),
        "object error [mm]": ("object_m", 1e3),
        f"{OFF_PATH}, mean [mm]": ("off_path_mean_m", 1e3),
        f"{OFF_PATH}, worst [mm]": ("off_path_m", 1e3),
        "late at worst [s]": ("late_s", 1.0),
    }
    rows = [("reached", f"{sum(each.reached for each in found)} of {len(found)}", "", "")]
    for words, (name, unit) in names.items():
        values = [unit * value for each in found if (value := getattr(each, name)) is not None]
        if values:
            median, most, largest = (f"{each:z.4g}" for each in np.quantile(values, (0.5, 0.9, 1)))
            rows.append((words, median, most, largest))
    if problem.objects:
        rows.append(("objects lost", f"{sum(each.lost for each in found)} in all", "", ""))
    if cleared := [1e3 * m for each in found if (m := each.least_clearance_m) is not None]:
        least = f"least {min(cleared):z.4g}"
        rows.append(("true clearance [mm]", f"{np.median(cleared):z.4g}", "", least))
    planned = f", planned {planned_words(result.plan)}" if result.plan else ""
    print_table((f"{problem.robot.name}{planned}", "median", "90 %", "largest"), rows)
    reasons = [(each.ending, each.touched or each.reason) for each in found if not each.reached]
    if reasons:
        print_table(("not reached", "reason"), reasons)
