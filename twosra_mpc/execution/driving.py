"""Driving a phase by what the camera sees: it is tracked, looked at when it ends, and judged.

Whatever can be corrected later is left; what cannot, because a segment would have to melt again, is
predicted, and the plan is given up as soon as that is certain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.execution.controller import (
    AstrayError,
    Looking,
    Next,
    UnseenError,
    look_once_stopped,
    rest,
)
from twosra_mpc.execution.robot_interface import Command, still
from twosra_mpc.execution.tracking.setup import outputs_of
from twosra_mpc.execution.tracking.tracker import Measurement
from twosra_mpc.model.bending import bending
from twosra_mpc.model.rolling import held
from twosra_mpc.robot.accuracy import ACCEPTED, POSE_SHARE
from twosra_mpc.robot.coordinates import POSE, Array, rotation
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, is_rigid, last_bent, soft_segments

if TYPE_CHECKING:
    from twosra_mpc.execution.following import Following

_ABOVE = 1.5  # times the dead zone: so that the slower wheels of a motion turn as well
_COUNTED = 0.2  # of the fastest wheel: in a bend slower ones make no difference
_SOON_S = np.array([0.5, 1.0])  # in which a robot of 2sra-v1's acceleration slows down
_STIFF = 0.7  # of the bend: in a log soft segments differ by 0.44 of it, a stiff one by all of it
_FELT_S = 4.0  # in which a robot that closes round an object bends no nearer: it is felt
_TIGHTER_PER_M = 2.0  # than planned: accuracy leaves bends 1 1/m looser, and 0.5 mm of gap is 0.5
_SLIPS_S, _SLIPS_PER_M2_S = 0.2, 150.0  # ahead its speed is looked at; as much, per (m/s)^2 and s
_MINUTES = 1.5  # times two deviations: one of 700 bends, each of 300 s, is worth half a second
_HELD = 0.1  # share of its motions that wheels hold, below which a shape drives a robot astray
_ROUNDING = 1e-9  # [1/m^2]
_HALVINGS = 60  # of an interval of deviations, down to rounding


class Pulses:
    """Passes fast commands on, and adds slow ones up until they are worth a pulse."""

    def __init__(self, dead_zone_rad_s: float) -> None:
        """Start with nothing left over from before."""
        self._dead, self._least, self._owed = dead_zone_rad_s, _ABOVE * dead_zone_rad_s, 0.0

    def shape(self, wheel_rad_s: Array, counted: float = 1.0) -> Array:
        """Return what to send for a command of the wheels (4,) in this period, as on average."""
        faster = self._faster(wheel_rad_s, counted)
        self._owed = self._owed + 1 / faster if faster > 1.0 else 1.0
        if self._owed < 1.0:
            return still()
        self._owed -= 1.0
        return self.brisk(wheel_rad_s, counted)

    def brisk(self, wheel_rad_s: Array, counted: float = 1.0) -> Array:
        """Return a command of the wheels (4,) at which they surely turn; slow ones are to stand."""
        turned = self._faster(wheel_rad_s, counted) * wheel_rad_s
        return np.where(np.abs(turned) < self._dead, 0.0, turned)

    def _faster(self, wheel_rad_s: Array, counted: float) -> float:
        """Factor of speed with which all wheels turn that have this share of the fastest's."""
        speeds = np.abs(wheel_rad_s)
        slowest = float(speeds[speeds >= counted * speeds.max()].min())
        return max(1.0, self._least / slowest) if slowest else 1.0


