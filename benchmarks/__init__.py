"""Benchmarks: named problem sets, both planners, one Markdown report."""
