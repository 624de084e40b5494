"""A robot in a rigid-body engine: its model as MJCF, and its motion."""
