"""The one runner of plans: it waits for each phase, has it driven, and says why it cannot go on.

The plan's clock stands at a phase's start until the feedback lets the phase begin, and jumps there
if that is early. The feedback decides what a phase waits for, which heaters are on and how it is
driven.

Heaters follow the events. A melt is not let begin before every phase in which the segment must be
solid is done, however long that takes; until then the segment is only kept warm. A heater goes off
when the last phase in which the segment must be soft is done, not at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from twosra_mpc.control.stiffness import stiffness_rule
from twosra_mpc.execution.run import Drive
from twosra_mpc.execution.session import Session
from twosra_mpc.execution.settings import Patience
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, Stiffness, mode_name
from twosra_mpc.timing import Transition
from twosra_mpc.timing.transitions import own_transitions

_WARM_SHARE = 0.7  # of the way from the air to where a segment may begin to melt, as observed


class Progress(NamedTuple):
    """How far the execution of a plan has come.

    Attributes:
        clock_s: Time of the plan; it stands at a phase's start until the phase can begin.
        done: How many phases have ended.
    """

    clock_s: float = 0.0
    done: int = 0


@dataclass(frozen=True)
class HeaterSchedule:
    """Set-points by progress.

    Attributes:
        plan: The plan.
    """

    plan: Plan

    @cached_property
    def warm_C(self) -> float:
        """Set-point at which a segment is kept warm, surely solid."""
        return warm_setpoint_C(self.plan.problem)

    @cached_property
    def _start_mode(self) -> Mode:
        """Asked for in every period of a run."""
        return self.plan.problem.start_mode

    @property
    def last_mode(self) -> Mode:
        """Mode that the plan ends in: the goal's, or as the last task leaves the segments."""
        mode = list(self._start_mode)
        for item in sorted(self.plan.transitions, key=lambda item: item.done_s):
            mode[item.segment - 1] = int(item.to == "soft")
        return tuple(mode)

    def setpoints(self, now: Progress) -> Array:
        """Set-points of the segments [C], (n,)."""
        planned = self.plan.trajectory.heater_setpoint_C([now.clock_s])[0].tolist()
        values = np.array([self._setpoint(j, now, each_C) for j, each_C in enumerate(planned)])
        heater, warm = self.plan.robot.heater, values == self.warm_C
        heated = np.count_nonzero(values == heater.soft_setpoint_C) + np.cumsum(warm)
        # As many are kept warm as may be heated besides those that melt.
        values[warm & (heated > self.plan.problem.heaters_at_once)] = heater.rigid_setpoint_C
        return values

    def begun(self, now: Progress) -> int:
        """How many transitions have been commanded by now."""
        return sum(self._commanded(item, now) for item in self.plan.transitions)

    def expected_s(self, segment: int, to: str) -> float:
        """Longest time the plan gives a segment (from 0) for such a transition [s]; 0: none."""
        own = own_transitions(self.plan.transitions, segment)
        return max((item.done_s - item.heater_s for item in own if item.to == to), default=0.0)

    def _setpoint(self, segment: int, now: Progress, planned_C: float) -> float:
        heater = self.plan.robot.heater
        soft, rigid = heater.soft_setpoint_C, heater.rigid_setpoint_C
        value = soft if self._start_mode[segment] else rigid
        for item in own_transitions(self.plan.transitions, segment):
            if self._commanded(item, now):
                value = soft if item.to == "soft" else rigid
            elif item.to == "soft" and _reached(now, item.heater_s):
                value = self.warm_C
        kept_warm = rigid < planned_C < soft  # by the plan itself
        return self.warm_C if value == rigid and kept_warm else value

    def _commanded(self, item: Transition, now: Progress) -> bool:
        before = sum(phase.end_s <= item.onset_s + SAME_TIME_S for phase in self.plan.phases)
        early = item.to == "rigid" and before > 0  # the plan let it coast
        return now.done >= before and (early or _reached(now, item.heater_s))


def _reached(now: Progress, time_s: float) -> bool:
    return now.clock_s >= time_s - SAME_TIME_S


def warm_setpoint_C(problem: Problem) -> float:
    """Temperature at which a segment is surely solid, even if its heater is a third stronger."""
    robot, air = problem.robot, problem.ambient
    segments = range(robot.coordinates.segments)
    melts_from_C = min(stiffness_rule(robot, air, j).rigid_until_C for j in segments)
    return air + _WARM_SHARE * (melts_from_C - air)