class Driving:
    """Phase on its way, and again while looks say that it comes nearer to its end."""

    def __init__(self, run: Following, index: int) -> None:
        """Begin a phase; the robot is in its mode."""
        self.run, self.index, self.belief = run, index, run.belief
        self.course, self.patience, self.mission = run.course, run.belief.patience, run.mission
        plan = run.course.plan
        self.phase = plan.phases[index]
        self.rigid = is_rigid(self.phase.mode)
        self.bends, self.last = self._goes_on()
        modes = [phase.mode for phase in plan.phases[index:]]
        self.soft, self.settling = list(soft_segments(self.phase.mode)), settling(modes)
        self.closes = self.last and not self.rigid and self.mission.closes
        self.scale = self.belief.accuracy.scale(plan.robot.coordinates)
        self.begun, self._slips = self.belief.q.copy(), np.zeros(POSE)
        if self.belief.guard is not None:
            self.belief.guard.begin(self.begun)
        self._best, self._looks = math.inf, 0
        self._nearer_s = _FELT_S if self.closes else self.patience.come_nearer_s
        self._left_s = self._nearer_s  # of driving: looks do not count

    def _goes_on(self) -> tuple[bool, bool]:
        """True if a mission goes on to bend, and nothing later makes good what is missed.

        So it is before a bend, where a task is done that is no path, and at the end.
        """
        phases = self.course.plan.phases
        if self.index == len(phases) - 1:
            return False, not self.mission.ends_on_path
        after = phases[self.index + 1]
        bends = self.mission.rests and self.rigid and not is_rigid(after.mode)
        return bends, bends or self.mission.ends_between(self.phase.start_s, after.start_s)

    def advance(self) -> Next:
        """Drive for a period, stand while that is not possible, or end."""
        belief, course, run = self.belief, self.course, self.run
        self.mission.see()
        if (standing := self._standing()) is not None:
            return standing
        planned, off, over = course.planned, self._off(), course.clock_s >= self.phase.end_s
        if (over and off <= self._near_enough()) or self._left_s <= 0.0:
            return self.ended()
        self._keep_within()
        if self._unequal() is not None:
            return look_once_stopped(belief, self._evened_out)
        self.mission.check_held()
        slower = 1.0
        if belief.guard is not None:
            soon = course.plan.trajectory.configuration(course.clock_s + _SOON_S)
            slower = belief.guard.pace(np.vstack([belief.q, soon]), belief.deviation)
        pace = min(slower, self.patience.tube / off) if off else slower
        # What turns yet belongs to the time at which it has turned; over, the path rests.
        time_s = course.clock_s + (belief.camera.period_s if over else pace * belief.motors.lag_s)
        measured = self._seen + belief.coasting + (0.0 if over else self._slipping(pace))
        cone = self.mission.pushing
        wheels = run.tracker.step(Measurement(time_s, self.index, measured, pace, cone)).wheel_rad_s
        # All time that passes until bends are right is time that metal does not freeze.
        shape = run.pulses.brisk if over and not self.rigid else run.pulses.shape
        period_s, mode = belief.camera.period_s, self.phase.mode
        soft_for_s = course.soft_for_s
        turned = shape(wheels, 1.0 if self.rigid else _COUNTED)
        command = Command(run.setpoint_C, period_s, turned, mode, planned, soft_for_s)
        if not over:
            course.clock_s = min(course.clock_s + pace * period_s, self.phase.end_s)
        self._left_s -= period_s
        if not over or off < self.patience.stuck * self._best:
            self._left_s, self._best = self._nearer_s, off
        return command

    def _slipping(self, pace: float) -> Array:
        """How much farther off than seen a robot is that pulls something, (3 + n,): it slips on.

        It is the integral of what it is off, in b0, as much as it is fast.
        """
        more, course = np.zeros_like(self.belief.q), self.course
        if self.rigid and self.mission.pulls:
            soon = course.plan.trajectory.configuration([course.clock_s + _SLIPS_S])[0]
            speed = pace * math.dist(soon[:2], course.planned[:2]) / _SLIPS_S
            seen = self._seen
            to_b0 = np.eye(POSE)
            to_b0[:2, :2] = rotation(seen[2]).T
            self._slips += (
                speed * self.belief.camera.period_s * (seen - course.planned)[:POSE] @ to_b0
            )
            more[:POSE] = _SLIPS_PER_M2_S * speed * self._slips @ to_b0.T
        return more

    def _standing(self) -> Next | None:
        """Rest while the robot is not in the mode, or nothing sees it; None: it may drive."""
        belief, course, mode = self.belief, self.course, self.phase.mode
        if belief.mode != mode:
            return rest(belief, course.held(self.run.setpoint_C, mode), self.patience.rest_s)
        if not belief.blind:
            return None
        if belief.gives_up_seeing:
            raise UnseenError(belief.unseen)
        return rest(belief, self.run.setpoint_C, belief.camera.period_s, course)

    def ended(self) -> Next:
        """Average camera frames at rest, where the end of the phase matters for the goal."""
        if self.rigid and not self.last:
            return self._looked()
        return self._look(self.patience.certain, self.patience.look_s, self._looked)

    def _look(self, share: float, at_most_s: float, then: Callable[[], Next]) -> Next:
        """Look until it is decided whether the phase is done, or certain to a share."""
        scale = share * self.scale
        if not self.rigid:
            scale[:POSE] = math.inf  # poses are corrected when everything is solid
        return Looking(self.belief, partial(self._known, scale), at_most_s, then)

    def _known(self, scale: Array) -> bool:
        """True if the end is surely not near enough, or is and a longer look costs time.

        Of several soft segments each counts for what is planned after a look.
        """
        if self.mission.closes or len(self.soft) > 1:
            return self.belief.certain(scale)
        short = self._accepted - self._off()
        wrong = -short >= self._uncertain()
        right = short >= self._surely * self._uncertain() and not self._coasts
        return self.belief.certain(scale) or ((wrong or right) and self._clear)

    @property
    def _coasts(self) -> bool:
        """True if the bent metal stays soft without heat: a look costs nothing."""
        return not self.rigid and self.belief.coasts

    @property
    def _clear(self) -> bool:
        """True if it is clear whether the goal's curvatures are missed."""
        share = 0.0 if self.rigid else self.belief.accuracy.of_shape(self._predicted_miss())
        return abs(share - ACCEPTED) >= self.patience.doubtful

    def _looked(self) -> Next:
        self._looks += 1
        patience, again = self.patience, self._looks <= self.patience.tries
        if again and (self._off() + self._uncertain() > self._accepted or self._mends):
            self._left_s, self._best = self._nearer_s, math.inf
            return self
        if self.rigid:
            return self._judged_pose()
        fine = patience.certain_of_a_melt * self.belief.accuracy.curvature_per_m
        if again and self._coasts and self.belief.deviation[POSE:].max() > fine:
            return self._look(patience.certain_of_a_melt, patience.long_look_s, self._looked)
        return self._judged_bends()

    @property
    def _mends(self) -> bool:
        """True if bends miss, and would do so by less if their mean were as planned."""
        several = len(self.soft) > 1 and not self.closes
        if not several or self._off() <= self.patience.near_enough:
            return False
        return self.belief.accuracy.of_shape(self._predicted_miss()) > ACCEPTED

    @property
    def _surely(self) -> float:
        """Times `_uncertain`, beyond which a look is over: what is missed costs minutes, or not."""
        return 1.0 if self.rigid else _MINUTES

    @property
    def _accepted(self) -> float:
        """Deviation that is left as it is, in units of the accuracy."""
        tightened = self.closes and self.course.clock_s >= self.phase.end_s
        tighter = _TIGHTER_PER_M / self.belief.accuracy.curvature_per_m if tightened else 0.0
        return POSE_SHARE if self.rigid else ACCEPTED + tighter

    def _judged_pose(self) -> Next:
        moved = self._seen - self.belief.q  # to where it would hold as planned what it holds
        if self.bends and self.belief.accuracy.of_pose(self.course.away + moved) > 1.0:
            raise AstrayError("the robot is not where it is to bend")
        return self.run.phase_done(self.index)

    def _judged_bends(self) -> Next:
        """Judge whether the phases to come lead to the goal's curvatures from here, as they are."""
        if self.mission.closes:
            return self.run.phase_done(self.index)
        if self._clear:
            return self._judged_miss()
        patience = self.patience
        return self._look(patience.certain_of_a_melt, patience.long_look_s, self._judged_miss)

    def _judged_miss(self) -> Next:
        missed, patience = self._predicted_miss(), self.patience
        if self.belief.accuracy.of_shape(missed) <= ACCEPTED:
            return self.run.phase_done(self.index)
        bends = " and ".join(f"{kappa:+z.1f}" for kappa in missed[POSE:].tolist())
        far = bool(np.abs(missed[POSE:]).max() > patience.stiff_per_m)
        bent = self.belief.doubt is not None and self.belief.doubt.each_bends
        text = f"the plan would miss the curvatures by {bends} 1/m"
        raise AstrayError(text, stiff=far and not bent, missed=self.phase.mode)

    @property
    def _seen(self) -> Array:
        """Configuration as seen, (3 + n,), its soft segments as far off as those that settle now.

        With an object that is led somewhere it is the one in which that would be held as planned.
        What a robot closes round it is to close on more tightly than planned, until that is felt.
        The units bend all soft segments at once, so one number can be brought to the plan's: what
        others miss is made good in the later phases in which they are soft.
        """
        over = self.course.clock_s >= self.phase.end_s
        q = self.mission.steered(self.belief.q.copy())
        if not self.rigid:
            away = (q - self.course.planned)[POSE:]
            aimed = self._right_at_once(q)
            mean = away[self.settling].mean() if aimed is None else away[self.soft].mean() + aimed
            q[POSE:][self.soft] += mean - away[self.soft].mean()
        if over and self.closes:
            planned = self.course.planned[POSE:][self.soft].mean()
            q[POSE:][self.soft] -= math.copysign(_TIGHTER_PER_M, planned)
        return q

    def _right_at_once(self, q: Array) -> float | None:
        """Mean bend at the phase's planned end, less that at the plan's end [1/m].

        None if not all soft segments can be right at once, or all have to be anyway.
        """
        if len(self.settling) == len(self.soft) or math.isfinite(self.mission.matters_s):
            return None
        plan, soft = self.course.plan, self.soft
        end, final = plan.trajectory.configuration([self.phase.end_s, plan.duration_s])
        at = np.concatenate([final[:POSE], q[POSE:]])
        at[POSE:][soft] += (final - q)[POSE:][soft].mean()
        if self.belief.accuracy.of_shape(self.belief.goal.error(at)) > ACCEPTED:
            return None
        return float((end - final)[POSE:][soft].mean())

    def _off(self) -> float:
        """Deviation of what the phase controls from the plan, in units of the accuracy."""
        return float(np.abs(self._outputs(self._seen - self.course.planned)).max())

    def _near_enough(self) -> float:
        """Deviation at which the phase may end: no finer than what is believed is certain."""
        loose = self.patience.loose if self.rigid and not self.last else 1.0
        return min(self.patience.near_enough * loose, max(self._uncertain(), self.patience.finest))

    def _uncertain(self) -> float:
        """Two standard deviations of what the phase is judged by, in units of the accuracy."""
        return 2 * float(np.abs(self._outputs(self.belief.deviation)).max())

    def _outputs(self, difference: Array) -> Array:
        """Outputs that the phase is judged by, of a difference of q, in units of the accuracy.

        The pose in a rigid phase; in a soft one the mean of the bends alone: a pose that is left
        over is corrected by a rigid drive.
        """
        selection = outputs_of(self.belief.problem.robot.body, self.phase.mode).selection
        turned = difference.copy()
        turned[2] = math.remainder(turned[2], math.tau)
        shares: Array = (selection @ turned) / (selection @ self.scale)
        return shares if self.rigid else shares[-1:]

    def _keep_within(self) -> None:
        """Leave the plan where the robot has left its corridor."""
        belief, patience, away = self.belief, self.patience, self.course.away
        turn, far_m = float(away[2]), math.hypot(away[0], away[1])
        lost = far_m > patience.corridor_m or abs(turn) > patience.corridor_rad
        if self.rigid and belief.guard is not None:
            lost = belief.guard.off_m(away) > patience.narrow_m
        if lost:
            if held(belief.problem.robot.body, self.phase.mode, belief.q) < _HELD:
                self.run.stalled.add(self.phase.mode)
            there = f"{1e3 * far_m:z.0f} mm and {abs(turn):z.2f} rad"
            raise AstrayError(f"the robot is {there} from the plan")

    def _evened_out(self) -> Next:
        """Go on if soft segments bend alike at rest: a fibre that is bent quickly lags."""
        if (unequal := self._unequal()) is not None:
            raise unequal
        return self

    def _unequal(self) -> AstrayError | None:
        """What is wrong if soft segments bend apart; None if nothing is."""
        soft = self.soft
        if not soft or self.closes:  # what it closes round may bend them apart
            return None
        kappa, asked = self.belief.q[POSE:][soft], self.course.planned[POSE:][soft]
        uneven = asked - asked.mean()
        left = np.clip((kappa - kappa.mean()) @ uneven / max(uneven @ uneven, _ROUNDING), 0.0, 1.0)
        apart = float(np.ptp(kappa - left * uneven)) / 2  # more than bends that have evened out
        bent = (self.belief.q - self.begun)[POSE:][soft]
        if apart <= max(self.patience.stiff_per_m, _STIFF * abs(float(bent.mean()))):
            return None
        text = f"the segments bend unequally, by {apart:z.1f} 1/m more and less than planned"
        stiff = bool(np.ptp(np.abs(bent)) > _STIFF * np.abs(bent).max())  # or both have bent
        return AstrayError(text, stiff=stiff, missed=self.phase.mode)

    def _predicted_miss(self) -> Array:
        """Distance to the goal, (3 + n,), if the phases after this one are driven as they are."""
        plan, until_s = self.course.plan, self.mission.matters_s
        later = [phase for phase in plan.phases[self.index + 1 :] if phase.end_s <= until_s]
        times = [self.course.clock_s, *(item.end_s for item in later)]
        path, modes = plan.trajectory.configuration(times), [item.mode for item in later]
        kappa = predicted_curvatures(plan.robot, self.belief.q, list(path), modes)
        if math.isfinite(until_s):
            return np.concatenate([np.zeros(POSE), kappa - path[-1, POSE:]])
        return self.belief.goal.error(np.concatenate([path[-1, :POSE], kappa]))


def settling(modes: Sequence[Mode]) -> list[int]:
    """Segments (from 0) that are soft in the first of these phases for the last time, or all soft.

    They are what it must bring to the plan's curvatures.
    """
    return last_bent(modes) or list(soft_segments(modes[0]))


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
    deviation = model.coordinates(deviated[POSE:]) - model.coordinates(path[0][POSE:])
    for k, (end, mode) in enumerate(zip(path[1:], modes, strict=True)):
        if soft := list(soft_segments(mode)):
            planned, last = model.coordinates(end[POSE:])[soft], settling(modes[k:])
            counted = [soft.index(j) for j in last]
            low, high = -deviation[soft].max(), -deviation[soft].min()
            for _ in range(_HALVINGS):
                shift = (low + high) / 2
                bent = model.curvature(planned + deviation[soft] + shift)
                less = bent[counted].mean() < end[POSE:][last].mean()
                low, high = (shift, high) if less else (low, shift)
            deviation[soft] += shift
    return model.curvature(model.coordinates(path[-1][POSE:]) + deviation)
