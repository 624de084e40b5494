"""Algorithm 1 as published: the greedy loop on the published model.

Source: Labazanova et al., IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749, Algorithm 1. This module
reproduces the published simulations, and is the reference in benchmarks; the model, with its q,
v, sigma and J, is ``published_model``. Nothing is repaired here either; the planner to use
is ``planning.planner``. One iteration at t = DT, 2 DT, ... is::

    v_i = J_i^+ (q_t - q) t,    q*_i = q + (1 - e^-t) J_i v_i DT,    i in {00, 01, 10, 11}

The mode nearest the target is taken once and then kept until its candidate no longer moves q.
With e = q_t - q, a step is P e t (1 - e^-t) DT, where P = J J^+ is an orthogonal projector: the
distance cannot grow until the gain t (1 - e^-t) DT passes 2, near t DT = 2. A problem that has not
stopped by then diverges: about one generic problem in some thousand, by chance of round-off, and
every one whose target is zero in all coordinates, because floats near zero have no last bit to
stop on.

The five published simulations: their tasks are those of the built-in scenarios, trial n of the
hardware has the task ``paper-n``; what else they were run with is by the authors' simulated
trajectories (2sr-agent-simulation).

Random problems are drawn as its authors draw, and without structure. The authors' script
(``control.py``) draws a start, a stiffness and an input by Python's ``random``, and lets forward
kinematics make the target with both constant for 10 s: one mode alone leads to every target. Its
draws have no seed; with one, in the same order, they can be repeated on any machine.
"""

from __future__ import annotations

import enum
import math
import random
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.arguments import public
from twosra_mpc.files import data_file
from twosra_mpc.lab.reproduction.published_model import (
    CURVATURE_RANGE,
    SEGMENT_M,
    HeldFrames,
    Vector,
    checked_configuration,
    combination,
    difference,
    distance,
    held_frames,
    inverse_kinematics,
    published_jacobian,
)
from twosra_mpc.problem.problem import load_problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import MODES, RIGID, Mode, ModeSequence, merged
from twosra_mpc.validation import Count, Positive, ReadOnlyArrays

IntArray: TypeAlias = NDArray[np.int64]

_CURVATURE_LIMIT = 10.0 * CURVATURE_RANGE  # 1/m, beyond it the run is given up as diverged
_STAGNATION = 1e-17  # a step that moves q by no more changes the mode
_RECORDED_STEP = 1e-5  # a step that moves q by more is recorded
_DIVERGENCE_FACTOR = 10.0  # of the first distance: farther off, a run is given up


class StopReason(enum.Enum):
    """Reason for the loop's end, and what to do about it."""

    REACHED = "The target was reached to the last bit."
    DIVERGED = (
        "The configuration ran away, because the published gain t (1 - e^-t) DT passed 2 before "
        "the target was met to the last bit: try another step_s, or use another planner."
    )
    ITERATION_LIMIT = (
        "max_iterations was used up before the target was reached: raise max_iterations, or "
        "accept final_q if its error is small enough."
    )


@dataclass(frozen=True, eq=False, repr=False)
class PublishedTrajectory(ReadOnlyArrays):
    """The recorded rows of one run; row 0 is the start with mode (0, 0). Arrays are read-only.

    As published, only steps longer than 1e-5 (unweighted norm of m, rad and 1/m) are recorded.
    The last rows of a diverged run are the divergence itself.

    Attributes:
        q: (n, 5) configurations [x, y, phi, kappa_1, kappa_2] in m, rad, 1/m.
        mode: (n, 2) stiffness (s_1, s_2), 1 = soft, of the step that led to the row.
        velocity: (n, 5) input [v_1, v_2, u_0, v_0, r_0] in m/s and rad/s of that step, before
            the factor 1 - e^-t; zero in row 0.
        iteration: (n,) loop iteration, counted from 0, that made the row; -1 in row 0.
        final_q: (5,) configuration at the end, after the last unrecorded steps.
        stop: why the loop ended.
        iterations: how many iterations were run.
        every_mode: modes of all iterations, recorded or not, without repetitions.
    """

    q: Array
    mode: IntArray
    velocity: Array
    iteration: IntArray
    final_q: Array
    stop: StopReason
    iterations: int
    every_mode: ModeSequence

    @property
    def sequence(self) -> ModeSequence:
        """Recorded modes without repetitions; the start is not one."""
        return merged(map(tuple, self.mode[1:].tolist()))


class _Problem(NamedTuple):
    """Constants of one run."""

    goal: Vector
    held: HeldFrames
    step_s: float
    forced: frozenset[int]
    distance_limit: float
    max_iterations: int


