"""Benchmarks: named studies, correctness beside time, one Markdown report each.

``python -m benchmarks NAME --out FOLDER`` runs a study. Everything runs in one thread: the
numerical libraries are told so here, before any of them is loaded.
"""

import os

for _library in ("OMP", "OPENBLAS", "MKL", "BLIS", "NUMEXPR"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
