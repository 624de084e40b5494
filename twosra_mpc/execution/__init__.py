"""Running plans: on anything that can be read and driven, first of all on a simulated robot."""
