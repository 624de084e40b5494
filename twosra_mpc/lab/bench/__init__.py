"""Work at the bench: a robot driven by hand, and the closed loop of one heater alone."""
