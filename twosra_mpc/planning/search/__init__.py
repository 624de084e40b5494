"""Search over mode sequences, and the lower bounds that order it. Knows no CasADi."""
