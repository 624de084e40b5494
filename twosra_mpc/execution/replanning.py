"""Planning what is left of a problem again, once nothing of the robot is changing any more."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.execution.controller import Activity, Looking, Next, rest
from twosra_mpc.execution.remaining import remaining_problem
from twosra_mpc.execution.run import Ending
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode

if TYPE_CHECKING:
    from twosra_mpc.execution.following import Following

_MISSES = 1  # of a mode of several segments that are planned again in the same


class Replanning:
    """The robot stands until metal rests, objects are looked at, and the rest is planned.

    Each segment goes on to what it was becoming, or all of them become solid.
    """

    def __init__(self, run: Following) -> None:
        """Leave a plan."""
        self._run, self._belief = run, run.belief
        self._cooled, self._until_s, self._told = set[int](), self._belief.now_s, False

    def begin(self, *, melting_on: bool = False, cooling: bool = False) -> Activity:
        """Let metal come to rest.

        Args:
            melting_on: Hold what is soft for a while, so that all of it melts.
            cooling: Let all segments become solid.
        """
        if melting_on:
            self._until_s += self._run.melt_on_s()
        return self._cool() if cooling else self

    def _cool(self) -> Activity:
        self._cooled = set(range(len(self._belief.setpoint_C)))
        return self

    def advance(self) -> Next:
        """Stand until metal rests, and look at objects."""
        run, belief, settings = self._run, self._belief, self._run.settings
        mode, solid = belief.mode, run.broken | self._cooled
        changing = mode is None or any(mode[j] for j in solid)
        if changing and belief.now_s > settings.longest_s:  # one that is slow: see `SegmentWatch`
            words = f"the run has taken more than {settings.longest_s:z.0f} s"
            return run.verdict(Ending.TIME_LIMIT, words)
        if changing or belief.now_s < self._until_s or not self._told:
            self._told = True  # to stand
            return rest(belief, self._as_they_become(), settings.patience.rest_s)
        if run.mission.holding is not None and any(mode or ()):  # no soft robot holds anything
            return self._cool()
        if belief.objects is None:
            return self._plan()
        belief.objects.forget()
        never = np.zeros_like(belief.q)
        return Looking(belief, never, settings.patience.objects_s, self._plan)

    def _plan(self) -> Next:
        run, belief, mode = self._run, self._belief, self._belief.mode
        if mode is None:  # it began to change during the look
            return self
        try:
            rest_of_it = remaining_problem(
                *run.mission.rest(),
                belief.reading.temperature_C,
                mode,
                run.broken,
                misses=len(run.missed),
                avoided=self._avoided,
            )
        except InputError as error:
            return self._failed(str(error))
        return _Thinking(self, rest_of_it)

    def planned(self, problem: Problem) -> Next:
        """Ask for a plan; stand as long as that takes."""
        run, belief = self._run, self._belief
        try:
            result = run.think(problem)
        except InputError as error:
            return self._failed(str(error))
        if result is None:
            return rest(belief, self._as_they_become(), run.patience.rest_s)
        return self._failed(result.message) if result.plan is None else run.adopt(result.plan)

    def _failed(self, why: str) -> Next:
        """Try what may help before it is said that there is no plan."""
        run, belief = self._run, self._belief
        if belief.guard is not None and any(belief.mode or ()):
            return self._cool()  # a solid robot may drive to where it can bend
        if run.missed:
            run.missed.clear()  # any plan is better than none
            return self
        return run.no_plan(why)

    @property
    def _avoided(self) -> set[Mode]:
        """Modes of several segments whose bends have missed before: these bend one by one."""
        several = {mode for mode in self._run.missed if sum(mode) > 1}
        return {mode for mode in several if self._run.missed.count(mode) > _MISSES}

    def _as_they_become(self) -> Array:
        """Set-points that let every segment become, or stay, what it is becoming, (n,)."""
        belief, heater = self._belief, self._belief.problem.robot.heater
        solid = self._run.broken | self._cooled
        becoming = []
        for segment, now in enumerate(belief.reading.stiffness):
            asked = belief.setpoint_C[segment] >= heater.soft_setpoint_C
            soft = now == "soft" or (now == "changing" and asked)
            becoming.append(soft and segment not in solid)
        return np.where(becoming, heater.soft_setpoint_C, heater.rigid_setpoint_C)


class _Thinking:
    """A robot that stands while the rest is planned."""

    def __init__(self, replanning: Replanning, problem: Problem) -> None:
        self._replanning, self._problem = replanning, problem

    def advance(self) -> Next:
        return self._replanning.planned(self._problem)
