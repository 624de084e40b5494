"""Disturbances of a real robot from its model, in four levels with the sources of their numbers.

Pairs are ranges to draw from, evenly; other numbers are standard deviations about the model, except
slip and rounding. Turn, shift, joint bends and the share of the bend are drawn once for each soft
mode, the others once a run. Thermal parameters are drawn from the ranges in the robot file (5 % and
95 % values), joint bends from its ``[uncertainty]``, with which plans count.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from twosra_mpc.arguments import Range, public
from twosra_mpc.errors import InputError
from twosra_mpc.execution.robot_interface import Camera, OfKind
from twosra_mpc.validation import Count, NonNegative, Share


@public
@dataclass(frozen=True)
class Disturbance:
    """Sizes of everything that the planner does not know.

    Attributes:
        slip: Mean share of a wheel's turn that is lost.
        slip_spread: Standard deviation of that share between wheels.
        slip_noise: Standard deviation of that share from frame to frame.
        dead_zone_rad_s: Slower wheel commands do not turn a wheel.
        motor_lag_s: Time constant of the wheels' motors.
        pivot_rad_per_rad: Turn of the robot that the wheels do not ask for, per bending angle.
        slide_m_per_rad: Sideways shift of the robot, per bending angle.
        joint_bends: Width of the uncertainty of joint bends, 1: as in the robot file.
        bend_share: Share of the commanded bending rate that is reached.
        lengths: Relative errors of the geometry's lengths.
        thermal_ranges: Width of the thermal parameters' ranges, 1: as in the robot file.
        thermistor: Tolerance of the thermistor and its resistor, a share.
        camera: Noise and rounding of the frames.
        object_gap: Frames between those in which objects are looked for.
        objects_lost: Share of those in which an object is not found.
        delay_frames: Least and largest delay of the frames.
        unit_s: How long a unit of work takes when the rest is planned; the last command stays in
            force meanwhile.
        clearance_m: With so much of it the guard stops no rigid drive.
    """

    slip: Share = 0.0
    slip_spread: NonNegative = 0.0
    slip_noise: NonNegative = 0.0
    dead_zone_rad_s: NonNegative = 0.0
    motor_lag_s: NonNegative = 0.0
    pivot_rad_per_rad: NonNegative = 0.0
    slide_m_per_rad: NonNegative = 0.0
    joint_bends: Share = 0.0
    bend_share: Annotated[tuple[NonNegative, NonNegative], Range()] = (1.0, 1.0)
    lengths: NonNegative = 0.0
    thermal_ranges: NonNegative = 0.0
    thermistor: NonNegative = 0.0
    camera: Camera = field(default_factory=Camera)
    object_gap: Count = 0
    objects_lost: Share = 0.0
    delay_frames: Annotated[tuple[Count, Count], Range()] = (0, 0)
    unit_s: NonNegative = 0.0
    clearance_m: NonNegative = 0.005


_ROUNDING: OfKind = (1e-3, 0.02, 1.0)  # of the camera in the logs


def _camera(noise: float) -> Camera:
    position, heading, curvature = (noise * value for value in _ROUNDING)
    return Camera(noise=(position, heading, curvature), step=_ROUNDING)


# Field: its size in the levels mild, moderate and hard, and where the numbers are from.
_SIZES: dict[str, tuple[Any, Any, Any]] = {
    "slip": (0.03, 0.10, 0.20),  # stability logs: 6 to 25 %
    "slip_spread": (0.01, 0.03, 0.06),  # the same
    "slip_noise": (0.02, 0.05, 0.10),  # the same
    "dead_zone_rad_s": (0.05, 0.2, 0.5),  # assumed: 0.5 to 5 % of the largest command
    "motor_lag_s": (0.1, 0.1, 0.1),  # follow-up robot's motor log: settled in 0.2 to 0.35 s
    # Rigid bodies driven by plans' wheel speeds alone, `python -m benchmarks soft-phases`: turns
    # of -0.1 to 0.1 rad, most shifts below 10 mm, most bends by 0.9 to 1.25 times.
    # Twelve soft phases of the authors' logs, given their bends: -0.25 to 0.65 rad, median 0.0.
    "pivot_rad_per_rad": (0.05, 0.15, 0.3),
    "slide_m_per_rad": (0.002, 0.008, 0.015),
    "joint_bends": (0.5, 1.0, 1.0),  # half of the robot file's, or all: there with their sources
    "bend_share": ((0.9, 1.1), (0.7, 1.2), (0.5, 1.3)),  # rigid bodies, as above
    "lengths": (0.005, 0.01, 0.02),  # assumed: measuring 40 mm to 0.2 to 0.8 mm
    "thermal_ranges": (0.5, 1.0, 1.0),  # half of the ranges in the robot file, or all
    "thermistor": (0.005, 0.01, 0.01),  # parts of 1 % are the ones that are sold, and watched
    "camera": (_camera(0.5), _camera(1.0), _camera(2.0)),  # once: as between phases of the logs
    "object_gap": (0, 1, 2),  # assumed
    "objects_lost": (0.01, 0.05, 0.2),  # assumed
    "delay_frames": ((1, 1), (1, 2), (2, 2)),  # assumed, of 15 Hz
    "unit_s": (0.001, 0.002, 0.005),  # assumed: as fast as usual machines, a half, a fifth
    # The most that one of 96 to 103 drives of 2sra-v1 in free space needed, rounded up:
    # ``python -m benchmarks departure``. Nine of ten drives at `hard` need 39 mm.
    "clearance_m": (0.015, 0.025, 0.075),
}

LEVELS: dict[str, Disturbance] = {
    "none": Disturbance(),
    **{
        level: Disturbance(**{name: sizes[column] for name, sizes in _SIZES.items()})
        for column, level in enumerate(("mild", "moderate", "hard"))
    },
}


def disturbance_level(name: str) -> Disturbance:
    """Look up a level.

    Raises:
        InputError: If there is no such level.
    """
    if name not in LEVELS:
        raise InputError("disturbance", name, f"one of {', '.join(LEVELS)}")
    return LEVELS[name]
