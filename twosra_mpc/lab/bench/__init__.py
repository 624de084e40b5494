"""Work at the bench: a robot driven by hand, and shapes in which its wheels lose control."""
