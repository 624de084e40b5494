"""The controller of a robot, as a step: a reading in, a command out.

It waits for nothing, knows no clock but the readings', and keeps no thread: what calls it sends the
command, lets time pass, and reads. Its state is its belief and one activity, which is a value too:
`pickle` keeps a controller, also while metal changes, and another process goes on with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Protocol, get_args

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.errors import TwosraError
from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.doubt import Doubt, DoubtError
from twosra_mpc.execution.guard import TooNearError
from twosra_mpc.execution.robot_interface import Command, Reading
from twosra_mpc.execution.run import Ending, Verdict
from twosra_mpc.execution.segment_watch import SegmentError
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode

if TYPE_CHECKING:
    from twosra_mpc.execution.course import Course


@dataclass(eq=False)
class AstrayError(TwosraError):
    """The rest of a plan does not lead to where it should.

    Attributes:
        text: Why, in words.
        stiff: Whether a segment that is reported soft seems to need more time.
        missed: Mode whose bends do not lead to the goal's curvatures, if that is why.
    """

    text: str
    stiff: bool = field(default=False, kw_only=True)
    missed: Mode | None = field(default=None, kw_only=True)


class UnseenError(TwosraError):
    """Camera frames are missing for too long."""


class ObjectLostError(TwosraError):
    """An object is not where it was held or put."""


Trouble = SegmentError | DoubtError | TooNearError | AstrayError | UnseenError | ObjectLostError

_LOOK_PERIODS = 3  # of the camera, between two looks at a robot at rest
_LOOK, _LOOK_S = 0.15, 3.0  # at what may not bend: of a frame's deviation, and for so long
_LOOK_AGAIN = 0.07  # the same before it is doubted; four times as many frames take as much longer
_STOPPED_S = 1.0  # a robot that was stopped is looked at for so long


class Activity(Protocol):
    """Activity of a controller; a value."""

    def advance(self) -> Next:
        """The next command, or what to do instead."""


Next = Command | Activity | Verdict


class Policy(Protocol):
    """Policy of a run: a plan is followed or played, or the greedy rule decides."""

    during: str
    longest_s: float

    def begin(self) -> Activity:
        """First activity."""

    def troubled(self, trouble: Trouble) -> Next:
        """Answer to a trouble; the robot stands."""

    def verdict(self, ending: Ending, reason: str) -> Verdict:
        """An ending of the run."""


@dataclass(eq=False)
class Looking:
    """A look at the resting robot, until enough is known or time is up.

    Attributes:
        belief: What is known of the robot.
        enough: True once enough is known.
        at_most_s: How long to look.
        then: What follows.
    """

    belief: Belief
    enough: Callable[[], bool]
    at_most_s: float
    then: Callable[[], Next]

    def __post_init__(self) -> None:
        self._end_s = self.belief.now_s + self.at_most_s
        self._stiffness = self.belief.reading.stiffness

    def advance(self) -> Next:
        """Stand, until then."""
        belief = self.belief
        over = belief.now_s >= self._end_s - 1e-9
        if over or self.enough() or belief.reading.stiffness != self._stiffness:
            return self.then()
        period_s = _LOOK_PERIODS * belief.camera.period_s
        return rest(belief, belief.setpoint_C, period_s, belief.command)


def _never() -> bool:
    """All of the time is looked."""
    return False


def look_once_stopped(belief: Belief, then: Callable[[], Next]) -> Looking:
    """A look at a robot that was stopped, when it has come to rest."""
    return Looking(belief, _never, _STOPPED_S, then)


def look_at_objects(belief: Belief, then: Callable[[], Next]) -> Next:
    """A look at objects alone, if there are any."""
    if belief.objects is None:
        return then()
    belief.objects.forget()
    return Looking(belief, _never, belief.patience.objects_s, then)


def look_at_robot(belief: Belief, then: Callable[[], Next]) -> Looking:
    """A look at where the robot has come to."""
    patience, accuracy = belief.patience, belief.accuracy.scale(belief.problem.robot.coordinates)
    enough = partial(belief.certain, patience.certain * accuracy)
    return Looking(belief, enough, patience.look_s, then)


def rest(
    belief: Belief, setpoint_C: Array, at_most_s: float, along: Course | Command | None = None
) -> Command:
    """A command to stand: along a course, or where the plan was, and what is soft stays so."""
    if along is None:
        return Command(setpoint_C, at_most_s, planned=belief.command.planned)
    return Command(setpoint_C, at_most_s, planned=along.planned, soft_for_s=along.soft_for_s)


@public
class Controller:
    """A controller: ``step`` takes a reading and gives a command, until there is a verdict.

    Attributes:
        belief: What is known of the robot.
        policy: What it does.
        verdict: How and why the run has ended; None while it goes on.
    """

    def __init__(self, belief: Belief, policy: Policy) -> None:
        """Begin with a robot of which nothing has been read."""
        self.belief, self.policy = belief, policy
        self.verdict: Verdict | None = None
        self._activity: Activity | None = None

    def step(self, reading: Reading) -> Command:
        """Take in a reading and say what the robot is to do.

        Args:
            reading: What has become known since the last command.

        Returns:
            What to send at once; the next reading is due after ``at_most_s``. Once there is a
            verdict: to stand, heaters off.

        Raises:
            InputError: If the reading is of another robot.
            RobotError: If the robot cannot be driven any more.
        """
        belief = self.belief
        if self.verdict is not None:
            return self._off
        try:
            belief.take(reading)
            activity: Next = self._activity or self.policy.begin()
            if belief.now_s > (longest_s := self.policy.longest_s):
                words = f"the run has taken more than {longest_s:z.0f} s"
                activity = self.policy.verdict(Ending.TIME_LIMIT, words)
            elif belief.doubt is not None and belief.doubtful:
                activity = _Suspicion(belief, belief.doubt, activity).look()
        except (SegmentError, DoubtError) as trouble:
            activity = self._troubled(trouble)
        if belief.uncertain:  # standing costs nothing
            return belief.give(rest(belief, belief.setpoint_C, belief.camera.period_s))
        return self._carry_out(activity)

    def _carry_out(self, activity: Next) -> Command:
        while not isinstance(activity, Verdict):
            try:
                if isinstance(activity, Command):
                    return self.belief.give(activity)
                self._activity = activity
                activity = activity.advance()
            except get_args(Trouble) as trouble:
                activity = self._troubled(trouble)
        self.verdict = activity
        self.belief.tell("end", activity.reason)
        return self.belief.give(self._off)

    def _troubled(self, trouble: Trouble) -> Next:
        """Stand, and look where that is, before anything is done about a trouble."""
        belief, policy = self.belief, self.policy
        if isinstance(trouble, TooNearError):
            return look_once_stopped(belief, partial(policy.troubled, trouble))
        if isinstance(trouble, DoubtError):
            belief.doubt_segments(trouble.segments)
        return policy.troubled(trouble)

    @property
    def _off(self) -> Command:
        """Wheels stand, heaters are off."""
        belief = self.belief
        off_C = np.full_like(belief.setpoint_C, belief.problem.robot.heater.rigid_setpoint_C)
        return Command(off_C, belief.camera.period_s)


@dataclass(eq=False)
class _Suspicion:
    """Looks at a robot that may not bend, before it is judged.

    Attributes:
        belief: What is known of the robot.
        doubt: About its bends.
        then: What goes on if it bends.
    """

    belief: Belief
    doubt: Doubt
    then: Next

    def look(self) -> Activity:
        """A short look."""
        return self._looking(_LOOK, _LOOK_S, self._looked)

    def _looked(self) -> Next:
        if self.doubt.look(self.belief.seen_at_rest()):
            return self._judged()
        return self._looking(_LOOK_AGAIN, 4 * _LOOK_S, partial(self._judged, again=True))

    def _judged(self, again: bool = False) -> Next:
        if again:
            self.doubt.look_again(self.belief.seen_at_rest())
        self.doubt.judge(self.belief.now_s, self.belief.known)
        return self.then

    def _looking(self, share: float, at_most_s: float, then: Callable[[], Next]) -> Activity:
        belief = self.belief
        frame = np.sqrt(belief.camera.variance(belief.problem.robot.coordinates))
        return Looking(belief, partial(belief.certain, share * frame), at_most_s, then)
