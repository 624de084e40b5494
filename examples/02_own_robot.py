"""A robot of one's own: longer segments and a stronger supply, and what they change.

Records are frozen and validated: a changed robot is a new one, and a wrong value is an error that
names its key. What is derived from a robot (kinematics, melting times, bounds) follows by itself.
"""

from matplotlib.figure import Figure

from twosra_mpc import Goal, InputError, Problem, Start, load_robot, plan
from twosra_mpc.plotting import draw_robot

built_in = load_robot("2sra-v1")  # or the path of a TOML file
mine = built_in.with_values(
    name="mine",
    geometry=built_in.geometry.with_values(segment_length_m=0.060),
    limits=built_in.limits.with_values(curvature_per_m=52.0),  # a half circle, as before
    heater=built_in.heater.with_values(melt_current_A=0.9),
)

start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=[0.0, 0.0])
goal = Goal(x_m=0.15, y_m=-0.10, phi_rad=0.5, kappa_per_m=[30.0, -20.0])
figure = Figure(figsize=(7, 2.6))
for ax, robot in zip(figure.subplots(1, 2, sharey=True), (built_in, mine), strict=True):
    made = plan(Problem(robot=robot, start=start, goal=goal)).require()
    print(f"{robot.name}: {made}")
    draw_robot(ax, robot.geometry, made.samples.q[-1], mode=(0, 0))
    ax.set(title=f"{robot.name}: {made.duration_s:.0f} s", xlabel="x [m]", aspect="equal")
figure.savefig("robots.png", dpi=120, bbox_inches="tight")

try:
    built_in.heater.with_values(melt_current_A=2.0)
except InputError as error:
    print(error)
