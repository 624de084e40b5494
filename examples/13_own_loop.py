"""A loop of one's own around the controller's step: a reading in, a command out.

The controller waits for nothing and starts no thread, so it fits any loop: a timer, a ROS node, a
test. `pickle` keeps it, and another process can go on with it.
"""

import pickle

from twosra_mpc import load_problem, plan
from twosra_mpc.execution import LEVELS, SimulatedRobot, plan_controller

made = plan(load_problem("paper-2")).require()
robot = SimulatedRobot(made.problem, "arc", LEVELS["mild"], seed=1)  # or your own

controller, kept = plan_controller(made, robot.camera), b""
try:
    while controller.verdict is None:
        command = controller.step(robot.read())
        robot.send(command.wheel_rad_s, command.heater_setpoint_C)
        robot.wait(command.at_most_s)
        if not kept and controller.belief.changes and controller.belief.stands:
            kept = pickle.dumps(controller)  # here or at any other moment
            controller = pickle.loads(kept)
finally:  # whatever happens, wheels stand and heaters are off
    robot.send(0 * command.wheel_rad_s, 0 * command.heater_setpoint_C)

print(f"{controller.verdict.ending} after {controller.belief.now_s:.0f} s:")
print(controller.verdict.reason)
for event in controller.belief.events:
    print(f"{event.time_s:7.1f} s  {event.text}")
