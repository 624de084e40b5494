"""Reasons for reshaping among obstacles: obstacles that block a shape, and places with room.

That a shape is blocked is proved on a superset of where it can be. An obstacle is to blame if the
proof fails without it alone.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twosra_mpc.planning.solver.block import Block, Sweep
from twosra_mpc.planning.stages.necessity import (
    HEADINGS,
    Necessity,
    last_shape,
    same_shape,
    unit_without_way,
)
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.plans.trajectory import Phase
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.robot.modes import (
    RIGID,
    SOFT_BOTH,
    ModeSequence,
    blocks_of,
    is_rigid,
    sequence_name,
)
from twosra_mpc.space.footprint import Footprint, footprint, kept_m
from twosra_mpc.space.separation import Separation

if TYPE_CHECKING:  # it imports shapely
    from twosra_mpc.space.possible import Box

_MOST_OBSTACLES = 10  # each needs a proof of its own
_ROOM_M, _PLACES = 0.2, 200  # places are 25 mm apart, half a unit
_NODES = 40  # of a phase

Proof = Callable[[Problem], bool]


class Blockage(NamedTuple):
    """Motion that is proved to be blocked, and by what.

    Attributes:
        words: What cannot be done.
        obstacles: Names of those without any one of which the proof fails; none: several together,
            or the edges of the workspace.
    """

    words: str
    obstacles: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.words}: proved blocked {_at(self.obstacles)}"


class Place(NamedTuple):
    """Place where a plan reshapes.

    Attributes:
        modes: Of its soft phases.
        begin: Pose of b0 as it begins, (3,) [m, m, rad].
        end: Pose of b0 as it ends, (3,).
        room: Share of the positions within 0.2 m of its beginning from which the same bending at
            the same heading keeps the clearance.
    """

    modes: ModeSequence
    begin: Array
    end: Array
    room: float

    def __str__(self) -> str:
        here, there = (
            f"({x:z.3f}, {y:z.3f}) m, {math.degrees(phi):z.0f} deg"
            for x, y, phi in (self.begin, self.end)
        )
        share = f"{100 * self.room:z.0f} % of the places within {_ROOM_M:zg} m"
        return f"{sequence_name(self.modes)} from {here} to {there}: room for it at {share}"


@dataclass(frozen=True, eq=False)
class Reshaping:
    """Reasons for which a plan reshapes, or cannot, and places.

    Attributes:
        why: Reasons, in sentences.
        blocked: What is proved blocked; its words are among the reasons.
        places: Where the plan reshapes.
    """

    why: tuple[str, ...]
    blocked: tuple[Blockage, ...]
    places: tuple[Place, ...]


def reshaping(result: Result) -> Reshaping:
    """Reasons for which a plan among obstacles reshapes; what blocks it, where there is none."""
    problem, made = result.problem, result.plan
    if made is not None and not made.transitions:
        return Reshaping((), (), ())
    blocked = tuple(_blockages(problem))
    why = [str(each) for each in blocked]
    if made is not None:
        why += _other_reasons(problem, made, bool(blocked))
    return Reshaping(tuple(why), blocked, () if made is None else tuple(_places(made)))


def _other_reasons(problem: Problem, made: Plan, proved: bool) -> Iterator[str]:
    if not proved and same_shape(problem):
        yield "no drive in this shape was found; that there is none is not proved"
    elif not proved:
        free = "no obstacle is proved to block the start's or the goal's"
        yield f"the goal asks for another shape; {free}"
    if blocks_of(made.sequence) > 1:
        necessity = Necessity(problem)
        necessity.proves_impossible((RIGID, SOFT_BOTH, RIGID))
        unknown = "one reshaping was not found to be enough; that it is not is not proved"
        yield necessity.words if necessity.needed > 1 else unknown


def _blockages(problem: Problem) -> Iterator[Blockage]:
    """Proved blockages: of a unit whatever the shape, else of drives in the shapes of both ends."""
    unit = unit_without_way(problem)
    if unit is not None:
        words = f"locomotion unit {unit} has no way there"
        yield Blockage(words, _to_blame(problem, lambda one: unit_without_way(one) is not None))
        return
    for words, blocked in _drives(problem):
        for headings in HEADINGS:
            if blocked(headings, problem):
                yield Blockage(words, _to_blame(problem, partial(blocked, headings)))
                break


def _drives(problem: Problem) -> Iterator[tuple[str, Callable[[int, Problem], bool]]]:
    """Drives that would do, or all but do, with one shape; and whether one is proved blocked.

    Where the shapes differ, b0 moves on by ``soft_travel_m`` at most while it reshapes, and may
    turn by any angle.
    """
    if not problem.start_stiffness == problem.goal.mode == problem.robot.rigid:
        return
    geometry, start = problem.robot.geometry, problem.start.configuration
    own, here = footprint(geometry, start[POSE:]), (start[:POSE], start[:POSE])
    low, high = problem.goal.box(start)
    there = (low[:POSE], high[:POSE])
    if same_shape(problem):
        yield "no drive in this shape", _blocks(own, here, there)
        return
    travel = np.array([problem.robot.limits.soft_travel_m] * 2 + [np.inf])
    near_start, near_goal = ((one - travel, other + travel) for one, other in (here, there))
    yield "the start's shape does not get to the goal", _blocks(own, here, near_goal)
    last = last_shape(problem)
    if last is not None:
        yield "the goal's shape does not get there from the start", _blocks(last, near_start, there)


def _blocks(shape: Footprint, here: Box, there: Box) -> Callable[[int, Problem], bool]:
    """Proof, from what is around, that no drive joins a box of poses to another one."""

    def proved(headings: int, problem: Problem) -> bool:
        from twosra_mpc.space.possible import apart  # they import shapely
        from twosra_mpc.space.slices import possible_slices

        world, start = problem.world, problem.start.configuration
        kept = kept_m(world, problem.robot.geometry)
        own = footprint(problem.robot.geometry, start[POSE:])
        kept = Separation(own, world, kept).kept_from_m(start[None, :POSE])
        return apart(possible_slices(shape, world, kept, headings), here, there)

    return proved


def _to_blame(problem: Problem, proof: Proof) -> tuple[str, ...]:
    """Names of the obstacles without which, one at a time, a proof fails; near ones are tried."""
    found = []
    for i in _nearest(problem):
        others = (*problem.obstacles[:i], *problem.obstacles[i + 1 :])
        if not proof(problem.with_values(obstacles=others)):
            found.append(i)
    return tuple(problem.world.names[i] for i in sorted(found))


def _nearest(problem: Problem) -> list[int]:
    """The obstacles nearest to the robot as it would be on the straight way to the goal."""
    start = problem.start.configuration
    poses = np.linspace(start[:POSE], problem.goal.aim(start)[:POSE], 40)
    shape = footprint(problem.robot.geometry, start[POSE:])
    alone = [World(obstacles=(one,)) for one in problem.obstacles]
    far = [float(Separation(shape, one, 0.0).distances(poses).min()) for one in alone]
    return sorted(range(len(far)), key=far.__getitem__)[:_MOST_OBSTACLES]


def _at(names: tuple[str, ...]) -> str:
    if not names:
        return "by several obstacles together, or by the edges of the workspace"
    if len(names) == 1:
        return f"at {names[0]}"
    return f"at {', '.join(names[:-1])} and {names[-1]}; with one of them away it is not"


def _places(made: Plan) -> Iterator[Place]:
    for rigid, phases in itertools.groupby(made.phases, key=lambda phase: is_rigid(phase.mode)):
        if not rigid:
            yield _place(made, list(phases))


def _place(made: Plan, phases: list[Phase]) -> Place:
    times = [np.linspace(phase.start_s, phase.end_s, _NODES) for phase in phases]
    q = made.trajectory.at(np.concatenate(times)).q
    begin, end = q[0, :POSE], q[-1, :POSE]
    nodes = np.hstack([composed(inverse(begin), q[:, :POSE]), q[:, POSE:]])
    sweep = Sweep(Block(np.zeros((0, 0, 5)), nodes), made.robot, made.problem.world)
    around = np.arange(_PLACES)
    radius, angle = _ROOM_M * np.sqrt((around + 0.5) / _PLACES), around * math.pi * (3 - 5**0.5)
    poses = begin + np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
    room = sum(map(sweep.clear, poses[sweep.may_be_clear(poses)])) / _PLACES
    return Place(tuple(phase.mode for phase in phases), begin, end, room)
