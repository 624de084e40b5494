"""A Gymnasium environment of the simulated robot, for learning: needs `pip install gymnasium`.

An action, held for a second, is the speed of each wheel over its limit, and a number for each
heater: above zero it is on. Observed is what a robot tells: the last frame less the goal,
temperatures, and which segments are soft. The reward is minus the distance from the goal, in units
of the robot's accuracy, for every second.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from twosra_mpc import Problem, load_problem
from twosra_mpc.execution import LEVELS, Accuracy, Reading, SimulatedRobot

Array = NDArray[np.float64]
HOTTEST_C, STEP_S, LIMIT_S = 85.0, 1.0, 1200.0


class SoftRobotEnv(gymnasium.Env[Array, Array]):
    def __init__(self, problem: Problem, level: str = "moderate") -> None:
        self.problem, self.level = problem, level
        coordinates = problem.robot.coordinates
        self.scale = (problem.robot.accuracy or Accuracy()).scale(coordinates)
        actions, told = 4 + coordinates.segments, coordinates.size + 2 * coordinates.segments
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (actions,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-1e6, 1e6, (told,), np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31))  # another robot of this kind
        self.robot = SimulatedRobot(self.problem, "arc", LEVELS[self.level], drawn)
        self.frame = self.problem.start.configuration
        return self.observed(self.robot.read()), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        heater, until_s = self.problem.robot.heater, self.robot.time_s + STEP_S - 1e-9
        wheel_rad_s = action[:4] * self.problem.robot.limits.wheel_speed_rad_s
        setpoint_C = np.where(action[4:] > 0, heater.soft_setpoint_C, heater.rigid_setpoint_C)
        while self.robot.time_s < until_s:
            self.robot.send(wheel_rad_s, setpoint_C)
            self.robot.wait(until_s - self.robot.time_s)
        reading = self.robot.read()
        observed = self.observed(reading)
        far = float(np.abs(self.problem.goal.error(self.frame) / self.scale).max())
        frozen = all(each == "rigid" for each in reading.stiffness)
        ended = (far <= 1.0 and frozen) or max(reading.temperature_C) > HOTTEST_C
        return observed, -far * STEP_S, ended, reading.time_s >= LIMIT_S, {}

    def observed(self, reading: Reading) -> Array:
        self.frame = reading.frames[-1] if len(reading.frames) else self.frame
        soft = [float(each == "soft") for each in reading.stiffness]
        return np.array([*self.problem.goal.error(self.frame), *reading.temperature_C, *soft])


env = SoftRobotEnv(load_problem("paper-2"))
check_env(env, skip_render_check=True)
env.reset(seed=1)
melting = np.array([0.0, 0.0, 0.0, 0.0, 1.0, -1.0])  # segment 1
cost = -sum(float(env.step(melting)[1]) for _ in range(60))
print(f"a minute of waiting for metal costs {cost:.0f}")
