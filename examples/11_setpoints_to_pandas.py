"""Set-points in pandas: heater energy by segment, and how far each wheel rolls in each mode."""

import pandas as pd

from twosra_mpc import load_problem, plan, save_setpoints

made = plan(load_problem("paper-1")).require()
save_setpoints(made, "setpoints.csv", rate_Hz=10.0)

frame = pd.read_csv("setpoints.csv")  # every row holds to the next
dt_s = frame["t_s"].diff().shift(-1, fill_value=0.0)
currents_A = frame.filter(regex=r"^current\d_A$")
energy_J = (currents_A**2).mul(dt_s, axis="index").sum() * made.robot.heater.resistance_ohm
print("heater energy [J], resistance taken as that at 25 C:")
print(energy_J.round(0).to_string())

wheels = frame.filter(regex=r"^wheel\d_rad_s$").abs().mul(dt_s, axis="index")
modes = [frame["mode1"], frame["mode2"]]
print("wheel travel by mode [rad]:")
print(wheels.groupby(modes).sum().round(1).to_string())
