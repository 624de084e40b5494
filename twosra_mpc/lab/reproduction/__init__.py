"""Published Algorithm 1 and its model, reproduced to rounding error."""
