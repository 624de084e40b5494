"""A simulated robot: motion, heated segments, slip, drift, a camera.

It moves by a path model and its disturbances, or in a rigid-body engine.
Everything that the planner does not know is drawn from one seed when the robot is made; the noise
of camera, sensors and wheels comes from another stream of the same seed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.arguments import check_size, public
from twosra_mpc.control.heated_segment import LONGEST_STEP_S, HeatedSegment
from twosra_mpc.control.stiffness import stiffness_controller
from twosra_mpc.control.thermistor import NtcDivider, TemperatureSensor, temperature_sensor
from twosra_mpc.errors import InputError
from twosra_mpc.execution.guard import bends_into_itself
from twosra_mpc.execution.robot_interface import Motors, Reading
from twosra_mpc.execution.simulation.disturbance import Disturbance
from twosra_mpc.model.bending import bending
from twosra_mpc.model.rolling import Drift, dragged, rolling
from twosra_mpc.physics.engine import Engine
from twosra_mpc.planning.planner import plan_again
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array
from twosra_mpc.robot.description import Robot, segment_model, with_path_model
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.joint_bends import JointBend, evened
from twosra_mpc.robot.modes import Mode, all_modes, soft_segments
from twosra_mpc.robot.paths import PATH_MODELS
from twosra_mpc.thermal.model import SegmentModel
from twosra_mpc.thermal.uncertainty import Ranges, drawn, healthy, healthy_ranges
from twosra_mpc.validation import ArrayValue, Count

if TYPE_CHECKING:
    from twosra_mpc.execution.simulation.object_plant import ObjectPlant


class PathMotion:
    """Motion by a path model, with slipping wheels and units that do not hold.

    Attributes:
        q: Configuration, (3 + n,).
    """

    touched: str | None = None  # it goes through obstacles, and is judged by where it was

    def __init__(
        self,
        problem: Problem,
        robot: Robot,
        what: Disturbance,
        drawn: np.random.Generator,
        noise: np.random.Generator,
    ) -> None:
        """Draw how this robot differs from its model.

        Args:
            problem: The start and the objects.
            robot: With the path model and the lengths that are true.
            what: How much it differs.
            drawn: For what differs from robot to robot.
            noise: For what differs from frame to frame.
        """
        self._robot, self._what, self._noise = robot, what, noise
        self.q = problem.start.configuration.copy()
        self._grip = 1 - np.clip(drawn.normal(what.slip, what.slip_spread, WHEELS), 0.0, 0.9)
        modes = all_modes(robot.coordinates.segments)[1:]
        by_number = sorted(modes, key=lambda mode: (sum(mode), mode[::-1]))  # [1,0] first
        self._joint, self._drift = dict[Mode, JointBend](), dict[Mode, Drift]()
        for mode in by_number:
            turn, shift = (what.pivot_rad_per_rad, what.slide_m_per_rad) * drawn.standard_normal(2)
            joint = robot.joint_bends[int(drawn.random() * len(robot.joint_bends))]
            self._joint[mode] = JointBend(*(what.joint_bends * np.array(joint)))
            self._drift[mode] = Drift(turn, shift, self._joint[mode].split)
        self._bends = {mode: drawn.uniform(*what.bend_share) for mode in by_number}
        self._mode: Mode | None = None  # in which it moved last
        self.objects: ObjectPlant | None = None
        if problem.objects:
            from twosra_mpc.execution.simulation.object_plant import ObjectPlant

            self.objects = ObjectPlant(problem, robot.geometry)

    def push(self, by: Array) -> None:
        """Shift and turn the robot about b0 by (3,) [m, m, rad]; wheels slip."""
        self.q = np.concatenate([self.q[:POSE] + by, self.q[POSE:]])

    def at_rest(self, melted: Sequence[float]) -> bool:
        """True unless segments are soft together that were not: they even out."""
        return self._mode == _mode(melted) or sum(_mode(melted)) < 2

    def roll(self, turned: Array, melted: Sequence[float], duration_s: float) -> None:
        """Roll for a period; metal that is changing does not bend yet."""
        q, mode = self.q, _mode(melted)
        if not self.at_rest(melted):
            self.q = self._evened(q, mode)
        self._mode = mode
        grip = self._grip * (1 + self._what.slip_noise * self._noise.standard_normal(WHEELS))
        drift, share = self._drift.get(mode, Drift()), self._bends.get(mode, 1.0)
        roll = rolling(self._robot, mode)
        after: Array = roll(self.q, turned * grip * share, drift).full().ravel()
        if not bends_into_itself(self._robot, self.q, after[None]):  # else the wheels slip
            self.q = after
        gave_way = self.objects is None or self.objects.follow(q, self.q)
        if any(mode) and not gave_way:  # what it closes round keeps it from bending
            self.q = np.concatenate([self.q[:POSE], q[POSE:]])

    def _evened(self, q: Array, mode: Mode) -> Array:
        """Configuration once segments are soft together; the wheels stand, and slip least."""
        facts, soft, after = bending(self._robot), list(soft_segments(mode)), q.copy()
        w = facts.coordinates(q[POSE:])
        w[soft] = evened(self._joint[mode], w[soft])
        after[POSE:] = facts.curvatures(w.tolist())
        after[:POSE] = dragged(self._robot, q, after[POSE:] - q[POSE:], np.zeros(WHEELS))
        return after


def _mode(melted: Sequence[float]) -> Mode:
    return tuple(int(share == 1.0) for share in melted)


AS_PLANNED, PHYSICS = "as-planned", "mujoco"
PLANTS = (AS_PLANNED, *PATH_MODELS)
ALL_PLANTS = (*PLANTS, PHYSICS)
_INSTANT_S = 1e-6
_SHORTEST_LAG = 0.25  # of the sensor's nominal one: 2 to 8 s in all


@public
@dataclass(frozen=True, eq=False, repr=False)
class Truth(ArrayValue):
    """Truth about a simulated robot: what it did; arrays of one length, read-only.

    Attributes:
        time_s: Time, (rows,).
        q: Configuration [m, m, rad, 1/m ...], (rows, 3 + n).
        temperature_C: Of the metal, (rows, n).
        melt_fraction: Of the metal, (rows, n).
        current_A: Heater currents, (rows, n).
        heat_J: Heat of each heater since the start, (rows, n).
        forced_s: How long the wheels have turned while metal was changing, (rows,).
        objects: Poses of the objects [m, m, rad], (rows, objects, 3); empty without any.
        squeezed: Which object was squeezed, what it lay in and how deep; empty if none.
        touched: Obstacle that a rigid-body engine had in contact with the robot, and when; empty if
            none; None of a path model, which goes through obstacles.
    """

    time_s: Array
    q: Array
    temperature_C: Array
    melt_fraction: Array
    current_A: Array
    heat_J: Array
    forced_s: Array
    objects: Array = field(default_factory=lambda: np.empty((0, 0, POSE)))
    squeezed: str = field(default="", kw_only=True)
    touched: str | None = field(default=None, kw_only=True)


def plant_robot(robot: Robot, plant: str) -> Robot:
    """Return the robot with the path model that its simulation shall follow.

    Raises:
        InputError: If there is no such plant.
    """
    if plant not in PLANTS:
        raise InputError("plant", plant, f"one of {', '.join(ALL_PLANTS)}")
    return robot if plant == AS_PLANNED else with_path_model(robot, plant)


@public
class SimulatedRobot:
    """A robot that is not quite what its description says.

    Attributes:
        robot: The robot as described, not as it is.
        camera: What is known about the camera.
        segments: Its segments, as they are.
        physics: Masses, stiffness and friction, as they are in a rigid-body engine.
    """

    def __init__(
        self,
        problem: Problem,
        plant: str = "arc",
        disturbance: Disturbance | None = None,
        seed: Count = 0,
        *,
        broken_heaters: Collection[int] = (),
        viewer: bool = False,
    ) -> None:
        """Put the robot where the problem starts.

        Args:
            problem: Robot, start and air.
            plant: Its true path model, "as-planned", or "mujoco": a rigid-body engine.
            disturbance: What else differs from the model; default: nothing.
            seed: Of all that is drawn at random.
            broken_heaters: Segments (from 1) whose heater never warms.
            viewer: Show the motion in MuJoCo's viewer.

        Raises:
            InputError: If there is no such plant, or the robot's segments are not described; of
                "mujoco", if it is not installed, there is no display for its viewer, or the wheels
                cannot carry the robot.
            RobotError: If the start cannot be simulated.
        """
        what = disturbance or Disturbance()
        drawn = np.random.default_rng([seed, 0])
        self._noise = np.random.default_rng([seed, 1])
        self.robot, self.camera, self._disturbance = problem.robot, what.camera, what
        physics = plant == PHYSICS
        true = plant_robot(problem.robot, AS_PLANNED if physics else plant)
        self._true = with_lengths(true, what.lengths, drawn)
        self._motion: PathMotion | Engine = PathMotion(
            problem, self._true, what, drawn, self._noise
        )
        self._delay = int(drawn.integers(*what.delay_frames, endpoint=True))
        self.segments = heated_segments(
            problem, what, drawn, self._noise, broken_heaters=broken_heaters
        )
        # All else is drawn in any case: one seed, the same heat and sensors.
        rng = np.random.default_rng([seed, 3])
        self.physics = self._true.true_physics.drawn(what.thermal_ranges, rng)
        if physics:
            self._motion = Engine(problem, self._true, self.physics, self._melted)
            if viewer:
                self._motion.view()
        elif viewer:
            raise InputError("viewer", True, f"False: only plant {PHYSICS} has one")
        self._touched = self._motion.touched
        self._told_rad_s, self._motors = np.zeros(WHEELS), Motors(what.motor_lag_s)
        self._setpoint_C = [segment.rigid_setpoint_C for segment in self.segments]
        self._tick, self._forced = 0, 0
        self._on_the_way: list[tuple[int, Array, Array | None]] = []
        self._object_noise = np.random.default_rng([seed, 2])
        self._told: list[tuple[object, ...]] = []
        self._thought: tuple[Result, float] | None = None
        self._photograph(1)
        self._note()

    @property
    def time_s(self) -> float:
        """Time since the start; frames are taken at whole multiples of the camera's period."""
        return self._tick * self.camera.period_s

    def read(self) -> Reading:
        """Return the frames that have arrived, and what the segments' controllers say."""
        due = self._tick - self._delay
        arrived = [item for item in self._on_the_way if item[0] <= due]
        self._on_the_way = [item for item in self._on_the_way if item[0] > due]
        return Reading(
            time_s=self.time_s,
            taken_s=np.array([tick for tick, _, _ in arrived]) * self.camera.period_s,
            frames=np.array([frame for _, frame, _ in arrived]).reshape(-1, len(self.q)),
            temperature_C=tuple(segment.measured_C for segment in self.segments),
            stiffness=tuple(segment.stiffness for segment in self.segments),
            faulty=tuple(segment.faulty for segment in self.segments),
            objects=None
            if self.objects is None
            else np.array([seen for _, _, seen in arrived]).reshape(-1, *self.objects.poses.shape),
            current_A=tuple(segment.told_A() for segment in self.segments),
        )

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        """Set wheels and heaters; wheels that are told to turn too fast turn at their limit.

        Raises:
            InputError: If there are more or fewer, or one is not finite.
        """
        check_size("wheel_rad_s", wheel_rad_s, WHEELS)
        check_size("heater_setpoint_C", heater_setpoint_C, self.robot.geometry.segments)
        most = self.robot.limits.wheel_speed_rad_s
        told = np.clip(wheel_rad_s, -most, most)
        self._told_rad_s = np.where(np.abs(told) < self._disturbance.dead_zone_rad_s, 0.0, told)
        self._setpoint_C = heater_setpoint_C.tolist()

    def wait(self, at_most_s: float) -> None:
        """Let whole camera periods pass, at least one, until a segment reports a new stiffness."""
        left = max(1, round(at_most_s * self.camera.rate_Hz))
        still = max(1, int(LONGEST_STEP_S * self.camera.rate_Hz + 1e-9))
        before = [segment.stiffness for segment in self.segments]
        while left > 0 and before == [segment.stiffness for segment in self.segments]:
            turning = bool(self._told_rad_s.any() or self._motors.rad_s.any())
            moving = turning or not self._motion.at_rest(self._melted)
            ticks = 1 if moving else min(left, still)
            if moving:
                self._roll(turning)
            for segment, setpoint_C in zip(self.segments, self._setpoint_C, strict=True):
                segment.advance(setpoint_C, ticks * self.camera.period_s)
            self._tick += ticks
            left -= ticks
            self._photograph(ticks)
        self._note()

    def push(self, by: Array) -> None:
        """Push the robot: by (3,) [m, m, rad], about b0, whatever its wheels do.

        Raises:
            InputError: If these are not three finite numbers.
        """
        check_size("by", by, POSE)
        self._motion.push(by)

    def think(self, problem: Problem) -> Result | None:
        """Plan while time passes for the robot; None as long as the disturbance says it takes."""
        if self._thought is None:
            made = plan_again(problem)
            self._thought = made, self.time_s + self._disturbance.unit_s * (made.stats.work or 0.0)
        result, end_s = self._thought
        if end_s - self.time_s > _INSTANT_S:
            return None
        self._thought = None
        return result

    def truth(self) -> Truth:
        """Truth so far."""
        columns = [np.array(column, dtype=float) for column in zip(*self._told, strict=True)]
        for column in columns:
            column.setflags(write=False)
        squeezed = "" if self.objects is None else self.objects.squeezed
        return Truth(*columns, squeezed=squeezed, touched=self._touched)

    @property
    def q(self) -> Array:
        """True configuration, (3 + n,)."""
        return self._motion.q

    @property
    def _melted(self) -> list[float]:
        return [segment.melt_fraction for segment in self.segments]

    @property
    def objects(self) -> ObjectPlant | Engine | None:
        """Objects with their ``poses``, (objects, 3) [m, m, rad]; None without any."""
        return self._motion.objects

    @property
    def geometry(self) -> Geometry:
        """Lengths as they truly are."""
        return self._true.geometry

    @property
    def mode(self) -> Mode:
        """Mode in truth: which segments can be bent."""
        return tuple(int(segment.soft) for segment in self.segments)

    def _roll(self, turning: bool) -> None:
        """Move for one period."""
        turned = self._motors.turned(self._told_rad_s, self.camera.period_s)
        self._motion.roll(turned, self._melted, self.camera.period_s)
        self._forced += turning and any(0 < share < 1 for share in self._melted)
        if not self._touched and (name := self._motion.touched) is not None:
            self._touched = name and f"touched {name} at {self.time_s:z.0f} s"

    def _photograph(self, ticks: int) -> None:
        """Take a frame at each of the last ``ticks`` periods, during which the robot rested."""
        coordinates = self.robot.coordinates
        noise, step = coordinates.each(*self.camera.noise), coordinates.each(*self.camera.step)
        seen = self.q + noise * self._noise.standard_normal((ticks, coordinates.size))
        frames = _rounded(seen, step)
        taken = range(self._tick - ticks + 1, self._tick + 1)
        objects: list[Array] | list[None] = [None] * ticks
        if self.objects is not None:  # as b0 is seen
            poses = self.objects.poses
            errors = noise[:POSE] * self._object_noise.standard_normal((ticks, *poses.shape))
            shown = _rounded(poses + errors, step[:POSE])
            lost = self._object_noise.random((ticks, len(poses))) < self._disturbance.objects_lost
            lost[np.array(taken) % (self._disturbance.object_gap + 1) > 0] = True
            objects = list(np.where(lost[..., None], np.nan, shown))
        self._on_the_way += zip(taken, frames, objects, strict=True)

    def _note(self) -> None:
        metal = [(s.temperature_C, s.melt_fraction, s.current_A, s.heat_J) for s in self.segments]
        forced_s = self._forced * self.camera.period_s
        row = (self.time_s, self.q, *zip(*metal, strict=True), forced_s)
        self._told.append(row if self.objects is None else (*row, self.objects.poses.copy()))


