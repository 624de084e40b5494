"""A problem's tasks on their way: which are done, what is held, and where the objects are.

Tasks count as done by what the camera sees when their time has come; boxes that are passed on the
way to one goal have no time of their own, and count by the path. A robot whose camera sees no
objects is taken to hold what it has closed around, and to leave it where it opens.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from twosra_mpc.checking.followed import follower
from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import AstrayError, ObjectLostError, UnseenError
from twosra_mpc.execution.guard import Guard, cage_of, fitted
from twosra_mpc.plans.carried import Carried, carried
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import SAME_TIME_S
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import (
    Carry,
    Follow,
    Grasp,
    Pass,
    Release,
    Task,
    carries,
    follows,
    grasps,
    part_in_b0,
    passes,
    put,
)
from twosra_mpc.problem.world import ACCURACY, Object
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse, rotation, wrapped

HOLD_M = 0.010  # an object that is held is no farther from where it was, or what the cage leaves
_CARRIED_SHARE = 0.5  # of `ACCURACY`: the release may add to it
_SURELY = 3.0  # standard deviations within which an object is where it is seen
_LOOSER_M = 1e-3  # than a cage as it is seen
_AHEAD = 4.0  # times a path's tolerance, that progress may gain from one reading to the next
_ANY = np.zeros((0, POSE))  # facets of the cone of all twists
_LOOKS = 2  # at the end of a carry before `ACCURACY` itself is enough


class Mission:
    """Mission as far as it is done, and what the robot holds.

    Attributes:
        rests: Whether tasks end at rest or are about objects: then it matters where a robot bends.
        done_s: When tasks were done.
        done_before: How many, before the plan that is followed.
        lost: How often each object was lost.
        trouble: What was lost last and not grasped since, in words; empty if nothing.
    """

    def __init__(self, belief: Belief, plan: Plan) -> None:
        """Begin with a plan of all tasks."""
        self.belief, self.problem = belief, plan.problem
        tasks, self.done_s = self.problem.tasks, list[float]()
        self.rests = bool(self.problem.objects) or any(task.rests for task in tasks)
        self.lost: Counter[str] = Counter()
        self.trouble = ""
        self._goals: dict[str, Carry] = {}
        self._put_at: tuple[Array, Array] | None = None  # object and b0 before the last release
        self._asked: dict[Task, Task] = {}  # as planned: as asked
        self._looks = 0  # at the end of this carry
        self._cone = _ANY
        self._drags: dict[str, Array] = {}  # how its release moves an object, in b0, (2,) [m]
        self._numbers = {item.name: i for i, item in enumerate(self.problem.objects)}
        self.begin(plan)

    def begin(self, plan: Plan) -> None:
        """Go on with a plan of what is left."""
        self.plan = plan
        self._left = tuple(self._asked.get(task, task) for task in plan.problem.tasks)
        self._ends = list(plan.trajectory.done_s) if self.rests else []
        self._grips = list(carried(plan.trajectory))
        self.done_before = len(self.done_s)
        self._hold: Carried | None = None
        self._path = [self.belief.q]
        if plan.problem.start.holding is not None:
            self._hold = self._grips.pop(0)
            self._closed_round(self._hold, self._hold.pose_in_b0)
        self._open_before_release()
        self._watch(None)

    @property
    def left(self) -> tuple[Task, ...]:
        """Tasks that are left, in order."""
        if self.rests:
            return self._left
        return tasks_left(tuple(passes(self._left).values()), np.array(self._path))

    @property
    def holding(self) -> str | None:
        """Name of the object that a plan made now has to start with."""
        if self._hold is not None:
            return self.problem.objects[self._hold.object].name
        first = self._left[0] if self._left else None
        return first.about if first is not None and first.lets_go else None

    @property
    def matters_s(self) -> float:
        """Time of the plan up to which shapes count: the next one that is asked for; inf: none."""
        for task, end_s in zip(self._left, self._ends, strict=False):
            if task.asks_shape and not task.closes:
                return end_s
        return math.inf

    @property
    def closes(self) -> bool:
        """True if the robot closes round an object: which decides what shape it can take."""
        return any(task.closes for task in self._left[:1])

    @property
    def pulls(self) -> bool:
        """True if what is held is led along a path."""
        return self._hold is not None and any(map(self._leads, self._left[:1]))

    @property
    def pushing(self) -> Array:
        """Facets of the cone of twists that keep what is pushed, (f, 3); none: nothing is."""
        return _ANY if self._hold is None else self._cone

    @property
    def ends_on_path(self) -> bool:
        """True if the last task is a path: its end is as near as its tolerance says."""
        return any(map(self._leads, self._left[-1:]))

    def ends_between(self, first_s: float, last_s: float) -> bool:
        """True if a task other than a path is done in a stretch of the plan."""
        ends = zip(self._left, self._ends, strict=False)
        others = (end_s for task, end_s in ends if not self._leads(task))
        return any(first_s < end_s <= last_s + SAME_TIME_S for end_s in others)

    def _leads(self, task: Task) -> bool:
        return task.stage(self.problem.modes).follows is not None

    def see(self) -> None:
        """Note where the robot is: boxes that are passed count by the path."""
        self._path.append(self.belief.q)

    def due(self, clock_s: float) -> Task | None:
        """The next task, if its time in the plan has come."""
        return self._left[0] if self._ends and self._ends[0] <= clock_s + SAME_TIME_S else None

    def judge(self) -> None:
        """Judge the task that is due; at one that ends at rest, objects were looked at.

        Raises:
            UnseenError: If it ends at rest, and nothing sees the robot.
            AstrayError: If it is not done.
            ObjectLostError: If its object is not where it was held or put.
        """
        task = self._left[0]
        if task.rests:
            if self.belief.unseen_s > self.belief.patience.unseen_s:
                raise UnseenError(self.belief.unseen)
            self.check_held()
        self._check(task)
        self._done()

    def check_held(self) -> None:
        """Check that what is held is where it is held.

        Raises:
            ObjectLostError: If it is not.
        """
        belief, hold = self.belief, self._hold
        if hold is None or belief.objects is None or not belief.objects.seen:
            return
        away_m = math.hypot(*(belief.objects.in_b0[hold.object] - self._held_in_b0)[:2])
        if away_m > HOLD_M + self._room_m:
            name = self.problem.objects[hold.object].name
            raise ObjectLostError(f"{name} is {1e3 * away_m:z.0f} mm from where it was held")

    def steered(self, q: Array) -> Array:
        """The robot (3 + n,) that would hold what it holds as planned, where that is seen to be.

        So a tracker brings the object to where it is planned, as it turns about b0 only where its
        heading is asked for. What is farther off than its cage has room is lost: see `check_held`.
        """
        hold, objects = self._hold, self.belief.objects
        if hold is None or objects is None or not objects.seen or not self._left:
            return q
        task, item, seen = self._left[0], self.problem.objects[hold.object], objects.in_b0
        if task.about != item.name:
            return q
        seen = seen[hold.object].copy()
        if item.disc is not None or not task.asks_heading:
            seen[2] = hold.pose_in_b0[2]
        held = composed(q[:POSE], composed(seen, inverse(hold.pose_in_b0)))
        held[2] = q[2] + wrapped(held[2] - q[2])
        return np.concatenate([held, q[POSE:]])

    def lose(self, words: str) -> int:
        """Have the object of this task grasped again: it is not held, or not where it was put.

        Returns:
            How often it has been lost by now.
        """
        first = self._left[0]
        name = self.holding or first.about  # what is held, or the task is about
        assert name is not None
        path = first.stage(self.problem.modes).follows
        if path is not None and path.object == name:  # it is led along the rest alone
            first = self._resumed(path, self.belief.q, self.poses())
        self.lost[name] += 1
        self.trouble, self._hold = words, None
        asked = (task for task in grasps(self.problem.tasks).values() if task.object == name)
        again: tuple[Task, ...] = ()
        if not first.takes:
            again = (next(asked, Grasp(object=name)),)
        if first.lets_go and name in self._goals:
            again += (self._goals[name],)
        self._left, self._ends = (*again, first, *self._left[1:]), []
        self._watch(None)
        return self.lost[name]

    def rest(self) -> tuple[Problem, Array]:
        """The problem with what is left to do, what is held and where objects are, and q now."""
        problem, poses, holding = self.problem, self.poses(), self.holding
        held = [i for i, item in enumerate(problem.objects) if item.name == holding]
        q = fitted(problem, self.belief.q, poses, held)
        objects = [
            item.with_values(pose=dict(zip(("x_m", "y_m", "phi_rad"), pose, strict=True)))
            for item, pose in zip(problem.objects, poses.tolist(), strict=True)
        ]
        start = problem.start.with_values(holding=holding)
        tasks = self.left
        if tasks and (path := tasks[0].stage(problem.modes).follows) is not None:
            tasks = (self._resumed(path, q, poses), *tasks[1:])
        aimed: dict[int, Task] = {i: self._aimed(task) for i, task in carries(tasks).items()}
        for i in held:
            cage = cage_of(problem, q, i, composed(inverse(q[:POSE]), poses[i]))
            room_m = cage.room_m + _LOOSER_M if cage is not None and cage.proved else 0.0
            led = follows(tasks, problem.objects[i].name)
            aimed |= {k: task.no_nearer_than(room_m) for k, task in led.items()}
        left = [aimed.get(i, task) for i, task in enumerate(tasks)]
        self._asked |= dict(zip(left, tasks, strict=True))
        return problem.with_values(start=start, tasks=left, objects=objects), q

    def _resumed(self, task: Follow, q: Array, poses: Array) -> Follow:
        """What is left of a path that is followed in part.

        Args:
            task: The path.
            q: The robot now, (3 + n,).
            poses: The objects now, (objects, 3).
        """
        if task.object is None:
            in_b0 = part_in_b0(self.problem.robot, q[POSE:], task.part)
            now = composed(q[:POSE], in_b0)
        else:
            in_b0, now = self._held_in_b0, poses[self._numbers[task.object]]
        at = np.vstack([composed(np.array(self._path)[:, :POSE], in_b0), now])
        gone_m = task.left.along(at[:, :2], _AHEAD * task.position_tolerance_m)[-1]
        last_m = task.line.length_m[-1] - task.position_tolerance_m
        return task.with_values(from_m=float(max(min(task.from_m + gone_m, last_m), task.from_m)))

    def poses(self) -> Array:
        """Poses of the objects, as far as is known, (objects, 3)."""
        belief = self.belief
        if belief.objects is None:
            return np.zeros((0, POSE))
        poses = belief.objects.poses.copy()
        if (hold := self._hold) is not None:
            seen = belief.objects.in_b0[hold.object]
            in_b0 = seen if belief.objects.seen else self._held_in_b0
            poses[hold.object] = composed(belief.q[:POSE], in_b0)
        return poses

    def _check(self, task: Task) -> None:
        """Check that what a task asks is so at its end, with a margin."""
        at, stage = f"{task.called} is not done", task.stage(self.problem.modes)
        if stage.through is not None:
            if not stage.through.met(np.array(self._path)[1:, :POSE]).any():
                raise AstrayError(f"{at}: the box was not entered")
        elif stage.grasps is not None:
            self._check_grasp(stage.grasps)
        elif stage.carries is not None:
            self._check_carried(stage.carries, at)
        elif stage.releases is not None:
            self._check_released(stage.releases)
        elif stage.follows is not None:
            self._check_followed(stage.follows, at)
        elif not self.belief.accuracy.surely(error := self._error(stage.goal)):
            raise AstrayError(f"{at}: {self.belief.accuracy.describe(error)}")

    def _error(self, goal: GoalSet | None) -> Array:
        """Distance to a goal set, or where there is none to where the plan leaves the robot."""
        q = self.belief.q.copy()
        if goal is not None:
            scale = self.belief.accuracy.scale(self.problem.robot.coordinates)
            return goal.loosened(-scale).error(q)
        error: Array = q - self.plan.trajectory.configuration([self._ends[0]])[0]
        error[2] = wrapped(error[2])
        return error

    def _check_carried(self, task: Carry, at: str) -> None:
        """Check that an object need not be carried on: nearer than that first, for it may slide."""
        task = self._aimed(task)
        if self._off(task) > (_CARRIED_SHARE if self._looks < _LOOKS else 1.0):
            self._looks += 1
            raise AstrayError(f"{at}: {self._where(task)}")

    def _check_followed(self, task: Follow, at: str) -> None:
        """Check that what follows a path has come to its end."""
        line, q = task.line, self.belief.q[None]
        (pose,) = follower(self.problem, task, q, self.poses()[None])
        off_m = math.hypot(*(pose[:2] - line.points[-1]))
        off_rad = abs(math.remainder(float(pose[2] - line.headings[-1]), math.tau))
        if off_m > task.position_tolerance_m or off_rad > task.heading_tolerance_rad:
            raise AstrayError(f"{at}: it is {1e3 * off_m:z.1f} mm from the end of its path")

    def _check_released(self, task: Release) -> None:
        """Check that the object was not moved from where it was carried."""
        goal = self._goals.get(task.object)
        if goal is None or self._off(goal, _SURELY) <= 1.0:
            return
        if self._put_at is not None:  # how it was dragged along: it will be so again
            (pose, q), now = self._put_at, self.poses()[self._numbers[task.object]]
            self._drags[task.object] = (now - pose)[:2] @ rotation(-q[2])
        moved = f"{task.object} was moved while it was released"
        raise ObjectLostError(f"{moved}: {self._where(goal)}")

    def _check_grasp(self, task: Grasp) -> None:
        """Check that the object is where it should be held, or proved to be caged."""
        seen, grip = self.belief.objects, self._grips[0]
        in_b0 = grip.pose_in_b0 if seen is None or not seen.seen else seen.in_b0[grip.object]
        away_m = math.hypot(*(in_b0 - grip.pose_in_b0)[:2])
        if not self._closed_round(grip, in_b0) and away_m > HOLD_M:
            where = f"it is {1e3 * away_m:z.0f} mm from where it should be held"
            raise ObjectLostError(f"{task.object} is not grasped: {where}, and not caged")

    def _closed_round(self, hold: Carried, in_b0: Array) -> bool:
        """Note where an object is in the hand, and how far it may get; True if it is caged."""
        cage = cage_of(self.problem, self.belief.q, hold.object, in_b0)
        self._held_in_b0, self._room_m, self._cone = in_b0.copy(), 0.0, _ANY
        if cage is None or not cage.proved:
            self._push(hold)
            return False
        self._room_m = cage.room_m
        return True

    def _push(self, hold: Carried) -> None:
        """Note what friction keeps of an object that is held as planned by being pushed."""
        thing = self.problem.objects[hold.object]
        q = self.plan.trajectory.configuration([hold.from_s])[0]
        planned = cage_of(self.problem, q, hold.object, hold.pose_in_b0)
        if thing.friction is None or (planned is not None and planned.proved):
            return
        from twosra_mpc.contact.grip import SURELY, pushing_cone

        where = self.problem.robot.geometry, q[POSE:], thing, hold.pose_in_b0
        cone = pushing_cone(*where, SURELY * thing.friction)
        self._cone, self._room_m = cone.facets, cone.room_m

    def _aimed(self, task: Carry) -> Carry:
        """The task with what the release is known to add taken off, for b0's heading now."""
        if (drag := self._drags.get(task.object)) is None:
            return task
        x_m, y_m = ([task.x_m, task.y_m] - drag @ rotation(self.belief.q[2])).tolist()
        phi_rad = task.phi_rad
        if phi_rad is None and self._looks:  # b0 has the heading for which this was worked out
            phi_rad = float(self.poses()[self._numbers[task.object], 2])
        return task.with_values(x_m=x_m, y_m=y_m, phi_rad=phi_rad)

    def _off(self, task: Carry, deviations: float = 0.0) -> float:
        """Distance of the object from where it is to be, in units of `ACCURACY`.

        With so many standard deviations of where it is seen, if it is.
        """
        objects, camera = self.belief.objects, self.belief.camera
        unsure = np.zeros(POSE) if objects is None else deviations * objects.deviation(camera)
        far_m, turn_rad = self._away(task)
        return max((far_m + unsure[0]) / ACCURACY[0], (turn_rad + unsure[2]) / ACCURACY[2])

    def _away(self, task: Carry) -> tuple[float, float]:
        number = self._numbers[task.object]
        return away(task, self.problem.objects[number], self.poses()[number])

    def _where(self, task: Carry) -> str:
        far_m, turn_rad = self._away(task)
        turned = f" and {math.degrees(turn_rad):z.1f} degrees" if turn_rad else ""
        return f"{task.object} is {1e3 * far_m:z.1f} mm{turned} from where it is to be"

    def _done(self) -> None:
        task, *left = self._left
        self._ends.pop(0)
        if task.takes:
            self._hold, self.trouble = self._grips.pop(0), ""
        self._left, self._path = tuple(left), [self.belief.q]
        self._looks = 0
        self._open_before_release()
        self.done_s.append(self.belief.now_s)
        where = ""
        for name, carry in put([task]).items():
            self._goals[name] = carry
            where = f": {self._where(self._aimed(carry))}"
        self.belief.tell("task", f"{task.called} is done{where}")
        self._watch(task)

    def _open_before_release(self) -> None:
        """Take an object that is about to be released as resting while the robot opens."""
        objects = self.belief.objects
        if self._hold is not None and self._left and self._left[0].lets_go:
            if objects is not None and not objects.seen:
                objects.poses = self.poses()
            self._put_at = self.poses()[self._hold.object], self.belief.q.copy()
            self._hold = None

    def _watch(self, before: Task | None) -> None:
        """Have the guard keep from what must not be touched until the next task is done."""
        problem, hold = self.problem, self._hold
        names = {before.about} if before is not None and before.lies_along else set()
        names |= {task.about for task in self._left[:1] if task.touches}
        free = [
            None if item.name in names or (hold is not None and hold.object == i) else pose
            for i, (item, pose) in enumerate(zip(problem.objects, self.poses(), strict=True))
        ]
        world = problem.world_with(free)
        kept = [item for item in world.obstacles if item.name not in names]
        if not kept and world.workspace is None:
            self.belief.guard = None
            return
        pieces: list[Array] = []
        if hold is not None:
            from twosra_mpc.space.convex import convex_parts

            held = problem.objects[hold.object].at(self._held_in_b0)
            pieces = convex_parts(held.corners_m)
        world = world.with_values(obstacles=kept)
        self.belief.guard = Guard(problem, self.belief.patience, world, pieces)


def tasks_left(tasks: tuple[Pass, ...], path: Array) -> tuple[Pass, ...]:
    """Tasks that a path (m, 3 + n) has not done yet, in their order."""
    for done, task in enumerate(tasks):
        met = task.met(path[:, :POSE])
        if not met.any():
            return tasks[done:]
        path = path[met.argmax() :]
    return ()


def away(task: Carry, item: Object, pose: Array) -> tuple[float, float]:
    """Distance of an object at a pose (3,) from where a task carries it, beyond its tolerance.

    A disc has no heading: nobody sees it turn in a cage.

    Returns:
        Distance [m] and turn [rad].
    """
    far_m = math.hypot(pose[0] - task.x_m, pose[1] - task.y_m) - task.position_tolerance_m
    turn_rad = 0.0
    if task.phi_rad is not None and item.disc is None:
        turn_rad = abs(math.remainder(pose[2] - task.phi_rad, math.tau))
        turn_rad = max(turn_rad - task.heading_tolerance_rad, 0.0)
    return max(far_m, 0.0), turn_rad
