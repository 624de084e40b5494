"""The paper's simulations in number: random problems, what the greedy rule does, what is optimal.

The paper's claims of its simulations (Labazanova et al., IEEE RA-L 2023,
doi 10.1109/LRA.2023.3241749, section "Simulation"): forward kinematics (FK) goes straight to its
end, the planner more slowly at first and then faster; within 100 simulations at most four modes
were used, the last one always rigid.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Self

from twosra_mpc.reproduction.published import StopReason
from twosra_mpc.robot.modes import Mode, ModeSequence

Kind = Literal["single-mode", "generic"]
Q = tuple[float, ...]  # [x, y, phi, kappa_1, kappa_2] in m, rad, 1/m

TIMES = 101  # normalised times 0, 0.01 ... 1 of error curves


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
    error: tuple[float, ...]
    fk_error: tuple[float, ...]

    @property
    def kind(self) -> Kind:
        """How the target was made."""
        return "generic" if self.target_mode is None else "single-mode"

    def to_dict(self) -> dict[str, Any]:
        """The value as plain data for JSON."""
        raise NotImplementedError

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read back what ``to_dict`` wrote."""
        raise NotImplementedError


@dataclass(frozen=True)
class OptimalProblem:
    """What the optimal planner does with a problem of the study; numbers are NaN without a plan.

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
    sequence: ModeSequence
    cost: float
    lower_bound: float
    gap: float
    duration_s: float
    waiting_s: float
    wall_s: float
    greedy_status: str
    greedy_sequence: ModeSequence
    greedy_duration_s: float
    greedy_waiting_s: float

    def to_dict(self) -> dict[str, Any]:
        """The value as plain data for JSON; None for NaN."""
        raise NotImplementedError

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read back what ``to_dict`` wrote."""
        raise NotImplementedError


class Share(NamedTuple):
    """So many of so many, with Wilson's interval of 95 % confidence for the share."""

    count: int
    of: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share; NaN of none."""
        raise NotImplementedError


class Spread(NamedTuple):
    """Quantiles of a number over problems; NaN where there is none."""

    least: float
    p5: float
    median: float
    mean: float
    p95: float
    most: float


@dataclass(frozen=True)
class GroupStatistics:
    """What the loop does with a group of problems.

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
    """What the published loop does with many problems.

    Attributes:
        kind: How their targets were made.
        all: Of all problems.
        by_target: Of those with a target made in each mode; empty for drawn targets.
        sequences: Recorded sequence -> number of problems, most frequent first.
        at_most_four: Problems of at most four recorded phases (the paper: all).
        last_rigid: Problems whose last recorded mode is rigid (the paper: all).
        last_rigid_raw: The same, every iteration counted.
        diverged: Problems on which the loop ran away.
        fk_straight: FK curves within 12 % of a straight line.
        fk_deviation: Largest distance of an FK curve from the straight line.
        slower_start: Planner above FK over all of the first tenth of the time.
        crossing: Normalised time from which the planner stays below FK.
        half: Normalised time at which half the error of the planner is left.
        fk_half: The same of FK.
        twentieth: Normalised time at which 5 % of the error of the planner are left.
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
    fk_straight: Share
    fk_deviation: Spread
    slower_start: Share
    crossing: Spread
    half: Spread
    fk_half: Spread
    twentieth: Spread
    hardware_wait_s: Spread


@dataclass(frozen=True)
class OptimalStatistics:
    """What the optimal planner does with the same problems, those of both planners compared.

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
    """Yield a problem a seed, in order, with what the published loop does with it."""
    raise NotImplementedError


def optimal_study(
    problems: Iterable[StudyProblem], robot: str = "2sra-v1-paper"
) -> Iterator[OptimalProblem]:
    """Yield what the optimal planner does with each problem, for a robot by name."""
    raise NotImplementedError


def statistics(problems: Sequence[StudyProblem]) -> StudyStatistics:
    """Count what the published loop did.

    Raises:
        InputError: If there is no problem, or the kinds are mixed.
    """
    raise NotImplementedError


def optimal_statistics(planned: Sequence[OptimalProblem]) -> OptimalStatistics:
    """Count what the optimal planner did.

    Raises:
        InputError: If there is no problem.
    """
    raise NotImplementedError
