"""Following a plan to its goal, whatever happens: correct, plan again, or say why not."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import Activity, Next, Trouble, look_at_objects, look_at_robot
from twosra_mpc.execution.course import Abort, Course, Waiting
from twosra_mpc.execution.doubt import DoubtError
from twosra_mpc.execution.driving import Driving, Pulses
from twosra_mpc.execution.guard import MeetsItselfError
from twosra_mpc.execution.mission import Mission
from twosra_mpc.execution.replanning import Replanning, reconsidered
from twosra_mpc.execution.run import Ending, Verdict, times
from twosra_mpc.execution.segment_watch import SegmentError
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.execution.tracking.tracker import Tracker
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.limits import CLEARANCE
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array, wrapped
from twosra_mpc.robot.modes import Mode, sequence_name

_LESS_ROOM = 0.7  # of a clearance that no plan keeps
_ON_S = 0.25  # of the plan, after which a robot that was stopped and is not too near may go on
_NEAR_PLAN = 0.5  # of the corridor: from farther away it is planned again
_LONGER = 2  # doublings: two melts of 2sra-v1, after which all of it is liquid

Think = Callable[[Problem], Result | None]
"""Plans a problem; None while it is still at it, and is asked again at the next step."""


class Following:
    """A policy: a plan is followed by a camera, and what is left is planned again where it must be.

    Attributes:
        belief: What is known of the robot.
        settings: When it is content, and when it gives up.
        course: The plan on its way.
        mission: The tasks on their way.
        during: What the run is at, in words.
        broken: Segments (from 0) that cannot be melted any more.
        missed: Modes whose bends have missed.
        clearance_m: What plans of the rest are to keep.
    """

    def __init__(
        self, belief: Belief, plan: Plan, settings: ExecutorSettings, think: Think
    ) -> None:
        """The robot is where the plan starts."""
        self.belief, self.settings, self.patience = belief, settings, settings.patience
        self.problem, self.think, self.longest_s = plan.problem, think, settings.longest_s
        self.tracker = Tracker(plan.robot, rate_Hz=belief.camera.rate_Hz)
        self.mission = Mission(belief, settings.patience, plan)
        self.broken, self.missed = set[int](), list[Mode]()
        self.clearance_m = settings.clearance_m
        self.near, self.during = "", "before the plan begins"
        self._plans, self._begun = list[Plan](), list[int]()
        self._replans = self._corrections = self._stops = self._doubted = 0
        self._melted_on = 0
        self._driving: Driving | None = None
        self._follow(plan)

    def begin(self) -> Activity:
        """Wait for the first phase, of a plan that keeps as much clearance as the run needs."""
        tell, kept_m, needed_m = self.belief.tell, self._kept_m, self.clearance_m
        tell("plan", summary(self.course.plan))
        if kept_m >= needed_m:
            return Waiting(self, 0)
        needed = f"{1e3 * needed_m:z.1f} are needed"
        tell("look", f"{1e3 * kept_m:z.1f} mm of clearance are planned, {needed}")
        return Replanning(self)

    @property
    def _kept_m(self) -> float:
        """Clearance that the plan keeps; infinite where there are no obstacles."""
        if not self.problem.obstacles:
            return math.inf
        plan = self.course.plan.require()
        return plan.problem.clearance_m + plan.verification.limits.get(CLEARANCE.name, 0.0)

    def narrower(self) -> Activity | None:
        """What to do where no plan keeps the clearance: ask for less; None: no more was asked."""
        if not self.problem.obstacles or self.clearance_m <= self.problem.clearance_m:
            return None
        self.belief.tell("look", f"no plan is found that keeps {1e3 * self.clearance_m:z.1f} mm")
        self.clearance_m *= _LESS_ROOM
        given = not self.belief.drives and self.clearance_m <= self._kept_m
        return Waiting(self, 0) if given else Replanning(self)

    def _follow(self, plan: Plan) -> None:
        self.course = Course(self.belief, plan, self.patience)
        self.pulses = Pulses(self.settings.dead_zone_rad_s)
        self.tracker.reset(plan)
        self._stopped_s = -math.inf
        self._plans.append(plan)
        self._decided_s = self.belief.now_s

    # A plan on its way.

    @property
    def setpoint_C(self) -> Array:
        """Set-points of the plan now, (n,)."""
        return self.course.setpoint_C

    def ready(self, mode: Mode, planned_s: float) -> bool:
        """True if the robot may drive in ``mode``, planned from ``planned_s`` on; early or late."""
        return self.belief.mode == mode

    def arrived(self, index: int) -> Next:
        """Drive a phase, or look where the robot has come to, once tasks are done that are due."""
        return _DueTasks(self, index, begins=True)

    def phase_done(self, index: int) -> Next:
        """Go on to the next phase, once tasks are done that are due."""
        course, phase = self.course, self.course.plan.phases[index]
        self._driving = None
        course.done += 1
        course.clock_s = max(course.clock_s, phase.end_s)
        return _DueTasks(self, index + 1, begins=False)

    def drive(self, index: int) -> Next:
        """Drive a phase; after the last, look where the robot has come to."""
        course, belief = self.course, self.belief
        if index == len(course.plan.phases):
            at = belief, self.patience
            return look_at_objects(*at, partial(look_at_robot, *at, self._at_the_end))
        self.during = f"in {course.name(index)}"
        belief.tell("drive", f"{course.name(index)} begins")
        self._driving = Driving(self, index)
        return self._driving

    def _at_the_end(self) -> Next:
        """Judge where the robot has come to at the end of a plan."""
        belief, left = self.belief, self.mission.left
        if belief.unseen_s > self.patience.unseen_s:
            return self.verdict(*belief.ending_unseen(left=bool(left)))
        if belief.accuracy.surely(belief.error) and not left:
            if not belief.sure(belief.accuracy.scale(self.problem.robot.coordinates)):
                return self.verdict(*belief.ending_unseen(left=False))
            if moved := self.mission.misplaced:
                return self.verdict(Ending.OBJECT_LOST, moved)
            if np.isnan(belief.goal.configuration).all():  # a mission without a goal
                return self.verdict(Ending.REACHED, "all tasks are done")
            return self.verdict(Ending.REACHED, f"the goal is reached: {belief.where}")
        missing = f"; {len(left)} of {len(self.problem.tasks)} tasks left" if left else ""
        belief.tell("look", f"the plan is at its end, {belief.where}{missing}")
        return Replanning(self).begin()

    # What goes wrong.

    def troubled(self, trouble: Trouble) -> Next:
        """Go on after a trouble, or end."""
        if isinstance(trouble, SegmentError):
            if trouble.cause == "heater":  # it may not be needed
                return self.left(Abort("heater", str(trouble), trouble.segment))
            return self.verdict(trouble.ending, str(trouble))
        if isinstance(trouble, DoubtError):
            driving = self._driving
            if driving is not None and not driving.rigid and self.mission.closes:
                return driving.ended()  # what it closes round may keep it from bending
            self._doubted = self.settings.doubts if trouble.final else self._doubted
            text, kind = str(trouble), "corridor" if trouble.stalled else "doubt"
            return self.left(Abort(kind, text, stiff=trouble.bends))  # type: ignore[arg-type]
        if not isinstance(trouble, MeetsItselfError) and self._goes_on():
            self.belief.tell("look", f"{trouble}, and goes on after a look")
            assert self._driving is not None
            return self._driving
        kind = "body" if isinstance(trouble, MeetsItselfError) else "near"
        return self.left(Abort(kind, str(trouble)))  # type: ignore[arg-type]

    def _goes_on(self) -> bool:
        """True if a robot that was stopped near its plan is not too near, now that it is seen."""
        belief, driving, before_s = self.belief, self._driving, self._stopped_s
        if driving is None or belief.guard is None or belief.mode is None:
            return False
        self._stopped_s = self.course.clock_s
        away = belief.q - self.course.planned
        away[2] = wrapped(away[2])
        near = belief.guard.forbids(belief.mode, belief.q[None], belief.deviation)
        near |= belief.guard.off_m(away) > _NEAR_PLAN * self.patience.narrow_m
        return not near and self._stopped_s >= before_s + _ON_S

    def left(self, left: Abort) -> Next:
        """What follows when a plan is left: an ending, or that the rest is planned again."""
        self._driving, tell = None, self.belief.tell
        match left.kind:
            case "camera":
                return self.verdict(*self.belief.ending_unseen(left=bool(self.mission.left)))
            case "doubt":
                return self._doubts(left)
            case "heater":
                self.broken.add(left.segment)
                tell("failure", left.text)
            case "corridor":
                tell("look", left.text)
                self.missed += [] if left.missed is None else [left.missed]
            case "near" | "body":
                return self._stopped(left)
            case "task":
                tell("look", left.text)
            case "lost":
                return self._lost(left.text)
        return Replanning(self).begin(melting_on=left.stiff)

    def _doubts(self, left: Abort) -> Next:
        """Heat on and try again, once: a segment may be soft later than its sensor says.

        From then on it is called soft when it has had the heat for it: see `SegmentWatch.doubted`.
        """
        self.belief.tell("failure", left.text)
        self._doubted += 1
        if self._doubted > self.settings.doubts:
            ending = Ending.SENSOR_FAILED if left.stiff else Ending.NOT_MOVING
            return self.verdict(ending, left.text)
        return Replanning(self).begin(melting_on=left.stiff)

    def _lost(self, text: str) -> Next:
        """Stop, and have the object grasped again, unless that has been tried too often."""
        self.belief.tell("failure", text)
        lost = self.mission.lose(text)
        if lost > self.settings.grasps:
            where = self.belief.where
            return self.verdict(Ending.OBJECT_LOST, f"{text}; lost {times(lost)}; {where}")
        return Replanning(self).begin(cooling=True)

    def _stopped(self, left: Abort) -> Next:
        """Stopped near something: let everything become solid, to be planned again from there.

        A robot that was stopped before it met itself bends back as it is.
        """
        self.belief.tell("look", left.text)
        self._stops, self.near = self._stops + 1, left.text
        if self._stops > self.settings.stops:
            words = f"{left.text}, {times(self._stops)} by now; {self.belief.where}"
            return self.verdict(Ending.TOO_NEAR, words)
        return Replanning(self).begin(cooling=left.kind == "near")

    # What is planned again.

    def adopt(self, plan: Plan) -> Next:
        """Go on with another plan, unless that has been done too often."""
        settings, belief = self.settings, self.belief
        if plan.cost.transitions:
            if len(self.mission.done_s) > self.mission.done_before:
                self._replans = 0
            if self._replans == settings.replans:
                words = f"{belief.where} after planning again {times(self._replans)}"
                return self.verdict(Ending.GAVE_UP, words)
            self._replans, self._corrections = self._replans + 1, 0
            old_s = self.course.plan.duration_s - self.course.clock_s
            words = (
                f"the rest is planned again, {summary(plan)}; of the plan {old_s:z.0f} s are left"
            )
            belief.tell("replan", words)
        else:
            if self._corrections == settings.corrections:
                words = f"{belief.where} after {self._corrections} corrections in a row"
                return self.verdict(Ending.GAVE_UP, words)
            self._corrections += 1
            belief.tell("correct", f"the pose is corrected, {summary(plan)}")
        return self._take_up(plan)

    def _take_up(self, plan: Plan) -> Activity:
        self._begun.append(self.course.begun)
        self.mission.begin(plan)
        self._follow(plan)
        self.near = ""
        return Waiting(self, 0)

    def learnt(self, index: int, what: str) -> Next | None:
        """Another plan, if one is better than this; None: it stays, or that was just decided."""
        if (now_s := self.belief.now_s) < self._decided_s + self.patience.rest_s:
            return None
        self._decided_s = now_s
        better = reconsidered(self, index, what)
        return None if better is None else self._take_up(better)

    def melt_on_s(self) -> float:
        """Time to hold soft segments for so that all of their metal melts: longer each time."""
        duration_s: float = self.patience.melt_on_s * 2**self._melted_on
        self._melted_on = min(self._melted_on + 1, _LONGER)
        return duration_s

    def no_plan(self, why: str) -> Verdict:
        """End, for there is no plan of the rest."""
        where = self.belief.where
        if self.near:
            words = f"{self.near}; {where}; the rest cannot be planned: {why}"
            return self.verdict(Ending.TOO_NEAR, words)
        if self.mission.trouble:
            words = f"{self.mission.trouble}; it cannot be grasped again: {why}"
            return self.verdict(Ending.OBJECT_LOST, words)
        if self.broken:
            names = " and ".join(str(segment + 1) for segment in sorted(self.broken))
            known = why.split("; allowed modes")[0]  # no advice to use what has failed
            return self.verdict(Ending.HEATER_FAILED, f"{where}; without heater {names}: {known}")
        return self.verdict(Ending.NO_PLAN, f"{where}; the rest cannot be planned: {why}")

    def verdict(self, ending: Ending, reason: str) -> Verdict:
        """An ending of the run."""
        begun = (*self._begun, self.course.begun)
        return Verdict("optimal", ending, reason, tuple(self._plans), begun, *self.mission.account)


class _DueTasks:
    """Tasks whose time in the plan has come, before the run goes on."""

    def __init__(self, run: Following, index: int, *, begins: bool) -> None:
        """Go on with a phase when they are done: it may begin, or is waited for."""
        self._run, self._index, self._begins = run, index, begins
        self._looked = False

    def advance(self) -> Next:
        """Look, and judge one after the other."""
        run, mission = self._run, self._run.mission
        while (task := mission.due(run.course.clock_s)) is not None:
            if task.rests and not self._looked:
                at = run.belief, run.patience
                return look_at_objects(*at, partial(look_at_robot, *at, self._on))
            self._looked = False
            if (left := mission.judge()) is not None:
                return run.left(left)
        course, index = run.course, self._index
        known = "may begin" if self._begins else "is waited for"
        if (other := run.learnt(index, f"{course.name(index)} {known}")) is not None:
            return other
        return run.drive(self._index) if self._begins else Waiting(run, self._index)

    def _on(self) -> Next:
        self._looked = True
        return self


def summary(plan: Plan) -> str:
    """A plan in words."""
    sequence = sequence_name([phase.mode for phase in plan.phases])
    return f"{sequence} in {plan.duration_s:z.1f} s"
