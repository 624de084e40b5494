"""``python -m benchmarks.tracker_step``: one step of the tracker against other ways to compute it.

The question: what does a step cost, how well is it solved, and what does its command lose against
the converged nonlinear program? All solve the same recorded steps, of a robot that follows a plan
from a disturbed start with camera noise and then rests at the phase's end. QP means the tracker's
linearised program, NLP the same cost with the limits as they are.
"""

from __future__ import annotations

import importlib.util
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.report_file import out_option, publish
from benchmarks.tracker_nlps import Fatrop, Gekko, Ipopt
from benchmarks.tracker_solvers import Answer, Piqp, PlainOsqp, Recorded, Solver, TrackerStep
from twosra_mpc import Plan, load_problem, plan
from twosra_mpc.execution.tracking.linearisation import tracking_program
from twosra_mpc.execution.tracking.reference import PhaseReference
from twosra_mpc.execution.tracking.settings import SolverSettings, TrackerLimits, TrackerWeights
from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.execution.tracking.solver import ProgramInPlace
from twosra_mpc.execution.tracking.stage import stage_model
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.robot.modes import RIGID, mode_name

Array = NDArray[np.float64]

NOISE = np.array([1e-3, 1e-3, 5e-3, 0.2, 0.2])  # camera: m, m, rad, 1/m, 1/m
PUSH = np.array([5e-3, -5e-3, 0.05, 0.0, 0.0])  # 5 mm and 3 degrees, at the start
REST_S = 0.7
RUNS = 6
ROUNDS = 20  # of the tracker, whose steps are too short to time once
SLOW_STEPS = 12  # for solvers that take milliseconds or more
CASES = (("paper-2", 0), ("paper-2", 1), ("paper-1", 2))


def record(of: Plan, phase: int, setup: Setup) -> list[Recorded]:
    """Drive the model in closed loop and keep what every step was given."""
    path, samples, h = of.phases[phase], of.samples, setup.period_s
    program = ProgramInPlace(tracking_program(setup), SolverSettings())
    selection = setup.outputs.selection
    reference = PhaseReference(of.trajectory, path, selection, setup.horizon, h)
    flow = interval_flow(of.robot, 16)
    start = samples.q[np.searchsorted(samples.t_s, path.start_s - 1e-6)]
    steps = []
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        q, previous, wheels = start + PUSH, np.zeros(setup.variables), np.zeros(4)
        program.forget()
        for k in range(int((path.end_s - path.start_s + REST_S) / h)):
            time_s = path.start_s + k * h
            program.measured[:] = measured = q + NOISE * rng.normal(size=5)
            program.wheels[:] = wheels
            reference.write(time_s, program.reference)
            at = program.reference.copy()
            program.solve()
            solved = program.quadratic_program()
            steps.append(Recorded(k == 0, time_s, measured, at, previous, wheels, solved))
            previous, wheels = solved.x, program.command.copy()
            q = flow(q, program.v * h, setup.mode).full().ravel()
    return steps


def first_speeds(setup: Setup, step: Recorded, deviation: Array) -> Array:
    """Speeds of the first period over their limits, if e_1 is as given."""
    y = setup.outputs.selection @ step.q
    change = step.reference[1] + setup.scale * deviation - y
    q = step.q.copy()
    if setup.mode == RIGID:
        q[:3] += change / 2
    else:
        bending = stage_model(setup).bending(step.q).full()
        q[list(setup.outputs.bending)] += bending @ change / 2
    speeds: Array = stage_model(setup).speeds(q, change)[0].full().ravel()
    return speeds


