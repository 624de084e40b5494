"""The fixed-sequence nonlinear program: direct multiple shooting over the phases of one sequence."""
