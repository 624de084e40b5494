"""A simulated robot that differs from its description, and runs on it."""
