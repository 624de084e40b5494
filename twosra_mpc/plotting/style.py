"""What the figures have in common: colours, opacity, resolution, matplotlib's settings."""

from __future__ import annotations

from typing import Any

RIGID_COLOUR = "#2a6fbb"
SOFT_COLOUR = "#c8202f"
CHANGING_COLOUR = "#f6b04e"  # melting or freezing
SEGMENT_COLOURS = ("#222222", "#12997c", "#7b5ea7", "#e07b00")
UNIT_COLOURS = SEGMENT_COLOURS[:2]
UNIT_COLOUR, METAL_COLOUR, HEATER_COLOUR = "#eceff1", "#455a64", "#5d4037"
PLANNED_COLOUR = "0.35"  # what shall be: goals, references
PALETTE = (
    *(RIGID_COLOUR, SOFT_COLOUR, CHANGING_COLOUR, *SEGMENT_COLOURS),
    *(UNIT_COLOUR, METAL_COLOUR, HEATER_COLOUR),
)
FAINT = 0.33  # opacity of a pose that is left behind
DPI = 160

STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": "medium",
    "figure.titlesize": 12,
    "figure.titleweight": "bold",
    "figure.facecolor": "white",
    "figure.constrained_layout.h_pad": 0.06,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.7,
    "pdf.fonttype": 42,
}
BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
BARE: dict[str, Any] = {"xticks": (), "yticks": ()}  # axes that show a place, not a quantity
_HATCHED = {"fc": CHANGING_COLOUR, "ec": "white", "lw": 0}
STATES: dict[str, dict[str, Any]] = {
    "rigid": {"fc": RIGID_COLOUR, "lw": 0},
    "melting": _HATCHED | {"hatch": "////"},
    "soft": {"fc": SOFT_COLOUR, "lw": 0},
    "freezing": _HATCHED | {"hatch": r"\\\\"},
    "heater current": {"fc": HEATER_COLOUR, "lw": 0},
}
