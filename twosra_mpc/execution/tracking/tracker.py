"""The receding-horizon tracker: from where the robot is to what the wheels and heaters should do.

The executor says when phases begin and end; the tracker follows the plan inside the phase it is
told, and goes on converging to the phase's end after the phase's time is over.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.arguments import Word, public
from twosra_mpc.errors import InputError
from twosra_mpc.execution.tracking.linearisation import tracking_program
from twosra_mpc.execution.tracking.setup import Setup, SolverSettings, TrackerLimits, TrackerWeights
from twosra_mpc.execution.tracking.solver import ProgramInPlace, QuadraticProgram, Quality
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Trajectory
from twosra_mpc.robot.coordinates import INPUTS, POSE, WHEELS, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode
from twosra_mpc.validation import ArrayValue

LONGEST_HORIZON = 200
HIGHEST_RATE_HZ = 1000.0
PARTS = 8  # grid points per sampling period; in between, the reference is interpolated linearly


class CommandStatus(Word):
    """Origin of a command."""

    SOLVED = "solved"  # the quadratic program was solved
    HELD = "held"  # between phases: the wheels rest, the heaters follow the plan
    FAILED = "failed"  # no solution: the wheels rest, the heaters keep their set-points


@public
@dataclass(frozen=True, eq=False, repr=False, slots=True)
class Measurement(ArrayValue):
    """Measurement of where the robot is, and which part of the plan it should be following.

    Attributes:
        time_s: Time in the plan [s]; in a phase that started late, the plan's start of the phase
            plus the time since.
        phase: Index of the phase to track, None between phases.
        q: Configuration [x m, y m, phi rad, kappa1 ... kappan 1/m], (3 + n,).
        pace: Share of the planned speed at which it goes on from there, from 1 / `PARTS` to 1.
        cone: Facets of the cone of twists t that keep what is pushed, cone @ t <= 0, (f, 3); none
            where nothing is.

    Raises:
        InputError: If a value is not a finite number.
    """

    time_s: float
    phase: int | None
    q: ArrayLike
    pace: float = 1.0
    cone: ArrayLike = ()

    def __post_init__(self) -> None:
        cone = np.array(self.cone, dtype=float).reshape(-1, POSE)
        object.__setattr__(self, "q", _read_only(np.array(self.q, dtype=float)))
        object.__setattr__(self, "cone", _read_only(cone))
        object.__setattr__(self, "time_s", float(self.time_s))


@dataclass(frozen=True, eq=False, repr=False, slots=True)
class Command(ArrayValue):
    """Command to the robot until the next step; arrays are read-only.

    Attributes:
        wheel_rad_s: Wheel speeds, (4,).
        v: Body input these are for, [v1, v2 m/s, u0, v0 m/s, r0 rad/s], (5,).
        heater_setpoint_C: Temperature set-points of the segments, (n,).
        status: Where the command comes from.
        message: One sentence on a status other than solved.
    """

    wheel_rad_s: Array
    v: Array
    heater_setpoint_C: Array
    status: CommandStatus
    message: str = ""


class PhaseReference:
    """Outputs along a phase, resting at its start before it and at its end after it.

    A tracker asks for a horizon of them within a millisecond: so the trajectory is asked once.
    """

    def __init__(
        self, trajectory: Trajectory, phase: Phase, selection: Array, horizon: int, period_s: float
    ) -> None:
        """Put outputs y = ``selection`` q on a grid that looks ``horizon`` periods either way."""
        self._grid_s = period_s / PARTS
        self._rest = horizon * PARTS
        count = int(np.ceil((phase.end_s - phase.start_s) / self._grid_s)) + 1
        t = np.minimum(phase.start_s + self._grid_s * np.arange(count), phase.end_s)
        outputs = trajectory.configuration(t) @ selection.T
        self._outputs = np.pad(outputs, [(self._rest, self._rest + 2), (0, 0)], mode="edge")
        self._slopes = np.diff(self._outputs, axis=0)
        self._start_s = phase.start_s
        self._last = float(count - 1 + self._rest)

    def write(self, time_s: float, into: Array, pace: float = 1.0) -> None:
        """Write the outputs at ``time_s`` of the plan, and those that follow at a pace."""
        apart = max(1, round(PARTS * pace))
        place = (time_s - self._start_s) / self._grid_s + self._rest
        place = min(max(place, 0.0), self._last)
        first = int(place)
        rows = slice(first, first + self._rest // PARTS * apart + 1, apart)
        np.multiply(self._slopes[rows], place - first, out=into)
        into += self._outputs[rows]


@public
class Tracker:
    """Linear time-varying model predictive control of one robot along a plan, phase by phase.

    Every step linearises the limits, solves one quadratic program (OSQP) and returns its first
    input. Programs are built once per mode; a step only changes numbers in them.

    Attributes:
        last_command: The last command that a step returned; wheels at rest and heaters off before
            the first. Stays as it is when a step refuses a measurement.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        horizon: int = 20,
        rate_Hz: float = 15.0,
        weights: TrackerWeights | None = None,
        limits: TrackerLimits | None = None,
        solver: SolverSettings | None = None,
    ) -> None:
        """Prepare a tracker; ``reset`` gives it a plan.

        Args:
            robot: The robot to drive.
            horizon: Prediction horizon in steps.
            rate_Hz: Steps per second; a command is meant to act for one period.
            weights: What deviations cost.
            limits: Limits of the drives that the robot file does not have.
            solver: Accuracy and effort of the quadratic program.

        Raises:
            InputError: If a value is out of its range.
        """
        if not isinstance(horizon, int | np.integer) or not 2 <= horizon <= LONGEST_HORIZON:
            raise InputError("horizon", horizon, f"from 2 to {LONGEST_HORIZON} steps")
        if not 0 < rate_Hz <= HIGHEST_RATE_HZ:
            raise InputError("rate_Hz", rate_Hz, f"more than 0 and at most {HIGHEST_RATE_HZ:zg} Hz")
        self.robot, self.horizon, self.period_s = robot, horizon, 1.0 / rate_Hz
        self.weights = weights or TrackerWeights()
        self.limits = limits or TrackerLimits()
        self.solver = solver or SolverSettings()
        self._programs: dict[tuple[Mode, int], ProgramInPlace] = {}
        self._phases: list[tuple[Mode, PhaseReference]] | None = None
        self._phase: tuple[int, int] | None = None  # with the facets of its cone
        self._solved_last: ProgramInPlace | None = None
        off = _read_only(np.full(robot.coordinates.segments, robot.heater.rigid_setpoint_C))
        self.last_command = Command(
            _NO_WHEELS, _NO_INPUT, off, CommandStatus.HELD, "no plan is being tracked yet"
        )

    def reset(self, plan: Plan) -> None:
        """Track another plan from the next step on; the wheels are taken to turn as last told.

        Raises:
            InputError: If the plan is for another robot, or its samples are not finite.
            NoPlanError: If the plan is not verified.
        """
        plan.require().check_robot(self.robot)
        samples = plan.samples
        for name in ("t_s", "q", "v", "a", "heater_setpoint_C"):
            if not np.isfinite(getattr(samples, name)).all():
                raise InputError(f"plan.samples.{name}", "not finite", "finite numbers")
        phases = []
        for phase in plan.phases:
            program = self._program(phase.mode)
            selection = program.program.setup.outputs.selection
            path = PhaseReference(plan.trajectory, phase, selection, self.horizon, self.period_s)
            phases.append((phase.mode, path))
        self._phases, self._phase = phases, None
        self._times = samples.t_s.tolist()
        self._heaters: list[Array] = list(samples.heater_setpoint_C)

    def step(self, measurement: Measurement) -> Command:
        """Find what to send to the robot for the coming period.

        Wheels that turn too fast for another phase to stop them at once are stopped between phases.

        Raises:
            InputError: If there is no plan yet, the plan has no such phase, or the robot has more
                or fewer coordinates.
        """
        if self._phases is None:
            raise InputError("plan", None, "a plan, given to reset")
        size = self.robot.coordinates.size
        if np.shape(measurement.q) != (size,):
            raise InputError("measurement.q", np.shape(measurement.q), f"{size} numbers, a row")
        place = bisect_right(self._times, measurement.time_s + SAME_TIME_S) - 1
        phase, heaters = measurement.phase, self._heaters[max(place, 0)]
        if phase is None:
            self._phase = None
            return self._stop(CommandStatus.HELD, heaters, "between phases")
        if not 0 <= phase < len(self._phases):
            allowed = f"None, or a phase of the plan (0 to {len(self._phases) - 1})"
            raise InputError("measurement.phase", phase, allowed)
        mode, path = self._phases[phase]
        cone = np.asarray(measurement.cone)
        program = self._program(mode, len(cone))
        if (phase, len(cone)) != self._phase:
            program.forget()
            self._phase = phase, len(cone)
            if np.abs(self.last_command.wheel_rad_s).max() > program.program.setup.wheel_change:
                return self._stop(CommandStatus.HELD, heaters, "the wheels stop between phases")
        program.measured[:] = measurement.q
        program.facets[:] = cone
        program.wheels[:] = self.last_command.wheel_rad_s
        path.write(measurement.time_s, program.reference, measurement.pace)
        self._solved_last = program
        quality = program.solve()
        if quality is Quality.UNUSABLE:
            return self._stop(
                CommandStatus.FAILED,
                self.last_command.heater_setpoint_C,
                f"wheels stopped, the quadratic program was not solved: {program.describe()}",
            )
        self.last_command = Command(
            _read_only(program.command.copy()),
            _read_only(program.v.copy()),
            heaters,
            CommandStatus.SOLVED,
            "" if quality is Quality.CONVERGED else program.describe(),
        )
        return self.last_command

    def quadratic_program(self) -> QuadraticProgram | None:
        """The program of the last step that solved one, with its solution; None if there is none.

        Its ``residuals()`` tell how well it was solved.
        """
        last = self._solved_last
        return last.quadratic_program() if last is not None and last.iterations else None

    def _program(self, mode: Mode, facets: int = 0) -> ProgramInPlace:
        if (mode, facets) not in self._programs:
            settings = self.horizon, self.period_s, self.weights, self.limits
            setup = Setup(self.robot.body, mode, *settings, facets)
            self._programs[mode, facets] = ProgramInPlace(tracking_program(setup), self.solver)
        return self._programs[mode, facets]

    def _stop(self, status: CommandStatus, heaters: Array, message: str) -> Command:
        self.last_command = Command(_NO_WHEELS, _NO_INPUT, heaters, status, message)
        return self.last_command


def _read_only(array: Array) -> Array:
    array.setflags(write=False)
    return array


_NO_WHEELS, _NO_INPUT = _read_only(np.zeros(WHEELS)), _read_only(np.zeros(INPUTS))
