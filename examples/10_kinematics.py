"""Kinematics: the hybrid Jacobian J and the wheel maps V and W, in numbers and in symbols.

q = [x, y, phi, kappa1, kappa2] in m, m, rad, 1/m, 1/m; sigma has a 1 for each soft segment;
v = [v1, v2, u0, v0, r0] in m/s and rad/s. Then q' = J v, and the wheels turn at V v rad/s.
"""

import casadi as ca
import numpy as np

from twosra_mpc import kinematics, load_robot

model = kinematics(load_robot("2sra-v1"))
q = np.array([0.10, -0.05, 0.30, 20.0, -10.0])
v = np.array([0.004, 0.010, 0.020, -0.010, 0.20])
np.set_printoptions(precision=3, suppress=True)

# Numbers: in every mode, only some inputs do anything.
for sigma in [(0, 0), (1, 0), (0, 1), (1, 1)]:
    rate = model.jacobian(q, sigma).full() @ v
    wheel_rad_s = model.wheel_matrix(q, sigma).full() @ v
    print(f"sigma {sigma}: q' = {rate}, wheels {wheel_rad_s} rad/s")

    # V follows from J and the exact map W of (u, v, r, kappa1', kappa2') with u, v, r in b0.
    c, s = np.cos(q[2]), np.sin(q[2])
    in_b0 = np.concatenate([[c * rate[0] + s * rate[1], c * rate[1] - s * rate[0]], rate[2:]])
    assert np.allclose(model.wheel_map(q[3:]).full() @ in_b0, wheel_rad_s)

# Finite differences: W says how far wheels roll, so it follows from where they are.
step, radius_m = np.array([0, 0, 0, 1e-4, 0]), 0.010
after, before = model.wheel_poses(q + step).full(), model.wheel_poses(q - step).full()
moved = (after - before)[:2] / 2e-4  # of each wheel in b0, per kappa1
psi = model.wheel_poses(q).full()[2]
rolled = (np.cos(psi) * moved[0] + np.sin(psi) * moved[1]) / radius_m
assert np.allclose(model.wheel_map(q[3:]).full()[:, 3], rolled, atol=1e-8)

# Symbols: the same functions in an expression of one's own. How fast can segment 1 bend while no
# wheel exceeds 10 rad/s, and how does that change with the shape?
shape = ca.SX.sym("kappa", 2)
unit_input = model.jacobian(ca.vertcat(0, 0, 0, shape), ca.DM([1, 0]))[3, 0]  # kappa1' per v1
fastest = ca.mmax(ca.fabs(model.wheel_matrix(ca.vertcat(0, 0, 0, shape), ca.DM([1, 0]))[:, 0]))
bend_rate = 10.0 * unit_input / fastest  # 1/(m s)
ask = ca.Function("ask", [shape], [bend_rate, ca.gradient(bend_rate, shape)])
most, slope = ask(q[3:])
print(f"segment 1 can bend at {float(most):.2f} 1/(m s); gradient {slope.full().ravel()} 1/s")
