"""Running a plan by a camera: phases are tracked, looked at when they end, and judged.

Whatever can be corrected later is left; what cannot, because a segment would have to melt again, is
predicted, and the plan is given up as soon as that is certain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twosra_mpc.execution.doubt import DoubtError
from twosra_mpc.execution.mission import Mission
from twosra_mpc.execution.runner import Abort, ByReports, PlanRunner
from twosra_mpc.execution.tracking.setup import outputs_of
from twosra_mpc.execution.tracking.tracker import Measurement, Tracker
from twosra_mpc.model.bending import bending
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.accuracy import ACCEPTED
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

_ABOVE = 1.5  # times the dead zone: so that the slower wheels of a motion turn as well
_STIFF = 0.7  # of the bend: soft segments differ by up to 0.44 of it, a stiff one by all of it
_HALVINGS = 60  # of an interval of deviations, down to rounding


class Pulses:
    """Passes fast commands on, and adds slow ones up until they are worth a pulse."""

    def __init__(self, dead_zone_rad_s: float) -> None:
        """Start with nothing left over from before."""
        self._least, self._owed = _ABOVE * dead_zone_rad_s, 0.0

    def shape(self, wheel_rad_s: Array) -> Array:
        """Return what to send for a command of the wheels (4,) in this period, as on average."""
        fastest = float(np.abs(wheel_rad_s).max())
        if fastest >= self._least or fastest == 0.0:
            self._owed = 0.0
            return wheel_rad_s
        self._owed += fastest / self._least
        if self._owed < 1.0:
            return np.zeros(4)
        self._owed -= 1.0
        return wheel_rad_s * (self._least / fastest)

    def brisk(self, wheel_rad_s: Array) -> Array:
        """Return a command of the wheels (4,) at the speed at which they surely turn, at least."""
        fastest = float(np.abs(wheel_rad_s).max())
        return wheel_rad_s * max(1.0, self._least / fastest) if fastest else wheel_rad_s


class ByCamera(ByReports):
    """Heaters and phases as by reports; the wheels by what the camera sees."""

    def __init__(self, plan: Plan, tracker: Tracker, pulses: Pulses, mission: Mission) -> None:
        """Make ready to run a plan.

        Args:
            plan: The plan.
            tracker: A tracker of its robot.
            pulses: What is done about the drives' dead zone.
            mission: Judges its tasks.
        """
        self.tracker, self.pulses, self.mission = tracker, pulses, mission
        tracker.reset(plan)

    def arrived(self, run: PlanRunner) -> Abort | None:
        """Look whether the tasks are done whose time has come."""
        return self.mission.arrived(run.clock_s)

    def drive(self, run: PlanRunner, index: int) -> Abort | None:
        """Drive a phase, and again while looks say that it comes nearer to where it should be."""
        return _TrackedPhase(self, run, index).drive()


class _TrackedPhase:
    """One phase on its way."""

    def __init__(self, by: ByCamera, run: PlanRunner, index: int) -> None:
        self.by, self.run, self.index = by, run, index
        self.session, self.patience = run.session, run.patience
        self.phase, self.mission = run.plan.phases[index], by.mission
        self.rigid = is_rigid(self.phase.mode)
        self.bends, self.last = self._goes_on()
        modes = [phase.mode for phase in run.plan.phases[index:]]
        self.soft, self.settling = list(soft_segments(self.phase.mode)), settling(modes)
        self.scale = self.session.accuracy.scale(run.plan.robot.coordinates)
        self.begun = run.session.q.copy()

    def _goes_on(self) -> tuple[bool, bool]:
        """True if a mission goes on to bend, and nothing later makes good what is missed.

        So it is before a bend, where a task is done, and at the end.
        """
        phases = self.run.plan.phases
        if self.index == len(phases) - 1:
            return False, True
        after = phases[self.index + 1]
        bends = self.mission.rests and self.rigid and not is_rigid(after.mode)
        return bends, bends or self.mission.ends_between(self.phase.start_s, after.start_s)

    def drive(self) -> Abort | None:
        before = off = math.inf
        while off > self._near_enough() and off <= self.patience.nearer * before:
            if (left := self._travel()) is not None:
                return left
            self._look()
            before, off = off, self._off()
        if not self.rigid:
            return self._judge()
        away = self.session.q - self.run.planned
        away[2] = math.remainder(float(away[2]), math.tau)
        off = self.session.accuracy.of_pose(away)
        if self.bends and off > 1.0:
            return Abort("corridor", "the robot is not where it is to bend")
        return None

    def _travel(self) -> Abort | None:
        """Track the phase until it ends where it should, or comes no nearer."""
        run, session, phase = self.run, self.session, self.phase
        left_s, best = self.patience.come_nearer_s, math.inf  # of driving: looks do not count
        while left_s > 0.0:
            if (left := run.wait_for(phase.mode, run.clock_s, held=phase.mode)) is not None:
                return left
            if (left := self._unseen()) is not None:
                return left
            planned, off, over = run.planned, self._off(), run.clock_s >= phase.end_s
            if over and off <= self._near_enough():
                return None
            if (left := self._outside(planned)) is not None:
                return left
            if (left := self.mission.dropped()) is not None:
                return left
            time_s = run.clock_s + (session.period_s if over else 0.0)  # then the path rests
            command = self.by.tracker.step(Measurement(time_s, self.index, self._seen))
            # All time that passes until bends are right is time that metal does not freeze.
            shape = self.by.pulses.brisk if over and not self.rigid else self.by.pulses.shape
            wheels = shape(command.wheel_rad_s)
            try:
                session.drive(phase.mode, wheels, run.setpoint_C, planned)
            except DoubtError:
                if self.rigid or not self.mission.closes:
                    raise
                return None  # what it closes round may keep it from bending
            if not over:
                pace = min(1.0, self.patience.tube / off) if off else 1.0
                run.clock_s = min(run.clock_s + pace * session.period_s, phase.end_s)
            left_s -= session.period_s
            if not over or off < self.patience.stuck * best:
                left_s, best = self.patience.come_nearer_s, off
        return None

    def _unseen(self) -> Abort | None:
        """Stand while nothing sees the robot, but not for long."""
        session = self.session
        if session.seen(self.run.setpoint_C, self.run.planned):
            return None
        return Abort("camera", session.unseen)

    def _look(self) -> None:
        """Average camera frames at rest, where the end of the phase matters for the goal."""
        scale = self.patience.certain * self.scale
        if not self.rigid:
            scale[:POSE] = math.inf  # poses are corrected when everything is solid
        if self.last or not self.rigid:
            self.session.average(self.run.setpoint_C, scale, self.patience.look_s)

    @property
    def _seen(self) -> Array:
        """Configuration as seen, (3 + n,), its soft segments as far off as those that settle now.

        The units bend all soft segments at once, so one number can be brought to the plan's: what
        others miss is made good in the later phases in which they are soft.
        """
        q = self.session.q.copy()
        if not self.rigid:
            away = (q - self.run.planned)[POSE:]
            q[POSE:][self.soft] += away[self.settling].mean() - away[self.soft].mean()
        return q

    def _off(self) -> float:
        """Deviation of what the phase controls from the plan, in units of the accuracy."""
        return float(np.abs(self._outputs(self._seen - self.run.planned)).max())

    def _near_enough(self) -> float:
        """Deviation at which the phase may end: no finer than what is believed is certain."""
        patience = self.patience
        certain = 2 * float(np.abs(self._outputs(self.session.deviation)).max())
        loose = patience.loose if self.rigid and not self.last else 1.0
        return min(patience.near_enough * loose, max(certain, patience.finest))

    def _outputs(self, difference: Array) -> Array:
        """Outputs that the phase is judged by, of a difference of q, in units of the accuracy.

        The pose in a rigid phase; in a soft one the mean of the bends alone: how far the units are
        dragged while they bend is not known, and a rigid drive corrects the pose.
        """
        selection, turned = outputs_of(self.phase.mode).selection, difference.copy()
        turned[2] = math.remainder(turned[2], math.tau)
        shares: Array = (selection @ turned) / (selection @ self.scale)
        return shares if self.rigid else shares[-1:]

    def _outside(self, planned: Array) -> Abort | None:
        """True if a rigid robot has left the corridor, or soft segments have bent apart."""
        session, patience = self.session, self.patience
        away, soft = session.q - planned, self.soft
        turn, far_m = math.remainder(float(away[2]), math.tau), math.hypot(away[0], away[1])
        lost = far_m > patience.corridor_m or abs(turn) > patience.corridor_rad
        if session.guard is not None:
            lost = session.guard.off_m(np.array([*away[:2], turn, *away[3:]])) > patience.narrow_m
        if self.rigid and lost:
            text = f"the robot is {1e3 * far_m:z.0f} mm and {abs(turn):z.2f} rad from the plan"
            return Abort("corridor", text)
        if not soft:
            return None
        apart = float(np.ptp(away[POSE:][soft])) / 2
        bent = abs(float((session.q - self.begun)[POSE:][soft].mean()))
        if apart > max(patience.stiff_per_m, _STIFF * bent):
            text = f"the segments bend unequally, by {apart:z.1f} 1/m more and less than planned"
            return Abort("corridor", text, stiff=True, missed=self.phase.mode)
        return None

    def _judge(self) -> Abort | None:
        """True if the phases to come lead to the goal's curvatures from here, as they are."""
        if self.mission.closes:
            return None
        patience, accuracy = self.patience, self.session.accuracy
        missed = self._predicted_miss()
        if abs(accuracy.of_shape(missed) - ACCEPTED) < patience.doubtful:
            scale = patience.certain_of_a_melt * self.scale
            scale[:POSE] = math.inf
            self.session.average(self.run.setpoint_C, scale, patience.long_look_s)
            missed = self._predicted_miss()
        if accuracy.of_shape(missed) <= ACCEPTED:
            return None
        bends = " and ".join(f"{kappa:+z.1f}" for kappa in missed[POSE:].tolist())
        far = bool(np.abs(missed[POSE:]).max() > patience.stiff_per_m)
        stiff = far and not self.session.each_bends
        text = f"the plan would miss the curvatures by {bends} 1/m"
        return Abort("corridor", text, stiff=stiff, missed=self.phase.mode)

    def _predicted_miss(self) -> Array:
        """Distance to the goal, (3 + n,), if the phases after this one are driven as they are."""
        plan, until_s = self.run.plan, self.mission.matters_s
        rest = [phase for phase in plan.phases[self.index + 1 :] if phase.end_s <= until_s]
        times = [self.run.clock_s, *(item.end_s for item in rest)]
        path, modes = plan.trajectory.configuration(times), [item.mode for item in rest]
        kappa = predicted_curvatures(plan.robot, self.session.q, list(path), modes)
        if math.isfinite(until_s):
            return np.concatenate([np.zeros(POSE), kappa - path[-1, POSE:]])
        return self.session.goal.error(np.concatenate([path[-1, :POSE], kappa]))