def row(
    solver: Solver, setup: Setup, steps: Sequence[Recorded], best: Sequence[Array], base: Array
) -> tuple[str, Array, Array]:
    """A line of the table, median and least time of each step [s]; ``base``: the tracker's."""
    answers: list[Answer] = [solver.solve(step) for step in steps]
    rounds = [[answer.taken for answer in answers]]
    if isinstance(solver, TrackerStep):
        rounds += [[solver.solve(step).taken for step in steps] for _ in range(ROUNDS)]
    taken = np.array(rounds)
    each = np.median(taken[:, :, 0], axis=0)
    errors = [
        np.abs(first_speeds(setup, step, answer.first) - at).max()
        for step, answer, at in zip(steps, answers, best, strict=True)
    ]
    wall, core = (
        " / ".join(f"{1e6 * np.quantile(taken[:, :, clock], q):.0f}" for q in (0.0, 0.5, 0.99))
        for clock in (0, 1)
    )
    ratio = "1" if not len(base) else f"{np.median(each / base):.3g}"
    primal = max(answer.primal for answer in answers)
    dual = max(answer.dual for answer in answers)
    success = sum(answer.success for answer in answers)
    line = (
        f"| {solver.name} | {solver.solves} | {success} of {len(steps)} "
        f"| {wall} | {core if solver.name != 'GEKKO, local' else 'another process'} | {ratio} "
        f"| {primal:.1e} | {dual:.1e} | {np.median(errors):.1e} / {max(errors):.1e} |"
    )
    return line.replace("nan", "not told"), each, taken[:, :, 0].min(axis=0)


def rivals(setup: Setup) -> tuple[list[Solver], list[str]]:
    """Every other solver for this mode on this machine; lines on those not installed."""
    found: list[Solver] = [PlainOsqp(setup)]
    missing = []
    kinds = [("piqp", Piqp), ("casadi", Ipopt)]
    if setup.mode == RIGID:
        kinds += [("casadi", Fatrop), ("gekko", Gekko)]
    for package, kind in kinds:
        if importlib.util.find_spec(package) is None:
            missing.append(f"- {kind.name} is left out: package {package} is not installed.")
        else:
            found.append(kind(setup))
    return found, missing


def table(scenario: str, phase: int) -> list[str]:
    """Report on one phase of one plan."""
    of = plan(load_problem(scenario)).require()
    mode = of.phases[phase].mode
    setup = Setup(of.robot, mode, 20, 1 / 15, TrackerWeights(), TrackerLimits())
    steps = record(of, phase, setup)
    converged = Ipopt(setup, 1e-10)
    best = [first_speeds(setup, step, converged.solve(step).first) for step in steps]
    iterations = np.array([step.program.iterations for step in steps])
    lines = [
        "",
        f"## Mode {mode_name(mode)}: phase {phase} of {scenario}, N = {setup.horizon}, "
        f"{len(steps)} steps",
        "",
        "| solver | solves | success | wall [us] min / median / p99 | core [us] min / median / p99 "
        "| times the tracker | primal residual | dual residual "
        "| error of the first speeds, median / max |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    line, base, least = row(TrackerStep(of, phase), setup, steps, best, np.array([]))
    lines.append(line)
    solvers, missing = rivals(setup)
    for solver in solvers:
        some = steps if solver.solves == "QP" else steps[:: max(1, len(steps) // SLOW_STEPS)]
        chosen = [steps.index(step) for step in some]
        lines.append(row(solver, setup, some, [best[i] for i in chosen], base[chosen])[0])
    quiet = " / ".join(f"{1e6 * np.quantile(least, q):.0f}" for q in (0.5, 0.9, 0.99, 1.0))
    spread = " / ".join(f"{np.quantile(iterations, q):.0f}" for q in (0.5, 0.9, 1.0))
    lines += [
        "",
        f"- Tracker, each step's least time of {ROUNDS + 1} rounds, which is nearest to a core of "
        f"its own; over the steps, median / p90 / p99 / max: {quiet} us.",
        f"- ADMM iterations of the tracker, median / p90 / max: {spread}.",
    ]
    return [*lines, *missing]


@click.command()
@out_option("Write the report here as well.")
def main(out: Path | None) -> None:
    """Print a Markdown report."""
    lines = [
        "# One step of the tracker",
        "",
        f"Python {platform.python_version()}, casadi {version('casadi')}, osqp {version('osqp')}, "
        f"{platform.machine()}, one thread. Residuals are of the program each solves, in its "
        "scaled units; errors are shares of the speed limits, against IPOPT at 1e-10. Times are of "
        "everything a control loop would do; core time leaves out what other programs took.",
    ]
    for scenario, phase in CASES:
        lines += table(scenario, phase)
    lines += [
        "- Limitation: NLP solvers are compared on every n-th step, each started from the solution "
        "of the step before it. Machines differ: compare within one run only.",
        "",
    ]
    publish("\n".join(lines), out)


if __name__ == "__main__":
    main()
