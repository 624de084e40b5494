"""Running a plan to its goal, whatever happens: follow it, correct, plan again, or say why not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.execution.camera_feedback import ByCamera, Pulses
from twosra_mpc.execution.doubt import DoubtError
from twosra_mpc.execution.guard import MeetsItselfError, TooNearError, guard_of
from twosra_mpc.execution.mission import Mission
from twosra_mpc.execution.remaining import remaining_problem, tasks_left
from twosra_mpc.execution.robot_interface import RobotInterface, stopped_after
from twosra_mpc.execution.run import Ending, Run, Verdict, times
from twosra_mpc.execution.runner import Abort, PlanRunner
from twosra_mpc.execution.segment_watch import SegmentError
from twosra_mpc.execution.session import Session
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.execution.tracking.tracker import Tracker
from twosra_mpc.interrupts import Interrupts
from twosra_mpc.planning.planner import plan as find_plan
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.tasks import Task
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, sequence_name

_MISSES = 1  # of a mode of several segments that are planned again in the same
_LONGER = 2  # doublings: two melts of 2sra-v1, after which all of it is liquid

Meanwhile = Callable[[Callable[[], Result], Callable[[], None]], Result]


def at_once(work: Callable[[], Result], _rest: Callable[[], None]) -> Result:
    """Plan while no time passes for the robot, as a simulated one."""
    return work()


@dataclass(frozen=True)
class Executor:
    """Runs plans on a robot: by events, with a camera, planning again where it must.

    Attributes:
        robot: The robot.
        settings: When it is content, and when it gives up.
        on_command: Called after every command.
        meanwhile: Plans, and lets the robot rest as long as that takes.
    """

    robot: RobotInterface
    settings: ExecutorSettings = field(default_factory=ExecutorSettings)
    on_command: Callable[[Session], None] = lambda session: None
    meanwhile: Meanwhile = at_once

    @public
    def run(self, plan: Plan) -> Run:
        """Run a plan; the robot must be where it starts. It stands at the end, heaters off.

        So it does whatever ends the run: an error, Ctrl-C, or a signal that ends the program.

        Raises:
            InputError: If the plan is for another robot.
            NoPlanError: If the plan is not verified.
            RobotError: If the robot cannot be driven any more.
        """
        if plan.require().robot != self.robot.robot:
            allowed = f"a plan for this very robot, {self.robot.robot.name}, with all its values"
            raise InputError("plan.robot", plan.robot.name, allowed)

        def drive(interrupts: Interrupts) -> Run:
            def told(session: Session) -> None:
                interrupts.check()
                self.on_command(session)

            return _Execution(replace(self, on_command=told), plan).run()

        return stopped_after(self.robot, drive)


class _Execution:
    """One run of the executor."""

    def __init__(self, executor: Executor, plan: Plan) -> None:
        robot, self.settings, self.problem = executor.robot, executor.settings, plan.problem
        self.meanwhile = executor.meanwhile
        self.tracker = Tracker(robot.robot, rate_Hz=robot.camera.rate_Hz)
        guard = guard_of(plan.problem, self.settings.patience)
        patience = self.settings.patience
        self.session = Session(robot, plan.problem, executor.on_command, guard, patience=patience)
        self.mission: Mission | None = None
        if plan.problem.is_mission:
            self.mission = Mission(self.session, self.settings.patience, plan)
        self.plans, self.begun = [plan], [0]
        self.broken: set[int] = set()
        self.cooled: set[int] = set()
        self.replans = self.corrections = self.melted_on = self.stops = 0
        self.doubted = 0
        self.missed: list[Mode] = []
        self.near = ""
        self.session.tell("plan", _summary(plan))

    def run(self) -> Run:
        """Follow plan after plan until there is an ending."""
        step = self._follow_and_plan
        while True:
            try:
                ending = step()
                step = self._follow_and_plan
            except SegmentError as trouble:  # wherever it was noticed
                ending, step = self._troubled(trouble), self._plan_again
            if ending is not None:
                account = ((), 0) if self.mission is None else self.mission.account
                verdict = Verdict(
                    "optimal", *ending, tuple(self.plans), tuple(self.begun), *account
                )
                return self.session.finish(verdict)

    def _follow_and_plan(self) -> tuple[Ending, str] | None:
        left = self._follow(self.plans[-1])
        ending = self._arrived() if left is None else self._left(left)
        return ending or self._plan_again()

    def _troubled(self, trouble: SegmentError) -> tuple[Ending, str] | None:
        """End for what is wrong with a segment; one that cannot be heated may not be needed."""
        if trouble.cause != "heater":
            return trouble.ending, str(trouble)
        return self._left(Abort("heater", str(trouble), trouble.segment))

    def _follow(self, plan: Plan) -> Abort | None:
        settings = self.settings
        pulses = Pulses(settings.dead_zone_rad_s)
        by_camera = ByCamera(plan, self.tracker, pulses, self.mission)
        runner = PlanRunner(self.session, plan, by_camera, settings.patience, settings.longest_s)
        try:
            left = runner.follow()
        except MeetsItselfError as near:
            left = Abort("body", str(near))
        except TooNearError as near:
            left = Abort("near", str(near))
        except DoubtError as doubt:
            kind: Literal["corridor", "doubt"] = "corridor" if doubt.stalled else "doubt"
            left = Abort(kind, str(doubt), stiff=doubt.bends)
            self.doubted = self.settings.doubts if doubt.final else self.doubted
        finally:
            self.begun[-1] = runner.schedule.begun(runner.progress)
        return left

    def _arrived(self) -> tuple[Ending, str] | None:
        """Look where the robot has come to at the end of a plan."""
        session, patience = self.session, self.settings.patience
        accuracy = session.accuracy
        scale = patience.certain * accuracy.scale(self.problem.robot.coordinates)
        session.average(session.setpoint_C, scale, patience.look_s)
        if session.unseen_s > patience.unseen_s:
            return session.ending_unseen(left=bool(self._tasks_left()))
        where = accuracy.describe(session.error)
        left = self._tasks_left()
        if accuracy.surely(session.error) and not left:
            if not session.sure(accuracy.scale(self.problem.robot.coordinates)):
                return session.ending_unseen(left=False)
            if np.isnan(self.session.goal.configuration).all():  # a mission without a goal
                return Ending.REACHED, f"all {len(self.problem.tasks)} tasks are done"
            return Ending.REACHED, f"the goal is reached: {where}"
        missing = f"; {len(left)} of {len(self.problem.tasks)} tasks left" if left else ""
        session.tell("look", f"the plan is at its end, {where}{missing}")
        return None

    def _left(self, left: Abort) -> tuple[Ending, str] | None:
        """What an abort means: an ending, or that the rest is to be planned again."""
        match left.kind:
            case "time":
                return Ending.TIME_LIMIT, left.text
            case "camera":
                return self.session.ending_unseen(left=bool(self._tasks_left()))
            case "doubt":
                return self._doubted(left)
            case "heater" if left.to == "rigid":
                return Ending.HEATER_FAILED, f"{left.text}; it cannot be cooled"
            case "heater":
                self.broken.add(left.segment)
                self.session.tell("failure", left.text)
            case "corridor":
                self.session.tell("look", left.text)
                if left.missed is not None:
                    self.missed.append(left.missed)
                if left.stiff:
                    self._melt_on()
            case "near" | "body":
                return self._stopped(left)
            case "task":
                self.session.tell("look", left.text)
            case "lost":
                return self._lost(left.text)
        return None

    def _doubted(self, left: Abort) -> tuple[Ending, str] | None:
        """Heat on and try again, once: a segment may be soft later than its sensor says.

        From then on it is called soft when it has had the heat for it: see `SegmentWatch.doubted`.
        """
        self.session.tell("failure", left.text)
        self.doubted += 1
        if self.doubted > self.settings.doubts:
            return Ending.SENSOR_FAILED if left.stiff else Ending.NOT_MOVING, left.text
        if left.stiff:
            self._melt_on()
        return None

    def _lost(self, text: str) -> tuple[Ending, str] | None:
        """Stop, and have the object grasped again, unless that has been tried too often."""
        assert self.mission is not None
        self.session.tell("failure", text)
        lost = self.mission.lose(text)
        if lost > self.settings.grasps:
            return Ending.OBJECT_LOST, f"{text}; lost {times(lost)}; {self._where()}"
        return self._cool()

    def _tasks_left(self) -> tuple[Task, ...]:
        """Tasks that are not done yet."""
        if self.mission is not None:
            return self.mission.left
        return tasks_left(self.problem.passes, self.session.path)

    def _stopped(self, left: Abort) -> tuple[Ending, str] | None:
        """Stopped near something: let everything become solid, to be planned again from there.

        A robot that was stopped before it met itself bends back as it is.
        """
        where = left.text
        self.session.tell("look", where)
        self.stops, self.near = self.stops + 1, where
        if self.stops > self.settings.stops:
            return Ending.TOO_NEAR, f"{where}, {times(self.stops)} by now; {self._where()}"
        return None if left.kind == "body" else self._cool()

    def _cool(self) -> tuple[Ending, str] | None:
        """Let all segments become solid."""
        self.cooled = set(range(len(self.session.setpoint_C)))
        stuck, self.cooled = self._wait_for_metal(), set()
        return stuck

    def _melt_on(self) -> None:
        """Hold the soft segments for a while, longer the next times, so that all of it melts."""
        session, patience = self.session, self.settings.patience
        end_s = session.now_s + patience.melt_on_s * 2**self.melted_on
        self.melted_on = min(self.melted_on + 1, _LONGER)
        while session.now_s < end_s:
            session.rest(self._as_they_become(), patience.rest_s)

    def _plan_again(self) -> tuple[Ending, str] | None:
        """Plan the rest from where the robot is, once nothing is changing any more."""
        session = self.session
        session.rest(self._as_they_become(), session.period_s)  # no wheel turns meanwhile
        if (stuck := self._wait_for_metal()) is not None:
            return stuck
        holds = self.mission is not None and self.mission.holding is not None
        if holds and (stuck := self._cool()) is not None:  # no soft robot holds anything
            return stuck
        if self.mission is not None:
            self.mission.look()
        found = self._planned()
        if isinstance(found, str) and session.guard is not None and any(session.mode or ()):
            if (stuck := self._cool()) is not None:  # a solid robot may drive to where it can bend
                return stuck
            found = self._planned()
        if isinstance(found, str) and self.missed:
            self.missed.clear()  # any plan is better than none
            found = self._planned()
        return self._no_plan(found) if isinstance(found, str) else self._adopt(found)

    def _planned(self) -> Plan | str:
        """A plan of what is left, or why there is none."""
        session = self.session
        mode = session.mode
        assert mode is not None
        try:
            warm_C = session.reading.temperature_C
            if self.mission is not None:
                rest = remaining_problem(*self.mission.rest(), warm_C, mode, self.broken)
            else:
                judged = len(self.missed), self._avoided
                rest = remaining_problem(
                    self.problem, session.q, warm_C, mode, self.broken, *judged
                )
                rest = rest.with_values(tasks=self._tasks_left())
            result = self.meanwhile(
                lambda: find_plan(rest),
                lambda: session.rest(self._as_they_become(), self.settings.patience.rest_s),
            )
        except InputError as error:
            return str(error)
        return result.message if result.plan is None else result.plan

    @property
    def _avoided(self) -> set[Mode]:
        """Modes of several segments whose bends have missed before: these bend one by one."""
        several = {mode for mode in self.missed if sum(mode) > 1}
        return {mode for mode in several if self.missed.count(mode) > _MISSES}

    def _adopt(self, plan: Plan) -> tuple[Ending, str] | None:
        """Go on with another plan, unless that has been done too often."""
        settings, where = self.settings, self._where()
        if plan.cost.transitions:
            if self.mission is not None and self.mission.advanced:
                self.replans = 0
            if self.replans == settings.replans:
                return Ending.GAVE_UP, f"{where} after planning again {times(self.replans)}"
            self.replans, self.corrections = self.replans + 1, 0
            self.session.tell("replan", f"the rest is planned again, {_summary(plan)}")
        else:
            if self.corrections == settings.corrections:
                return Ending.GAVE_UP, f"{where} after {self.corrections} corrections in a row"
            self.corrections += 1
            self.session.tell("correct", f"the pose is corrected, {_summary(plan)}")
        if self.mission is not None:
            self.mission.begin(plan)
        self.plans.append(plan)
        self.begun.append(0)
        self.near = ""
        return None

    def _no_plan(self, why: str) -> tuple[Ending, str]:
        where = self._where()
        if self.near:
            return Ending.TOO_NEAR, f"{self.near}; {where}; the rest cannot be planned: {why}"
        if self.mission is not None and self.mission.trouble:
            return Ending.OBJECT_LOST, f"{self.mission.trouble}; it cannot be grasped again: {why}"
        if self.broken:
            names = " and ".join(str(segment + 1) for segment in sorted(self.broken))
            known = why.split("; allowed modes")[0]  # no advice to use what has failed
            return Ending.HEATER_FAILED, f"{where}; without heater {names}: {known}"
        return Ending.NO_PLAN, f"{where}; the rest cannot be planned: {why}"

    def _where(self) -> str:
        return self.session.accuracy.describe(self.session.error)

    def _wait_for_metal(self) -> tuple[Ending, str] | None:
        """Wait until no segment is changing; each goes on to what it was becoming."""
        session, settings = self.session, self.settings
        while session.mode is None or any(session.mode[j] for j in self.broken | self.cooled):
            if session.now_s > settings.longest_s:  # a segment that is slow: see `SegmentWatch`
                return Ending.TIME_LIMIT, f"the run has taken more than {settings.longest_s:z.0f} s"
            session.rest(self._as_they_become(), settings.patience.rest_s)
        return None

    def _as_they_become(self) -> Array:
        """Set-points that let every segment become, or stay, what it is becoming, (n,)."""
        heater = self.problem.robot.heater
        becoming = []
        for segment, now in enumerate(self.session.reading.stiffness):
            asked = self.session.setpoint_C[segment] >= heater.soft_setpoint_C
            soft = now == "soft" or (now == "changing" and asked)
            becoming.append(soft and segment not in self.broken | self.cooled)
        return np.where(becoming, heater.soft_setpoint_C, heater.rigid_setpoint_C)


def _summary(plan: Plan) -> str:
    sequence = sequence_name([phase.mode for phase in plan.phases])
    return f"{sequence} in {plan.duration_s:z.1f} s"
