"""The planning problem: start, goal, limits, weights; frozen and validated."""