def _rounded(seen: Array, step: Array) -> Array:
    """Frames rounded to steps, where there are any."""
    return np.where(step > 0, np.round(seen / np.where(step > 0, step, 1.0)) * step, seen)


def with_lengths(robot: Robot, spread: float, rng: np.random.Generator) -> Robot:
    """Return the robot with lengths that differ by relative errors of this standard deviation."""
    error = 1 + spread * rng.standard_normal(3)
    if spread == 0.0:
        return robot
    geometry = robot.geometry
    lengths = {
        "segment_length_m": tuple(length_m * error[0] for length_m in geometry.lengths_m),
        "middle_link_m": geometry.middle_link_m * error[1],
        "wheel_radius_m": geometry.wheel_radius_m * error[2],
    }
    return robot.with_values(geometry=geometry.with_values(**lengths))


def heated_segments(
    problem: Problem,
    what: Disturbance,
    differences: np.random.Generator,
    noise: np.random.Generator,
    *,
    broken_heaters: Collection[int] = (),
) -> tuple[HeatedSegment, ...]:
    """Draw the segments with their sensors.

    Args:
        problem: Robot, temperatures at the start and air.
        what: How much they differ from their description.
        differences: For these.
        noise: For the sensors' noise.
        broken_heaters: Segments (from 1) whose heater never warms.

    Raises:
        InputError: If the robot's segments are not described, or there are no such segments.
    """
    robot, air, count = problem.robot, problem.ambient, problem.robot.coordinates.segments
    if not set(broken_heaters) <= set(range(1, count + 1)):
        allowed = f"segments {' and '.join(map(str, range(1, count + 1)))}"
        raise InputError("broken_heaters", sorted(broken_heaters), allowed)
    rng = np.random.default_rng(int(differences.integers(2**31)))
    return tuple(
        HeatedSegment(
            true_model(segment_model(robot, air, j), robot.thermal_segment(j).ranges, what, rng),
            true_sensor(temperature_sensor(robot, air, j), what, differences),
            stiffness_controller(robot, air, j),
            problem.temperatures[j],
            noise.standard_normal,
            rigid_setpoint_C=robot.heater.rigid_setpoint_C,
            broken_heater=j + 1 in broken_heaters,
        )
        for j in range(count)
    )


def true_model(
    nominal: SegmentModel, ranges: Ranges, what: Disturbance, rng: np.random.Generator
) -> SegmentModel:
    """Draw a segment's model, from its ranges made narrower or wider."""

    def scaled(middle: float, end: float) -> float:
        return middle + what.thermal_ranges * (end - middle)

    parameters = vars(nominal)
    spread = {
        name: (scaled(parameters[name], low), scaled(parameters[name], high))
        for name, (low, high) in ranges.items()
        if name in parameters
    }
    return healthy(drawn(nominal, spread, rng), healthy_ranges(nominal, spread))


def true_sensor(
    nominal: TemperatureSensor, what: Disturbance, differences: np.random.Generator
) -> TemperatureSensor:
    """Draw a sensor whose parts are off, and which may be faster than its description."""
    parts = what.thermistor * differences.uniform(-1.0, 1.0, 3)
    faster = 1 - what.thermal_ranges * (1 - _SHORTEST_LAG) * differences.random()
    return replace(
        nominal,
        part=NtcDivider().off_by(*parts),
        lags_s=(nominal.lags_s[0] * faster, nominal.lags_s[1] * faster),
        noise_C=nominal.noise_C if what.thermistor > 0 else 0.0,
    )
