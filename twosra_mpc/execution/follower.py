"""Following one plan by events: wait for a mode, drive its phase, look, go on.

The plan's clock stands at a phase's start until the segments are reported to be what the phase
needs, jumps there if they are early, and slows down inside a phase for a robot that lags behind.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.accuracy import Accuracy
from twosra_mpc.execution.heater_schedule import HeaterSchedule, Progress, heater_schedule
from twosra_mpc.execution.pulses import Pulses
from twosra_mpc.execution.remaining import ACCEPTED
from twosra_mpc.execution.session import Session
from twosra_mpc.execution.tracking.outputs import OUTPUTS
from twosra_mpc.execution.tracking.tracker import Measurement, Tracker
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.modes import RIGID, SOFT_BOTH, Mode, mode_name

Array = NDArray[np.float64]

WAIT_S = 1.0  # longest rest between two looks at the heaters
LATE = 3.0  # a transition that takes so many times the planned time has failed
LEAST_TRANSITION_S = 20.0  # what is taken for the planned time, at least
SETTLED, FINEST = 0.3, 3e-5  # of the accuracy: deviation at which a phase may end
LOOSE = 3.0  # headings of soft phases, and poses of phases that are not the last, may be so far off
TUBE = 5.0  # times the accuracy: farther from the plan, the plan's clock slows down
CERTAIN = 0.15  # of the accuracy: standard deviation with which a phase's end is looked at
LOOK_S = 6.0
NEARER = 0.7  # of the deviation before: a phase that comes no nearer ends
DOUBTFUL, CERTAIN_OF_A_MELT, LONG_LOOK_S = 0.3, 0.08, 20.0  # before a melt is decided on
PATIENCE_S = 15.0
CORRIDOR_M, CORRIDOR_RAD = 0.1, 1.0
STIFF_PER_M = 5.0  # no path model is so wrong; metal that is not yet all liquid is


class Departure(NamedTuple):
    """Why a plan cannot be followed to its end.

    Attributes:
        kind: "corridor": the rest of the plan does not lead to the goal from here; "heater": a
            segment did not become what it should; "time": the run takes too long.
        text: The same in words.
        segment: The segment (0, 1) whose heater it is.
        to: What it should have become.
        stiff: Whether a segment that is reported soft seems to need more time.
    """

    kind: Literal["corridor", "heater", "time"]
    text: str
    segment: int = 0
    to: Literal["soft", "rigid"] = "soft"
    stiff: bool = False


class PlanFollower:
    """One plan on its way; ``follow`` may be called once."""

    def __init__(
        self,
        session: Session,
        tracker: Tracker,
        plan: Plan,
        accuracy: Accuracy,
        pulses: Pulses,
        longest_s: float,
    ) -> None:
        """Make ready to follow a plan that starts where the robot is.

        Args:
            session: The run.
            tracker: A tracker of the robot.
            plan: The plan; it must have samples.
            accuracy: How near to the goal is near enough.
            pulses: What is done about the drives' dead zone.
            longest_s: When the run takes too long.
        """
        self.session, self.tracker, self.plan = session, tracker, plan
        self.accuracy, self.pulses, self.longest_s = accuracy, pulses, longest_s
        self.schedule: HeaterSchedule = heater_schedule(plan)
        self._samples = plan.samples
        self._clock_s, self._done = 0.0, 0
        tracker.reset(plan)

    @property
    def begun(self) -> int:
        """How many of the plan's transitions were begun."""
        return self.schedule.begun(self._progress)

    @property
    def setpoint_C(self) -> Array:
        """Set-points of the plan now, (2,)."""
        return self.schedule.setpoints(self._progress)

    @property
    def _progress(self) -> Progress:
        return Progress(self._clock_s, self._done)

    def follow(self) -> Departure | None:
        """Follow the plan until everything is as it should be at its end, or it has to be left."""
        for index, phase in enumerate(self.plan.phases):
            left = self._await(phase.mode, phase.start_s) or self._drive(index)
            if left is not None:
                return left
            self._done, self._clock_s = index + 1, max(self._clock_s, phase.end_s)
        return self._await(self.plan.problem.goal.mode, float(self._samples.t_s[-1]))

    def _await(self, mode: Mode, until_s: float, *, melt: Mode = RIGID) -> Departure | None:
        """Wait until a mode is reported; the plan's clock goes on to ``until_s`` meanwhile.

        Args:
            mode: The mode.
            until_s: Time of the plan at which the mode is needed.
            melt: Segments to melt whatever the plan says: it has lost them too early.
        """
        soft_C = self.plan.robot.heater.soft_setpoint_C
        while self.session.mode != mode:
            if (failure := self._failure(mode)) is not None:
                return failure
            before_s = self.session.now_s
            setpoint_C = np.where(melt, soft_C, self.setpoint_C)
            self.session.rest(setpoint_C, WAIT_S, self._planned())
            self._clock_s = min(self._clock_s + self.session.now_s - before_s, until_s)
        self._clock_s = until_s
        return None

    def _failure(self, mode: Mode) -> Departure | None:
        """A segment that should have become what ``mode`` needs long ago, or a run without end."""
        session, heater = self.session, self.plan.robot.heater
        if session.now_s > self.longest_s:
            return Departure("time", f"the run has taken more than {self.longest_s:.0f} s")
        for segment in (0, 1):
            to: Literal["soft", "rigid"] = "soft" if mode[segment] else "rigid"
            if session.reading.stiffness[segment] == to:
                continue
            name = f"segment {segment + 1}"
            if session.reading.faulty[segment]:
                text = f"the controller of {name} reports a fault of its heater or sensor"
                return Departure("heater", text, segment, to)
            setpoint_C = heater.soft_setpoint_C if to == "soft" else heater.rigid_setpoint_C
            asked_s = session.asked_for_s(segment)
            expected_s = max(self.schedule.expected_s(segment, to), LEAST_TRANSITION_S)
            if session.setpoint_C[segment] == setpoint_C and asked_s > LATE * expected_s:
                text = f"{name} is not {to} after {asked_s:.0f} s, planned were {expected_s:.0f} s"
                return Departure("heater", text, segment, to)
        return None

    def _drive(self, index: int) -> Departure | None:
        """Drive a phase, and again while looks say that it comes nearer to where it should be."""
        phase = self.plan.phases[index]
        text = f"phase {index + 1} of {len(self.plan.phases)} begins, {mode_name(phase.mode)}"
        self.session.tell("drive", text)
        before = off = math.inf
        while off > self._settled(index) and off <= NEARER * before:
            left = self._travel(index)
            if left is not None:
                return left
            self._look(index)
            before, off = off, self._off(index)
        return None if phase.mode == RIGID else self._judge(index)

    def _travel(self, index: int) -> Departure | None:
        """Track a phase until it ends where it should, or comes no nearer."""
        session, phase = self.session, self.plan.phases[index]
        until_s = session.now_s + PATIENCE_S
        while session.now_s < until_s:
            left = self._await(phase.mode, self._clock_s, melt=phase.mode)
            if left is not None:
                return left
            planned, off, over = self._planned(), self._off(index), self._clock_s >= phase.end_s
            if over and off <= self._settled(index):
                return None
            if (left := self._outside(phase.mode, planned)) is not None:
                return left
            time_s = self._clock_s + (session.period_s if over else 0.0)  # then the path rests
            command = self.tracker.step(Measurement(time_s, index, session.q))
            wheels = self.pulses.shape(command.wheel_rad_s)
            session.drive(phase.mode, wheels, self.setpoint_C, planned)
            if not over:
                pace = min(1.0, TUBE / off) if off else 1.0
                self._clock_s = min(self._clock_s + pace * session.period_s, phase.end_s)
                until_s = session.now_s + PATIENCE_S
        return None

    def _look(self, index: int) -> None:
        """Average camera frames at rest, where the end of a phase matters for the goal."""
        scale = CERTAIN * self.accuracy.scale
        if self.plan.phases[index].mode == RIGID:
            if not self._last(index):
                return
        else:
            scale[:3] = math.inf  # poses are corrected when everything is solid
        self.session.average(self.setpoint_C, scale, LOOK_S)

    def _last(self, index: int) -> bool:
        return index == len(self.plan.phases) - 1

    def _planned(self) -> Array:
        """Configuration of the plan now, (5,)."""
        samples, clock_s = self._samples, self._clock_s
        return np.array([np.interp(clock_s, samples.t_s, column) for column in samples.q.T])

    def _off(self, index: int) -> float:
        """Deviation of what the phase controls from the plan, in units of the accuracy."""
        return float(np.abs(self._outputs(index, self.session.q - self._planned())).max())

    def _settled(self, index: int) -> float:
        """Deviation at which a phase may end: no finer than what is believed is certain."""
        certain = 2 * float(np.abs(self._outputs(index, self.session.deviation)).max())
        loose = self.plan.phases[index].mode == RIGID and not self._last(index)
        return min(SETTLED * (LOOSE if loose else 1.0), max(certain, FINEST))

    def _outputs(self, index: int, difference: Array) -> Array:
        """Outputs of a phase's mode of a difference of q, in units of the accuracy."""
        mode = self.plan.phases[index].mode
        outputs, scale = OUTPUTS[mode], self.accuracy.scale
        turned = difference.copy()
        turned[2] = math.remainder(turned[2], math.tau)
        if mode != RIGID:
            scale[2] *= LOOSE
        shares: Array = (outputs.selection @ turned) / (outputs.selection @ scale)
        return shares

    def _outside(self, mode: Mode, planned: Array) -> Departure | None:
        """Whether the robot has left the corridor around the plan."""
        away = self.session.q - planned
        turn = math.remainder(float(away[2]), math.tau)
        if math.hypot(away[0], away[1]) > CORRIDOR_M or abs(turn) > CORRIDOR_RAD:
            far = f"{1e3 * math.hypot(away[0], away[1]):.0f} mm and {abs(turn):.2f} rad"
            unbent = np.abs(away[3:]) * mode > STIFF_PER_M
            return Departure(
                "corridor", f"the robot is {far} from the plan", stiff=bool(unbent.any())
            )
        apart = abs(float(away[3] - away[4])) / 2
        if mode == SOFT_BOTH and apart > STIFF_PER_M:
            text = f"the segments bend unequally, by {apart:.1f} 1/m more and less than planned"
            return Departure("corridor", text, stiff=True)
        return None

    def _judge(self, index: int) -> Departure | None:
        """Whether the phases to come lead to the goal's curvatures from here, as they are."""
        missed = self._predicted_miss(index)
        if abs(self.accuracy.of_shape(missed) - ACCEPTED) < DOUBTFUL:
            scale = np.full(5, math.inf)
            scale[3:] = CERTAIN_OF_A_MELT * self.accuracy.curvature_per_m
            self.session.average(self.setpoint_C, scale, LONG_LOOK_S)
            missed = self._predicted_miss(index)
        if self.accuracy.of_shape(missed) <= ACCEPTED:
            return None
        text = f"the plan would miss the curvatures by {missed[3]:+.1f} and {missed[4]:+.1f} 1/m"
        return Departure("corridor", text, stiff=bool(np.abs(missed[3:]).max() > STIFF_PER_M))

    def _predicted_miss(self, index: int) -> Array:
        """Distance to the goal, (5,), if the phases after this one are driven as they are."""
        end = self._samples.q[-1]
        first, second = (self.session.q - self._planned())[3:].tolist()
        for phase in self.plan.phases[index + 1 :]:
            match phase.mode:
                case (1, 0):
                    first = 0.0
                case (0, 1):
                    second = 0.0
                case (1, 1):
                    first, second = (first - second) / 2, (second - first) / 2
        return self.plan.problem.goal.error(np.array([*end[:3], end[3] + first, end[4] + second]))
