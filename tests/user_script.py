"""A user's script that builds every public record; read by mypy --strict, never run."""

import time
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc import (
    Box,
    Carry,
    Conform,
    Disc,
    Follow,
    Goal,
    Grasp,
    InputError,
    Mode,
    Object,
    Obstacle,
    Pass,
    Plan,
    Pose,
    Problem,
    Progress,
    Reach,
    Release,
    Result,
    Robot,
    Round,
    Start,
    Status,
    Task,
    Tolerance,
    Weights,
    Workspace,
    World,
    check_plan,
    explain,
    kinematics,
    load_plan,
    load_robot,
    plan,
    read_obstacles,
    read_outline,
    refined,
    robot_shape,
    save_setpoints,
    with_path_model,
)
from twosra_mpc.execution import (
    Accuracy,
    Camera,
    Disturbance,
    Executor,
    ExecutorSettings,
    KnownStiffness,
    Patience,
    Reading,
    RobotInterface,
    Run,
    SimulatedRobot,
    simulate,
)
from twosra_mpc.execution.tracking import (
    Command,
    Measurement,
    SolverSettings,
    Tracker,
    TrackerLimits,
    TrackerWeights,
)
from twosra_mpc.lab.identification import HeatingLog, identify, read_heating_log
from twosra_mpc.plotting import animate_plan, plot_plan

robot: Robot = load_robot("2sra-v1")
start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0), temperature_C=[25.0, 25.0])
held = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=[20.0, 20.0], holding="cup")
goal = Goal(x_m=0.1, kappa_per_m=[25.0, None], tolerance=Tolerance(x_m=0.01), mode=(1, 0))
problem = Problem(robot=robot, start=start, goal=goal)
obstacles = [
    Obstacle(name="pillar", disc=Disc(x_m=0.3, y_m=0.1, radius_m=0.05)),
    Obstacle(name="wall", box=Box(x_m=(0.5, 0.6), y_m=(-1.0, 1.0))),
    Obstacle(polygon_m=[(1.0, 1.0), (1.1, 1.0), (1.0, 1.1)]),
]
world = World(obstacles=obstacles, clearance_m=0.01, workspace=Workspace(x_m=(-1.0, 1.0)))
cup = Object(name="cup", disc=Round(radius_m=0.03), pose=Pose(x_m=0.3, y_m=0.1))
crate = Object(name="crate", box=Box(x_m=(0.0, 0.1), y_m=(0.0, 0.1)), pose=Pose(x_m=0.0, y_m=0.5))
bean = Object(name="bean", polygon_m=read_outline("bean.csv"), pose=Pose(x_m=0.0, y_m=0.7))
tasks: list[Task] = [
    Pass(x_m=(0.0, 0.1), name="gate"),
    Reach(goal=Goal(x_m=0.2)),
    Conform(object="pillar", segments=[1, 2]),
    Grasp(object="cup", hold="pushed"),
    Carry(object="cup", x_m=0.1, y_m=0.1, phi_rad=0.0),
    Follow(object="cup", path=[(0.1, 0.1), (0.2, 0.1)]),
    Release(object="cup"),
]
mission = Problem(
    robot=robot,
    start=start,
    tasks=tasks,
    objects=[cup, crate, bean],
    obstacles=read_obstacles("lab.geojson"),
    modes=[(0, 0), (1, 0)],
    heaters_at_once=1,
    weights=Weights(effort=1.0),
    heating="keep_warm",
    work_limit=10000.0,
)


Array = NDArray[np.float64]


def told(progress: Progress) -> None:
    print(progress.lower_bound)


try:
    result: Result = plan(problem, on_progress=told)
except InputError as error:
    print(error.field)
made: Plan = result.require()
found: bool = result.status is Status.OPTIMAL and made.verification.ok
modes: list[Mode] = [phase.mode for phase in made.phases]
finer: Plan = refined(made, 1e-3)
save_setpoints(made, Path("setpoints.csv"), rate_Hz=10.0)
check_plan("plan.json")
print(explain(problem), load_plan("plan.json").gap, robot_shape(robot.geometry, [0.0] * 5))
log: HeatingLog = read_heating_log("log.csv")
identify(log, robot)
spirals: Robot = with_path_model(robot, "log_spiral")

model = kinematics(robot)
matrix = model.jacobian(np.zeros(5), (1, 0)).full()
symbolic = model.wheel_matrix(ca.SX.sym("q", 5), ca.DM([1, 0]))[0, 0] * 2


def run(driver: RobotInterface) -> Run:
    print(Camera(rate_Hz=30.0, noise=(1e-3, 0.02, 1.0)))
    return Executor(driver, settings=ExecutorSettings(patience=Patience())).run(made)


class Driver(RobotInterface):
    def read(self) -> Reading:
        return reading

    def send(self, wheel_rad_s: Array, heater_setpoint_C: NDArray[np.float64]) -> None:
        print(wheel_rad_s, heater_setpoint_C)

    def wait(self, at_most_s: float) -> None:
        time.sleep(at_most_s)


class Declared(Driver):
    robot: Robot
    camera: Camera

    def __init__(self, made: Robot) -> None:
        self.robot, self.camera = made, Camera()


class Told(Driver):
    @property
    def robot(self) -> Robot:
        return load_robot("2sra-v1")

    @property
    def camera(self) -> Camera:
        return Camera()


known: tuple[KnownStiffness, KnownStiffness] = ("soft", "changing")
none = np.zeros((0, 5))
reading = Reading(0.0, np.zeros(0), none, (25.0, 25.0), known, (False, False))
for driver in (Declared(robot), Told()):
    run(driver)
run(SimulatedRobot(problem, "none", seed=1))
print(Disturbance())
simulate(problem, disturbance="mild", seed=1)
print(Accuracy(position_m=0.002))

weights, limits, solver = TrackerWeights(), TrackerLimits(), SolverSettings()
tracker = Tracker(robot, horizon=10, weights=weights, limits=limits, solver=solver)
tracker.reset(made)
command: Command = tracker.step(Measurement(time_s=0.0, phase=0, q=[0.0] * 5))
plot_plan(made, "plan.png")
animate_plan(made, "plan.gif", duration_s=5.0)