def settling(modes: Sequence[Mode]) -> list[int]:
    """Segments (from 0) that are soft in the first of these phases for the last time, or all soft.

    They are what it must bring to the plan's curvatures.
    """
    soft = list(soft_segments(modes[0]))
    return [j for j in soft if not any(later[j] for later in modes[1:])] or soft


def predicted_curvatures(
    robot: Robot, deviated: Array, path: Sequence[Array], modes: Sequence[Mode]
) -> Array:
    """Curvatures at the end of a plan whose next phases are driven as they are, (n,) [1/m].

    The locomotion units bend all soft segments at once, each by the same change of its bending
    coordinate W. So in every phase the deviations of W of the soft segments are shifted by one
    number, and the tracker chooses it: it brings the mean curvature of those that settle to the
    plan's.

    Args:
        robot: The robot.
        deviated: Configuration now, (3 + n,).
        path: Configurations of the plan now and at the end of each of the phases.
        modes: Modes of these phases.
    """
    model = bending(robot)

    def coordinates(q: Array) -> Array:
        return np.array([model.coordinate(kappa) for kappa in q[POSE:].tolist()])

    deviation = coordinates(deviated) - coordinates(path[0])
    for k, (end, mode) in enumerate(zip(path[1:], modes, strict=True)):
        if soft := list(soft_segments(mode)):
            planned, last = coordinates(end)[soft], settling(modes[k:])
            counted = [soft.index(j) for j in last]
            low, high = -deviation[soft].max(), -deviation[soft].min()
            for _ in range(_HALVINGS):
                shift = (low + high) / 2
                bent = model.curvature(planned + deviation[soft] + shift)
                less = bent[counted].mean() < end[POSE:][last].mean()
                low, high = (shift, high) if less else (low, shift)
            deviation[soft] += shift
    return model.curvature(coordinates(path[-1]) + deviation)
