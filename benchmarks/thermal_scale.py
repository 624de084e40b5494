"""A robot that is the same but for the speed of its melting and freezing."""

from __future__ import annotations

from twosra_mpc import InputError, Robot
from twosra_mpc.robot.segment import LumpedSegment


def thermally_faster(robot: Robot, factor: float) -> Robot:
    """Return the robot with all heat capacities and latent heat of its segments divided.

    Density of metal and rubber is divided by ``factor``. The heating wire, which would hold ever
    more of the heat, becomes thinner by factor^(1/4) and shorter by factor^(1/2): its resistance
    stays, its volume is divided by ``factor`` too. Power and losses stay, so every melting and
    freezing time is divided by ``factor``. Ranges of identified parameters are left out.

    Raises:
        InputError: If the robot's segment is not described by its materials.
    """
    segment = robot.segment
    if not isinstance(segment, LumpedSegment):
        raise InputError("robot.segment", robot.name, "a segment by geometry and materials")
    core, wire = segment.core_diameter_m, segment.coil.wire_diameter_m
    thin = wire / factor**0.25
    turns = segment.coil.turns / factor**0.5 * (core + wire) / (core + thin)
    document = robot.model_dump(mode="json")
    document["name"] = f"{robot.name}, {factor:zg} times faster thermally"
    document["segment"]["metal"]["density_kg_per_m3"] /= factor
    document["segment"]["rubber"]["density_kg_per_m3"] /= factor
    document["segment"]["coil"] |= {"wire_diameter_m": thin, "turns": turns}
    document["segment"]["ranges"] = {}
    return Robot.parse(document, robot.name)
