"""The hardware trials of the paper against its simulations, from their logs.

A log is read by ``identification.motion_log``. Trials and published figures: Labazanova et al.,
IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from twosra_mpc.identification.motion_log import MotionLog
from twosra_mpc.reproduction.published import PublishedTrajectory
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, ModeSequence

Q = tuple[float, ...]  # of [x, y, phi, kappa_1, kappa_2]


@dataclass(frozen=True)
class DtwRow:
    """Distances of a log from a simulation, of x, y, phi, kappa_1 and kappa_2.

    Attributes:
        source: Name of the log.
        published: Distances by the published recipe, without a unit, (5,).
        mean: Mean deviation along the path of time warping [m, m, rad, 1/m, 1/m], (5,).
        largest: Largest deviation along it, likewise.
        rows: Of the log.
        padded: Rows of the simulation that are copies of its last one.
    """

    source: str
    published: Q
    mean: Q
    largest: Q
    rows: int
    padded: int


@dataclass(frozen=True)
class PhaseRow:
    """A phase of a log.

    Attributes:
        mode: Its mode.
        wait_s: Wait before it; of the first phase by the rule, for it is not in the log.
        begin_s: First row, since the log's first.
        end_s: Last row.
        rows: How many.
        start: Configuration of the first row [m, m, rad, 1/m, 1/m].
        end: Of the last.
    """

    mode: Mode
    wait_s: float
    begin_s: float
    end_s: float
    rows: int
    start: Q
    end: Q

    @property
    def motion_s(self) -> float:
        """How long it moved."""
        return self.end_s - self.begin_s


@dataclass(frozen=True)
class WaitingShares:
    """Where the time of a log went.

    Attributes:
        source: Name of the log.
        phases: Its phases.
        first_heating_s: Wait before the log, by the rule.
        waits_s: Waits in the log.
        motion_s: The rest of the log.
        share_waiting: Of all time, the first heating included.
        final_error: Last configuration less the target [m, m, rad, 1/m, 1/m]; empty without one.
    """

    source: str
    phases: tuple[PhaseRow, ...]
    first_heating_s: float
    waits_s: float
    motion_s: float
    share_waiting: float
    final_error: Q

    @property
    def sequence(self) -> ModeSequence:
        """Modes of the phases."""
        return tuple(phase.mode for phase in self.phases)

    @property
    def total_s(self) -> float:
        """All time, the first heating included."""
        return self.first_heating_s + self.waits_s + self.motion_s


def read_trials(folder: str | Path, robot: Robot) -> Iterator[MotionLog]:
    """Yield the log in each CSV file of a folder, by name.

    Raises:
        InputError: If there is none, or one is no log of motion with inputs.
    """
    raise NotImplementedError


def trial_of(log: MotionLog) -> int | None:
    """Trial (1 to 5) whose simulation starts where a log does; None if there is none."""
    raise NotImplementedError


def dtw_table(log: MotionLog, simulation: PublishedTrajectory) -> DtwRow:
    """Compare a log with a simulation, as published and by values alone."""
    raise NotImplementedError


def waiting(log: MotionLog, goal: Sequence[float] | Array | None = None) -> WaitingShares:
    """Tell where the time of a log went; ``goal`` is the target, for the final error."""
    raise NotImplementedError


def fixed_waits_s(sequence: ModeSequence) -> tuple[float, ...]:
    """Wait before each phase by the rule of the trials, for a robot that is rigid at first [s]."""
    raise NotImplementedError
