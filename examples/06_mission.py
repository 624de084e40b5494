"""A mission: grasp a cup, carry it elsewhere, put it down; one problem, one plan.

A grasp is proved to cage the object. The metal melts for the next task while the robot still
drives for the one before, where it can.
"""

from twosra_mpc import (
    Carry,
    Grasp,
    Object,
    Pose,
    Problem,
    Release,
    Round,
    Start,
    load_robot,
    plan,
)
from twosra_mpc.plotting import plot_plan

cup = Object(name="cup", disc=Round(radius_m=0.03), pose=Pose(x_m=0.32, y_m=0.10))

problem = Problem(
    robot=load_robot("2sra-v1"),
    start=Start(x_m=-0.30, y_m=-0.25, phi_rad=0.0, kappa_per_m=[0.0, 0.0]),
    objects=[cup],
    tasks=[
        Grasp(object="cup"),
        Carry(object="cup", x_m=-0.30, y_m=0.15),
        Release(object="cup"),
    ],
)
made = plan(problem).require()
for task, done_s in zip(problem.tasks, made.trajectory.done_s, strict=True):
    print(f"{task.do:8} done after {done_s:6.1f} s")
plot_plan(made, "mission.png")
