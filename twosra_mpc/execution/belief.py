"""Belief: what is known of a robot after each reading, and after each command given to it."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twosra_mpc.control.stiffness import CLEARLY_S, KnownStiffness, clearly
from twosra_mpc.errors import InputError, RobotError
from twosra_mpc.execution.camera_filter import CREEP, EVENING, CameraFilter, only, usable
from twosra_mpc.execution.doubt import Doubt
from twosra_mpc.execution.guard import (
    Guard,
    MeetsItselfError,
    ObjectsSeen,
    TooNearError,
    bends_into_itself,
)
from twosra_mpc.execution.robot_interface import Camera, Command, Motors, Reading
from twosra_mpc.execution.run import Change, Drive, Ending, EventKind, RunEvent
from twosra_mpc.execution.segment_watch import SegmentError, SegmentWatch
from twosra_mpc.execution.settings import Patience
from twosra_mpc.model.rolling import NO_DRIFT, held, rolling
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import Mode, is_rigid

_LATELY = 6  # periods whose motion the guard expects to go on: in fewer frames' noise is motion
_COASTING = 1.5  # of the last period's motion: motors that lag by 0.1 s at commands of 15 Hz
_BLIND_PERIODS = 5  # without a frame: 20 % of frames lost do that once an hour
_CLEARLY_K = 0.5  # a reported stiffness overrules a temperature on the wrong side by this
_SURELY = 3.0  # deviations by which what is seen may be off
_STOOD = 10  # readings between which no time passes: news may end a wait early, for each segment
_LEAP_S = 0.5  # later than it was due a reading is believed only when the next is later still
_FAULTS = 3  # readings in a row with its flag make a fault: single ones are noise


class Metal(NamedTuple):
    """Metal of a segment, as the start of a problem has it.

    Attributes:
        temperature_C: Its temperature.
        melt_fraction: From 0 (solid) to 1 (liquid).
        body_C: Temperature of what is around it; None: it is as warm.
    """

    temperature_C: float
    melt_fraction: float
    body_C: float | None = None


class Belief:
    """Belief about a robot, by all that was read and commanded so far.

    Attributes:
        problem: What was asked.
        camera: What sees the robot.
        patience: How long it is waited for, and how near is near enough.
        reading: The last reading, with those of its frames that are believed.
        accuracy: How near to the goal is near enough.
        objects: Where objects are seen, if there are any.
        guard: What keeps the robot clear of what is around it, if anything is.
        command: The last command; its set-points are those asked for.
        events: What happened.
        changes: Melts and freezes so far.
        drives: When the robot was driven.
        doubt: About bends that are not seen; None of a robot that nothing sees.
        doubtful: True if it must stand and be looked at for that.
        motors: Of its wheels, as they turn by the commands given.
    """

    def __init__(
        self,
        problem: Problem,
        camera: Camera,
        patience: Patience,
        *,
        motor_lag_s: float = 0.0,
        guard: Guard | None = None,
        sighted: bool = True,
        reports: bool = True,
    ) -> None:
        """The robot is where the problem starts; nothing has been read yet.

        Args:
            problem: What is asked.
            camera: What sees the robot, or the rate of its commands alone.
            patience: How long frames and reports are waited for.
            motor_lag_s: Time constant of the wheels' motors, as far as it is known.
            guard: What keeps it clear of what is around it.
            sighted: True if it is driven by what a camera sees.
            reports: True if temperatures must be reported.
        """
        robot, segments = problem.robot, range(problem.robot.coordinates.segments)
        start_C = problem.temperatures
        self.problem, self.camera, self.guard, self.patience = problem, camera, guard, patience
        self.accuracy, self.goal = robot.ends_within, problem.judged_goal
        self.objects = ObjectsSeen(problem) if problem.objects else None
        self.doubt = Doubt(robot.geometry.lengths_m) if sighted else None
        self.doubtful = False
        self.events, self.changes, self.drives = list[RunEvent](), list[Change](), list[Drive]()
        self._watches = [
            SegmentWatch(robot, problem.ambient, j, patience, reports=reports, start_C=start_C[j])
            for j in segments
        ]
        off_C = np.full(len(segments), robot.heater.rigid_setpoint_C)
        self.command = Command(off_C, 0.0)
        unread, size = (None,) * len(segments), robot.coordinates.size
        sound, unknown_C = (False,) * len(segments), (np.nan,) * len(segments)
        self.reading = Reading(np.nan, np.empty(0), np.empty((0, size)), unknown_C, unread, sound)
        self._filter = CameraFilter(camera, problem.start.configuration, 0.0)
        self._newest_s = self._seen_s = -np.inf
        self._compared: tuple[Mode | None, Array] = None, self.q
        self.motors, self._driven = Motors(motor_lag_s), robot.rigid
        self._stood, self._leapt_s, self._heard_s = 0, np.nan, np.nan
        self._faults = np.zeros(len(segments), dtype=int)
        self._lately: deque[tuple[float, Array]] = deque(maxlen=_LATELY)

    # What is believed.

    @property
    def now_s(self) -> float:
        """Time of the last reading."""
        return self.reading.time_s

    @property
    def setpoint_C(self) -> Array:
        """Set-points last asked for, (n,)."""
        return self.command.heater_setpoint_C

    @property
    def stands(self) -> bool:
        """True if the wheels were last told to stand."""
        return not self.command.wheel_rad_s.any()

    @property
    def q(self) -> Array:
        """Configuration believed, (3 + n,)."""
        return self._filter.q

    @property
    def deviation(self) -> Array:
        """Standard deviation of what is believed, (3 + n,)."""
        return self._filter.deviation

    @property
    def error(self) -> Array:
        """Distance to the goal as believed, (3 + n,)."""
        return self.goal.error(self.q.copy())

    @property
    def where(self) -> str:
        """Distance to the goal in words; of a mission without one, that it is not over."""
        if self.problem.ends_anywhere:
            return "before all tasks are done"
        return self.accuracy.describe(self.error)

    @property
    def mode(self) -> Mode | None:
        """Mode the robot is in; None while a segment is changing or not known."""
        reported = self.reading.stiffness
        if not set(reported) <= {"soft", "rigid"}:
            return None
        return tuple(int(now == "soft") for now in reported)

    @property
    def _even_out(self) -> bool:
        """True if a segment melts while another is not solid: their bends may even out."""
        stiffness, soft_C = self.reading.stiffness, self.problem.robot.heater.soft_setpoint_C
        melts = "changing" in np.array(stiffness)[self.setpoint_C >= soft_C]
        return melts and stiffness.count("rigid") + 1 < len(stiffness)

    @property
    def metal(self) -> tuple[Metal | None, ...]:
        """Metal of the segments as believed; None of one that is changing and nobody knows."""
        return tuple(map(self._metal, range(len(self._watches))))

    def _metal(self, segment: int) -> Metal | None:
        solid_C, liquid_C = self.problem.segment_thresholds_C[segment]
        here_C, heater = self._watches[segment].shown_C, self.problem.robot.heater
        match self.reading.stiffness[segment]:
            case "soft":
                here_C = min(max(here_C, liquid_C + _CLEARLY_K), heater.temperature_max_C)
                return Metal(here_C, 1.0)
            case "rigid":
                here_C = max(min(here_C, solid_C - _CLEARLY_K), heater.temperature_min_C)
                return Metal(here_C, 0.0)
        state = self._watches[segment].state
        if state is None:
            return None
        model = segment_model(self.problem.robot, self.problem.ambient, segment)
        here_C, share = model.temperature_C(state), model.melt_fraction(state)
        if 0.0 < share < 1.0:
            here_C = solid_C + share * (liquid_C - solid_C)
        return Metal(here_C, share, state[1] if len(state) > 1 else None)

    @property
    def coasts(self) -> bool:
        """True if all that is to stay soft does so without heat, for as long as it must."""
        soft = self.setpoint_C >= self.problem.robot.heater.soft_setpoint_C
        asked = zip(self._watches, self.setpoint_C.tolist(), strict=True)
        allowed_C = np.array([watch.allowed_C(asked_C) for watch, asked_C in asked])
        return bool(soft.any() and (allowed_C < self.setpoint_C)[soft].all())

    @property
    def known(self) -> str:
        """What is known about the segments, in words."""
        return ", ".join(map(self.reading.describe, range(len(self.setpoint_C))))

    @property
    def unseen_s(self) -> float:
        """Time since the last camera frame came in; infinite before the first."""
        return self.now_s - self._seen_s

    @property
    def unseen(self) -> str:
        """Time without a frame, in words."""
        since = f"for {self.unseen_s:z.0f} s" if np.isfinite(self.unseen_s) else "at all"
        hangs = ", but always the same picture" if self._filter.frozen else ""
        return f"no camera frame {since}{hangs}"

    @property
    def blind(self) -> bool:
        """True if no frame has come in for so long that the wheels must stand."""
        return self.unseen_s > max(self.patience.blind_s, _BLIND_PERIODS * self.camera.period_s)

    @property
    def gives_up_seeing(self) -> bool:
        """True if no frame has come in for so long that none is waited for."""
        return self.now_s - max(self._seen_s, self._begun_s) >= 2 * self.patience.unseen_s

    def certain(self, deviation: Array) -> bool:
        """True if the standard deviation of what is believed is at most this, (3 + n,)."""
        return bool((self.deviation <= deviation).all())

    def sure(self, scale: Array) -> bool:
        """True if it has been seen lately where the robot is, to a part of these (3 + n,)."""
        lately = self.unseen_s <= self.patience.unseen_s
        return lately and self.certain(self.patience.known * scale)

    def ending_unseen(self, left: bool) -> tuple[Ending, str]:
        """Ending of a run whose robot is not seen, or badly; ``left``: something is left to do."""
        where = f"{self.where} as believed"
        if left or not self.accuracy.surely(self.error):
            return Ending.CAMERA_LOST, f"{self.unseen}; {where}"
        known = f"not seen for {self.unseen_s:z.1f} s"
        if self.unseen_s <= self.patience.unseen_s:
            known = f"seen too badly, give or take {self.accuracy.describe(self.deviation)}"
        return Ending.UNSEEN, f"arrived by dead reckoning, {known}; {where}"

    def tell(self, kind: EventKind, text: str) -> None:
        """Note an event."""
        self.events.append(RunEvent(self.now_s, kind, text))

    def doubt_segments(self, segments: tuple[int, ...]) -> None:
        """Believe no longer that these (from 0) are soft when their sensors say so."""
        for segment in segments:
            self._watches[segment].doubted = True

    # Readings.

    def take(self, reading: Reading) -> None:
        """Take in what was read after the last command.

        Raises:
            InputError: If the reading is of another robot.
            RobotError: If the robot's clock does not go on, or it has fallen silent.
            SegmentError: If something is wrong with a segment.
            DoubtError: If the robot does not move as it is commanded.
        """
        self._check(reading)
        begun_s, self.doubtful, creep = self.now_s, False, EVENING if self._even_out else CREEP
        self.reading = usable(self._timed(reading), self._newest_s)
        if np.isnan(begun_s):
            self._begin()
            return
        mode, before = self.command.mode, self.q.copy()
        self._driven = self._driven if mode is None else mode
        turned = self.motors.turned(self.command.wheel_rad_s, self.now_s - begun_s)
        after = self._rolled(self._driven, before, turned) if turned.any() else before
        if mode is not None and self.drives and self.drives[-1].mode != mode:
            self._filter.forget_response()
        lengths_m = self.problem.robot.geometry.lengths_m
        self._filter.predict(self.now_s, after - before, lengths_m, creep)
        self._look()
        self._listen()
        self._note_changes()
        if mode is not None:
            if self.drives and self.drives[-1][::2] == (mode, begun_s):  # it goes on
                self.drives[-1] = self.drives[-1]._replace(end_s=self.now_s)
            else:
                self.drives.append(Drive(mode, begun_s, self.now_s))
            self._compare(mode, before, after)

    def _check(self, reading: Reading) -> None:
        segments, objects = len(self._watches), len(self.problem.objects)
        if (told := len(reading.temperature_C)) != segments:
            raise InputError("reading.temperature_C", told, f"{segments} numbers, of each segment")
        seen = reading.objects
        if self.objects is not None and seen is not None and len(seen) and len(seen[0]) != objects:
            raise InputError("reading.objects", seen.shape, f"poses of all {objects} objects")

    def _begin(self) -> None:
        """The first reading; the robot has not been told anything yet."""
        self._filter = CameraFilter(self.camera, self.problem.start.configuration, self.now_s)
        self._begun_s = self._heard_s = self.now_s
        self._last_known = list(self.reading.stiffness)
        self._look()

    def _timed(self, reading: Reading) -> Reading:
        """The reading, at the time of the last one where its own is wrong; not for long.

        Without a clock nothing would ever be late, or lost.
        """
        begun_s, time_s, at_most_s = self.now_s, reading.time_s, self.command.at_most_s
        if np.isnan(begun_s):
            return reading
        leaps = time_s > begun_s + at_most_s + _LEAP_S
        goes_on = time_s > begun_s and (not leaps or time_s > self._leapt_s)
        self._leapt_s = time_s if leaps else np.nan
        self._stood = 0 if goes_on else self._stood + 1
        if goes_on:
            return reading
        words = f"the robot's clock stands still, at {time_s:zg} s"
        if time_s != begun_s:
            back = f"goes back, by {begun_s - time_s:zg} s"
            words = f"the robot's clock {back if time_s < begun_s else f'leaps to {time_s:zg} s'}"
            self.tell("failure", f"{words}: no time is believed to have passed")
        if self._stood >= _STOOD:
            raise RobotError(words)
        return replace(reading, time_s=begun_s)

    def _look(self) -> None:
        """Take in the frames of the last reading; from now on it has those that are believed."""
        taken_s = self.reading.taken_s
        if not len(taken_s):
            return
        self._newest_s = float(taken_s[-1])
        believed = self._filter.correct(taken_s, self.reading.frames)
        self.reading = only(self.reading, believed)
        if self.objects is not None:
            self.objects.take(self.reading.frames, self.reading.objects)
        if believed.any():
            self._seen_s = self.now_s

    def _listen(self) -> None:
        """Take in what the segments report; a silent robot is waited for while it stands."""
        reading = self.reading
        unread = np.isnan(reading.temperature_C) | [now is None for now in reading.stiffness]
        if self.doubt is None or len(reading.frames) or not unread.all():
            self._heard_s = self.now_s
            self._watch()
        elif (silent_s := self.now_s - self._heard_s) > self.patience.outage_s:
            raise RobotError(f"the robot has been silent for {silent_s:z.0f} s")

    @property
    def uncertain(self) -> bool:
        """True if wheels must stand: nobody knows how late it is, or a resting robot is silent."""
        return self._stood > 0 or (self._heard_s < self.now_s and self.stands)

    def _watch(self) -> None:
        """Look at what the segments report; nobody believes in "soft" without enough heat."""
        reading = self.reading
        current_A = reading.current_A or (None,) * len(self._watches)
        told = zip(reading.temperature_C, reading.stiffness, reading.faulty, current_A, strict=True)
        for watch, asked_C, of_segment in zip(self._watches, self.setpoint_C, told, strict=True):
            watch.take(self.now_s, float(asked_C), *of_segment)
        heated = self.setpoint_C >= self.problem.robot.heater.soft_setpoint_C
        self._faults = np.where(heated & reading.faulty, self._faults + 1, 0)
        for segment in np.flatnonzero(self._faults >= _FAULTS).tolist():
            here = f"{reading.temperature_C[segment]:z.1f} C: heater or sensor?"
            raise SegmentError("heater", segment, f"heating does not warm it, {here}")
        believed = tuple(map(self._believed, range(len(self._watches)), reading.stiffness))
        if believed != reading.stiffness:
            self.reading = replace(reading, stiffness=believed)

    def _believed(self, segment: int, reported: KnownStiffness | None) -> KnownStiffness | None:
        """Stiffness of a segment: its sensor shows it late, or may lie."""
        watch = self._watches[segment]
        if self.doubt is not None:  # else nobody sees whether it bends
            coasts_s = watch.coasts_s()
            goes_on = self._last_known[segment] == "soft" and coasts_s > CLEARLY_S
            known = clearly(coasts_s, watch.clearly_solid, watch.moved_K)
            if goes_on or known is not None:
                return "soft" if goes_on else known
        return "changing" if reported == "soft" and not watch.may_be_soft else reported

    def _note_changes(self) -> None:
        """Write down each segment that has become soft or rigid, and was not so before."""
        for segment, now in enumerate(self.reading.stiffness):
            if now is None or now == "changing" or now == self._last_known[segment]:
                continue
            if self._last_known[segment] != "changing":
                self.changes.append(Change(self.now_s, segment + 1, now))
                self.tell("confirmed", f"segment {segment + 1} is {now}")
            self._last_known[segment] = now

    def _compare(self, mode: Mode, before: Array, after: Array) -> None:
        """Doubt a robot that does not do what it is told; frames are late, so rests count too."""
        if self.doubt is None:
            return
        told_in, seen_at = self._compared
        seen = self.q - (seen_at if told_in == mode else before)
        self._compared = mode, self.q.copy()
        moved = after - before
        off, holds = _SURELY * self.deviation, held(self.problem.robot.body, mode, before)
        self.doubtful = self.doubt.take(self.now_s, mode, moved, seen, off, holds)

    def seen_at_rest(self) -> Array:
        """Change of q since the robot was compared last with what it was told, (3 + n,)."""
        mode, before = self._compared
        self._compared = mode, self.q.copy()
        return self.q - before

    @property
    def coasting(self) -> Array:
        """How q changes yet until wheels stand that are told to, (3 + n,)."""
        motors = self.motors
        return self._rolled(self._driven, self.q, motors.lag_s * motors.rad_s) - self.q

    def _rolled(self, mode: Mode, q: Array, turned: Array) -> Array:
        return rolling(self.problem.robot, mode)(q, turned, NO_DRIFT).full().ravel()

    # Commands.

    def give(self, command: Command) -> Command:
        """Note a command; the one to be sent has set-points that the segments' sensors allow.

        Raises:
            TooNearError: If the robot would come too near to something.
        """
        if command.mode is not None:
            self._keep_clear(command.mode, command.wheel_rad_s)
        self._lately.append((self.now_s, self.q))
        setpoint_C = command.heater_setpoint_C
        allowed_C, for_s = setpoint_C.copy(), command.soft_for_s
        for j, watch in enumerate(self._watches):
            watch.soft_for_s = float(for_s[j]) if for_s.size and self.doubt else np.inf
            allowed_C[j] = watch.allowed_C(float(setpoint_C[j]))
        self.command = replace(command, heater_setpoint_C=setpoint_C.copy())
        return replace(command, heater_setpoint_C=allowed_C)

    def _keep_clear(self, mode: Mode, wheel_rad_s: Array) -> None:
        """Refuse to drive nearer to something than the guard allows, or into itself."""
        guard = self.guard
        if not wheel_rad_s.any() or (guard is None and is_rigid(mode)):
            return
        ahead_s = (1 + _COASTING) * self.camera.period_s
        told, lately = self._rolled(mode, self.q, ahead_s * wheel_rad_s), ahead_s * self._rate()
        lately[POSE:] *= mode  # what is solid does not bend on
        places = np.array([self.q, told, self.q + lately])
        if guard is not None and guard.forbids(mode, places, self.deviation):
            raise TooNearError(f"stopped {guard.describe(self.q)}")
        if not is_rigid(mode) and bends_into_itself(self.problem.robot, self.q, places):
            raise MeetsItselfError("stopped, for parts of the robot would meet")

    def _rate(self) -> Array:
        """Rate of motion in the last periods, as believed, (3 + n,) [1/s]."""
        if not self._lately:
            return np.zeros(POSE + len(self._watches))
        time_s, q = self._lately[0]
        passed_s = self.now_s - time_s
        return (self.q - q) / passed_s if passed_s > 0 else np.zeros_like(self.q)
