"""Running a controller on a robot: read, step, send, wait, until there is a verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import Controller
from twosra_mpc.execution.following import Following, Think
from twosra_mpc.execution.greedy_rule import Greedy
from twosra_mpc.execution.guard import guard_of
from twosra_mpc.execution.robot_interface import Camera, RobotInterface, stopped_after
from twosra_mpc.execution.run import Run, RunRecord
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.interrupts import Interrupts
from twosra_mpc.planning.planner import plan_again
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.problem import Problem

OnCommand = Callable[[RunRecord], None]


def run_controller(
    robot: RobotInterface, controller: Controller, on_command: OnCommand = lambda record: None
) -> Run:
    """Run a controller on a robot. The robot stands at the end, heaters off.

    So it does whatever ends the run: an error, Ctrl-C, or a signal that ends the program.

    Args:
        robot: The robot.
        controller: Its controller.
        on_command: Called after every command.

    Raises:
        RobotError: If the robot cannot be driven any more.
    """

    def drive(interrupts: Interrupts) -> Run:
        record = RunRecord(controller)
        while True:
            command = controller.step(robot.read())
            record.note()
            robot.send(command.wheel_rad_s, command.heater_setpoint_C)
            interrupts.check()
            on_command(record)
            if controller.verdict is not None:
                return record.run(controller.verdict)
            robot.wait(command.at_most_s)

    return stopped_after(robot, drive)


@public
def plan_controller(
    plan: Plan, camera: Camera, settings: ExecutorSettings | None = None, think: Think = plan_again
) -> Controller:
    """Controller that follows a plan by a camera, and plans the rest again where it must.

    Args:
        plan: The plan; the robot must be where it starts.
        camera: What sees the robot; commands are given at its rate.
        settings: When it is content, and when it gives up.
        think: Plans a problem; None means that it is still at it: it is asked again.

    Raises:
        NoPlanError: If the plan is not verified.
    """
    chosen = settings or ExecutorSettings()
    problem, lag_s = plan.require().problem, chosen.motor_lag_s
    belief = Belief(problem, camera, chosen.patience, motor_lag_s=lag_s)
    return Controller(belief, Following(belief, plan, chosen, think))


@public
def greedy_controller(
    problem: Problem, camera: Camera, settings: ExecutorSettings | None = None
) -> Controller:
    """Controller that drives to a goal by the paper's greedy rule alone; there is no plan.

    Args:
        problem: The problem; the robot must be where it starts.
        camera: What sees the robot; commands are given at its rate.
        settings: When it is content, and when it gives up.

    Raises:
        InputError: If the robot has more or fewer segments than the rule knows, or there are tasks.
    """
    if problem.robot.coordinates.segments != 2:
        raise InputError("executor", "greedy", "optimal: the greedy rule knows two segments")
    if problem.tasks:
        raise InputError("executor", "greedy", "optimal: the greedy rule knows no tasks")
    chosen = settings or ExecutorSettings()
    guard, lag_s = guard_of(problem, chosen.patience), chosen.motor_lag_s
    belief = Belief(problem, camera, chosen.patience, motor_lag_s=lag_s, guard=guard)
    return Controller(belief, Greedy(belief, chosen))


@public
@dataclass(frozen=True)
class Executor:
    """Runs plans on a robot: by events, with a camera, planning again where it must.

    Attributes:
        robot: The robot.
        settings: When it is content, and when it gives up.
        on_command: Called after every command.
        think: Plans what is left; None means that it is still at it: the robot stands meanwhile.
    """

    robot: RobotInterface
    settings: ExecutorSettings = field(default_factory=ExecutorSettings)
    on_command: OnCommand = lambda record: None
    think: Think = plan_again

    def run(self, plan: Plan) -> Run:
        """Run a plan; the robot must be where it starts. It stands at the end, heaters off.

        So it does whatever ends the run: an error, Ctrl-C, or a signal that ends the program.

        Raises:
            InputError: If the plan is for another robot.
            NoPlanError: If the plan is not verified.
            RobotError: If the robot cannot be driven any more.
        """
        plan.require().check_robot(self.robot.robot)
        controller = plan_controller(plan, self.robot.camera, self.settings, self.think)
        return run_controller(self.robot, controller, self.on_command)

    def drive(self, problem: Problem) -> Run:
        """Drive to a goal by the greedy rule alone; the robot must be where the problem starts.

        Raises:
            RobotError: If the robot cannot be driven any more.
            InputError: If the robot has more or fewer segments than the rule knows, or there are
                tasks.
        """
        controller = greedy_controller(problem, self.robot.camera, self.settings)
        return run_controller(self.robot, controller, self.on_command)
