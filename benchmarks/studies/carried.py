"""Objects led along curves by robots of rigid bodies: how far are they from their paths?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from benchmarks.study import RUNNING, Count, Measured, Names, Study
from twosra_mpc import Plan, Problem, plan
from twosra_mpc.contact.grip import Pulls
from twosra_mpc.errors import NoPlanError
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.execution.simulation.plant import PHYSICS, SimulatedRobot
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.plans.carried import carried
from twosra_mpc.problem.polyline import Polyline, flattened
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.validation import Positive

_SIDES = 40
_AT = 0.25, 0.05, 0.3  # object at t = 0
_BEGIN = 0.30, 0.10  # of its path
_LOOKS = 200  # at the drive along it
_LONG_M, _TIGHTEST_M = (1.2, 1.8), 0.08  # of paths: as the authors'


def _polygon(x_m: Array, y_m: Array) -> dict[str, Any]:
    return {"polygon_m": np.column_stack([x_m, y_m]).tolist()}


_ANGLES = np.arange(_SIDES) * 2 * np.pi / _SIDES
_C, _S = np.cos(_ANGLES), np.sin(_ANGLES)
_RADII_M = 0.030 * (1 + 0.08 * np.cos(2 * _ANGLES) + 0.05 * np.cos(3 * _ANGLES))
OUTLINES: Mapping[str, dict[str, Any]] = {
    "disc": {"disc": {"radius_m": 0.03}},
    "box": {"box": {"x_m": (-0.025, 0.025), "y_m": (-0.025, 0.025)}},
    "ellipse": _polygon(0.034 * _C, 0.026 * _S),
    "Fourier": _polygon(_RADII_M * _C, _RADII_M * _S),
}


class Case(NamedTuple):
    """A run: an outline, a random path, and the robot of a seed, its own."""

    outline: str
    path: int
    seed: int


class Carried(Study):
    """Grasp an object, bring it to the begin of a random Bezier path, and lead it along.

    Attributes:
        outlines: Of the objects.
        paths: Of each outline.
        robots: On each path.
        level: Level of disturbance.
        tolerance_m: That the tasks ask for: more than cages leave of room.
    """

    question: ClassVar = "Objects led along curves on rigid bodies: how far off are they?"
    measures: ClassVar = RUNNING

    outlines: Names = ("disc", "box", "ellipse")
    paths: Count = 1
    robots: Count = 1
    level: str = "moderate"
    tolerance_m: Positive = 0.015

    def cases(self) -> Iterator[Case]:
        """Yield the runs."""
        for path in range(self.paths):
            for number, outline in enumerate(self.outlines):
                for robot in range(self.robots):
                    seed = (path * len(self.outlines) + number) * self.robots + robot
                    yield Case(outline, path, 1 + seed)

    def run(self, case: Case) -> dict[str, Any]:
        """Run the same plan on the robot of this seed; its ``Metrics``, and times on the path."""
        try:
            made = _planned(case.outline, case.path, self.tolerance_m)
        except NoPlanError as error:
            return {"ending": "no plan", "reason": str(error)}
        level = disturbance_level(self.level)
        physics = SimulatedRobot(made.problem, PHYSICS, level, case.seed).physics
        found = simulate(
            made.problem, plan=made, plant=PHYSICS, disturbance=self.level, seed=case.seed
        )
        _, begin_s, end_s = made.trajectory.done_s
        (held,), t_s = carried(made.trajectory), np.linspace(begin_s, end_s, _LOOKS)
        q = made.trajectory.configuration(t_s)
        moved = composed(inverse(q[:-1, :POSE]), q[1:, :POSE])
        own = made.robot, q[0, POSE:], made.problem.objects[0], held.pose_in_b0
        needs_N = float(Pulls.of(*own)(moved).max()) * physics.drag_N
        pulls_N = physics.pull_N(made.robot.geometry)
        done_s = found.run.done_s[1:]
        return {
            **found.metrics._asdict(),
            "planned_s": end_s - begin_s,
            "needs_N": needs_N,
            "pulls_N": pulls_N,
            "can_pull": needs_N <= pulls_N,
            "drive_s": done_s[-1] - done_s[0] if len(done_s) > 1 else None,
        }

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Runs by outline."""
        return {
            "by_outline": {
                name: [each.record for each in results if each.case.outline == name]
                for name in self.outlines
            }
        }


def bezier(seed: int) -> Array:
    """Control points of a random cubic Bezier curve that begins at zero, (4, 2)."""
    rng = np.random.default_rng(seed)
    while True:
        control = np.vstack([np.zeros(2), rng.uniform((0.2, -0.6), (1.3, 0.6), (3, 2))])
        line = Polyline.of(flattened(control.tolist()))
        turned = np.abs(np.diff(line.tangent.headings)) / np.diff(line.length_m)
        if _LONG_M[0] <= line.length_m[-1] <= _LONG_M[1] and turned.max() < 1 / _TIGHTEST_M:
            return control


@lru_cache
def _planned(outline: str, path: int, tolerance_m: float) -> Plan:
    x_m, y_m, phi_rad = _AT
    thing = {"name": "thing", "pose": {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad}}
    control = (bezier(path) + _BEGIN).tolist()
    problem = Problem.parse(
        {
            "robot": "2sra-v1",
            "gap": 0.1,
            "motion": "fastest",
            "start": {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]},
            "objects": [thing | OUTLINES[outline]],
            "tasks": [
                {"do": "grasp", "object": "thing"},
                {
                    "do": "carry",
                    "object": "thing",
                    "x_m": _BEGIN[0],
                    "y_m": _BEGIN[1],
                    "position_tolerance_m": 0.002,
                },
                {
                    "do": "follow",
                    "object": "thing",
                    "path": {"bezier": control},
                    "position_tolerance_m": tolerance_m,
                },
            ],
        },
        f"{outline} along path {path}",
    )
    return plan(problem).require()
