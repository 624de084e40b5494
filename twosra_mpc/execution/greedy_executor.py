"""The greedy rule in closed loop, as its authors ran it: chosen anew at every measurement.

Each allowed mode proposes to remove as much of the error as its Jacobian can; the mode whose
proposal ends nearest the goal (unweighted norm, as published) is taken and kept until it no longer
moves the robot. A change of mode waits until the segments have changed. Three things are added,
without which noise would keep it switching for ever: errors within a part of the accuracy count as
none, modes that would not move the robot are not chosen, and before another mode is chosen the
resting robot is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.execution.camera_feedback import Pulses
from twosra_mpc.execution.doubt import DoubtError
from twosra_mpc.execution.guard import TooNearError, guard_of
from twosra_mpc.execution.robot_interface import RobotInterface, stopped_after
from twosra_mpc.execution.run import Ending, Run, Verdict
from twosra_mpc.execution.segment_watch import SegmentError
from twosra_mpc.execution.session import Session
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.interrupts import Interrupts
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, mode_name

GAIN = 0.25  # of the proposal per measurement: the authors' gain on the robot
LEFT, KEPT = 0.3, 0.65  # of the accuracy: errors that a mode leaves, and that need no other mode
AWAY_M = 30.0  # a drive that leads so much farther leads nowhere; from 13 m some have come back
STAGNATED = 0.02  # of the accuracy: a mode that moves less per measurement is done


@dataclass(frozen=True)
class GreedyExecutor:
    """Drives a robot to a goal by the greedy rule alone; there is no plan."""

    robot: RobotInterface
    settings: ExecutorSettings = field(default_factory=ExecutorSettings)

    def run(self, problem: Problem) -> Run:
        """Drive to the goal; the robot must be where the problem starts. At the end it is off.

        Raises:
            RobotError: If the robot cannot be driven any more.
            InputError: If the robot has more or fewer segments than the rule knows, or there are
                tasks.
        """
        if problem.robot.coordinates.segments != 2:
            raise InputError("executor", "greedy", "optimal: the greedy rule knows two segments")
        if problem.tasks:
            raise InputError("executor", "greedy", "optimal: the greedy rule knows no tasks")
        patience = self.settings.patience

        def drive(interrupts: Interrupts) -> Run:
            guard = guard_of(problem, patience)
            session = Session(
                self.robot, problem, lambda _: interrupts.check(), guard, patience=patience
            )
            ending, reason = _GreedyRun(session, self.settings).run()
            return session.finish(Verdict("greedy", ending, reason))

        return stopped_after(self.robot, drive)


class _GreedyRun:
    """One run of the greedy executor."""

    def __init__(self, session: Session, settings: ExecutorSettings) -> None:
        self.session, self.settings, self.problem = session, settings, session.problem
        self.accuracy = session.accuracy
        self.scale = self.accuracy.scale(self.problem.robot.coordinates)
        self.pulses = Pulses(settings.dead_zone_rad_s)
        self.modes = list(self.problem.modes)
        self.broken: list[int] = []
        self.doubted = 0
        self.stalled: Mode | None = None

    def run(self) -> tuple[Ending, str]:
        """Drive until there is an ending, without segments that cannot be heated."""
        lost: SegmentError | None = None
        while True:
            try:
                if lost is not None:
                    self._lost(lost.segment, "soft")
                return self._driven()
            except SegmentError as trouble:  # the other one's, perhaps, while the first is given up
                if trouble.cause != "heater" or trouble.segment + 1 in self.broken:
                    return trouble.ending, str(trouble)
                lost = trouble
            except DoubtError as doubt:
                if doubt.stalled:
                    self.stalled = self.session.drives[-1].mode
                    self.session.tell("look", str(doubt))
                    continue
                self.doubted += 1
                if doubt.bends and not doubt.final and self.doubted <= self.settings.doubts:
                    self._melt_on(str(doubt))
                    continue
                return Ending.SENSOR_FAILED if doubt.bends else Ending.NOT_MOVING, str(doubt)
            except TooNearError as near:
                where = self.accuracy.describe(self.session.error)
                return Ending.TOO_NEAR, f"{near}; {where}"

    def _melt_on(self, why: str) -> None:
        """Hold the segments as they are for a while: one may be soft later than its sensor says."""
        session, patience = self.session, self.settings.patience
        session.tell("failure", why)
        end_s = session.now_s + patience.melt_on_s
        while session.now_s < end_s:
            session.rest(session.setpoint_C, patience.rest_s)

    def _driven(self) -> tuple[Ending, str]:
        """Choose modes and drive in them until there is an ending."""
        session, settings = self.session, self.settings
        while session.now_s < settings.longest_s:
            certain, look_s = settings.patience.certain, settings.patience.look_s
            session.average(session.setpoint_C, certain * self.scale, look_s)
            where = self.accuracy.describe(session.error)
            if session.unseen_s > settings.patience.unseen_s:
                return session.ending_unseen(left=False)
            failed = [j for j in self.broken if self.problem.goal.mode[j - 1]]
            if failed:
                return Ending.HEATER_FAILED, f"{where}; heater {failed[0]} failed, and is needed"
            if self.accuracy.surely(session.error) and self._ended():
                return self._reached(f"the goal is reached: {where}")
            mode = self._choice()
            if mode is None and self.accuracy.of(session.error) <= 1.0:
                if self._ended():
                    return self._reached(f"no mode comes nearer, which is near enough: {where}")
                continue
            if mode is None:
                lost = f"; heater {', '.join(map(str, self.broken))} failed" if self.broken else ""
                kind = Ending.HEATER_FAILED if self.broken else Ending.GAVE_UP
                return kind, f"{where}; no mode comes nearer{lost}"
            if self._changed_to(mode):
                self.stalled = None
                session.tell("drive", f"driven in mode {mode_name(mode)}")
                if not self._drive(mode):
                    where = self.accuracy.describe(session.error)
                    return (
                        Ending.GAVE_UP,
                        f"{where}; mode {mode_name(mode)} leads away from the goal",
                    )
        return Ending.TIME_LIMIT, f"the run has taken more than {settings.longest_s:z.0f} s"

    def _reached(self, text: str) -> tuple[Ending, str]:
        if self.session.sure(self.scale):
            return Ending.REACHED, text
        return self.session.ending_unseen(left=False)

    def _ended(self) -> bool:
        """Whether the robot is still at the goal once it is as stiff as it should be."""
        if self.session.mode == self.problem.goal.mode:
            return True
        self._changed_to(self.problem.goal.mode)
        return False

    def _choice(self) -> Mode | None:
        """Mode that comes nearest to the goal; None if none moves any more."""
        error = self._error(KEPT)
        left = {}
        for mode in self.modes:
            if mode == self.stalled:
                continue
            moved = GAIN * self._proposal(mode, error)[1]
            if not self._stagnated(moved):
                left[mode] = float(np.linalg.norm(error + moved))
        return min(left, key=lambda mode: left[mode], default=None)

    def _drive(self, mode: Mode) -> bool:
        """Move in a mode until it no longer moves the robot, or is lost; False if it goes away."""
        session, robot = self.session, self.problem.robot
        farthest_m = float(np.hypot(*session.error[:2])) + AWAY_M
        while session.mode == mode and session.now_s < self.settings.longest_s:
            if not session.seen(session.setpoint_C):
                break
            step, moved = self._proposal(mode, self._error(LEFT))
            if self._stagnated(GAIN * moved):
                break
            v = GAIN * step / session.period_s
            wheels = kinematics(robot).wheel_matrix(session.q, mode).full() @ v
            most, limits = float(np.abs(wheels).max()), robot.limits
            slower = max(1.0, most / limits.wheel_speed_rad_s)
            slower = max(slower, float(np.abs(v[:2]).max()) / limits.unit_speed_m_s)
            session.drive(mode, self.pulses.shape(wheels / slower), session.setpoint_C)
            if np.hypot(*session.error[:2]) > farthest_m:
                return False
        return True

    def _proposal(self, mode: Mode, error: Array) -> tuple[Array, Array]:
        """Input displacement with which a mode removes most of the error, and what it moves."""
        jacobian = kinematics(self.problem.robot).jacobian(self.session.q, mode).full()
        columns = slice(0, 2) if any(mode) else slice(2, 5)
        step = np.zeros(5)
        step[columns] = -(np.linalg.pinv(jacobian[:, columns]) @ error)
        return step, jacobian @ step

    def _error(self, share: float) -> Array:
        """Error that counts, (5,): what is beyond this share of the accuracy."""
        error = self.session.error
        counted = np.maximum(np.abs(error) - share * self.scale, 0.0)
        signed: Array = np.sign(error) * counted
        return signed

    def _stagnated(self, moved: Array) -> bool:
        return bool(np.abs(moved / self.scale).max() < STAGNATED)

    def _changed_to(self, mode: Mode) -> bool:
        """Wait for a mode; False if a heater fails meanwhile, or time is up."""
        session, heater = self.session, self.problem.robot.heater
        setpoint_C = np.where(mode, heater.soft_setpoint_C, heater.rigid_setpoint_C)
        while session.mode != mode and session.now_s < self.settings.longest_s:
            session.rest(setpoint_C, self.settings.patience.rest_s)
            for segment in (0, 1):  # one that is slow: see `SegmentWatch`
                to = "soft" if mode[segment] else "rigid"
                known = session.reading
                if known.stiffness[segment] != to and known.faulty[segment]:
                    return self._lost(segment, to)
        return session.mode == mode

    def _lost(self, segment: int, to: str) -> bool:
        """Go on without the modes in which this segment is soft."""
        self.session.tell("failure", f"segment {segment + 1} does not become {to}")
        if segment + 1 not in self.broken:
            self.broken.append(segment + 1)
        self.modes = [mode for mode in self.modes if not mode[segment]]
        setpoint_C = self.session.setpoint_C.copy()
        for each in self.broken:
            setpoint_C[each - 1] = self.problem.robot.heater.rigid_setpoint_C
        self.session.rest(setpoint_C, self.session.period_s)
        return False
