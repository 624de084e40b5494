"""Planning what is left of a problem again, from where the robot is, whatever its metal does."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.effort import limited
from twosra_mpc.errors import InputError
from twosra_mpc.execution.belief import Metal
from twosra_mpc.execution.controller import Activity, Looking, Next, look_at_objects, rest
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.planning.bounds.schedule import cost_coefficients, feasible_schedule
from twosra_mpc.planning.planner import plan_again
from twosra_mpc.planning.stages.necessity import unit_without_way
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.limits import bent_back
from twosra_mpc.problem.problem import Problem, Start
from twosra_mpc.robot.accuracy import ACCEPTED, PLANNED
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, sequence_name
from twosra_mpc.timing import transition_model

if TYPE_CHECKING:
    from twosra_mpc.execution.following import Following

SWITCH_S = 10.0  # a change of plan costs: what is known of metal is as uncertain
_DECISION_WORK = 200.0  # units, a third of a second: commands go on meanwhile once a second
_SURELY_BENT = 3.0  # deviations: as at the end of bends
_ROOM_WORK = 4000.0  # units, 6 s: for one that keeps more than is asked
_MISSES = 1  # of a mode of several segments that are planned again in the same
_SURELY = 0.99  # quantile of the time that is planned for once a joint bend has missed
_MISSES_COUNTED = 3  # the same where plans count with them, and only what is bent last may miss


class Replanning:
    """The robot stands until objects are looked at and the rest is planned.

    So it does until metal rests whose state is not known, or that must become solid. Meanwhile each
    segment goes on to what it was becoming.
    """

    def __init__(self, run: Following, *, melting_on: bool = False, cooling: bool = False) -> None:
        """Leave a plan.

        Args:
            run: The run.
            melting_on: Hold what is soft for a while, so that all of it melts.
            cooling: Let all segments become solid.
        """
        self._run, self._belief = run, run.belief
        self._until_s = run.belief.now_s + (run.melt_on_s() if melting_on else 0.0)
        self._cooled = set(range(len(run.belief.setpoint_C)) if cooling else ())
        self._resting = False
        self._left: Problem | None = None  # what is being planned
        run.driving = None

    def _cool(self) -> Activity:
        self._cooled = set(range(len(self._belief.setpoint_C)))
        return self

    def advance(self) -> Next:
        """Stand, and look at objects; while the rest is planned, stand on."""
        run, belief, settings = self._run, self._belief, self._run.settings
        if self._left is not None:
            return self._planned(self._left)
        stiffness, solid = belief.reading.stiffness, run.broken | self._cooled
        changing = belief.mode is None and (self._resting or None in belief.metal)
        changing |= any(stiffness[j] != "rigid" for j in solid)
        if changing or belief.now_s < self._until_s or not belief.stands:
            return rest(belief, self._as_they_become(), settings.patience.rest_s)
        if run.mission.holding is not None and set(stiffness) != {"rigid"}:  # soft, none holds
            return self._cool()
        objects = partial(look_at_objects, belief, self._plan)
        return Looking(belief, self._decided, settings.patience.long_look_s, objects)

    def _decided(self) -> bool:
        """True if it is clear which of the soft segments are as the goal wants them.

        One that is taken to be, and is not, costs a melt and a freeze more.
        """
        belief = self._belief
        soft = np.array(belief.reading.stiffness) == "soft"
        off, unsure = (
            np.abs(value[POSE:][soft]) / belief.accuracy.curvature_per_m
            for value in (belief.error, belief.deviation)
        )
        certain = unsure <= belief.patience.certain_of_a_melt
        return bool((certain | (np.abs(off - ACCEPTED) >= _SURELY_BENT * unsure)).all())

    def _plan(self) -> Next:
        try:
            self._left = what_is_left(self._run)  # None: metal changes since the look
        except InputError as error:
            return self._failed(str(error))
        return self

    def _planned(self, problem: Problem) -> Next:
        """Ask for a plan; stand as long as that takes."""
        run, belief = self._run, self._belief
        try:
            result = run.think(problem)
        except InputError as error:
            return self._failed(str(error))
        if result is None:
            return rest(belief, self._as_they_become(), belief.camera.period_s)
        if result.plan is None or not result.found:  # a plan that does not verify is none
            return self._failed(result.message)
        return run.adopt(result.plan)

    def _failed(self, why: str) -> Next:
        """Try what may help before it is said that there is no plan."""
        run, belief, self._left = self._run, self._belief, None
        if belief.mode is None:
            self._resting = True  # from rest there may be one
            return self
        if belief.guard is not None and any(belief.mode):
            return self._cool()  # a solid robot may drive to where it can bend
        if run.missed or run.stalled:
            run.missed.clear()  # any plan is better than none
            run.stalled.clear()
            return self
        return run.narrower() or run.no_plan(why)

    def _as_they_become(self) -> Array:
        """Set-points that let every segment become, or stay, what it is becoming, (n,)."""
        belief, heater = self._belief, self._belief.problem.robot.heater
        solid = self._run.broken | self._cooled
        becoming = []
        for segment, now in enumerate(belief.reading.stiffness):
            asked = belief.setpoint_C[segment] >= heater.soft_setpoint_C
            soft = now == "soft" or (now == "changing" and asked)
            becoming.append(soft and segment not in solid)
        return np.where(becoming, heater.soft_setpoint_C, heater.rigid_setpoint_C)


def what_is_left(run: Following) -> Problem | None:
    """What is left of a run's problem, from where it is; None while metal is in no known state.

    Once a joint bend has missed, others are taken to miss wherever they may by the robot's file;
    and modes of several segments whose bends have missed often are avoided, and those that stall.

    Raises:
        InputError: If no mode is left.
    """
    metal = [one for one in run.belief.metal if one is not None]
    if len(metal) < len(run.belief.metal):
        return None
    missed, (problem, q) = [mode for mode in run.missed if sum(mode) > 1], run.mission.rest()
    known = problem.only_time and problem.robot.uncertainty is not None
    if missed and known:
        problem = problem.with_values(risk=_SURELY)
    most = _MISSES_COUNTED if known else _MISSES
    avoided = run.stalled | {mode for mode in missed if missed.count(mode) > most}
    left = remaining_problem(problem, q, metal, run.broken, len(run.missed), avoided)
    if run.clearance_m <= left.clearance_m:
        return left
    work = min(left.work_limit, _ROOM_WORK)
    tasks = [task.kept_from(left.clearance_m) for task in left.tasks]
    return left.with_values(clearance_m=run.clearance_m, work_limit=work, tasks=tasks)


def has_no_room(problem: Problem, clearance_m: float) -> bool:
    """True if it is proved that no plan keeps so much clearance: a unit has no way with it.

    Nothing is proved of tasks, which may touch what is around.
    """
    if problem.tasks:
        return False
    room = problem.with_values(clearance_m=clearance_m)
    return unit_without_way(room, wheels=True) is not None


def reconsidered(run: Following, index: int, learnt: str) -> Plan | None:
    """A plan that is better than the rest of the one in force by more than switching costs.

    None if that stays: also where the state of metal is not known, or no plan is made in time
    to be of use, as among obstacles and of tasks.

    Args:
        run: A run on its way.
        index: Phase that comes next.
        learnt: What has become known, in words.
    """
    plan, asked = run.course.plan, run.problem
    if index == len(plan.phases) or asked.tasks or asked.obstacles or asked.planner == "greedy":
        return None
    try:
        left = what_is_left(run)
    except InputError:
        return None
    cost_s = None if left is None else cost_of_rest_s(plan, index, left)
    if left is None or cost_s is None:
        return None
    with limited(_DECISION_WORK, math.inf):
        result = plan_again(left, cost_s - SWITCH_S)
    words = f"{learnt}: of the plan {cost_s:z.1f} s are left"
    if (better := result.plan) is None or not result.found:
        least = f"none takes less than {result.lower_bound or 0.0:z.1f} s"
        run.belief.tell("kept", f"{words}, {least}")
        return None
    words += f", {sequence_name(better.sequence)} takes {better.duration_s:z.1f} s"
    run.belief.tell("replan", words)
    return better


def cost_of_rest_s(plan: Plan, index: int, left: Problem) -> float | None:
    """Cost of a plan's phases from one on, begun anew from the metal at a problem's start."""
    phases = plan.phases[index:]
    lasting = np.array([phase.end_s - phase.start_s for phase in phases])
    modes = tuple(phase.mode for phase in phases)
    network = transition_model(left).network(modes, plan.last_mode, [0.0] * len(phases))
    if (found := feasible_schedule(network, lasting, left)) is None:
        return None
    prices, constant = cost_coefficients(found[1], left.cost_weights)
    return float(prices @ found[0]) + constant


_ROUNDING = 1e-9


def remaining_problem(
    problem: Problem,
    q: Array,
    metal: Sequence[Metal],
    broken: Collection[int] = (),
    misses: int = 0,
    avoided: Collection[Mode] = (),
) -> Problem:
    """State what is left of a problem.

    Curvatures that are near enough need not change, so the segment need not melt again; only those
    that are not are asked for, and one that alone is soft, which costs next to nothing. A robot
    that is believed to be bent into itself starts bent back.

    Args:
        problem: What was asked in the beginning.
        q: Configuration now, (3 + n,).
        metal: State of the segments.
        broken: Segments (from 0) that cannot be melted any more.
        misses: How often bends have missed so far: the next are aimed nearer to the middle.
        avoided: Modes in which they have.

    Raises:
        InputError: If no mode is left.
    """
    mode = tuple(int(one.melt_fraction == 1.0) for one in metal)
    bodies = [one.temperature_C if one.body_C is None else one.body_C for one in metal]
    kappa = bent_back(problem.robot, q[POSE:])
    start = Start(
        x_m=q[0],
        y_m=q[1],
        phi_rad=q[2],
        kappa_per_m=tuple(kappa.tolist()),
        temperature_C=tuple(one.temperature_C for one in metal),
        melt_fraction=tuple(one.melt_fraction for one in metal),
        body_temperature_C=tuple(bodies) if any(one.body_C is not None for one in metal) else None,
        holding=problem.start.holding,
    )
    usable = (m for m in problem.modes if not any(m[segment] for segment in broken))
    modes = tuple(m for m in usable if m not in avoided)
    aimed = PLANNED / (2 + misses)
    goal = _goal(problem, np.concatenate([q[:POSE], kappa]), mode, broken, aimed)
    workspace = problem.workspace
    if workspace is not None:  # who is out of it already needs so much more room
        shape = robot_shape(problem.robot.geometry, start.configuration)
        thick = problem.robot.geometry.fibre_radius_m
        fibre = (part + end for part in (shape.segments, shape.links) for end in (-thick, thick))
        outline = (shape.units, shape.wheels, *fibre)
        workspace = workspace.holding(np.concatenate([part.reshape(-1, 2) for part in outline]))
    return problem.with_values(start=start, goal=goal, modes=modes, workspace=workspace)


def _goal(problem: Problem, q: Array, mode: Mode, broken: Collection[int], aimed: float) -> GoalSet:
    """The middle of the goal, with curvature tolerances within which nothing needs to melt.

    What must bend, or alone is soft, is ``aimed`` at to within so much of the accuracy.
    """
    scale = problem.robot.ends_within.scale(problem.robot.coordinates)
    goal = problem.judged_goal
    off = np.abs(goal.error(q.copy())) / scale
    kept, bends = np.where(mode, aimed if sum(mode) == 1 else ACCEPTED, ACCEPTED), off[POSE:]
    kept[list(broken)] = 1.0
    wider = np.where(bends <= kept, bends + _ROUNDING, aimed)
    return goal.loosened(scale * [0.0, 0.0, 0.0, *wider])
