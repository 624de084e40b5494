"""The robot as data: geometry, path model, limits, heater and transition times, all SI.

A robot is described by a TOML file; ``2sra-v1`` is built in. Units are in the key names:
m, rad, s, A, ohm, C (degrees Celsius), per_m (1/m).
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from weakref import WeakValueDictionary

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from twosra_mpc import files
from twosra_mpc.arguments import public
from twosra_mpc.errors import MISSING, InputError, doubt
from twosra_mpc.keys import doubts
from twosra_mpc.robot.accuracy import Accuracy
from twosra_mpc.robot.coordinates import Coordinates
from twosra_mpc.robot.geometry import Geometry, MotionLimits
from twosra_mpc.robot.joint_bends import JointBend, Uncertainty
from twosra_mpc.robot.modes import Mode, all_modes, rigid_mode
from twosra_mpc.robot.paths import PATH_MODELS, LogSpiralPath
from twosra_mpc.robot.paths import Path as PathRecord
from twosra_mpc.robot.physics import Physics
from twosra_mpc.robot.segment import AnySegment, Heater, Segment
from twosra_mpc.robot.timing import AnyTiming
from twosra_mpc.thermal.model import SegmentModel
from twosra_mpc.validation import FrozenDict, Several, Value, missing, plain

if TYPE_CHECKING:
    from tomlkit import TOMLDocument


_SAGITTA_M = 2.5e-4  # by which arcs may stray from their chords at the curvature limit


@dataclass(frozen=True, eq=False)
class Body:
    """Body: all that the motion of a robot depends on; the key of compiled functions.

    All robots that move alike have one (``one_body``): to look it up, nothing is compared.
    """

    geometry: Geometry
    path: PathRecord
    limits: MotionLimits

    @property
    def body(self) -> Body:
        """Itself, so that a function of a body can be given a robot."""
        return self

    def chords(self, segment: int) -> int:
        """Number of equal chords that stand for the arc of a segment (from 0)."""
        length, most = self.geometry.lengths_m[segment], self.limits.curvature_per_m
        return max(1, math.ceil(length * math.sqrt(most / (8 * _SAGITTA_M))))

    def __reduce__(self) -> tuple[Any, ...]:
        return one_body, (self.geometry, self.path, self.limits)


_bodies = WeakValueDictionary[tuple[Geometry, PathRecord, MotionLimits], Body]()


def one_body(geometry: Geometry, path: PathRecord, limits: MotionLimits) -> Body:
    """Return the body of these values, the same object as long as any robot has it."""
    return _bodies.setdefault((geometry, path, limits), Body(geometry, path, limits))


class Robot(Value):
    """A complete robot description. ``timing`` maps a name to a set of transition times.

    ``segment`` describes how every segment warms and cools, ``segments`` each for itself; timing
    "thermal" needs one of them. In a file, ``segments = 3`` gives the number of segments that are
    alike (2 if left out), and a list ``[[segment]]`` each with its ``length_m``. ``accuracy`` is
    how near to their goals runs end; where it is missing, plans meet theirs exactly. ``robot_id``
    is for firmware that expects the robot's number as the last one of every line. ``physics`` is
    for simulation in a rigid-body engine; planning does not use it. ``uncertainty`` is what nobody
    knows before trying; plans count with it where a problem's ``risk`` asks for it.
    """

    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    geometry: Geometry
    path: PathRecord
    limits: MotionLimits
    accuracy: Accuracy | None = None
    heater: Heater
    segment: AnySegment | None = None
    segments: Several[AnySegment] = ()
    timing: Annotated[dict[str, AnyTiming], Field(min_length=1), AfterValidator(FrozenDict)]
    physics: Physics | None = None
    uncertainty: Uncertainty | None = None
    robot_id: Annotated[int, Field(ge=0), BeforeValidator(plain)] | None = None

    @property
    def unit_doubts(self) -> tuple[str, ...]:
        """Numbers that are legal and probably in another unit, each with what may be meant."""
        return tuple(doubts(self.model_dump(mode="json")))

    @model_validator(mode="before")
    @classmethod
    def _segments_as_written(cls, data: Any) -> Any:
        """Take ``segments = n`` and ``[[segment]]`` apart into lengths and thermal descriptions."""
        if not isinstance(data, dict):
            return data
        data, count = dict(data), data.get("segments")
        geometry = data.get("geometry")
        if isinstance(count, int) and isinstance(geometry, dict):
            del data["segments"]
            data["geometry"] = {**geometry, "segments": count}
        listed = data.get("segment")
        if isinstance(listed, list) and isinstance(geometry, dict):
            data |= _listed_segments(listed, geometry)
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Robot:
        self.path.check_segments(self.geometry.lengths_m)
        longest, most = max(self.geometry.lengths_m), self.path.largest_bend_rad
        if self.limits.curvature_per_m * longest > most:
            allowed = (
                f"at most {most / longest:z.2f} 1/m, where path model "
                f"{self.path.model} ends (a bending angle of {most:z.3f} rad)"
            )
            raise InputError("limits.curvature_per_m", self.limits.curvature_per_m, allowed)
        if self.segments and len(self.segments) != self.geometry.segments:
            allowed = f"none, or one for each of {self.geometry.segments} segments"
            raise InputError("segments", len(self.segments), allowed)
        thermal = [name for name, times in self.timing.items() if times.needs_segment]
        if thermal and self.segment is None and not self.segments:
            needed = f"a table of keys: timing {thermal[0]} takes its times from it"
            raise InputError("segment", MISSING, needed)
        return self

    @model_validator(mode="after")
    def _melts_below_set_point(self) -> Robot:
        most_C = self.heater.soft_setpoint_C
        for j, segment in enumerate(self.segments or (self.segment,)):
            known = None if segment is None else segment.thresholds_C
            if known is not None and not known[1] < most_C:
                where = f"segments.{j}" if self.segments else "segment"
                allowed = f"less than heater.soft_setpoint_C ({most_C:zg} C), or it never is liquid"
                raise InputError(f"{where}.liquid_above_C", known[1], allowed)
        return self

    @cached_property
    def body(self) -> Body:
        """Body, on which its motion depends."""
        return one_body(self.geometry, self.path, self.limits)

    @property
    def ends_within(self) -> Accuracy:
        """Accuracy of runs at their goals: ``accuracy``, or 2 mm, 1 degree and 1 1/m."""
        return self.accuracy or Accuracy()

    @property
    def joint_bends(self) -> tuple[JointBend, ...]:
        """Ways in which joint bends may end: of ``uncertainty``, or as planned without it."""
        return (self.uncertainty or Uncertainty()).joint_bends

    @property
    def true_physics(self) -> Physics:
        """Masses, stiffness and friction: ``physics``, or what is assumed without it."""
        return self.physics or Physics()

    @cached_property
    def coordinates(self) -> Coordinates:
        """Coordinates of a configuration of this robot."""
        return Coordinates(self.geometry.segments)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Every mode of stiffness, the rigid one first."""
        return all_modes(self.geometry.segments)

    @cached_property
    def rigid(self) -> Mode:
        """The mode in which every segment is solid."""
        return rigid_mode(self.geometry.segments)

    def thermal_segment(self, segment: int) -> Segment:
        """Thermal description of a segment (from 0).

        Raises:
            InputError: If there is no such segment, or the robot file has no ``[segment]``.
        """
        if not 0 <= segment < self.geometry.segments:
            raise InputError("segment", segment, f"from 0 to {self.geometry.segments - 1}")
        found = self.segments[segment] if self.segments else self.segment
        if found is None:
            raise InputError("segment", None, f"a thermal description in robot {self.name}")
        return found

    @property
    def describes_heat(self) -> bool:
        """True if its file says how segments warm and cool."""
        return self.segment is not None or bool(self.segments)

    def __hash__(self) -> int:
        return hash((self.name, self.geometry.segment_length_m, self.path.model))


