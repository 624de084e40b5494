"""The steps that all solvers are given, and what an answer's first command is worth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.tracker_step.solvers import Recorded
from twosra_mpc import Plan
from twosra_mpc.execution.tracking.linearisation import tracking_program
from twosra_mpc.execution.tracking.reference import PhaseReference
from twosra_mpc.execution.tracking.settings import SolverSettings
from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.execution.tracking.solver import ProgramInPlace
from twosra_mpc.execution.tracking.stage import stage_model
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.robot.modes import is_rigid

Array = NDArray[np.float64]

NOISE = np.array([1e-3, 1e-3, 5e-3, 0.2, 0.2])  # camera: m, m, rad, 1/m, 1/m
PUSH = np.array([5e-3, -5e-3, 0.05, 0.0, 0.0])  # 5 mm and 3 degrees, at the start
REST_S = 0.7


def record_steps(of: Plan, phase: int, setup: Setup, runs: int) -> list[Recorded]:
    """Drive the model in closed loop and keep what every step was given."""
    assert of.samples is not None
    path, samples, h = of.phases[phase], of.samples, setup.period_s
    program = ProgramInPlace(tracking_program(setup), SolverSettings())
    selection = setup.outputs.selection
    reference = PhaseReference(of.trajectory, path, selection, setup.horizon, h)
    flow = interval_flow(of.robot, 16)
    start = samples.q[np.searchsorted(samples.t_s, path.start_s - 1e-6)]
    steps = []
    for seed in range(runs):
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
    change = step.reference[1] + setup.scale * deviation - setup.outputs.selection @ step.q
    q = step.q.copy()
    if is_rigid(setup.mode):
        q[:3] += change / 2
    else:
        bending = stage_model(setup).bending(step.q).full()
        q[list(setup.outputs.bending)] += bending @ change / 2
    speeds: Array = stage_model(setup).speeds(q, change)[0].full().ravel()
    return speeds
