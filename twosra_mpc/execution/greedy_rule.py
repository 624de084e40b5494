"""The greedy rule in closed loop, as its authors ran it: chosen anew at every measurement.

Each allowed mode proposes to remove as much of the error as its Jacobian can; the mode whose
proposal ends nearest the goal (unweighted norm, as published) is taken and kept until it no longer
moves the robot. A change of mode waits until the segments have changed. Three things are added,
without which noise would keep it switching for ever: errors within a part of the accuracy count as
none, modes that would not move the robot are not chosen, and before another mode is chosen the
resting robot is looked at.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import Activity, Next, Trouble, look_at_robot, rest
from twosra_mpc.execution.doubt import DoubtError
from twosra_mpc.execution.driving import Pulses
from twosra_mpc.execution.robot_interface import Command
from twosra_mpc.execution.run import Ending, Verdict
from twosra_mpc.execution.segment_watch import SegmentError
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.greedy import proposal
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, mode_name

GAIN = 0.25  # of the proposal per measurement: the authors' gain on the robot
LEFT, KEPT = 0.3, 0.65  # of the accuracy: errors that a mode leaves, and that need no other mode
AWAY_M = 30.0  # a drive that leads so much farther leads nowhere; from 13 m some have come back
STAGNATED = 0.02  # of the accuracy: a mode that moves less per measurement is done


class Greedy:
    """A policy: the greedy rule.

    Attributes:
        during: What the run is at, in words.
    """

    def __init__(self, belief: Belief, settings: ExecutorSettings) -> None:
        """The robot is where the problem starts."""
        self.belief, self.settings, self._problem = belief, settings, belief.problem
        self._scale = belief.accuracy.scale(self._problem.robot.coordinates)
        self.pulses = Pulses(settings.dead_zone_rad_s)
        self._modes, self._broken = list(self._problem.modes), list[int]()
        self._doubted, self.longest_s = 0, settings.longest_s
        self._stalled: Mode | None = None
        self.during = "before the first mode"

    def begin(self) -> Activity:
        """Look before a mode is chosen."""
        return look_at_robot(self.belief, self._chosen)

    def _chosen(self) -> Next:
        """Choose a mode, or end."""
        belief, where = self.belief, self.belief.where
        if belief.unseen_s > self.belief.patience.unseen_s:
            return self.verdict(*belief.ending_unseen(left=False))
        failed = [j for j in self._broken if self._problem.goal.mode[j - 1]]
        if failed:
            words = f"{where}; heater {failed[0]} failed, and is needed"
            return self.verdict(Ending.HEATER_FAILED, words)
        if belief.accuracy.surely(belief.error):
            return self._arrived(f"the goal is reached: {where}")
        mode = self._choice()
        if mode is not None:
            return Changing(self, mode, _Drive(self, mode).begun)
        if belief.accuracy.of(belief.error) <= 1.0:
            return self._arrived(f"no mode comes nearer, which is near enough: {where}")
        lost = f"; heater {', '.join(map(str, self._broken))} failed" if self._broken else ""
        kind = Ending.HEATER_FAILED if self._broken else Ending.GAVE_UP
        return self.verdict(kind, f"{where}; no mode comes nearer{lost}")

    def _arrived(self, text: str) -> Next:
        """End, if the robot is as stiff as it should be; else become so, and look again."""
        if self.belief.mode != self._problem.goal.mode:
            return Changing(self, self._problem.goal.mode, self.begin)
        if self.belief.sure(self._scale):
            return self.verdict(Ending.REACHED, text)
        return self.verdict(*self.belief.ending_unseen(left=False))

    def _choice(self) -> Mode | None:
        """Mode that comes nearest to the goal; None if none moves any more."""
        error = self.error(KEPT)
        left = {}
        for mode in self._modes:
            if mode == self._stalled:
                continue
            moved = GAIN * proposal(self._problem.robot, self.belief.q, error, mode)[1]
            if not self.stagnated(moved):
                left[mode] = float(np.linalg.norm(error + moved))
        return min(left, key=lambda mode: left[mode], default=None)

    def began(self, mode: Mode) -> None:
        """A mode is driven in: another may be tried again afterwards."""
        self._stalled, self.during = None, f"driven in mode {mode_name(mode)}"
        self.belief.tell("drive", self.during)

    def error(self, share: float) -> Array:
        """Error that counts, (5,): what is beyond this share of the accuracy."""
        error = self.belief.error
        counted = np.maximum(np.abs(error) - share * self._scale, 0.0)
        return np.sign(error) * counted

    def stagnated(self, moved: Array) -> bool:
        """True if a motion (5,) is none."""
        return bool(np.abs(moved / self._scale).max() < STAGNATED)

    def setpoint_C(self, mode: Mode) -> Array:
        """Set-points with which the robot gets into a mode, (n,)."""
        heater = self._problem.robot.heater
        works = [j + 1 not in self._broken for j in range(len(mode))]
        wanted: Array = np.logical_and(mode, works)
        return np.where(wanted, heater.soft_setpoint_C, heater.rigid_setpoint_C)

    def troubled(self, trouble: Trouble) -> Next:
        """Go on after a trouble, or end."""
        belief = self.belief
        if isinstance(trouble, SegmentError):
            if trouble.cause != "heater" or trouble.segment + 1 in self._broken:
                return self.verdict(trouble.ending, str(trouble))
            return self._lost(trouble.segment)
        if not isinstance(trouble, DoubtError):
            return self.verdict(Ending.TOO_NEAR, f"{trouble}; {belief.where}")
        if trouble.stalled and not trouble.final:
            self._stalled = belief.drives[-1].mode
            belief.tell("look", str(trouble))
            return Standing(self, 0.0)
        self._doubted += 1
        if trouble.bends and not trouble.final and self._doubted <= self.settings.doubts:
            belief.tell("failure", str(trouble))  # one may be soft later than its sensor says
            return Standing(self, self.belief.patience.melt_on_s)
        ending = Ending.SENSOR_FAILED if trouble.bends else Ending.NOT_MOVING
        return self.verdict(ending, str(trouble))

    def verdict(self, ending: Ending, reason: str) -> Verdict:
        """An ending of the run."""
        return Verdict("greedy", ending, reason)

    def _lost(self, segment: int) -> Activity:
        """Go on without the modes in which this segment is soft."""
        self.belief.tell("failure", f"segment {segment + 1} does not become soft")
        if segment + 1 not in self._broken:
            self._broken.append(segment + 1)
        self._modes = [mode for mode in self._modes if not mode[segment]]
        return Standing(self, 0.0)


class Standing:
    """A robot that stands for a time, at least until the next reading; its metal is held."""

    def __init__(self, run: Greedy, duration_s: float) -> None:
        """Stand from now on."""
        self._run, self._end_s, self._told = run, run.belief.now_s + duration_s, False

    def advance(self) -> Next:
        """Stand; then look."""
        belief, run = self._run.belief, self._run
        if self._told and belief.now_s >= self._end_s:
            return run.begin()
        self._told = True
        soft = belief.setpoint_C >= belief.problem.robot.heater.soft_setpoint_C
        held_C = run.setpoint_C(tuple(soft.astype(int).tolist()))
        return rest(belief, held_C, belief.patience.rest_s)


class Changing:
    """A robot that stands until it is in a mode."""

    def __init__(self, run: Greedy, mode: Mode, then: Callable[[], Next]) -> None:
        """Heat what is to be soft."""
        self._run, self._mode, self._then = run, mode, then
        run.during = f"waiting for mode {mode_name(mode)}"

    def advance(self) -> Next:
        """Stand, or go on."""
        run, belief = self._run, self._run.belief
        if belief.mode == self._mode:
            return self._then()
        return rest(belief, run.setpoint_C(self._mode), belief.patience.rest_s)


class _Drive:
    """A drive in a mode, until it no longer moves the robot, or is lost."""

    def __init__(self, run: Greedy, mode: Mode) -> None:
        self._run, self._mode = run, mode
        self._farthest_m = np.inf

    def begun(self) -> Next:
        """The robot is in the mode."""
        self._run.began(self._mode)
        if (guard := self._run.belief.guard) is not None:
            guard.begin(self._run.belief.q)
        self._farthest_m = float(np.hypot(*self._run.belief.error[:2])) + AWAY_M
        return self

    def advance(self) -> Next:
        """Drive for a period, or choose again."""
        run, belief, mode = self._run, self._run.belief, self._mode
        if np.hypot(*belief.error[:2]) > self._farthest_m:
            words = f"{belief.where}; mode {mode_name(mode)} leads away from the goal"
            return run.verdict(Ending.GAVE_UP, words)
        if belief.mode != mode:
            return run.begin()
        if belief.blind:  # stand, and choose again if no frames come in
            stands = rest(belief, belief.setpoint_C, belief.camera.period_s)
            return run.begin() if belief.gives_up_seeing else stands
        robot, period_s = belief.problem.robot, belief.camera.period_s
        step, moved = proposal(robot, belief.q, run.error(LEFT), mode)
        if run.stagnated(GAIN * moved):
            return run.begin()
        v = GAIN * step / period_s
        wheels = kinematics(robot).wheel_matrix(belief.q, mode).full() @ v
        most, limits = float(np.abs(wheels).max()), robot.limits
        slower = max(1.0, most / limits.wheel_speed_rad_s)
        slower = max(slower, float(np.abs(v[:2]).max()) / limits.unit_speed_m_s)
        return Command(belief.setpoint_C, period_s, run.pulses.shape(wheels / slower), mode)
