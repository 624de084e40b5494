r"""Belief of where the robot is: a Kalman filter of two numbers for each coordinate.

Besides the coordinate q it estimates the response g, the share of the motion m that the model makes
of the commands which really happens: wheels slip, and path models differ by factors.

.. math:: q \leftarrow q + g\,m, \qquad z = q - g\,M + \text{noise},

where M is what the model has moved since the frame z was taken, for frames arrive late. While the
robot moves the camera is followed; while it rests m = 0, and the filter is the mean of all frames,
down to a fraction of what they are rounded to.

A frame whose innovation z - (q - g M) is beyond `GATE` of its standard deviations, and more than
`WILD` besides, is not believed. If the next ones agree with it, the robot was moved: then they are.
Nor is one believed that is the same as before, to the last digit, although the robot was driven by
more than `WILD` since: that is a camera that hangs.

`usable` leaves out frames that are of no use at all: a lost frame is better than a wrong one.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import RobotError
from twosra_mpc.execution.robot_interface import Camera, Reading
from twosra_mpc.robot.coordinates import POSE, Array, Coordinates

RESPONSE_DOUBT = 0.5  # standard deviation of a mode's response about 1 before it has moved
RESPONSE_WALK = 0.05  # its change from one period of motion to the next
DRIFT = 0.15  # of the travel: of the pose, besides its response
FLEX_PER_M = 0.2  # of curvatures in rigid drives: 0.1 at the median, 0.9 once in 16 in MuJoCo
ARM_M = 0.1  # at which turning and bending count as travel
SETTLING_S = 0.35  # in which motors settle, by the follow-up robot's log; the model has no lag
CREEP = 0.01  # of a frame's standard deviation, per square root of a second
EVENING = 0.3  # the same while segments become soft together: a second's frames count
_RESPONSES = (-2.0, 4.0)  # what a push would teach beyond that would run away
GATE = 6.0
WILD = (0.01, 0.1, 5.0)  # [m, rad, 1/m]: models are off by 3 mm and 0.05 rad more at `hard`
AGAIN = 5  # frames that agree: a third of a second
REMEMBERED_S = 2.0  # no frame arrives later than this
_NO_NOISE = 1e-18  # variance of a perfect camera, so that it is believed at once


class CameraFilter:
    """Belief about the configuration, from commands and frames.

    Attributes:
        q: Configuration [m, m, rad, 1/m ...], (3 + n,).
        variance: Of each coordinate, (3 + n,).
        frozen: Whether the last frame was the same as before, although the robot was driven.
    """

    def __init__(self, camera: Camera, q: Array, time_s: float) -> None:
        """Start where the robot is known to be, to about a frame's accuracy."""
        self._coordinates = Coordinates(len(q) - POSE)
        self._frame = camera.variance(self._coordinates) + _NO_NOISE
        self.q, self.variance = q.astype(float).copy(), self._frame.copy()
        self._time_s, self._moved = time_s, np.zeros(len(q))
        self._moving = False
        self._past: deque[tuple[float, Array]] = deque([(time_s, self._moved)])
        self._wild, self._apart = self._coordinates.each(*WILD), list[Array]()
        self._picture, self._taken_at, self.frozen = self._frame, self._moved, False
        self.forget_response()

    @property
    def deviation(self) -> Array:
        """Standard deviation of each coordinate, (3 + n,)."""
        return np.sqrt(self.variance)

    def forget_response(self) -> None:
        """Another mode begins: nothing is known of its response."""
        size = self._coordinates.size
        self._response, self._shared = np.ones(size), np.zeros(size)
        self._doubt = np.full(size, RESPONSE_DOUBT**2)

    def predict(
        self, time_s: float, moved: Array, lengths_m: tuple[float, ...], creep: float = CREEP
    ) -> None:
        """Take in that time has passed.

        Args:
            time_s: Now.
            moved: How the model says q has changed since, (5,).
            lengths_m: Of the segments.
            creep: What it moves by itself, see `CREEP`.
        """
        self.variance = self.variance + creep**2 * (time_s - self._time_s) * self._frame
        if moved.any():
            bent = float(np.abs(moved[POSE:]) @ lengths_m)
            travel = math.hypot(moved[0], moved[1]) + ARM_M * (abs(float(moved[2])) + bent)
            drift = DRIFT * self._coordinates.each(travel, travel / ARM_M, 0.0)
            self.q = self.q + self._response * moved
            self.variance += moved * (2 * self._shared + moved * self._doubt) + drift**2
            flex = 0.0 if bent else FLEX_PER_M
            self.variance[POSE:] = np.maximum(self.variance[POSE:], flex**2)
            self._shared = self._shared + moved * self._doubt
            self._doubt = self._doubt + RESPONSE_WALK**2
            self._moved = self._moved + moved
        elif self._moving:  # a robot that was told to stand has not moved lately as commanded
            self.variance += (self._moved - self._moved_until(time_s - SETTLING_S)) ** 2
        self._moving = bool(moved.any())
        self._time_s = time_s
        self._past.append((time_s, self._moved))
        while self._past[0][0] < time_s - REMEMBERED_S and len(self._past) > 1:
            self._past.popleft()

    def correct(self, taken_s: Array, frames: Array) -> NDArray[np.bool_]:
        """Take in frames (k, 3 + n) that were taken at these times (k,).

        Returns:
            Which of them were believed, (k,).
        """
        if not len(frames):
            return np.zeros(0, dtype=bool)
        since = self._moved - self._moved_until(taken_s)
        late, believed = since.any(axis=1), np.zeros(len(frames), dtype=bool)
        alive = np.array([self._is_news(*each) for each in zip(frames, since, strict=True)])
        for k in np.flatnonzero(late & alive):
            if self._believable(frames[k], since[k]):
                self._take(frames[k], since[k], self._frame)
                believed[k] = True
        for k in np.flatnonzero(~late & alive):
            believed[k] = self._believable(frames[k], since[k])
        resting = frames[believed & ~late]
        if len(resting):
            turn = resting[:, 2] - self.q[2]
            mean = resting.mean(axis=0)
            mean[2] = self.q[2] + (np.remainder(turn + math.pi, math.tau) - math.pi).mean()
            self._take(mean, np.zeros(len(mean)), self._frame / len(resting))
        return believed

    def _moved_until(self, time_s: float | Array) -> Array:
        """What the model had moved by then, one row for each time."""
        times = [time for time, _ in self._past]
        path = np.array([moved for _, moved in self._past])
        return np.stack([np.interp(time_s, times, m) for m in path.T], axis=-1)

    def _is_news(self, frame: Array, moved: Array) -> bool:
        """True if a frame shows anything else than the one before, or nothing should have moved."""
        at = self._moved - moved
        if (frame != self._picture).any():
            self._picture, self._taken_at = frame, at
        self.frozen = bool((np.abs(at - self._taken_at) > self._wild).any())
        return not self.frozen

    def _believable(self, frame: Array, moved: Array) -> bool:
        """True if a frame is where the robot can be; or agrees with others, where it then is."""
        surprise, _, _, total = self._innovation(frame, moved, self._frame)
        if (np.abs(surprise) <= GATE * np.sqrt(total) + self._wild).all():
            self._apart.clear()
            return True
        there = self.q + surprise
        apart = there - self._apart[-1] if self._apart else np.zeros_like(there)
        if (np.abs(apart) > GATE * np.sqrt(2 * self._frame) + self._wild).any():
            self._apart.clear()
        self._apart.append(there)
        if len(self._apart) < AGAIN:
            return False
        self.q, self.variance = np.mean(self._apart, axis=0), self._frame.copy()
        self._apart.clear()
        self.forget_response()
        return True

    def _innovation(
        self, frame: Array, moved: Array, variance: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Innovation of a frame since which the model has ``moved``, and its variance.

        Between them its covariances with the configuration and with the response.
        """
        surprise: Array = frame - (self.q - self._response * moved)
        surprise[2] = math.remainder(surprise[2], math.tau)
        here, there = self.variance - moved * self._shared, self._shared - moved * self._doubt
        return surprise, here, there, here - moved * there + variance

    def _take(self, frame: Array, moved: Array, variance: Array) -> None:
        """Correct by one frame, or the mean of several, since which the model has ``moved``."""
        surprise, here, there, total = self._innovation(frame, moved, variance)
        gain, response = here / total, there / total
        self.q = self.q + gain * surprise
        self._response = np.clip(self._response + response * surprise, *_RESPONSES)
        self.variance = np.maximum(self.variance - gain * here, 0.0)
        self._shared = self._shared - gain * there
        self._doubt = np.maximum(self._doubt - response * there, 0.0)


_AHEAD_S = 0.2  # clocks of camera and robot may differ by
_FAR_M, _BENT_PER_M = 100.0, 1e3  # no robot of this kind goes, or bends, so far: see `Metres`


def usable(reading: Reading, newest_s: float) -> Reading:
    """The reading without frames that are not finite, too far, too old, ahead of time, or no news.

    Args:
        reading: What was read.
        newest_s: When the newest frame before it was taken.

    Raises:
        RobotError: If nobody knows what time it is.
    """
    if not np.isfinite(reading.time_s):
        raise RobotError(f"the robot's clock shows {reading.time_s}")
    taken_s = reading.taken_s
    away = np.abs(reading.frames)
    sound = np.isfinite(taken_s) & np.isfinite(away).all(axis=1)
    sound &= (away[:, :2] <= _FAR_M).all(axis=1) & (away[:, POSE:] <= _BENT_PER_M).all(axis=1)
    sound &= (taken_s >= reading.time_s - REMEMBERED_S) & (taken_s <= reading.time_s + _AHEAD_S)
    newest = np.maximum.accumulate(np.where(sound, taken_s, -np.inf))
    sound &= taken_s > np.maximum(newest_s, np.concatenate([[-np.inf], newest[:-1]]))
    return only(reading, sound)


def only(reading: Reading, kept: NDArray[np.bool_]) -> Reading:
    """The reading with these of its frames (k,) alone."""
    if kept.all():
        return reading
    objects = None if reading.objects is None else reading.objects[kept]
    taken_s, frames = reading.taken_s[kept], reading.frames[kept]
    return replace(reading, taken_s=taken_s, frames=frames, objects=objects)
