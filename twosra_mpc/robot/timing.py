"""Sets of transition times as data: from the thermal model, constant, or waited through."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, SerializeAsAny, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.validation import Seconds, Tagged


class Timing(Tagged):
    """Set of transition times; its model is registered with ``timing.model_of``.

    Times that come from the segments are checked by replaying the heater currents.

    Attributes:
        needs_segment: Whether the times come from the thermal description of the segments.
    """

    tag_key = "overlap"
    needs_segment: ClassVar[bool] = False
    overlap: str


class OverlappedTiming(Timing):
    """Constant melt and freeze times; transitions may overlap each other and the motion.

    Only the last ``*_changing_s`` of a transition are spent on the plateau, where nothing may move.
    Heating a molten segment for ``superheat_s`` more brings it to the set-point, from where cooling
    to the plateau takes freeze_s - freeze_changing_s; a shorter heating, as much less.
    """

    overlap: Literal["full"]
    melt_s: Seconds
    melt_changing_s: Seconds
    freeze_s: Seconds
    freeze_changing_s: Seconds
    superheat_s: Seconds

    @property
    def superheat_share(self) -> float:
        """Share of a short liquid period during which the heater must stay on."""
        return self.superheat_s / (self.superheat_s + self.freeze_s - self.freeze_changing_s)

    @model_validator(mode="after")
    def _plateau_within(self) -> OverlappedTiming:
        for kind in ("melt", "freeze"):
            name = f"{kind}_changing_s"
            whole, changing = getattr(self, f"{kind}_s"), getattr(self, name)
            if changing > whole:
                raise InputError(name, changing, f"at most {kind}_s ({whole:zg} s)")
        return self


class SequentialTiming(Timing):
    """The authors' practice: the robot waits a fixed time through every change of mode."""

    overlap: Literal["none"]
    heat_s: Seconds
    freeze_s: Seconds
    reconfigure_s: Seconds
    reconfigure_cool_s: Seconds

    @model_validator(mode="after")
    def _cooling_within(self) -> SequentialTiming:
        if self.reconfigure_cool_s >= self.reconfigure_s:
            allowed = f"less than reconfigure_s ({self.reconfigure_s:zg} s)"
            raise InputError("reconfigure_cool_s", self.reconfigure_cool_s, allowed)
        return self


class ThermalTiming(Timing):
    """Times from the thermal model of the segments; transitions may overlap, as in "full"."""

    needs_segment = True

    overlap: Literal["thermal"]


AnyTiming = Annotated[SerializeAsAny[Timing], BeforeValidator(Timing.of_kind)]
