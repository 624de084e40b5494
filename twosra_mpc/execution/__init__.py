"""Running plans: on anything that can be read and driven, first of all on a simulated robot."""

from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.execution.controller import Controller
from twosra_mpc.execution.executor import Executor, greedy_controller, plan_controller
from twosra_mpc.execution.robot_interface import (
    Camera,
    Command,
    Reading,
    RobotError,
    RobotInterface,
)
from twosra_mpc.execution.run import Ending, Run
from twosra_mpc.execution.run_log import load_run
from twosra_mpc.execution.serial.robot import PoseSource, SerialRobot, connected
from twosra_mpc.execution.settings import ExecutorSettings, Patience
from twosra_mpc.execution.simulation.disturbance import LEVELS, Disturbance
from twosra_mpc.execution.simulation.plant import SimulatedRobot, Truth
from twosra_mpc.execution.simulation.simulate import Metrics, Simulation, Spread, simulate, spread
from twosra_mpc.execution.think_aside import ThinkAside
from twosra_mpc.model.markers import (
    Calibration,
    Marker,
    Markers,
    Sighting,
    calibrated_markers,
    configuration_by_markers,
    load_markers,
    marker_poses,
)
from twosra_mpc.robot.accuracy import Accuracy

__all__ = [
    "LEVELS",
    "Accuracy",
    "Calibration",
    "Camera",
    "Command",
    "Controller",
    "Disturbance",
    "Ending",
    "Executor",
    "ExecutorSettings",
    "KnownStiffness",
    "Marker",
    "Markers",
    "Metrics",
    "Patience",
    "PoseSource",
    "Reading",
    "RobotError",
    "RobotInterface",
    "Run",
    "SerialRobot",
    "Sighting",
    "SimulatedRobot",
    "Simulation",
    "Spread",
    "ThinkAside",
    "Truth",
    "calibrated_markers",
    "configuration_by_markers",
    "connected",
    "greedy_controller",
    "load_markers",
    "load_run",
    "marker_poses",
    "plan_controller",
    "simulate",
    "spread",
]
