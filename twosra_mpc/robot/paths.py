"""Path models as data: which curve a locomotion unit follows while the fibre bends."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, SerializeAsAny

from twosra_mpc.errors import InputError
from twosra_mpc.validation import Positive, Tagged, Triple


class OfPath(Tagged):
    """Record of a path model; the model is made from it by ``model.path_models``."""

    tag_key = "model"
    model: str

    @property
    def largest_bend_rad(self) -> float:
        """Largest bending angle that the model describes."""
        raise NotImplementedError

    def check_segments(self, lengths_m: tuple[float, ...]) -> None:
        """Refuse robots the model cannot describe.

        Raises:
            InputError: If the model knows two segments of equal length only, and these are others.
        """
        if len(lengths_m) != 2 or lengths_m[0] != lengths_m[1]:
            listed = ", ".join(f"{length:zg}" for length in lengths_m)
            allowed = f"'arc' for {len(lengths_m)} segments of {listed} m"
            allowed += ": it knows two of equal length only"
            raise InputError("path.model", self.model, allowed)


class LogSpiralPath(OfPath):
    """The paper's path model: locomotion units trace logarithmic spirals I, II, III (Table I).

    ``log_spiral_corrected`` takes row III at the spiral angle it was fitted for (erratum 1).
    """

    model: Literal["log_spiral", "log_spiral_corrected"]
    scale: Triple
    growth: Triple
    angle_ratio: Triple
    smoothing_rad: Positive

    @property
    def largest_bend_rad(self) -> float:
        """Spiral III is defined up to half a circle per segment (eq. kappa_fit3)."""
        return math.pi


class ArcPath(OfPath):
    """Exact constant-curvature arcs; ``speed_reference`` says which point's speed v_j is."""

    model: Literal["arc"]
    speed_reference: Literal["fibre_end", "side_wheel"]

    def check_segments(self, lengths_m: tuple[float, ...]) -> None:
        """Accept every robot: arcs of any number and length."""

    @property
    def largest_bend_rad(self) -> float:
        """A full circle: the series of ``model.series`` are accurate so far."""
        return math.tau


class CardioidPath(OfPath):
    """The follow-up robot's path model: cardioids r = 2 a (1 - cos phi) for cases I, II, III.

    The polar angle is phi = pi + ``phi_per_alpha`` * bending angle, a = ``radius_m``.
    """

    model: Literal["cardioid"]
    radius_m: Triple
    phi_per_alpha: Triple

    @property
    def largest_bend_rad(self) -> float:
        """Bend at which the first of the cardioids comes within half a radian of its cusp [rad]."""
        return (math.pi - 0.5) / max(self.phi_per_alpha)


PATH_MODELS = tuple(OfPath.kinds)
Path = Annotated[SerializeAsAny[OfPath], BeforeValidator(OfPath.of_kind)]
