"""A driver of one's own: what `Executor` needs of a robot, real or simulated, in 60 lines.

This one is simulated with the simplest physics there is: metal with a latent heat, wheels that slip
by 5 %, a perfect camera.
"""

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import Robot, kinematics, load_problem, plan
from twosra_mpc.execution import Camera, Executor, KnownStiffness, Reading

Array = NDArray[np.float64]
DT_S, AIR_C, MELTING_C = 1 / 15, 25.0, 61.0
HEATER_W, LOSS_W_PER_K, J_PER_K, LATENT_J = 4.2, 0.017, 3.3, 148.0


class MyRobot:
    def __init__(self, robot: Robot, q: Array) -> None:
        self.robot, self.camera, self.q = robot, Camera(rate_Hz=1 / DT_S), q
        self.time_s, self.wheel_rad_s, self.heated = 0.0, np.zeros(4), np.zeros(2, dtype=bool)
        self.heat_J = np.full(2, (AIR_C - MELTING_C) * J_PER_K)  # 0: solid, at the melting point
        self.frames = [(0.0, q)]

    def read(self) -> Reading:
        (taken_s, frames), self.frames = zip(*self.frames, strict=True), []
        warm_C = tuple(self.temperature_C().tolist())
        told = self.stiffness(0), self.stiffness(1)
        return Reading(self.time_s, np.array(taken_s), np.array(frames), warm_C, told, (False,) * 2)

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        self.wheel_rad_s, self.heated = 0.95 * wheel_rad_s, heater_setpoint_C > MELTING_C

    def wait(self, at_most_s: float) -> None:
        for _ in range(max(1, round(at_most_s / DT_S))):
            warm_C = self.temperature_C()
            power_W = HEATER_W * (self.heated & (warm_C < 68)) - LOSS_W_PER_K * (warm_C - AIR_C)
            self.heat_J, self.q = self.heat_J + power_W * DT_S, self.q + self.rate() * DT_S
            self.time_s += DT_S
            self.frames.append((self.time_s, self.q))

    def temperature_C(self) -> Array:
        sensible_J = self.heat_J - np.clip(self.heat_J, 0, LATENT_J)
        return np.asarray(MELTING_C + sensible_J / J_PER_K)

    def stiffness(self, segment: int) -> KnownStiffness:
        above_K = self.temperature_C()[segment] - MELTING_C
        return "soft" if above_K > 2 else "rigid" if above_K < -2 else "changing"

    def rate(self) -> Array:  # of q, in the motion with which wheels slip least
        sigma = (self.heat_J > LATENT_J).astype(int)
        inputs = slice(0, 2) if sigma.any() else slice(2, 5)
        jacobian, wheels = kinematics(self.robot).shared(self.q, sigma)
        v = np.linalg.pinv(wheels.full()[:, inputs]) @ self.wheel_rad_s
        return np.asarray(jacobian.full()[:, inputs] @ v)


made = plan(load_problem("paper-2")).require()
run = Executor(MyRobot(made.robot, made.samples.q[0])).run(made)
print(f"{run.ending}: {run.reason}")