_WHOLE = 1e-9  # rounding of a number of periods


class Abort(NamedTuple):
    """Why a plan cannot be followed to its end.

    Attributes:
        kind: "corridor": the rest of the plan does not lead to the goal from here; "heater": a
            segment did not become what it should; "camera": nothing sees the robot; "doubt": it
            does not move as commanded; "near": it was stopped near something; "body": it was
            stopped near itself; "task": a task is not done where it should be; "lost": an object is
            not where it was held or put; "time": the run takes too long.
        text: The same in words.
        segment: The segment (from 0) whose heater it is.
        to: What it should have become.
        stiff: Whether a segment that is reported soft seems to need more time.
        missed: Mode whose bends do not lead to the goal's curvatures, if that is why.
    """

    kind: Literal["corridor", "heater", "camera", "doubt", "near", "body", "task", "lost", "time"]
    text: str
    segment: int = 0
    to: Stiffness = "soft"
    stiff: bool = False
    missed: Mode | None = None


@dataclass(eq=False)
class PlanRunner:
    """One plan on its way; ``follow`` may be called once.

    Attributes:
        session: The run it is a part of; the robot is where the plan starts.
        plan: The plan.
        feedback: What it waits for, and how it is driven.
        patience: How long it waits.
        longest_s: Longest run.
        schedule: The plan's heaters by events.
        clock_s: Time of the plan.
        driven: The phases driven so far.
    """

    session: Session
    plan: Plan
    feedback: ByReports
    patience: Patience
    longest_s: float = math.inf

    def __post_init__(self) -> None:
        self.schedule = HeaterSchedule(self.plan)
        self.clock_s = 0.0
        self.driven: list[Drive] = []
        self._planned = -1.0, np.empty(0)

    @property
    def progress(self) -> Progress:
        """How far the plan has come."""
        return Progress(self.clock_s, len(self.driven))

    @property
    def setpoint_C(self) -> Array:
        """Set-points of the plan now, (n,)."""
        return self.feedback.setpoint_C(self)

    @property
    def planned(self) -> Array:
        """Configuration of the plan now, (3 + n,); asked for several times a period."""
        if self._planned[0] != self.clock_s:
            q = self.plan.trajectory.configuration([self.clock_s])[0]
            self._planned = self.clock_s, q
        return self._planned[1]

    def follow(self) -> Abort | None:
        """Run the plan until everything is as it should be at its end, or it has to be left."""
        session, phases, last = self.session, self.plan.phases, self.schedule.last_mode
        for index, phase in enumerate(phases):
            name = f"phase {index + 1} of {len(phases)} {mode_name(phase.mode)}"
            session.during = f"waiting for {name}"
            if (left := self._arrived(phase.mode, phase.start_s)) is not None:
                return left
            session.during = f"in {name}"
            session.tell("drive", f"{name} begins")
            begun_s = session.now_s
            if (left := self.feedback.drive(self, index)) is not None:
                return left
            self.driven.append(Drive(phase.mode, begun_s, session.now_s))
            self.clock_s = max(self.clock_s, phase.end_s)
            if (left := self.feedback.arrived(self)) is not None:
                return left
        session.during = f"waiting for the end {mode_name(last)}"
        return self._arrived(last, self.plan.trajectory.duration_s)

    def _arrived(self, mode: Mode, until_s: float) -> Abort | None:
        """Wait for what comes next, which may be what completes a task."""
        return self.wait_for(mode, until_s) or self.feedback.arrived(self)

    def wait_for(self, mode: Mode, until_s: float, *, held: Mode | None = None) -> Abort | None:
        """Stand until the feedback lets the robot drive; the plan's clock goes on to ``until_s``.

        Args:
            mode: Mode to drive in.
            until_s: Time of the plan at which it is needed.
            held: Segments to heat whatever the plan says: it has lost them too early.
        """
        session, begun_s = self.session, self.session.now_s
        while (left := self._broken()) is None and not self.feedback.ready(self, mode, until_s):
            if (left := self._late(mode, session.now_s - begun_s)) is not None:
                return left
            before_s, left_s, rest_s = session.now_s, until_s - self.clock_s, self.patience.rest_s
            if left_s > SAME_TIME_S:
                rest_s = min(left_s, rest_s)
            setpoint_C = self.setpoint_C
            if held is not None:
                setpoint_C = np.where(held, self.plan.robot.heater.soft_setpoint_C, setpoint_C)
            session.rest(setpoint_C, rest_s, self.planned)
            self.clock_s = min(self.clock_s + session.now_s - before_s, until_s)
        self.clock_s = until_s
        return left

    def _broken(self) -> Abort | None:
        """A run without end, or a segment that is heated and whose controller has given up."""
        session, soft_C = self.session, self.plan.robot.heater.soft_setpoint_C
        if session.now_s > self.longest_s:
            return Abort("time", f"the run has taken more than {self.longest_s:z.0f} s")
        for segment, faulty in enumerate(session.reading.faulty):
            if faulty and session.setpoint_C[segment] >= soft_C:
                here = f"{session.reading.temperature_C[segment]:z.1f} C: heater or sensor?"
                text = f"segment {segment + 1}: heating does not warm it, {here}"
                return Abort("heater", text, segment)
        return None

    def _late(self, mode: Mode, waited_s: float) -> Abort | None:
        """A segment that should have become what ``mode`` needs long ago."""
        session = self.session
        for segment, (soft, now) in enumerate(zip(mode, session.reading.stiffness, strict=True)):
            to: Stiffness = "soft" if soft else "rigid"
            if to == "rigid":  # by its model's time, and with its cause: see `SegmentWatch`
                continue
            planned_s = self.schedule.expected_s(segment, to)
            latest_s = self.patience.late * max(planned_s, self.patience.least_transition_s)
            asked_s = min(waited_s, session.in_vain_s(segment))
            if now not in (None, to) and asked_s > latest_s:
                known = session.reading.describe(segment)
                text = f"{known}, not {to} after {asked_s:z.0f} s, planned were {planned_s:z.0f} s"
                return Abort("heater", text, segment, to)
        return None


