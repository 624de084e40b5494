"""Thermal photographs: where a soft segment is in them, and how it is curved."""
