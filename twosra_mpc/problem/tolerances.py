"""By how much a plan may miss what it must keep, and still be verified: all in one place.

Whatever verification forgives, plans, lower bounds and certificates forgive as well: a lower bound
holds for every plan that is verified. So none of them writes a tolerance of its own.
"""

from __future__ import annotations

OVERLAP_M = 5e-4
"""Overlap allowed with what may be touched."""
TOUCHING_M = 1e-3
"""What is grasped or pushed is no further from the robot."""
