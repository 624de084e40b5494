"""Plans made without the planner: what they cost may never be below what the planner proves."""
