"""Running a plan to its goal, whatever happens: follow it, correct, plan again, or say why not."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.execution.accuracy import Accuracy
from twosra_mpc.execution.follower import (
    CERTAIN,
    LOOK_S,
    WAIT_S,
    Departure,
    PlanFollower,
)
from twosra_mpc.execution.pulses import Pulses
from twosra_mpc.execution.remaining import remaining_problem
from twosra_mpc.execution.robot_interface import RobotInterface
from twosra_mpc.execution.run import Ending, Run, times
from twosra_mpc.execution.session import Session
from twosra_mpc.execution.tracking.tracker import Tracker
from twosra_mpc.planning.planner import plan as find_plan
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.modes import sequence_name

Array = NDArray[np.float64]

_LONGEST_CHANGE_S = 1500.0  # for a segment that is waited for before planning again
_PAUSE_S = 30.0  # for metal that is reported soft and does not bend


@dataclass(frozen=True)
class ExecutorSettings:
    """When an executor is content, and when it gives up.

    Attributes:
        accuracy: How near to the goal is near enough.
        replans: How often the remaining problem is planned again at most.
        corrections: How often in a row the pose is corrected at most.
        longest_s: Longest run.
        dead_zone_rad_s: Of the robot's drives, as far as it is known.
    """

    accuracy: Accuracy = field(default_factory=Accuracy)
    replans: int = 8
    corrections: int = 6
    longest_s: float = 7200.0
    dead_zone_rad_s: float = 0.0


class Executor:
    """Runs plans on a robot: by events, with feedback, planning again where it must."""

    def __init__(self, robot: RobotInterface, settings: ExecutorSettings | None = None) -> None:
        """Make ready to drive a robot."""
        self.robot, self.settings = robot, settings or ExecutorSettings()
        self._tracker = Tracker(robot.robot, rate_Hz=robot.camera.rate_Hz)

    def run(self, plan: Plan) -> Run:
        """Run a plan; the robot must be where it starts.

        Raises:
            InputError: If the plan is for another robot.
        """
        if plan.robot != self.robot.robot:
            allowed = f"a plan for this very robot, {self.robot.robot.name}, with all its values"
            raise InputError("plan.robot", plan.robot.name, allowed)
        return _Journey(self.robot, self._tracker, self.settings, plan).run()


class _Journey:
    """One run of the executor."""

    def __init__(
        self, robot: RobotInterface, tracker: Tracker, settings: ExecutorSettings, plan: Plan
    ) -> None:
        self.settings, self.tracker, self.problem = settings, tracker, plan.problem
        self.session = Session(robot, plan.problem)
        self.plans, self.begun = [plan], [0]
        self.broken: set[int] = set()
        self.replans = self.corrections = 0
        self.session.tell("plan", _summary(plan))

    def run(self) -> Run:
        """Follow plan after plan until there is an ending."""
        while True:
            left = self._follow(self.plans[-1])
            ending = self._arrived() if left is None else self._left(left)
            ending = ending or self._plan_again()
            if ending is not None:
                return self.session.finish(
                    "optimal",
                    self.settings.accuracy,
                    *ending,
                    plans=tuple(self.plans),
                    begun=tuple(self.begun),
                )

    def _follow(self, plan: Plan) -> Departure | None:
        settings = self.settings
        follower = PlanFollower(
            self.session,
            self.tracker,
            plan,
            settings.accuracy,
            Pulses(settings.dead_zone_rad_s),
            settings.longest_s,
        )
        left = follower.follow()
        self.begun[-1] = follower.begun
        return left

    def _arrived(self) -> tuple[Ending, str] | None:
        """Look where the robot has come to at the end of a plan."""
        session, accuracy = self.session, self.settings.accuracy
        session.average(session.setpoint_C, CERTAIN * accuracy.scale, LOOK_S)
        where = accuracy.describe(session.error)
        if accuracy.surely(session.error):
            return Ending.REACHED, f"the goal is reached: {where}"
        session.tell("look", f"the plan is at its end, {where}")
        return None

    def _left(self, left: Departure) -> tuple[Ending, str] | None:
        """What a departure means: an ending, or that the rest is to be planned again."""
        match left.kind:
            case "time":
                return Ending.TIME_LIMIT, left.text
            case "heater" if left.to == "rigid":
                return Ending.HEATER_FAILED, f"{left.text}; it cannot be cooled"
            case "heater":
                self.broken.add(left.segment)
                self.session.tell("failure", left.text)
            case "corridor":
                self.session.tell("look", left.text)
                if left.stiff:
                    self._give_time()
        return None

    def _give_time(self) -> None:
        """Hold the soft segments for a while, so that the last of their metal melts."""
        end_s = self.session.now_s + _PAUSE_S
        while self.session.now_s < end_s:
            self.session.rest(self._as_they_become(), WAIT_S)

    def _plan_again(self) -> tuple[Ending, str] | None:
        """Plan the rest from where the robot is, once nothing is changing any more."""
        stuck = self._settle()
        if stuck is not None:
            return stuck
        session, settings = self.session, self.settings
        mode = session.mode
        assert mode is not None
        try:
            problem = remaining_problem(
                self.problem,
                session.q,
                session.reading.temperature_C,
                mode,
                settings.accuracy,
                self.broken,
            )
            result = find_plan(problem)
        except InputError as error:
            return self._no_plan(str(error))
        if result.plan is None:
            return self._no_plan(result.message)
        return self._adopt(result.plan)

    def _adopt(self, plan: Plan) -> tuple[Ending, str] | None:
        """Go on with another plan, unless that has been done too often."""
        settings, where = self.settings, self.settings.accuracy.describe(self.session.error)
        if plan.cost.transitions:
            if self.replans == settings.replans:
                return Ending.GAVE_UP, f"{where} after planning again {times(self.replans)}"
            self.replans, self.corrections = self.replans + 1, 0
            self.session.tell("replan", f"the rest is planned again, {_summary(plan)}")
        else:
            if self.corrections == settings.corrections:
                return Ending.GAVE_UP, f"{where} after {self.corrections} corrections in a row"
            self.corrections += 1
            self.session.tell("correct", f"the pose is corrected, {_summary(plan)}")
        self.plans.append(plan)
        self.begun.append(0)
        return None

    def _no_plan(self, why: str) -> tuple[Ending, str]:
        where = self.settings.accuracy.describe(self.session.error)
        if self.broken:
            names = " and ".join(str(segment + 1) for segment in sorted(self.broken))
            known = why.split("; allowed modes")[0]  # no advice to use what has failed
            return Ending.HEATER_FAILED, f"{where}; without heater {names}: {known}"
        return Ending.NO_PLAN, f"{where}; the rest cannot be planned: {why}"

    def _settle(self) -> tuple[Ending, str] | None:
        """Wait until no segment is changing; each goes on to what it was becoming."""
        session = self.session
        while session.mode is None or any(session.mode[segment] for segment in self.broken):
            slow = max(session.asked_for_s(segment) for segment in (0, 1))
            if slow > _LONGEST_CHANGE_S or session.now_s > self.settings.longest_s:
                return Ending.HEATER_FAILED, f"a segment has been changing for {slow:.0f} s"
            session.rest(self._as_they_become(), WAIT_S)
        return None

    def _as_they_become(self) -> Array:
        """Set-points that let every segment become, or stay, what it is becoming, (2,)."""
        heater = self.problem.robot.heater
        becoming = []
        for segment, now in enumerate(self.session.reading.stiffness):
            asked = self.session.setpoint_C[segment] >= heater.soft_setpoint_C
            soft = now == "soft" or (now == "changing" and asked)
            becoming.append(soft and segment not in self.broken)
        return np.where(becoming, heater.soft_setpoint_C, heater.rigid_setpoint_C)


def _summary(plan: Plan) -> str:
    sequence = sequence_name([phase.mode for phase in plan.phases])
    return f"{sequence} in {plan.duration_s:.1f} s"
