"""Objects carried along curves by rigid bodies: how far off the path, how long, and is one lost?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from benchmarks.study import RUNNING, Count, Measured, Names, Study
from twosra_mpc import Problem, load_problem, plan
from twosra_mpc.checking.followed import followed
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.execution.simulation.simulate import Simulation, simulate
from twosra_mpc.problem.polyline import flattened
from twosra_mpc.problem.tasks import Carry, Follow, Grasp
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array, composed, inverse
from twosra_mpc.robot.physics import Physics

_BEGIN_M, _ROOM_M = (0.30, 0.10), 0.013  # where paths begin; more than a box has room in its cage
_LONG_M, _CURVED_PER_M = (1.2, 1.8), 12.0  # lengths, as the authors', and how curved at most
_GROUND = 0.3  # friction of objects on the ground of the plant


class Case(NamedTuple):
    """An outline along a path, and the seed of the robot."""

    outline: str
    path: int
    robot: int


class CarriedPaths(Study):
    """Objects of some outlines, each grasped, carried to where a Bezier path begins, and along it.

    Attributes:
        outlines: What is carried.
        paths: How many random paths of 1.2 to 1.8 m.
        robots: How many robots follow each; no two cases of an outline have the same robot.
        level: Level of disturbance.
    """

    question: ClassVar = "Does what is carried keep to a curve, in a rigid-body engine?"
    measures: ClassVar = RUNNING

    outlines: Names = ("disc", "box", "ellipse", "fourier")
    paths: Count = 3
    robots: Count = 1
    level: str = "moderate"

    def cases(self) -> Iterator[Case]:
        """Yield the runs."""
        for path in range(self.paths):
            for robot in range(self.robots):
                for outline in self.outlines:
                    yield Case(outline, path, path * self.robots + robot + 1)

    def run(self, case: Case) -> dict[str, Any]:
        """Plan, run, and measure what is carried between the tasks before the path and its end."""
        problem, drag = carried_problem(case), self._drag(case)
        result = plan(problem)
        if result.plan is None:
            return {"drag": drag, "ending": "no plan", "reason": result.message}
        done = simulate(
            problem,
            plan=result.plan,
            plant="mujoco",
            disturbance=self.level,
            seed=case.robot,
        )
        made = {"drag": drag, "ending": done.metrics.ending, "reason": done.metrics.reason}
        made |= {"lost": done.metrics.lost, "corrections": done.metrics.corrections}
        return made | along_path(done)

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Runs by outline."""
        outlines = {
            name: [each.record for each in results if each.case.outline == name]
            for name in self.outlines
        }
        return {"outlines": outlines}

    def _drag(self, case: Case) -> float:
        """What the ground holds the object with, over all that the robot's wheels can push with."""
        robot, width = load_problem("follow-bezier").robot, disturbance_level(self.level)
        rng = np.random.default_rng([case.robot, 3])  # as the plant draws it
        drawn: Physics = robot.true_physics.drawn(width.thermal_ranges, rng)
        fibre_kg = drawn.fibre_kg_per_m * sum(robot.geometry.lengths_m)
        pressed_kg = 2 * drawn.unit_mass_kg + fibre_kg
        return _GROUND * drawn.object_mass_kg / (drawn.wheel_friction * pressed_kg)


def outline(name: str) -> dict[str, Any]:
    """Keys of an object: a disc, a box, an ellipse, or a Fourier outline."""
    if name == "disc":
        return {"disc": {"radius_m": 0.03}}
    if name == "box":
        return {"box": {"x_m": [-0.025, 0.025], "y_m": [-0.025, 0.025]}}
    at = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
    radius_m = np.column_stack([0.034 * np.cos(at), 0.026 * np.sin(at)])
    if name == "fourier":
        bumps = 0.03 * (1 + 0.08 * np.cos(2 * at) + 0.05 * np.cos(3 * at))
        radius_m = bumps[:, None] * np.column_stack([np.cos(at), np.sin(at)])
    return {"polygon_m": radius_m.tolist()}


def random_bezier(seed: int) -> list[list[float]]:
    """Control points of a cubic curve of 1.2 to 1.8 m, nowhere more curved than 12 1/m."""
    rng = np.random.default_rng(seed)
    while True:
        inner = rng.uniform([0.2, -0.6], [1.3, 0.6], (3, 2))
        control = [list(_BEGIN_M), *(np.array(_BEGIN_M) + inner).tolist()]
        if _as_long_and_smooth(np.array(flattened(control))):
            return control


def _as_long_and_smooth(points: Array) -> bool:
    step = np.diff(points, axis=0)
    long_m = np.hypot(*step.T)
    turned = np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))
    curved = np.abs(turned) / np.minimum(long_m[1:], long_m[:-1])
    return bool(_LONG_M[0] <= long_m.sum() <= _LONG_M[1] and curved.max() <= _CURVED_PER_M)


def carried_problem(case: Case) -> Problem:
    """Grasp, carry to where the path begins, follow it."""
    x_m, y_m = _BEGIN_M
    item = {"name": "thing", "pose": {"x_m": 0.25, "y_m": 0.05, "phi_rad": 0.3}}
    path: Any = {"bezier": random_bezier(case.path)}
    return Problem(
        robot=load_problem("follow-bezier").robot,
        start={"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]},  # type: ignore[arg-type]
        objects=[Object(**item, **outline(case.outline))],  # type: ignore[arg-type]
        tasks=[
            Grasp(object="thing"),
            Carry(object="thing", x_m=x_m, y_m=y_m),
            Follow(object="thing", path=path, position_tolerance_m=_ROOM_M),
        ],
        gap=0.1,
    )


def along_path(done: Simulation) -> dict[str, Any]:
    """What was measured along the path in truth; nothing if it was never begun."""
    run, truth = done.run, done.truth
    if len(run.done_s) < 2:
        return {}
    begun_s, end_s = run.done_s[1], (*run.done_s, float(truth.time_s[-1]))[2]
    now = (truth.time_s >= begun_s) & (truth.time_s <= end_s)
    t_s, poses = truth.time_s[now], truth.objects[now, 0]
    task = run.problem.tasks[2]
    assert isinstance(task, Follow)
    found = followed(task, t_s, poses)
    off_m = np.interp(t_s, found.t_s, found.off_m)
    in_b0 = composed(inverse(truth.q[now, :3]), poses)
    return {
        "driving_s": float(end_s - begun_s),
        "mean_m": float(np.trapezoid(off_m, t_s) / (t_s[-1] - t_s[0])),
        "worst_m": float(off_m.max()),
        "slip_m": float(np.hypot(*(in_b0 - in_b0[0])[:, :2].T).max()),
        "left_m": found.left_m,
    }
