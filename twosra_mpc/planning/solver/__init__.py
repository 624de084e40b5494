"""Plans of one mode sequence of each stage: guesses, nonlinear programs, ways among obstacles."""
