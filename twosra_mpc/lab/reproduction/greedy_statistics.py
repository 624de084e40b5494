"""The paper's simulations in number: random problems, what the greedy rule does, what is optimal.

The paper's claims of its simulations (Labazanova et al., IEEE RA-L 2023,
doi 10.1109/LRA.2023.3241749, section "Simulation"): forward kinematics (FK) goes straight to its
end, the planner more slowly at first and then faster; within 100 simulations at most four modes
were used, the last one always rigid.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, Self, get_args

from twosra_mpc.errors import InputError
from twosra_mpc.lab.reproduction.error_curves import (
    Curve,
    deviation,
    error_curve,
    starts_above,
)
from twosra_mpc.lab.reproduction.fixed_waits import fixed_waits_s
from twosra_mpc.lab.reproduction.published_runs import StopReason, published_trajectory
from twosra_mpc.lab.reproduction.random_problems import draw_generic, draw_single_mode
from twosra_mpc.lab.reproduction.shares import (
    Share,
    Spread,
    by_size,
    in_order,
    share,
    spread,
    tuples,
)
from twosra_mpc.planning.planner import plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot, load_robot
from twosra_mpc.robot.modes import MODES, Mode, ModeSequence, is_rigid

Kind = Literal["single-mode", "generic"]
Q = tuple[float, ...]  # [x, y, phi, kappa_1, kappa_2] in m, rad, 1/m

REFUSED = "refused"  # where the robot cannot be, by its description


@dataclass(frozen=True)
class StudyProblem:
    """A random problem, and what the published loop does with it.

    Attributes:
        seed: What it is drawn from.
        target_mode: Mode in which forward kinematics made the target; None if it was drawn.
        start: First configuration [m, m, rad, 1/m, 1/m], (5,).
        goal: Target, likewise.
        recorded: Modes of the steps longer than 1e-5, without repetitions, as the authors plot.
        raw: Modes of all iterations, without repetitions.
        iterations: How many there were.
        stop: Why the loop ended.
        error: Distance to the target as a share of its largest, at ``TIMES`` normalised times
            (rows recorded), of the planner.
        fk_error: The same of forward kinematics; empty if the target was drawn.
    """

    seed: int
    target_mode: Mode | None
    start: Q
    goal: Q
    recorded: ModeSequence
    raw: ModeSequence
    iterations: int
    stop: StopReason
    error: Curve
    fk_error: Curve

    @property
    def kind(self) -> Kind:
        """Kind of target."""
        return "generic" if self.target_mode is None else "single-mode"

    def to_dict(self) -> dict[str, Any]:
        """The value as plain data for JSON."""
        return {**asdict(self), "stop": self.stop.name}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read back what ``to_dict`` wrote."""
        return cls(**tuples({**data, "stop": StopReason[data["stop"]]}))


