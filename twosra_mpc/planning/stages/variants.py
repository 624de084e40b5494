"""The ways to do the stages of a problem: in which order, with which touch of each object.

A touch gives a shape and a place at its object. Ways with the same shapes are one variant: the
search tells variants apart, and within one the places are tried, the nearest ones first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, OutOfEffortError, charge, out_of_effort, remembered
from twosra_mpc.model.flow import twists
from twosra_mpc.planning.stages.along import BEGUN_RAD, Along
from twosra_mpc.problem.goals import Goal, GoalSet, Tolerance
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Pass, Stage, orders
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.space.footprint import SAGITTA_M

if TYPE_CHECKING:
    from twosra_mpc.contact.grip import Pulls, PushingCone
    from twosra_mpc.planning.stages.handling import Handling

May = Callable[[Array], NDArray[np.bool_]]  # twists (m, 3) -> which of them drives may have

_TOUCHING_SAGITTA_M = 1e-4
_EASILY = 1.1  # times the least pull along a path, and on the way to it


@dataclass(frozen=True, eq=False)
class Placement:
    """One way to do a stage; boxes to pass belong to what follows them.

    Attributes:
        stage: What is asked.
        goal: Shapes to end in and, where there are no ``ends``, the poses.
        world: Surroundings of the robot.
        passes: Boxes to pass on the way.
        ends: Poses of b0 to end in, one of these, (m, 3); None: those of the goal.
        within_m: How far from one of these any other end is that the task allows, at most.
        held: Convex pieces of what is carried, in b0, (pieces, 4, 2).
        drives_first: Whether it may begin with a drive.
        drives_last: Whether it may drive once it has its last shape.
        reshapes: Whether it must reshape, as is proved.
        openings: Goals that may do instead, as this one does not say how far to bend.
        entries: Shapes from which it gets around what it grasps, as far open as ``openings``.
        away: Surroundings at its end; those of all of it where None.
        cone: Twists in which friction keeps what is held; None: all.
        along: The one drive that it is, where it follows a path.
        pulls: What wheels pull for what is held, over that one's friction.
        most: What they can pull, likewise; inf: nobody knows.
        via: Poses of b0 on the way to its end, (m, 3).
    """

    stage: Stage
    goal: GoalSet
    world: World
    passes: tuple[Pass, ...] = ()
    ends: Array | None = None
    within_m: float = 0.0
    held: Array = field(default_factory=lambda: np.zeros((0, 4, 2)))
    drives_first: bool = True
    drives_last: bool = True
    reshapes: bool = False
    openings: tuple[GoalSet, ...] = ()
    entries: tuple[Goal, ...] = ()
    away: World | None = None
    cone: PushingCone | None = None
    along: Along | None = None
    pulls: Pulls | None = None
    most: float = math.inf
    via: Array = field(default_factory=lambda: np.zeros((0, POSE)))

    @property
    def reaches(self) -> bool:
        """True if it ends in any pose and shape of its goal."""
        return self.ends is None and self.away is None

    @property
    def may(self) -> May | None:
        """Twists (m, 3) -> which of them drives may have; None: all."""
        pulls, cone = self.pulls, self.cone
        if pulls is None or (cone is None and math.isinf(self.most)):
            return None
        return lambda t: (pulls(t) <= self.most) & (True if cone is None else cone.holds(t))

    @property
    def sagitta_m(self) -> float:
        """By which what is drawn around the robot may stray from it."""
        return _TOUCHING_SAGITTA_M if self.stage.touches else SAGITTA_M

    def box(self, near: Array) -> tuple[Array, Array]:
        """(low, high) of a box that holds every end that counts, next to ``near``, (3 + n,)."""
        low, high = self.goal.box_met(near)
        if self.ends is not None:
            low[:POSE], high[:POSE] = self.ends.min(axis=0), self.ends.max(axis=0)
            low[:2], high[:2] = low[:2] - self.within_m, high[:2] + self.within_m
        return low, high


@dataclass(frozen=True, eq=False)
class Variant:
    """Ways to solve a problem with the same shapes.

    Attributes:
        problem: The problem with its tasks in the order of the variant.
        members: The stages of each way, the shortest one first.
        easy: Those in which wheels pull easily: plans are looked for here, bounds hold for all.
    """

    problem: Problem
    members: tuple[tuple[Placement, ...], ...]
    easy: tuple[tuple[Placement, ...], ...]

    def reaching(self, stage: Placement) -> Problem:
        """The problem of coming from the start to the goal of a stage alone."""
        problem = self.problem
        if stage.goal is problem.goal and stage.passes == problem.tasks and not problem.objects:
            return problem
        start, around = problem.start.with_values(holding=None), stage.world.obstacles
        asked = {"goal": stage.goal, "tasks": stage.passes}
        return problem.with_values(start=start, **asked, objects=(), obstacles=around)

    @cached_property
    def aimed(self) -> Variant:
        """The same with the goals that plans are looked for in first, narrower than all of them."""
        if not any(stage.openings for stage in self.members[0]):
            return self
        members = tuple(
            tuple(
                replace(stage, goal=goal)
                for stage, goal in zip(stages, next(goals_of(stages)), strict=True)
            )
            for stages in self.members
        )
        return replace(self, members=members)


def goals_of(stages: Sequence[Placement]) -> Iterator[tuple[GoalSet, ...]]:
    """Goals of the stages; those that do not say how far to bend ask for more and more.

    What is opened just before something is grasped is opened for that, too.
    """
    count = max((len(stage.openings) + 1 for stage in stages if stage.openings), default=1)
    for k in range(count):
        found = list[GoalSet]()
        for stage, then in zip(stages, [*stages[1:], None], strict=True):
            opened = [stage.goal, *stage.openings][min(k, len(stage.openings))]
            if stage.openings and then is not None and then.entries:
                opened = _in_both(opened, then.entries[min(k, len(then.entries) - 1)])
            found.append(opened)
        yield tuple(found)


def _in_both(opened: GoalSet, entry: GoalSet) -> GoalSet:
    """The shapes of two sets; those of the first, where there are none."""
    nothing = np.zeros(POSE + len(opened.mode))
    (low, high), (least, most) = opened.box(nothing), entry.box(nothing)
    low, high = np.maximum(low, least)[POSE:], np.minimum(high, most)[POSE:]
    if (low > high).any():
        return opened
    free = ~np.isfinite(high - low)
    middle = [None if f else m for f, m in zip(free, ((low + high) / 2).tolist(), strict=True)]
    width = np.where(free, 0.0, (high - low) / 2)
    return Goal(kappa_per_m=tuple(middle), tolerance=Tolerance(kappa_per_m=tuple(width.tolist())))


_OVERLAP_M = 4e-4  # with what is touched, of what is drawn around the robot


class Hold(NamedTuple):
    """Hold of an object: its number, the robot's shape, its pose in b0, and how far it may get.

    That is infinite where no cage is proved.
    """

    number: int
    kappa: Array
    pose_in_b0: Array
    room_m: float

    @property
    def caged(self) -> bool:
        """True if it is proved that it cannot leave."""
        return math.isfinite(self.room_m)


class State(NamedTuple):
    """State after what has been done so far.

    Attributes:
        placements: The stages so far.
        poses: Where objects are.
        hold: How one is held.
        passes: Boxes to pass before the next stage ends.
        touches: What may be touched on the way through them.
        key: Shapes that were chosen.
    """

    placements: tuple[Placement, ...]
    poses: tuple[Array, ...]
    hold: Hold | None = None
    passes: tuple[Pass, ...] = ()
    touches: frozenset[str] = frozenset()
    key: tuple[float, ...] = ()

    def after(self, placement: Placement) -> State:
        """State after a stage; boxes to pass belonged to it, and what was held moved."""
        charge(Cost.STAGE)
        placement, poses = replace(placement, passes=self.passes), list(self.poses)
        if (hold := self.hold) is not None:
            ends = placement.ends
            pose = ends[0] if ends is not None else placement.goal.configuration[:POSE]
            poses[hold.number] = composed(pose, hold.pose_in_b0)
        placements = (*self.placements, placement)
        return State(placements, tuple(poses), self.hold, key=self.key)

    def world(self, problem: Problem, touches: frozenset[str] = frozenset()) -> World:
        """Surroundings of the robot; what may be touched is smaller, as much as keeps away."""
        held = None if self.hold is None else self.hold.number
        around = problem.world_with([None if i == held else p for i, p in enumerate(self.poses)])
        if not touches:
            return around
        from twosra_mpc.space.convex import eroded
        from twosra_mpc.space.footprint import kept_m

        off_m = kept_m(around, problem.robot.geometry) + _OVERLAP_M
        kept = list[Obstacle]()
        for thing in around.obstacles:
            kept += eroded(thing, off_m) if thing.name in touches else [thing]
        return around.with_values(obstacles=tuple(kept))


class Ways(NamedTuple):
    """The ways to do a problem.

    Attributes:
        variants: Every variant, the shortest one first.
        refused: Why there are none, or no more, and whether that is proved.
    """

    variants: tuple[Variant, ...]
    refused: dict[str, bool]


@remembered(8)  # the same each time a problem is planned, e.g. without one sequence or another
def ways_of(problem: Problem) -> Ways:
    """Make the variants of a problem.

    Raises:
        OutOfEffortError: If the effort is over first, as no bound holds for some of them.
    """
    found, refused, held = list[Variant](), dict[str, bool](), problem.start.holding
    handling = cache(partial(_handling, problem, refused))
    poses = tuple(item.pose.pose for item in problem.objects)
    begin = State((), poses, None if held is None else handling().at_start())
    for order in [problem.tasks] if problem.order == "given" else orders(problem.tasks, held):
        if found and out_of_effort():
            raise OutOfEffortError
        own = problem.with_values(tasks=order)
        if problem.ends_anywhere and order and (goal := order[-1].as_goal) is not None:
            own = problem.with_values(tasks=order[:-1], goal=goal)  # what comes last is the goal
        states = [begin]
        for stage in own.stages:
            states = [after for at in states for after in _ways(own, stage, at, handling)]
        groups: dict[tuple[float, ...], list[tuple[Placement, ...]]] = {}
        for state in states:
            groups.setdefault(state.key, []).append(state.placements)
        for members in groups.values():
            members.sort(key=partial(_length_m, problem))
            found.append(Variant(own, tuple(members), tuple(_easy(problem, members))))
    found.sort(key=lambda variant: _length_m(problem, variant.members[0]))
    return Ways(tuple(found), refused)


def _handling(problem: Problem, refused: dict[str, bool]) -> Handling:
    from twosra_mpc.planning.stages.handling import Handling  # loads GEOS

    return Handling(problem, refused)


def _ways(
    problem: Problem, stage: Stage, at: State, handling: Callable[[], Handling]
) -> Iterator[State]:
    """Every way to do a stage; a box is left to the stage that follows."""
    stage = replace(stage, touches=stage.touches | at.touches)
    if stage.through is not None:
        yield at._replace(passes=(*at.passes, stage.through), touches=stage.touches)
    elif stage.goal is None:
        yield from handling().ways(stage, at)
    else:
        placed = Placement(stage, stage.goal, at.world(problem, stage.touches))
        yield at.after(handling().holding(placed, at.hold) if at.hold else placed)


def _easy(
    problem: Problem, members: Sequence[tuple[Placement, ...]]
) -> Iterator[tuple[Placement, ...]]:
    """Yield members in which wheels pull least along paths, and on the way to them."""
    eased = [_eased(problem.start.configuration, stages) for stages in members]
    most = _EASILY * min(pull for pull, _ in eased)  # nobody knows what wheels can pull
    yield from (stages for pull, stages in eased if pull <= most)


def _eased(start: Array, stages: tuple[Placement, ...]) -> tuple[float, tuple[Placement, ...]]:
    """Most that a wheel pulls along paths and on the way to them, and stages with an easy way.

    It begins where the stage before may end, or at the start: by one screw, or, where none is easy
    and nothing is around, the robot turns about the object before it carries it and afterwards.
    """
    most, found = 0.0, list(stages)
    for k, stage in enumerate(stages):
        if stage.along is None or (pulls := stage.pulls) is None:
            continue
        most = max(most, float(pulls(stage.along.twists).max()))
        ends = [start[None, :POSE], *(each.ends for each in stages)]
        begun, ending = ends[k - 1], ends[k]
        if k == 0 or begun is None or ending is None or stages[k - 1].pulls is None:
            continue
        (to,) = ending
        direct = pulls(twists(begun, to))
        easily = direct <= _EASILY * max(most, direct.min())
        around = stage.cone or stage.world.obstacles or stage.world.workspace  # in its way
        if direct.min() > _EASILY * most and not around:
            easily = np.arange(len(begun)) == direct.argmin()
            via = turning(pulls, begun[direct.argmin()], to)
            way = np.vstack([begun[easily], via, to])
            direct = pulls(twists(way[:-1], way[1:])).max(keepdims=True)
            found[k - 1] = replace(stages[k - 1], via=via)
        most = max(most, float(direct.min()))
        if k > 1:
            found[k - 2] = replace(stages[k - 2], ends=begun[easily])
    return most, tuple(found)


def turning(pulls: Pulls, begin: Array, end: Array) -> Array:
    """Poses of b0 between which an object is carried easily, about which it turns before and after.

    That is from where it is with b0 at one pose (3,) to where it is with b0 at another, (2, 3).
    """
    at = composed(np.array([begin, end])[:, None], pulls.pose_in_b0)
    at = np.repeat(at, len(BEGUN_RAD), axis=1)
    at[:, :, 2] = BEGUN_RAD + pulls.pose_in_b0[2]
    first, last = composed(at, inverse(pulls.pose_in_b0))
    legs = twists(begin, first), twists(first, last), twists(last, end)
    pull = np.max([pulls(each) for each in legs], axis=0)
    turned = np.abs(legs[0][:, 2]) + np.abs(legs[2][:, 2])
    best = np.where(pull <= _EASILY * pull.min(), turned, np.inf).argmin()
    return np.array([first[best], last[best]])


def _length_m(problem: Problem, stages: Sequence[Placement]) -> float:
    """About how far the robot drives."""
    here, far = problem.start.configuration[None, :POSE], 0.0
    for stage in stages:
        if stage.ends is not None:
            apart = np.linalg.norm(here[:, None, :2] - stage.ends[None, :, :2], axis=-1)
            far += stage.along.length_m if stage.along else float(apart.min())
            here = stage.ends
    return far
