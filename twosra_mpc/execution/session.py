"""One run on a robot, step by step: send, let time pass, read, believe, and write it all down."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.execution import run
from twosra_mpc.execution.camera_filter import COASTING, CameraFilter, only, usable
from twosra_mpc.execution.doubt import Doubt, DoubtError
from twosra_mpc.execution.guard import Guard, MeetsItselfError, TooNearError, bends_into_itself
from twosra_mpc.execution.objects_seen import ObjectsSeen
from twosra_mpc.execution.robot_interface import Reading, RobotError, RobotInterface
from twosra_mpc.execution.segment_watch import SegmentWatch
from twosra_mpc.execution.settings import Patience
from twosra_mpc.model.rolling import NO_DRIFT, rolling
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import WHEELS, Array
from twosra_mpc.robot.modes import Mode, is_rigid

_STILL = np.zeros(WHEELS)
_LATELY = 3  # periods whose motion the guard expects to go on
_BLIND_PERIODS = 5  # without a frame: 20 % of frames lost do that once an hour
_STOOD = 10  # waits that take no time: news may end one early, for each segment
_LOOK, _LOOK_S = 0.15, 3.0  # at what may not bend: of a frame's deviation, and for so long
_LOOK_AGAIN = 0.07  # the same before it is doubted; four times as many frames take as much longer
_STOPPED_S = 1.0  # a robot that was stopped is looked at for so long
_CODES: dict[KnownStiffness | None, float] = {
    **{"rigid": 0.0, "changing": run.CHANGING, "soft": 1.0},
    None: np.nan,
}


class Session:
    """What is known and what was done in a run so far.

    Attributes:
        robot: The robot.
        problem: What was asked.
        during: What the run is at, in words.
        reading: The last reading.
        accuracy: How near to the goal is near enough.
        goal: What the run is measured by.
        objects: Where objects are seen, if there are any.
        guard: What keeps it clear of what is around it, if anything is.
        setpoint_C: Set-points last sent, (n,).
        events: What happened.
        changes: Melts and freezes so far.
        drives: When the robot was driven.
    """

    def __init__(
        self,
        robot: RobotInterface,
        problem: Problem,
        on_command: Callable[[Session], None] = lambda session: None,
        guard: Guard | None = None,
        *,
        patience: Patience | None = None,
        sighted: bool = True,
        reports: bool = True,
    ) -> None:
        """Read the robot for the first time; it is where the problem starts.

        Args:
            robot: The robot.
            problem: What is asked.
            on_command: Called after every command.
            guard: What keeps it clear of what is around it.
            patience: How long it waits for frames and reports.
            sighted: Whether it is driven by what a camera sees.
            reports: Whether temperatures must be reported.

        Raises:
            RobotError: If the robot cannot be driven any more.
        """
        self._patience, self._newest_s = patience or Patience(), -np.inf
        self._doubt = Doubt(problem.robot.geometry.lengths_m) if sighted else None
        self.guard = guard
        self.robot, self.problem, self.during = robot, problem, "before the plan begins"
        self.accuracy = problem.robot.ends_within
        self.goal = problem.judged_goal
        self._on_command, segments = on_command, problem.robot.coordinates.segments
        self.reading: Reading = usable(robot.read(), -np.inf)
        self._filter = CameraFilter(robot.camera, problem.start.configuration, self.reading.time_s)
        self._frame = np.sqrt(robot.camera.variance(problem.robot.coordinates))
        self.objects = ObjectsSeen(problem) if problem.objects else None
        self._seen_s = -np.inf
        self._look()
        self._watches = [
            SegmentWatch(
                problem.robot,
                problem.ambient,
                j,
                self._patience,
                reports=reports,
                start_C=problem.temperatures[j],
            )
            for j in range(segments)
        ]
        self.setpoint_C = np.full(segments, problem.robot.heater.rigid_setpoint_C)
        self._since = [self.reading.time_s] * segments
        self.events: list[run.RunEvent] = []
        self.changes: list[run.Change] = []
        self.drives: list[run.Drive] = []
        self._compared: tuple[Mode | None, Array] = None, self.q
        self._turns, self._stood = False, 0
        self._silent, self._heard_s = False, self.now_s
        self._told = self.reading.stiffness
        self._last_known = list(self.reading.stiffness)
        self._unknown = np.full(problem.robot.coordinates.size, np.nan)
        self._planned, self._no_mode = self._unknown, (np.nan,) * segments
        self._lately: deque[tuple[float, Array]] = deque(maxlen=_LATELY)
        self._rows: list[tuple[object, ...]] = []  # in the order of the log's columns

    @property
    def now_s(self) -> float:
        """Time of the last reading."""
        return self.reading.time_s

    @property
    def period_s(self) -> float:
        """Time from a camera frame to the next."""
        return self.robot.camera.period_s

    @property
    def stands(self) -> bool:
        """Whether the wheels were last told to stand."""
        return not self._turns

    @property
    def unseen_s(self) -> float:
        """Time since the last camera frame came in; infinite before the first."""
        return self.now_s - self._seen_s

    @property
    def unseen(self) -> str:
        """For how long no frame has come in, in words."""
        since = f"for {self.unseen_s:z.0f} s" if np.isfinite(self.unseen_s) else "at all"
        hangs = ", but always the same picture" if self._filter.frozen else ""
        return f"no camera frame {since}{hangs}"

    @property
    def q(self) -> Array:
        """Configuration believed, (3 + n,)."""
        return self._filter.q

    @property
    def deviation(self) -> Array:
        """Standard deviation of what is believed, (3 + n,)."""
        return self._filter.deviation

    @property
    def path(self) -> Array:
        """Where the robot was believed to be so far, (rows, 3 + n)."""
        return np.array([row[1] for row in self._rows] + [self.q])

    @property
    def error(self) -> Array:
        """Distance to the goal as believed, (3 + n,)."""
        return self.goal.error(self.q.copy())

    @property
    def mode(self) -> Mode | None:
        """Mode reported by the segments' controllers; None while one is changing or not known."""
        reported = self.reading.stiffness
        if not set(reported) <= {"soft", "rigid"}:
            return None
        return tuple(int(now == "soft") for now in reported)

    @property
    def each_bends(self) -> bool:
        """Whether every soft segment was seen to bend in the mode driven last."""
        return self._doubt is not None and self._doubt.each_bends

    def in_vain_s(self, segment: int) -> float:
        """How long a segment (from 0) has been asked for what it is not."""
        return self.now_s - self._since[segment]

    def tell(self, kind: run.EventKind, text: str) -> None:
        """Note an event."""
        self.events.append(run.RunEvent(self.now_s, kind, text))

    def rest(self, setpoint_C: Array, at_most_s: float, planned: Array | None = None) -> None:
        """Stand still until time is up or the robot has news; ``planned`` as in ``drive``.

        A robot that has fallen silent is waited for: standing costs nothing.

        Raises:
            RobotError: If it stays silent.
            SegmentError: If something is wrong with a segment.
        """
        self._pass(_STILL, setpoint_C, at_most_s, planned, self._no_mode)
        self._believe(np.zeros_like(self.q))
        while self._silent:
            if (silent_s := self.now_s - self._heard_s) > self._patience.outage_s:
                raise RobotError(f"the robot has been silent for {silent_s:z.0f} s")
            self._pass(_STILL, setpoint_C, at_most_s, planned, self._no_mode)
            self._believe(np.zeros_like(self.q))

    def drive(
        self, mode: Mode, wheel_rad_s: Array, setpoint_C: Array, planned: Array | None = None
    ) -> None:
        """Drive for one camera period.

        Args:
            mode: Mode the robot is in.
            wheel_rad_s: Wheel speeds, (4,).
            setpoint_C: Set-points of the heaters, (n,).
            planned: Where the plan is now, (3 + n,).

        Raises:
            TooNearError: If the robot would come too near to something; it stands then.
            DoubtError: If it does not move as it is commanded; it stands then.
            SegmentError: If something is wrong with a segment.
        """
        self._keep_clear(mode, wheel_rad_s)
        begun_s, before = self.now_s, self.q.copy()
        self._pass(wheel_rad_s, setpoint_C, self.period_s, planned, mode)
        duration_s = self.now_s - begun_s
        turned = wheel_rad_s * duration_s
        after = self._rolled(mode, before, turned)
        if self.drives and self.drives[-1].mode != mode:
            self._filter.forget_response()
        self._believe(after - before)
        if self._goes_on(mode, begun_s):
            self.drives[-1] = self.drives[-1]._replace(end_s=self.now_s)
        else:
            self.drives.append(run.Drive(mode, begun_s, self.now_s))
        self._compare(mode, before, after)

    def _compare(self, mode: Mode, before: Array, after: Array) -> None:
        """Doubt a robot that does not do what it is told; frames are late, so rests count too."""
        if self._doubt is None:
            return
        told_in, seen_at = self._compared
        seen = self.q - (seen_at if told_in == mode else before)
        self._compared = mode, self.q.copy()
        known = ", ".join(map(self.reading.describe, range(len(self.setpoint_C))))
        try:
            if self._doubt.take(self.now_s, mode, after - before, seen):
                if not self._doubt.look(self._looked(mode, _LOOK, _LOOK_S)):
                    self._doubt.look_again(self._looked(mode, _LOOK_AGAIN, 4 * _LOOK_S))
                self._doubt.judge(self.now_s, known)
        except DoubtError as doubt:
            for segment in doubt.segments:
                self._watches[segment].doubted = True
            self.rest(self.setpoint_C, self.period_s)
            raise

    def _looked(self, mode: Mode, share: float, at_most_s: float) -> Array:
        """How q has changed by a look at the robot at rest since it was compared last, (3 + n,)."""
        self.average(self.setpoint_C, share * self._frame, at_most_s)
        before, self._compared = self._compared[1], (mode, self.q.copy())
        return self.q - before

    def seen(self, setpoint_C: Array, planned: Array | None = None) -> bool:
        """Stand while no frames come in; False if they stay away. ``planned`` as in ``drive``."""
        patience = self._patience
        blind_s = max(patience.blind_s, _BLIND_PERIODS * self.period_s)
        until_s = self.now_s + 2 * patience.unseen_s - blind_s
        while self.unseen_s > blind_s:
            if self.now_s >= until_s:
                return False
            self.rest(setpoint_C, self.period_s, planned)
        return True

    def sure(self, scale: Array) -> bool:
        """Whether it has been seen lately where the robot is, to a part of these (3 + n,)."""
        patience = self._patience
        lately = self.unseen_s <= patience.unseen_s
        return lately and bool((self.deviation <= patience.known * scale).all())

    def ending_unseen(self, left: bool) -> tuple[run.Ending, str]:
        """How a run ends whose robot is not seen, or badly: at the goal as believed, or not.

        Args:
            left: Whether there is something left to do.
        """
        where = f"{self.accuracy.describe(self.error)} as believed"
        if left or not self.accuracy.surely(self.error):
            return run.Ending.CAMERA_LOST, f"{self.unseen}; {where}"
        known = f"not seen for {self.unseen_s:z.1f} s"
        if self.unseen_s <= self._patience.unseen_s:
            known = f"seen too badly, give or take {self.accuracy.describe(self.deviation)}"
        return run.Ending.UNSEEN, f"arrived by dead reckoning, {known}; {where}"

    def _goes_on(self, mode: Mode, time_s: float) -> bool:
        """Whether a drive at this time continues the last one."""
        return bool(self.drives) and self.drives[-1][::2] == (mode, time_s)

    def _keep_clear(self, mode: Mode, wheel_rad_s: Array) -> None:
        """Stop instead of driving nearer to something than the guard allows, or into itself."""
        guard = self.guard
        if guard is not None and (guard.fresh or not self._goes_on(mode, self.now_s)):
            guard.begin(self.q)
        if not wheel_rad_s.any() or (guard is None and is_rigid(mode)):
            return
        ahead_s = (1 + COASTING) * self.period_s
        told = self._rolled(mode, self.q, ahead_s * wheel_rad_s)
        places = np.array([self.q, told, self.q + ahead_s * self._rate()])
        if guard is not None and guard.forbids(mode, places, self.deviation):
            self._stand()
            raise TooNearError(f"stopped {guard.describe(self.q)}")
        if not is_rigid(mode) and bends_into_itself(self.problem.robot, self.q, places):
            self._stand()
            raise MeetsItselfError("stopped, for parts of the robot would meet")

    def _stand(self) -> None:
        """Stand, and look where that is."""
        self.rest(self.setpoint_C, self.period_s)
        self.average(self.setpoint_C, np.zeros_like(self.q), _STOPPED_S)

    def _rate(self) -> Array:
        """How fast the robot has moved in the last periods, as believed, (3 + n,) [1/s]."""
        if not self._lately:
            return np.zeros_like(self.q)
        time_s, q = self._lately[0]
        return (self.q - q) / (self.now_s - time_s)

    def _rolled(self, mode: Mode, q: Array, turned: Array) -> Array:
        after: Array = rolling(self.problem.robot, mode)(q, turned, NO_DRIFT).full().ravel()
        return after

    def average(self, setpoint_C: Array, deviation: Array, at_most_s: float) -> None:
        """Look at the resting robot until the belief is this certain (3 + n,), or time is up."""
        end_s, planned = self.now_s + at_most_s, self._planned
        stiffness = self.reading.stiffness
        while (
            (self.deviation > deviation).any()
            and self.now_s < end_s - 1e-9
            and self.reading.stiffness == stiffness
        ):
            self.rest(setpoint_C, 3 * self.period_s, planned)

    def finish(self, verdict: run.Verdict) -> run.Run:
        """Stop the wheels, switch off the heaters, and return the run."""
        heater = self.problem.robot.heater
        self.setpoint_C = np.full_like(self.setpoint_C, heater.rigid_setpoint_C)
        self.robot.send(_STILL, self.setpoint_C)
        self.tell("end", verdict.reason)
        self._note(_STILL, self.setpoint_C, self._unknown, self._no_mode)
        return self.so_far(verdict)

    def so_far(self, verdict: run.Verdict) -> run.Run:
        """Return the run as it is written down up to now; the robot is told nothing."""
        kinds = [event.kind for event in self.events]
        columns = (np.array(column, dtype=float) for column in zip(*self._rows, strict=True))
        return run.Run(
            problem=self.problem,
            **verdict._asdict(),
            error=self.error,
            replans=kinds.count("replan"),
            corrections=kinds.count("correct"),
            changes=tuple(self.changes),
            drives=tuple(self.drives),
            events=tuple(self.events),
            log=run.RunLog(*columns),
        )

    def _pass(
        self,
        wheels: Array,
        setpoint_C: Array,
        at_most_s: float,
        planned: Array | None,
        mode: tuple[float, ...],
    ) -> None:
        self._planned = self._unknown if planned is None else planned
        watched = zip(self._watches, setpoint_C, strict=True)
        allowed_C = np.array([watch.allowed_C(float(asked_C)) for watch, asked_C in watched])
        self._note(wheels, setpoint_C, self._planned, mode)
        for segment in np.flatnonzero(setpoint_C != self.setpoint_C):
            self._since[segment] = self.now_s
        self.setpoint_C, self._turns = setpoint_C.copy(), bool(wheels.any())
        self.robot.send(wheels, allowed_C)
        self._on_command(self)
        before_s = self.now_s
        self.robot.wait(at_most_s)
        self.reading = usable(self.robot.read(), self._newest_s)
        self._check_clock(self.now_s - before_s)

    def _check_clock(self, passed_s: float) -> None:
        """Without a clock nothing would ever be late, or lost."""
        self._stood = 0 if passed_s else self._stood + 1
        if passed_s < 0.0:
            raise RobotError(f"the robot's clock goes back, by {-passed_s:zg} s")
        if self._stood >= _STOOD:
            raise RobotError(f"the robot's clock stands still, at {self.now_s:zg} s")

    def _believe(self, moved: Array) -> None:
        """Take in how the robot should have moved, and what was read."""
        self._filter.predict(self.now_s, moved, self.problem.robot.geometry.lengths_m)
        self._look()
        reading = self.reading
        unread = np.isnan(reading.temperature_C) | [now is None for now in reading.stiffness]
        blind = self._doubt is not None and not len(reading.frames)
        self._silent = blind and bool(unread.all())
        if not self._silent:
            self._heard_s = self.now_s
            self._watch()
        self._note_changes()

    def _watch(self) -> None:
        """Look at what the segments report; nobody believes in "soft" without enough heat."""
        reading, self._told = self.reading, self.reading.stiffness
        current_A = reading.current_A or (None,) * len(self._watches)
        known = zip(
            reading.temperature_C, reading.stiffness, reading.faulty, current_A, strict=True
        )
        for watch, asked_C, of_segment in zip(self._watches, self.setpoint_C, known, strict=True):
            watch.take(self.now_s, float(asked_C), *of_segment)
        believed = tuple(
            "changing" if now == "soft" and not watch.may_be_soft else now
            for watch, now in zip(self._watches, reading.stiffness, strict=True)
        )
        if believed != reading.stiffness:
            self.reading = replace(reading, stiffness=believed)

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

    def _note_changes(self) -> None:
        """Write down each segment that has become soft or rigid, and was not so before."""
        soft_C = self.problem.robot.heater.soft_setpoint_C
        for segment, now in enumerate(self.reading.stiffness):
            if self._told[segment] == ("soft" if self.setpoint_C[segment] >= soft_C else "rigid"):
                self._since[segment] = self.now_s
            if now is None or now == "changing" or now == self._last_known[segment]:
                continue
            if self._last_known[segment] != "changing":
                self.changes.append(run.Change(self.now_s, segment + 1, now))
                self.tell("confirmed", f"segment {segment + 1} is {now}")
            self._last_known[segment] = now

    def _note(
        self, wheels: Array, setpoint_C: Array, planned: Array, mode: tuple[float, ...]
    ) -> None:
        reading = self.reading
        seen = reading.frames.mean(axis=0) if len(reading.frames) else self._unknown
        stiffness = tuple(_CODES[now] for now in reading.stiffness)
        known = (reading.time_s, self.q, seen, planned, reading.temperature_C, stiffness)
        self._lately.append((reading.time_s, self.q))
        self._rows.append((*known, setpoint_C, wheels, mode))
