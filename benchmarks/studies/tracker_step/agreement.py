"""How far the tracker's first input is from that of the converged nonlinear program.

At random states of a phase, each from a fresh start, as nothing helps that the step before found:
from camera noise up to the largest deviations that count, and at the curvature limit.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.studies.tracker_step.nonlinear import Array, Asked, converged
from twosra_mpc import Plan
from twosra_mpc.execution.tracking.linearisation import stage_model, tracking_program
from twosra_mpc.execution.tracking.setup import Setup, SolverSettings
from twosra_mpc.execution.tracking.solver import ProgramInPlace, Quality
from twosra_mpc.execution.tracking.tracker import PhaseReference
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import is_rigid

NOISE = np.array([1e-3, 1e-3, 5e-3, 0.2, 0.2])  # camera: m, m, rad, 1/m, 1/m
PUSHED = np.array([5e-3, 5e-3, 0.05, 2.0, 2.0])
LARGEST = np.array([0.05, 0.05, 0.5, 20.0, 20.0])  # more counts as this
AT_LIMIT = 0.95  # of the curvature limit, to all of it


def first_speeds(setup: Setup, asked: Asked, deviation: Array) -> Array:
    """Speeds of the first period over their limits, if e_1 is as given."""
    change = asked.reference[1] + setup.scale * deviation - setup.outputs.selection @ asked.q
    q = asked.q.copy()
    if is_rigid(setup.mode):
        q[:POSE] += change / 2
    else:
        bending = stage_model(setup).bending(asked.q).full()
        q[list(setup.outputs.bending)] += bending @ change / 2
    speeds: Array = stage_model(setup).speeds(q, change)[0].full().ravel()
    return speeds


def disagreements(of: Plan, phase: int, setup: Setup, states: int) -> list[float]:
    """Largest difference of the first speeds at each state, in shares of their ranges.

    NaN where the tracker has no command or IPOPT no solution.
    """
    program = ProgramInPlace(tracking_program(setup), SolverSettings())
    best, found = converged(setup), []
    for asked in scattered(of, phase, setup, states):
        program.forget()
        program.measured[:], program.wheels[:] = asked.q, asked.wheels
        program.reference[:] = asked.reference
        solved, first = program.solve() is Quality.CONVERGED, best(asked)
        if not solved or first is None:
            found.append(np.nan)
            continue
        ours = program.quadratic_program().x[: setup.outputs.count]
        apart = np.subtract(*(first_speeds(setup, asked, e) for e in (ours, first)))
        found.append(float(np.abs(apart).max()) / 2)
    return found


def scattered(of: Plan, phase: int, setup: Setup, states: int) -> Iterator[Asked]:
    """Yield random states: of each four a noisy, a pushed, a lost one, one at the curvature limit.

    The units move as in the plan, or rest.
    """
    path, samples, rng = of.phases[phase], of.samples, np.random.default_rng(5)
    outputs = setup.outputs.selection
    reference = PhaseReference(of.trajectory, path, outputs, setup.horizon, setup.period_s)
    limit, size = setup.body.limits.curvature_per_m, setup.coordinates.size
    for i in range(states):
        time_s = rng.uniform(path.start_s, path.end_s)
        q = of.trajectory.configuration(np.array([time_s]))[0]
        q += (NOISE, PUSHED, LARGEST, PUSHED)[i % 4] * rng.uniform(-1.0, 1.0, size)
        if i % 4 == 3:
            near = limit * rng.uniform(AT_LIMIT, 1.0, size - POSE)
            q[POSE:] = np.copysign(near, q[POSE:])
        asked = np.zeros((setup.horizon + 1, setup.outputs.count))
        reference.write(time_s, asked)
        v = samples.v[np.searchsorted(samples.t_s, time_s)] * rng.integers(2)
        wheels = kinematics(setup.body).wheel_matrix(q, setup.mode).full() @ v
        yield Asked(q, asked, wheels)
