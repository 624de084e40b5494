"""A batch: one problem for a grid of goals and currents, planned by all cores, as one table.

`twosra batch` goes on where it was interrupted, and plans on any Dask cluster as well.
"""

import subprocess
import sys
from pathlib import Path

from twosra_mpc.lab.batch import read_runs

Path("spec.toml").write_text("""
scenario = "paper-2"

[grid]
"robot.heater.melt_current_A" = [0.7, 0.8, 0.9]
"goal.kappa_per_m.0" = [0.0, 20.0, 40.0]
""")
batch = [sys.executable, "-m", "twosra_mpc", "batch", "spec.toml", "--out", "runs", "--quiet"]
subprocess.run([*batch, "--workers", "1"], check=True)

frame = read_runs("runs")
current, bend = frame.attrs["varied"]
print("duration [s] by current [A] and curvature of segment 1 [1/m]:")
print(frame.pivot(index=current, columns=bend, values="duration_s").round(1).to_string())
