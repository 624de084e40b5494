"""Planning in a thread, for robots that must be told again and again to stand meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable

from twosra_mpc.arguments import public
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem

_JOIN_S = 0.01


@public
class ThinkAside:
    """Plans in a thread of its own, so that a robot is told again and again to stand meanwhile.

    An interrupt, or trouble with the robot, leaves the computation behind.
    """

    def __init__(self, plan: Callable[[Problem], Result]) -> None:
        """Nothing is being planned.

        Args:
            plan: Plans a problem.
        """
        self._plan = plan
        self._thread: threading.Thread | None = None
        self._made: list[Result] = []
        self._failures: list[BaseException] = []

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self._plan,))  # whoever goes on asks again

    def __call__(self, problem: Problem) -> Result | None:
        """The result for a problem, or None while it is being planned: ask again."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._compute, args=(problem,), daemon=True)
            self._thread.start()
        self._thread.join(_JOIN_S)
        if self._thread.is_alive():
            return None
        self._thread = None
        if self._failures:
            raise self._failures.pop()
        return self._made.pop()

    def _compute(self, problem: Problem) -> None:
        try:
            self._made.append(self._plan(problem))
        except BaseException as error:
            self._failures.append(error)
