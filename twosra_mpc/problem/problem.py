"""The planning problem: a complete, validated, frozen value.

Keys are those of the scenario file; a coordinate left out of the goal is free.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import (
    BeforeValidator,
    Field,
    SerializeAsAny,
    ValidationInfo,
    field_validator,
    model_validator,
)

from twosra_mpc.arguments import public
from twosra_mpc.errors import MISSING, InputError, doubt
from twosra_mpc.files import built_in_names, check_kind, locate, read_document, reading
from twosra_mpc.keys import doubts, near_word
from twosra_mpc.problem.geojson import read_obstacles
from twosra_mpc.problem.goals import Anywhere, Goal, GoalSet, inner_goal, read_only
from twosra_mpc.problem.tasks import Pass, Stage, Task, passes, stages_of, task_problems, with_ways
from twosra_mpc.problem.tolerances import CURVATURE_TOLERANCE_PER_M
from twosra_mpc.problem.world import Object, Obstacles, Workspace, World, names_twice
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot, load_robot, segment_model
from twosra_mpc.robot.modes import Mode, StartingStiffness
from twosra_mpc.robot.timing import Timing
from twosra_mpc.thermal.model import SegmentModel, State, thresholds_C
from twosra_mpc.thermal.uncertainty import Windows, windows
from twosra_mpc.validation import (
    MOST_SEGMENTS,
    Celsius,
    Metres,
    ModeField,
    NonNegative,
    Numbers,
    Positive,
    Radians,
    Several,
    Value,
    missing,
    plain,
)


class Start(Value):
    """Initial state: pose, curvatures, state of the metal of each segment, and the object in hand.

    Segments may be in any state. ``temperature_C`` is that of the metal, ``melt_fraction`` how much
    of it is molten, from 0 (solid) to 1 (liquid), ``body_temperature_C`` that of what is around the
    metal, for segments with two nodes. Left out, a temperature is that of the air, or the one at
    which so much is molten; a melt fraction is what the temperature says, and all of a segment has
    the temperature of its metal. A segment that is partly molten is neither soft nor rigid until it
    has melted, or frozen, completely.
    """

    x_m: Metres
    y_m: Metres
    phi_rad: Radians
    kappa_per_m: Numbers
    temperature_C: Numbers | None = None
    melt_fraction: Numbers | None = None
    body_temperature_C: Numbers | None = None
    holding: str | None = None

    @property
    def configuration(self) -> Array:
        """Q = [x, y, phi, kappa1 ... kappan], shape (3 + n,), read-only."""
        return read_only([self.x_m, self.y_m, self.phi_rad, *self.kappa_per_m])


_OF_SEGMENTS = ("temperature_C", "melt_fraction", "body_temperature_C")  # keys of a start
_SAME_C, _SAME_SHARE = 1e-6, 1e-8  # temperatures and melt fractions that differ by rounding
_LEAST_ENERGY_S_PER_J = 10.0  # a melt of 300 J then counts more than any plan's duration


FORMAT = "twosra-plan"  # of plan files, which hold their problem


class Weights(Value):
    """Weights of the cost, which is in seconds: duration counts 1.

    ``effort`` weighs the integral of the sum of (wheel speed / largest wheel speed)^2 [s].
    """

    energy_s_per_J: NonNegative = 0.0
    transition_s: NonNegative = 0.0
    effort: NonNegative = 0.0


def _named_here(load: Callable[[Any], object], source: object, field: str) -> object:
    """Load what a file holds; that there is no such ``field`` is said of the key that names it."""
    try:
        return load(source)
    except InputError as error:
        if error.field == field:
            beside = "paths are taken from the scenario's folder, or from this one."
            lost = Path(str(source)).suffix and "that exists" in error.allowed
            hint = error.hint or (beside if lost else "")
            raise InputError("", error.value, error.allowed, hint=hint) from None
        raise


def _molten_at(thresholds_C: tuple[float, float], fraction: float) -> float:
    """Temperature at which so much of a segment's metal is molten [C]."""
    solid, liquid = thresholds_C
    return solid + fraction * (liquid - solid)


