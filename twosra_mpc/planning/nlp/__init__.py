"""The fixed-sequence nonlinear program: direct multiple shooting over a sequence's phases."""