class _Step(NamedTuple):
    """A candidate configuration and how it is reached."""

    q: Vector
    mode: Mode
    velocity: Vector
    moved: float  # distance from the configuration before the step


@public
def published_trajectory(
    start: ArrayLike,
    goal: ArrayLike,
    *,
    step_s: Positive = 0.05,
    switch_iterations: Sequence[int] | None = None,
    max_iterations: Count = 5000,
) -> PublishedTrajectory:
    """Run Algorithm 1 from start to goal.

    Args:
        start: (5,) configuration in m, rad, 1/m; curvatures within +-2 pi / l = +-157 1/m.
        goal: (5,) target, likewise.
        step_s: time step DT in s; published: 0.05, and 0.1 for simulation 5.
        switch_iterations: iterations (from 0) at which the mode is chosen anew. Up to the last
            of them they replace the stagnation test, whose verdict hangs on the last bit.
        max_iterations: iterations after which the loop is stopped.

    Returns:
        The recorded rows and the reason for stopping.

    Raises:
        InputError: On a malformed or out-of-range argument.
    """
    first = checked_configuration("start", start)
    target = checked_configuration("goal", goal)
    forced = frozenset(switch_iterations or ())
    problem = _Problem(
        goal=target,
        held=held_frames(first),
        step_s=step_s,
        forced=forced,
        distance_limit=_DIVERGENCE_FACTOR * max(distance(first, target), 1.0),
        max_iterations=max_iterations,
    )
    step = _Step(first, RIGID, [0.0, 0.0, 0.0, 0.0, 0.0], moved=0.0)
    iterations, steps = [-1], [step]  # that are recorded
    modes: list[Mode] = []  # of all iterations
    time_s, iteration = step_s, 0
    while (stop := _stop_reason(step.q, iteration, problem)) is None:
        step = _next_step(step, time_s, iteration, problem)
        modes.append(step.mode)
        if step.moved > _RECORDED_STEP:
            iterations.append(iteration)
            steps.append(step)
        time_s += step_s  # by addition, as published: not bit for bit (iteration + 2) * step_s
        iteration += 1
    return PublishedTrajectory(
        q=np.array([each.q for each in steps]),
        mode=np.array([each.mode for each in steps], dtype=np.int64),
        velocity=np.array([each.velocity for each in steps]),
        iteration=np.array(iterations, dtype=np.int64),
        final_q=np.array(step.q),
        stop=stop,
        iterations=iteration,
        every_mode=merged(modes),
    )


def _stop_reason(q: Vector, iteration: int, problem: _Problem) -> StopReason | None:
    remaining = distance(q, problem.goal)
    if remaining == 0.0:  # the published test; no tolerance
        return StopReason.REACHED
    bent = max(abs(q[3]), abs(q[4]))
    if not (remaining <= problem.distance_limit and bent <= _CURVATURE_LIMIT):  # also when NaN
        return StopReason.DIVERGED
    if iteration >= problem.max_iterations:
        return StopReason.ITERATION_LIMIT
    return None


def _next_step(previous: _Step, time_s: float, iteration: int, problem: _Problem) -> _Step:
    """Keep the previous mode while it may be kept, otherwise take the one nearest the goal.

    The published loop evaluates all four modes in every iteration and then overrules the best of
    them in favour of the previous one; asking the previous one first gives the same choice.
    """
    if iteration > 0:  # the first choice is free
        kept = _candidate(previous.q, previous.mode, time_s, problem)
        # The paper has 0, the simulations 1e-17. Coordinates above 0.125 cannot move by less than
        # 2.8e-17, so this asks whether the last bit of any of them still changes.
        stays = kept.moved > _STAGNATION
        if iteration <= max(problem.forced, default=-1):
            stays = iteration not in problem.forced
        if stays:
            return kept
    candidates = (_candidate(previous.q, mode, time_s, problem) for mode in MODES)
    return min(candidates, key=lambda step: distance(step.q, problem.goal))


def _candidate(q: Vector, mode: Mode, time_s: float, problem: _Problem) -> _Step:
    """Take one Euler step of the feedback law v = J^+ (q_t - q) t in one mode."""
    demand = [error * time_s for error in difference(problem.goal, q)]
    velocity, rate = inverse_kinematics(q, mode, demand, problem.held)
    ramp = 1.0 - math.exp(-time_s)
    reached = combination(1.0, q, problem.step_s, [ramp * change for change in rate])
    return _Step(reached, mode, velocity, moved=distance(reached, q))