def _nearest(value: float, ends: tuple[float, float], same: float) -> float:
    """A value, or the one of two that it is but for rounding."""
    return next((end for end in ends if abs(value - end) <= same), value)


def _molten(now: float, solid: float, liquid: float) -> float:
    """Share that is molten at a temperature, from 0 to 1."""
    return 0.0 if now <= solid else 1.0 if now >= liquid else (now - solid) / (liquid - solid)


AnyTask = Annotated[SerializeAsAny[Task], BeforeValidator(Task.of_kind)]


Risk = Literal["nominal", "mean"] | float
"""What of an uncertain time counts: none of the uncertainty, the mean, or a quantile."""


def _word_or_quantile(value: object) -> object:
    number = isinstance(value := plain(value), float) and 0.0 < value < 1.0
    if number or value in get_args(get_args(Risk)[0]):
        return value
    hint = near_word(value, get_args(get_args(Risk)[0]))
    raise InputError("", value, "nominal, mean, or a quantile between 0 and 1, as 0.9", hint=hint)


class Alone(NamedTuple):
    """One stretch of a problem: from a start to a goal, whatever else is asked."""

    robot: Robot
    start: Start
    goal: GoalSet
    workspace: Workspace | None


class Problem(Value):
    """A complete planning problem (``planner`` chooses the optimal or the greedy planner).

    ``ambient_C`` is the temperature of the air, the robot file's unless told otherwise. The heaters
    always start as late as the plan allows. ``heating`` says what counts beyond that: "fastest",
    time and the given weights; "least_energy", heater energy first and time second; "keep_warm" as
    fastest, and solid segments are kept warm between soft phases where that costs less. At most
    ``heaters_at_once`` heaters are on at a time: one, or all. ``transition_quantile`` reserves
    windows that hold this share of early and of late transitions, given the ranges of the robot's
    parameters. ``motion`` says what is done with time to spare, and with the ``gap`` that is asked
    for: "gentle" drives and bends as slowly as they allow, "fastest" as fast as the robot can. With
    ``weights.effort`` the cost itself says how fast, and ``motion`` has nothing to add. No point of
    the robot leaves the ``workspace``, and all keep ``clearance_m`` from the ``obstacles``. The
    ``tasks`` are done one after the other, or with ``order = "free"`` in the order that costs least
    (those of one object keep theirs); then the goal is reached. A last task that says
    ``do = "reach"`` is the goal, and a mission may end without one. ``risk`` says what of the time
    counts where joint bends are uncertain: "nominal", as if they were not; "mean"; or a quantile,
    as 0.9. The search ends within ``gap`` of the best possible, after ``work_limit`` units of work
    (`effort`: the same on every machine), or after ``time_limit_s`` of CPU time, which is for
    machines on which that work takes too long.
    """

    description: str = ""
    robot: Robot
    planner: Literal["optimal", "greedy"] = "optimal"
    start: Start
    goal: SerializeAsAny[GoalSet] = Field(default=None, validate_default=True)
    tasks: Several[AnyTask] = ()
    order: Literal["given", "free"] = "given"
    objects: Several[Object] = ()
    workspace: Workspace | None = None
    obstacles: Obstacles = ()
    clearance_m: NonNegative = 0.002
    curvature_uncertainty_per_m: NonNegative = 0.0
    weights: Weights = Weights()
    timing: str = "nominal"
    ambient_C: Celsius | None = None
    heating: Literal["fastest", "least_energy", "keep_warm"] = "fastest"
    motion: Literal["gentle", "fastest"] = "gentle"
    heaters_at_once: Annotated[int, BeforeValidator(plain)] = Field(
        default_factory=lambda data: data["robot"].coordinates.segments, ge=1, le=MOST_SEGMENTS
    )
    transition_quantile: Annotated[float, Field(ge=0.5, lt=1.0)] | None = None
    modes: Several[ModeField] = Field(default_factory=lambda data: data["robot"].modes)
    max_phases: Annotated[int, Field(ge=1, le=12), BeforeValidator(plain)] = 8
    risk: Annotated[Risk, BeforeValidator(_word_or_quantile)] = "nominal"
    gap: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.01
    work_limit: Positive = 60_000.0
    time_limit_s: Positive = 600.0

    @model_validator(mode="before")
    @classmethod
    def _reached_last(cls, data: Any) -> Any:
        """A last task that says reach is the goal; other tasks need none after them."""
        if not isinstance(data, dict) or data.get("goal") is not None:
            return data
        tasks = data.get("tasks")
        if not isinstance(tasks, list | tuple) or not tasks:
            return data
        *before, last = (dict(task) if isinstance(task, Task) else task for task in tasks)
        if not isinstance(last, dict) or last.get("do") == "pass":
            return data
        if last.get("do") != "reach" or last.get("mode") == "any":
            return {**data, "goal": Anywhere()}
        goal = last.get("goal") or {k: v for k, v in last.items() if k not in ("do", "name")}
        return {**data, "tasks": before, "goal": goal}

    @field_validator("robot", mode="before")
    @classmethod
    def _load_robot(cls, value: object) -> object:
        named = isinstance(value, str | Path)
        return _named_here(load_robot, value, "robot") if named else value

    @field_validator("obstacles", mode="before")
    @classmethod
    def _read_obstacles(cls, value: object) -> object:
        named = isinstance(value, str | Path)
        return _named_here(read_obstacles, value, "file") if named else value

    @field_validator("goal", mode="before")
    @classmethod
    def _box_unless_told_otherwise(cls, goal: object) -> object:
        if goal is None:
            raise InputError("", MISSING, missing("goal").allowed)
        return Goal(**goal) if isinstance(goal, dict) else goal

    @field_validator("goal", mode="after")
    @classmethod
    def _of_this_robot(cls, goal: GoalSet, info: ValidationInfo) -> GoalSet:
        robot = info.data.get("robot")
        return goal if robot is None else goal.of_robot(robot)

    @field_validator("tasks", mode="after")
    @classmethod
    def _for_this_robot(cls, tasks: tuple[Task, ...], info: ValidationInfo) -> tuple[Task, ...]:
        robot = info.data.get("robot")
        return tasks if robot is None else tuple(task.of_robot(robot) for task in tasks)

    @field_validator("modes")
    @classmethod
    def _some_mode(cls, modes: tuple[Mode, ...]) -> tuple[Mode, ...]:
        if not modes:
            raise InputError("", modes, "at least one mode, e.g. [[0, 0], [1, 0]]")
        return tuple(dict.fromkeys(modes))  # a mode given twice is one mode

    @model_validator(mode="after")
    def _consistent(self) -> Problem:
        found = list(self._wrong_lengths()) or list(self._contradictions())
        things = [[item.name for item in kind] for kind in (self.obstacles, self.objects)]
        found += names_twice(*things)
        segments, held = self.robot.coordinates.segments, self.start.holding
        found += task_problems(self.tasks, self.objects, self.obstacles, segments, held)
        if found:
            raise found[0].among(found[1:])
        if self.order == "given":
            ways = with_ways(self.robot, self.start.configuration, self.objects, self.tasks)
            object.__setattr__(self, "tasks", tuple(ways))
        return self

    def _wrong_lengths(self) -> Iterator[InputError]:
        """Yield every list that has not one entry for each segment."""
        count = self.robot.coordinates.segments
        allowed = f"a list of {count} values, one for each segment of robot {self.robot.name}"
        lists: dict[str, Sequence[object] | None] = {
            "start.kappa_per_m": self.start.kappa_per_m,
            **{f"start.{key}": getattr(self.start, key) for key in _OF_SEGMENTS},
            "goal.mode": self.goal.mode,
        }
        for where, goal in self._goals().items():
            lists[f"{where}.kappa_per_m"] = tuple(goal.configuration[POSE:].tolist())
            lists[f"{where}.tolerance.kappa_per_m"] = tuple(goal.half_width[POSE:].tolist())
        lists |= {f"modes.{i}": mode for i, mode in enumerate(self.modes)}
        for field, given in lists.items():
            if given is not None and len(given) > count:
                yield InputError(field, given, allowed)
            elif given is not None:
                yield from (
                    InputError(f"{field}.{j}", MISSING, f"a value for segment {j + 1} is required")
                    for j in range(len(given), count)
                )
        if self.heaters_at_once not in (1, count):  # what is possible in between is not worked out
            yield InputError("heaters_at_once", self.heaters_at_once, f"1 or {count}")

    def _goals(self) -> dict[str, GoalSet]:
        """The goal, and goals on the way, by their keys."""
        on_the_way = {f"tasks.{i}": task.ends_in for i, task in enumerate(self.tasks)}
        found = {where: goal for where, goal in on_the_way.items() if goal is not None}
        return {"goal": self.goal, **found}

    def _contradictions(self) -> Iterator[InputError]:
        """Yield every value that the robot does not allow."""
        robot = self.robot
        if self.timing not in robot.timing:
            yield InputError("timing", self.timing, f"one of {', '.join(robot.timing)}")
        limit = robot.limits.curvature_per_m
        ends = [("start", self.start.configuration)]
        ends += [(where, goal.configuration) for where, goal in self._goals().items()]
        for j in range(robot.coordinates.segments):
            for where, q in ends:
                if abs(q[3 + j]) > limit + CURVATURE_TOLERANCE_PER_M:
                    allowed = f"from {-limit:zg} to {limit:zg} 1/m (robot {robot.name})"
                    yield InputError(f"{where}.kappa_per_m.{j}", float(q[3 + j]), allowed)
        if self.risk != "nominal" and not self.only_time:
            allowed = "nominal with weights, objects or tasks"
            yield InputError("risk", self.risk, allowed)
        yield from self._tasks_outside()
        yield from self._impossible_temperatures()
        if self._thermal:
            yield from self._too_weak_a_heater()
        elif self.timing in robot.timing:
            constant = f"only with a thermal timing; {self.timing} has constant times"
            if self.heating == "keep_warm":
                yield InputError("heating", self.heating, constant)
            if self.transition_quantile is not None:
                yield InputError("transition_quantile", self.transition_quantile, constant)

    def _tasks_outside(self) -> Iterator[InputError]:
        """Yield boxes to pass that are wholly outside of the workspace."""
        edges = () if self.workspace is None else (self.workspace.x_m, self.workspace.y_m)
        for i, task in passes(self.tasks).items():
            for name, pair, edge in zip(("x_m", "y_m"), (task.x_m, task.y_m), edges, strict=False):
                if pair and edge and (pair[1] < edge[0] or pair[0] > edge[1]):
                    allowed = f"some of it within the workspace, {edge[0]:zg} to {edge[1]:zg} m"
                    yield InputError(f"tasks.{i}.{name}", pair, allowed)

    def _impossible_temperatures(self) -> Iterator[InputError]:
        heater, name = self.robot.heater, self.robot.name
        low, high = heater.temperature_min_C, heater.temperature_max_C
        thresholds = self.segment_thresholds_C
        lowest, _ = self.stiffness_thresholds_C
        if not low <= self.ambient < lowest:
            allowed = f"from {low:zg} to below {lowest:zg} C, where the metal of {name} melts"
            yield InputError("ambient_C", self.ambient, allowed)
            return
        given = zip(self.temperatures, self._shares, strict=True)
        for j, ((now, fraction), (solid, liquid)) in enumerate(zip(given, thresholds, strict=True)):
            field, there = f"start.temperature_C.{j}", _molten_at((solid, liquid), fraction or 0.0)
            if fraction is not None and not 0.0 <= fraction <= 1.0:
                allowed = "from 0 (solid) to 1 (liquid)"
                yield InputError(f"start.melt_fraction.{j}", fraction, allowed)
            elif not low - _SAME_C <= now <= high + _SAME_C:
                yield InputError(field, now, f"from {low:zg} to {high:zg} C (robot {name})")
            elif fraction is None and now == solid == liquid:
                allowed = f"with start.melt_fraction: at {solid:zg} C metal may be solid or liquid"
                yield InputError(field, now, allowed)
            elif fraction == 0.0 and now > solid + _SAME_C:
                yield InputError(field, now, f"at most {solid:zg} C: melt_fraction says solid")
            elif fraction == 1.0 and now < liquid - _SAME_C:
                yield InputError(field, now, f"at least {liquid:zg} C: melt_fraction says liquid")
            elif fraction and fraction < 1.0 and abs(now - there) > _SAME_C:
                said = f"melt_fraction says that {100 * fraction:zg} % is molten"
                yield InputError(field, now, f"{there:zg} C: {said}")
        yield from self._impossible_bodies()

    def _impossible_bodies(self) -> Iterator[InputError]:
        """Yield temperatures around the metal that it has not, or by which it melts unheated."""
        heater = self.robot.heater
        low, high = heater.temperature_min_C, heater.temperature_max_C
        for j, body in enumerate(self.start.body_temperature_C or ()):
            field, now = f"start.body_temperature_C.{j}", self.temperatures[j]
            most = min(high, max(now, self.segment_thresholds_C[j][0]))
            if not self._thermal or len(self.segment_models[j].initial(now)) == 1:
                if abs(body - now) > _SAME_C:
                    yield InputError(field, body, f"{now:zg} C, as its metal: it has no other node")
            elif not low <= body <= most:
                yield InputError(field, body, f"from {low:zg} to {most:zg} C, its metal being so")

    def _too_weak_a_heater(self) -> Iterator[InputError]:
        heater, air = self.robot.heater, self.ambient
        for model, now in zip(self.segment_models, self.start_states, strict=True):
            setpoint = model.level_at(heater.soft_setpoint_C)
            coldest, _ = model.extremes(now)
            if model.time_until(coldest, heater.melt_current_A, setpoint) == math.inf:
                allowed = (
                    f"a current that heats to the set-point {heater.soft_setpoint_C:zg} C "
                    f"in air of {air:zg} C"
                )
                yield InputError("robot.heater.melt_current_A", heater.melt_current_A, allowed)
                return

    @property
    def _thermal(self) -> bool:
        times = self.robot.timing.get(self.timing)
        return times is not None and times.needs_segment

    @cached_property
    def ambient(self) -> float:
        """Temperature of the air [C]."""
        return self.robot.heater.ambient_C if self.ambient_C is None else self.ambient_C

    @property
    def _unsaid(self) -> tuple[None, ...]:
        return (None,) * self.robot.coordinates.segments

    @property
    def _shares(self) -> Sequence[float | None]:
        """Melt fractions that are told, 0 or 1 to rounding."""
        told = self.start.melt_fraction or self._unsaid
        return [share and _nearest(share, (0.0, 1.0), _SAME_SHARE) for share in told]

    @cached_property
    def temperatures(self) -> Sequence[float]:
        """Temperatures of the segments' metal at t = 0, thresholds to rounding [C]."""
        spans = self.segment_thresholds_C
        found = self.start.temperature_C or (
            _molten_at(span, share) if share else self.ambient
            for share, span in zip(self._shares, spans, strict=True)
        )
        return tuple(_nearest(now, span, _SAME_C) for now, span in zip(found, spans, strict=True))

    @cached_property
    def melt_fractions(self) -> Sequence[float]:
        """Melt fraction of each segment at t = 0: 0 where it is solid to rounding, 1 liquid."""
        said = zip(self._shares, self.temperatures, self.segment_thresholds_C, strict=True)
        return tuple(
            _molten(now, *span) if share is None or span[0] < span[1] else share
            for share, now, span in said
        )

    @cached_property
    def start_states(self) -> tuple[State, ...]:
        """State of each segment at t = 0, of its thermal model; none where times are constant."""
        bodies = self.start.body_temperature_C or self._unsaid
        own = zip(self.segment_models, self.temperatures, self.melt_fractions, bodies, strict=False)
        return tuple(model.initial(now, share, body) for model, now, share, body in own)

    @property
    def stiffness_thresholds_C(self) -> tuple[float, float]:
        """Temperatures up to which every segment is solid, and from which on liquid [C]."""
        solid, liquid = zip(*self.segment_thresholds_C, strict=True)
        return min(solid), max(liquid)

    @cached_property
    def segment_models(self) -> tuple[SegmentModel, ...]:
        """Thermal model of each segment in this air; none where times are constant."""
        segments = range(self.robot.coordinates.segments if self._thermal else 0)
        return tuple(segment_model(self.robot, self.ambient, j) for j in segments)

    @cached_property
    def windows(self) -> tuple[Windows, ...]:
        """Windows of the transitions of each segment; none where times are constant."""
        heater = self.robot.heater
        asked = heater.melt_current_A, heater.soft_setpoint_C, self.transition_quantile
        ranges = (self.robot.thermal_segment(j).ranges for j in range(len(self.segment_models)))
        pairs = zip(self.segment_models, ranges, strict=True)
        return tuple(windows(model, tuple(own.items()), *asked) for model, own in pairs)

    @cached_property
    def segment_thresholds_C(self) -> tuple[tuple[float, float], ...]:
        """Temperatures up to which each segment is solid, and from which on it is liquid [C]."""
        if self._thermal:
            return tuple(map(thresholds_C, self.segment_models))
        return ((self.robot.heater.melting_point_C,) * 2,) * self.robot.coordinates.segments

    @cached_property
    def replay_tolerance(self) -> float:
        """Share of a transition's time by which replayed heater currents may miss it."""
        return max((model.replay_tolerance for model in self.segment_models), default=0.0)

    @cached_property
    def world(self) -> World:
        """Surroundings of the robot, without objects."""
        return World(**{name: getattr(self, name) for name in World.model_fields})

    def world_with(self, poses: Sequence[Array | None]) -> World:
        """Surroundings of the robot with objects at poses (3,); None: not in the way."""
        if len(poses) != len(self.objects):
            allowed = f"a pose or None for each of {len(self.objects)} objects"
            raise InputError("poses", len(poses), allowed)
        placed = zip(self.objects, poses, strict=True)
        there = [item.at(pose) for item, pose in placed if pose is not None]
        return self.world.with_values(obstacles=(*self.obstacles, *there))

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Stages in turn: one for each task, and one for the goal if there is one."""
        return tuple(stages_of(self.tasks, self.goal, self.modes, self.start.holding))

    @cached_property
    def ends_anywhere(self) -> bool:
        """True if the last task says where it ends, soft or rigid, and there is no goal."""
        return isinstance(self.goal, Anywhere)

    @property
    def passes(self) -> tuple[Pass, ...]:
        """The boxes to pass."""
        return tuple(passes(self.tasks).values())

    @cached_property
    def inner_goal(self) -> GoalSet:
        """Part of the goal where plans should end, for the sake of their runs."""
        return inner_goal(self.robot, self.goal)

    @property
    def judged_goal(self) -> GoalSet:
        """Goal set by which runs are judged: the goal less the robot's accuracy, which is added."""
        robot = self.robot
        return self.goal.loosened(-robot.ends_within.scale(robot.coordinates))

    @cached_property
    def start_mode(self) -> Mode:
        """Mode at t = 0: what is liquid is soft."""
        return tuple(int(soft == 1) for soft in self.start_stiffness)

    @cached_property
    def start_stiffness(self) -> StartingStiffness:
        """Stiffness at t = 0: 1 where a segment is liquid, 0 where solid, None where changing."""
        return tuple({0.0: 0, 1.0: 1}.get(share) for share in self.melt_fractions)

    @cached_property
    def drives_gently(self) -> bool:
        """True if time to spare is used to drive slowly: a robot that may jump needs none.

        Nor does a plan whose cost already says what effort is worth, or who follows a path in time.
        """
        if any(stage.follows is not None and len(stage.follows.due) for stage in self.stages):
            return False
        limited = self.robot.limits.wheel_acceleration_rad_s2 is not None
        return self.motion == "gentle" and limited and self.weights.effort == 0

    @cached_property
    def cost_weights(self) -> Weights:
        """The weights, with energy before time where ``heating`` asks for it."""
        if self.heating != "least_energy":
            return self.weights
        energy = max(self.weights.energy_s_per_J, _LEAST_ENERGY_S_PER_J)
        return self.weights.with_values(energy_s_per_J=energy)

    @property
    def only_time(self) -> bool:
        """True if all that counts is the time to reach a goal, with obstacles or without."""
        other = self.objects or self.tasks
        return not other and not any(self.cost_weights.model_dump().values())

    @cached_property
    def transition_times(self) -> Timing:
        """The set of transition times that ``timing`` names."""
        return self.robot.timing[self.timing]

    @property
    def unit_doubts(self) -> tuple[str, ...]:
        """Numbers that are legal and probably in another unit, each with what may be meant."""
        found = self.scenario()
        if self.obstacles or self.workspace:  # a map, whose origin may be far away
            found["workspace"] = None
            for place in (found["start"], found["goal"] or {}, *found["tasks"]):
                for key in {"x_m", "y_m"} & place.keys():
                    del place[key]
        return tuple(doubts(found))

    def scenario(self) -> dict[str, Any]:
        """The scenario as plain data with all defaults filled in (the robot by its name).

        What only missions have, starts amid a change, or risks, is left out where it is not used.
        """
        found = self.model_dump(mode="json", exclude={"robot"})
        for table, key, unused in (
            (found, "objects", []),
            (found, "order", "given"),
            (found, "risk", "nominal"),
            (found["start"], "holding", None),
            (found["start"], "melt_fraction", None),
            (found["start"], "body_temperature_C", None),
        ):
            if table[key] == unused:
                del table[key]
        return {**found, "robot": self.robot.name}