@dataclass(frozen=True)
class OptimalProblem:
    """Optimal plan of a problem of the study; numbers are NaN without a plan.

    Attributes:
        seed: Of the problem.
        status: Of the result; "refused" if the robot cannot be there.
        message: Of the result, or why it was refused.
        sequence: Modes of the plan; empty without one.
        cost: Of the plan [s].
        lower_bound: Proved [s].
        gap: Proved, relative to the cost.
        duration_s: Of the plan.
        waiting_s: Of it at rest.
        wall_s: How long planning took.
        greedy_status: Status of the greedy rule on the same robot, with the same waits.
        greedy_sequence: Its modes.
        greedy_duration_s: Its duration.
        greedy_waiting_s: Of it at rest.
    """

    seed: int
    status: str
    message: str
    sequence: ModeSequence = ()
    cost: float = math.nan
    lower_bound: float = math.nan
    gap: float = math.nan
    duration_s: float = math.nan
    waiting_s: float = math.nan
    wall_s: float = math.nan
    greedy_status: str = REFUSED
    greedy_sequence: ModeSequence = ()
    greedy_duration_s: float = math.nan
    greedy_waiting_s: float = math.nan

    def to_dict(self) -> dict[str, Any]:
        """The value as plain data for JSON; None for what is not finite."""
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read back what ``to_dict`` wrote."""
        known = {name: math.nan if value is None else value for name, value in data.items()}
        return cls(**tuples(known))


@dataclass(frozen=True)
class GroupStatistics:
    """Statistics of the loop on a group of problems.

    Attributes:
        problems: How many there are.
        recorded: Number of recorded phases -> number of problems.
        raw: The same, every iteration counted.
        last: Last recorded mode -> number of problems.
        raw_last: The same, every iteration counted.
        iterations: Until the loop stopped.
    """

    problems: int
    recorded: Mapping[int, int]
    raw: Mapping[int, int]
    last: Mapping[Mode, int]
    raw_last: Mapping[Mode, int]
    iterations: Spread


@dataclass(frozen=True)
class StudyStatistics:
    """Statistics of the published loop on many problems.

    Attributes:
        kind: How their targets were made.
        all: Of all problems.
        by_target: Of those with a target made in each mode; empty for drawn targets.
        sequences: Recorded sequence -> number of problems, most frequent first.
        at_most_four: Problems of at most four recorded phases (the paper: all).
        last_rigid: Problems whose last recorded mode is rigid (the paper: all).
        last_rigid_raw: The same, every iteration counted.
        diverged: Problems on which the loop ran away.
        fk_deviation: Largest distance of an FK curve from the straight line.
        slower_start: Planner above FK over all of the first tenth of the time.
        hardware_wait_s: Waits of the recorded sequences by the rule of the trials.
    """

    kind: Kind
    all: GroupStatistics
    by_target: Mapping[Mode, GroupStatistics]
    sequences: Mapping[ModeSequence, int]
    at_most_four: Share
    last_rigid: Share
    last_rigid_raw: Share
    diverged: Share
    fk_deviation: Spread
    slower_start: Share
    hardware_wait_s: Spread


@dataclass(frozen=True)
class OptimalStatistics:
    """Statistics of the optimal planner on the same problems, both planners compared.

    Attributes:
        problems: How many there are.
        planned: Of them have a plan.
        statuses: Status -> number of problems.
        sequences: Sequence -> number of problems, most frequent first.
        phases: Number of phases -> number of problems.
        last_rigid: Plans whose last mode is rigid.
        duration_s: Of plans.
        waiting_s: Of plans.
        gap: Proved.
        wall_s: Of planning.
        both: Problems that the greedy rule has a plan for, too.
        shorter: Of those, plans of less time than the greedy rule's.
        saved: Share of the greedy rule's time that is saved.
        hardware_wait_s: Waits of the sequences by the rule of the trials.
    """

    problems: int
    planned: Share
    statuses: Mapping[str, int]
    sequences: Mapping[ModeSequence, int]
    phases: Mapping[int, int]
    last_rigid: Share
    duration_s: Spread
    waiting_s: Spread
    gap: Spread
    wall_s: Spread
    both: Share
    shorter: Share
    saved: Spread
    hardware_wait_s: Spread


def published_study(seeds: Iterable[int], kind: Kind = "single-mode") -> Iterator[StudyProblem]:
    """Yield a problem a seed, in order, with what the published loop does with it.

    Args:
        seeds: A problem each; the same seed is the same problem everywhere.
        kind: "single-mode" as the authors draw, "generic" with a target drawn like the start.

    Raises:
        InputError: On another kind, or a negative seed.
    """
    if kind not in get_args(Kind):
        raise InputError("kind", kind, f"one of {', '.join(get_args(Kind))}")
    for seed in seeds:
        if seed < 0:
            raise InputError("seed", seed, "0 or more")
        if kind == "single-mode":
            driven, mode = draw_single_mode(seed)
            yield _studied(seed, mode, driven[0], driven[-1], error_curve(driven, driven[-1]))
        else:
            start, goal = draw_generic(seed)
            yield _studied(seed, None, start, goal, ())


def _studied(
    seed: int, mode: Mode | None, start: Array, goal: Array, fk_error: Curve
) -> StudyProblem:
    run = published_trajectory(start, goal)
    return StudyProblem(
        seed=seed,
        target_mode=mode,
        start=tuple(start.tolist()),
        goal=tuple(goal.tolist()),
        recorded=run.sequence,
        raw=run.every_mode,
        iterations=run.iterations,
        stop=run.stop,
        error=error_curve(run.q, goal),
        fk_error=fk_error,
    )


def optimal_study(
    problems: Iterable[StudyProblem], robot: str | Robot = "2sra-v1-paper"
) -> Iterator[OptimalProblem]:
    """Yield what the optimal planner does with each problem, and the greedy rule beside it.

    Args:
        problems: Of a study.
        robot: Who is to move; its description's accuracy, if it has one, is the goals' tolerance.
    """
    described = load_robot(robot) if isinstance(robot, str) else robot
    for problem in problems:
        yield _planned(problem, described)


def _planned(studied: StudyProblem, robot: Robot) -> OptimalProblem:
    ends = [
        {"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": tuple(kappa)}
        for x, y, phi, *kappa in (studied.start, studied.goal)
    ]
    values: dict[str, Any] = {"start": ends[0], "goal": ends[1]}
    try:
        problem = Problem(robot=robot, **values)
        result, greedy = plan(problem), plan(problem.with_values(planner="greedy"))
    except InputError as error:
        return OptimalProblem(studied.seed, REFUSED, str(error))
    sequence, duration_s, waiting_s = _durations(result)
    greedy_sequence, greedy_duration_s, greedy_waiting_s = _durations(greedy)
    made = result.plan
    return OptimalProblem(
        seed=studied.seed,
        status=str(result.status),
        message=result.message,
        sequence=sequence,
        cost=made.cost.total if made else math.nan,
        lower_bound=math.nan if result.lower_bound is None else result.lower_bound,
        gap=math.nan if result.gap is None else result.gap,
        duration_s=duration_s,
        waiting_s=waiting_s,
        wall_s=result.stats.wall_s,
        greedy_status=str(greedy.status),
        greedy_sequence=greedy_sequence,
        greedy_duration_s=greedy_duration_s,
        greedy_waiting_s=greedy_waiting_s,
    )


def _durations(result: Result) -> tuple[ModeSequence, float, float]:
    """Sequence, duration and time at rest of a plan that verifies; nothing and NaN without one."""
    made = result.plan
    if made is None or not made.verification.ok:
        return (), math.nan, math.nan
    return made.sequence, made.duration_s, made.duration_s - made.moving_s


def statistics(problems: Sequence[StudyProblem]) -> StudyStatistics:
    """Count what the published loop did.

    Raises:
        InputError: If there is no problem, or the kinds are mixed.
    """
    kinds = {problem.kind for problem in problems}
    if len(kinds) != 1:
        raise InputError("problems", sorted(kinds), "problems of one kind")
    driven = [problem for problem in problems if problem.fk_error]
    deviations = [deviation(problem.fk_error) for problem in driven]
    modes = MODES if driven else ()
    return StudyStatistics(
        kind=kinds.pop(),
        all=_group(problems),
        by_target={mode: _group([p for p in problems if p.target_mode == mode]) for mode in modes},
        sequences=by_size(problem.recorded for problem in problems),
        at_most_four=share(len(problem.recorded) <= 4 for problem in problems),
        last_rigid=share(is_rigid(problem.recorded[-1]) for problem in problems),
        last_rigid_raw=share(is_rigid(problem.raw[-1]) for problem in problems),
        diverged=share(problem.stop is StopReason.DIVERGED for problem in problems),
        fk_deviation=spread(deviations),
        slower_start=share(starts_above(problem.error, problem.fk_error) for problem in driven),
        hardware_wait_s=spread(sum(fixed_waits_s(problem.recorded)) for problem in problems),
    )


def _group(problems: Sequence[StudyProblem]) -> GroupStatistics:
    return GroupStatistics(
        problems=len(problems),
        recorded=in_order(len(problem.recorded) for problem in problems),
        raw=in_order(len(problem.raw) for problem in problems),
        last=in_order(problem.recorded[-1] for problem in problems),
        raw_last=in_order(problem.raw[-1] for problem in problems),
        iterations=spread(problem.iterations for problem in problems),
    )


def optimal_statistics(planned: Sequence[OptimalProblem]) -> OptimalStatistics:
    """Count what the optimal planner did.

    Raises:
        InputError: If there is no problem.
    """
    if not planned:
        raise InputError("planned", 0, "at least one problem")
    made = [each for each in planned if each.sequence]
    both = [each for each in made if each.greedy_sequence]
    return OptimalStatistics(
        problems=len(planned),
        planned=share(bool(each.sequence) for each in planned),
        statuses=by_size(each.status for each in planned),
        sequences=by_size(each.sequence for each in made),
        phases=in_order(len(each.sequence) for each in made),
        last_rigid=share(is_rigid(each.sequence[-1]) for each in made),
        duration_s=spread(each.duration_s for each in made),
        waiting_s=spread(each.waiting_s for each in made),
        gap=spread(each.gap for each in made),
        wall_s=spread(each.wall_s for each in planned),
        both=share(bool(each.greedy_sequence) for each in made),
        shorter=share(each.duration_s < each.greedy_duration_s for each in both),
        saved=spread(1.0 - each.duration_s / each.greedy_duration_s for each in both),
        hardware_wait_s=spread(sum(fixed_waits_s(each.sequence)) for each in made),
    )
