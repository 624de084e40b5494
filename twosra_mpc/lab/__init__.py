"""The laboratory: measurements, the paper reproduced, thousands of plans.

It uses the rest of the package and is used by nothing in it: `twosra_mpc.cli` knows its commands by
their names only.
"""
