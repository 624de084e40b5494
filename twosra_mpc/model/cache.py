"""Compiled functions, kept by what they depend on: robots of one body share them."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, update_wrapper
from typing import Concatenate, ParamSpec, TypeVar

from twosra_mpc.robot.description import Body, Robot

Arguments = ParamSpec("Arguments")
Made = TypeVar("Made")


def per_body(
    maxsize: int,
) -> Callable[
    [Callable[Concatenate[Body, Arguments], Made]],
    Callable[Concatenate[Robot | Body, Arguments], Made],
]:
    """Keep what a function makes of a body and further arguments; call it with a robot or a body.

    Compiling takes a hundred times as long as planning, and a robot that differs in its name or its
    heat moves like the other one.
    """

    def decorate(
        make: Callable[Concatenate[Body, Arguments], Made],
    ) -> Callable[Concatenate[Robot | Body, Arguments], Made]:
        kept = lru_cache(maxsize)(make)

        def of_robot(
            robot: Robot | Body, /, *args: Arguments.args, **kwargs: Arguments.kwargs
        ) -> Made:
            return kept(robot.body, *args, **kwargs)  # type: ignore[arg-type]  # hashable arguments

        return update_wrapper(of_robot, make)

    return decorate
