"""The tracker alone, in a simulator of one's own: feedback against a disturbed plant.

`reset` gives the tracker a plan; `step` turns a measurement into wheel speeds for one period. Here
the plant slips by 8 % and is dragged sideways, and phases begin and end by the plan's clock. While
a segment is soft the wheels bend it, and the place of the robot is left to the next rigid drive.
"""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twosra_mpc import kinematics, load_problem, plan
from twosra_mpc.execution.tracking import Measurement, Tracker

Array = NDArray[np.float64]
RATE_HZ = 15.0

made = plan(load_problem("paper-2")).require()
model = kinematics(made.robot)
tracker = Tracker(made.robot, rate_Hz=RATE_HZ)
tracker.reset(made)


def rate(q: Array, mode: tuple[int, ...], wheel_rad_s: Array) -> Array:
    """Rate of q of the true robot, whose wheels slip least, and all by 8 %."""
    inputs = slice(0, 2) if any(mode) else slice(2, 5)
    jacobian, wheels = (matrix.full()[:, inputs] for matrix in model.shared(q, mode))
    drag_m_s = np.array([0.0, 3e-4, 0.0, 0.0, 0.0])
    return np.asarray(jacobian @ (np.linalg.pinv(wheels) @ (0.92 * wheel_rad_s)) + drag_m_s)


def simulate(feedback: bool) -> list[float]:
    """Return distances to the plan [mm], one a period, phase after phase."""
    q, off_mm, dt_s = made.samples.q[0], [], 1 / RATE_HZ
    for number, phase in enumerate(made.phases):
        for t_s in np.arange(phase.start_s, phase.end_s, dt_s):
            wheels = made.trajectory.at(t_s).wheel_rad_s[0]
            if feedback:
                wheels = tracker.step(Measurement(t_s, number, q)).wheel_rad_s
            middle = q + rate(q, phase.mode, wheels) * dt_s / 2  # midpoint rule
            q = q + rate(middle, phase.mode, wheels) * dt_s
            wanted = made.trajectory.configuration(t_s + dt_s)[0]
            off_mm.append(1e3 * float(np.hypot(*(q - wanted)[:2])))
    return off_mm


figure = Figure(figsize=(6, 3))
ax = figure.add_subplot(xlabel="time in motion [s]", ylabel="middle link off its plan [mm]")
for name, feedback in (("plan's wheel speeds", False), ("tracker", True)):
    off_mm = simulate(feedback)
    ax.plot(np.arange(len(off_mm)) / RATE_HZ, off_mm, label=name)
    print(f"{name}: {off_mm[-1]:.1f} mm off at the end")
ax.legend()
figure.savefig("tracking.png", dpi=120, bbox_inches="tight")
