"""Following a plan to its goal, whatever happens: correct, plan again, or say why not."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import (
    Activity,
    AstrayError,
    Looking,
    Next,
    ObjectLostError,
    Trouble,
    UnseenError,
    look_at_objects,
    look_at_robot,
)
from twosra_mpc.execution.course import Course, PlanPolicy, Waiting
from twosra_mpc.execution.doubt import DoubtError
from twosra_mpc.execution.driving import Driving, Pulses
from twosra_mpc.execution.guard import MeetsItselfError
from twosra_mpc.execution.mission import Mission
from twosra_mpc.execution.replanning import Replanning, has_no_room, reconsidered
from twosra_mpc.execution.run import Ending, Verdict, times
from twosra_mpc.execution.segment_watch import SegmentError
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.execution.tracking.tracker import Tracker
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.limits import CLEARANCE
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.accuracy import SHAPE_SHARE
from twosra_mpc.robot.modes import Mode, is_rigid, sequence_name

_LESS_ROOM = 0.7  # of a clearance that no plan keeps
_ON_S = 0.25  # of the plan, after which a robot that was stopped and is not too near may go on
_NEAR_PLAN = 0.5  # of the corridor: from farther away it is planned again
_LONGER = 2  # doublings: two melts of 2sra-v1, after which all of it is liquid

Think = Callable[[Problem], Result | None]
"""Plans a problem; None while it is still at it, and is asked again at the next step."""


class Following(PlanPolicy):
    """A policy: a plan is followed by a camera, and what is left is planned again where it must be.

    Attributes:
        belief: What is known of the robot.
        settings: When it is content, and when it gives up.
        course: The plan on its way.
        mission: The tasks on their way.
        during: What the run is at, in words.
        broken: Segments (from 0) that cannot be melted any more.
        missed: Modes whose bends have missed.
        stalled: Modes in which wheels could bend no further in this shape.
        clearance_m: What plans of the rest are to keep.
    """

    def __init__(
        self, belief: Belief, plan: Plan, settings: ExecutorSettings, think: Think
    ) -> None:
        """The robot is where the plan starts."""
        self.belief, self.settings, self.patience = belief, settings, belief.patience
        self.problem, self.think, self.longest_s = plan.problem, think, settings.longest_s
        self.tracker = Tracker(plan.robot, rate_Hz=belief.camera.rate_Hz)
        self.mission = Mission(belief, plan)
        self.broken, self.missed, self.stalled = set[int](), list[Mode](), set[Mode]()
        self.clearance_m = settings.clearance_m if plan.problem.obstacles else 0.0
        self.near, self.during = "", "before the plan begins"
        self._plans, self._begun = list[Plan](), list[int]()
        self._replans = self._corrections = self._stops = self._doubted = 0
        self._melted_on = 0
        self.driving: Driving | None = None
        self._follow(plan)

    def begin(self) -> Activity:
        """Wait for the first phase, of a plan that keeps as much clearance as the run needs."""
        self.belief.tell("plan", summary(self.course.plan))
        if (kept_m := self._kept_m) >= self.clearance_m:
            return Waiting(self, 0)
        kept_mm, needed_mm = 1e3 * kept_m, 1e3 * self.clearance_m
        self.belief.tell(
            "look", f"{needed_mm:z.1f} mm of clearance are needed, {kept_mm:z.1f} planned"
        )
        while self.clearance_m > kept_m and has_no_room(self.problem, self.clearance_m):
            self.clearance_m *= _LESS_ROOM
        return Replanning(self) if self.clearance_m > kept_m else Waiting(self, 0)

    @property
    def _kept_m(self) -> float:
        """Clearance that the plan keeps."""
        plan = self.course.plan.require()
        return plan.problem.clearance_m + plan.verification.limits.get(CLEARANCE.name, 0.0)

    def narrower(self) -> Activity | None:
        """Ask for less clearance where no plan keeps so much; None: no more was asked."""
        if self.clearance_m <= self.problem.clearance_m:
            return None
        self.belief.tell("look", f"no plan is found that keeps {1e3 * self.clearance_m:z.1f} mm")
        self.clearance_m *= _LESS_ROOM
        given = not self.belief.drives and self.clearance_m <= self._kept_m
        return Waiting(self, 0) if given else Replanning(self)

    def _follow(self, plan: Plan) -> None:
        self.course = Course(self.belief, plan)
        self.pulses = Pulses(self.settings.dead_zone_rad_s)
        self.tracker.reset(plan)
        self._stopped_s = -math.inf
        self._plans.append(plan)
        self._decided_s = self.belief.now_s

    # A plan on its way.

    def arrived(self, index: int) -> Next:
        """Drive a phase, or look where the robot has come to, once tasks are done that are due."""
        return _DueTasks(self, index, begins=True)

    def phase_done(self, index: int) -> Next:
        """Go on to the next phase, once tasks are done that are due."""
        self.driving, phase = None, self.course.plan.phases[index]
        self.course.end(phase)
        if not is_rigid(phase.mode):
            self.stalled.clear()
        return _DueTasks(self, index + 1, begins=False)

    def drive(self, index: int) -> Next:
        """Drive a phase; after the last, look where the robot has come to."""
        course, belief = self.course, self.belief
        if index == len(course.plan.phases):
            surely = belief.accuracy.surely(np.abs(belief.error) + 2 * belief.deviation)
            at_most_s, then = self.patience.long_look_s, self._at_the_end
            return then() if surely else Looking(belief, self._decided, at_most_s, then)
        self.during = f"in {course.name(index)}"
        belief.tell("drive", f"{course.name(index)} begins")
        self.driving = Driving(self, index)
        return self.driving

    def _decided(self) -> bool:
        """True if it is certain where the robot is, and whether its shape is near enough."""
        belief, accuracy, patience = self.belief, self.belief.accuracy, self.patience
        short = abs(SHAPE_SHARE - accuracy.of_shape(belief.error))
        clear = short >= 2 * accuracy.of_shape(belief.deviation)
        share = patience.certain if clear else patience.certain_of_a_melt
        return belief.certain(share * accuracy.scale(self.problem.robot.coordinates))

    def _at_the_end(self) -> Next:
        """Judge where the robot has come to at the end of a plan."""
        belief, left = self.belief, self.mission.left
        if belief.unseen_s > self.patience.unseen_s:
            return self.verdict(*belief.ending_unseen(left=bool(left)))
        if belief.accuracy.surely(belief.error) and not left:
            if not belief.sure(belief.accuracy.scale(self.problem.robot.coordinates)):
                return self.verdict(*belief.ending_unseen(left=False))
            if np.isnan(belief.goal.configuration).all():  # a mission without a goal
                return self.verdict(Ending.REACHED, "all tasks are done")
            return self.verdict(Ending.REACHED, f"the goal is reached: {belief.where}")
        missing = f"; {len(left)} of {len(self.problem.tasks)} tasks left" if left else ""
        belief.tell("look", f"the plan is at its end, {belief.where}{missing}")
        return Replanning(self)

    # What goes wrong.

    def troubled(self, trouble: Trouble) -> Next:
        """Go on after a trouble, or end."""
        driving, text = self.driving, str(trouble)
        if isinstance(trouble, UnseenError):
            return self.verdict(*self.belief.ending_unseen(left=bool(self.mission.left)))
        if isinstance(trouble, ObjectLostError):
            return self._lost(text)
        if isinstance(trouble, AstrayError):
            self.missed += [] if trouble.missed is None else [trouble.missed]
            return self._astray(text, melting_on=trouble.stiff)
        if isinstance(trouble, SegmentError):
            if trouble.cause != "heater":  # which may not be needed
                return self.verdict(trouble.ending, text)
            self.broken.add(trouble.segment)
            self.belief.tell("failure", text)
            return Replanning(self)
        if isinstance(trouble, DoubtError):
            if driving is not None and not driving.rigid and self.mission.closes:
                return driving.ended()  # what it closes round may keep it from bending
            if trouble.stalled and not trouble.final:
                self.stalled |= set() if driving is None else {driving.phase.mode}
                return self._astray(text, melting_on=trouble.bends)
            return self._doubts(trouble)
        bends_back = isinstance(trouble, MeetsItselfError)
        if driving is not None and not bends_back and self._goes_on():
            self.belief.tell("look", f"{text}, and goes on after a look")
            return driving
        return self._stopped(text, cooling=not bends_back)

    def _goes_on(self) -> bool:
        """True if a robot that was stopped near its plan is not too near, now that it is seen."""
        belief, before_s = self.belief, self._stopped_s
        if belief.guard is None or belief.mode is None:
            return False
        self._stopped_s = self.course.clock_s
        near = belief.guard.forbids(belief.mode, belief.q[None], belief.deviation)
        near |= belief.guard.off_m(self.course.away) > _NEAR_PLAN * self.patience.narrow_m
        return not near and self._stopped_s >= before_s + _ON_S

    def _astray(self, text: str, *, melting_on: bool) -> Next:
        self.belief.tell("look", text)
        return Replanning(self, melting_on=melting_on)

    def _doubts(self, doubt: DoubtError) -> Next:
        """Heat on and try again, once: a segment may be soft later than its sensor says.

        From then on it is called soft when it has had the heat for it: see `SegmentWatch.doubted`.
        """
        text, held = str(doubt), self.mission.holding
        if held is not None and not doubt.bends:
            text += f"; it holds {held}: can its wheels pull that?"
        self.belief.tell("failure", text)
        self._doubted += 1
        if doubt.final or self._doubted > self.settings.doubts:
            ending = Ending.SENSOR_FAILED if doubt.bends else Ending.NOT_MOVING
            return self.verdict(ending, text)
        return Replanning(self, melting_on=doubt.bends)

    def _lost(self, text: str) -> Next:
        """Stop, and have the object grasped again, unless that has been tried too often."""
        self.belief.tell("failure", text)
        lost = self.mission.lose(text)
        if lost > self.settings.grasps:
            where = self.belief.where
            return self.verdict(Ending.OBJECT_LOST, f"{text}; lost {times(lost)}; {where}")
        return Replanning(self, cooling=True)

    def _stopped(self, text: str, *, cooling: bool) -> Next:
        """Stopped near something: let everything become solid, to be planned again from there.

        A robot that was stopped before it met itself bends back as it is.
        """
        self.belief.tell("look", text)
        self._stops, self.near = self._stops + 1, text
        if self._stops > self.settings.stops:
            words = f"{text}, {times(self._stops)} by now; {self.belief.where}"
            return self.verdict(Ending.TOO_NEAR, words)
        return Replanning(self, cooling=cooling)

    # What is planned again.

    def adopt(self, plan: Plan) -> Next:
        """Go on with another plan, unless that has been done too often."""
        settings, belief, again = self.settings, self.belief, bool(plan.cost.transitions)
        if again:
            if len(self.mission.done_s) > self.mission.done_before:
                self._replans = 0
            old_s = self.course.plan.duration_s - self.course.clock_s
            done = f"planning again {times(self._replans)}"
            words = f"the rest is planned again, {summary(plan)}; "
            words += f"of the plan {old_s:z.0f} s are left"
            self._replans, self._corrections = self._replans + 1, 0
        else:
            done = f"{self._corrections} corrections in a row"
            words = f"the pose is corrected, {summary(plan)}"
            self._corrections += 1
        if self._replans > settings.replans or self._corrections > settings.corrections:
            return self.verdict(Ending.GAVE_UP, f"{belief.where} after {done}")
        belief.tell("replan" if again else "correct", words)
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
        rest = f"the rest cannot be planned: {why}"
        if self.near:
            return self.verdict(Ending.TOO_NEAR, f"{self.near}; {where}; {rest}")
        if lost := self.mission.trouble:
            return self.verdict(Ending.OBJECT_LOST, f"{lost}; it cannot be grasped again: {why}")
        if self.broken:
            names = " and ".join(str(segment + 1) for segment in sorted(self.broken))
            known = why.split("; allowed modes")[0]  # no advice to use what has failed
            return self.verdict(Ending.HEATER_FAILED, f"{where}; without heater {names}: {known}")
        return self.verdict(Ending.NO_PLAN, f"{where}; {rest}")

    def verdict(self, ending: Ending, reason: str) -> Verdict:
        """An ending of the run."""
        plans, begun = tuple(self._plans), (*self._begun, self.course.begun)
        account = tuple(self.mission.done_s), self.mission.lost.total()
        return Verdict("optimal", ending, reason, plans, begun, *account)


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
                return look_at_objects(run.belief, partial(look_at_robot, run.belief, self._on))
            self._looked = False
            mission.judge()
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
    return f"{sequence_name([phase.mode for phase in plan.phases])} in {plan.duration_s:z.1f} s"
