"""A plan as a value: its trajectory, its file, its set-points."""
