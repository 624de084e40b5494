"""``simulate``: plan, and run the plan in closed loop on a simulated robot.

That it touched nothing, and how near it came, is told of where it really was.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.execution.executor import Executor
from twosra_mpc.execution.mission import away
from twosra_mpc.execution.run import Run
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.execution.simulation.disturbance import Disturbance, disturbance_level
from twosra_mpc.execution.simulation.plant import SimulatedRobot, Truth
from twosra_mpc.files import plain_data
from twosra_mpc.planning.planner import plan as find_plan
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import put
from twosra_mpc.problem.world import ACCURACY, World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.validation import ArrayValue, Count, OneOrMore

_STEP_M = 1e-3  # the outline moves no farther between two looks


class Approach(NamedTuple):
    """The closest approach to an obstacle in a run, or the first touch.

    Attributes:
        clearance_m: Least distance, at least: that of pieces that hold the robot; negative by the
            depth where they overlap.
        name: The obstacle.
        time_s: When.
        touched: Whether it was touched.
    """

    clearance_m: float
    name: str
    time_s: float
    touched: bool


def closest_approach(world: World, geometry: Geometry, truth: Truth) -> Approach | None:
    """Closest approach to obstacles of a robot of this geometry; None where there are none."""
    if not world.obstacles:
        return None
    from twosra_mpc.space.separation import Proximity, arms_m

    time_s, q = _finely(arms_m(geometry), truth)
    distances_m = Proximity(world, geometry).distances(q)[:, :-1]
    least_m = distances_m.min(axis=1)
    at = int((least_m <= 0).argmax() if (least_m <= 0).any() else least_m.argmin())
    return Approach(
        clearance_m=float(least_m.min()),
        name=world.names[int(distances_m[at].argmin())],
        time_s=float(time_s[at]),
        touched=bool(least_m[at] <= 0),
    )


def _finely(arms_m: Array, truth: Truth) -> tuple[Array, Array]:
    """Times and configurations between which no point of the robot moves far; no place twice."""
    moved_m = np.abs(np.diff(truth.q, axis=0)) @ arms_m
    steps = np.ceil(moved_m / _STEP_M).astype(int)
    places = [truth.q[:1]]
    times = [truth.time_s[:1]]
    for k in np.flatnonzero(steps):
        shares = np.arange(1, steps[k] + 1) / steps[k]
        places.append(truth.q[k] + shares[:, None] * (truth.q[k + 1] - truth.q[k]))
        times.append(truth.time_s[k] + shares * (truth.time_s[k + 1] - truth.time_s[k]))
    return np.concatenate(times), np.concatenate(places)


EXECUTORS = ("optimal", "greedy")


@public
class Metrics(NamedTuple):
    """Metrics of a run.

    Attributes:
        reached: Whether the robot is in truth within the accuracy of the goal, and objects are at
            theirs, and the run says so; one that has touched an obstacle is not.
        ending: How the run ended.
        reason: Why, in a sentence.
        position_m: True distance from the goal in the plane.
        heading_rad: True distance in heading.
        curvature_per_m: True distance of the curvature that is farthest off.
        time_s: Duration.
        transitions: Melts and freezes.
        allowed: Transitions of the plan and of every plan made again, as far as they were begun.
        energy_J: Heat of all heaters.
        replans: How often the rest was planned again.
        corrections: How often the pose was corrected.
        forced_s: How long wheels turned while metal was changing.
        least_clearance_m: Least distance to an obstacle in truth; None where there are none.
        touched: What the robot touched first and when, in words; empty if nothing.
        tasks_done: How many tasks of a mission were done, as the robot saw it.
        object_m: Distance of the object that is farthest from its goal in truth: where it was to be
            carried, or where it stood if it was not to be held; None where there is none.
        object_rad: The same for headings, where they are asked for.
        lost: How often an object was not where it should have been held.
        squeezed: Which object was squeezed, in what and how deep; empty if none.
        off_path_mean_m: How far what follows a path was from it in truth, on average along the
            way; None where nothing follows one.
        off_path_m: The same at worst.
        late_s: How late it came by a point that has a time, at worst; None where none has.
    """

    reached: bool
    ending: str
    reason: str
    position_m: float
    heading_rad: float
    curvature_per_m: float
    time_s: float
    transitions: int
    allowed: int
    energy_J: float
    replans: int
    corrections: int
    forced_s: float
    least_clearance_m: float | None = None
    touched: str = ""
    tasks_done: int = 0
    object_m: float | None = None
    object_rad: float | None = None
    lost: int = 0
    squeezed: str = ""
    off_path_mean_m: float | None = None
    off_path_m: float | None = None
    late_s: float | None = None


@public
@dataclass(frozen=True, eq=False, repr=False)
class Simulation(ArrayValue):
    """A simulated run.

    Attributes:
        plant: True path model of the robot, or "mujoco".
        disturbance: Level of what else differed from the model.
        seed: Of all that was drawn.
        run: What the robot measured and did.
        truth: What really happened.
        approach: How near it came to an obstacle, or which it touched first; None without any.
    """

    plant: str
    disturbance: str
    seed: int
    run: Run
    truth: Truth
    approach: Approach | None = None

    @property
    def metrics(self) -> Metrics:
        """Numbers, by what really happened."""
        run, truth = self.run, self.truth
        error, near = run.goal.error(truth.q[-1].copy()), self.approach
        touched = truth.touched or ""
        if truth.touched is None and near is not None and near.touched:
            touched = f"touched {near.name} at {near.time_s:z.0f} s"
        object_m, object_rad = object_errors(run.problem, truth)
        followed = run.followed(truth.time_s, truth.q, truth.objects)
        off_m = [each.off_m for each in followed]
        put = (object_m or 0.0) <= ACCURACY[0] and (object_rad or 0.0) <= ACCURACY[2]
        return Metrics(
            reached=run.reached and run.accuracy.of(error) <= 1.0 and put and not touched,
            ending=str(run.ending),
            reason=run.reason,
            position_m=float(np.hypot(error[0], error[1])),
            heading_rad=abs(float(error[2])),
            curvature_per_m=float(np.abs(error[POSE:]).max()),
            time_s=run.duration_s,
            transitions=run.transitions,
            allowed=sum(run.begun),
            energy_J=float(truth.heat_J[-1].sum()),
            replans=run.replans,
            corrections=run.corrections,
            forced_s=float(truth.forced_s[-1]),
            least_clearance_m=None if near is None else near.clearance_m,
            touched=touched,
            tasks_done=len(run.done_s),
            object_m=object_m,
            object_rad=object_rad,
            lost=run.lost,
            squeezed=truth.squeezed,
            off_path_mean_m=float(np.concatenate(off_m).mean()) if off_m else None,
            off_path_m=float(np.concatenate(off_m).max()) if off_m else None,
            late_s=max((float(s) for each in followed for s in each.late_s), default=None),
        )

    def to_dict(self) -> dict[str, Any]:
        """The simulation as plain data, without objects where there are none."""
        truth = {item.name: getattr(self.truth, item.name) for item in fields(Truth)}
        del truth["touched"]  # it stands in the metrics
        if not self.truth.objects.size:
            del truth["objects"], truth["squeezed"]
        return {
            **self.run.to_dict(),
            "plant": self.plant,
            "disturbance": self.disturbance,
            "seed": self.seed,
            "metrics": self.metrics._asdict(),
            "truth": plain_data(truth),
        }


def settings_for(level: Disturbance) -> ExecutorSettings:
    """Settings of an executor that knows a level's drives, and the clearance that it needs."""
    return ExecutorSettings(
        dead_zone_rad_s=level.dead_zone_rad_s,
        motor_lag_s=level.motor_lag_s,
        clearance_m=level.clearance_m,
    )


