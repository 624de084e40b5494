"""What was published, reproduced to rounding error: Algorithm 1 and its model."""
