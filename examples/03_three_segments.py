"""Three segments: the same planner for a longer chain, one curvature left free.

Robots have one to four segments; curvatures, modes and temperatures then have one entry for each.
"""

from twosra_mpc import Goal, Problem, Start, load_robot, plan
from twosra_mpc.plotting import plot_plan

problem = Problem(
    robot=load_robot("3sra"),
    start=Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=[0.0, 0.0, 0.0]),
    goal=Goal(x_m=0.15, y_m=0.10, phi_rad=0.8, kappa_per_m=[20.0, None, 30.0]),  # 1/m; None: free
)
made = plan(problem).require()
print(made)
print("curvatures at the end [1/m]:", made.samples.q[-1, 3:].round(1))
plot_plan(made, "three-segments.png")