@public
def simulate(
    problem: Problem,
    *,
    plant: str = "arc",
    disturbance: str = "moderate",
    seed: Count = 0,
    executor: str = "optimal",
    plan: Plan | None = None,
    settings: ExecutorSettings | None = None,
    broken_heaters: Collection[int] = (),
    viewer: bool = False,
) -> Simulation:
    """Plan a problem and run it; or drive to its goal by the greedy rule, which needs no plan.

    Args:
        problem: The problem.
        plant: True path model of the robot, "as-planned", or "mujoco": a rigid-body engine.
        disturbance: A level: none, mild, moderate or hard.
        seed: Of all that is drawn at random.
        executor: "optimal", or "greedy".
        plan: A plan of the problem, if there is one already.
        settings: Of the executor; by default it knows the level's dead zone and clearance.
        broken_heaters: Segments (from 1) whose heater never warms.
        viewer: Show the motion in the viewer of plant "mujoco".

    Raises:
        InputError: If there is no such plant, level or executor, the plan is of another problem, or
            the robot has no ``[segment]``; see `SimulatedRobot`.
        NoPlanError: If the problem has no plan.
        RobotError: If the simulation of plant "mujoco" diverges.
    """
    level = disturbance_level(disturbance)
    if executor not in EXECUTORS:
        raise InputError("executor", executor, f"one of {', '.join(EXECUTORS)}")
    robot = SimulatedRobot(
        problem, plant, level, seed, broken_heaters=broken_heaters, viewer=viewer
    )
    chosen = settings or settings_for(level)
    if executor == "greedy":
        run = Executor(robot, chosen).drive(problem)
    else:
        made = plan or find_plan(problem).require()
        if made.problem != problem:
            raise InputError("plan", made, "a plan of this very problem: plan(problem).require()")
        run = Executor(robot, chosen, think=robot.think).run(made)
    truth = robot.truth()
    near = closest_approach(problem.world, robot.geometry, truth)
    return Simulation(plant, disturbance, seed, run, truth, near)


def object_errors(problem: Problem, truth: Truth) -> tuple[float | None, float | None]:
    """Largest true distance [m] and turn [rad] of an object from its goal; None where none has one.

    The goal is where it is brought last, or where it stood if it is never held.
    """
    found = []
    held = {task.about for task in problem.tasks if task.takes or task.needs_held}
    goals = put(problem.tasks)
    for number, item in enumerate(problem.objects):
        if item.name in goals:
            found.append(away(goals[item.name], item, truth.objects[-1, number]))
        elif item.name not in held:
            moved = truth.objects[-1, number] - item.pose.pose
            turned = abs(float(moved[2])) if item.disc is None else 0.0
            found.append((float(np.hypot(moved[0], moved[1])), turned))
    if not found:
        return None, None
    far_m, turn_rad = np.max(found, axis=0).tolist()
    return far_m, turn_rad


class Spread(NamedTuple):
    """Median, 90 % quantile and largest value."""

    median: float
    p90: float
    largest: float


@public
def spread(runs: OneOrMore[Metrics], of: Callable[[Metrics], float]) -> Spread:
    """Spread of a number over runs."""
    return Spread(*np.quantile([of(run) for run in runs], (0.5, 0.9, 1.0)).tolist())
