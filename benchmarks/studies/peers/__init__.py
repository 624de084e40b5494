"""Peer planners: three textbook ways to solve the same problems, judged like our own plans."""