@dataclass(frozen=True, eq=False)
class Simulation:
    """A published simulation, and what was published of its task.

    Attributes:
        number: Its number in the authors' data.
        task: Scenario with its start and goal.
        step_s: Time step.
        switches: Iterations at which the mode changed. The published rule looks at the last bit of
            the configuration, on which C libraries differ; so they are given.
        sequence: Modes of the authors' simulated trajectory.
        rows: Rows that it records.
        dtw: Distances of the trial from it by dynamic time warping, of x, y, phi, kappa_1 and
            kappa_2 (bar plot of Fig. 7(b), from the authors' notebook).
    """

    number: int
    task: str
    step_s: float
    switches: list[int]
    sequence: ModeSequence
    rows: int
    dtw: list[float]

    @cached_property
    def start(self) -> Array:
        """First configuration [m, m, rad, 1/m, 1/m], (5,)."""
        return load_problem(self.task).start.configuration

    @cached_property
    def goal(self) -> Array:
        """Target [m, m, rad, 1/m, 1/m], (5,)."""
        return load_problem(self.task).goal.configuration

    @cache  # noqa: B019 (five values in all)
    def run(self) -> PublishedTrajectory:
        """The published trajectory, to rounding error."""
        timed: dict[str, Any] = {"step_s": self.step_s, "switch_iterations": self.switches}
        return published_trajectory(self.start, self.goal, **timed)

    @cache  # noqa: B019 (the same)
    def run_freely(self) -> PublishedTrajectory:
        """The published loop on the same task, switching where the last bit tells it to here."""
        return published_trajectory(self.start, self.goal, step_s=self.step_s)


# Trial of the hardware -> its simulation; trial n has the task paper-n.
_PUBLISHED = tomllib.loads(data_file("lab/reproduction/published_runs.toml"))["simulation"]
SIMULATIONS = {
    trial: Simulation(**each | {"sequence": tuple(map(tuple, each["sequence"]))})
    for trial, each in enumerate(_PUBLISHED, start=1)
}


STEP_S, STEPS = 0.05, 200  # of forward kinematics
MOST_PER_M = 1.5 * math.pi / SEGMENT_M  # it ends before a curvature beyond
GENERIC = np.array([0.25, 0.25, math.pi, 78.0, 78.0])  # [m, m, rad, 1/m, 1/m], to both sides

Kind = Literal["single-mode", "generic"]


class RandomRun(NamedTuple):
    """The published loop on a random problem.

    Attributes:
        target_mode: Mode in which forward kinematics made the target; None if it was drawn.
        run: The loop's trajectory.
    """

    target_mode: Mode | None
    run: PublishedTrajectory


@public
def random_runs(problems: int, kind: Kind) -> list[RandomRun]:
    """Runs on so many problems, drawn from the seeds 0, 1, ...

    Args:
        problems: How many.
        kind: "single-mode" as the authors draw, "generic" with a target drawn like the start: x, y
            within 0.25 m, any phi, curvatures within 78 1/m.
    """
    found = []
    for seed in range(problems):
        mode: Mode | None = None
        if kind == "single-mode":
            driven, mode = draw_single_mode(seed)
        else:
            driven = np.random.default_rng(seed).uniform(-GENERIC, GENERIC, (2, len(GENERIC)))
        found.append(RandomRun(mode, published_trajectory(driven[0], driven[-1])))
    return found


def draw_single_mode(seed: int) -> tuple[Array, Mode]:
    """Draw a start at the origin, a mode and an input; the way driven, (rows, 5), and the mode.

    phi is drawn from -0.6 to 0.06 rad (as in the script), curvatures within 60 1/m, speeds of units
    within 8 mm/s, of the rigid robot within 30 mm/s and 0.1 rad/s.
    """
    draw = random.Random(seed)
    phi = draw.uniform(-0.6, 0.06)
    start = np.array([0.0, 0.0, phi, *(draw.uniform(-60.0, 60.0) for _ in range(2))])
    mode = (draw.randint(0, 1), draw.randint(0, 1))
    v = np.array([draw.uniform(-most, most) for most in (0.008, 0.008, 0.03, 0.03, 0.1)])
    return forward_kinematics(start, mode, v), mode


def forward_kinematics(start: Array, mode: Mode, v: Array) -> Array:
    """Drive with a constant input by Euler's rule; configurations (rows, 5), the start first."""
    rows = [start]
    for _ in range(STEPS):
        q = rows[-1] + STEP_S * (published_jacobian(rows[-1], start, mode) @ v)
        if np.abs(q[3:]).max() > MOST_PER_M:
            break
        rows.append(q)
    return np.array(rows)