class ByReports:
    """Heaters by events, phases when the reports confirm what they need, wheels as planned.

    A melt is not let begin before the phases are done that need the segment rigid, and a heater
    goes off when the last phase is done that needs the segment soft.
    """

    def setpoint_C(self, run: PlanRunner) -> Array:
        """Set-points of the plan now, (n,)."""
        return run.schedule.setpoints(run.progress)

    def ready(self, run: PlanRunner, mode: Mode, planned_s: float) -> bool:
        """Whether the robot may drive in ``mode``, planned from ``planned_s`` on; early or late."""
        return run.session.mode == mode

    def arrived(self, run: PlanRunner) -> Abort | None:
        """Look whether tasks are done whose time has come, if anything can."""
        return None

    def drive(self, run: PlanRunner, index: int) -> Abort | None:
        """Drive a phase of the plan, and stand while a segment is not as it must be."""
        phase, session = run.plan.phases[index], run.session
        for order in wheel_commands(run.plan.trajectory, phase, session.robot.camera.rate_Hz):
            if (left := run.wait_for(phase.mode, order.start_s, held=phase.mode)) is not None:
                return left
            session.drive(phase.mode, order.wheel_rad_s, run.setpoint_C, run.planned)
            run.clock_s = order.end_s
        return None


class ByClock(ByReports):
    """Heaters and phases at the plan's own times, for a robot that reports nothing."""

    def setpoint_C(self, run: PlanRunner) -> Array:
        """Set-points in force at the plan's time, (n,)."""
        setpoints: Array = run.plan.trajectory.heater_setpoint_C([run.clock_s])[0]
        return setpoints

    def ready(self, run: PlanRunner, mode: Mode, planned_s: float) -> bool:
        """Whether it is time."""
        return run.clock_s >= planned_s - SAME_TIME_S


class WheelCommand(NamedTuple):
    """Wheel speeds [rad/s], (4,), for one period, and the plan's time at its start and end [s]."""

    wheel_rad_s: Array
    start_s: float
    end_s: float


def wheel_commands(trajectory: Trajectory, phase: Phase, rate_Hz: float) -> list[WheelCommand]:
    """Divide a phase into equal parts, one a period of the controller.

    In each period the wheels turn exactly as far as in that part of the phase. A phase that does
    not last a whole number of periods is stretched to the next: the robot follows the same path a
    little slower, never faster.
    """
    count = max(1, math.ceil((phase.end_s - phase.start_s) * rate_Hz - _WHOLE))
    ends = np.linspace(phase.start_s, phase.end_s, count + 1)
    turned = np.diff(trajectory.wheel_travel_rad(ends), axis=0)
    return [
        WheelCommand(turned[k] * rate_Hz, float(ends[k]), float(ends[k + 1])) for k in range(count)
    ]
