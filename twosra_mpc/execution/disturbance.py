"""How a real robot differs from its model, in four levels with the sources of their numbers.

=====================  =====  ========  =====  ===================================================
                       mild   moderate  hard   source
=====================  =====  ========  =====  ===================================================
wheel slip             3 %    10 %      20 %   stability logs: 6 to 25 %
its spread, its noise  1, 2   3, 5      6, 10  per cent; between wheels, from frame to frame
dead zone [rad/s]      0.05   0.2       0.5    assumed: 0.5 to 5 % of the largest command
pivot [rad/rad]        0.05   0.15      0.36   experiment 3_2: the held unit turned 0.36 a radian
slide [mm/rad]         2      8         48     experiment 6: b0 moved 48 mm sideways a radian
unequal bending        0.5 %  2 %       10 %   experiments 1 and 3: 44 % and 1 %
lengths                0.5 %  1 %       2 %    assumed: measuring 40 mm to 0.2 to 0.8 mm
thermal parameters     half   all       all    ranges in the robot file (5 % and 95 % values)
thermistor, resistor   0.5 %  1 %       2 %    parts of 1 % are the ones that are sold
camera noise           half   once      twice  once: 1 mm, 0.02 rad, 1 1/m, between log phases
camera rounding        once   once      once   1 mm, 0.02 rad, 1 1/m in the logs
camera delay [frames]  1      1 or 2    2      assumed, of 15 Hz
=====================  =====  ========  =====  ===================================================

Except slip and rounding, numbers are standard deviations about the model; pivot, slide and unequal
bending are drawn once for each soft mode, the others once a run.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from twosra_mpc.errors import InputError
from twosra_mpc.execution.robot_interface import EXACT, Camera, OfConfiguration


@dataclass(frozen=True)
class Disturbance:
    """Sizes of everything that the planner does not know.

    Attributes:
        slip: Mean share of a wheel's turn that is lost.
        slip_spread: Standard deviation of that share between wheels.
        slip_noise: Standard deviation of that share from frame to frame.
        dead_zone_rad_s: Slower wheel commands do not turn a wheel.
        pivot_rad_per_rad: Turn of the unit that should hold, per bending angle.
        slide_m_per_rad: Sideways shift of the robot, per bending angle.
        split: Unequal bending of two soft segments, relative to their mean.
        lengths: Relative errors of the geometry's lengths.
        thermal_ranges: Width of the thermal parameters' ranges, 1: as in the robot file.
        thermistor: Relative errors of the thermistor and its resistor.
        camera: Noise and rounding of the frames.
        delay_frames: Least and largest delay of the frames.
    """

    slip: float = 0.0
    slip_spread: float = 0.0
    slip_noise: float = 0.0
    dead_zone_rad_s: float = 0.0
    pivot_rad_per_rad: float = 0.0
    slide_m_per_rad: float = 0.0
    split: float = 0.0
    lengths: float = 0.0
    thermal_ranges: float = 0.0
    thermistor: float = 0.0
    camera: Camera = field(default_factory=Camera)
    delay_frames: tuple[int, int] = (0, 0)


_ROUNDING: OfConfiguration = (1e-3, 1e-3, 0.02, 1.0, 1.0)


def _camera(noise: float) -> Camera:
    x, y, phi, first, second = (noise * value for value in _ROUNDING)
    return Camera(noise=(x, y, phi, first, second), step=_ROUNDING)


LEVELS: dict[str, Disturbance] = {
    "none": Disturbance(camera=Camera(noise=EXACT, step=EXACT)),
    "mild": Disturbance(
        slip=0.03,
        slip_spread=0.01,
        slip_noise=0.02,
        dead_zone_rad_s=0.05,
        pivot_rad_per_rad=0.05,
        slide_m_per_rad=0.002,
        split=0.005,
        lengths=0.005,
        thermal_ranges=0.5,
        thermistor=0.005,
        camera=_camera(0.5),
        delay_frames=(1, 1),
    ),
    "moderate": Disturbance(
        slip=0.10,
        slip_spread=0.03,
        slip_noise=0.05,
        dead_zone_rad_s=0.2,
        pivot_rad_per_rad=0.15,
        slide_m_per_rad=0.008,
        split=0.02,
        lengths=0.01,
        thermal_ranges=1.0,
        thermistor=0.01,
        camera=_camera(1.0),
        delay_frames=(1, 2),
    ),
    "hard": Disturbance(
        slip=0.20,
        slip_spread=0.06,
        slip_noise=0.10,
        dead_zone_rad_s=0.5,
        pivot_rad_per_rad=0.36,
        slide_m_per_rad=0.048,
        split=0.10,
        lengths=0.02,
        thermal_ranges=1.0,
        thermistor=0.02,
        camera=_camera(2.0),
        delay_frames=(2, 2),
    ),
}


def disturbance_level(name: str) -> Disturbance:
    """Look up a level.

    Raises:
        InputError: If there is no such level.
    """
    if name not in LEVELS:
        raise InputError("disturbance", name, f"one of {', '.join(LEVELS)}")
    return LEVELS[name]
