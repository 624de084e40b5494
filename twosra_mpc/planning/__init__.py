"""From a problem to a verified plan: relaxation, search over mode sequences, NLP of a sequence."""
