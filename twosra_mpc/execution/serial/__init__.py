"""A plan on real hardware, over a serial line, in the line format of the authors' firmware."""