def embedded_problem(robot: dict[str, Any], scenario: dict[str, Any], source: str) -> Problem:
    """Read a problem that another file holds; unlike one of a user it may name no file.

    Where the robot's geometry has no ``unit_frame_m``, the file was written when the square that
    wheels sit around was the outline, too; so it is here.

    Args:
        robot: Its robot, as the file has it.
        scenario: All else.
        source: The file.

    Raises:
        InputError: If it is wrong, or naming the key and the file that it names.
    """
    allowed, where = "in this file itself: plan files name no other file", f"{source} (scenario)"
    if isinstance(named := scenario.get("obstacles"), str):
        raise InputError("obstacles", named, f"a list {allowed}", where)
    objects = scenario.get("objects")
    for i, item in enumerate(objects if isinstance(objects, list) else ()):
        if isinstance(item, dict) and "outline" in item:
            raise InputError(f"objects.{i}.outline", item["outline"], f"corners {allowed}", where)
    if isinstance(lengths := robot.get("geometry"), dict) and "unit_side_m" in lengths:
        robot = {**robot, "geometry": {"unit_frame_m": lengths["unit_side_m"], **lengths}}
    known = Robot.parse(robot, f"{source} (robot)")
    return Problem.parse({**scenario, "robot": known}, where)


@public
def load_problem(source: str | Path, **overrides: Any) -> Problem:
    """Load a built-in scenario by name, or a scenario TOML/JSON file by path.

    A plan file holds its problem, which is loaded then. Keyword arguments replace top-level keys
    of the file. A relative path to a robot file, or to a GeoJSON file of obstacles, is taken from
    the scenario's folder.

    Warns:
        InputWarning: If a number is legal, and probably in another unit.

    Raises:
        InputError: If there is no such scenario, or it is wrong; the message names the key.
    """
    path = locate(source, "scenarios", "scenario")
    document = read_document(path, str(source))
    if document.get("format") == FORMAT and isinstance(document.get("scenario"), dict):
        planned = embedded_problem(document.get("robot", {}), document["scenario"], str(source))
        return planned.with_values(**overrides)
    check_kind(document, "scenario", str(source))
    document |= overrides
    for key in ("robot", "obstacles"):
        given = document.get(key)
        if isinstance(given, str) and os.path.isfile(path.parent / given):
            document[key] = path.parent / given
    with reading(str(source), "scenario"):
        problem = Problem.parse(document, str(source))
    doubt(problem.unit_doubts, str(source))
    return problem


@public
def scenario_names() -> list[str]:
    """Names of the built-in scenarios."""
    return built_in_names("scenarios")
