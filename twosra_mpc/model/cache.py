"""Compiled functions, kept by what they depend on: robots of one body share them.

What is compiled for a robot weighs 3 MiB, so it is kept of few robots at a time: a process that
plans for thousands of them holds no more than one that plans for these few.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial, update_wrapper
from typing import Concatenate, ParamSpec, TypeVar
from weakref import ref

import casadi as ca

from twosra_mpc.effort import remembered
from twosra_mpc.robot.description import Body, Robot

Arguments = ParamSpec("Arguments")
Made = TypeVar("Made")

_OfBody = Callable[Concatenate[Body, Arguments], Made]
_OfRobot = Callable[Concatenate[Robot | Body, Arguments], Made]
_OfFunction = Callable[Concatenate[ca.Function, Arguments], Made]

BODIES = 6  # whose functions are kept: more than are compared in one go, and 20 MiB


def per_body(
    each: int = 1, bodies: int = BODIES
) -> Callable[[_OfBody[Arguments, Made]], _OfRobot[Arguments, Made]]:
    """Keep what a function makes of a body and further arguments; call it with a robot or a body.

    It is kept of the last ``bodies`` bodies, of each for its last ``each`` further arguments.

    Compiling takes a hundred times as long as planning, and a robot that differs in its name or its
    heat moves like the other one.
    """

    def decorate(make: _OfBody[Arguments, Made]) -> _OfRobot[Arguments, Made]:
        @lru_cache(bodies)
        def kept(body: Body) -> Callable[Arguments, Made]:
            return remembered(each)(partial(make, body))

        def of_robot(
            robot: Robot | Body, /, *args: Arguments.args, **kwargs: Arguments.kwargs
        ) -> Made:
            return kept(robot.body)(*args, **kwargs)

        return update_wrapper(of_robot, make)

    return decorate


def per_function(
    each: int = 1,
) -> Callable[[_OfFunction[Arguments, Made]], _OfFunction[Arguments, Made]]:
    """Keep what is made of a function and its last ``each`` further arguments, while it lives."""

    def decorate(make: _OfFunction[Arguments, Made]) -> _OfFunction[Arguments, Made]:
        kept: dict[int, tuple[ref[ca.Function], Callable[Arguments, Made]]] = {}  # by identity

        def of_function(
            function: ca.Function, /, *args: Arguments.args, **kwargs: Arguments.kwargs
        ) -> Made:
            name = id(function)
            if name not in kept:
                same = ca.Function(function)  # another name of it, so that this one is let go
                own: Callable[Arguments, Made] = lru_cache(each)(partial(make, same))  # type: ignore[assignment]
                kept[name] = ref(function, lambda _: kept.pop(name)), own
            return kept[name][1](*args, **kwargs)

        return update_wrapper(of_function, make)

    return decorate
