"""Benchmarks: named suites, correctness beside time, one Markdown report with its figures.

``python -m benchmarks NAME --out FOLDER`` runs a suite. Everything runs in one thread: the
numerical libraries are told so here, before any of them is loaded.
"""

import os

for _library in ("OMP", "OPENBLAS", "MKL", "BLIS", "NUMEXPR"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