def _listed_segments(listed: list[Any], geometry: dict[str, Any]) -> dict[str, Any]:
    """Fields of a robot whose file lists its segments."""
    if "segment_length_m" in geometry:
        allowed = "no length here: every [[segment]] has its own length_m"
        raise InputError("geometry.segment_length_m", geometry["segment_length_m"], allowed)
    thermal = []
    for number, entry in enumerate(listed):
        if not isinstance(entry, dict):
            raise InputError(f"segment.{number}", entry, "a table of keys")
        if "length_m" not in entry:
            raise missing("length_m").within(f"segment.{number}")
        thermal.append({key: value for key, value in entry.items() if key != "length_m"})
    lengths = tuple(entry["length_m"] for entry in listed)
    own = thermal if any(thermal) else ()
    lengthened = {**geometry, "segments": len(listed), "segment_length_m": lengths}
    return {"geometry": lengthened, "segment": None, "segments": own}


@lru_cache(maxsize=64)
def segment_model(robot: Robot, ambient_C: float, segment: int) -> SegmentModel:
    """Build the thermal model of a segment (from 0) of a robot.

    Raises:
        InputError: If the robot file has no ``[segment]``.
    """
    length_m = robot.geometry.lengths_m[segment]
    return robot.thermal_segment(segment).thermal_model(length_m, robot.heater, ambient_C)


