"""Thousands of plans: what to plan as a file, on a Dask cluster, into one table."""

from twosra_mpc.lab.batch.table import read_runs

__all__ = ["read_runs"]
