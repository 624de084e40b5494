"""Proved lower bounds of stages and of mode sequences; they know no model and no solver."""