@public
def load_robot(source: str | Path) -> Robot:
    """Load a built-in robot by name, or a robot TOML/JSON file by path.

    Warns:
        InputWarning: If a number is legal, and probably in another unit.

    Raises:
        InputError: If there is no such robot, or the file describes it wrongly.
    """
    document = files.read_document(files.locate(source, "robots", "robot"), str(source))
    files.check_kind(document, "robot", str(source))
    with files.reading(str(source), "robot"):
        robot = Robot.parse(document, str(source))
    doubt(robot.unit_doubts, str(source))
    return robot


@public
def robot_names() -> list[str]:
    """Names of the built-in robots."""
    return files.built_in_names("robots")


def robot_document(source: str | Path) -> TOMLDocument:
    """Read a robot file (a built-in name or a path) with its comments and layout.

    Raises:
        InputError: If there is none, it cannot be read, or is not a TOML file.
    """
    import tomlkit  # half a second

    path = files.locate(source, "robots", "robot")
    if path.suffix == ".json":
        raise InputError("robot", str(source), "a TOML file, to be copied with its comments")
    return tomlkit.parse(files.read_text(path, str(source)))


SPIRALS = ("log_spiral", "log_spiral_corrected")


@public
def with_path_model(robot: Robot, model: str) -> Robot:
    """Return ``robot`` with the path model of this name.

    A robot that has spiral parameters keeps them for both readings of Table I; parameters that it
    lacks are those fitted to its lengths, if these are a built-in robot's. ``arc`` measures v_j at
    the side wheels.

    Raises:
        InputError: If there is no such path model, or no fit to these lengths.
    """
    if model not in PATH_MODELS:
        raise InputError("path.model", model, f"one of {', '.join(PATH_MODELS)}")
    if model == robot.path.model:
        return robot
    if model == "arc":
        table = {"model": "arc", "speed_reference": "side_wheel"}
    elif isinstance(robot.path, LogSpiralPath) and model in SPIRALS:
        table = {**robot.path.model_dump(), "model": model}
    else:
        table = _fitted(robot.geometry, model)
    return robot.with_values(path=table)


def _fitted(geometry: Geometry, model: str) -> dict[str, Any]:
    """The ``[path]`` table of a model, fitted to these lengths."""
    lengths = {"segment_length_m": geometry.lengths_m[0], "middle_link_m": geometry.middle_link_m}
    for fit in tomllib.loads(files.data_file("robot/fitted_paths.toml"))["fit"]:
        if fit["path"]["model"] == model and lengths.items() <= fit.items():
            return dict(fit["path"])
    allowed = "one that the robot file has: twosra fit-paths fits spirals and cardioids to lengths"
    raise InputError("path.model", model, allowed)
